//! Settings of an episode, as flags shared by the commands.

use clap::Args;
use tactile_data::output;
use tactile_data::touch::Side;
use tactile_eval::Result;
use tactile_filter::EpisodeConfig;
use tactile_filter::action::ActionRule;
use tactile_filter::belief::EngineConfig;
use tactile_infer::Model;

use super::arguments::Engine;

/// Flags that change an episode's settings; what is left out keeps its default.
#[derive(Args)]
#[command(next_help_heading = "Tuning [default: as the model was calibrated]")]
pub struct Tuning {
    /// Temperature tau: how much the likelihood makes of a difference in similarity
    #[arg(long, value_name = "TAU")]
    temperature: Option<f64>,
    /// Share of the touches that look like any view rather than like their own
    #[arg(long, value_name = "SHARE")]
    outlier_share: Option<f64>,
    /// A view outside the recorded area is as likely as a recorded one of this cosine with the touch
    #[arg(long, value_name = "COSINE")]
    unknown_similarity: Option<f64>,
    /// Probability that hole and peg at one pose are both blank or both not
    #[arg(long, value_name = "P")]
    blank_agreement: Option<f64>,
    /// A view with a smaller share of edge pixels is blank
    #[arg(long, value_name = "SHARE")]
    blank_share: Option<f32>,
    /// Touches keep at least this far apart, mm ...
    #[arg(long, value_name = "MM")]
    min_separation_mm: Option<f64>,
    /// ... or are turned by at least this much, degrees
    #[arg(long, value_name = "DEG")]
    min_separation_deg: Option<f64>,
    /// States drawn from the belief to judge a motion by
    #[arg(long, value_name = "N")]
    draws: Option<usize>,
    /// States supposed true, one after the other, when a motion is judged
    #[arg(long, value_name = "N")]
    suppositions: Option<usize>,
    /// Motions judged by all draws, the best of a first pass over all
    #[arg(long, value_name = "N")]
    finalists: Option<usize>,
    /// The least goodness of fit of a part that explains the touches
    #[arg(long, value_name = "FIT")]
    none_fit: Option<f64>,
    /// How much better the fit must be after one touch, half as much after four, for the filter to be confident
    #[arg(long, value_name = "FIT")]
    fit_margin: Option<f64>,
    /// Share of their error that the touches of one hole have in common where they match their views well; up to six times as
    /// much where they do not
    #[arg(long, value_name = "SHARE")]
    shared_error: Option<f64>,
    /// Touches nearer than this to each other share evidence, mm
    #[arg(long, value_name = "MM")]
    overlap_mm: Option<f64>,
    /// Information that a millimetre of travel must bring, nats
    #[arg(long, value_name = "NATS")]
    travel_nats_per_mm: Option<f64>,
    /// States between two recorded poses of a bank that is interpolated, on each axis
    #[arg(long, value_name = "N")]
    subdivisions: Option<usize>,
    /// Stop when a part is more probable than this (delta_prob)
    #[arg(long, value_name = "P")]
    stop_probability: Option<f64>,
    /// Warn where no touch reaches this cosine with any recorded view
    #[arg(long, value_name = "COSINE")]
    low_similarity: Option<f32>,
    /// Particles of the particle engine
    #[arg(long, value_name = "N")]
    particles: Option<usize>,
}

impl Tuning {
    /// The settings of an engine and a rule for touches of one side.
    pub fn config(&self, engine: Engine, rule: ActionRule, model: &Model, side: Side) -> Result<EpisodeConfig> {
        let mut config = engine.config(model, side);
        config.action.rule = rule;
        let (likelihood, action) = (&mut config.likelihood, &mut config.action);
        set(&mut likelihood.temperature, self.temperature);
        set(&mut likelihood.outlier_share, self.outlier_share);
        likelihood.unknown_similarity = self.unknown_similarity.or(likelihood.unknown_similarity);
        set(&mut likelihood.blank_agreement, self.blank_agreement);
        set(&mut likelihood.blank_share, self.blank_share);
        set(&mut likelihood.shared_error, self.shared_error);
        set(&mut likelihood.overlap_mm, self.overlap_mm);
        set(&mut action.min_separation_mm, self.min_separation_mm);
        set(&mut action.travel_nats_per_mm, self.travel_nats_per_mm);
        set(&mut action.n_draws, self.draws);
        set(&mut action.n_suppositions, self.suppositions);
        action.min_separation_deg = self.min_separation_deg.or(action.min_separation_deg);
        action.n_finalists = self.finalists.or(action.n_finalists);
        set(&mut config.stop_probability, self.stop_probability);
        set(&mut config.fit_margin, self.fit_margin);
        set(&mut config.subdivisions, self.subdivisions);
        set(&mut config.low_similarity, self.low_similarity);
        config.none_fit = self.none_fit.or(config.none_fit);
        if let EngineConfig::Particle(particles) = &mut config.engine {
            set(&mut particles.n_particles, self.particles);
        }
        config.validate()?;
        self.check_memory()?;
        Ok(config)
    }

    /// Refuses numbers of states and particles that no memory holds.
    fn check_memory(&self) -> Result<()> {
        /// A state and its weight, both twice while particles are resampled.
        const PARTICLE_BYTES: f64 = 32.0;
        /// What is kept of a state that was drawn, its cosines among it.
        const STATE_BYTES: f64 = 64.0;
        for (flag, number, n_bytes_each) in [
            ("--particles", self.particles, PARTICLE_BYTES),
            ("--draws", self.draws, STATE_BYTES),
            ("--suppositions", self.suppositions, STATE_BYTES),
        ] {
            let number = number.unwrap_or(0);
            output::check_memory(flag, number, number as f64 * n_bytes_each)?;
        }
        Ok(())
    }
}

fn set<T>(to: &mut T, from: Option<T>) {
    if let Some(from) = from {
        *to = from;
    }
}
