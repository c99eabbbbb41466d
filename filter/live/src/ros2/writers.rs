//! What a bus writes: its writers with their readers, and what of it comes to those that are late.

use std::sync::Arc;
use std::time::{Duration, Instant};

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

    /// Makes the writer anew: one that has written nothing. The writer before.
    pub(super) fn replace(&mut self, wire: &Wire) -> Result<Option<Writer>> {
        let before = self.writer.take();
        if let Err(error) = self.open(wire) {
            self.writer = before;
            return Err(error);
        }
        if let (Some(latch), Some(before)) = (&mut self.latch, &before) {
            latch.replaced(&before.peers.guids, Instant::now());
        }
        Ok(before)
    }

    fn has_readers(&self) -> bool {
        self.writer.as_ref().is_some_and(|writer| !writer.peers.guids.is_empty())
    }

    /// There is a newer message; whether it is to be written.
    pub(super) fn newer(&mut self) -> bool {
        let has_readers = self.has_readers();
        self.latch.as_mut().is_none_or(|latch| latch.newer(has_readers))
    }

    /// Sends the last message of a topic again, where those that come late get it from RustDDS.
    pub(super) fn send_last(&mut self) -> Result<()> {
        if !self.newer() {
            return Ok(());
        }
        let (Some(writer), Some(last)) = (&self.writer, &self.writes.last) else { return Ok(()) };
        send(&writer.dds, &self.writes.name, last, options(None)).map(|_| ())
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

/// Removals that RustDDS 0.15.1 takes in at once. One above that it forgets, and such a writer would offer its old
/// messages to newcomers for ever.
const MAX_REMOVALS: usize = 4;

/// How long RustDDS may take with them where nothing shows it.
const REMOVAL: Duration = Duration::from_millis(200);

/// Writers that were replaced, until they are removed.
#[derive(Default)]
pub(super) struct Retired {
    /// Each with its slot.
    waiting: Vec<(usize, Writer)>,
    /// Removals that RustDDS may not have taken in, and the time of the last.
    n_removing: usize,
    since: Option<Instant>,
    /// Slots whose present writer is found only after that: writers are added and removed in one step.
    signs: Vec<usize>,
}

impl Retired {
    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// The writer before the present one of a slot.
    pub(super) fn push(&mut self, at: usize, before: Writer) {
        self.waiting.push((at, before));
    }

    /// Removes as many as RustDDS takes in.
    pub(super) fn go_on(&mut self, slots: &[WriterSlot], now: Instant) {
        let is_late = self.since.is_none_or(|since| now.saturating_duration_since(since) >= REMOVAL);
        let is_over = is_late && !slots.iter().any(WriterSlot::is_held);
        if is_over || self.signs.iter().any(|at| slots[*at].has_readers()) {
            self.n_removing = 0;
            self.signs.clear();
        }
        while self.n_removing < MAX_REMOVALS && !self.waiting.is_empty() {
            let (at, before) = self.waiting.remove(0);
            drop(before);
            self.n_removing += 1;
            self.since = Some(now);
            self.signs.extend((!slots[at].has_readers()).then_some(at));
        }
    }

    /// Leaves them to a network that is left as it is.
    pub(super) fn abandon(&mut self) {
        std::mem::forget(std::mem::take(self));
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
