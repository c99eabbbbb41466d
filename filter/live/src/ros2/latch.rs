//! Who comes late to a latched topic gets its newest message, and no other.
//!
//! RustDDS 0.15.1 offers each newcomer all that a writer keeps, and it keeps too much: it removes old messages every
//! six seconds only, and none of the latest 64 while nobody reads. So nothing is written while nobody reads, and a
//! writer that has written more than once is replaced by a new one before a newcomer is offered anything; the newcomer
//! alone is sent the newest message. The others, who find the new writer empty, get nothing a second time; only on a
//! machine too busy for readers to acknowledge in time is the newest message sent again rather than not at all.

use std::collections::BTreeSet;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Wake, Waker};
use std::time::{Duration, Instant};

use futures_core::Stream;
use rustdds::bytes::Bytes;
use rustdds::{DataWriterStatus, StatusEvented, mio1, no_key};

use super::graph::Guid;
use super::raw::Raw;

/// How long RustDDS's thread is held at most.
const HOLD: Duration = Duration::from_millis(200);

/// How long the readers of a writer that was replaced are waited for.
const RETURN: Duration = Duration::from_secs(1);

/// How long after a newcomer others are waited for, so that they are served together.
const COLLECT: Duration = Duration::from_millis(50);

/// What is known of a latched topic's present writer.
pub(super) struct Latch {
    pub(super) gate: Arc<Gate>,
    /// Messages for all by this writer, and whether it sent one to single readers.
    n_written: usize,
    has_served: bool,
    /// Whether the newest message is not among them, since nobody read when it came.
    lacks_newest: bool,
    /// Whether every reader had the newest message before the last newcomer, and those that may lack it else.
    is_acked: bool,
    serving: BTreeSet<Guid>,
    /// Readers of the writers before this one, which it has not found yet.
    known: BTreeSet<Guid>,
    /// Readers that are to get the newest message.
    owed: BTreeSet<Guid>,
    /// When the writer began, when the last newcomer came, when something was written.
    since: Instant,
    came: Instant,
    written: Instant,
}

impl Latch {
    /// What is known of a writer that has written nothing.
    pub(super) fn new(bell: Arc<mio1::Waker>) -> Self {
        let now = Instant::now();
        Self {
            gate: Arc::new(Gate::new(bell)),
            n_written: 0,
            has_served: false,
            lacks_newest: false,
            is_acked: true,
            serving: BTreeSet::new(),
            known: BTreeSet::new(),
            owed: BTreeSet::new(),
            since: now,
            came: now,
            written: now,
        }
    }

    /// There is a newer message; whether it is to be written. `has_readers`: the writer has found some.
    pub(super) fn newer(&mut self, has_readers: bool) -> bool {
        let is_read = has_readers || !self.known.is_empty() || !self.owed.is_empty();
        if is_read {
            self.wrote();
        } else {
            self.lacks_newest = true;
            self.gate.hold(self.keeps_more());
        }
        is_read
    }

    /// A message for all is written: nobody is owed the one before.
    fn wrote(&mut self) {
        self.n_written += 1;
        (self.is_acked, self.lacks_newest) = (false, false);
        self.written = Instant::now();
        self.serving.clear();
        self.owed.clear();
        self.gate.hold(self.keeps_more());
    }

    /// Everybody has the newest message.
    pub(super) fn acked(&mut self) {
        self.is_acked = true;
        self.serving.clear();
    }

    /// Whether that is not yet known.
    pub(super) fn is_open(&self) -> bool {
        !self.is_acked || !self.serving.is_empty()
    }

    /// Whether it is soon to be looked at again. A reader that has stopped acknowledges nothing: not for long.
    pub(super) fn is_settling(&self, now: Instant) -> bool {
        let is_recent = |moment: Instant| now.saturating_duration_since(moment) < RETURN;
        (self.is_open() && is_recent(self.written)) || (!self.owed.is_empty() && is_recent(self.came))
    }

    /// Whether RustDDS would offer a newcomer anything but the newest message.
    fn keeps_more(&self) -> bool {
        self.n_written > 1 || self.has_served || (self.lacks_newest && self.n_written > 0)
    }

    /// A reader was found; whether the writer must be replaced. `has_last`: there is a message to get.
    pub(super) fn found(&mut self, reader: Guid, has_last: bool) -> bool {
        let is_known = self.known.remove(&reader);
        if !has_last {
            return false;
        }
        // Who was there before lacks all that was written for all since.
        let must_be_replaced = if is_known { self.has_served } else { self.keeps_more() };
        if !is_known && (must_be_replaced || self.n_written == 0) {
            self.owed.insert(reader);
            self.came = Instant::now();
        }
        must_be_replaced
    }

    /// Readers are gone.
    pub(super) fn lose(&mut self, is_lost: impl Fn(&Guid) -> bool) {
        for readers in [&mut self.known, &mut self.owed, &mut self.serving] {
            readers.retain(|reader| !is_lost(reader));
        }
    }

    /// The writer was replaced; `readers`: those of the one before.
    pub(super) fn replaced(&mut self, readers: &BTreeSet<Guid>, now: Instant) {
        // Those that may not have got the newest message get it again rather than not at all.
        self.owed.append(&mut self.serving);
        let mut others = std::mem::take(&mut self.known);
        others.extend(readers);
        if self.is_acked {
            self.known = others.difference(&self.owed).copied().collect();
        } else {
            self.owed.append(&mut others);
        }
        (self.n_written, self.has_served, self.lacks_newest) = (0, false, false);
        (self.is_acked, self.since) = (true, now);
        self.gate.hold(false);
    }

    /// The readers among `readers` that are sent the newest message now: all together, once the others have found this
    /// writer, since a reader that comes after that is offered what was meant for them.
    pub(super) fn due(&mut self, readers: &BTreeSet<Guid>, now: Instant) -> Vec<Guid> {
        let is_over = |moment: Instant, time: Duration| now.saturating_duration_since(moment) >= time;
        let is_complete = self.known.is_empty() && self.owed.is_subset(readers);
        if !is_over(self.came, COLLECT) || !(is_complete || is_over(self.since.max(self.came), RETURN)) {
            return Vec::new();
        }
        let due: Vec<Guid> = self.owed.intersection(readers).copied().collect();
        self.owed.retain(|reader| !due.contains(reader));
        if !due.is_empty() {
            self.serving.extend(&due);
            (self.has_served, self.written) = (true, now);
            self.gate.hold(true);
        }
        due
    }
}

/// Holds RustDDS's thread, which tells of a new reader before it offers it anything, until this node's thread has
/// looked.
pub(super) struct Gate {
    bell: Arc<mio1::Waker>,
    is_armed: AtomicBool,
    holds: AtomicBool,
    is_held: Mutex<bool>,
    opened: Condvar,
}

impl Gate {
    fn new(bell: Arc<mio1::Waker>) -> Self {
        Self {
            bell,
            is_armed: AtomicBool::new(false),
            holds: AtomicBool::new(false),
            is_held: Mutex::new(false),
            opened: Condvar::new(),
        }
    }

    /// Whether a new reader is held, or only known.
    fn hold(&self, holds: bool) {
        self.holds.store(holds, Ordering::Release);
    }

    /// Waits for the next status of a writer; one that is there already.
    pub(super) fn arm(self: &Arc<Self>, dds: &no_key::DataWriter<Bytes, Raw>) -> Option<DataWriterStatus> {
        // Once is enough; and while RustDDS is held, its statuses are locked.
        if *self.held() || self.is_armed.swap(true, Ordering::AcqRel) {
            return None;
        }
        let waker = Waker::from(Arc::clone(self));
        let mut statuses = dds.as_async_status_stream();
        match Pin::new(&mut statuses).poll_next(&mut Context::from_waker(&waker)) {
            Poll::Ready(Some(status)) => {
                self.is_armed.store(false, Ordering::Release);
                Some(status)
            }
            Poll::Ready(None) | Poll::Pending => None,
        }
    }

    /// A new writer has to be armed.
    pub(super) fn disarm(&self) {
        self.is_armed.store(false, Ordering::Release);
    }

    /// This node's thread has looked; it is to look again, since it could not arm.
    pub(super) fn open(&self) {
        if std::mem::take(&mut *self.held()) {
            self.opened.notify_all();
            // Without the bell the thread looks at its next tick.
            drop(self.bell.wake());
        }
    }

    /// Whether RustDDS waits.
    pub(super) fn is_held(&self) -> bool {
        *self.held()
    }

    fn held(&self) -> MutexGuard<'_, bool> {
        self.is_held.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Wake for Gate {
    fn wake(self: Arc<Self>) {
        self.wake_by_ref();
    }

    fn wake_by_ref(self: &Arc<Self>) {
        let mut is_held = self.held();
        *is_held = self.holds.load(Ordering::Acquire);
        self.is_armed.store(false, Ordering::Release);
        if self.bell.wake().is_ok() && *is_held {
            let waited = self.opened.wait_timeout_while(is_held, HOLD, |is_held| *is_held);
            // Whoever does not look in that time is closed, or finds the reader late.
            *waited.unwrap_or_else(PoisonError::into_inner).0 = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Guid = [1; 16];
    const B: Guid = [2; 16];
    const C: Guid = [3; 16];
    const D: Guid = [4; 16];

    fn latch() -> (mio1::Poll, Latch) {
        let poll = mio1::Poll::new().unwrap();
        let bell = Arc::new(mio1::Waker::new(poll.registry(), mio1::Token(0)).unwrap());
        (poll, Latch::new(bell))
    }

    fn readers(guids: &[Guid]) -> BTreeSet<Guid> {
        guids.iter().copied().collect()
    }

    #[test]
    fn a_writer_is_replaced_for_a_newcomer_where_it_keeps_more_than_the_newest_message() {
        let (_poll, mut latch) = latch();
        // Nothing is written yet; then RustDDS itself has the newest message alone.
        assert!(!latch.found(A, false));
        latch.wrote();
        assert!(!latch.found(B, true) && latch.due(&readers(&[A, B]), Instant::now() + RETURN).is_empty());
        latch.wrote();
        assert!(latch.is_open());
        latch.acked();
        assert!(latch.found(C, true));
        latch.replaced(&readers(&[A, B, C]), Instant::now());
        // A and B find the new writer; only then C gets its message, and once.
        assert!(!latch.found(A, true) && !latch.found(C, true));
        let soon = Instant::now() + COLLECT;
        assert!(latch.due(&readers(&[A, C]), soon).is_empty());
        assert!(!latch.found(B, true));
        let all = readers(&[A, B, C]);
        assert!(latch.due(&all, latch.came).is_empty(), "others may come");
        assert_eq!(latch.due(&all, soon + COLLECT), [C]);
        assert!(latch.due(&all, soon + RETURN).is_empty() && latch.is_open());
        // What was written for C is nothing for the next newcomer, who takes it from C where C may not have it yet.
        assert!(latch.found(D, true));
        latch.replaced(&readers(&[A, B, C, D]), Instant::now());
        assert!([A, B, C, D].into_iter().all(|reader| !latch.found(reader, true)));
        assert_eq!(latch.due(&readers(&[A, B, C, D]), Instant::now() + COLLECT), [C, D]);
        latch.acked();
        assert!(latch.found([5; 16], true));
        latch.replaced(&readers(&[A, B, C, D]), Instant::now());
        assert_eq!((latch.known.len(), latch.owed.len()), (4, 1));
    }

    #[test]
    fn readers_that_do_not_come_back_are_not_waited_for_and_are_offered_nothing_that_is_not_theirs() {
        let (_poll, mut latch) = latch();
        (0..2).for_each(|_| latch.wrote());
        latch.acked();
        assert!(latch.found(B, true));
        latch.replaced(&readers(&[A, B]), Instant::now());
        assert!(!latch.found(B, true));
        assert!(latch.due(&readers(&[B]), Instant::now() + COLLECT).is_empty());
        assert_eq!(latch.due(&readers(&[B]), Instant::now() + RETURN), [B]);
        // A is late, and would be offered what was for B.
        latch.acked();
        assert!(latch.found(A, true));
        latch.replaced(&readers(&[A, B]), Instant::now());
        assert!(latch.owed.is_empty());
        // What is written for all before it comes back is for it as well.
        (0..2).for_each(|_| latch.wrote());
        assert!(!latch.found(A, true) && !latch.found(B, true));
        // A message that may be lost is sent again, and a newer one takes its place.
        assert!(latch.found(C, true));
        latch.replaced(&readers(&[A, B, C]), Instant::now());
        assert_eq!(latch.owed, readers(&[A, B, C]));
        latch.lose(|reader| *reader == B);
        assert_eq!(latch.due(&readers(&[A, C]), Instant::now() + RETURN), [A, C]);
        latch.wrote();
        assert!(latch.found(D, true) && !latch.serving.contains(&A));
        latch.wrote();
        assert!(latch.due(&readers(&[A, C, D]), Instant::now() + RETURN).is_empty());
    }

    #[test]
    fn nothing_is_written_while_nobody_reads() {
        let (_poll, mut latch) = latch();
        assert!(!latch.newer(false) && !latch.newer(false));
        // Nothing has to be replaced for the first reader, which gets the newest message alone.
        assert!(!latch.found(A, true));
        assert!(latch.newer(false), "it is owed one, and gets this one with all");
        assert!(latch.newer(true));
        // All are gone, and what the writer keeps is not the newest.
        latch.lose(|_| true);
        latch.acked();
        assert!(!latch.newer(false));
        assert!(latch.found(B, true));
        latch.replaced(&readers(&[B]), Instant::now());
        assert!(!latch.found(B, true));
        assert_eq!(latch.due(&readers(&[B]), Instant::now() + COLLECT), [B]);
        // One message that is not the newest is too much as well.
        let (_poll, mut latch) = self::latch();
        assert!(latch.newer(true));
        assert!(!latch.newer(false) && latch.found(A, true));
    }

    #[test]
    fn the_gate_holds_until_it_is_opened_and_never_for_good() {
        let (mut poll, latch) = latch();
        let gate = Arc::clone(&latch.gate);
        // Nothing to hold for.
        Arc::clone(&gate).wake();
        gate.hold(true);
        let held = std::thread::spawn({
            let gate = Arc::clone(&gate);
            move || gate.wake()
        });
        let mut events = mio1::Events::with_capacity(4);
        poll.poll(&mut events, Some(Duration::from_secs(30))).unwrap();
        assert!(!events.is_empty());
        while !held.is_finished() {
            gate.open();
            std::thread::yield_now();
        }
        held.join().unwrap();
        // Nobody looks.
        gate.wake();
    }
}
