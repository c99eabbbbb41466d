//! What is odd about the pictures of touches.

use std::collections::HashMap;
use std::hash::{DefaultHasher, Hasher};

use rayon::prelude::*;

use super::{Finding, Kind, named};
use crate::dataset::store::Dataset;
use crate::dataset::touch::Touch;
use crate::error::Result;
use crate::frame::{Background, EDGE_COUNTS, Preprocessing, area_average};
use crate::recording::contact::FrameContact;

/// Size at which light is compared, pixels: noise averages out below one count.
const LIGHT_PX: [usize; 2] = [40, 30];

/// At most this many frames are looked at for one figure; the median of so many is known to a tenth of its spread.
const MAX_SAMPLE: usize = 200;

/// No median is taken of fewer frames.
pub(super) const LEAST_SAMPLE: usize = 10;

/// The frame at rest may be brighter or darker than the touches by this much, counts. In simulated recordings of every
/// preset, whose exposure drifts by -8..+19 %, it is at most 1.2; an exposure set anew by a tenth makes 8 to 11.
const EXPOSURE_COUNTS: f32 = 6.0;

/// Half of the view may differ by this much between the first and the last tenth, counts. In simulated recordings the
/// presets make 0.05 to 0.8, and 2.3 at most with only 17 frames a tenth in order of their poses under the roughest
/// sensor; a picture that moved by half a millimetre makes 3, by a millimetre 6.
const CHANGE_COUNTS: f32 = 3.0;

/// This share of the touches may show no contact: 0.004 of `alphabet-small` and 0.012 of `maze` do not. Of
/// `alphabet-large`, where faces fill the view, it is 0.12.
const NO_CONTACT_SHARE: f64 = 0.05;

/// A number for each frame: equal frames have equal ones.
pub(super) fn digests(dataset: &Dataset) -> Vec<u64> {
    let digest = |frame: usize| {
        let mut hasher = DefaultHasher::new();
        hasher.write(dataset.frame_bytes(frame));
        hasher.finish()
    };
    (0..dataset.len()).into_par_iter().map(digest).collect()
}

/// Frames with the bytes of an earlier one: noise makes every picture of a working camera another.
pub(super) fn frozen(dataset: &Dataset, digests: &[u64]) -> Option<Finding> {
    let mut first_with: HashMap<u64, usize> = HashMap::new();
    let (mut frames, mut first) = (Vec::new(), None);
    for (frame, digest) in digests.iter().enumerate() {
        let earlier = *first_with.entry(*digest).or_insert(frame);
        if earlier < frame && dataset.frame_bytes(earlier) == dataset.frame_bytes(frame) {
            first.get_or_insert(earlier);
            frames.push(frame);
        }
    }
    let message = format!(
        "{} frame(s) are byte for byte an earlier one (a frozen camera?): frames {}, first that of frame {}",
        frames.len(),
        named(&frames),
        first?
    );
    Some(Finding { kind: Kind::FrozenCamera, message, frames })
}

/// A frame at rest of another exposure than the touches: the median over touches of the light where nothing touches.
/// Frames whose exposure was found to be another (`others`, in order) do not count.
pub(super) fn rest_exposure(dataset: &Dataset, frames: &[Result<FrameContact>], others: &[usize]) -> Option<Finding> {
    let sample = sample(frames, (0..frames.len()).filter(|frame| others.binary_search(frame).is_err()));
    if sample.len() < LEAST_SAMPLE {
        return None;
    }
    let size = light_px(dataset);
    let rest = area_average(dataset.no_contact(), size);
    let shifts: Vec<[f32; 3]> =
        sample.into_par_iter().map(|frame| far_shift(&area_average(&dataset.frame(frame), size), &rest)).collect();
    let shift: [f32; 3] = std::array::from_fn(|channel| median(shifts.iter().map(|shift| shift[channel]).collect()));
    if shift.iter().all(|counts| counts.abs() <= EXPOSURE_COUNTS) {
        return None;
    }
    let [red, green, blue] = shift;
    let message = format!(
        "where nothing touches, the touches differ from the frame at rest by {red:+.1}, {green:+.1}, {blue:+.1} counts of \
         red, green and blue: it is of another exposure"
    );
    Some(Finding { kind: Kind::RestExposure, message, frames: Vec::new() })
}

/// How much brighter than at rest a frame is in each channel, far from what touches, counts: the mean over the pixels
/// whose difference is within [`EDGE_COUNTS`] of the frame's median.
fn far_shift(planes: &[f32], rest: &[f32]) -> [f32; 3] {
    let n = planes.len() / 3;
    let difference = |channel: usize, pixel: usize| planes[channel * n + pixel] - rest[channel * n + pixel];
    let medians: [f32; 3] = std::array::from_fn(|c| median((0..n).map(|pixel| difference(c, pixel)).collect()));
    let is_far = |pixel: &usize| (0..3).all(|c| (difference(c, *pixel) - medians[c]).abs() <= EDGE_COUNTS);
    let far: Vec<usize> = (0..n).filter(is_far).collect();
    if far.is_empty() {
        return medians;
    }
    std::array::from_fn(|c| far.iter().map(|pixel| difference(c, *pixel)).sum::<f32>() / far.len() as f32)
}

/// A sensor that moved or was changed: the first tenth of the frames shows another sensor at rest than the last.
pub(super) fn changed_sensor(dataset: &Dataset, frames: &[Result<FrameContact>]) -> Result<Option<Finding>> {
    let tenth = frames.len() / 10;
    let first = sample(frames, 0..tenth);
    let last = sample(frames, frames.len() - tenth..frames.len());
    if first.len().min(last.len()) < LEAST_SAMPLE {
        return Ok(None);
    }
    let background = Background::new(dataset.no_contact(), &Preprocessing::counts(light_px(dataset)))?;
    let (first, last) = (at_rest(dataset, &background, &first)?, at_rest(dataset, &background, &last)?);
    let n = first.len() / 3;
    let change = |pixel: usize| (0..3).map(|c| (first[c * n + pixel] - last[c * n + pixel]).abs()).fold(0.0, f32::max);
    // What touches is in another place at the end of a recording, but not in half of the view.
    let counts = median((0..n).map(change).collect());
    let message = format!(
        "half of the view differs by {counts:.1} counts or more between the first and the last tenth of the frames, \
         exposure set aside: the sensor moved or was changed"
    );
    Ok((counts > CHANGE_COUNTS).then_some(Finding { kind: Kind::ChangedSensor, message, frames: Vec::new() }))
}

/// What some frames show of the sensor at rest: the median over them of each pixel's difference from rest, exposure
/// compensated, counts; planes `[3, height, width]`.
fn at_rest(dataset: &Dataset, background: &Background, frames: &[usize]) -> Result<Vec<f32>> {
    let images = frames.par_iter().map(|frame| Ok(background.tactile_image(&dataset.frame(*frame))?.planes));
    let images = images.collect::<Result<Vec<_>>>()?;
    let n = images.first().map_or(0, Vec::len);
    Ok((0..n).into_par_iter().map(|at| median(images.iter().map(|image| image[at]).collect())).collect())
}

/// Touches with a pose that show no contact.
pub(super) fn without_contact(touches: &[Touch], frames: &[Result<FrameContact>]) -> Option<Finding> {
    let posed = || (0..frames.len()).filter(|frame| touches[*frame].part_from_sensor.is_some());
    let shows_nothing = |frame: &usize| frames[*frame].as_ref().is_ok_and(|frame| !frame.is_contact());
    let (n, without): (usize, Vec<usize>) = (posed().count(), posed().filter(shows_nothing).collect());
    let message = format!(
        "{} of {n} touches with a pose show no contact (a press that missed, or a face that fills the view): frames {}",
        without.len(),
        named(&without)
    );
    let is_much = without.len() as f64 > NO_CONTACT_SHARE * n as f64;
    is_much.then_some(Finding { kind: Kind::NoContact, message, frames: without })
}

/// Usable ones of some frames, evenly spread, at most [`MAX_SAMPLE`].
fn sample(frames: &[Result<FrameContact>], some: impl Iterator<Item = usize>) -> Vec<usize> {
    let usable: Vec<usize> = some.filter(|frame| frames[*frame].is_ok()).collect();
    let n = usable.len().min(MAX_SAMPLE);
    (0..n).map(|i| usable[i * usable.len() / n]).collect()
}

pub(super) fn light_px(dataset: &Dataset) -> [usize; 2] {
    let [width, height] = dataset.meta().frame_px;
    [width.min(LIGHT_PX[0]), height.min(LIGHT_PX[1])]
}

/// The middle one of at least one value.
pub(super) fn median(mut values: Vec<f32>) -> f32 {
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f32::total_cmp).1
}
