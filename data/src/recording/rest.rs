//! The frame of the sensor at rest, from the first frames of a recording.

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::picture;
use crate::recording::folder::NoContact;
use crate::recording::pipeline::check_px;

/// Where no frame at rest is named, at most this many first frames are taken for it.
pub const MAX_REST_FRAMES: usize = 15;

/// Two frames of a sensor at rest differ by less than this mean absolute difference, counts. White
/// noise of 2.5 counts gives 2.5 * 2 / sqrt(pi) = 2.8; the lightest touch that changes a tenth of a
/// view by 20 counts adds 2.
const REST_COUNTS: f64 = 3.0;

/// The frame at rest. `frames` are the recording's first frames in order, each with its place for errors; no more of
/// them are asked for than are needed. What was guessed goes to `warnings`.
///
/// # Errors
/// Fewer frames than were asked for, frames of different sizes, a file that cannot be read.
pub fn no_contact(
    how: &NoContact,
    frames: &mut dyn Iterator<Item = Result<(Frame, String)>>,
    warnings: &mut Vec<String>,
) -> Result<Frame> {
    let n_first = match how {
        NoContact::File(path) => return picture::read(path),
        NoContact::First(0) => return Err(Error::invalid("no-contact frames", "at least 1", "0")),
        NoContact::First(n) => *n,
        NoContact::Guess => MAX_REST_FRAMES,
    };
    let mut first: Vec<Frame> = Vec::new();
    for item in frames {
        let (frame, place) = item?;
        if let Some(rest) = first.first() {
            check_px(&frame, [rest.width_px(), rest.height_px()], &place)?;
            if matches!(how, NoContact::Guess) && mean_difference(rest, &frame) > REST_COUNTS {
                break;
            }
        }
        first.push(frame);
        if first.len() == n_first {
            break;
        }
    }
    match how {
        NoContact::First(n) if first.len() < *n => {
            return Err(Error::invalid("no-contact frames", format!("{n} first frames"), format!("{}", first.len())));
        }
        NoContact::Guess => warnings.push(format!(
            "no no-contact frame given: taking the first {} frame(s), which look alike, for the sensor at rest",
            first.len()
        )),
        _ => {}
    }
    median(&first)
}

/// Mean absolute difference of two frames of one size, counts.
fn mean_difference(a: &Frame, b: &Frame) -> f64 {
    let sum: u64 = a.rgb().iter().zip(b.rgb()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.rgb().len() as f64
}

/// The median of each byte over frames of one size.
fn median(frames: &[Frame]) -> Result<Frame> {
    let Some(first) = frames.first() else {
        return Err(Error::invalid("no-contact frames", "at least 1 frame", "0"));
    };
    let mut values = vec![0; frames.len()];
    let middle = frames.len() / 2;
    let rgb = (0..first.rgb().len()).map(|at| {
        values.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.rgb()[at]);
        *values.select_nth_unstable(middle).1
    });
    Frame::new(first.width_px(), first.height_px(), rgb.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rest(how: NoContact, values: &[u8]) -> (Result<Frame>, Vec<String>) {
        let mut frames = values.iter().map(|value| Ok((Frame::new(2, 1, vec![*value; 6])?, "here".to_owned())));
        let mut warnings = Vec::new();
        (no_contact(&how, &mut frames, &mut warnings), warnings)
    }

    #[test]
    fn the_median_of_as_many_as_look_alike_or_are_asked_for() {
        let (frame, warnings) = rest(NoContact::Guess, &[10, 12, 11, 90, 10]);
        assert_eq!(frame.unwrap().rgb(), [11; 6]);
        assert!(warnings[0].contains("the first 3 frame(s)"), "{warnings:?}");
        assert_eq!(rest(NoContact::First(5), &[10, 12, 11, 90, 10]).0.unwrap().rgb(), [11; 6]);
        let long: Vec<u8> = (0..40).map(|i| i / 14).collect();
        assert!(rest(NoContact::Guess, &long).1[0].contains("first 15"));
    }

    #[test]
    fn too_few_frames_are_refused() {
        for (how, values) in [(NoContact::First(3), &[1, 2][..]), (NoContact::First(0), &[1]), (NoContact::Guess, &[])]
        {
            let message = rest(how, values).0.unwrap_err().to_string();
            assert!(message.starts_with("no-contact frames: expected"), "{message}");
        }
    }
}
