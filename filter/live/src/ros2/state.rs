//! What a bus has: its wishes, which last, and its endpoints, which are made anew when the network is.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rustdds::bytes::Bytes;
use rustdds::rpc::SampleIdentity;
use rustdds::{GUID, Timestamp, WriteOptionsBuilder, mio1, no_key};

use super::error::{Error, Result};
use super::graph;
use super::inbox::{Incoming, Queue};
use super::raw::Raw;
use super::settings::Settings;
use super::trigger::{self, Form};
use super::trouble::Trouble;
use super::wire::{News, Reader, Sample, Wire, Wish, Writer, send, wishes_of_the_node};
use super::{Call, Client, Delivery, Endpoint, RequestId, Service};

/// How long a subscription waits for a publisher before that is reported.
const PATIENCE: Duration = Duration::from_secs(5);

/// How long an answer waits for its caller's endpoint.
const ANSWER_PATIENCE: Duration = Duration::from_secs(1);

/// How long a server that was found is given to find us as well: a request before that would be lost.
const SETTLING: Duration = Duration::from_millis(300);

/// How often messages that were left out are reported.
const REPORT: Duration = Duration::from_secs(1);

/// Calls without an answer that are remembered.
const MAX_CALLS: usize = 64;

/// Answers that wait for their callers' endpoints.
const MAX_ANSWERS: usize = 64;

/// How the identifiers of a CycloneDDS program begin (RTPS 2.5, 8.2.4: the vendor).
const CYCLONE: [u8; 2] = [1, 0x10];

/// What a reader is for.
pub(super) struct Reads {
    pub(super) name: String,
    pub(super) ros_type: String,
    pub(super) endpoint: Endpoint,
}

/// What a writer is for.
pub(super) struct Writes {
    pub(super) name: String,
    /// Whose peers its readers are; `None`: nobody asks.
    pub(super) endpoint: Option<Endpoint>,
    /// The last message of a latched topic, sent again when the network is made anew.
    pub(super) last: Option<Vec<u8>>,
}

struct ReaderSlot {
    wish: Wish,
    reads: Reads,
    reader: Option<Reader>,
    /// Since when it has no peer; `None` once that is reported.
    alone_since: Option<Instant>,
    /// The last number of each publisher.
    numbers: Vec<([u8; 16], i64)>,
    n_refused: u64,
    reason: String,
    reported: Option<Instant>,
}

struct WriterSlot {
    wish: Wish,
    writes: Writes,
    writer: Option<Writer>,
}

struct ClientSlot {
    reader: usize,
    writer: usize,
    n_calls: u64,
    /// Servers that were found and had time to find us, and since when it is another number.
    n_servers: usize,
    changed: Option<Instant>,
    /// Calls without an answer, and how their answers are known.
    waiting: Vec<(Call, Form, SampleIdentity)>,
}

/// An answer whose caller is not yet found.
struct Answering {
    writer: usize,
    id: RequestId,
    cdr: Vec<u8>,
    until: Instant,
}

/// An outlet of messages, and its topic's name.
pub(super) type Outlet = (Arc<no_key::DataWriter<Bytes, Raw>>, String);

/// See the module.
pub(super) struct State {
    settings: Settings,
    registry: mio1::Registry,
    wire: Option<Wire>,
    readers: Vec<ReaderSlot>,
    /// The first two are the graph's and the log's.
    writers: Vec<WriterSlot>,
    /// The reader of each subscription, the writer of each publication and of each service's answers.
    pub(super) subscriptions: Vec<usize>,
    pub(super) publications: Vec<usize>,
    pub(super) services: Vec<usize>,
    clients: Vec<ClientSlot>,
    answering: Vec<Answering>,
}

const GRAPH: usize = 0;
const LOG: usize = 1;

impl State {
    pub(super) fn open(settings: Settings, registry: mio1::Registry) -> Result<Self> {
        let wire = Some(Wire::open(&settings)?);
        let mut state = Self {
            settings,
            registry,
            wire,
            readers: Vec::new(),
            writers: Vec::new(),
            subscriptions: Vec::new(),
            publications: Vec::new(),
            services: Vec::new(),
            clients: Vec::new(),
            answering: Vec::new(),
        };
        for wish in wishes_of_the_node() {
            let name = wish.topic.clone();
            state.add_writer(wish, Writes { name, endpoint: None, last: None })?;
        }
        state.announce()?;
        Ok(state)
    }

    fn wire(&self) -> Result<&Wire> {
        self.wire.as_ref().ok_or_else(|| Error::network("the network")("it is being opened again"))
    }

    pub(super) fn add_reader(&mut self, wish: Wish, reads: Reads) -> Result<usize> {
        let at = self.readers.len();
        let reader = Some(self.wire()?.reader(&wish, &self.registry, at)?);
        let alone_since = Some(Instant::now());
        let (numbers, reason) = (Vec::new(), String::new());
        let slot = ReaderSlot { wish, reads, reader, alone_since, numbers, n_refused: 0, reason, reported: None };
        self.readers.push(slot);
        Ok(at)
    }

    pub(super) fn add_writer(&mut self, wish: Wish, writes: Writes) -> Result<usize> {
        let writer = Some(self.wire()?.writer(&wish)?);
        self.writers.push(WriterSlot { wish, writes, writer });
        Ok(self.writers.len() - 1)
    }

    pub(super) fn add_client(&mut self, name: String, request: Wish, answer: Wish) -> Result<Client> {
        let client = Client(self.clients.len());
        let endpoint = Endpoint::Client(client);
        let ros_type = "std_srvs/srv/Trigger".to_owned();
        // The answers first: a server that finds the request can then answer it.
        let reader = self.add_reader(answer, Reads { name: name.clone(), ros_type, endpoint })?;
        let writer = self.add_writer(request, Writes { name, endpoint: None, last: None })?;
        let slot = ClientSlot { reader, writer, n_calls: 0, n_servers: 0, changed: None, waiting: Vec::new() };
        self.clients.push(slot);
        Ok(client)
    }

    /// Tells the others which endpoints are this node's.
    pub(super) fn announce(&mut self) -> Result<()> {
        let readers: Vec<_> = self.readers.iter().filter_map(|slot| slot.reader.as_ref().map(Reader::guid)).collect();
        let writers: Vec<_> = self.writers.iter().filter_map(|slot| slot.writer.as_ref().map(Writer::guid)).collect();
        let Settings { node, long_identifiers, .. } = &self.settings;
        let cdr = graph::participant(node, self.wire()?.guid(), &readers, &writers, *long_identifiers);
        let (dds, name) = self.outlet(GRAPH, &cdr)?;
        send(&dds, &name, &cdr, WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).build()).map(|_| ())
    }

    /// Where a message goes out; a latched one is remembered.
    pub(super) fn outlet(&mut self, writer: usize, cdr: &[u8]) -> Result<Outlet> {
        let slot = &mut self.writers[writer];
        let Some(writer) = &slot.writer else {
            return Err(Error::network(&slot.writes.name)("the network is being opened again"));
        };
        if slot.wish.delivery == Delivery::Latched {
            slot.writes.last = Some(cdr.to_vec());
        }
        Ok((Arc::clone(&writer.dds), slot.writes.name.clone()))
    }

    pub(super) fn log_outlet(&mut self, cdr: &[u8]) -> Result<Outlet> {
        self.outlet(LOG, cdr)
    }

    /// Answers, now or when the caller's endpoint is found.
    pub(super) fn reply(&mut self, service: Service, id: &RequestId, cdr: Vec<u8>) -> Result<()> {
        let writer = self.services.get(service.0).copied().ok_or_else(|| Error::Unknown("service".to_owned()))?;
        let answering = Answering { writer, id: id.clone(), cdr, until: Instant::now() + ANSWER_PATIENCE };
        if self.is_found(&answering) || self.answering.len() >= MAX_ANSWERS {
            return self.answer(&answering);
        }
        self.answering.push(answering);
        Ok(())
    }

    fn is_found(&self, answering: &Answering) -> bool {
        let peers = self.writers[answering.writer].writer.as_ref().map(|writer| &writer.peers.guids);
        peers.is_some_and(|guids| guids.iter().any(|guid| guid.starts_with(&answering.id.program)))
    }

    fn answer(&mut self, answering: &Answering) -> Result<()> {
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now());
        let options = options.related_sample_identity(answering.id.request).build();
        let (dds, name) = self.outlet(answering.writer, &answering.cdr)?;
        send(&dds, &name, &answering.cdr, options).map(|_| ())
    }

    /// Calls a service in the form that its server understands.
    pub(super) fn call(&mut self, client: Client) -> Result<Call> {
        let Some(slot) = self.clients.get_mut(client.0) else { return Err(Error::Unknown("client".to_owned())) };
        let WriterSlot { writes, writer, .. } = &self.writers[slot.writer];
        let none = || Error::NoServer { service: writes.name.clone() };
        let writer = writer.as_ref().ok_or_else(none)?;
        let server = writer.peers.guids.first().filter(|_| slot.n_servers > 0).ok_or_else(none)?;
        slot.n_calls += 1;
        let mut header = trigger::CycloneHeader::default();
        header[..8].copy_from_slice(&writer.guid()[8..]);
        header[8..].copy_from_slice(&slot.n_calls.to_le_bytes());
        let form = if server.starts_with(&CYCLONE) { Form::Cyclone(header) } else { Form::Plain };
        let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).build();
        let identity = send(&writer.dds, &writes.name, &trigger::write_request(form), options)?;
        if slot.waiting.len() >= MAX_CALLS {
            slot.waiting.remove(0);
        }
        let call = Call(slot.n_calls);
        slot.waiting.push((call, form, identity));
        Ok(call)
    }

    /// Takes all that came.
    pub(super) fn take(&mut self, queue: &Queue) {
        for slot in &mut self.readers {
            let Some(reader) = &slot.reader else { continue };
            reader.drain();
            while let Some(taken) = reader.take() {
                let read = taken.and_then(|sample| match slot.reads.endpoint {
                    Endpoint::Subscription(subscription) => {
                        let lost = count_lost(&mut slot.numbers, &sample);
                        let Sample { cdr, source_ns, received, .. } = sample;
                        Ok(Some(Incoming::Message { subscription, cdr, source_ns, received, lost }))
                    }
                    Endpoint::Service(service) => request(service, &sample).map(Some),
                    Endpoint::Client(client) => response(client, &mut self.clients, &sample),
                    Endpoint::Publication(_) => Ok(None),
                });
                match read {
                    Ok(Some(incoming)) => queue.push(incoming),
                    // An answer to somebody else.
                    Ok(None) => {}
                    Err(reason) => {
                        slot.n_refused += 1;
                        slot.reason = reason;
                    }
                }
            }
        }
    }

    /// Looks after peers, reports, and answers that wait.
    pub(super) fn look(&mut self, queue: &Queue, now: Instant) {
        for slot in &mut self.readers {
            if let Some(wire) = &self.wire {
                slot.look(queue, now, wire);
            }
        }
        for WriterSlot { writes, writer, .. } in &mut self.writers {
            let Some(writer) = writer else { continue };
            while let Some(news) = writer.news() {
                report(queue, writes.endpoint, &writes.name, news, ("", writer.peers.guids.len()));
            }
        }
        for at in 0..self.clients.len() {
            self.look_for_servers(at, queue, now);
        }
        let waiting = std::mem::take(&mut self.answering);
        for answering in waiting {
            if !self.is_found(&answering) && now < answering.until {
                self.answering.push(answering);
            } else if let Err(error) = self.answer(&answering) {
                let name = self.writers[answering.writer].writes.name.clone();
                queue.push(Incoming::Trouble(Trouble::Refused { name, n_messages: 1, reason: error.to_string() }));
            }
        }
    }

    /// Reports servers of a client once requests and answers will both pass.
    fn look_for_servers(&mut self, at: usize, queue: &Queue, now: Instant) {
        let ClientSlot { reader, writer, .. } = self.clients[at];
        let listens = self.writers[writer].writer.as_ref().map_or(0, |writer| writer.peers.guids.len());
        let answers = self.readers[reader].reader.as_ref().map_or(0, |reader| reader.peers.guids.len());
        let n_servers = listens.min(answers);
        let slot = &mut self.clients[at];
        if n_servers == slot.n_servers {
            slot.changed = None;
        } else if n_servers == 0 || now.duration_since(*slot.changed.get_or_insert(now)) >= SETTLING {
            slot.n_servers = n_servers;
            slot.changed = None;
            queue.push(Incoming::Matched { endpoint: Endpoint::Client(Client(at)), n_peers: n_servers });
        }
    }

    pub(super) fn is_closed(&self) -> bool {
        self.wire.is_none()
    }

    /// Leaves the network; the wishes stay.
    pub(super) fn close(&mut self) {
        self.readers.iter_mut().for_each(|slot| slot.reader = None);
        self.writers.iter_mut().for_each(|slot| slot.writer = None);
        self.clients.iter_mut().for_each(|slot| slot.waiting.clear());
        self.answering.clear();
        self.wire = None;
    }

    /// Leaves a network whose middleware broke: its own ends would break as well, so that they are left as they are.
    pub(super) fn abandon(&mut self) {
        self.readers.iter_mut().for_each(|slot| std::mem::forget(slot.reader.take()));
        self.writers.iter_mut().for_each(|slot| std::mem::forget(slot.writer.take()));
        std::mem::forget(self.wire.take());
        self.close();
    }

    /// Joins the network again with the same endpoints.
    pub(super) fn reopen(&mut self, queue: &Queue) -> Result<()> {
        let wire = Wire::open(&self.settings)?;
        for (at, slot) in self.readers.iter_mut().enumerate() {
            slot.reader = Some(wire.reader(&slot.wish, &self.registry, at)?);
            slot.alone_since = Some(Instant::now());
            slot.numbers.clear();
            if !matches!(slot.reads.endpoint, Endpoint::Client(_)) {
                queue.push(Incoming::Matched { endpoint: slot.reads.endpoint, n_peers: 0 });
            }
        }
        for slot in &mut self.writers {
            let writer = wire.writer(&slot.wish)?;
            if let Some(last) = &slot.writes.last {
                let options = WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).build();
                send(&writer.dds, &slot.writes.name, last, options)?;
            }
            slot.writer = Some(writer);
            if let Some(endpoint) = slot.writes.endpoint {
                queue.push(Incoming::Matched { endpoint, n_peers: 0 });
            }
        }
        self.wire = Some(wire);
        self.announce()
    }
}

impl ReaderSlot {
    /// Reports peers, messages that were left out, and a subscription that nobody publishes for.
    fn look(&mut self, queue: &Queue, now: Instant, wire: &Wire) {
        let Self { reads, reader: Some(reader), .. } = self else { return };
        while let Some(news) = reader.news(wire) {
            // A client's servers are counted with both of its endpoints.
            let endpoint = Some(reads.endpoint).filter(|endpoint| !matches!(endpoint, Endpoint::Client(_)));
            report(queue, endpoint, &reads.name, news, (&reads.ros_type, reader.peers.guids.len()));
        }
        let is_alone = reader.peers.guids.is_empty() && matches!(reads.endpoint, Endpoint::Subscription(_));
        if !is_alone {
            // The next time it is alone counts again.
            self.alone_since = Some(now);
        } else if self.alone_since.is_some_and(|since| now.duration_since(since) >= PATIENCE) {
            self.alone_since = None;
            let (topic, message_type) = (reads.name.clone(), reads.ros_type.clone());
            queue.push(Incoming::Trouble(Trouble::NoPublisher { topic, message_type }));
        }
        let is_due = self.reported.is_none_or(|last| now.duration_since(last) >= REPORT);
        if self.n_refused > 0 && is_due {
            let (name, reason) = (reads.name.clone(), std::mem::take(&mut self.reason));
            queue.push(Incoming::Trouble(Trouble::Refused { name, n_messages: self.n_refused, reason }));
            self.n_refused = 0;
            self.reported = Some(now);
        }
    }
}

/// Passes on what is new of an endpoint's peers, which are of a type and as many.
fn report(queue: &Queue, endpoint: Option<Endpoint>, name: &str, news: News, (of_type, n_peers): (&str, usize)) {
    let topic = name.to_owned();
    match (news, endpoint) {
        (News::Changed, Some(endpoint)) => queue.push(Incoming::Matched { endpoint, n_peers }),
        (News::Changed, None) => {}
        (News::OtherType(got), _) => {
            queue.push(Incoming::Trouble(Trouble::OtherType { topic, expected: of_type.to_owned(), got }));
        }
        (News::Incompatible { asked, offered }, _) => {
            queue.push(Incoming::Trouble(Trouble::Incompatible { topic, asked, offered }));
        }
    }
}

/// Messages of this publisher between its last one and this one.
fn count_lost(numbers: &mut Vec<([u8; 16], i64)>, sample: &Sample) -> u64 {
    /// Publishers that are remembered.
    const MAX_PUBLISHERS: usize = 64;
    match numbers.iter_mut().find(|(writer, _)| *writer == sample.writer) {
        Some((_, last)) => {
            let lost = (sample.number - *last - 1).max(0);
            *last = sample.number;
            lost.unsigned_abs()
        }
        None => {
            if numbers.len() >= MAX_PUBLISHERS {
                numbers.remove(0);
            }
            numbers.push((sample.writer, sample.number));
            0
        }
    }
}

/// The call in a message to a service.
fn request(service: Service, sample: &Sample) -> std::result::Result<Incoming, String> {
    let form = trigger::read_request(&sample.cdr)?;
    let mut request = sample.identity;
    // Fast DDS names the endpoint that its answers go to instead of the one that asked.
    if let Some(related) = sample.related.filter(|related| related.writer_guid != GUID::from_bytes([0; 16])) {
        request.writer_guid = related.writer_guid;
    }
    let program = sample.writer.first_chunk().copied().unwrap_or_default();
    let id = RequestId { request, program, form };
    Ok(Incoming::Request { service, id, received: sample.received })
}

/// The answer in a message to a client; `None`: to another client of the service, or to a call that is forgotten.
fn response(
    client: Client,
    clients: &mut [ClientSlot],
    sample: &Sample,
) -> std::result::Result<Option<Incoming>, String> {
    let Some(slot) = clients.get_mut(client.0) else { return Ok(None) };
    let (form, answer) = trigger::read_answer(&sample.cdr, sample.writer.starts_with(&CYCLONE))?;
    let is_answered = |call: &(Call, Form, SampleIdentity)| match form {
        Form::Cyclone(_) => call.1 == form,
        Form::Plain => sample.related == Some(call.2),
    };
    let Some(at) = slot.waiting.iter().position(is_answered) else { return Ok(None) };
    let (call, ..) = slot.waiting.remove(at);
    let trigger::Answer { success, message } = answer;
    Ok(Some(Incoming::Response { client, call, success, message }))
}
