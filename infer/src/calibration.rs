//! How far a model's cosines can be believed, measured on parts it was not trained on.
//!
//! In: touches of known part and pose, and a bank. Out: the numbers that a model's file holds for the filter ([`Calibration`],
//! [`match_odds`], [`presence`]) and what is measured by them.

#[cfg(feature = "datasets")]
pub mod calibrate;
#[cfg(feature = "datasets")]
pub mod fit;
pub mod match_odds;
#[cfg(feature = "datasets")]
pub mod matching;
#[cfg(feature = "datasets")]
pub mod minimum;
#[cfg(feature = "datasets")]
pub mod offset;
pub mod own_by_edge;
pub mod presence;
pub mod touches_of_bank;

use serde::{Deserialize, Serialize};

use crate::bank::views::Views;
use crate::calibration::own_by_edge::{MOST_BY_EDGE, OwnByEdge};
use crate::error::{Error, Result};
use crate::maps::sensor_offset::{MOST_MISFIT, MOST_STRAIN};

/// A view with a smaller share of edge pixels is blank.
pub const BLANK_SHARE: f32 = 0.01;

/// What touches of a side match like, as a model sees them: stored in its checkpoint. What is said of holes here is said of
/// the touched pegs where it is of [`Side::Peg`](tactile_data::dataset::touch::Side::Peg).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    /// 99 in 100 holes with an edge reach this cosine with some recorded peg.
    pub low_similarity: f32,
    /// The cosine with the view that was touched, interpolated where the bank is fine enough for it
    /// ([`Bank::cosine_at`](crate::Bank::cosine_at)); `None` in models calibrated before it was measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matched: Option<Spread>,
    /// How far the mean of that differs from sensor to sensor, a standard deviation that is part of the one in
    /// `matched`: touches of one sensor have it in common. `None` where touches of one sensor were compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between_sensors: Option<f64>,
    /// How many times as much a distance of touch and view costs as was fitted ([`crate::calibration::match_odds`]), 1 at most: less under a rough
    /// sensor. `None` where nobody measured it, or of several sensors: 1.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steepness: Option<f64>,
    /// How much farther touches with little edge are from their own views. `None` where nobody measured it, of several sensors, and where touches
    /// did not say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub own_by_edge: Option<OwnByEdge>,
    /// What the views of the bank were of that the touches were compared with.
    #[serde(default, skip_serializing_if = "Views::is_pegs")]
    pub views: Views,
    /// Holes with an edge that were compared.
    pub n_holes: usize,
    /// What a verifier says of the sensor's touches; `None` where none judged them, or of several sensors.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verifier: Option<OfVerifier>,
    /// What was known before them, where it counted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prior: Option<Prior>,
}

/// What a verifier says of a sensor's touches where they were made, more than of simulated ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OfVerifier {
    /// The checksum of the networks that draw the maps and judge.
    pub maps_sha256: String,
    /// The mean, nats a touch.
    pub nats: f64,
    /// Touches that it is of.
    pub n_touches: usize,
    /// How much larger along both axes parts seem than under a simulated sensor, 0.01 for a hundredth.
    #[serde(default)]
    pub strain: f64,
    /// How much farther their maps are off than usual, nats ([`presence::misfit_nats`]).
    #[serde(default)]
    pub misfit: f64,
}

impl Calibration {
    /// Refuses numbers that no touches give, naming the field.
    ///
    /// # Errors
    /// A cosine outside -1..=1, a negative spread, numbers that are not finite.
    pub fn validate(&self) -> Result<()> {
        let Self { low_similarity, matched, between_sensors, .. } = *self;
        let low = f64::from(low_similarity);
        check("low_similarity", "-1..=1", low, (-1.0..=1.0).contains(&low))?;
        if let Some(Spread { mean, sd }) = matched {
            check("matched", "a finite mean", mean, mean.is_finite())?;
            check("matched", "a finite deviation, not negative", sd, sd.is_finite() && sd >= 0.0)?;
        }
        let between = between_sensors.unwrap_or(0.0);
        check("between_sensors", "a finite number, not negative", between, between.is_finite() && between >= 0.0)?;
        let steepness = self.steepness.unwrap_or(1.0);
        check("steepness", "a positive number", steepness, steepness.is_finite() && steepness > 0.0)?;
        if let Some(OwnByEdge { by_edge, usual_edge }) = self.own_by_edge {
            let expected = format!("-{MOST_BY_EDGE} to {MOST_BY_EDGE}");
            check("own_by_edge.by_edge", &expected, by_edge, by_edge.abs() <= MOST_BY_EDGE)?;
            check("own_by_edge.usual_edge", "a finite number", usual_edge, usual_edge.is_finite())?;
        }
        if let Some(OfVerifier { nats, strain, misfit, .. }) = self.verifier {
            check("verifier.nats", "a finite number", nats, nats.is_finite())?;
            for (field, value, most) in [("strain", strain, MOST_STRAIN), ("misfit", misfit, MOST_MISFIT)] {
                check(&format!("verifier.{field}"), &format!("-{most} to {most}"), value, value.abs() <= most)?;
            }
        }
        let Some(prior) = self.prior else { return Ok(()) };
        let n = prior.n_touches;
        check("prior.n_touches", "a finite number, not negative", n, n.is_finite() && n >= 0.0)?;
        prior.as_calibration(self).validate().map_err(|error| error.within("prior"))
    }

    /// What a calibration with other touches starts from, worth `n_touches`: what was known before this one's own,
    /// where it counted, so that the same touches never count twice.
    pub fn as_prior(&self, n_touches: f64) -> Prior {
        let own = Prior {
            n_touches,
            low_similarity: self.low_similarity,
            matched: self.matched,
            between_sensors: self.between_sensors,
            views: self.views,
        };
        self.prior.map_or(own, |prior| Prior { n_touches, ..prior })
    }
}

/// What is known of a model before a sensor's own touches are. Fields as in [`Calibration`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Prior {
    /// How many touches it counts as much as; not negative.
    pub n_touches: f64,
    /// The cosine that 99 in 100 edged touches reach.
    pub low_similarity: f32,
    /// The cosine with the view that was touched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub matched: Option<Spread>,
    /// How far the mean of that differs from sensor to sensor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub between_sensors: Option<f64>,
    /// What the bank's views were of.
    #[serde(default, skip_serializing_if = "Views::is_pegs")]
    pub views: Views,
}

impl Prior {
    /// What was known, in the place of what a calibration says.
    fn as_calibration(&self, of: &Calibration) -> Calibration {
        let Self { n_touches: _, low_similarity, matched, between_sensors, views } = *self;
        Calibration { low_similarity, matched, between_sensors, views, prior: None, ..of.clone() }
    }
}

fn check(field: &str, expected: &str, got: f64, is_fine: bool) -> Result<()> {
    if is_fine { Ok(()) } else { Err(Error::invalid(field, expected, got.to_string())) }
}

/// Mean and spread of many values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// The mean.
    pub mean: f64,
    /// The standard deviation.
    pub sd: f64,
}

impl Spread {
    /// The spread of at least one value.
    pub fn from_values(values: &[f64]) -> Self {
        let mean_of = |value: &dyn Fn(f64) -> f64| values.iter().map(|v| value(*v)).sum::<f64>() / values.len() as f64;
        let mean = mean_of(&|v| v);
        Self { mean, sd: mean_of(&|v| (v - mean).powi(2)).sqrt() }
    }
}
