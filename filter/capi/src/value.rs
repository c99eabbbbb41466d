//! Plain values that cross the border: poses, estimates, decisions.

use std::ffi::c_char;

use tactile_data::pose::se2::Se2;
use tactile_data::pose::symmetry::Symmetry;
use tactile_filter::belief::modes::Mode;
use tactile_filter::{Decision, Estimate, RunnerUp, StopReason, Warning};

use crate::model::Parts;
use crate::pointer::{fill, get};
use crate::status::{Failure, call, tf_status};

/// A rigid motion or a pose in the plane. x to the right, y downwards, angles from x towards y, as in the sensor's image.
/// Zeros are no motion.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct tf_pose {
    /// Along x, mm.
    pub x_mm: f64,
    /// Along y, mm.
    pub y_mm: f64,
    /// The turn, rad; any finite angle is taken, one above -pi and up to pi is given.
    pub theta_rad: f64,
}

impl From<Se2> for tf_pose {
    fn from(Se2 { x_mm, y_mm, theta_rad }: Se2) -> Self {
        Self { x_mm, y_mm, theta_rad }
    }
}

impl From<tf_pose> for Se2 {
    fn from(tf_pose { x_mm, y_mm, theta_rad }: tf_pose) -> Self {
        Self::new(x_mm, y_mm, theta_rad)
    }
}

/// a_from_c: one motion after another, each in the frame that the one before led to; the sum of the motions since a touch.
#[unsafe(no_mangle)]
pub extern "C" fn tf_pose_compose(a_from_b: tf_pose, b_from_c: tf_pose) -> tf_pose {
    (Se2::from(a_from_b) * Se2::from(b_from_c)).into()
}

/// b_from_a: the motion back.
#[unsafe(no_mangle)]
pub extern "C" fn tf_pose_inverse(a_from_b: tf_pose) -> tf_pose {
    Se2::from(a_from_b).inverse().into()
}

/// Why an episode is over.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum tf_stop {
    /// It is not: go on.
    #[default]
    None = 0,
    /// A part is more probable than stop_probability, explains the touches, and was told from the next likeliest.
    Confident = 1,
    /// No part explains the touches: this one is not in the bank.
    NoneOfThese = 2,
    /// max_touches touches were made.
    TouchLimit = 3,
    /// No motion of the reach leads anywhere that was not touched.
    NothingToLearn = 4,
}

impl From<StopReason> for tf_stop {
    fn from(reason: StopReason) -> Self {
        match reason {
            StopReason::Confident => Self::Confident,
            StopReason::NoneOfThese => Self::NoneOfThese,
            StopReason::TouchLimit => Self::TouchLimit,
            StopReason::NothingToLearn => Self::NothingToLearn,
        }
    }
}

/// tf_estimate.symmetry_order of a round part, which feels the same after any turn.
pub const TF_ROUND: usize = 360;

/// Bit of tf_estimate.warnings: no edged touch looks like any recorded view; perhaps none of these parts.
pub const TF_WARNING_LOW_SIMILARITY: u32 = 1;
/// Bit of tf_estimate.warnings: every touch was blank, no edge was ever seen.
pub const TF_WARNING_NOTHING_SEEN: u32 = 2;
/// Bit of tf_estimate.warnings: the bank, or the fit of its maps, is for the other side than the one that is touched.
pub const TF_WARNING_OTHER_SIDE: u32 = 4;
/// Bit of tf_estimate.warnings: what was felt is longer or shorter than the named part, which is not named with confidence.
pub const TF_WARNING_OTHER_SIZE: u32 = 8;

/// What is known after the touches so far.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct tf_estimate {
    /// Index of the most probable part in the bank; the first of equals.
    pub part: usize,
    /// Its name, UTF-8. Belongs to the episode or runner that gave the estimate, and is valid until that is freed.
    pub part_name: *const c_char,
    /// Its probability, 0 to 1.
    pub probability: f64,
    /// Pose of the sensor now, in the part's frame.
    pub part_from_sensor: tf_pose,
    /// Pose of the sensor at its first touch, in the part's frame.
    pub part_from_first: tf_pose,
    /// Covariance of that pose over (x mm, y mm, theta rad), row by row, over all that is believed of where the part is: other
    /// places count as far as they are away.
    pub covariance: [f64; 9],
    /// 1 where `fit`, `none_probability` and `stranger_rate` hold numbers: an edge was felt.
    pub has_fit: u32,
    /// Bits TF_WARNING_...: reasons to doubt all this.
    pub warnings: u32,
    /// How well the part explains what was felt: how many standard deviations the edged touches look more like its views than the
    /// touches of a part that is there do on average.
    pub fit: f64,
    /// Probability that it is none of the bank's parts, 0 to 1, where that was as likely as the named part before the first touch.
    pub none_probability: f64,
    /// How often a part that is not in the bank comes to so good a match at any touch of an episode, 0 to 1.
    pub stranger_rate: f64,
    /// Entropy over all states, nats.
    pub entropy_nats: f64,
    /// Log-probability of all touches, nats, up to a constant.
    pub log_evidence: f64,
    /// Touches taken in.
    pub n_touches: usize,
    /// Turns by 360 degrees / symmetry_order about the centre change nothing that can be felt; 1: only the full turn does
    /// so; TF_ROUND: any turn.
    pub symmetry_order: usize,
    /// That centre along x and y in the part's frame, mm.
    pub symmetry_centre_mm: [f64; 2],
}

impl Default for tf_estimate {
    fn default() -> Self {
        Self {
            part: 0,
            part_name: c"".as_ptr(),
            probability: 0.0,
            part_from_sensor: tf_pose::default(),
            part_from_first: tf_pose::default(),
            covariance: [0.0; 9],
            has_fit: 0,
            warnings: 0,
            fit: 0.0,
            none_probability: 0.0,
            stranger_rate: 0.0,
            entropy_nats: 0.0,
            log_evidence: 0.0,
            n_touches: 0,
            symmetry_order: 1,
            symmetry_centre_mm: [0.0; 2],
        }
    }
}

/// A covariance of C's, row by row.
pub(crate) fn unflat(values: &[f64; 9]) -> [[f64; 3]; 3] {
    [0, 1, 2].map(|row| [0, 1, 2].map(|column| values[3 * row + column]))
}

/// Row by row.
pub(crate) fn flat(covariance: &[[f64; 3]; 3]) -> [f64; 9] {
    let mut rows = [0.0; 9];
    rows.iter_mut().zip(covariance.as_flattened()).for_each(|(to, from)| *to = *from);
    rows
}

impl tf_estimate {
    /// An estimate as C sees it; its name belongs to `parts`.
    pub(crate) fn of(estimate: &Estimate, parts: &Parts) -> Result<Self, Failure> {
        let part = parts.index(&estimate.part)?;
        let warnings = estimate.warnings.iter().map(|warning| match warning {
            Warning::LowSimilarity { .. } => TF_WARNING_LOW_SIMILARITY,
            Warning::NothingSeen => TF_WARNING_NOTHING_SEEN,
            Warning::OtherSide { .. } => TF_WARNING_OTHER_SIDE,
            Warning::OtherSize { .. } => TF_WARNING_OTHER_SIZE,
        });
        Ok(Self {
            part,
            part_name: parts.name(part)?.as_ptr(),
            probability: estimate.probability,
            part_from_sensor: estimate.part_from_sensor.into(),
            part_from_first: estimate.part_from_first.into(),
            covariance: flat(&estimate.covariance),
            has_fit: estimate.fit.is_some().into(),
            warnings: warnings.fold(0, |bits, bit| bits | bit),
            fit: estimate.fit.unwrap_or_default(),
            none_probability: estimate.presence.map_or(0.0, |presence| presence.none()),
            stranger_rate: estimate.presence.map_or(0.0, |presence| presence.stranger_rate),
            entropy_nats: estimate.entropy_nats,
            log_evidence: estimate.log_evidence,
            n_touches: estimate.n_touches,
            symmetry_order: estimate.symmetry.order.unwrap_or(TF_ROUND),
            symmetry_centre_mm: estimate.symmetry.centre_mm,
        })
    }
}

/// The second most probable part.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct tf_runner_up {
    /// 1 where there is one; 0 where no other part is left, then all else is zeros and an empty name.
    pub has_part: u32,
    /// Its index in the bank; the first of equals.
    pub part: usize,
    /// Its name, UTF-8. Belongs to the episode or runner, and is valid until that is freed.
    pub part_name: *const c_char,
    /// Its probability, 0 to 1.
    pub probability: f64,
}

impl Default for tf_runner_up {
    fn default() -> Self {
        Self { has_part: 0, part: 0, part_name: c"".as_ptr(), probability: 0.0 }
    }
}

impl tf_runner_up {
    /// A runner-up, where there is one, as C sees it; its name belongs to `parts`.
    pub(crate) fn of(runner_up: Option<&RunnerUp>, parts: &Parts) -> Result<Self, Failure> {
        let Some(RunnerUp { part, probability }) = runner_up else {
            return Ok(Self::default());
        };
        let part = parts.index(part)?;
        Ok(Self { has_part: 1, part, part_name: parts.name(part)?.as_ptr(), probability: *probability })
    }
}

/// What to do.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum tf_decision_kind {
    /// Move by sensor_from_next, touch, and take that touch in.
    #[default]
    Touch = 0,
    /// Stop.
    Done = 1,
}

/// What to do next.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct tf_decision {
    /// Touch again, or stop.
    pub kind: tf_decision_kind,
    /// Why to stop; TF_STOP_NONE for a touch.
    pub stop: tf_stop,
    /// For a touch: the motion to make, one of the reach, in the sensor's frame.
    pub sensor_from_next: tf_pose,
    /// For a stop: what was found; else zeros and an empty name.
    pub estimate: tf_estimate,
}

impl tf_decision {
    /// A decision as C sees it; its name belongs to `parts`.
    pub(crate) fn of(decision: &Decision, parts: &Parts) -> Result<Self, Failure> {
        Ok(match decision {
            Decision::Touch(action) => Self { sensor_from_next: action.sensor_from_next.into(), ..Self::default() },
            Decision::Done(estimate, reason) => Self {
                kind: tf_decision_kind::Done,
                stop: (*reason).into(),
                estimate: tf_estimate::of(estimate, parts)?,
                ..Self::default()
            },
        })
    }
}

/// A peak of the belief with the states that lead up to it.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct tf_mode {
    /// Index of the part in the bank.
    pub part: usize,
    /// Probability of the mode's states, 0 to 1; of its twins' too, where the part is symmetric.
    pub mass: f64,
    /// Mean pose of the sensor now, in the part's frame.
    pub part_from_sensor: tf_pose,
    /// Covariance of that pose over (x mm, y mm, theta rad), row by row.
    pub covariance: [f64; 9],
}

impl From<&Mode> for tf_mode {
    fn from(Mode { part, mass, part_from_sensor, covariance }: &Mode) -> Self {
        let (part_from_sensor, covariance) = ((*part_from_sensor).into(), flat(covariance));
        Self { part: *part, mass: *mass, part_from_sensor, covariance }
    }
}

/// A pose of the sensor on a part, and its probability.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct tf_state {
    /// Pose of the sensor now, in the part's frame.
    pub part_from_sensor: tf_pose,
    /// Its probability, 0 to 1; over all poses of all parts they sum to 1.
    pub probability: f64,
}

/// The poses that touch cannot tell from an estimate's, itself first: insert at any of them.
/// \param required  where their number goes, symmetry_order, or 36 of a round part; with a capacity of 0
///                  nothing else is written
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_estimate_twins(
    estimate: *const tf_estimate,
    buffer: *mut tf_pose,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let estimate = get(estimate, "estimate")?;
        let order = Some(estimate.symmetry_order).filter(|order| *order != TF_ROUND);
        let symmetry = Symmetry { order, centre_mm: estimate.symmetry_centre_mm };
        if !symmetry.is_valid() {
            let expected = format!("1 to {} or TF_ROUND, and a finite centre", Symmetry::MAX_ORDER);
            return Err(Failure::argument("estimate.symmetry_order", expected, estimate.symmetry_order));
        }
        let twins: Vec<tf_pose> =
            symmetry.twins(&estimate.part_from_sensor.into()).into_iter().map(Into::into).collect();
        fill(&twins, buffer, capacity, required)
    })
}
