//! What could not be sent, without a line for each message.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// The same failure is said again no sooner than this.
const AGAIN: Duration = Duration::from_secs(10);

/// Failures that are remembered.
const MAX_KNOWN: usize = 64;

/// Failures that were said, by their text, and how many of each were not.
#[derive(Debug, Default)]
pub(super) struct Failures {
    said: BTreeMap<String, (Instant, u64)>,
}

impl Failures {
    /// The line to say of a failure, where it was not just said.
    pub(super) fn line(&mut self, text: &str, now: Instant) -> Option<String> {
        let Some((since, n_more)) = self.said.get_mut(text) else {
            if self.said.len() >= MAX_KNOWN {
                self.said.retain(|_, (since, _)| now.duration_since(*since) < AGAIN);
            }
            if self.said.len() < MAX_KNOWN {
                self.said.insert(text.to_owned(), (now, 0));
            }
            return Some(text.to_owned());
        };
        if now.duration_since(*since) < AGAIN {
            *n_more += 1;
            return None;
        }
        let n = std::mem::take(n_more);
        *since = now;
        Some(if n == 0 { text.to_owned() } else { format!("{text} ({n} more since)") })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_failure_is_said_once_in_ten_seconds_with_how_many_there_were() {
        let (mut failures, start) = (Failures::default(), Instant::now());
        let mut at = |tenths: u64, text: &str| failures.line(text, start + Duration::from_millis(100 * tenths));
        assert_eq!(at(0, "a").as_deref(), Some("a"));
        assert_eq!(at(1, "b").as_deref(), Some("b"));
        assert!((2..100).all(|tenths| at(tenths, "a").is_none()));
        assert_eq!(at(100, "a").as_deref(), Some("a (98 more since)"));
        assert_eq!(at(300, "a").as_deref(), Some("a"));
    }
}
