//! How far a touch and a view speak for each other: the log-odds that the touch was made at the view, against a touch made
//! anywhere in the world of parts.
//!
//! For a touch with the embedding `q` and the edge share `e`, and a view with the key `k`, both of unit length in the bank's
//! metric:
//!
//! ```text
//! log p(touch | made at the view) / p(touch) = offset + rarity(touch) - steepness(e) ((usual / own)^g |q - k| - usual)
//! rarity(touch) = h . q + w l - r,   steepness(e) = s exp(a l),   l = ln((e + 0.003) / 0.05)
//! ```
//!
//! The distance `|q - k|` is the root of `2 (1 - cosine)`: errors of embeddings are spread as a Laplace distribution is, not as
//! a normal one, so that a logarithm linear in the distance explains touches better than one linear in the cosine, which is its
//! square. `own` is how far touches are from their own views on average, in this bank; where that is more than usual, under a rough
//! sensor, distances count for less; a user's calibration says how it falls with `l` ([`super::own_by_edge`]). How rare a touch is in the world is
//! linear in its embedding as the network gives it. What nobody recorded, and a part that is not in the bank, are the world: log-odds of 0.

use serde::{Deserialize, Serialize};

use crate::bank::similarity::dot;
use crate::calibration::check;
use crate::error::{Error, Result};

/// Edge pixels that noise alone may show, a share of the view.
const NOISE_SHARE: f64 = 0.003;

/// A common share of edge pixels, from which shares are counted.
const USUAL_SHARE: f64 = 0.05;

/// Share of touches that are of something else than they were meant for: a slip, a crumb. The fit and the filter take the same.
pub const OUTLIER_SHARE: f64 = 0.005;

/// What was fitted of a model where one side is touched; stored in its checkpoint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MatchOdds {
    /// Log-odds of a touch that is as rare as the average and as far from the view as touches are from their own, nats.
    pub offset: f64,
    /// s: how much a distance of 1 costs where a usual share of the view is edge, nats.
    pub steepness: f64,
    /// a: how much steeper, the more edge the touch shows.
    pub steepness_by_edge: f64,
    /// Mean distance of edged touches from their own views in a bank of pegs that are compared by the cosine alone: the usual one.
    pub own_distance: f64,
    /// g: by which power of the usual distance over its own a bank's distances count.
    #[serde(default)]
    pub distance_by_own: f64,
    /// w: how much rarer a touch is, the more edge it shows, nats.
    pub rarity_by_edge: f64,
    /// What the two terms of rarity come to in the average touch, nats; it is taken off.
    pub usual_rarity: f64,
    /// h: how rare a touch is in the world by its embedding, nats; `[dim]`.
    pub rarity: Vec<f32>,
    /// Touches that it was fitted to.
    pub n_touches: usize,
    /// How much more probable than by chance they are at their own states, less what it costs where their part or pose is left
    /// out and they are the world's; mean, nats.
    pub log_probability: f64,
}

impl MatchOdds {
    /// l: the logarithm of a share of edge pixels, against a usual one.
    pub fn log_edge(edge_share: f32) -> f64 {
        ((f64::from(edge_share) + NOISE_SHARE) / USUAL_SHARE).ln()
    }

    /// How rare a touch is in the world, above the average touch, nats. `query`: `[dim]`, of unit length.
    pub fn rarity_of(&self, query: &[f32], edge_share: f32) -> f64 {
        self.rarity_at(query, Self::log_edge(edge_share))
    }

    /// The same by the logarithm of the share of edge.
    pub(crate) fn rarity_at(&self, query: &[f32], log_edge: f64) -> f64 {
        f64::from(dot(&self.rarity, query)) + self.rarity_by_edge * log_edge - self.usual_rarity
    }

    /// Refuses numbers that no fit gives, naming the field.
    ///
    /// # Errors
    /// Numbers that are not finite, a steepness or an own distance that is not positive, a rarity of another length.
    pub fn validate(&self, dim: usize) -> Result<()> {
        let Self { offset, steepness, steepness_by_edge, own_distance, rarity_by_edge, log_probability, .. } = *self;
        for (field, value) in [
            ("offset", offset),
            ("steepness_by_edge", steepness_by_edge),
            ("rarity_by_edge", rarity_by_edge),
            ("distance_by_own", self.distance_by_own),
            ("usual_rarity", self.usual_rarity),
            ("log_probability", log_probability),
        ] {
            check(field, "a finite number", value, value.is_finite())?;
        }
        for (field, value) in [("steepness", steepness), ("own_distance", own_distance)] {
            check(field, "a positive number", value, value.is_finite() && value > 0.0)?;
        }
        if self.rarity.len() != dim || !self.rarity.iter().all(|value| value.is_finite()) {
            let expected = format!("{dim} finite numbers, as an embedding has");
            return Err(Error::invalid("rarity", expected, format!("{} numbers", self.rarity.len())));
        }
        Ok(())
    }
}

/// The distance of two embeddings of unit length by their cosine.
pub fn distance(cosine: f64) -> f64 {
    (2.0 * (1.0 - cosine)).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn odds() -> MatchOdds {
        MatchOdds {
            offset: 3.0,
            steepness: 24.0,
            steepness_by_edge: 0.25,
            own_distance: 0.4,
            distance_by_own: 0.5,
            rarity_by_edge: 0.5,
            usual_rarity: 0.0,
            rarity: vec![2.0, -1.0, 0.5],
            n_touches: 9,
            log_probability: 1.5,
        }
    }

    #[test]
    fn edges_are_counted_from_a_usual_share_and_none_is_not_impossible() {
        // 0.047 and the noise are the usual share; 0.197 and the noise four times that; no edge is 0.06 of it.
        for (edge_share, times) in [(0.047, 1.0_f64), (0.197, 4.0), (0.0, 0.06), (0.997, 20.0)] {
            let found = MatchOdds::log_edge(edge_share);
            // A share in f32 is off by at most 2^-24 of itself.
            assert!((found - times.ln()).abs() < 6e-8, "{edge_share}: {found}");
        }
    }

    #[test]
    fn rarity_is_linear_in_the_embedding_and_in_the_logarithm_of_the_edge() {
        // 2 * 0.6 + 1 * 0.0 + 0.5 * 0.8 and 0.5 ln 4.
        let found = odds().rarity_of(&[0.6, 0.0, 0.8], 0.197);
        assert!((found - (1.6 + 0.5 * 4.0_f64.ln())).abs() < 3e-7, "{found}");
        let found = odds().rarity_of(&[0.0, 1.0, 0.0], 0.047);
        assert!((found + 1.0).abs() < 3e-7, "{found}");
    }

    #[test]
    fn a_distance_is_that_of_the_two_vectors() {
        for degrees in [0.0_f64, 1e-3, 30.0, 90.0, 179.0, 180.0] {
            // The chord of the angle between them.
            let chord = 2.0 * (degrees.to_radians() / 2.0).sin();
            // A cosine of almost 1 is off by 1e-16, its distance by at most the root of twice that.
            assert!((distance(degrees.to_radians().cos()) - chord).abs() < 2e-8, "{degrees}");
        }
        // Rounding makes cosines above 1.
        assert_eq!(distance(1.0 + 1e-7), 0.0);
    }

    #[test]
    fn numbers_that_no_fit_gives_are_refused_by_name() {
        odds().validate(3).unwrap();
        let refused = |change: &dyn Fn(&mut MatchOdds, f64), value: f64| {
            let mut wrong = odds();
            change(&mut wrong, value);
            wrong.validate(3).err().map(|error| error.to_string())
        };
        type Set = fn(&mut MatchOdds, f64);
        let numbers: [(&str, Set); 6] = [
            ("offset", |odds, value| odds.offset = value),
            ("steepness_by_edge", |odds, value| odds.steepness_by_edge = value),
            ("rarity_by_edge", |odds, value| odds.rarity_by_edge = value),
            ("log_probability", |odds, value| odds.log_probability = value),
            ("steepness", |odds, value| odds.steepness = value),
            ("own_distance", |odds, value| odds.own_distance = value),
        ];
        for (index, (field, set)) in numbers.into_iter().enumerate() {
            let is_positive = index >= 4;
            let expected = if is_positive { "a positive number" } else { "a finite number" };
            for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                let said = refused(&set, value).unwrap();
                assert_eq!(said, format!("{field}: expected {expected}, got {value}"));
            }
            for value in [0.0, -1.0] {
                assert_eq!(refused(&set, value).is_some(), is_positive, "{field}: {value}");
            }
        }
        for rarity in [vec![], vec![1.0; 2], vec![1.0; 4], vec![1.0, f32::NAN, 0.0]] {
            let said = MatchOdds { rarity, ..odds() }.validate(3).unwrap_err().to_string();
            assert!(said.starts_with("rarity: expected 3 finite numbers, as an embedding has, got "), "{said}");
        }
    }
}
