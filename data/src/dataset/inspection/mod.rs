//! What is missing or odd in a dataset of touches, mostly one that was recorded.

use serde::Serialize;

use crate::dataset::store::Dataset;
use crate::dataset::touch::Touch;
use crate::error::Result;
use crate::pose::se2::Se2;
use crate::recording::contact::FrameContact;

mod exposure;
mod pictures;
mod poses;
mod touches;

#[cfg(test)]
mod tests;

/// Frames named in a message before it says only that there are more.
const MAX_NAMED: usize = 4;

/// One thing that is missing or odd.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Finding {
    /// What kind of thing it is.
    pub kind: Kind,
    /// What was found, one line for a person.
    pub message: String,
    /// The frames it is about, in order; none where it is about the whole.
    pub frames: Vec<usize>,
}

/// What can be found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Holes without pegs, or pegs without holes.
    MissingSide,
    /// Parts touched more often than others.
    UnequalTouches,
    /// Times that go back.
    TimesGoBack,
    /// Poses of one part and side with several pictures.
    RepeatedPose,
    /// Poses far from every other.
    LonelyPose,
    /// Frames with the bytes of another one.
    FrozenCamera,
    /// A frame at rest that is brighter or darker than the touches.
    RestExposure,
    /// Frames in a row of another exposure than the frame at rest and than other frames.
    ChangedExposure,
    /// A sensor that moved or was changed.
    ChangedSensor,
    /// Touches with a pose that show no contact.
    NoContact,
}

/// Everything that is odd about a dataset, in the order of [`Kind`]; `frames` is what
/// [`contact::measure`](crate::recording::contact::measure) says of it.
///
/// # Errors
/// A frame at rest that is of no use.
pub fn findings(dataset: &Dataset, frames: &[Result<FrameContact>]) -> Result<Vec<Finding>> {
    let digests = pictures::digests(dataset);
    let touches = dataset.touches();
    let mut found = Vec::new();
    found.extend(touches::missing_sides(touches));
    found.extend(touches::unequal_numbers(touches));
    found.extend(touches::times_that_go_back(touches));
    found.extend(poses::repeated(touches, &digests));
    found.extend(poses::lonely(touches));
    found.extend(pictures::frozen(dataset, &digests));
    let changed = exposure::changed_exposure(dataset, frames);
    let others: Vec<usize> = changed.iter().flat_map(|finding| finding.frames.iter().copied()).collect();
    found.extend(pictures::rest_exposure(dataset, frames, &others));
    found.extend(changed);
    found.extend(pictures::changed_sensor(dataset, frames)?);
    found.extend(pictures::without_contact(touches, frames));
    Ok(found)
}

/// Whether a frame shows the touch before it on: a further frame of an animation.
fn is_continued(touch: &Touch) -> bool {
    touch.moved == Some(Se2::IDENTITY)
}

/// Frames by their numbers: the first of them where there are many.
fn named(frames: &[usize]) -> String {
    let shown: Vec<String> = frames.iter().take(MAX_NAMED).map(usize::to_string).collect();
    let more = if frames.len() > MAX_NAMED { ", ..." } else { "" };
    format!("{}{more}", shown.join(", "))
}
