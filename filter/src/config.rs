//! What an episode runs with: what a user chooses, what is measured or fixed, and by which method.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;
use tactile_infer::Model;

use crate::belief::particle::ParticleConfig;
use crate::belief::{EngineConfig, KnownStart};
use crate::choice::ActionRule;
use crate::decision::SensorMatch;
#[cfg(feature = "experiments")]
use crate::error::Error;
use crate::error::Result;
use crate::settings::Settings;
use crate::touch_model::TouchModel;

/// By which method an episode infers and chooses. All but the default are for comparisons.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Method {
    /// Which inference runs.
    pub engine: EngineConfig,
    /// How the next touch is chosen.
    pub rule: ActionRule,
    /// Whether the pose may lie between recorded ones; else it is one of them, as in the paper's protocol.
    pub between_poses: bool,
}

impl Default for Method {
    /// Exact inference, expected information, poses anywhere.
    fn default() -> Self {
        Self { engine: EngineConfig::Exact, rule: ActionRule::default(), between_poses: true }
    }
}

/// What an episode runs with. A user sets [`Self::settings`]; the rest belongs to the model, and with the feature
/// `experiments` to whoever compares.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EpisodeConfig {
    /// What a user chooses.
    pub settings: Settings,
    pub(crate) model: TouchModel,
    pub(crate) method: Method,
    /// What was learnt of the sensor from the confident holes of this run ([`crate::Episode::learn`]); nothing at first.
    #[serde(skip_serializing_if = "SensorMatch::is_default")]
    pub sensor: SensorMatch,
    /// Where this hole is known to be before it is touched; nothing by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<KnownStart>,
}

impl EpisodeConfig {
    /// The defaults with what was measured of a model where holes are touched, where it was (`tactile-infer calibrate`).
    pub fn of(model: &Model) -> Self {
        Self::of_side(model, Side::Hole)
    }

    /// The defaults with what was measured of a model where this side is touched (`tactile-infer calibrate --side`). A
    /// model without a calibration for pegs is believed as for holes.
    pub fn of_side(model: &Model, side: Side) -> Self {
        Self { model: TouchModel::of_side(model, side), ..Self::default() }
    }

    /// Alg. 1 as printed, K = 100, where it cannot be taken literally read as follows: log-likelihood =
    /// cosine / temperature; the moved particle is weighted; 1 / f_PP = exp(-cosine / temperature); actions
    /// with contact; a view outside the recorded area is unknown; the estimate is the state of largest
    /// accumulated posterior in the likeliest part. Lines 9-10: the likeliest state against the K = 100 particles.
    pub fn paper() -> Self {
        let engine = EngineConfig::Particle(ParticleConfig::paper());
        Self {
            settings: Settings {
                false_accept: None,
                n_draws: 100,
                n_suppositions: 1,
                n_finalists: None,
                ..Settings::default()
            },
            model: TouchModel::paper(),
            method: Method { engine, rule: ActionRule::Paper, between_poses: false },
            ..Self::default()
        }
    }

    /// The same where so much is known of the sensor.
    #[must_use]
    pub fn with_sensor(self, sensor: SensorMatch) -> Self {
        Self { sensor, ..self }
    }

    /// The same for a hole that is known so well before it is touched.
    #[must_use]
    pub fn with_start(self, start: KnownStart) -> Self {
        Self { start: Some(start), ..self }
    }

    /// The same for a hole that may be anywhere.
    #[must_use]
    pub fn without_start(self) -> Self {
        Self { start: None, ..self }
    }

    /// What is measured or fixed.
    pub fn model(&self) -> &TouchModel {
        &self.model
    }

    /// By which method.
    pub fn method(&self) -> &Method {
        &self.method
    }

    /// The same with changes for an experiment: to what a user chooses, to what is measured or fixed, to the method.
    #[cfg(any(test, feature = "experiments"))]
    #[must_use]
    pub fn changed(mut self, change: impl FnOnce(&mut Settings, &mut TouchModel, &mut Method)) -> Self {
        change(&mut self.settings, &mut self.model, &mut self.method);
        self
    }

    /// Sets a number by its name: a setting, or for experiments one that is measured or fixed, or `n_particles` of the
    /// particle filter.
    ///
    /// # Errors
    /// No number has the name, or its range does not have the value. Nothing is changed.
    #[cfg(feature = "experiments")]
    pub fn set(&mut self, name: &str, text: &str) -> Result<()> {
        if name == "n_particles" {
            let refused = |expected: &str, got: &str| Err(Error::config("episode.engine.n_particles", expected, got));
            let EngineConfig::Particle(particle) = &mut self.method.engine else {
                return refused("an engine of particles", "another");
            };
            return match text.parse() {
                Ok(n_particles) => {
                    particle.n_particles = n_particles;
                    Ok(())
                }
                Err(_) => refused("a whole number", text),
            };
        }
        if TouchModel::numbers().iter().any(|number| number.name == name) {
            return self.model.set(name, text);
        }
        self.settings.set(name, text)
    }

    /// Refuses numbers outside their ranges, and effort that takes more than a second for a decision or all memory.
    ///
    /// # Errors
    /// The first of them, by its name.
    pub fn validate(&self) -> Result<()> {
        self.settings.validate()?;
        self.model.validate()?;
        self.sensor.validate()?;
        match self.method.engine {
            EngineConfig::Particle(particle) => particle.validate(),
            EngineConfig::Exact => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(config: EpisodeConfig) -> String {
        config.validate().map_or_else(|error| error.to_string(), |()| "nothing".into())
    }

    #[test]
    fn what_takes_all_time_or_memory_is_refused_by_name() {
        let set = |settings: Settings| EpisodeConfig { settings, ..EpisodeConfig::default() };
        let particle = |n_particles| {
            let particle = ParticleConfig { n_particles, ..ParticleConfig::default() };
            EpisodeConfig::default().changed(|_, _, method| method.engine = EngineConfig::Particle(particle))
        };
        let of = Settings::default();
        for (config, names) in [
            (set(Settings { max_touches: 1001, ..of }), "episode.max_touches: expected 1 to 1000, got 1001"),
            (set(Settings { max_touches: usize::MAX, ..of }), "episode.max_touches: expected 1 to 1000, got 18446"),
            (set(Settings { max_touches: 0, ..of }), "episode.max_touches: expected 1 to 1000, got 0"),
            (set(Settings { subdivisions: 5, ..of }), "episode.subdivisions: expected 1 to 4, got 5"),
            (set(Settings { n_draws: usize::MAX, ..of }), "episode.n_draws: expected 1 to 100000"),
            (set(Settings { n_suppositions: usize::MAX, ..of }), "episode.n_suppositions: expected 1 to 10000"),
            (set(Settings { n_finalists: Some(0), ..of }), "episode.n_finalists: expected at least 1"),
            (
                set(Settings { n_draws: 100_000, ..of }),
                "episode.n_draws, n_suppositions, n_finalists: expected at most 1e8 pairs",
            ),
            (particle(usize::MAX), "episode.engine.n_particles: expected 1 to 1000000"),
            (particle(0), "episode.engine.n_particles: expected 1 to 1000000, got 0"),
        ] {
            let refused = refused(config);
            assert!(refused.starts_with(names) && refused.len() < 200, "{names}: {refused}");
        }
    }

    #[test]
    fn alg_1_may_touch_as_often_as_any() {
        let most = EpisodeConfig::paper().changed(|settings, _, _| settings.max_touches = 1_000);
        assert_eq!(refused(most), "nothing");
    }

    #[test]
    fn a_share_of_edge_outside_0_to_1_is_refused() {
        for blank_share in [-0.1, 1.5, f32::NAN, f32::INFINITY] {
            let config = EpisodeConfig::default().changed(|_, model, _| model.blank_share = blank_share);
            let refused = refused(config);
            assert!(refused.starts_with("touch_model.blank_share: expected 0..=1"), "{refused}");
        }
    }
}
