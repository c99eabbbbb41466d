//! What a bus writes: its writers with their readers.

use super::Endpoint;
use super::error::Result;
use super::inbox::Queue;
use super::readers::report;
use super::wire::{Wire, Wish, Writer, options, send};

/// What a writer is for.
pub(super) struct Writes {
    pub(super) name: String,
    /// Whose peers its readers are; `None`: nobody asks.
    pub(super) endpoint: Option<Endpoint>,
    /// The last message of a latched topic, sent again when the network is made anew.
    pub(super) last: Option<Vec<u8>>,
}

/// A writer, and what is remembered of it.
pub(super) struct WriterSlot {
    pub(super) wish: Wish,
    pub(super) writes: Writes,
    pub(super) writer: Option<Writer>,
}

impl WriterSlot {
    /// Makes the writer, or makes it anew: one that has written nothing.
    pub(super) fn open(&mut self, wire: &Wire) -> Result<()> {
        self.writer = Some(wire.writer(&self.wish)?);
        Ok(())
    }

    /// Sends the last message of a latched topic again.
    pub(super) fn send_last(&mut self) -> Result<()> {
        let (Some(writer), Some(last)) = (&self.writer, &self.writes.last) else { return Ok(()) };
        send(&writer.dds, &self.writes.name, last, options()).map(|_| ())
    }

    /// Reports readers.
    pub(super) fn look(&mut self, queue: &Queue) {
        let Self { writes, writer: Some(writer), .. } = self else { return };
        while let Some(news) = writer.news() {
            report(queue, writes.endpoint, &writes.name, news, ("", writer.peers.guids.len()));
        }
    }
}
