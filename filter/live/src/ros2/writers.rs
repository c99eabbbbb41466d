//! What a bus writes: its writers with their readers, and what of it comes to those that are late.

use std::sync::Arc;
use std::time::Instant;

use super::Endpoint;
use super::error::Result;
use super::graph::Guid;
use super::inbox::Queue;
use super::latch::Latch;
use super::readers::report;
use super::wire::{Change, News, Wire, Wish, Writer, options, send};

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
    /// Serves latecomers, where the topic has one message for them.
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

    /// Takes in a change of the readers of others.
    pub(super) fn take(&mut self, change: &Change, queue: &Queue) {
        let Self { writes, writer: Some(writer), latch, .. } = self else { return };
        let is_news = match change {
            Change::Found { writer: of, reader } => *of == writer.guid() && writer.found(*reader),
            Change::Lost(reader) => lose(writer, latch, |guid| guid == reader),
            Change::Left(program) => lose(writer, latch, |guid| guid.starts_with(program)),
        };
        if is_news {
            report(queue, writes.endpoint, &writes.name, News::Changed, ("", writer.peers.guids.len()));
        }
    }

    /// Whether RustDDS waits until this writer was looked at.
    pub(super) fn is_held(&self) -> bool {
        self.latch.as_ref().is_some_and(|latch| latch.gate.is_held())
    }

    /// Whether it is soon to be looked at again.
    pub(super) fn is_settling(&self, now: Instant) -> bool {
        self.latch.as_ref().is_some_and(|latch| latch.is_settling(now))
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
        let mut must_be_replaced = false;
        for reader in arrivals {
            must_be_replaced |= latch.found(reader, has_last);
        }
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

/// Forgets readers; whether one of them was connected with.
fn lose(writer: &mut Writer, latch: &mut Option<Latch>, is_lost: impl Fn(&Guid) -> bool) -> bool {
    latch.iter_mut().for_each(|latch| latch.lose(&is_lost));
    let lost: Vec<_> = writer.peers.guids.iter().filter(|guid| is_lost(guid)).copied().collect();
    lost.iter().for_each(|reader| {
        writer.lost(reader);
    });
    !lost.is_empty()
}
