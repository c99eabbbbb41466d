//! Settings of an episode, as flags shared by the commands.

use clap::Args;
use tactile_data::touch::Side;
use tactile_eval::{Error, Result};
use tactile_filter::EpisodeConfig;
use tactile_filter::belief::EngineConfig;
use tactile_filter::choice::ActionRule;
use tactile_infer::Model;

use super::arguments::Engine;

/// Flags that change what touches say and when to stop; what is left out keeps its default.
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
    /// States between two recorded poses of a bank that is interpolated, on each axis
    #[arg(long, value_name = "N")]
    subdivisions: Option<usize>,
    /// Stop when a part is more probable than this (delta_prob)
    #[arg(long, value_name = "P")]
    stop_probability: Option<f64>,
    /// Warn where no touch reaches this cosine with any recorded view
    #[arg(long, value_name = "COSINE")]
    low_similarity: Option<f32>,
}

/// Flags that change how the next touch is chosen, of the commands that choose one.
#[derive(Args)]
#[command(next_help_heading = "Tuning of the next touch")]
pub struct ChoiceTuning {
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
    /// Information that a millimetre of travel must bring, nats; of the rule information
    #[arg(long, value_name = "NATS")]
    travel_nats_per_mm: Option<f64>,
}

/// The flag of the particle engine, of the commands that may have one.
#[derive(Args)]
#[command(next_help_heading = "Tuning [default: as the model was calibrated]")]
pub struct ParticleTuning {
    /// Particles of the engines particle and paper
    #[arg(long, value_name = "N")]
    particles: Option<usize>,
}

impl Tuning {
    /// The settings of an engine for touches of one side.
    pub fn config(&self, engine: Engine, model: &Model, side: Side) -> Result<EpisodeConfig> {
        let mut config = engine.config(model, side);
        let likelihood = &mut config.likelihood;
        set(&mut likelihood.temperature, self.temperature);
        set(&mut likelihood.outlier_share, self.outlier_share);
        likelihood.unknown_similarity = self.unknown_similarity.or(likelihood.unknown_similarity);
        set(&mut likelihood.blank_agreement, self.blank_agreement);
        set(&mut likelihood.blank_share, self.blank_share);
        set(&mut likelihood.shared_error, self.shared_error);
        set(&mut likelihood.overlap_mm, self.overlap_mm);
        set(&mut config.stop_probability, self.stop_probability);
        set(&mut config.fit_margin, self.fit_margin);
        set(&mut config.subdivisions, self.subdivisions);
        set(&mut config.low_similarity, self.low_similarity);
        config.none_fit = self.none_fit.or(config.none_fit);
        config.validate()?;
        Ok(config)
    }

    /// Whether the states between recorded poses are chosen here.
    pub fn has_states(&self) -> bool {
        self.subdivisions.is_some()
    }
}

impl ChoiceTuning {
    /// Some settings with this rule.
    pub fn applied_to(&self, mut config: EpisodeConfig, rule: ActionRule) -> Result<EpisodeConfig> {
        let action = &mut config.action;
        action.rule = rule;
        set(&mut action.min_separation_mm, self.min_separation_mm);
        set(&mut action.travel_nats_per_mm, self.travel_nats_per_mm);
        set(&mut action.n_draws, self.draws);
        set(&mut action.n_suppositions, self.suppositions);
        action.min_separation_deg = self.min_separation_deg.or(action.min_separation_deg);
        action.n_finalists = self.finalists.or(action.n_finalists);
        config.validate()?;
        Ok(config)
    }

    /// The flags that say how well motions are judged: each with whether it is given.
    pub fn effort(&self) -> [(&'static str, bool); 3] {
        let Self { draws, suppositions, finalists, .. } = self;
        [("--draws", draws.is_some()), ("--suppositions", suppositions.is_some()), ("--finalists", finalists.is_some())]
    }

    /// Refuses flags that none of some rules looks at.
    pub fn check_rules(&self, rules: &[ActionRule]) -> Result<()> {
        if !rules.iter().any(|rule| matches!(rule, ActionRule::Information | ActionRule::Paper)) {
            refuse_given(&self.effort(), "a rule that judges motions, information or paper", "others alone")?;
        }
        if rules.contains(&ActionRule::Information) {
            return Ok(());
        }
        let travel = [("--travel-nats-per-mm", self.travel_nats_per_mm.is_some())];
        refuse_given(&travel, "the rule information", "other rules alone")
    }
}

impl ParticleTuning {
    /// Some settings with so many particles, where they have any.
    pub fn applied_to(&self, mut config: EpisodeConfig) -> Result<EpisodeConfig> {
        if let EngineConfig::Particle(particle) = &mut config.engine {
            set(&mut particle.n_particles, self.particles);
        }
        config.validate()?;
        Ok(config)
    }

    /// The flag, with whether it is given.
    pub fn flag(&self) -> (&'static str, bool) {
        ("--particles", self.particles.is_some())
    }

    /// Refuses particles where no engine has any.
    pub fn check_engines(&self, engines: &[Engine]) -> Result<()> {
        if engines.iter().any(|engine| *engine != Engine::Exact) {
            return Ok(());
        }
        refuse_given(&[self.flag()], "the engine particle or paper", "exact alone")
    }
}

/// Refuses the first of some flags that is given, though it would do nothing.
pub fn refuse_given(flags: &[(&str, bool)], expected: &str, got: &str) -> Result<()> {
    match flags.iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(Error::invalid(*flag, expected, got)),
        None => Ok(()),
    }
}

fn set<T>(to: &mut T, from: Option<T>) {
    if let Some(from) = from {
        *to = from;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_that_would_do_nothing_are_refused() {
        let none = || ChoiceTuning {
            min_separation_mm: None,
            min_separation_deg: None,
            draws: None,
            suppositions: None,
            finalists: None,
            travel_nats_per_mm: None,
        };
        let (information, paper, random) = (ActionRule::Information, ActionRule::Paper, ActionRule::Random);
        let draws = ChoiceTuning { draws: Some(8), ..none() };
        assert_eq!(
            draws.check_rules(&[random]).unwrap_err().to_string(),
            "--draws: expected a rule that judges motions, information or paper, got others alone"
        );
        draws.check_rules(&[random, paper]).unwrap();
        let travel = ChoiceTuning { travel_nats_per_mm: Some(0.1), ..none() };
        travel.check_rules(&[information, random]).unwrap();
        assert!(travel.check_rules(&[paper]).unwrap_err().to_string().starts_with("--travel-nats-per-mm"));
        none().check_rules(&[random]).unwrap();
        let particles = ParticleTuning { particles: Some(50) };
        particles.check_engines(&[Engine::Exact, Engine::Paper]).unwrap();
        let refused = particles.check_engines(&[Engine::Exact]).unwrap_err().to_string();
        assert_eq!(refused, "--particles: expected the engine particle or paper, got exact alone");
    }
}
