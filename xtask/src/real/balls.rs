//! Presses of a ball: the light fitted to one half of them, the other half named, and the other way round.

use std::fmt::Write;
use std::fs;

use serde_json::Value;

use super::Set;
use super::bench::{Bench, Sensor, copy};
use super::named::Named;
use super::twins::{Press, Twins, Views};
use crate::error::{Error, Result};
use crate::json::{entries, number};

const FOLDER: &str = "gelsight-ball-fots";
const TITLE: &str = "Balls (FOTS)";
const SOURCE: [&str; 2] =
    ["https://github.com/Rancho-zhao/FOTS", "MIT by its README; the repository has no licence file"];
const PART: &str = "ball:4.7";

/// Pixels per mm, and the size of the pictures once they lie as the model's do, pixels.
const PX_PER_MM: f64 = 19.58;
const FRAME_PX: [f64; 2] = [320.0, 240.0];

/// Presses of an episode, and by how many presses one is ahead of the next: without a common divisor with 21.
const N_TOUCHES: usize = 5;
const STRIDE: usize = 4;

/// What a folder of presses lists of each.
const INDEX: &str = "file,part,side,x_mm,y_mm,theta_deg,episode\n";

/// Presses that calibrate confidence.
const N_CALIBRATING: usize = 10;

/// One press, in the picture turned by a quarter.
struct Label {
    /// The picture in the folder of turned ones.
    file: String,
    centre_px: [f64; 2],
    radius_px: f64,
}

/// The presses that one light was fitted to.
struct Fitted {
    /// The calibration file.
    file: String,
    /// What the fit says of each press.
    presses: Vec<Pressed>,
}

/// One press as its fit has it.
struct Pressed {
    /// The picture.
    file: String,
    /// How deep the ball was pressed in, mm.
    depth_mm: f64,
    /// Where it touched, pixels.
    centre_px: [f64; 2],
}

/// Names every ball by one press and in episodes.
pub fn name(bench: &Bench<'_>) -> Result<Option<Set>> {
    if !bench.has(FOLDER, TITLE) {
        return Ok(None);
    }
    let labels = turned(bench)?;
    let halves: [Vec<&Label>; 2] = [0, 1].map(|half| labels.iter().skip(half).step_by(2).collect());
    // The light for the presses of a half is fitted to the other.
    let [other, one] = [calibrate(bench, 0, &halves[0])?, calibrate(bench, 1, &halves[1])?];
    let (mut by_one, mut by_several, mut by_calibrated) = (Vec::new(), Vec::new(), Vec::new());
    let mut twins = Twins::default();
    for (half, light, depths) in [(0, &one, &other), (1, &other, &one)] {
        let presses = &halves[half];
        let mut named = episodes(bench, half, presses, light)?;
        by_several.extend(named.split_off(presses.len().min(named.len())));
        let mut named = calibrated(bench, half, &halves[1 - half], light)?;
        by_calibrated.extend(named.split_off(presses.len().min(named.len())));
        by_one.extend(named);
        twins = twins.and(compare(bench, half, presses, [light, depths])?);
    }
    let about = format!(
        "{} presses of a ball of 4.70 mm on a home-made sensor with three lamps, their places labelled by hand. The light, \
         the gel's length and where exactly the ball touched are fitted to every second press and the others named, and \
         the other way round: no press is named under a light that was fitted to it. The pictures are turned by a quarter, \
         as the model sees wide ones. The bank is simulated at the depth of the fitted presses. An episode is {N_TOUCHES} \
         presses with the motions between their labels: the ball did not move, the sensor did. After one touch the filter \
         is hardly ever confident. Calibrated: confidence, too, by {N_CALIBRATING} presses of the half that the light was \
         fitted to, as a user with 20 presses of a ball would. A twin is where and as deep as the fit of its own half has the press.",
        labels.len()
    );
    let named = vec![("one press", by_one), ("five presses", by_several), ("five presses, calibrated", by_calibrated)];
    Ok(Some(Set { title: TITLE, source: SOURCE, about, named, twins: Some(twins) }))
}

/// Turns the pictures counter-clockwise by a quarter, and their labels with them.
fn turned(bench: &Bench<'_>) -> Result<Vec<Label>> {
    let [x, y] = view_mm();
    bench.run(
        "tactile-data",
        &format!(
            "import REAL/{FOLDER}/images --turn 90 --no-contact REAL/{FOLDER}/gelsight_bg.png --field-of-view-mm {x} {y} \
             --out balls-raw"
        ),
    )?;
    bench.run("tactile-data", "export balls-raw --to folder --out balls")?;
    let path = bench.real.join(FOLDER).join("labels_derived.csv");
    let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
    // Exported in the order of their names, as the labels are.
    text.lines().skip(1).enumerate().map(|(n, line)| label(n, line)).collect()
}

/// A line of the labels: file, centre x, centre y and radius in pixels.
fn label(n: usize, line: &str) -> Result<Label> {
    let numbers: Vec<f64> = line.split(',').skip(1).filter_map(|cell| cell.trim().parse().ok()).collect();
    let [x, y, radius_px] = numbers[..] else {
        return Err(Error::invalid(format!("{FOLDER}: label {}", n + 1), "file, x, y, radius", line));
    };
    let centre_px = [y, FRAME_PX[1] - 1.0 - x];
    Ok(Label { file: format!("{n:06}.png"), centre_px, radius_px })
}

fn view_mm() -> [f64; 2] {
    FRAME_PX.map(|px| px / PX_PER_MM)
}

/// Fits the light to some presses.
fn calibrate(bench: &Bench<'_>, half: usize, presses: &[&Label]) -> Result<Fitted> {
    let folder = bench.folder(&format!("light-{half}"))?;
    let mut labels = "file,center_x,center_y,radius\n".to_owned();
    for Label { file, centre_px: [x, y], radius_px } in presses {
        copy(&bench.out.join("balls").join(file), &folder.join(file))?;
        line(&mut labels, format_args!("{file},{x},{y},{radius_px}"))?;
    }
    bench.write(&format!("light-{half}.csv"), &labels)?;
    let file = format!("light-{half}.toml");
    let fitted = bench.json(
        "tactile-data",
        &format!(
            "calibrate light-{half} --ball-mm 4.70 --px-per-mm {PX_PER_MM} --labels light-{half}.csv \
             --no-contact balls/no_contact.png --out {file}"
        ),
    )?;
    let pressed = |press: &Value| {
        Ok(Pressed {
            file: press["file"].as_str().unwrap_or_default().to_owned(),
            depth_mm: number(press, "/depth_mm")?,
            centre_px: [number(press, "/centre_px/0")?, number(press, "/centre_px/1")?],
        })
    };
    let presses = entries(&fitted, "/presses")?.iter().map(pressed).collect::<Result<_>>()?;
    Ok(Fitted { file, presses })
}

/// The bank under one light, and what it calls the presses of the other half: each alone first, then episodes.
fn episodes(bench: &Bench<'_>, half: usize, presses: &[&Label], light: &Fitted) -> Result<Vec<Named>> {
    let mut depths: Vec<f64> = light.presses.iter().map(|press| press.depth_mm).collect();
    depths.sort_by(f64::total_cmp);
    let depth_mm = depths.get(depths.len() / 2).copied();
    let bank = format!("balls-bank-{half}");
    bench.bank(&bank, &Sensor { view_mm: view_mm(), depth_mm, calibration: Some(&light.file) })?;
    let folder = bench.folder(&format!("balls-{half}"))?;
    let mut index = INDEX.to_owned();
    let n = presses.len();
    let alone = (0..n).map(|i| (format!("one-{i:02}"), vec![i]));
    let several = (0..n).map(|i| (format!("several-{i:02}"), (0..N_TOUCHES).map(|k| (i + STRIDE * k) % n).collect()));
    for (episode, touches) in alone.chain(several) {
        for (k, press) in touches.into_iter().enumerate() {
            let file = format!("{episode}-{k}.png");
            copy(&bench.out.join("balls").join(&presses[press].file), &folder.join(&file))?;
            let [x, y] = ball_from_sensor_mm(presses[press].centre_px);
            line(&mut index, format_args!("{file},{PART},peg,{x:.4},{y:.4},0,{episode}"))?;
        }
    }
    bench.write(&format!("balls-{half}/index.csv"), &index)?;
    import(bench, &format!("balls-{half}"), light, &format!("balls-set-{half}"))?;
    bench.replay(&bank, &format!("balls-set-{half}"))
}

/// What the presses of a half are called once the confidence was calibrated by some of the others.
fn calibrated(bench: &Bench<'_>, half: usize, others: &[&Label], light: &Fitted) -> Result<Vec<Named>> {
    let folder = bench.folder(&format!("own-{half}"))?;
    let mut index = INDEX.to_owned();
    for Label { file, centre_px, .. } in others {
        copy(&bench.out.join("balls").join(file), &folder.join(file))?;
        let [x, y] = ball_from_sensor_mm(*centre_px);
        line(&mut index, format_args!("{file},{PART},peg,{x:.4},{y:.4},0,{file}"))?;
    }
    bench.write(&format!("own-{half}/index.csv"), &index)?;
    import(bench, &format!("own-{half}"), light, &format!("own-set-{half}"))?;
    let (bank, own) = (format!("balls-bank-{half}"), format!("own-{half}.safetensors"));
    bench.run(
        "tactile-infer",
        &format!(
            "calibrate --model MODEL --bank {bank}.bank --holes own-set-{half} --side peg --touches {N_CALIBRATING} \
             --out {own}"
        ),
    )?;
    bench.replay_by(&own, &bank, &format!("balls-set-{half}"))
}

/// Imports a folder of presses under a light.
fn import(bench: &Bench<'_>, folder: &str, light: &Fitted, out: &str) -> Result<()> {
    let [x, y] = view_mm();
    bench.run(
        "tactile-data",
        &format!(
            "import {folder} --no-contact balls/no_contact.png --field-of-view-mm {x} {y} --calibration {} --out {out}",
            light.file
        ),
    )
}

/// The sensor's middle, seen from the ball's, mm.
fn ball_from_sensor_mm(centre_px: [f64; 2]) -> [f64; 2] {
    [0, 1].map(|axis| (0.5 * (FRAME_PX[axis] - 1.0) - centre_px[axis]) / PX_PER_MM)
}

/// The presses of a half next to their twins, under the light of the other; places and depths are those that their own
/// half's fit gives.
fn compare(bench: &Bench<'_>, half: usize, presses: &[&Label], [light, own]: [&Fitted; 2]) -> Result<Twins> {
    let press = |label: &&Label| {
        let pressed = own.presses.iter().find(|press| press.file == label.file);
        let Pressed { depth_mm, centre_px, .. } =
            pressed.ok_or_else(|| Error::invalid(&label.file, "a press of its half", "none"))?;
        let [x, y] = ball_from_sensor_mm(*centre_px);
        Ok(Press {
            picture: format!("balls/{}", label.file),
            render: format!("{PART} --pose={x:.4},{y:.4},0 --depth-mm {depth_mm:.4} --calibration {}", light.file),
        })
    };
    let presses = presses.iter().map(press).collect::<Result<Vec<_>>>()?;
    let name = format!("ball-twin-{half}");
    let views = Views { name: &name, rest: "balls/no_contact.png", view_mm: view_mm(), calibration: Some(&light.file) };
    Twins::of(bench, &views, &presses)
}

/// Adds a line.
fn line(text: &mut String, line: std::fmt::Arguments<'_>) -> Result<()> {
    writeln!(text, "{line}").map_err(|error| Error::invalid("index", "text", error.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_turns_with_its_picture() {
        // 240 x 320: ten pixels from the top right corner lie, turned counter-clockwise, ten from the top left.
        let label = label(4, "0005.png,229,10,40").unwrap();
        assert_eq!((label.file.as_str(), label.centre_px, label.radius_px), ("000004.png", [10.0, 10.0], 40.0));
        // Left of and above the middle is the ball, so that the sensor is to the right of and below it.
        let [x, y] = ball_from_sensor_mm(label.centre_px);
        assert!((x - 149.5 / 19.58).abs() < 1e-9 && (y - 109.5 / 19.58).abs() < 1e-9);
        assert!(super::label(0, "0001.png,a,2,3").is_err());
    }

    #[test]
    fn an_episode_holds_no_press_twice() {
        for i in 0..21 {
            let mut presses: Vec<usize> = (0..N_TOUCHES).map(|k| (i + STRIDE * k) % 21).collect();
            presses.sort_unstable();
            presses.dedup();
            assert_eq!(presses.len(), N_TOUCHES);
        }
    }
}
