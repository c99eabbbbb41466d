//! One participant on the network with its endpoints: what RustDDS makes of our wishes.

use std::collections::BTreeSet;
use std::net::{IpAddr, Ipv4Addr};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::Instant;

use rustdds::bytes::Bytes;
use rustdds::policy::{Durability, History, ResourceLimits};
use rustdds::rpc::SampleIdentity;
use rustdds::{
    DataReaderStatus, DataWriterStatus, DomainParticipant, DomainParticipantBuilder, DomainParticipantStatusEvent,
    DomainParticipantStatusListener, Duration, GUID, QosPolicies, QosPolicyBuilder, RTPSEntity, StatusEvented,
    Timestamp, TopicKind, WriteOptions, WriteOptionsBuilder, mio1, no_key, policy,
};

use super::Delivery;
use super::error::{Error, Result};
use super::graph::{self, Guid};
use super::inbox::DEPTH;
use super::latch::Gate;
use super::raw::Raw;
use super::settings::Settings;

/// Messages that a reliable publisher keeps until everybody has them. A subscriber that has stopped holds up its topic
/// when as many wait.
const MAX_UNACKNOWLEDGED: i32 = 64;

/// How long a message waits for a subscriber that does not keep up: short, since a node's loop waits with it.
const MAX_BLOCKING: Duration = Duration::from_millis(10);

/// Messages of a service, and lines of the log, that are kept.
const OTHERS_DEPTH: i32 = 10;

/// A topic as it is on the wire, and how its messages are passed on.
#[derive(Clone, Debug)]
pub(super) struct Wish {
    /// `rt/gelsight/image`.
    pub(super) topic: String,
    /// `sensor_msgs::msg::dds_::Image_`.
    pub(super) type_name: String,
    pub(super) delivery: Delivery,
}

impl Wish {
    fn qos(&self, is_reader: bool) -> QosPolicies {
        let builder = QosPolicyBuilder::new();
        let limits = ResourceLimits {
            max_samples: MAX_UNACKNOWLEDGED,
            max_instances: 1,
            max_samples_per_instance: MAX_UNACKNOWLEDGED,
        };
        let depth = match self.delivery {
            Delivery::Latched if !is_reader => 1,
            Delivery::Newest => DEPTH as i32,
            _ => OTHERS_DEPTH,
        };
        let builder = builder.history(History::KeepLast { depth });
        match self.delivery {
            Delivery::Newest => builder.best_effort().durability(Durability::Volatile).build(),
            Delivery::Reliable => {
                builder.reliable(MAX_BLOCKING).durability(Durability::Volatile).resource_limits(limits).build()
            }
            Delivery::Latched => {
                builder.reliable(MAX_BLOCKING).durability(Durability::TransientLocal).resource_limits(limits).build()
            }
        }
    }
}

/// A participant.
pub(super) struct Wire {
    participant: DomainParticipant,
    statuses: DomainParticipantStatusListener,
    publisher: rustdds::Publisher,
    subscriber: rustdds::Subscriber,
}

impl Wire {
    pub(super) fn open(settings: &Settings) -> Result<Self> {
        let what = || format!("domain {}", settings.domain_id);
        let mut builder = DomainParticipantBuilder::new(settings.domain_id);
        if settings.localhost_only {
            builder = builder.with_only_networks([IpAddr::V4(Ipv4Addr::LOCALHOST)]);
        }
        let participant = builder.build().map_err(Error::network(what()))?;
        let qos = QosPolicyBuilder::new().build();
        let publisher = participant.create_publisher(&qos).map_err(Error::network(what()))?;
        let subscriber = participant.create_subscriber(&qos).map_err(Error::network(what()))?;
        Ok(Self { statuses: participant.status_listener(), participant, publisher, subscriber })
    }

    pub(super) fn guid(&self) -> Guid {
        self.participant.guid().to_bytes()
    }

    /// What has changed with the readers of others since the last call. A writer's own statuses tell it sooner, but no
    /// more than four at once.
    pub(super) fn changes(&self) -> Vec<Change> {
        let change = |event| match event {
            DomainParticipantStatusEvent::RemoteReaderMatched { local_writer, remote_reader } => {
                Some(Change::Found { writer: local_writer.to_bytes(), reader: remote_reader.to_bytes() })
            }
            DomainParticipantStatusEvent::ReaderLost { guid, .. } => Some(Change::Lost(guid.to_bytes())),
            DomainParticipantStatusEvent::ParticipantLost { id, .. } => {
                let of_program = GUID { prefix: id, ..GUID::from_bytes([0; 16]) };
                let [program @ .., _, _, _, _] = of_program.to_bytes();
                Some(Change::Left(program))
            }
            _ => None,
        };
        std::iter::from_fn(|| self.statuses.try_recv_status()).filter_map(change).collect()
    }

    /// The type that a publisher says its messages have.
    fn type_of(&self, writer: Guid) -> Option<String> {
        let mut data = self.participant.discovered_writers().into_iter().map(|writer| writer.publication_topic_data);
        data.find(|data| data.key.to_bytes() == writer).map(|data| data.type_name)
    }

    pub(super) fn reader(&self, wish: &Wish, registry: &mio1::Registry, token: usize) -> Result<Reader> {
        let qos = wish.qos(true);
        let topic = self.topic(wish, &qos)?;
        let mut dds = self
            .subscriber
            .create_simple_datareader_no_key::<Vec<u8>, Raw>(&topic, Some(qos))
            .map_err(Error::network(&wish.topic))?;
        registry
            .register(&mut dds, mio1::Token(token), mio1::Interest::READABLE)
            .map_err(Error::network(&wish.topic))?;
        Ok(Reader { dds, type_name: wish.type_name.clone(), peers: Peers::default(), strangers: BTreeSet::new() })
    }

    pub(super) fn writer(&self, wish: &Wish) -> Result<Writer> {
        let qos = wish.qos(false);
        let topic = self.topic(wish, &qos)?;
        let dds = self.publisher.create_datawriter_no_key::<Bytes, Raw>(&topic, Some(qos));
        let dds = Arc::new(dds.map_err(Error::network(&wish.topic))?);
        Ok(Writer { dds, peers: Peers::default(), arrivals: Vec::new(), gate: None })
    }

    fn topic(&self, wish: &Wish, qos: &QosPolicies) -> Result<rustdds::Topic> {
        let (name, type_name) = (wish.topic.clone(), wish.type_name.clone());
        let topic = self.participant.create_topic(name, type_name, qos, TopicKind::NoKey);
        topic.map_err(Error::network(&wish.topic))
    }
}

/// For one reader alone, where one is named.
pub(super) fn options(to: Option<Guid>) -> WriteOptions {
    let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now());
    match to {
        Some(reader) => options.to_single_reader(GUID::from_bytes(reader)).build(),
        None => options.build(),
    }
}

/// The graph's and the log's topics.
pub(super) fn wishes_of_the_node() -> [Wish; 2] {
    [(graph::TOPIC, graph::TYPE), (graph::LOG_TOPIC, graph::LOG_TYPE)].map(|(topic, type_name)| Wish {
        topic: topic.to_owned(),
        type_name: type_name.to_owned(),
        delivery: Delivery::Latched,
    })
}

/// The endpoints of others that one of ours is connected with.
#[derive(Debug, Default)]
pub(super) struct Peers {
    pub(super) guids: BTreeSet<Guid>,
    /// The peers that were reported as not fitting.
    reported: BTreeSet<Guid>,
}

/// A change of the readers of others.
#[derive(Debug)]
pub(super) enum Change {
    /// One was connected with one of our writers.
    Found { writer: Guid, reader: Guid },
    /// One is gone.
    Lost(Guid),
    /// A program is gone with all of its readers.
    Left([u8; 12]),
}

/// What is new of an endpoint's peers.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum News {
    /// One more or one less.
    Changed,
    /// A publisher of another type.
    OtherType(String),
    /// One that asks for more than the other offers.
    Incompatible { asked: String, offered: String },
}

impl Peers {
    fn update(&mut self, guid: GUID, change: i32) -> News {
        if change < 0 {
            self.guids.remove(&guid.to_bytes());
        } else {
            self.guids.insert(guid.to_bytes());
        }
        News::Changed
    }

    fn incompatible(&mut self, guid: GUID, asked: &QosPolicies, offered: &QosPolicies) -> Option<News> {
        let is_new = self.reported.insert(guid.to_bytes());
        is_new.then(|| News::Incompatible { asked: words(asked), offered: words(offered) })
    }
}

/// Quality of service in ROS 2's words.
fn words(qos: &QosPolicies) -> String {
    let reliability = match qos.reliability() {
        Some(policy::Reliability::Reliable { .. }) => "RELIABLE",
        _ => "BEST_EFFORT",
    };
    let durability = match qos.durability() {
        None | Some(Durability::Volatile) => "VOLATILE",
        _ => "TRANSIENT_LOCAL",
    };
    format!("{reliability} {durability}")
}

/// A message as it came.
pub(super) struct Sample {
    pub(super) cdr: Vec<u8>,
    pub(super) source_ns: Option<i64>,
    pub(super) received: Instant,
    pub(super) writer: Guid,
    pub(super) number: i64,
    /// What the sender says the message belongs to.
    pub(super) related: Option<SampleIdentity>,
    /// The message itself, as an answer names it.
    pub(super) identity: SampleIdentity,
}

/// A reader of whole messages.
pub(super) struct Reader {
    dds: no_key::SimpleDataReader<Vec<u8>, Raw>,
    type_name: String,
    pub(super) peers: Peers,
    /// Publishers of another type. RustDDS connects with them; their messages must not be read as ours.
    strangers: BTreeSet<Guid>,
}

impl Reader {
    pub(super) fn guid(&self) -> Guid {
        self.dds.guid().to_bytes()
    }

    /// Call before [`Self::take`], so that what comes later rings again.
    pub(super) fn drain(&self) {
        self.dds.drain_read_notifications();
    }

    /// The next message, or why one could not be taken; `None`: no more for now.
    pub(super) fn take(&self) -> Option<std::result::Result<Sample, String>> {
        loop {
            let change = match self.dds.try_take_one() {
                Ok(change) => change?,
                Err(error) => return Some(Err(error.to_string())),
            };
            let writer = change.writer_guid.to_bytes();
            if self.strangers.contains(&writer) {
                continue;
            }
            return Some(Ok(Sample {
                source_ns: change.source_timestamp().and_then(since_1970),
                received: Instant::now(),
                writer,
                number: change.sequence_number.into(),
                related: change.related_sample_identity(),
                identity: SampleIdentity { writer_guid: change.writer_guid, sequence_number: change.sequence_number },
                cdr: change.into_value(),
            }));
        }
    }

    pub(super) fn news(&mut self, wire: &Wire) -> Option<News> {
        while let Some(status) = self.dds.try_recv_status() {
            let news = match status {
                DataReaderStatus::SubscriptionMatched { current, writer, .. } => {
                    self.matched(writer, current.count_change(), wire)
                }
                DataReaderStatus::RequestedIncompatibleQos { writer, requested_qos, offered_qos, .. } => {
                    self.peers.incompatible(writer, &requested_qos, &offered_qos)
                }
                _ => None,
            };
            if news.is_some() {
                return news;
            }
        }
        None
    }
}

impl Reader {
    fn matched(&mut self, writer: GUID, change: i32, wire: &Wire) -> Option<News> {
        let guid = writer.to_bytes();
        if change < 0 {
            let is_ours = !self.strangers.remove(&guid);
            return is_ours.then(|| self.peers.update(writer, change));
        }
        match wire.type_of(guid) {
            Some(other) if other != self.type_name => {
                let is_new = self.strangers.insert(guid);
                is_new.then_some(News::OtherType(other))
            }
            _ => Some(self.peers.update(writer, change)),
        }
    }
}

/// A time on the wire in ns since 1970; `None` where the sender says none.
fn since_1970(time: rustdds::Timestamp) -> Option<i64> {
    let ticks = time.to_ticks();
    let (seconds, fraction) = (ticks >> 32, ticks & u64::from(u32::MAX));
    let is_set = ticks != 0 && seconds != u64::from(u32::MAX);
    // Rounded: the fraction is in 1 / 2^32 s, about 0.23 ns.
    let ns = (fraction * 1_000_000_000 + (1 << 31)) >> 32;
    is_set.then(|| (seconds * 1_000_000_000 + ns) as i64)
}

/// A writer of whole messages.
pub(super) struct Writer {
    pub(super) dds: Arc<no_key::DataWriter<Bytes, Raw>>,
    pub(super) peers: Peers,
    /// Readers that were found since somebody looked.
    pub(super) arrivals: Vec<Guid>,
    /// What a reader of a latched topic has to pass.
    pub(super) gate: Option<Arc<Gate>>,
}

impl Writer {
    pub(super) fn guid(&self) -> Guid {
        self.dds.guid().to_bytes()
    }

    /// A reader is connected with; whether that is news.
    pub(super) fn found(&mut self, reader: Guid) -> bool {
        let is_news = self.peers.guids.insert(reader);
        self.arrivals.extend(is_news.then_some(reader));
        is_news
    }

    /// A reader is gone; whether it was connected with.
    pub(super) fn lost(&mut self, reader: &Guid) -> bool {
        self.arrivals.retain(|arrival| arrival != reader);
        self.peers.guids.remove(reader)
    }

    fn status(&self) -> Option<DataWriterStatus> {
        self.dds.try_recv_status().or_else(|| self.gate.as_ref()?.arm(&self.dds))
    }

    /// Whether everybody has all messages.
    pub(super) fn is_acked(&self) -> bool {
        self.dds.wait_for_acknowledgments(std::time::Duration::ZERO).unwrap_or(false)
    }

    pub(super) fn news(&mut self) -> Option<News> {
        while let Some(status) = self.status() {
            let news = match status {
                DataWriterStatus::PublicationMatched { current, reader, .. } => {
                    let guid = reader.to_bytes();
                    let is_news = if current.count_change() > 0 { self.found(guid) } else { self.lost(&guid) };
                    is_news.then_some(News::Changed)
                }
                DataWriterStatus::OfferedIncompatibleQos { reader, requested_qos, offered_qos, .. } => {
                    self.peers.incompatible(reader, &requested_qos, &offered_qos)
                }
                _ => None,
            };
            if news.is_some() {
                return news;
            }
        }
        None
    }
}

/// Sends a whole message, which must be plain CDR, little endian.
pub(super) fn send(
    dds: &no_key::DataWriter<Bytes, Raw>,
    topic: &str,
    cdr: &[u8],
    options: WriteOptions,
) -> Result<SampleIdentity> {
    let [0, 1, 0, 0, body @ ..] = cdr else {
        return Err(Error::NotCdr { topic: topic.to_owned(), got: super::trigger::beginning(cdr) });
    };
    let written = guarded(|| dds.write_with_options(Bytes::copy_from_slice(body), options));
    written.map_err(Error::network(topic))?.map_err(|error| match error {
        rustdds::dds::result::WriteError::WouldBlock { .. } => Error::Congested { topic: topic.to_owned() },
        other => Error::Network { what: topic.to_owned(), reason: other.to_string() },
    })
}

/// Runs what calls RustDDS, which panics where one of its threads did: the reason of a panic.
pub(super) fn guarded<T>(run: impl FnOnce() -> T) -> std::result::Result<T, String> {
    // What is left half done is abandoned with the network.
    catch_unwind(AssertUnwindSafe(run)).map_err(|panic| {
        let text = panic.downcast_ref::<String>().map(String::as_str).or(panic.downcast_ref::<&str>().copied());
        format!("the middleware failed: {}", text.unwrap_or("no reason given"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_below_becomes_its_reason() {
        assert_eq!(guarded(|| 3), Ok(3));
        let broken = guarded(|| panic!("a poisoned lock"));
        assert_eq!(broken, Err("the middleware failed: a poisoned lock".to_owned()));
    }

    #[test]
    fn a_time_on_the_wire_is_read_to_the_nanosecond() {
        for ns in [1u64, 999_999_999, 1_700_000_000_123_456_789] {
            let (seconds, rest) = (ns / 1_000_000_000, ns % 1_000_000_000);
            let ticks = (seconds << 32) | ((rest << 32) / 1_000_000_000);
            assert_eq!(since_1970(Timestamp::from_ticks(ticks)), Some(ns as i64));
        }
        for unset in [Timestamp::ZERO, Timestamp::INVALID, Timestamp::INFINITE] {
            assert_eq!(since_1970(unset), None);
        }
    }
}
