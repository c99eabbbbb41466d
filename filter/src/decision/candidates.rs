//! Which part it is: what the belief says of each part and, of the likeliest, what a verifier says at each place where they may be.
//!
//! In: the belief, the bank's maps, the maps of the touches. Out: the probability of each part, where the one is that is named, and
//! whether it is there at all.
//!
//! ```text
//! p(part) ~ sum over its places of belief(part, place) exp(0.5 V(part, place))
//! V: the verifier's log-odds of the touches with an edge, each as much as it is new
//! ```
//!
//! What is not verified counts as the least likely of what is.

use tactile_data::pose::se2::Se2;
use tactile_infer::calibration::presence::Presence;

use crate::belief::modes::{is_one_hill, modes};
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
    /// Whether it is there at all; `None` where no edge was felt.
    pub(crate) presence: Option<Presence>,
}

/// A place where a part may be.
#[derive(Clone, Copy, Debug)]
struct Place {
    part: usize,
    /// What is believed of it.
    mass: f64,
    placed: Placed,
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
        let places = if self.are_verified() { self.places() } else { Vec::new() };
        let judged = |place: &Place| Some((place.part, place.mass, place.placed.verified?.log_odds));
        let judged: Vec<(usize, f64, f64)> = places.iter().filter_map(judged).collect();
        // All of them, or none.
        if judged.len() < 2 {
            let (part, probability) = likeliest(by_part);
            let placed = places.first().map_or_else(|| self.find_place(part), |place| place.placed);
            let placed = self.compared(part, placed);
            return Candidates {
                by_part: by_part.to_vec(),
                part,
                probability,
                placed,
                presence: self.presence(&placed),
            };
        }
        let (by_part, by_place) = weighed(by_part, &judged);
        let (part, probability) = likeliest(&by_part);
        let of_part = || places.iter().zip(&by_place).filter(|(place, _)| place.part == part);
        let best = of_part().reduce(|best, next| if next.1 > best.1 { next } else { best });
        let placed = best.map_or_else(|| self.find_place(part), |(place, _)| place.placed);
        let placed = self.compared(part, placed);
        let presence = self.presence(&placed);
        Candidates { by_part, part, probability, placed, presence }
    }

    /// Where the likeliest parts would be, and as many other places that are believed, the likeliest first.
    fn places(self) -> Vec<Place> {
        let (posterior, n) = (self.belief.posterior(), self.config.settings.verify);
        let by_part = posterior.by_part();
        let mut order: Vec<usize> = (0..by_part.len()).collect();
        // Stable: the first of equals comes first.
        order.sort_by(|a, b| by_part[*b].total_cmp(&by_part[*a]));
        let believed = order.iter().enumerate().take(n).filter(|(rank, part)| *rank == 0 || by_part[**part] > LEAST);
        let mut places: Vec<Place> = believed
            .map(|(_, part)| Place { part: *part, mass: by_part[*part], placed: self.find_place(*part) })
            .collect();
        let (grid, n_parts) = (posterior.grid(), places.len());
        let modes = modes(posterior, &Se2::IDENTITY, &|part| self.bank.symmetry(part));
        let mut n_left = n;
        for mode in modes {
            let Some(own) = places[..n_parts].iter().position(|place| place.part == mode.part) else { continue };
            let best = posterior.best(Some(mode.part)).map(|state| grid.pose(state.cell));
            if n_left == 0 || best.is_none_or(|best| is_one_hill(grid, &best, &mode.part_from_sensor)) {
                continue;
            }
            n_left -= 1;
            places[own].mass = (places[own].mass - mode.mass).max(0.0);
            let placed = self.place_at(mode.part, &mode.part_from_sensor);
            places.push(Place { part: mode.part, mass: mode.mass, placed });
        }
        places
    }
}

/// Probabilities of parts, and of places of some of them that were judged: part, what is believed of the place, log-odds.
fn weighed(by_part: &[f64], judged: &[(usize, f64, f64)]) -> (Vec<f64>, Vec<f64>) {
    let log_odds = |of: fn(f64, f64) -> f64| judged.iter().map(|(.., log_odds)| *log_odds).reduce(of).unwrap_or(0.0);
    let [least, most] = [log_odds(f64::min), log_odds(f64::max)];
    let mut left = by_part.to_vec();
    judged.iter().for_each(|(part, mass, _)| left[*part] = (left[*part] - mass).max(0.0));
    let mut weighed: Vec<f64> = left.iter().map(|p| p * (SHARE * (least - most)).exp()).collect();
    let mut by_place: Vec<f64> =
        judged.iter().map(|(_, mass, log_odds)| mass * (SHARE * (log_odds - most)).exp()).collect();
    judged.iter().zip(&by_place).for_each(|((part, ..), weight)| weighed[*part] += weight);
    let sum: f64 = weighed.iter().sum();
    weighed.iter_mut().chain(&mut by_place).for_each(|p| *p /= sum);
    (weighed, by_place)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_of_what_is_said_counts_and_others_are_as_the_worst() {
        let (found, by_place) = weighed(&[0.6, 0.3, 0.1], &[(0, 0.6, -2.0), (1, 0.3, 4.0)]);
        let odds = |a: usize, b: usize| (found[a] / found[b]).ln();
        assert!((odds(1, 0) - (0.5_f64.ln() + 0.5 * 6.0)).abs() < 1e-12);
        assert!((odds(2, 0) - (1.0_f64 / 6.0).ln()).abs() < 1e-12);
        assert!((found.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        assert_eq!(by_place, found[..2]);
        // What all share says nothing.
        assert_eq!(weighed(&[0.75, 0.25], &[(0, 0.75, 3.0), (1, 0.25, 3.0)]).0, [0.75, 0.25]);
        // A part is as probable as its places together, and where no one looked it is as the worst.
        let (found, by_place) = weighed(&[0.8, 0.2], &[(0, 0.5, -1.0), (0, 0.125, 3.0), (1, 0.2, 3.0)]);
        let (worst, best) = ((0.5 * -4.0_f64).exp(), 1.0);
        let expected = 0.5 * worst + 0.125 * best + 0.175 * worst;
        assert!((found[0] / found[1] - expected / 0.2).abs() < 1e-12);
        assert!((by_place[0] / by_place[1] - 4.0 * worst).abs() < 1e-12);
        assert_eq!(likeliest(&[0.25, 0.5, 0.5]), (1, 0.5));
    }
}
