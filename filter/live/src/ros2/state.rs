//! What a bus has: its wishes, which last, and its endpoints, which are made anew when the network is.

use std::sync::Arc;
use std::time::{Duration, Instant};

use rustdds::bytes::Bytes;
use rustdds::{Timestamp, WriteOptionsBuilder, mio1, no_key};

use super::calls::{ClientSlot, request, response};
use super::error::{Error, Result};
use super::graph::{self, Identifiers};
use super::inbox::{Incoming, Queue};
use super::latch::Latch;
use super::raw::Raw;
use super::readers::{ReaderSlot, Reads, count_lost};
use super::settings::Settings;
use super::trouble::Trouble;
use super::wire::{Reader, Sample, Wire, Wish, Writer, options, send, wishes_of_the_node};
use super::writers::{Retired, WriterSlot, Writes};
use super::{Call, Client, Delivery, Endpoint, RequestId, Service};

/// How long an answer waits for its caller's endpoint.
const ANSWER_PATIENCE: Duration = Duration::from_secs(1);

/// How long a server that was found is given to find us as well: a request before that would be lost.
const SETTLING: Duration = Duration::from_millis(300);

/// Answers that wait for their callers' endpoints.
const MAX_ANSWERS: usize = 64;

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
    bell: Arc<mio1::Waker>,
    wire: Option<Wire>,
    /// Reads what others say in the graph.
    graph: Option<Reader>,
    /// The layout that they have.
    heard: Option<Identifiers>,
    readers: Vec<ReaderSlot>,
    /// The first two are the graph's and the log's.
    writers: Vec<WriterSlot>,
    retired: Retired,
    /// The reader of each subscription, the writer of each publication and of each service's answers.
    pub(super) subscriptions: Vec<usize>,
    pub(super) publications: Vec<usize>,
    pub(super) services: Vec<usize>,
    clients: Vec<ClientSlot>,
    answering: Vec<Answering>,
}

const GRAPH: usize = 0;
const LOG: usize = 1;

/// The graph's reader among those that wake the thread.
const GRAPH_TOKEN: usize = usize::MAX - 1;

impl State {
    pub(super) fn open(settings: Settings, registry: mio1::Registry, bell: Arc<mio1::Waker>) -> Result<Self> {
        let wire = Some(Wire::open(&settings)?);
        let mut state = Self {
            settings,
            registry,
            bell,
            wire,
            graph: None,
            heard: None,
            readers: Vec::new(),
            writers: Vec::new(),
            retired: Retired::default(),
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
        state.graph = Some(state.graph_reader()?);
        state.announce()?;
        Ok(state)
    }

    fn wire(&self) -> Result<&Wire> {
        self.wire.as_ref().ok_or_else(|| Error::network("the network")("it is being opened again"))
    }

    pub(super) fn add_reader(&mut self, wish: Wish, reads: Reads) -> Result<usize> {
        let at = self.readers.len();
        let reader = self.wire()?.reader(&wish, &self.registry, at)?;
        self.readers.push(ReaderSlot::new(wish, reads, reader));
        Ok(at)
    }

    fn graph_reader(&self) -> Result<Reader> {
        let [graph, _] = wishes_of_the_node();
        self.wire()?.reader(&graph, &self.registry, GRAPH_TOKEN)
    }

    pub(super) fn add_writer(&mut self, wish: Wish, writes: Writes) -> Result<usize> {
        let at = self.writers.len();
        // The log's latecomers get its latest lines.
        let is_latched = wish.delivery == Delivery::Latched && at != LOG;
        let latch = is_latched.then(|| Latch::new(Arc::clone(&self.bell)));
        let mut slot = WriterSlot { wish, writes, writer: None, latch };
        slot.open(self.wire()?)?;
        self.writers.push(slot);
        Ok(at)
    }

    pub(super) fn add_client(&mut self, name: String, request: Wish, answer: Wish) -> Result<Client> {
        let client = Client(self.clients.len());
        let endpoint = Endpoint::Client(client);
        let ros_type = "std_srvs/srv/Trigger".to_owned();
        // The answers first: a server that finds the request can then answer it.
        let reader = self.add_reader(answer, Reads { name: name.clone(), ros_type, endpoint })?;
        let writer = self.add_writer(request, Writes { name, endpoint: None, last: None })?;
        self.clients.push(ClientSlot::new(reader, writer));
        Ok(client)
    }

    /// Tells the others which endpoints are this node's, once it is known how.
    pub(super) fn announce(&mut self) -> Result<()> {
        let Some(identifiers) = self.settings.identifiers.or(self.heard) else { return Ok(()) };
        let readers: Vec<_> = self.readers.iter().filter_map(|slot| slot.reader.as_ref().map(Reader::guid)).collect();
        let writers: Vec<_> = self.writers.iter().filter_map(|slot| slot.writer.as_ref().map(Writer::guid)).collect();
        let cdr = graph::participant(&self.settings.node, self.wire()?.guid(), &readers, &writers, identifiers);
        let Some((dds, name)) = self.outlet(GRAPH, &cdr)? else { return Ok(()) };
        send(&dds, &name, &cdr, options(None)).map(|_| ())
    }

    /// Takes in what others say in the graph: how their messages are laid out.
    pub(super) fn listen(&mut self, queue: &Queue) {
        let (Some(reader), Some(wire)) = (&mut self.graph, &self.wire) else { return };
        let own = wire.guid();
        while reader.news(wire).is_some() {}
        reader.drain();
        let taken = std::iter::from_fn(|| reader.take()).flatten();
        let of_others = taken.filter(|sample| sample.writer[..12] != own[..12]);
        let found: Vec<_> = of_others.filter_map(|sample| Identifiers::of_message(&sample.cdr)).collect();
        for identifiers in found {
            if let Err(error) = self.hear(identifiers) {
                queue.push(Incoming::Trouble(Trouble::NoNetwork { reason: error.to_string() }));
            }
        }
    }

    /// The layout of the graph's messages of others.
    #[cfg(test)]
    pub(super) fn heard(&self) -> Option<Identifiers> {
        self.heard
    }

    /// Another node's messages have such identifiers. Where some have long ones and others short ones, long ones are
    /// sent: a reader of short ones takes them for a participant without nodes, one of long ones would break.
    fn hear(&mut self, identifiers: Identifiers) -> Result<()> {
        let is_settled = self.heard.is_some_and(|heard| heard == identifiers || heard == Identifiers::Long);
        if is_settled || self.settings.identifiers.is_some() {
            return Ok(());
        }
        if self.heard.replace(identifiers).is_some() {
            // Nobody who comes late may be offered what was sent in the other layout.
            self.replace(GRAPH)?;
        }
        self.announce()
    }

    /// Makes a writer anew that has written nothing.
    fn replace(&mut self, at: usize) -> Result<()> {
        let Some(wire) = &self.wire else { return Ok(()) };
        if let Some(before) = self.writers[at].replace(wire)? {
            self.retired.push(at, before);
            self.retired.go_on(&self.writers, Instant::now());
        }
        Ok(())
    }

    /// Where a message goes out. A latched one is remembered; `None`: nobody is there to read it.
    pub(super) fn outlet(&mut self, writer: usize, cdr: &[u8]) -> Result<Option<Outlet>> {
        let slot = &mut self.writers[writer];
        let Some(dds) = slot.writer.as_ref().map(|writer| Arc::clone(&writer.dds)) else {
            return Err(Error::network(&slot.writes.name)("the network is being opened again"));
        };
        if slot.wish.delivery == Delivery::Latched {
            slot.writes.last = Some(cdr.to_vec());
        }
        Ok(slot.newer().then(|| (dds, slot.writes.name.clone())))
    }

    pub(super) fn log_outlet(&mut self, cdr: &[u8]) -> Result<Option<Outlet>> {
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
        let Some((dds, name)) = self.outlet(answering.writer, &answering.cdr)? else { return Ok(()) };
        send(&dds, &name, &answering.cdr, options).map(|_| ())
    }

    /// Calls a service in the form that its server understands.
    pub(super) fn call(&mut self, client: Client) -> Result<Call> {
        let Some(slot) = self.clients.get_mut(client.0) else { return Err(Error::Unknown("client".to_owned())) };
        let WriterSlot { writes, writer, .. } = &self.writers[slot.writer];
        slot.call(writer.as_ref(), &writes.name)
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
        self.look_at_writers(queue, now);
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

    /// Reports readers, and lets those of latched topics have the newest message.
    fn look_at_writers(&mut self, queue: &Queue, now: Instant) {
        for change in self.wire.as_ref().map_or_else(Vec::new, Wire::changes) {
            self.writers.iter_mut().for_each(|slot| slot.take(&change, queue));
        }
        let mut is_replaced = false;
        // First what RustDDS waits for: nothing else can be replaced meanwhile.
        let (held, others): (Vec<_>, Vec<_>) = (0..self.writers.len()).partition(|at| self.writers[*at].is_held());
        for at in held.into_iter().chain(others) {
            let must_be_replaced = self.writers[at].look(queue);
            let replaced = if must_be_replaced { self.replace(at) } else { Ok(()) };
            is_replaced |= must_be_replaced && replaced.is_ok();
            let done = replaced.and_then(|()| self.writers[at].serve(now));
            if let Err(error) = done {
                let name = self.writers[at].writes.name.clone();
                queue.push(Incoming::Trouble(Trouble::Refused { name, n_messages: 1, reason: error.to_string() }));
            }
        }
        self.retired.go_on(&self.writers, now);
        if is_replaced && let Err(error) = self.announce() {
            queue.push(Incoming::Trouble(Trouble::NoNetwork { reason: error.to_string() }));
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

    /// Whether something is soon to be looked at again.
    pub(super) fn is_settling(&self, now: Instant) -> bool {
        !self.retired.is_empty() || self.writers.iter().any(|slot| slot.is_settling(now))
    }

    pub(super) fn is_closed(&self) -> bool {
        self.wire.is_none()
    }

    /// Leaves the network; the wishes stay.
    pub(super) fn close(&mut self) {
        self.readers.iter_mut().for_each(|slot| slot.reader = None);
        self.writers.iter_mut().for_each(|slot| slot.writer = None);
        self.retired = Retired::default();
        self.graph = None;
        self.clients.iter_mut().for_each(|slot| slot.waiting.clear());
        self.answering.clear();
        self.wire = None;
    }

    /// Leaves a network whose middleware broke: its own ends would break as well, so that they are left as they are.
    pub(super) fn abandon(&mut self) {
        self.readers.iter_mut().for_each(|slot| std::mem::forget(slot.reader.take()));
        self.writers.iter_mut().for_each(|slot| std::mem::forget(slot.writer.take()));
        self.retired.abandon();
        std::mem::forget(self.graph.take());
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
        for (at, slot) in self.writers.iter_mut().enumerate() {
            slot.latch = slot.latch.take().map(|_| Latch::new(Arc::clone(&self.bell)));
            slot.open(&wire)?;
            // The graph's last message names endpoints that are gone.
            if at != GRAPH {
                slot.send_last()?;
            }
            if let Some(endpoint) = slot.writes.endpoint {
                queue.push(Incoming::Matched { endpoint, n_peers: 0 });
            }
        }
        self.wire = Some(wire);
        self.graph = Some(self.graph_reader()?);
        self.announce()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(identifiers: Option<Identifiers>) -> State {
        let poll = mio1::Poll::new().unwrap();
        let registry = poll.registry().try_clone().unwrap();
        let bell = Arc::new(mio1::Waker::new(&registry, mio1::Token(0)).unwrap());
        let settings = Settings::new("n").unwrap();
        let domain_id = 100 + (std::process::id() % 100) as u16;
        let settings = Settings { domain_id, localhost_only: true, identifiers, ..settings };
        State::open(settings, registry, bell).unwrap()
    }

    /// The layout of what was last said in the graph; `None` where nothing was.
    fn said(state: &State) -> Option<Identifiers> {
        state.writers[GRAPH].writes.last.as_ref().map(|cdr| Identifiers::of_message(cdr).unwrap())
    }

    #[test]
    fn nothing_is_said_in_the_graph_until_a_layout_is_stated_or_heard() {
        let mut learning = state(None);
        assert_eq!(said(&learning), None);
        learning.hear(Identifiers::Short).unwrap();
        assert_eq!(said(&learning), Some(Identifiers::Short));
        let writer = |state: &State| state.writers[GRAPH].writer.as_ref().unwrap().guid();
        let before = writer(&learning);
        learning.hear(Identifiers::Long).unwrap();
        assert_eq!(said(&learning), Some(Identifiers::Long));
        assert_ne!(writer(&learning), before, "a latecomer would get the short one as well");
        learning.hear(Identifiers::Short).unwrap();
        assert_eq!(said(&learning), Some(Identifiers::Long));
        let mut stated = state(Some(Identifiers::Short));
        assert_eq!(said(&stated), Some(Identifiers::Short));
        stated.hear(Identifiers::Long).unwrap();
        assert_eq!(said(&stated), Some(Identifiers::Short));
    }
}
