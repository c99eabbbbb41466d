//! Whether one of two is right more often on the same episodes: McNemar's test, exact.

use serde::{Deserialize, Serialize};

/// Below so many episodes of which one alone is right, no test at 5 % can call either better: 2 / 2^5 is 0.06.
pub const LEAST_DISCORDANT: usize = 6;

/// Two outcomes of the same episodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Paired {
    /// Episodes that the first alone names rightly.
    pub better: usize,
    /// Episodes that the second alone names rightly.
    pub worse: usize,
    /// Probability of a split at least as uneven where neither is better, 0..=1: McNemar's test, two-sided and exact.
    /// It takes episodes as independent.
    pub p_value: f64,
}

impl Paired {
    /// Compares whether the first and the second are right, an entry for each episode.
    pub fn of(pairs: impl Iterator<Item = (bool, bool)>) -> Self {
        let count = |[better, worse]: [usize; 2], (one, other): (bool, bool)| {
            [better + usize::from(one && !other), worse + usize::from(other && !one)]
        };
        let [better, worse] = pairs.fold([0; 2], count);
        Self { better, worse, p_value: p_value(better, worse) }
    }

    /// Whether chance alone is unlikely (5 %) to make so many more of the one.
    pub fn is_clear(&self) -> bool {
        self.p_value < 0.05
    }

    /// Whether so few differ that nothing could be clear.
    pub fn is_too_few(&self) -> bool {
        self.better + self.worse < LEAST_DISCORDANT
    }
}

/// The two-sided probability that a fair coin falls at least as unevenly (McNemar 1947; exact as in Fay 2010).
fn p_value(better: usize, worse: usize) -> f64 {
    let n = (better + worse) as f64;
    // The logarithm of a binomial probability: 2^-n alone is zero in f64 from n = 1,075.
    let (mut log, mut tail) = (-n * std::f64::consts::LN_2, 0.0);
    for k in 0..=better.min(worse) {
        tail += log.exp();
        log += ((n - k as f64) / (k + 1) as f64).ln();
    }
    (2.0 * tail).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By Pascal's triangle, in whole numbers.
    fn by_counting(better: usize, worse: usize) -> f64 {
        let n = better + worse;
        let mut row = vec![1_u128];
        for _ in 0..n {
            let next = row.windows(2).map(|pair| pair[0] + pair[1]);
            row = std::iter::once(1).chain(next).chain([1]).collect();
        }
        let tail: u128 = row[..=better.min(worse)].iter().sum();
        (2.0 * tail as f64 / 2f64.powi(n as i32)).min(1.0)
    }

    #[test]
    fn the_exact_p_value_is_that_of_counted_coins() {
        for (better, worse) in [(0, 0), (1, 0), (5, 0), (0, 6), (10, 2), (7, 7), (40, 60), (3, 80)] {
            let (p, counted) = (p_value(better, worse), by_counting(better, worse));
            assert!((p - counted).abs() < 1e-12, "{better} {worse}: {p} {counted}");
        }
        // Two-sided normal tail of 100 more of 2,000 coins with the correction for continuity, (100 - 1) / sqrt(2,000).
        assert!((p_value(1050, 950) - 0.02684).abs() < 2e-4, "{}", p_value(1050, 950));
    }

    #[test]
    fn fewer_than_six_that_differ_are_never_clear() {
        let of = |better, worse| Paired { better, worse, p_value: p_value(better, worse) };
        let n = LEAST_DISCORDANT;
        assert!((0..n).all(|n| (0..=n).all(|k| !of(k, n - k).is_clear() && of(k, n - k).is_too_few())));
        assert!(of(n, 0).is_clear() && of(0, n).is_clear() && !of(n, 0).is_too_few());
        let pairs = [(true, true), (true, false), (false, true), (true, false), (false, false)];
        assert_eq!(Paired::of(pairs.into_iter()), Paired { better: 2, worse: 1, p_value: 1.0 });
    }
}
