//! A press recorded frame by frame: when contact begins and ends.

use super::{Lab, Row, Set, Source};
use crate::error::{Error, Result};
use crate::json::{entries, numbers};
use crate::workspace::remove;

const FOLDER: &str = "gsmini-digits-tactilemnist";
const TITLE: &str = "Press on a printed digit (Tactile MNIST)";
const SOURCE: Source =
    Source { repository: "https://github.com/TimSchneider42/tactile-mnist", path: Some("docs/img/"), licence: "MIT" };
const WHAT: &str = "first and last frame of contact";
const TARGET: &str = "within 2 frames of where the difference rises and has fallen";
const FRAMES: usize = 2;

/// Frames at the start that show the sensor at rest.
const N_REST: usize = 15;

/// The difference has risen where it is more than this share of the way from rest to its peak: where a rise time
/// begins by custom.
const RISEN: f64 = 0.1;

/// Compares the frames that count as contact with those whose difference has risen.
pub fn check(lab: &Lab) -> Result<Set> {
    let gif = format!("{FOLDER}/tactile-mnist-touch-real-seq-t256-320x240.gif");
    if lab.real(&gif).is_none() {
        return Ok(Set::missing(TITLE, &[(WHAT, TARGET)]));
    }
    remove(&lab.out.join("digit"))?;
    lab.run(&format!("import REAL/{gif} --no-contact {N_REST} --out digit"))?;
    let inspected = lab.json("inspect digit --sheet digit.png --frames")?;
    let contact = numbers(&inspected, "/contact_frames/0")?;
    let n_runs = entries(&inspected, "/contact_frames")?.len();
    let differences = numbers(&inspected, "/difference_rms")?;
    let (first, last) = risen(&differences)?;
    let [begins, ends] = [contact[0] as usize, contact[1] as usize];
    let is_near = n_runs == 1 && begins.abs_diff(first) <= FRAMES && ends.abs_diff(last) <= FRAMES;
    let measured = format!("contact in {begins} to {ends}, the difference in {first} to {last}");
    Ok(Set {
        title: TITLE,
        source: Some(SOURCE),
        about: format!(
            "{} frames of one press on a raised digit with a Mini. Contact is found in each frame alone, by the \
             share of its pixels that show an edge; the difference is the root mean square over the whole frame, and \
             has risen where it is more than {:.0} % of the way from that of the first {N_REST} frames to its peak. \
             The digit's shape is not public, so nothing is simulated here.",
            differences.len(),
            100.0 * RISEN
        ),
        rows: vec![Row::new(WHAT, TARGET, measured, is_near)],
        pictures: vec![lab.picture("digit.png", "48 of the frames in order, each above its difference from rest.")],
    })
}

/// The first and last frame whose difference from rest has risen.
fn risen(differences: &[f64]) -> Result<(usize, usize)> {
    let rest = &differences[..N_REST.min(differences.len())];
    let at_rest = rest.iter().sum::<f64>() / rest.len() as f64;
    let peak = differences.iter().copied().fold(at_rest, f64::max);
    let has_risen = |value: &f64| *value > at_rest + RISEN * (peak - at_rest);
    let (first, last) = (differences.iter().position(has_risen), differences.iter().rposition(has_risen));
    first.zip(last).ok_or_else(|| Error::invalid(TITLE, "a difference that rises", "none"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rise_is_separated_from_noise() {
        let mut differences: Vec<f64> = (0..40).map(|i| 1.0 + 0.02 * f64::from(i % 2)).collect();
        differences[20..=30].fill(2.0);
        (differences[19], differences[31]) = (1.05, 1.2);
        assert_eq!(risen(&differences).unwrap(), (20, 31));
        assert!(risen(&[1.0; 40]).is_err());
    }
}
