//! Settings of an episode, as flags shared by the commands.

use clap::Args;
use tactile_eval::{Error, Result};
use tactile_filter::EpisodeConfig;
use tactile_filter::action::ActionRule;
use tactile_filter::belief::EngineConfig;
use tactile_filter::particle::ParticleConfig;
use tactile_infer::Model;

/// Flags that change an episode's settings; what is left out keeps its default.
#[derive(Args)]
pub struct Tuning {
    /// Similarity temperature tau of the likelihood.
    #[arg(long)]
    temperature: Option<f64>,
    /// Likelihood of a quite different view, relative to the best match.
    #[arg(long)]
    outlier_floor: Option<f64>,
    /// Probability that hole and peg at one pose are both blank or both not.
    #[arg(long)]
    blank_agreement: Option<f64>,
    /// A view with a smaller share of edge pixels is blank.
    #[arg(long)]
    blank_share: Option<f32>,
    /// Touches keep at least this far apart, mm ...
    #[arg(long)]
    min_separation_mm: Option<f64>,
    /// ... or are turned by at least this much, degrees.
    #[arg(long)]
    min_separation_deg: Option<f64>,
    /// States drawn from the belief to judge an action by.
    #[arg(long)]
    draws: Option<usize>,
    /// States supposed true in turn when an action is judged.
    #[arg(long)]
    suppositions: Option<usize>,
    /// Actions judged by all draws, after a first look at each.
    #[arg(long)]
    finalists: Option<usize>,
    /// Least fit of a part that explains the touches.
    #[arg(long)]
    none_fit: Option<f64>,
    /// How much better the fit must be after one touch, half as much after two, to be confident.
    #[arg(long)]
    fit_margin: Option<f64>,
    /// Touches nearer than this share evidence, mm.
    #[arg(long)]
    overlap_mm: Option<f64>,
    /// What a millimetre of travel must tell to be worth it, nats.
    #[arg(long)]
    travel_nats_per_mm: Option<f64>,
    /// States between two recorded poses of a bank that is interpolated, on each axis.
    #[arg(long)]
    subdivisions: Option<usize>,
    /// Stop when a part is more probable than this (delta_prob).
    #[arg(long)]
    stop_probability: Option<f64>,
    /// Warn where no touch reaches this cosine with any recorded view.
    #[arg(long)]
    low_similarity: Option<f32>,
    /// Particles of the particle engine.
    #[arg(long)]
    particles: Option<usize>,
}

impl Tuning {
    /// The settings of an engine (`exact`, `particle` or `paper`: Alg. 1 as printed) and a rule, with what was
    /// measured of the model.
    pub fn config(&self, engine: &str, rule: ActionRule, model: &Model) -> Result<EpisodeConfig> {
        let mut config = match engine {
            "exact" => EpisodeConfig::of(model),
            "particle" => {
                EpisodeConfig { engine: EngineConfig::Particle(ParticleConfig::default()), ..EpisodeConfig::of(model) }
            }
            "paper" => EpisodeConfig::paper(),
            other => return Err(Error::invalid("--engine", "exact, particle or paper", other)),
        };
        config.action.rule = rule;
        let set = |to: &mut f64, from: Option<f64>| *to = from.unwrap_or(*to);
        set(&mut config.likelihood.temperature, self.temperature);
        set(&mut config.likelihood.outlier_floor, self.outlier_floor);
        set(&mut config.likelihood.blank_agreement, self.blank_agreement);
        set(&mut config.action.min_separation_mm, self.min_separation_mm);
        config.action.min_separation_deg = self.min_separation_deg.or(config.action.min_separation_deg);
        set(&mut config.stop_probability, self.stop_probability);
        set(&mut config.action.travel_nats_per_mm, self.travel_nats_per_mm);
        config.none_fit = self.none_fit.or(config.none_fit);
        set(&mut config.fit_margin, self.fit_margin);
        set(&mut config.likelihood.overlap_mm, self.overlap_mm);
        config.subdivisions = self.subdivisions.unwrap_or(config.subdivisions);
        config.action.n_finalists = self.finalists.or(config.action.n_finalists);
        config.likelihood.blank_share = self.blank_share.unwrap_or(config.likelihood.blank_share);
        config.low_similarity = self.low_similarity.unwrap_or(config.low_similarity);
        config.action.n_draws = self.draws.unwrap_or(config.action.n_draws);
        config.action.n_suppositions = self.suppositions.unwrap_or(config.action.n_suppositions);
        if let (EngineConfig::Particle(particles), Some(n)) = (&mut config.engine, self.particles) {
            particles.n_particles = n;
        }
        config.validate()?;
        Ok(config)
    }
}

/// The rule of a name.
pub fn rule(name: &str) -> Result<ActionRule> {
    match name {
        "paper" => Ok(ActionRule::Paper),
        "information" => Ok(ActionRule::Information),
        "random" => Ok(ActionRule::Random),
        other => Err(Error::invalid("--actions", "paper, information or random", other)),
    }
}
