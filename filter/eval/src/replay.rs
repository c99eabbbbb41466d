//! Recordings played back through the filter, the same way as live touches.

use std::sync::Arc;

use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::{Side, Touch, instead_of};
use tactile_data::pose::se2::Se2;
use tactile_data::recording::contact;
use tactile_infer::Bank;
use tactile_infer::maps::mosaic::Difference;

use crate::error::{Error, Result};
use tactile_filter::{Episode, EpisodeConfig, FeltMap, Sensor, StopReason, Warning};

/// One touch of a recording: the frame to look at, and the motion since the touch before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Played {
    /// Index of the frame.
    pub frame: usize,
    /// Motion since the touch before, in the sensor's frame there; `None` begins an episode.
    pub moved: Option<Se2>,
}

/// What one recorded episode came to.
#[derive(Clone, Debug, Serialize)]
pub struct Replayed {
    /// Frames looked at, in order.
    pub frames: Vec<usize>,
    /// The most probable part.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// The part that it may be as well: the next likeliest and its probability, where [`tactile_filter::Estimate::second`] says so; left
    /// out otherwise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub or: Option<(String, f64)>,
    /// Pose of the sensor at the last touch: x mm, y mm, theta degrees.
    pub part_from_sensor: [f64; 3],
    /// Turns of the part, none among them, that feel the same: 1 for a part without symmetry; `None`: any turn.
    pub symmetry_order: Option<usize>,
    /// The part that was touched, where the recording says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<String>,
    /// Whether the filter would act on this: confident, and nothing in the touches to doubt it.
    pub confident: bool,
    /// The probability that it is none of the bank's parts, before which a stranger was as likely, 0..=1; left out where no edge was felt.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub none_probability: Option<f64>,
    /// The share of strangers' episodes that look this much like a part of the bank, 0..=1; left out where no edge was felt.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stranger_rate: Option<f64>,
    /// Why the filter stopped; left out where the recording ended first.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub stop: Option<StopReason>,
    /// Reasons to doubt it.
    pub warnings: Vec<String>,
    /// How what was felt (first) differs from the bank's map of the part (second), mm²; left out without maps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub difference: Option<Difference>,
    /// What was felt, where maps were drawn.
    #[serde(skip)]
    pub felt_map: Option<FeltMap>,
    /// All touches that were looked at.
    #[serde(skip)]
    pub episode: Episode,
}

/// Cuts a recording into episodes.
///
/// A frame with `moved` continues the episode. Frames of one part and one named episode, whose poses are known, follow
/// each other by the motion between them. Frames of which neither is known are a film: each run of frames with
/// contact is one touch, its most edged frame, and an episode of its own. Touches of the other side are passed over.
///
/// # Errors
/// Touches of the other side alone, and frames of a film that cannot be used.
pub fn episodes(dataset: &Dataset, side: Side) -> Result<Vec<Vec<Played>>> {
    let is_film = |touch: &Touch| touch.moved.is_none() && touch.part_from_sensor.is_none();
    let contacts = if dataset.touches().iter().any(is_film) { contact::measure(dataset)? } else { Vec::new() };
    let mut episodes: Vec<Vec<Played>> = Vec::new();
    let mut film: Option<(usize, f32)> = None;
    for (frame, touch) in dataset.touches().iter().enumerate() {
        if touch.side.is_some_and(|of| of != side) {
            continue;
        }
        if is_film(touch) {
            let contact = contacts[frame].as_ref().map_err(|e| at_frame(frame, e))?;
            match (&mut film, contact.is_contact()) {
                (Some(best), true) if contact.edge_share > best.1 => *best = (frame, contact.edge_share),
                (Some(_), true) => {}
                (None, true) => film = Some((frame, contact.edge_share)),
                (best, false) => episodes.extend(best.take().map(|(frame, _)| vec![Played { frame, moved: None }])),
            }
            continue;
        }
        episodes.extend(film.take().map(|(frame, _)| vec![Played { frame, moved: None }]));
        let last = episodes.last_mut().and_then(|episode| Some((episode.last()?.frame, episode)));
        let step = last.and_then(|(before, episode)| Some((motion(dataset.touch(before), touch)?, episode)));
        match step {
            Some((moved, episode)) => episode.push(Played { frame, moved: Some(moved) }),
            None => episodes.push(vec![Played { frame, moved: None }]),
        }
    }
    episodes.extend(film.take().map(|(frame, _)| vec![Played { frame, moved: None }]));
    if dataset.touches().iter().all(|touch| touch.side.is_some_and(|of| of != side)) {
        let other = if side.is_hole() { "--side peg plays them" } else { "--side hole plays them" };
        let got = instead_of(side, dataset.touches(), other);
        return Err(Error::invalid(dataset.meta().name.clone(), format!("touches of {side}s"), got));
    }
    Ok(episodes)
}

/// The motion from one touch to the next, where the recording has it.
fn motion(before: &Touch, now: &Touch) -> Option<Se2> {
    if now.moved.is_some() {
        return now.moved;
    }
    let same = before.part == now.part && before.side == now.side && before.episode == now.episode;
    let (from, to) = (before.part_from_sensor?, now.part_from_sensor?);
    same.then(|| from.inverse() * to)
}

/// Plays one episode until its stopping rule ends it or the recording does. If `feels_all`, what is none of these parts is felt to the
/// recording's end.
pub fn play(
    (dataset, touches): (&Dataset, &[Played]),
    sensor: &Sensor,
    bank: &Arc<Bank>,
    config: &EpisodeConfig,
    feels_all: bool,
) -> Result<Replayed> {
    let Some(first) = touches.first() else {
        return Err(Error::invalid("recorded episode", "at least one touch", "none"));
    };
    let observe = |frame: usize| sensor.observe(&dataset.frame(frame)).map_err(|e| at_frame(frame, &e));
    let begun = Episode::begin(*config, bank.clone(), &observe(first.frame)?);
    let mut episode = begun.map_err(|e| at_frame(first.frame, &e))?;
    let mut frames = vec![first.frame];
    let mut ended = None;
    for next in &touches[1..] {
        if ended.is_none() && episode.stop_reason().is_some() {
            ended = Some(episode.estimate());
        }
        if ended.as_ref().is_some_and(|ended| !feels_all || ended.stop != Some(StopReason::NoneOfThese)) {
            break;
        }
        let moved = next.moved.unwrap_or(Se2::IDENTITY);
        episode.observe(moved, &observe(next.frame)?).map_err(|e| at_frame(next.frame, &e))?;
        if ended.is_none() {
            frames.push(next.frame);
        }
    }
    let estimate = ended.unwrap_or_else(|| episode.estimate());
    let (pose, felt_map) = (estimate.part_from_sensor, episode.felt_map());
    Ok(Replayed {
        difference: felt_map.as_ref().and_then(|map| map.difference),
        felt_map,
        truth: dataset.touch(first.frame).part.clone(),
        confident: estimate.stop == Some(StopReason::Confident)
            && !estimate.warnings.iter().any(Warning::is_of_touches),
        none_probability: estimate.presence.map(|presence| presence.none()),
        stranger_rate: estimate.presence.map(|presence| presence.stranger_rate),
        or: estimate.second().map(|other| (other.part.clone(), other.probability)),
        stop: estimate.stop,
        warnings: estimate.warnings.iter().map(ToString::to_string).collect(),
        part: estimate.part,
        probability: estimate.probability,
        part_from_sensor: [pose.x_mm, pose.y_mm, pose.theta_deg()],
        symmetry_order: estimate.symmetry.order,
        frames,
        episode,
    })
}

fn at_frame(frame: usize, error: &dyn std::fmt::Display) -> Error {
    Error::invalid(format!("frame {frame}"), "a usable frame", error.to_string())
}
