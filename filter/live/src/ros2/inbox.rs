//! What arrives, in order, in a queue whose memory is bounded.

use std::collections::VecDeque;
use std::sync::mpsc::RecvTimeoutError;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::{Call, Client, Endpoint, RequestId, Service, Subscription, Trouble};

/// Messages of one subscription that wait at most; an older one gives way.
pub(super) const DEPTH: usize = 5;

/// Requests, answers and reports that wait at most.
const MAX_OTHERS: usize = 1024;

/// Something from the network.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Incoming {
    /// A message.
    Message {
        /// The subscription that it came by.
        subscription: Subscription,
        /// The whole message: its header of 4 bytes, of which the last two, the options, are always 0, and its body. It
        /// is as it came, malformed or not; it may end with up to 3 bytes that only fill it.
        cdr: Vec<u8>,
        /// When the publisher sent it by its clock, ns since 1970, if it says so.
        source_ns: Option<i64>,
        /// When it was taken from the network.
        received: Instant,
        /// Messages of this subscription that were lost since the one before: on the network, or because this queue
        /// was full.
        lost: u64,
    },
    /// Somebody calls a service; [`Bus::reply`](super::Bus::reply) answers.
    Request {
        /// Which service.
        service: Service,
        /// To whom the answer goes.
        id: RequestId,
        /// When it was taken from the network.
        received: Instant,
    },
    /// The answer to a call.
    Response {
        /// The client that called.
        client: Client,
        /// To which call.
        call: Call,
        /// Whether it was done.
        success: bool,
        /// Why not, or what was done.
        message: String,
    },
    /// How many others an endpoint is connected with has changed.
    Matched {
        /// Which one.
        endpoint: Endpoint,
        /// With how many now.
        n_peers: usize,
    },
    /// Something to report.
    Trouble(Trouble),
}

/// The receiving end of a [`Bus`](super::Bus).
#[derive(Debug)]
pub struct Inbox(Arc<Queue>);

impl Inbox {
    pub(super) fn new() -> (Self, Arc<Queue>) {
        let queue = Arc::new(Queue::default());
        (Self(Arc::clone(&queue)), queue)
    }

    /// Waits for the next event, at most `timeout`.
    ///
    /// # Errors
    /// Nothing came in that time, or the bus is closed and everything was taken.
    pub fn recv_timeout(&self, timeout: Duration) -> Result<Incoming, RecvTimeoutError> {
        let deadline = Instant::now() + timeout;
        let mut waiting = self.0.lock();
        loop {
            if let Some(incoming) = waiting.items.pop_front() {
                return Ok(waiting.count(incoming));
            }
            if waiting.is_closed {
                return Err(RecvTimeoutError::Disconnected);
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Err(RecvTimeoutError::Timeout);
            }
            waiting = self.0.arrived.wait_timeout(waiting, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// The next event, if one waits.
    pub fn try_recv(&self) -> Option<Incoming> {
        self.recv_timeout(Duration::ZERO).ok()
    }
}

/// What waits, shared by the reading thread and the inbox.
#[derive(Debug, Default)]
pub(super) struct Queue {
    waiting: Mutex<Waiting>,
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct Waiting {
    items: VecDeque<Incoming>,
    /// Messages given up for each subscription since its last one was taken.
    dropped: Vec<u64>,
    /// Whether requests were refused because too many wait; said once until one is taken.
    is_flooded: bool,
    is_closed: bool,
}

impl Waiting {
    /// Adds what this queue gave up to an event that is taken.
    fn count(&mut self, mut incoming: Incoming) -> Incoming {
        if let Incoming::Message { subscription, lost, .. } = &mut incoming
            && let Some(dropped) = self.dropped.get_mut(subscription.0)
        {
            *lost += std::mem::take(dropped);
        }
        incoming
    }

    /// Drops the oldest message of `of` where `DEPTH` wait, and remembers it and what was lost before it.
    fn make_room(&mut self, of: Subscription) {
        let is_of = |item: &Incoming| matches!(item, Incoming::Message { subscription, .. } if *subscription == of);
        if self.items.iter().filter(|item| is_of(item)).count() < DEPTH {
            return;
        }
        let oldest = self.items.iter().position(is_of).and_then(|at| self.items.remove(at));
        if let Some(Incoming::Message { lost, .. }) = oldest {
            if self.dropped.len() <= of.0 {
                self.dropped.resize(of.0 + 1, 0);
            }
            self.dropped[of.0] += lost + 1;
        }
    }
}

impl Queue {
    fn lock(&self) -> MutexGuard<'_, Waiting> {
        // A queue is whole after each line below, so a panic elsewhere leaves it usable.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn push(&self, incoming: Incoming) {
        let mut waiting = self.lock();
        if let Incoming::Message { subscription, .. } = &incoming {
            waiting.make_room(*subscription);
        } else {
            let n_others = waiting.items.iter().filter(|item| !matches!(item, Incoming::Message { .. })).count();
            match n_others.cmp(&MAX_OTHERS) {
                std::cmp::Ordering::Less => waiting.is_flooded = false,
                _ if waiting.is_flooded => return,
                _ => {
                    waiting.is_flooded = true;
                    waiting.items.push_back(Incoming::Trouble(Trouble::Flooded { limit: MAX_OTHERS }));
                    return;
                }
            }
        }
        waiting.items.push_back(incoming);
        self.arrived.notify_one();
    }

    pub(super) fn close(&self) {
        self.lock().is_closed = true;
        self.arrived.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(subscription: usize, number: u8, lost: u64) -> Incoming {
        let subscription = Subscription(subscription);
        Incoming::Message { subscription, cdr: vec![number], source_ns: None, received: Instant::now(), lost }
    }

    fn taken(inbox: &Inbox) -> Vec<(usize, u8, u64)> {
        std::iter::from_fn(|| inbox.try_recv())
            .map(|incoming| match incoming {
                Incoming::Message { subscription, cdr, lost, .. } => (subscription.0, cdr[0], lost),
                other => panic!("{other:?}"),
            })
            .collect()
    }

    #[test]
    fn the_oldest_message_of_a_subscription_gives_way_and_is_counted() {
        let (inbox, queue) = Inbox::new();
        queue.push(message(1, 100, 0));
        for number in 0..8 {
            queue.push(message(0, number, u64::from(number == 1)));
        }
        // 0, 1 and 2 gave way; one more had been lost on the network before 1.
        assert_eq!(taken(&inbox), [(1, 100, 0), (0, 3, 4), (0, 4, 0), (0, 5, 0), (0, 6, 0), (0, 7, 0)]);
        queue.push(message(0, 8, 0));
        assert_eq!(taken(&inbox), [(0, 8, 0)]);
    }

    #[test]
    fn requests_are_never_given_up_for_messages_and_a_flood_is_said_once() {
        let (inbox, queue) = Inbox::new();
        let request = || Incoming::Matched { endpoint: Endpoint::Service(Service(0)), n_peers: 1 };
        (0..MAX_OTHERS + 50).for_each(|_| queue.push(request()));
        (0..100).for_each(|_| queue.push(message(0, 1, 0)));
        let all: Vec<_> = std::iter::from_fn(|| inbox.try_recv()).collect();
        let n_requests = all.iter().filter(|item| matches!(item, Incoming::Matched { .. })).count();
        let n_floods = all.iter().filter(|item| matches!(item, Incoming::Trouble(_))).count();
        assert_eq!((n_requests, n_floods, all.len()), (MAX_OTHERS, 1, MAX_OTHERS + 1 + DEPTH));
    }

    #[test]
    fn a_closed_bus_is_said_after_the_last_event() {
        let (inbox, queue) = Inbox::new();
        queue.push(message(0, 1, 0));
        queue.close();
        assert_eq!(taken(&inbox).len(), 1);
        assert_eq!(inbox.recv_timeout(Duration::from_secs(5)).unwrap_err(), RecvTimeoutError::Disconnected);
    }
}
