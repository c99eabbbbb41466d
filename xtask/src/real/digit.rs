//! A printed digit, which no bank holds.

use super::Set;
use super::bench::{Bench, ONE_BALL, Sensor, copy};
use super::named::STRANGER;
use crate::error::Result;
use crate::json::numbers;

const FOLDER: &str = "gsmini-digits-tactilemnist";
const TITLE: &str = "A digit that is not in the bank (Tactile MNIST)";
const SOURCE: [&str; 2] = ["https://github.com/TimSchneider42/tactile-mnist", "MIT"];

/// What a Mini's frame shows where nothing else is known, mm.
const VIEW_MM: [f64; 2] = [18.6, 14.3];

/// Frames at the start that show the sensor at rest, and frames of the press that are taken for touches.
const N_REST: usize = 15;
const N_TOUCHES: usize = 5;

/// Names one frame of the press, and five.
pub fn name(bench: &Bench<'_>) -> Result<Option<Set>> {
    let gif = format!("{FOLDER}/tactile-mnist-touch-real-seq-t256-320x240.gif");
    if !bench.has(&gif, TITLE) {
        return Ok(None);
    }
    bench.bank("digit-bank", &Sensor { balls: ONE_BALL, view_mm: VIEW_MM, depth_mm: None, calibration: None })?;
    bench.run("tactile-data", &format!("import REAL/{gif} --no-contact {N_REST} --out digit-film"))?;
    let by_one = bench.replay("digit-bank", "digit-film")?;
    bench.run("tactile-data", "export digit-film --to folder --out digit-frames")?;
    let inspected = bench.json("tactile-data", "inspect digit-film --frames")?;
    let contact = numbers(&inspected, "/contact_frames/0")?;
    let folder = bench.folder("digit")?;
    let mut index = "file,part,side,x_mm,y_mm,theta_deg,episode\n".to_owned();
    for frame in spread(contact[0] as usize, contact[1] as usize) {
        let file = format!("{frame:06}.png");
        copy(&bench.out.join("digit-frames").join(&file), &folder.join(&file))?;
        index += &format!("{file},{STRANGER},peg,0,0,0,digit\n");
    }
    bench.write("digit/index.csv", &index)?;
    bench.run("tactile-data", "import digit --no-contact digit-frames/no_contact.png --out digit-set")?;
    let by_five = bench.replay("digit-bank", "digit-set")?;
    let about = "One press on a raised digit with a Mini, filmed: the frame with most edges alone, and five frames of the \
                 press with no motion between them. The digit is none of the bank's parts, so that nothing else than none \
                 of these is right. What the frames show is not known; the bank is simulated at 18.6 x 14.3 mm under the \
                 default light of a Mini."
        .to_owned();
    let named = vec![("one frame", by_one), ("five frames", by_five)];
    Ok(Some(Set { title: TITLE, source: SOURCE, about, named, twins: None }))
}

/// Frames spread over the middle half of a press.
fn spread(first: usize, last: usize) -> Vec<usize> {
    let quarter = last.saturating_sub(first) / 4;
    let (from, to) = (first + quarter, last.saturating_sub(quarter));
    let mut frames: Vec<usize> = (0..N_TOUCHES).map(|k| from + (to - from) * k / (N_TOUCHES - 1)).collect();
    frames.dedup();
    frames
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_of_the_middle_half() {
        assert_eq!(spread(20, 40), [25, 27, 30, 32, 35]);
        assert_eq!(spread(7, 7), [7]);
    }
}
