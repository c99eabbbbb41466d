//! The settings of an episode as a plain struct, all of them.

use tactile_filter::EpisodeConfig;
use tactile_filter::belief::EngineConfig;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::choice::ActionRule;
use tactile_filter::likelihood::interpolation::Interpolation;
use tactile_infer::Views;

use crate::model::tf_model;
use crate::pointer::{get, out};
use crate::sensor::{side, tf_side};
use crate::status::{Failure, call, tf_status};

/// Which inference runs.
#[repr(C)]
pub enum tf_engine {
    /// All states: exact on the grid.
    Exact = 0,
    /// A particle filter.
    Particle = 1,
}

/// How the next touch is chosen.
#[repr(C)]
pub enum tf_rule {
    /// The largest expected information.
    Information = 0,
    /// The paper's rule.
    Paper = 1,
    /// Any motion, each equally likely.
    Random = 2,
    /// Any motion that would show an edge from the likeliest state, each equally likely.
    RandomEdge = 3,
}

/// How views between recorded poses are judged.
#[repr(C)]
pub enum tf_interpolation {
    /// Interpolated where the bank's grid is fine enough, else by the nearest view.
    Auto = 0,
    /// By the nearest recorded view.
    Nearest = 1,
    /// Interpolated.
    Cubic = 2,
}

/// What the views of a bank are of.
#[repr(C)]
pub enum tf_views {
    /// Views of pegs, as a robot records them.
    Pegs = 0,
    /// Views of pegs and their holes, as a scene has them.
    Both = 1,
}

/// How an episode infers, chooses and stops. Filled by tf_episode_config_default(); change what you need. A setting with a
/// `has_` is not used where that is 0; other values of 0 or 1 are off or on.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct tf_episode_config {
    /// sizeof(tf_episode_config) of the program that uses it: set by tf_episode_config_default(). A later version of this
    /// library may add settings at the end, and then takes their defaults for a program that does not know them.
    pub size: usize,
    /// Seed of every random draw: same seed and touches, same numbers.
    pub seed: u64,
    /// Stop after this many touches, the first included; 1 to 1,000.
    pub max_touches: usize,
    /// Stop when a part is more probable than this, 0 to 1, and an edge was felt. 1: never for this reason.
    pub stop_probability: f64,
    /// 1: to be confident the place must be known too.
    pub has_stop_place: u32,
    /// 1: a part must explain the touches.
    pub has_none_fit: u32,
    /// To be confident the place must be known to this standard deviation along x and along y, mm; positive.
    pub stop_place_mm: f64,
    /// A part explains the touches where tf_estimate.fit is at least this; at or below 0.
    pub none_fit: f64,
    /// To be confident after n touches the fit must be at least none_fit + fit_margin / sqrt(n); not negative.
    pub fit_margin: f64,
    /// A fit below none_fit means none of these parts from this many touches on, where at least two of them showed an edge
    /// in the recorded area (with 1 here, one); at least 1.
    pub none_touches: usize,
    /// 1: the pose may lie between recorded ones.
    pub between_poses: u32,
    /// An estimate warns where no edged touch reached this cosine with any recorded view, -1 to 1.
    pub low_similarity: f32,
    /// States between two recorded poses on each axis, 1 to 4.
    pub subdivisions: usize,

    /// A value of tf_engine.
    pub engine: u32,
    /// A value of tf_rule.
    pub rule: u32,
    /// Particles, 1 to 1,000,000, and times one more than n_moves at most as many; of the particle filter only, as the next
    /// three.
    pub n_particles: usize,
    /// Resample when the effective sample size is at most this share of them, 0 to 1.
    pub resample_share: f64,
    /// 1: as many particles as the states still occupied ask for, up to n_particles.
    pub adaptive_particles: u32,
    /// A value of tf_interpolation.
    pub interpolation: u32,
    /// Moves of each particle after each touch.
    pub n_moves: usize,

    /// States drawn from the belief, against which a motion is judged; 1 to 100,000. A decision among 1,000 motions weighs at
    /// most 1e8 pairs of drawn and supposed states, over all motions that are judged.
    pub n_draws: usize,
    /// States supposed true in turn; 1 to 10,000.
    pub n_suppositions: usize,
    /// 1: only the best of a first pass are judged by all draws.
    pub has_n_finalists: u32,
    /// 1: a touch near an earlier one counts where it is turned by min_separation_deg.
    pub has_min_separation_deg: u32,
    /// How many those are; at least 1.
    pub n_finalists: usize,
    /// A touch keeps at least this far from every earlier one, mm, not negative ...
    pub min_separation_mm: f64,
    /// ... or is turned against it by at least this much, degrees, not negative.
    pub min_separation_deg: f64,
    /// What a millimetre of travel must tell to be worth it, nats, not negative; TF_RULE_INFORMATION only.
    pub travel_nats_per_mm: f64,
    /// A motion counts only from states where it would show a larger share of edge than this, 0 to 1.
    pub contact_threshold: f32,

    /// A view with a smaller share of edge is blank, 0 to 1.
    pub blank_share: f32,
    /// Probability that hole and peg at one pose are both blank or both edged; above 0 and below 1.
    pub blank_agreement: f64,
    /// The difference of cosine that changes a probability by a factor e; positive.
    pub temperature: f64,
    /// Share of the touches that look like any view rather than like their own, 0 to below 1.
    pub outlier_share: f64,
    /// How far from its pose the nearest view is trusted wholly, steps of the grid; positive.
    pub nearest_tolerance: f64,
    /// Touches nearer than this share evidence, mm, not negative.
    pub overlap_mm: f64,
    /// Touches at one place turned by less than this share evidence, degrees; positive.
    pub overlap_deg: f64,

    /// The cosine of an edged touch with the view that it was made at: mean, -1 to 1 ...
    pub matched_mean: f64,
    /// ... and standard deviation, positive: what tf_estimate.fit is measured by. This and what follows are
    /// not of the first version of this struct.
    pub matched_sd: f64,
    /// Not used: kept so that what follows stays where it is.
    pub gap_mean: f64,
    /// Not used.
    pub gap_sd: f64,
    /// A view outside the recorded area is as likely as a recorded one whose cosine with the touch is this, -1 to 1.
    pub unknown_similarity: f64,
    /// 0: it is as likely as an average recorded one.
    pub has_unknown_similarity: u32,
    /// Share of their error that the touches of one hole have in common, 0 to 1, where they match their views well; up to six
    /// times as much, and at most 1, the worse they do. n touches count as n / (1 + share (n - 1)).
    pub shared_error: f64,
    /// A tf_views: what the views of the bank are of that matched_mean and matched_sd were measured with.
    pub matched_views: u32,
    /// Share of the square of matched_sd that the touches of one hole have in common, 0 to 1.
    pub matched_shared: f64,
}

/// The size of the struct's first version.
pub(crate) const FIRST_SIZE: usize = std::mem::offset_of!(tf_episode_config, matched_mean);

/// The size of its second version.
pub(crate) const SECOND_SIZE: usize = std::mem::offset_of!(tf_episode_config, matched_views);

/// The size of its third version.
pub(crate) const THIRD_SIZE: usize = std::mem::offset_of!(tf_episode_config, matched_shared);

/// Refuses a size that no version of the struct has.
pub(crate) fn check_size(name: &str, size: usize) -> Result<(), Failure> {
    let newest = size_of::<tf_episode_config>();
    if [FIRST_SIZE, SECOND_SIZE, THIRD_SIZE, newest].contains(&size) {
        Ok(())
    } else {
        Err(Failure::argument(name, newest, size))
    }
}

impl From<ActionRule> for tf_rule {
    fn from(rule: ActionRule) -> Self {
        match rule {
            ActionRule::Information => Self::Information,
            ActionRule::Paper => Self::Paper,
            ActionRule::Random => Self::Random,
            ActionRule::RandomEdge => Self::RandomEdge,
        }
    }
}

impl From<Interpolation> for tf_interpolation {
    fn from(interpolation: Interpolation) -> Self {
        match interpolation {
            Interpolation::Auto => Self::Auto,
            Interpolation::Nearest => Self::Nearest,
            Interpolation::Cubic => Self::Cubic,
        }
    }
}

impl From<Views> for tf_views {
    fn from(views: Views) -> Self {
        match views {
            Views::Pegs => Self::Pegs,
            Views::Both => Self::Both,
        }
    }
}

impl From<&EpisodeConfig> for tf_episode_config {
    fn from(config: &EpisodeConfig) -> Self {
        let EpisodeConfig { action, likelihood, .. } = config;
        let (engine, particle) = match config.engine {
            EngineConfig::Exact => (tf_engine::Exact, ParticleConfig::default()),
            EngineConfig::Particle(particle) => (tf_engine::Particle, particle),
        };
        Self {
            size: size_of::<Self>(),
            seed: config.seed,
            max_touches: config.max_touches,
            stop_probability: config.stop_probability,
            has_stop_place: config.stop_place_mm.is_some().into(),
            has_none_fit: config.none_fit.is_some().into(),
            stop_place_mm: config.stop_place_mm.unwrap_or(1.0),
            none_fit: config.none_fit.unwrap_or_default(),
            fit_margin: config.fit_margin,
            none_touches: config.none_touches,
            between_poses: config.between_poses.into(),
            low_similarity: config.low_similarity,
            subdivisions: config.subdivisions,
            engine: engine as u32,
            rule: tf_rule::from(action.rule) as u32,
            n_particles: particle.n_particles,
            resample_share: particle.resample_share,
            adaptive_particles: particle.adaptive.into(),
            interpolation: tf_interpolation::from(likelihood.interpolation) as u32,
            n_moves: particle.n_moves,
            n_draws: action.n_draws,
            n_suppositions: action.n_suppositions,
            has_n_finalists: action.n_finalists.is_some().into(),
            has_min_separation_deg: action.min_separation_deg.is_some().into(),
            n_finalists: action.n_finalists.unwrap_or(1),
            min_separation_mm: action.min_separation_mm,
            min_separation_deg: action.min_separation_deg.unwrap_or_default(),
            travel_nats_per_mm: action.travel_nats_per_mm,
            contact_threshold: action.contact_threshold,
            blank_share: likelihood.blank_share,
            blank_agreement: likelihood.blank_agreement,
            temperature: likelihood.temperature,
            outlier_share: likelihood.outlier_share,
            nearest_tolerance: likelihood.nearest_tolerance,
            overlap_mm: likelihood.overlap_mm,
            overlap_deg: likelihood.overlap_deg,
            matched_mean: likelihood.matched_mean,
            matched_sd: likelihood.matched_sd,
            gap_mean: 0.0,
            gap_sd: 0.0,
            unknown_similarity: likelihood.unknown_similarity.unwrap_or_default(),
            has_unknown_similarity: likelihood.unknown_similarity.is_some().into(),
            shared_error: likelihood.shared_error,
            matched_views: tf_views::from(likelihood.matched_views) as u32,
            matched_shared: likelihood.matched_shared,
        }
    }
}

/// Fills in the settings that were measured to be good for a model where holes are touched.
/// \param size  sizeof(tf_episode_config) of your program
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_config_default(
    model: *const tf_model,
    size: usize,
    config: *mut tf_episode_config,
) -> tf_status {
    unsafe { tf_episode_config_of_side(model, tf_side::Hole as u32, size, config) }
}

/// Fills in the settings that were measured to be good for a model where this side is touched; of a model without a
/// calibration for pegs, those for holes.
/// \param touched  a value of tf_side
/// \param size  sizeof(tf_episode_config) of your program
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_config_of_side(
    model: *const tf_model,
    touched: u32,
    size: usize,
    config: *mut tf_episode_config,
) -> tf_status {
    call(|| {
        check_size("size", size)?;
        let default = EpisodeConfig::of_side(&unsafe { get(model, "model")? }.model, side(touched)?);
        let default = tf_episode_config { size, ..(&default).into() };
        out(config.cast::<usize>(), "config")?;
        // No more than the program has room for.
        unsafe { std::ptr::copy_nonoverlapping((&raw const default).cast::<u8>(), config.cast(), size) };
        Ok(())
    })
}
