//! What a bus reads: its readers with their peers, and what was lost or left out.

use std::time::{Duration, Instant};

use super::Endpoint;
use super::inbox::{Incoming, Queue};
use super::trouble::Trouble;
use super::wire::{News, Reader, Sample, Wire, Wish};

/// How long a subscription waits for a publisher before that is reported.
const PATIENCE: Duration = Duration::from_secs(5);

/// How often messages that were left out are reported, the first of them at once.
const REPORT: Duration = Duration::from_secs(10);

/// What a reader is for.
pub(super) struct Reads {
    pub(super) name: String,
    pub(super) ros_type: String,
    pub(super) endpoint: Endpoint,
}

/// A reader, and what is remembered of it.
pub(super) struct ReaderSlot {
    pub(super) wish: Wish,
    pub(super) reads: Reads,
    pub(super) reader: Option<Reader>,
    /// Since when it has no peer; `None` once that is reported.
    pub(super) alone_since: Option<Instant>,
    /// The last number of each publisher.
    pub(super) numbers: Vec<([u8; 16], i64)>,
    pub(super) n_refused: u64,
    pub(super) reason: String,
    reported: Option<Instant>,
}

impl ReaderSlot {
    pub(super) fn new(wish: Wish, reads: Reads, reader: Reader) -> Self {
        let (reader, alone_since) = (Some(reader), Some(Instant::now()));
        let (numbers, reason) = (Vec::new(), String::new());
        Self { wish, reads, reader, alone_since, numbers, n_refused: 0, reason, reported: None }
    }

    /// Reports peers, messages that were left out, and a subscription that nobody publishes for.
    pub(super) fn look(&mut self, queue: &Queue, now: Instant, wire: &Wire) {
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
pub(super) fn report(
    queue: &Queue,
    endpoint: Option<Endpoint>,
    name: &str,
    news: News,
    (of_type, n_peers): (&str, usize),
) {
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
pub(super) fn count_lost(numbers: &mut Vec<([u8; 16], i64)>, sample: &Sample) -> u64 {
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
