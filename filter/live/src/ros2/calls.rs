//! Calls of services: those that this node makes and waits for, and those that come.

use std::time::Instant;

use rustdds::GUID;
use rustdds::rpc::SampleIdentity;

use super::error::{Error, Result};
use super::inbox::Incoming;
use super::trigger::{self, Form};
use super::wire::{Sample, Writer, options, send};
use super::{Call, Client, RequestId, Service};

/// Calls without an answer that are remembered.
const MAX_CALLS: usize = 64;

/// How the identifiers of a CycloneDDS program begin (RTPS 2.5, 8.2.4: the vendor).
const CYCLONE: [u8; 2] = [1, 0x10];

/// A client: the reader of its answers, the writer of its requests.
pub(super) struct ClientSlot {
    pub(super) reader: usize,
    pub(super) writer: usize,
    pub(super) n_calls: u64,
    /// Servers that were found and had time to find us, and since when it is another number.
    pub(super) n_servers: usize,
    pub(super) changed: Option<Instant>,
    /// Calls without an answer, and how their answers are known.
    pub(super) waiting: Vec<(Call, Form, SampleIdentity)>,
}

impl ClientSlot {
    pub(super) fn new(reader: usize, writer: usize) -> Self {
        Self { reader, writer, n_calls: 0, n_servers: 0, changed: None, waiting: Vec::new() }
    }

    /// Calls the service `name` in the form that its server understands.
    pub(super) fn call(&mut self, writer: Option<&Writer>, name: &str) -> Result<Call> {
        let none = || Error::NoServer { service: name.to_owned() };
        let writer = writer.ok_or_else(none)?;
        let server = writer.peers.guids.first().filter(|_| self.n_servers > 0).ok_or_else(none)?;
        self.n_calls += 1;
        let mut header = trigger::CycloneHeader::default();
        header[..8].copy_from_slice(&writer.guid()[8..]);
        header[8..].copy_from_slice(&self.n_calls.to_le_bytes());
        let form = if server.starts_with(&CYCLONE) { Form::Cyclone(header) } else { Form::Plain };
        let identity = send(&writer.dds, name, &trigger::write_request(form), options(None))?;
        if self.waiting.len() >= MAX_CALLS {
            self.waiting.remove(0);
        }
        let call = Call(self.n_calls);
        self.waiting.push((call, form, identity));
        Ok(call)
    }
}

/// The call in a message to a service.
pub(super) fn request(service: Service, sample: &Sample) -> std::result::Result<Incoming, String> {
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
pub(super) fn response(
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
