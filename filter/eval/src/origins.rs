//! Where the episodes of a figure come from: their parts, and how many different views they began with.

use std::collections::{BTreeMap, BTreeSet};

use crate::evaluate::{Outcome, Scored};

/// The origins of some episodes, in their order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Origins {
    parts: Vec<usize>,
    distinct_first_views: Option<usize>,
}

impl Origins {
    /// The origins of some outcomes.
    pub fn of(outcomes: &[Outcome]) -> Self {
        let views: Option<BTreeSet<_>> = outcomes.iter().map(|o| Some((o.part, o.first_view?))).collect();
        Self {
            parts: outcomes.iter().map(|outcome| outcome.part).collect(),
            distinct_first_views: views.map(|views| views.len()).filter(|n| *n > 0),
        }
    }

    /// Pairs of part and pose, or frame of a recording, that the episodes began with; `None` where they began anywhere.
    /// Touched twice, they say little more than once.
    pub fn distinct_first_views(&self) -> Option<usize> {
        self.distinct_first_views
    }

    /// What the episodes of each part that was touched add to some sums.
    pub fn sums_by_part<const K: usize>(&self, scored: &[Scored], of: impl Fn(&Scored) -> [f64; K]) -> Vec<[f64; K]> {
        let mut sums: BTreeMap<usize, [f64; K]> = BTreeMap::new();
        for (part, scored) in self.parts.iter().zip(scored) {
            let sum = sums.entry(*part).or_insert([0.0; K]);
            sum.iter_mut().zip(of(scored)).for_each(|(sum, value)| *sum += value);
        }
        sums.into_values().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_view_that_is_drawn_again_is_not_another() {
        let outcome = |part, first_view| Outcome { part, first_view, ..Outcome::default() };
        let drawn = [(0, 5), (1, 5), (0, 5), (0, 6)].map(|(part, view)| outcome(part, Some(view)));
        assert_eq!(Origins::of(&drawn).distinct_first_views(), Some(3));
        assert_eq!(Origins::of(&[outcome(0, None), outcome(0, Some(1))]).distinct_first_views(), None);
        assert_eq!(Origins::of(&[]).distinct_first_views(), None);
    }

    #[test]
    fn sums_are_of_the_parts_that_were_touched() {
        let parts = [2, 0, 2, 2].map(|part| Outcome { part, ..Outcome::default() });
        let scored = [true, true, false, true].map(|right| Scored { right, ..Scored::default() });
        let sums = Origins::of(&parts).sums_by_part(&scored, |s| [f64::from(u8::from(s.right)), 1.0]);
        assert_eq!(sums, [[1.0, 1.0], [2.0, 3.0]]);
    }
}
