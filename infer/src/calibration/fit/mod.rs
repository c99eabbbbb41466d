//! Fits the log-odds of a match to touches whose parts and poses are known.
//!
//! In: a model, banks, touches. Out: [`MatchOdds`]. The numbers are those by which the touches are most probable: each at its own
//! state among the states of twelve parts and the world, and of the world where its part or its pose is left out. So a match
//! weighs as much as the best of the wrong views that a filter meets lets it.

mod objective;
mod sample;
mod states;

use crate::calibration::match_odds::{MatchOdds, OUTLIER_SHARE};
use crate::calibration::minimum::minimum;
use crate::error::{Error, Result};
use objective::{N_FIRST, Objective};
pub use sample::{N_PARTS, Samples};

/// Fewer touches say too little of a hundred numbers.
const FEWEST: usize = 1_000;

/// Rounds of the optimiser; a hundred are usually enough.
const MAX_ROUNDS: u64 = 300;

/// What the search begins with: offset, logarithm of the steepness, steepness by edge, rarity by edge, distance by own.
const START: [f64; N_FIRST] = [5.0, 3.0, 0.2, 0.0, 0.0];

/// The log-odds by which touches are most probable.
///
/// # Errors
/// Fewer than a thousand touches, or touches that no finite numbers suit.
pub fn fit(samples: &Samples) -> Result<MatchOdds> {
    if samples.len() < FEWEST {
        let expected = format!("{FEWEST} or more {}s within the banks' poses", samples.side);
        return Err(Error::invalid("touches", expected, samples.len().to_string()));
    }
    let usual_distance = usual_distance(samples);
    let objective = Objective { samples: &samples.samples, outlier_share: OUTLIER_SHARE, usual_distance };
    let start: Vec<f64> = START.into_iter().chain(vec![0.0; samples.dim]).collect();
    let no_fit = |error: String| Error::invalid("touches", "some that finite numbers suit", error);
    let (numbers, cost) = minimum(start, MAX_ROUNDS, |numbers| objective.at(numbers)).map_err(no_fit)?;
    Ok(odds(samples, &numbers, cost))
}

/// The numbers as a model keeps them: rarity is counted from the average touch.
fn odds(samples: &Samples, numbers: &[f64], cost: f64) -> MatchOdds {
    let rarity: Vec<f32> = numbers[N_FIRST..].iter().map(|value| *value as f32).collect();
    let mut odds = MatchOdds {
        offset: numbers[0],
        steepness: numbers[1].exp(),
        steepness_by_edge: numbers[2],
        own_distance: usual_distance(samples),
        distance_by_own: numbers[4],
        rarity_by_edge: numbers[3],
        usual_rarity: 0.0,
        rarity,
        n_touches: samples.len(),
        log_probability: -cost,
    };
    let of_touches: Vec<f64> =
        samples.samples.iter().map(|sample| odds.rarity_at(&sample.query, sample.log_edge)).collect();
    odds.usual_rarity = mean(&of_touches);
    odds.offset += odds.usual_rarity;
    odds
}

/// The mean of the banks of pegs that are compared by the cosine alone, where there are any.
fn usual_distance(samples: &Samples) -> f64 {
    mean(samples.own_distances.iter().find(|of| !of.is_empty()).map_or(&[], Vec::as_slice))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}
