//! Which part it is: what the belief says of each part and, of the likeliest, what a verifier says where each would be.
//!
//! In: the belief, the bank's maps, the maps of the touches. Out: the probability of each part, and where the one is that is named.
//!
//! ```text
//! p(part) ~ belief(part) exp(0.5 V(part))        V: the verifier's log-odds of all touches, each as much as it is new
//! ```
//!
//! Parts that are not verified count as the least likely of those that are.

use crate::decision::Placed;
use crate::decision::verdict::Asked;

/// What counts of a verifier's log-odds: where embeddings are alike by chance, maps often are, too.
const SHARE: f64 = 0.5;

/// A part that is believed less is not worth a look.
const LEAST: f64 = 1e-6;

/// Parts as they may be named.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Candidates {
    /// The probability of each part, `[n_parts]`.
    pub(crate) by_part: Vec<f64>,
    /// The most probable one, the first of equals.
    pub(crate) part: usize,
    /// Its probability.
    pub(crate) probability: f64,
    /// Where it would be.
    pub(crate) placed: Placed,
}

/// The most probable part, the first of equals, and its probability.
pub(crate) fn likeliest(by_part: &[f64]) -> (usize, f64) {
    let most = |best: (usize, f64), next: (usize, f64)| if next.1 > best.1 { next } else { best };
    by_part.iter().copied().enumerate().fold((0, 0.0), most)
}

impl<'a> Asked<'a> {
    /// Whether a verifier may name another part than the belief.
    pub(crate) fn are_verified(self) -> bool {
        self.bank.verifier().is_some()
            && self.config.settings.verify > 1
            && self.touches.iter().any(|(_, touch)| touch.map.is_some())
    }

    /// The probability of each part, without a place where nothing judges.
    pub(crate) fn class_posterior(self) -> &'a [f64] {
        if self.are_verified() { &self.candidates().by_part } else { self.belief.posterior().by_part() }
    }

    /// The parts that may be named.
    pub(crate) fn find_candidates(self) -> Candidates {
        let by_part = self.belief.posterior().by_part();
        let n = if self.are_verified() { self.config.settings.verify } else { 1 };
        let mut order: Vec<usize> = (0..by_part.len()).collect();
        // Stable: the first of equals comes first.
        order.sort_by(|a, b| by_part[*b].total_cmp(&by_part[*a]));
        let believed = order.iter().enumerate().take(n).filter(|(rank, part)| *rank == 0 || by_part[**part] > LEAST);
        let places: Vec<(usize, Placed)> = believed.map(|(_, part)| (*part, self.find_place(*part))).collect();
        let judged = places.iter().filter_map(|(part, placed)| Some((*part, placed.verified?.log_odds)));
        let judged: Vec<(usize, f64)> = judged.collect();
        let by_part = if judged.len() > 1 { weighed(by_part, &judged) } else { by_part.to_vec() };
        let (part, probability) = likeliest(&by_part);
        let placed = places.into_iter().find(|(of, _)| *of == part);
        let placed = placed.map_or_else(|| self.find_place(part), |(_, placed)| placed);
        Candidates { by_part, part, probability, placed }
    }
}

/// Probabilities of parts, some of which were judged, by log-odds.
fn weighed(by_part: &[f64], judged: &[(usize, f64)]) -> Vec<f64> {
    let log_odds = |of: fn(f64, f64) -> f64| judged.iter().map(|(_, log_odds)| *log_odds).reduce(of).unwrap_or(0.0);
    let [least, most] = [log_odds(f64::min), log_odds(f64::max)];
    let mut weighed: Vec<f64> = by_part.iter().map(|p| p * (SHARE * (least - most)).exp()).collect();
    judged.iter().for_each(|(part, log_odds)| weighed[*part] = by_part[*part] * (SHARE * (log_odds - most)).exp());
    let sum: f64 = weighed.iter().sum();
    weighed.iter_mut().for_each(|p| *p /= sum);
    weighed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_what_is_said_counts_and_others_are_as_the_worst() {
        let found = weighed(&[0.6, 0.3, 0.1], &[(0, -2.0), (1, 4.0)]);
        let odds = |a: usize, b: usize| (found[a] / found[b]).ln();
        assert!((odds(1, 0) - (0.5_f64.ln() + 0.5 * 6.0)).abs() < 1e-12);
        assert!((odds(2, 0) - (1.0_f64 / 6.0).ln()).abs() < 1e-12);
        assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        // What all share says nothing.
        assert_eq!(weighed(&[0.75, 0.25], &[(0, 3.0), (1, 3.0)]), [0.75, 0.25]);
        assert_eq!(likeliest(&[0.25, 0.5, 0.5]), (1, 0.5));
    }
}
