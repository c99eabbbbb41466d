//! A node on the network: its topics and services, and the thread that reads them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use rustdds::mio1;

use super::error::{Error, Result};
use super::graph::{self, Level};
use super::inbox::{Inbox, Incoming, Queue};
use super::names;
use super::readers::Reads;
use super::settings::Settings;
use super::state::State;
use super::trigger::{self, Answer};
use super::trouble::Trouble;
use super::wire::{Wish, guarded, options, send};
use super::writers::Writes;
use super::{Call, Client, Delivery, Endpoint, Publication, RequestId, Service, Subscription};

/// How often the thread looks at what rings no bell: peers, the clock, answers that wait.
const TICK: Duration = Duration::from_millis(100);

/// The same while it is open whether readers have what was written.
const QUICK_TICK: Duration = Duration::from_millis(5);

/// A step of the clock that means new connections: RustDDS reads no best-effort message that is older by the clock than
/// the last one, and takes leases for expired.
const CLOCK_STEP: Duration = Duration::from_millis(500);

/// How long a try to open the network again waits for the next one.
const RETRY: Duration = Duration::from_secs(1);

/// Wakes the thread.
const BELL: usize = usize::MAX;

/// A node. Its calls may come from any thread and wait at most 10 ms for the network. Dropping it leaves the network.
pub struct Bus {
    settings: Settings,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
    queue: Arc<Queue>,
    bell: Arc<mio1::Waker>,
    is_over: AtomicBool,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        // Its lists are whole after each step, so a panic elsewhere leaves it usable.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Bus {
    /// Joins the network as a node; what arrives comes out of the inbox.
    ///
    /// # Errors
    /// No network, or no socket free.
    pub fn open(settings: Settings) -> Result<(Self, Inbox)> {
        let what = || format!("node {}", settings.node.full());
        let poll = mio1::Poll::new().map_err(Error::network(what()))?;
        let registry = poll.registry().try_clone().map_err(Error::network(what()))?;
        let bell =
            mio1::Waker::new(poll.registry(), mio1::Token(BELL)).map(Arc::new).map_err(Error::network(what()))?;
        let (inbox, queue) = Inbox::new();
        let state = Mutex::new(State::open(settings.clone(), registry, Arc::clone(&bell))?);
        let shared = Arc::new(Shared { state, queue, bell, is_over: AtomicBool::new(false) });
        let reading = Arc::clone(&shared);
        let thread = std::thread::Builder::new()
            .name("ros2".to_owned())
            .spawn(move || read(poll, &reading))
            .map_err(Error::network(what()))?;
        Ok((Self { settings, shared, thread: Some(thread) }, inbox))
    }

    /// A name in full, remapped.
    ///
    /// # Errors
    /// A name that ROS 2 does not allow.
    pub fn resolve(&self, name: &str) -> Result<String> {
        names::resolve(&self.settings.node, &self.settings.own_name, &self.settings.remaps, name)
    }

    /// Listens to a topic; `message_type` is `package/msg/Name`.
    ///
    /// # Errors
    /// A name or type that ROS 2 does not allow; the middleware refuses.
    pub fn subscribe(&self, name: &str, message_type: &str, delivery: Delivery) -> Result<Subscription> {
        let full = self.resolve(name)?;
        let type_name = names::dds_type(message_type, "")?;
        let wish = Wish { topic: format!("rt{full}"), type_name, delivery };
        let mut state = self.shared.state();
        let subscription = Subscription(state.subscriptions.len());
        let endpoint = Endpoint::Subscription(subscription);
        let reader = state.add_reader(wish, Reads { name: full, ros_type: message_type.to_owned(), endpoint })?;
        state.subscriptions.push(reader);
        self.announced(state)?;
        Ok(subscription)
    }

    /// Publishes a topic; `message_type` is `package/msg/Name`.
    ///
    /// # Errors
    /// A name or type that ROS 2 does not allow; the middleware refuses.
    pub fn advertise(&self, name: &str, message_type: &str, delivery: Delivery) -> Result<Publication> {
        let full = self.resolve(name)?;
        let type_name = names::dds_type(message_type, "")?;
        let wish = Wish { topic: format!("rt{full}"), type_name, delivery };
        let mut state = self.shared.state();
        let publication = Publication(state.publications.len());
        let endpoint = Some(Endpoint::Publication(publication));
        let writer = state.add_writer(wish, Writes { name: full, endpoint, last: None })?;
        state.publications.push(writer);
        self.announced(state)?;
        Ok(publication)
    }

    /// Sends a message: its header `00 01 00 00` and its body in CDR.
    ///
    /// # Errors
    /// Another header; a subscriber that does not keep up; no network.
    pub fn publish(&self, publication: Publication, cdr: &[u8]) -> Result<()> {
        let outlet = {
            let mut state = self.shared.state();
            let writer = state.publications.get(publication.0).copied();
            let writer = writer.ok_or_else(|| Error::Unknown("publication".to_owned()))?;
            state.outlet(writer, cdr)?
        };
        let Some((dds, name)) = outlet else { return Ok(()) };
        // Outside of the lock: sending may wait, and reading must not wait with it.
        send(&dds, &name, cdr, options(None)).map(|_| ())
    }

    /// A line for people, in `/rosout`. What cannot be sent is left out: a log must not stop a node.
    pub fn log(&self, level: Level, text: &str) {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let time_ns = i64::try_from(since_1970.as_nanos()).unwrap_or(i64::MAX);
        let cdr = graph::log(time_ns, level, &self.settings.node, text);
        let outlet = self.shared.state().log_outlet(&cdr);
        if let Ok(Some((dds, name))) = outlet {
            drop(send(&dds, &name, &cdr, options(None)));
        }
    }

    /// Offers a service of type `std_srvs/srv/Trigger`; calls arrive as [`Incoming::Request`].
    ///
    /// # Errors
    /// A name that ROS 2 does not allow; the middleware refuses.
    pub fn serve(&self, name: &str) -> Result<Service> {
        let full = self.resolve(name)?;
        let (request, answer) = trigger_wishes(&full)?;
        let mut state = self.shared.state();
        let service = Service(state.services.len());
        let endpoint = Endpoint::Service(service);
        let ros_type = "std_srvs/srv/Trigger".to_owned();
        // The answers' topic first: who finds the service by its requests can then be answered.
        let writer = state.add_writer(answer, Writes { name: full.clone(), endpoint: None, last: None })?;
        state.services.push(writer);
        state.add_reader(request, Reads { name: full, ros_type, endpoint })?;
        self.announced(state)?;
        Ok(service)
    }

    /// Answers a call. Where the caller's own endpoint is not yet found, the answer waits for it, a second at most.
    ///
    /// # Errors
    /// A handle of another bus; no network.
    pub fn reply(&self, service: Service, id: &RequestId, success: bool, message: &str) -> Result<()> {
        let cdr = trigger::write_answer(id.form, &Answer { success, message: message.to_owned() });
        self.shared.state().reply(service, id, cdr)
    }

    /// Calls services of type `std_srvs/srv/Trigger` of that name.
    ///
    /// # Errors
    /// A name that ROS 2 does not allow; the middleware refuses.
    pub fn client(&self, name: &str) -> Result<Client> {
        let full = self.resolve(name)?;
        let (request, answer) = trigger_wishes(&full)?;
        let mut state = self.shared.state();
        let client = state.add_client(full, request, answer)?;
        self.announced(state)?;
        Ok(client)
    }

    /// Calls the service; the answer arrives as [`Incoming::Response`], or never: the caller decides how long to wait.
    ///
    /// # Errors
    /// Nobody offers the service; no network.
    pub fn call(&self, client: Client) -> Result<Call> {
        self.shared.state().call(client)
    }

    /// Tells the network of new endpoints, and the thread that it has more to read.
    fn announced(&self, mut state: MutexGuard<'_, State>) -> Result<()> {
        state.announce()?;
        drop(state);
        self.shared.bell.wake().map_err(Error::network("the reading thread"))
    }
}

impl Drop for Bus {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        // Without the bell the thread sees it at its next tick.
        let is_rung = self.shared.bell.wake().is_ok();
        debug_assert!(is_rung, "the bell belongs to the thread's own poll");
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has nobody left to hear of it.
            drop(thread.join());
        }
        self.shared.state().close();
        self.shared.queue.close();
    }
}

/// The topics of a service's requests and answers.
fn trigger_wishes(name: &str) -> Result<(Wish, Wish)> {
    let delivery = Delivery::Reliable;
    let type_name = |part| names::dds_type("std_srvs/srv/Trigger", part);
    let request = Wish { topic: format!("rq{name}Request"), type_name: type_name("_Request")?, delivery };
    let answer = Wish { topic: format!("rr{name}Reply"), type_name: type_name("_Response")?, delivery };
    Ok((request, answer))
}

/// The thread: waits for the network, takes what came, looks after the rest.
fn read(mut poll: mio1::Poll, shared: &Shared) {
    let mut events = mio1::Events::with_capacity(64);
    let mut clock = Clock::new();
    let (mut next_try, mut wait) = (Instant::now(), TICK);
    while !shared.is_over.load(Ordering::Acquire) {
        // An interrupted wait is a short one.
        if poll.poll(&mut events, Some(wait)).is_err() {
            events.clear();
        }
        let now = Instant::now();
        let mut state = shared.state();
        // Peers first: what a publisher of another type sends must not be taken.
        let taken = guarded(|| {
            state.look(&shared.queue, now);
            state.take(&shared.queue);
            state.listen(&shared.queue);
        });
        wait = if state.is_settling(now) { QUICK_TICK } else { TICK };
        if let Err(reason) = taken {
            shared.queue.push(Incoming::Trouble(Trouble::NoNetwork { reason }));
            state.abandon();
        }
        if let Some(seconds) = clock.step() {
            shared.queue.push(Incoming::Trouble(Trouble::ClockSet { seconds }));
            state.close();
        }
        if state.is_closed() && now >= next_try {
            next_try = now + RETRY;
            if let Err(error) = state.reopen(&shared.queue) {
                shared.queue.push(Incoming::Trouble(Trouble::NoNetwork { reason: error.to_string() }));
            }
        }
    }
}

/// Sees when the clock is set, by a clock that cannot be.
struct Clock {
    wall: SystemTime,
    steady: Instant,
}

impl Clock {
    fn new() -> Self {
        Self { wall: SystemTime::now(), steady: Instant::now() }
    }

    /// By how many seconds it was set since the last call.
    fn step(&mut self) -> Option<f64> {
        let before = std::mem::replace(self, Self::new());
        let steady = self.steady.duration_since(before.steady);
        let expected = before.wall + steady;
        match self.wall.duration_since(expected) {
            Ok(forward) => (forward > CLOCK_STEP).then_some(forward.as_secs_f64()),
            Err(back) => (back.duration() > CLOCK_STEP).then_some(-back.duration().as_secs_f64()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;
    use tactile_data::recording::ros::messages::{Text, from_cdr, to_cdr};

    /// Time enough for what comes at once on a machine that is busy with other things.
    const PATIENCE: Duration = Duration::from_secs(60);

    /// Time in which a second message would come.
    const MORE: Duration = Duration::from_millis(1500);

    const TYPE: &str = "std_msgs/msg/String";

    fn open(name: &str, domain: u16) -> (Bus, Inbox) {
        // Test programs that run at the same time do not hear each other.
        let domain_id = domain + (std::process::id() % 50) as u16;
        Bus::open(Settings { domain_id, localhost_only: true, ..Settings::new(name).unwrap() }).unwrap()
    }

    /// The beginnings of the texts that come until there are `n`, and in some time more.
    fn texts(inbox: &Inbox, n: usize) -> BTreeMap<Subscription, Vec<String>> {
        let (start, mut found, mut n_found) = (Instant::now(), BTreeMap::<_, Vec<String>>::new(), 0);
        let mut last = start;
        while n_found < n && start.elapsed() < PATIENCE || last.elapsed() < MORE {
            if let Ok(Incoming::Message { subscription, cdr, .. }) = inbox.recv_timeout(Duration::from_millis(20)) {
                let text: Text = from_cdr(&cdr, "text").unwrap();
                found.entry(subscription).or_default().push(text.data.trim_end_matches('.').to_owned());
                (n_found, last) = (n_found + 1, Instant::now());
            }
        }
        found
    }

    /// Without repetitions: on a busy machine the newest message may come again.
    fn once(texts: Option<Vec<String>>) -> Vec<String> {
        let mut texts = texts.unwrap_or_default();
        texts.dedup();
        texts
    }

    /// The next text.
    fn one(inbox: &Inbox) -> Option<String> {
        let start = Instant::now();
        while start.elapsed() < PATIENCE {
            if let Ok(Incoming::Message { cdr, .. }) = inbox.recv_timeout(Duration::from_millis(20)) {
                return from_cdr(&cdr, "text").ok().map(|text: Text| text.data.trim_end_matches('.').to_owned());
            }
        }
        None
    }

    fn connected(inbox: &Inbox, n: usize) {
        let start = Instant::now();
        loop {
            match inbox.recv_timeout(Duration::from_millis(20)) {
                Ok(Incoming::Matched { endpoint: Endpoint::Subscription(_), n_peers }) if n_peers == n => return,
                _ => assert!(start.elapsed() < PATIENCE, "not connected"),
            }
        }
    }

    #[test]
    fn who_comes_late_gets_no_message_but_the_newest_and_who_was_there_each_one() {
        let (node, _inbox) = open("node", 120);
        let label = node.advertise("/label", TYPE, Delivery::Latched).unwrap();
        let publish = |text: &str, n_bytes: usize| {
            node.publish(label, &to_cdr(&Text { data: text.to_owned() + &".".repeat(n_bytes) })).unwrap();
        };
        let (first, first_inbox) = open("first", 120);
        let early = first.subscribe("/label", TYPE, Delivery::Latched).unwrap();
        connected(&first_inbox, 1);
        // One message in one packet, then in several.
        for (round, n_bytes) in [(0, 1), (1, 200_000)] {
            let (waiting, waiting_inbox) = open("waiting", 120);
            let numbers: Vec<String> = (20 * round..20 * round + 12).map(|number| number.to_string()).collect();
            let mut heard = Vec::new();
            for number in &numbers {
                publish(number, n_bytes);
                heard.extend(one(&first_inbox));
            }
            heard.extend(texts(&first_inbox, 0).into_values().flatten());
            assert_eq!(once(Some(heard)), numbers, "the first of all, round {round}");
            let newest = numbers.last().unwrap().clone();
            let late: Vec<_> = ["a", "b", "c"]
                .map(|name| {
                    let (bus, inbox) = open(name, 120);
                    let of = bus.subscribe("/label", TYPE, Delivery::Latched).unwrap();
                    (bus, inbox, of)
                })
                .into();
            for (_, inbox, of) in &late {
                assert_eq!(once(texts(inbox, 1).remove(of)), std::slice::from_ref(&newest), "late, round {round}");
            }
            // A program that was there all the time asks only now.
            let of = waiting.subscribe("/label", TYPE, Delivery::Latched).unwrap();
            assert_eq!(once(texts(&waiting_inbox, 1).remove(&of)), [newest], "waiting, round {round}");
            let next = (20 * round + 15).to_string();
            publish(&next, n_bytes);
            for (_, inbox, of) in &late {
                assert_eq!(once(texts(inbox, 1).remove(of)).last(), Some(&next), "live, round {round}");
            }
            assert_eq!(
                once(texts(&first_inbox, 1).remove(&early)).last(),
                Some(&next),
                "the first of all, round {round}"
            );
        }
    }

    #[test]
    fn the_layout_of_the_graph_is_learned_from_another_node() {
        let domain_id = 180 + (std::process::id() % 50) as u16;
        let settings = |name, identifiers| Settings {
            domain_id,
            localhost_only: true,
            identifiers,
            ..Settings::new(name).unwrap()
        };
        let (learning, _inbox) = Bus::open(settings("learning", None)).unwrap();
        assert_eq!(learning.shared.state().heard(), None);
        let (_humble, _its_inbox) = Bus::open(settings("humble", Some(graph::Identifiers::Long))).unwrap();
        let start = Instant::now();
        while learning.shared.state().heard().is_none() {
            assert!(start.elapsed() < PATIENCE, "nothing was heard");
            std::thread::sleep(Duration::from_millis(20));
        }
        assert_eq!(learning.shared.state().heard(), Some(graph::Identifiers::Long));
    }
}
