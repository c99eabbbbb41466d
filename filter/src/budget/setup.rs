//! What trades speed, memory and touches for accuracy: the settings that a trade-off measures and a budget chooses.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::embedding::precision::Precision;

use crate::belief::EngineConfig;
use crate::belief::states_between;
use crate::choice::ActionRule;
use crate::config::EpisodeConfig;
use crate::error::{Error, Result};

/// A way to run an episode, with what it needs of a model and a bank.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Setup {
    /// Name of the model, for people.
    pub model: String,
    /// Its checksum.
    pub model_sha256: String,
    /// Step of the bank's places, mm.
    pub xy_step_mm: f64,
    /// Step of the bank's angles, degrees.
    pub theta_step_deg: f64,
    /// Format of the bank's rows in memory.
    #[serde(with = "by_name")]
    pub rows: Precision,
    /// Which inference runs.
    pub engine: EngineConfig,
    /// States between two recorded poses, on each axis.
    pub subdivisions: usize,
    /// How the next touch is chosen.
    pub rule: ActionRule,
    /// States drawn to judge a candidate by.
    pub n_draws: usize,
    /// States supposed true in turn.
    pub n_suppositions: usize,
    /// Candidates judged by all draws.
    pub n_finalists: Option<usize>,
    /// Parts that a verifier judges ([`crate::Settings::verify`]); `None` without networks that draw maps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verify: Option<usize>,
    /// How rarely a stranger may be named ([`crate::Settings::false_accept`]). A budget keeps the user's.
    pub false_accept: Option<f64>,
}

/// A knob of [`Setup`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Knob {
    /// The trained model.
    Model,
    /// The bank's steps.
    BankStep,
    /// The format of its rows.
    Rows,
    /// Exact inference or particles.
    Engine,
    /// States between recorded poses.
    Subdivisions,
    /// The rule of choice.
    Rule,
    /// Draws, suppositions and finalists: the effort of a choice.
    Effort,
    /// Maps, and how many parts are verified by them.
    Verify,
    /// How rarely a stranger may be named.
    Risk,
}

impl Setup {
    /// The defaults of the filter with a model and a bank.
    pub fn of(model: &Model, bank_grid: &PoseGrid) -> Self {
        let config = EpisodeConfig::of(model);
        Self {
            model: model.provenance().name.clone(),
            model_sha256: model.sha256().to_string(),
            xy_step_mm: bank_grid.xy_step_mm,
            theta_step_deg: bank_grid.theta_step_deg,
            rows: Precision::F32,
            engine: config.method.engine,
            subdivisions: config.settings.subdivisions,
            rule: config.method.rule,
            n_draws: config.settings.n_draws,
            n_suppositions: config.settings.n_suppositions,
            n_finalists: config.settings.n_finalists,
            verify: model.maps().map(|_| config.settings.verify),
            false_accept: config.settings.false_accept,
        }
    }

    /// These settings in a configuration that keeps the rest of `base`.
    pub fn applied_to(&self, base: &EpisodeConfig) -> EpisodeConfig {
        let mut config = *base;
        config.method.engine = self.engine;
        config.settings.subdivisions = self.subdivisions;
        config.method.rule = self.rule;
        config.settings.n_draws = self.n_draws;
        config.settings.n_suppositions = self.n_suppositions;
        config.settings.n_finalists = self.n_finalists;
        config.settings.verify = self.verify.unwrap_or(config.settings.verify);
        config.settings.false_accept = self.false_accept;
        config
    }

    /// Whether they were measured with a bank of these steps.
    pub fn is_of_grid(&self, grid: &PoseGrid) -> bool {
        (self.xy_step_mm - grid.xy_step_mm).abs() < 1e-6 && (self.theta_step_deg - grid.theta_step_deg).abs() < 1e-6
    }

    /// The knobs whose values differ in `other`.
    pub fn turned(&self, other: &Self) -> Vec<Knob> {
        let effort = |of: &Self| (of.n_draws, of.n_suppositions, of.n_finalists);
        let knobs = [
            (Knob::Model, self.model_sha256 != other.model_sha256),
            (Knob::BankStep, (self.xy_step_mm, self.theta_step_deg) != (other.xy_step_mm, other.theta_step_deg)),
            (Knob::Rows, self.rows != other.rows),
            (Knob::Engine, self.engine != other.engine),
            (Knob::Subdivisions, self.subdivisions != other.subdivisions),
            (Knob::Rule, self.rule != other.rule),
            (Knob::Effort, effort(self) != effort(other)),
            (Knob::Verify, self.verify != other.verify),
            (Knob::Risk, self.false_accept != other.false_accept),
        ];
        knobs.into_iter().filter(|(_, turned)| *turned).map(|(knob, _)| knob).collect()
    }

    /// The value of a knob, in words.
    pub fn tell(&self, knob: Knob) -> String {
        match knob {
            Knob::Model => self.model.clone(),
            Knob::BankStep => format!("bank of {} mm, {}°", self.xy_step_mm, self.theta_step_deg),
            Knob::Rows => format!("{} rows", self.rows),
            Knob::Engine => match self.engine {
                EngineConfig::Exact => "exact".into(),
                EngineConfig::Particle(config) => format!("{} particles", config.n_particles),
            },
            Knob::Subdivisions if self.subdivisions == 1 => "1 state a step".into(),
            Knob::Subdivisions => format!("{} states a step", self.subdivisions),
            Knob::Rule => match self.rule {
                ActionRule::Paper => "the paper’s rule".into(),
                ActionRule::Information => "most informative touch".into(),
                ActionRule::Random => "random touch".into(),
                ActionRule::RandomEdge => "random touch of an edge".into(),
            },
            Knob::Effort if matches!(self.rule, ActionRule::Random | ActionRule::RandomEdge) => {
                "no candidate judged".into()
            }
            Knob::Effort => {
                let judged = self.n_finalists.map_or("all candidates".into(), |n| format!("{n} finalists"));
                format!("{judged} by {} draws x {}", self.n_draws, self.n_suppositions)
            }
            Knob::Verify => match self.verify {
                None => "no maps".into(),
                Some(1) => "maps, 1 part verified".into(),
                Some(n) => format!("maps, {n} parts verified"),
            },
            Knob::Risk => match self.false_accept {
                None => "strangers are not told".into(),
                Some(rate) => format!("{} % of strangers", (1e5 * rate).round() / 1e3),
            },
        }
    }

    /// Megabytes (10^6 bytes) that an episode of `n_touches` holds: weights, bank, tables of each touch and belief, and with maps those of
    /// the bank's parts and of each touch.
    pub fn memory_mb(&self, model: &Model, bank: &Bank, n_touches: usize) -> Result<f64> {
        let finer = states_between(bank.start(), self.subdivisions);
        finer.validate().map_err(|e| Error::config("subdivisions", "a grid of states", e.to_string()))?;
        let n_states = bank.parts().len() * finer.len();
        // Rows, edge shares and nine cosines of neighbours; a cosine for each row of each touch; log-weight and
        // probability of each state, or of each particle with what each touch says of each state.
        let bank_bytes = bank.n_rows() * (self.rows.n_bytes_of_row(bank.dim()) + 4 + 36);
        let touch_bytes = n_touches * bank.n_rows() * 4;
        let belief_bytes = match self.engine {
            EngineConfig::Exact => n_states * 24,
            EngineConfig::Particle(config) => config.n_particles * 16 + n_touches * n_states * 8,
        };
        let maps_bytes = self.verify.and(model.maps()).map_or(0, |maps| {
            let [width, height] = maps.drawer().config().input_px;
            let of_parts = bank.mosaics().map_or(0, |mosaics| mosaics.values().len());
            // Inside, distance, its error and contact.
            4 * (maps.n_parameters() + of_parts + n_touches * width * height * 4)
        });
        Ok((4 * model.n_parameters() + bank_bytes + touch_bytes + belief_bytes + maps_bytes) as f64 / 1e6)
    }
}

/// A precision as its name.
mod by_name {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};
    use tactile_infer::embedding::precision::Precision;

    pub fn serialize<S: Serializer>(precision: &Precision, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(precision)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Precision, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::belief::particle::ParticleConfig;
    use tactile_data::frame::Preprocessing;
    use tactile_infer::DeviceKind;
    use tactile_infer::bank::rows::Rows;
    use tactile_infer::embedding::architecture::NetworkConfig;
    use tactile_infer::embedding::checkpoint::{Checkpoint, Provenance};

    pub(crate) fn settings() -> Setup {
        Setup {
            model: "small".into(),
            model_sha256: "ab".into(),
            xy_step_mm: 2.0,
            theta_step_deg: 15.0,
            rows: Precision::F32,
            engine: EngineConfig::Exact,
            subdivisions: 2,
            rule: ActionRule::Information,
            n_draws: 160,
            n_suppositions: 24,
            n_finalists: Some(24),
            verify: None,
            false_accept: Some(0.01),
        }
    }

    #[test]
    fn settings_come_back_from_json_and_are_taken_over() {
        let some = Setup {
            rows: Precision::I8,
            engine: EngineConfig::Particle(ParticleConfig::paper()),
            n_finalists: Some(7),
            ..settings()
        };
        let text = serde_json::to_string(&some).unwrap();
        assert!(text.contains(r#""rows":"i8""#), "{text}");
        assert_eq!(serde_json::from_str::<Setup>(&text).unwrap(), some);
        let config = some.applied_to(&EpisodeConfig::default().changed(|settings, _, _| settings.max_touches = 4));
        assert_eq!(
            (config.settings.max_touches, config.settings.n_finalists, config.method.engine),
            (4, Some(7), some.engine)
        );
    }

    #[test]
    fn a_turned_knob_is_named_once() {
        let other = Setup { n_draws: 8, n_finalists: Some(4), xy_step_mm: 4.0, ..settings() };
        assert_eq!(settings().turned(&other), [Knob::BankStep, Knob::Effort]);
        assert!(settings().turned(&settings()).is_empty());
    }

    /// By hand: 2 parts x 9 poses of 6 numbers; 2 states a step make 25 a part.
    #[test]
    fn memory_is_the_sum_of_what_is_held() {
        let grid = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 2.0, theta_half_deg: 0.0, theta_step_deg: 15.0 };
        let rows = (0..2 * 9 * 6).map(|i| (i as f32).sin()).collect();
        let bank = Bank::from_rows(
            ["A", "B"].map(String::from).into(),
            grid,
            Rows::new(6, rows).unwrap(),
            vec![0.5; 18],
            "ab",
        )
        .unwrap();
        let network = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = (network.init(3, &DeviceKind::Flex.tensor_device()), network);
        let checkpoint = Checkpoint::of(&network.0, network.1, Preprocessing::counts([16, 12]), Provenance::default());
        let model = Model::new(checkpoint, "ab".into(), DeviceKind::Flex).unwrap();
        let bytes = |settings: &Setup| (1e6 * settings.memory_mb(&model, &bank, 3).unwrap()).round() as usize;
        let exact = 4 * model.n_parameters() + 18 * (24 + 40) + 3 * 18 * 4 + 50 * 24;
        assert_eq!(bytes(&settings()), exact);
        assert_eq!(exact - bytes(&Setup { rows: Precision::I8, ..settings() }), 18 * (24 - 10));
        let few = EngineConfig::Particle(ParticleConfig::paper());
        assert_eq!(bytes(&Setup { engine: few, ..settings() }), exact - 1_200 + 1_600 + 3 * 50 * 8);
    }
}
