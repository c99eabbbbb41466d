//! What a bus writes: its writers with their readers, and what of it comes to those that are late.

use std::sync::Arc;
use std::time::Instant;

use super::Endpoint;
use super::error::Result;
use super::inbox::Queue;
use super::latch::Latch;
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
    /// Of a topic whose latecomers get one message.
    pub(super) latch: Option<Latch>,
}

impl WriterSlot {
    /// Makes the writer.
    pub(super) fn open(&mut self, wire: &Wire) -> Result<()> {
        let mut writer = wire.writer(&self.wish)?;
        if let Some(latch) = &self.latch {
            latch.gate.disarm();
            writer.gate = Some(Arc::clone(&latch.gate));
        }
        self.writer = Some(writer);
        Ok(())
    }

    /// Makes the writer anew: one that has written nothing.
    pub(super) fn replace(&mut self, wire: &Wire) -> Result<()> {
        let before = self.writer.take();
        let opened = self.open(wire);
        if opened.is_err() {
            self.writer = before;
            return opened;
        }
        if let (Some(latch), Some(before)) = (&mut self.latch, &before) {
            latch.replaced(&before.peers.guids, Instant::now());
        }
        Ok(())
    }

    /// Sends the last message of a latched topic again.
    pub(super) fn send_last(&mut self) -> Result<()> {
        let (Some(writer), Some(last)) = (&self.writer, &self.writes.last) else { return Ok(()) };
        send(&writer.dds, &self.writes.name, last, options(None))?;
        self.latch.iter_mut().for_each(Latch::wrote);
        Ok(())
    }

    /// Reports readers; whether one of them must not be offered what the writer keeps.
    pub(super) fn look(&mut self, queue: &Queue) -> bool {
        let Self { writes, writer: Some(writer), latch, .. } = self else { return false };
        while let Some(news) = writer.news() {
            report(queue, writes.endpoint, &writes.name, news, ("", writer.peers.guids.len()));
        }
        let arrivals = std::mem::take(&mut writer.arrivals);
        let Some(latch) = latch else { return false };
        let has_last = writes.last.is_some();
        let must_be_replaced = arrivals.into_iter().fold(false, |must, reader| latch.found(reader, has_last) || must);
        if !must_be_replaced && latch.is_open() && writer.is_acked() {
            latch.acked();
        }
        must_be_replaced
    }

    /// Lets RustDDS go on, and sends the newest message to those that lack it.
    pub(super) fn serve(&mut self, now: Instant) -> Result<()> {
        let Self { writes, writer: Some(writer), latch: Some(latch), .. } = self else { return Ok(()) };
        latch.gate.open();
        let Some(last) = &writes.last else { return Ok(()) };
        for reader in latch.due(&writer.peers.guids, now) {
            send(&writer.dds, &writes.name, last, options(Some(reader)))?;
        }
        Ok(())
    }
}
