//! One hole, touch by touch: what a robot embeds.

use serde::{Deserialize, Serialize};
use tactile_data::frame::{Background, Frame};
use tactile_data::se2::Se2;
use tactile_infer::Model;
use tactile_infer::bank::Bank;

use crate::action::{Action, ActionConfig, choose};
use crate::belief::{Belief, EngineConfig};
use crate::error::{Error, Result};
use crate::likelihood::{LikelihoodConfig, Observation, TouchLikelihood};
use crate::modes::{Mode, modes};
use crate::particle::ParticleConfig;

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
    /// delta_prob: stop when a part is more probable than this, 0..=1. One: never for this reason.
    pub stop_probability: f64,
    /// N_max: stop after this many touches, the first included; at least 1.
    pub max_touches: usize,
    /// An estimate warns where no edged touch reached this cosine with any recorded view, -1..=1.
    pub low_similarity: f32,
    /// Seed of every random draw.
    pub seed: u64,
}

impl Default for EpisodeConfig {
    /// Exact inference and expected information; delta_prob and N_max of the paper (Sec. V).
    fn default() -> Self {
        Self {
            engine: EngineConfig::Exact,
            action: ActionConfig::default(),
            likelihood: LikelihoodConfig::default(),
            stop_probability: 0.95,
            max_touches: 10,
            low_similarity: 0.5,
            seed: 1,
        }
    }
}

impl EpisodeConfig {
    /// Alg. 1 as printed, K = 100, where it cannot be taken literally read as follows: log-likelihood =
    /// cosine / temperature; the moved particle is weighted; 1 / f_PP = exp(-cosine / temperature); actions
    /// with contact; a view outside the recorded area is unknown; the estimate is the state of largest
    /// accumulated posterior in the likeliest part.
    pub fn paper() -> Self {
        Self {
            engine: EngineConfig::Particle(ParticleConfig::paper()),
            action: ActionConfig::paper(),
            likelihood: LikelihoodConfig::paper(),
            ..Self::default()
        }
    }

    /// Refuses numbers outside their ranges.
    pub fn validate(&self) -> Result<()> {
        let check = |name: &str, expected: &str, got: f64, fine: bool| {
            if fine { Ok(()) } else { Err(Error::invalid(format!("episode.{name}"), expected, got.to_string())) }
        };
        let (stop, low) = (self.stop_probability, f64::from(self.low_similarity));
        check("stop_probability", "0..=1", stop, (0.0..=1.0).contains(&stop))?;
        check("low_similarity", "-1..=1", low, (-1.0..=1.0).contains(&low))?;
        check("max_touches", "at least 1", self.max_touches as f64, self.max_touches >= 1)?;
        let (mm, deg) = (self.action.min_separation_mm, self.action.min_separation_deg);
        check("action.min_separation_mm", "a number, not negative", mm, mm.is_finite() && mm >= 0.0)?;
        check("action.min_separation_deg", "a number, not negative", deg, deg.is_finite() && deg >= 0.0)?;
        let (draws, supposed) = (self.action.n_draws, self.action.n_suppositions);
        check("action.n_draws", "at least 1", draws as f64, draws >= 1)?;
        check("action.n_suppositions", "at least 1", supposed as f64, supposed >= 1)?;
        if let EngineConfig::Particle(ParticleConfig { n_particles, resample_share, .. }) = self.engine {
            check("engine.n_particles", "at least 1", n_particles as f64, n_particles >= 1)?;
            check("engine.resample_share", "0..=1", resample_share, (0.0..=1.0).contains(&resample_share))?;
        }
        self.likelihood.validate()
    }
}

/// A model and a sensor at rest: makes observations of frames.
#[derive(Debug)]
pub struct Eye<'a> {
    model: &'a Model,
    background: Background,
}

impl<'a> Eye<'a> {
    /// Prepares a sensor from its no-contact frame. Fails where that frame is unusable.
    pub fn new(model: &'a Model, no_contact: &Frame) -> Result<Self> {
        Ok(Self { model, background: model.background(no_contact)? })
    }

    /// What a frame of a hole shows. Fails where it is dark, saturated or of another size.
    pub fn observe(&self, frame: &Frame) -> Result<Observation> {
        let image = self.background.tactile_image(frame)?;
        let edge_share = image.edge_share;
        Ok(Observation { query: self.model.embed_holes(&[image])?, edge_share })
    }
}

/// What to do next.
#[derive(Clone, Debug, PartialEq)]
pub enum Decision {
    /// Move like this, touch, and report with [`Episode::observe`].
    Touch(Action),
    /// Stop.
    Done(Box<Estimate>, StopReason),
}

/// Why an episode is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum StopReason {
    /// A part is more probable than `stop_probability`.
    Confident,
    /// `max_touches` touches were made.
    TouchLimit,
    /// No candidate leads anywhere that was not touched.
    NothingToLearn,
}

/// A reason to doubt an estimate, however probable it is: the filter only weighs the parts of its bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Warning {
    /// No edged touch looks like any recorded view: perhaps none of these parts.
    LowSimilarity {
        /// The largest cosine of any edged touch with any recorded view.
        best: f32,
        /// What [`EpisodeConfig::low_similarity`] asks for.
        floor: f32,
    },
    /// Every touch was blank: no edge was ever seen.
    NothingSeen,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::LowSimilarity { best, floor } => {
                write!(f, "no touch looks like any recorded view (best cosine {best:.2}, expected {floor:.2} or more)")
            }
            Self::NothingSeen => write!(f, "no touch showed an edge"),
        }
    }
}

/// What is known after the touches so far.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Name of the most probable part; the first of equals.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// Pose of the sensor now, by the likeliest state of that part.
    pub part_from_sensor: Se2,
    /// Pose of the sensor at its first touch, by the same state; a pose of the bank's grid.
    pub part_from_first: Se2,
    /// Probability of each part of the bank, `[n_parts]`.
    pub class_posterior: Vec<f64>,
    /// Where else it may be: the belief's modes, the heaviest first.
    pub modes: Vec<Mode>,
    /// Entropy over all states, nats.
    pub entropy_nats: f64,
    /// Touches made.
    pub n_touches: usize,
    /// Reasons to doubt all this.
    pub warnings: Vec<Warning>,
}

/// One hole being identified. Exists from the first touch on.
#[derive(Clone, Debug)]
pub struct Episode<'a> {
    config: EpisodeConfig,
    eye: Option<&'a Eye<'a>>,
    bank: &'a Bank,
    belief: Belief,
}

impl<'a> Episode<'a> {
    /// Begins with the frame of the first touch.
    ///
    /// # Errors
    /// A config out of range, a bank made by another model than the eye's, or an unusable frame.
    pub fn begin(config: &EpisodeConfig, eye: &'a Eye<'a>, bank: &'a Bank, frame: &Frame) -> Result<Self> {
        if eye.model.sha256() != bank.model_sha256() {
            let expected = format!("one made by model {}", eye.model.sha256());
            return Err(Error::invalid("bank", expected, format!("one made by {}", bank.model_sha256())));
        }
        let episode = Self::begin_with(config, bank, &eye.observe(frame)?)?;
        Ok(Self { eye: Some(eye), ..episode })
    }

    /// Begins with the observation of the first touch; for callers that embed touches themselves.
    pub fn begin_with(config: &EpisodeConfig, bank: &'a Bank, observation: &Observation) -> Result<Self> {
        config.validate()?;
        let first = TouchLikelihood::new(observation, bank, &config.likelihood)?;
        let belief = Belief::new(bank, config.engine, config.likelihood.lookup_tolerance, config.seed, first);
        Ok(Self { config: *config, eye: None, bank, belief })
    }

    /// Takes in a touch: `moved` is the motion actually made since the touch before, in the sensor's frame at
    /// that touch. After an error the belief is as before.
    ///
    /// # Errors
    /// An unusable frame, a motion that is not finite, or an episode that was begun without an eye.
    pub fn observe(&mut self, moved: Se2, frame: &Frame) -> Result<()> {
        let eye = self.eye.ok_or_else(|| {
            Error::invalid("episode", "an eye, given to Episode::begin, to see frames with", "one begun without")
        })?;
        self.observe_with(moved, &eye.observe(frame)?)
    }

    /// Like [`Self::observe`], with the touch already embedded.
    pub fn observe_with(&mut self, moved: Se2, observation: &Observation) -> Result<()> {
        if !moved.is_finite() {
            return Err(Error::invalid("moved", "a finite motion", format!("{moved:?}")));
        }
        let likelihood = TouchLikelihood::new(observation, self.bank, &self.config.likelihood)?;
        self.belief.update(&moved, likelihood);
        Ok(())
    }

    /// Whether to stop, and if not, which of `candidates` (motions of the sensor that the reach allows) to
    /// make. Changes nothing: asked again, it answers the same.
    pub fn decide(&self, candidates: &[Se2]) -> Decision {
        let done = |reason| Decision::Done(Box::new(self.estimate()), reason);
        let probability = self.belief.class_posterior().into_iter().fold(0.0, f64::max).min(1.0);
        if probability > self.config.stop_probability {
            return done(StopReason::Confident);
        }
        let n_touches = self.belief.touches().len();
        if n_touches >= self.config.max_touches {
            return done(StopReason::TouchLimit);
        }
        // A stream of draws of its own for each touch.
        let seed = self.config.seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(n_touches as u64);
        let action = choose(&self.config.action, &self.config.likelihood, &self.belief, self.bank, candidates, seed);
        action.map_or_else(|| done(StopReason::NothingToLearn), Decision::Touch)
    }

    /// What is known now.
    pub fn estimate(&self) -> Estimate {
        let class_posterior = self.belief.class_posterior();
        let most = |best: (usize, f64), next: (usize, f64)| if next.1 > best.1 { next } else { best };
        let (part, probability) = class_posterior.iter().copied().enumerate().fold((0, 0.0), most);
        let cell = self.belief.best(Some(part)).map_or(0, |hypothesis| hypothesis.cell);
        let part_from_first = self.bank.grid().pose(cell);
        Estimate {
            part: self.bank.parts()[part].clone(),
            probability: probability.min(1.0),
            part_from_sensor: part_from_first * self.belief.first_from_sensor(),
            part_from_first,
            class_posterior,
            modes: modes(&self.belief),
            entropy_nats: self.belief.entropy_nats(),
            n_touches: self.belief.touches().len(),
            warnings: self.warnings(),
        }
    }

    /// The belief, for maps and reports.
    pub fn belief(&self) -> &Belief {
        &self.belief
    }

    fn warnings(&self) -> Vec<Warning> {
        let edged = self.belief.touches().iter().map(|touched| &touched.likelihood).filter(|touch| !touch.blank);
        let best = edged.map(|touch| touch.best_similarity).reduce(f32::max);
        let floor = self.config.low_similarity;
        match best {
            None => vec![Warning::NothingSeen],
            Some(best) if best < floor => vec![Warning::LowSimilarity { best, floor }],
            Some(_) => Vec::new(),
        }
    }
}
