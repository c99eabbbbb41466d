//! Our side of the checks against other implementations of DDS (`cargo xtask dds`): does what its words say and prints
//! what happens as lines of JSON. A picture's data are its number (u64), the CRC-32 of what follows, and bytes.
//!
//! ```text
//! ros2_peer --seconds 10 --subscribe /image newest --publish /echo reliable 20000 25 100 --serve ~/observe
//!           --call /other 3 --garbage /noise 10000 --ros-args -r __ns:=/left
//! ```

use std::collections::VecDeque;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use tactile_data::recording::ros::messages::{CompressedImage, Header, Time, from_cdr, to_cdr};
use tactile_live::ros2::{
    Bus, Client, Delivery, Endpoint, Incoming, Level, Publication, Result, Service, Settings, Subscription, arguments,
};

const IMAGE: &str = "sensor_msgs/msg/CompressedImage";

/// What to publish, and how far it is.
struct Publishing {
    topic: Publication,
    n_bytes: usize,
    period: Duration,
    n_left: u64,
    number: u64,
    next: Instant,
    is_garbage: bool,
}

/// What the words ask for.
struct Peer {
    bus: Bus,
    until: Instant,
    subscriptions: Vec<(Subscription, String)>,
    publishing: Vec<Publishing>,
    services: Vec<(Service, String)>,
    clients: Vec<(Client, u64)>,
    is_quiet: bool,
}

fn main() -> Result<()> {
    let words = arguments(std::env::args().skip(1))?;
    let settings = Settings::from_words("peer", &words, |name| std::env::var(name).ok())?;
    let (bus, inbox) = Bus::open(settings)?;
    let mut peer = Peer {
        bus,
        until: Instant::now() + Duration::from_secs(10),
        subscriptions: Vec::new(),
        publishing: Vec::new(),
        services: Vec::new(),
        clients: Vec::new(),
        is_quiet: false,
    };
    peer.set_up(words.own.into())?;
    peer.bus.log(Level::Info, "ready");
    println!("{{\"event\":\"ready\"}}");
    while Instant::now() < peer.until {
        if let Ok(incoming) = inbox.recv_timeout(peer.next_publication()) {
            peer.report(incoming)?;
        }
        peer.publish();
    }
    println!("{{\"event\":\"end\"}}");
    Ok(())
}

impl Peer {
    fn set_up(&mut self, mut words: VecDeque<String>) -> Result<()> {
        while let Some(flag) = words.pop_front() {
            let mut next = || words.pop_front().unwrap_or_default();
            match flag.as_str() {
                "--seconds" => self.until = Instant::now() + Duration::from_secs_f64(number(&next())),
                "--quiet" => self.is_quiet = true,
                "--subscribe" => {
                    let (name, delivery) = (next(), delivery(&next()));
                    self.subscriptions.push((self.bus.subscribe(&name, IMAGE, delivery)?, name));
                }
                "--publish" => {
                    let (name, delivery) = (next(), delivery(&next()));
                    let [n_bytes, rate, n_left] = [number(&next()), number(&next()), number(&next())];
                    let topic = self.bus.advertise(&name, IMAGE, delivery)?;
                    let period = Duration::from_secs_f64(1.0 / rate);
                    self.add(Publishing { n_bytes: n_bytes as usize, period, ..begin(topic, n_left) });
                }
                "--garbage" => {
                    let topic = self.bus.advertise(&next(), IMAGE, Delivery::Reliable)?;
                    let n_left = number(&next());
                    self.add(Publishing { period: Duration::from_millis(1), is_garbage: true, ..begin(topic, n_left) });
                }
                "--serve" => {
                    let name = next();
                    self.services.push((self.bus.serve(&name)?, name));
                }
                "--call" => {
                    let client = self.bus.client(&next())?;
                    self.clients.push((client, number(&next()) as u64));
                }
                other => eprintln!("unknown word {other}"),
            }
        }
        Ok(())
    }

    fn add(&mut self, publishing: Publishing) {
        self.publishing.push(publishing);
    }

    fn next_publication(&self) -> Duration {
        let due = self.publishing.iter().filter(|publishing| publishing.n_left > 0).map(|publishing| publishing.next);
        due.min().map_or(Duration::from_millis(50), |due| due.saturating_duration_since(Instant::now()))
    }

    fn publish(&mut self) {
        for publishing in &mut self.publishing {
            if publishing.n_left == 0 || Instant::now() < publishing.next {
                continue;
            }
            let message = if publishing.is_garbage {
                garbage(publishing.number)
            } else {
                picture(publishing.number, publishing.n_bytes)
            };
            if let Err(error) = self.bus.publish(publishing.topic, &message) {
                println!("{{\"event\":\"unsent\",\"why\":\"{error}\"}}");
            }
            publishing.number += 1;
            publishing.n_left -= 1;
            publishing.next += publishing.period;
        }
    }

    fn report(&mut self, incoming: Incoming) -> Result<()> {
        match incoming {
            Incoming::Message { subscription, cdr, source_ns, lost, .. } => {
                let topic = self.subscriptions.iter().find(|(of, _)| *of == subscription).map_or("", |(_, name)| name);
                match read(&cdr) {
                    Ok(_) if self.is_quiet => {}
                    Ok((number, is_whole, n_bytes, sent_ns)) => {
                        let latency_us = (now_ns() - sent_ns) / 1000;
                        let has_source = source_ns.is_some();
                        println!(
                            "{{\"event\":\"message\",\"topic\":\"{topic}\",\"number\":{number},\"whole\":{is_whole},\
                             \"bytes\":{n_bytes},\"latency_us\":{latency_us},\"lost\":{lost},\"source\":{has_source}}}"
                        );
                    }
                    Err(error) => {
                        let error = format!("{error}").replace('"', "'");
                        println!(
                            "{{\"event\":\"malformed\",\"topic\":\"{topic}\",\"lost\":{lost},\"why\":\"{error}\"}}"
                        );
                    }
                }
            }
            Incoming::Request { service, id, .. } => {
                let name = self.services.iter().find(|(of, _)| *of == service).map_or("", |(_, name)| name);
                println!("{{\"event\":\"request\",\"service\":\"{name}\"}}");
                self.bus.reply(service, &id, true, &format!("done: {name}"))?;
            }
            Incoming::Response { success, message, .. } => {
                println!("{{\"event\":\"response\",\"success\":{success},\"message\":\"{message}\"}}");
            }
            Incoming::Matched { endpoint, n_peers } => {
                println!("{{\"event\":\"matched\",\"endpoint\":\"{endpoint:?}\",\"peers\":{n_peers}}}");
                self.call(endpoint, n_peers)?;
            }
            Incoming::Trouble(trouble) => {
                let text = trouble.to_string().replace('"', "'");
                println!("{{\"event\":\"trouble\",\"text\":\"{text}\"}}");
            }
            other => println!("{{\"event\":\"other\",\"text\":\"{other:?}\"}}"),
        }
        Ok(())
    }

    /// Calls a service whose server was found, as often as was asked for.
    fn call(&mut self, endpoint: Endpoint, n_peers: usize) -> Result<()> {
        for (client, n_calls) in &mut self.clients {
            if n_peers > 0 && endpoint == Endpoint::Client(*client) {
                while *n_calls > 0 && self.bus.call(*client).is_ok() {
                    *n_calls -= 1;
                }
            }
        }
        Ok(())
    }
}

fn begin(topic: Publication, n_left: f64) -> Publishing {
    let next = Instant::now() + Duration::from_secs(1);
    let n_left = n_left as u64;
    Publishing { topic, n_bytes: 0, period: Duration::ZERO, n_left, number: 0, next, is_garbage: false }
}

fn number(word: &str) -> f64 {
    word.parse().unwrap_or(0.0)
}

fn delivery(word: &str) -> Delivery {
    match word {
        "reliable" => Delivery::Reliable,
        "latched" => Delivery::Latched,
        _ => Delivery::Newest,
    }
}

fn now_ns() -> i64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64)
}

/// Bytes that look random, from a number: xorshift.
fn noise(seed: u64, n_bytes: usize) -> impl Iterator<Item = u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    (0..n_bytes).map(move |_| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 24) as u8
    })
}

/// A `CompressedImage` of `n_bytes` of data.
fn picture(number: u64, n_bytes: usize) -> Vec<u8> {
    let rest: Vec<_> = noise(number + 1, n_bytes.saturating_sub(12)).collect();
    let data = [&number.to_le_bytes()[..], &crc32fast::hash(&rest).to_le_bytes(), &rest].concat();
    let header = Header { stamp: Time::of_nanoseconds(now_ns()), frame_id: "gel".into() };
    to_cdr(&CompressedImage { header, format: "jpeg".into(), data })
}

/// A message of random length and bytes behind a right header.
fn garbage(number: u64) -> Vec<u8> {
    let length: usize = noise(number, 2).map(usize::from).sum();
    [0, 1, 0, 0].into_iter().chain(noise(number + 7, length)).collect()
}

/// A picture's number, whether its data are whole, how many they are, and when it was sent.
fn read(message: &[u8]) -> tactile_data::error::Result<(u64, bool, usize, i64)> {
    let CompressedImage { header, data, .. } = from_cdr(message, "picture")?;
    let sent_ns = header.stamp.nanoseconds();
    let (Some(number), Some(crc)) = (data.first_chunk(), data.get(8..12)) else {
        return Ok((u64::MAX, false, data.len(), sent_ns));
    };
    let is_whole = crc32fast::hash(&data[12..]).to_le_bytes() == crc;
    Ok((u64::from_le_bytes(*number), is_whole, data.len(), sent_ns))
}
