//! How far a touch and a view speak for each other: the log-odds that the touch was made at the view, against a touch made
//! anywhere in the world of parts.
//!
//! For a touch with the embedding `q` and the edge share `e`, and a view with the key `k`, both of unit length in the bank's
//! metric:
//!
//! ```text
//! log p(touch | made at the view) / p(touch) = offset + rarity(touch) - steepness(e) (|q - k| - own)
//! rarity(touch) = h . q + w l - r,   steepness(e) = s exp(a l),   l = ln((e + 0.003) / 0.05)
//! ```
//!
//! The distance `|q - k|` is the root of `2 (1 - cosine)`: errors of embeddings are spread as a Laplace distribution is, not as
//! a normal one, so that a logarithm linear in the distance explains touches better than one linear in the cosine, which is its
//! square. `own` is how far touches are from their own views on average, in this bank. How rare a touch is in the world is
//! linear in its embedding as the network gives it. What nobody recorded, and a part that is not in the bank, are the world: log-odds of 0.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::similarity::dot;

/// Edge pixels that noise alone may show, a share of the view.
const NOISE_SHARE: f64 = 0.003;

/// A common share of edge pixels, from which shares are counted.
const USUAL_SHARE: f64 = 0.05;

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
    /// Mean distance of edged touches from their own views in a bank of pegs that are compared by the cosine alone.
    pub own_distance: f64,
    /// w: how much rarer a touch is, the more edge it shows, nats.
    pub rarity_by_edge: f64,
    /// What the two terms of rarity come to in the average touch, nats; it is taken off.
    pub usual_rarity: f64,
    /// h: how rare a touch is in the world by its embedding, nats; `[dim]`.
    pub rarity: Vec<f32>,
    /// Touches that it was fitted to.
    pub n_touches: usize,
    /// Their mean log-probability at the true poses, parts and poses that were left out counted as the world, nats.
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

fn check(field: &str, expected: &str, got: f64, is_good: bool) -> Result<()> {
    if is_good { Ok(()) } else { Err(Error::invalid(field, expected, got.to_string())) }
}
