//! The settings of an episode.

use serde::{Deserialize, Serialize};
use tactile_data::touch::Side;
use tactile_infer::Model;

use crate::belief::EngineConfig;
use crate::belief::particle::ParticleConfig;
use crate::choice::ActionConfig;
use crate::error::{Error, Result};
use crate::likelihood::{LikelihoodConfig, calibration_of};
use crate::limits;

/// How an episode infers, chooses and stops.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeConfig {
    /// Which inference runs.
    pub engine: EngineConfig,
    /// How the next touch is chosen.
    pub action: ActionConfig,
    /// How similarities become probabilities.
    pub likelihood: LikelihoodConfig,
    /// delta_prob: stop when a part is more probable than this, 0..=1, and an edge was felt. 1: never for this reason.
    pub stop_probability: f64,
    /// To be confident the place must be known as well: the first touch's to this standard deviation along x and along y,
    /// mm, positive, with as much of the belief in the part as `stop_probability` says within three of them. Only with a
    /// bank fine enough to be interpolated, and `between_poses`. `None`: sure of the part is sure enough.
    pub stop_place_mm: Option<f64>,
    /// N_max: stop after this many touches, the first included; 1 to 1,000.
    pub max_touches: usize,
    /// Whether the pose may lie between recorded ones; else it is one of them, as in the paper's protocol.
    pub between_poses: bool,
    /// States between two recorded poses of a bank of 2 mm and 15 degrees, on each axis; 1 to 4. A state stands for all
    /// poses around it, and ten touches see farther than a bank's step. Of a finer bank states are no nearer, but for
    /// those at its own poses; of one too coarse to be interpolated there are no others.
    pub subdivisions: usize,
    /// A part explains the touches when its fit ([`crate::Estimate::fit`]) is at least this; at or below 0. `None`: any
    /// part explains any touches.
    pub none_fit: Option<f64>,
    /// To be confident the fit of `n` touches ([`crate::Estimate::n_fitted`]) must be at least
    /// `none_fit + fit_margin / sqrt(n)`; not negative. Large: parts that are not in the bank are recognised, at the price of
    /// touches.
    pub fit_margin: f64,
    /// A fit below `none_fit` means none of these parts from this many touches on, where it is of more than one of them
    /// ([`crate::Estimate::n_fitted`]); at least 1. With 1 that of the first touch is enough.
    pub none_touches: usize,
    /// An estimate warns where no edged touch reached this cosine with any recorded view, -1..=1.
    pub low_similarity: f32,
    /// Seed of every random draw.
    pub seed: u64,
}

/// One in 160, were the mean cosine of a hole's touches normal.
const NONE_FIT: f64 = -2.5;

impl Default for EpisodeConfig {
    /// Exact inference and expected information; delta_prob and N_max of the paper (Sec. V). The warning's cosine is a
    /// guess for a model that was not calibrated; [`Self::of`] takes the one that 99 in 100 of its touches reach.
    fn default() -> Self {
        Self {
            engine: EngineConfig::Exact,
            action: ActionConfig::default(),
            likelihood: LikelihoodConfig::default(),
            stop_probability: 0.95,
            stop_place_mm: None,
            max_touches: 10,
            between_poses: true,
            subdivisions: 2,
            none_fit: Some(NONE_FIT),
            fit_margin: 4.6,
            none_touches: 4,
            low_similarity: 0.8,
            seed: 1,
        }
    }
}

impl EpisodeConfig {
    /// The defaults with what was measured of a model where holes are touched, where it was (`tactile-infer calibrate`).
    pub fn of(model: &Model) -> Self {
        Self::of_side(model, Side::Hole)
    }

    /// The defaults with what was measured of a model where this side is touched (`tactile-infer calibrate --side`). A
    /// model without a calibration for pegs is believed as for holes.
    pub fn of_side(model: &Model, side: Side) -> Self {
        let default = Self::default();
        let calibration = calibration_of(model, side);
        let low_similarity = calibration.map_or(default.low_similarity, |c| c.low_similarity);
        Self { likelihood: LikelihoodConfig::of_side(model, side), low_similarity, ..default }
    }

    /// Alg. 1 as printed, K = 100, where it cannot be taken literally read as follows: log-likelihood =
    /// cosine / temperature; the moved particle is weighted; 1 / f_PP = exp(-cosine / temperature); actions
    /// with contact; a view outside the recorded area is unknown; the estimate is the state of largest
    /// accumulated posterior in the likeliest part.
    pub fn paper() -> Self {
        Self {
            engine: EngineConfig::Particle(ParticleConfig::paper()),
            action: ActionConfig::paper(),
            likelihood: LikelihoodConfig::paper(),
            between_poses: false,
            none_fit: None,
            ..Self::default()
        }
    }

    /// Refuses numbers outside their ranges, and those that take more than a second for a decision or all memory.
    pub fn validate(&self) -> Result<()> {
        let check = |name: &str, expected: &str, got: f64, fine: bool| {
            if fine { Ok(()) } else { Err(Error::config(format!("episode.{name}"), expected, got.to_string())) }
        };
        let (stop, low) = (self.stop_probability, f64::from(self.low_similarity));
        check("stop_probability", "0..=1", stop, (0.0..=1.0).contains(&stop))?;
        check("low_similarity", "-1..=1", low, (-1.0..=1.0).contains(&low))?;
        if let Some(fit) = self.none_fit {
            check("none_fit", "a number, at most 0", fit, fit.is_finite() && fit <= 0.0)?;
        }
        if let Some(mm) = self.stop_place_mm {
            check("stop_place_mm", "a positive number", mm, mm.is_finite() && mm > 0.0)?;
        }
        let margin = self.fit_margin;
        check("fit_margin", "a number, not negative", margin, margin.is_finite() && margin >= 0.0)?;
        check("none_touches", "at least 1", self.none_touches as f64, self.none_touches >= 1)?;
        let mm = self.action.min_separation_mm;
        check("action.min_separation_mm", "a number, not negative", mm, mm.is_finite() && mm >= 0.0)?;
        if let Some(deg) = self.action.min_separation_deg {
            check("action.min_separation_deg", "a number, not negative", deg, deg.is_finite() && deg >= 0.0)?;
        }
        let contact = f64::from(self.action.contact_threshold);
        check("action.contact_threshold", "0..=1", contact, (0.0..=1.0).contains(&contact))?;
        let travel = self.action.travel_nats_per_mm;
        check("action.travel_nats_per_mm", "a number, not negative", travel, travel.is_finite() && travel >= 0.0)?;
        if let EngineConfig::Particle(ParticleConfig { resample_share, .. }) = self.engine {
            check("engine.resample_share", "0..=1", resample_share, (0.0..=1.0).contains(&resample_share))?;
        }
        limits::check(self)?;
        self.likelihood.validate()
    }
}
