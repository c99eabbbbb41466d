//! The frame of the sensor at rest of a recording.

use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::file::output;
use crate::frame::Frame;
use crate::frame::picture;
use crate::recording::geometry::check_px;

/// Where no frame at rest is named, at most this many first frames are taken for it.
pub const MAX_REST_FRAMES: usize = 15;

/// Two frames of a sensor at rest differ by less than this mean absolute difference, counts. White
/// noise of 2.5 counts gives 2.5 * 2 / sqrt(pi) = 2.8; the lightest touch that changes a tenth of a
/// view by 20 counts adds 2.
const REST_COUNTS: f64 = 3.0;

/// Where the frame of the sensor at rest comes from.
#[derive(Clone, Debug, Default)]
pub enum NoContact {
    /// A picture; not counted among the frames where it is in the same folder.
    File(PathBuf),
    /// The median of this many first frames.
    First(usize),
    /// The median of the first frames that look like the very first.
    #[default]
    Guess,
}

/// The sensor at rest as its source holds it; `frames` gives the recording's own, each with its place. A guess
/// adds a line to `warnings`.
///
/// # Errors
/// A picture that cannot be read, too few frames, or first frames of several sizes.
pub fn find(
    how: &NoContact,
    frames: &mut dyn Iterator<Item = Result<(Frame, String)>>,
    warnings: &mut Vec<String>,
) -> Result<Frame> {
    match how {
        NoContact::File(path) => picture::read(path),
        NoContact::First(0) => Err(Error::invalid("no-contact frames", "at least 1", "0")),
        NoContact::First(n) => {
            let first = take(frames, *n, f64::INFINITY)?;
            if first.len() < *n {
                return Err(Error::invalid("no-contact frames", format!("{n} first frames"), first.len().to_string()));
            }
            median(&first)
        }
        NoContact::Guess => {
            let first = take(frames, MAX_REST_FRAMES, REST_COUNTS)?;
            if first.is_empty() {
                return Err(Error::invalid("no-contact frames", "at least one frame", "none"));
            }
            warnings.push(format!(
                "no no-contact frame given: taking the first {} frame(s), which look alike, for the sensor at rest",
                first.len()
            ));
            median(&first)
        }
    }
}

/// The first frames, `n` at most, up to one that differs from the very first by more than `counts`.
fn take(frames: &mut dyn Iterator<Item = Result<(Frame, String)>>, n: usize, counts: f64) -> Result<Vec<Frame>> {
    let mut taken: Vec<Frame> = Vec::new();
    for frame in frames.take(n) {
        let (frame, place) = frame?;
        if let Some(first) = taken.first() {
            check_px(&frame, [first.width_px(), first.height_px()], &place)?;
            if mean_difference(first, &frame) > counts {
                break;
            }
        } else {
            output::check_memory("no-contact frames", n, n as f64 * frame.rgb().len() as f64)?;
        }
        taken.push(frame);
    }
    Ok(taken)
}

/// Mean absolute difference of two frames of one size, counts.
fn mean_difference(a: &Frame, b: &Frame) -> f64 {
    let sum: u64 = a.rgb().iter().zip(b.rgb()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.rgb().len() as f64
}

/// The median of each byte over frames of one size.
///
/// # Errors
/// No frame.
pub fn median(frames: &[Frame]) -> Result<Frame> {
    if frames.is_empty() {
        return Err(Error::invalid("no-contact frames", "at least one frame", "none"));
    }
    let mut values = vec![0; frames.len()];
    let middle = frames.len() / 2;
    let rgb = (0..frames[0].rgb().len()).map(|at| {
        values.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.rgb()[at]);
        *values.select_nth_unstable(middle).1
    });
    Frame::new(frames[0].width_px(), frames[0].height_px(), rgb.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frames(values: &[u8]) -> impl Iterator<Item = Result<(Frame, String)>> {
        values.iter().map(|value| Ok((Frame::new(4, 2, vec![*value; 24]).unwrap(), format!("frame {value}"))))
    }

    fn found(how: NoContact, values: &[u8]) -> Result<(u8, usize)> {
        let mut warnings = Vec::new();
        let frame = find(&how, &mut frames(values), &mut warnings)?;
        Ok((frame.rgb()[0], warnings.len()))
    }

    #[test]
    fn the_median_of_the_first_is_taken_and_a_guess_ends_at_the_first_that_differs() {
        assert_eq!(found(NoContact::First(3), &[10, 90, 30, 31]).unwrap(), (30, 0));
        assert_eq!(found(NoContact::Guess, &[10, 12, 11, 90, 90, 90, 90]).unwrap(), (11, 1));
    }

    #[test]
    fn too_few_frames_are_refused() {
        for (how, values, reason) in [
            (NoContact::First(0), &[1_u8][..], "at least 1"),
            (NoContact::First(3), &[1, 2], "expected 3 first frames, got 2"),
            (NoContact::First(usize::MAX), &[1, 2], "memory"),
            (NoContact::Guess, &[], "at least one frame"),
        ] {
            let message = found(how, values).unwrap_err().to_string();
            assert!(message.contains(reason), "{message}");
        }
    }
}
