//! Presses of a ball: the light fitted to all but one predicts that one.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{Lab, Picture, Row, Set, Source};
use crate::error::{Error, Result};
use crate::json::{entries, number};
use crate::workspace::remove;

const FOLDER: &str = "gelsight-ball-fots";
const TITLE: &str = "Ball presses (FOTS)";
const SOURCE: Source = Source {
    repository: "https://github.com/Rancho-zhao/FOTS",
    path: Some("mlp_calib/"),
    licence: "MIT by its README; the repository has no licence file",
};
const LEFT_OUT: &str = "contact, each press left out";
const RENDERED: &str = "three presses rendered, left out of the fit";
const TARGET: &str = "L1 at most 1/4 of the bare background's, r at least 0.95";

/// The ball's diameter, mm, and the camera's scale, as the set gives them.
const BALL: &str = "--ball-mm 4.70 --px-per-mm 19.58";

/// Presses that are shown: left out of the fit, then rendered.
const SHOWN: [&str; 3] = ["0001.png", "0021.png", "0042.png"];

/// Fits the light and judges it; then fits it without three presses and renders these.
pub fn check(lab: &Lab) -> Result<Set> {
    let Some(folder) = lab.real(FOLDER) else {
        return Ok(Set::missing(TITLE, &[(LEFT_OUT, TARGET), (RENDERED, TARGET)]));
    };
    let given = format!("{BALL} --no-contact REAL/{FOLDER}/gelsight_bg.png");
    let fitted = lab.json(&format!(
        "calibrate REAL/{FOLDER}/images {given} --labels REAL/{FOLDER}/labels_derived.csv --out ball.toml"
    ))?;
    let presses = entries(&fitted, "/presses")?;
    leave_out_shown(lab, &folder, presses)?;
    let refitted =
        lab.json(&format!("calibrate ball-others {given} --labels ball-others.csv --out ball-others.toml"))?;
    let render = |name: &&str| {
        let press = presses.iter().find(|press| press["file"] == *name);
        rendered(lab, &refitted, press.ok_or_else(|| Error::invalid(TITLE, *name, "no such press"))?, name)
    };
    let shown = SHOWN.iter().map(render).collect::<Result<Vec<_>>>()?;
    let n_presses = presses.len();
    let calibrated = |name: &str| number(&fitted, &format!("/calibration/{name}"));
    Ok(Set {
        title: TITLE,
        source: Some(SOURCE),
        about: format!(
            "A home-made sensor with three lamps, {n_presses} presses of a ball of 4.70 mm. The light, the gel's decay \
             length ({} mm) and the contact's share of the labelled circles ({}) are fitted to all presses but one, \
             which is then predicted: on the circle and half its radius round it, exposure compensated on pixels more \
             than 4 mm away. The pictures are of presses that the light was not fitted to, rendered by tactile-data \
             render and judged by tactile-data compare within 1 mm of the contact; the gel's length and the depths \
             are of all presses.",
            calibrated("gel_length_mm")?,
            calibrated("contact_share")?
        ),
        rows: vec![left_out_row(&fitted, n_presses)?, rendered_row(&shown)],
        pictures: shown.into_iter().map(|shown| shown.picture).collect(),
    })
}

/// Puts all presses but those shown, and their labels, into the output folder.
fn leave_out_shown(lab: &Lab, folder: &Path, presses: &[Value]) -> Result<()> {
    let (others, labels) = (lab.out.join("ball-others"), lab.out.join("ball-others.csv"));
    remove(&others)?;
    fs::create_dir(&others).map_err(Error::io(&others))?;
    for name in presses.iter().filter_map(|press| press["file"].as_str()).filter(|name| !SHOWN.contains(name)) {
        let (from, to) = (folder.join("images").join(name), others.join(name));
        fs::copy(&from, &to).map_err(Error::io(&from))?;
    }
    let all = folder.join("labels_derived.csv");
    let text = fs::read_to_string(&all).map_err(Error::io(&all))?;
    let is_kept = |line: &&str| !SHOWN.iter().any(|name| line.starts_with(name));
    let kept: String = text.lines().filter(is_kept).flat_map(|line| [line, "\n"]).collect();
    fs::write(&labels, kept).map_err(Error::io(&labels))
}

fn left_out_row(fitted: &Value, n_presses: usize) -> Result<Row> {
    let mean = |name: &str| number(fitted, &format!("/calibration/leave_one_out/{name}"));
    let (ratio, correlation) = (mean("ratio")?, mean("correlation")?);
    let measured = format!(
        "L1 {:.2} counts, {ratio:.3} of {:.2}; r {correlation:.3}; PSNR {:.1} dB; {n_presses} presses",
        mean("l1_counts")?,
        mean("background_l1_counts")?,
        mean("psnr_db")?,
    );
    Ok(Row::new(LEFT_OUT, TARGET, measured, is_met(ratio, correlation)))
}

fn rendered_row(shown: &[Shown]) -> Row {
    let mean = |figure: fn(&Shown) -> f64| shown.iter().map(figure).sum::<f64>() / shown.len() as f64;
    let (l1, bare, correlation) = (mean(|s| s.l1_counts), mean(|s| s.background_l1_counts), mean(|s| s.correlation));
    let measured = format!("L1 {l1:.2} counts, {:.3} of {bare:.2}; r {correlation:.3}", l1 / bare);
    Row::new(RENDERED, TARGET, measured, is_met(l1 / bare, correlation))
}

fn is_met(ratio: f64, correlation: f64) -> bool {
    ratio <= 0.25 && correlation >= 0.95
}

/// A press rendered and compared with its real picture.
struct Shown {
    l1_counts: f64,
    background_l1_counts: f64,
    correlation: f64,
    picture: Picture,
}

/// Renders one press over the real sensor's background and compares the two.
fn rendered(lab: &Lab, fitted: &Value, press: &Value, name: &str) -> Result<Shown> {
    let depth_mm = number(press, "/depth_mm")?;
    let view = |axis: usize| number(fitted, &format!("/calibration/field_of_view_mm/{axis}"));
    // The sensor's middle, seen from the ball's, mm.
    let middle = |axis: usize| {
        let n_pixels = number(fitted, &format!("/calibration/frame_px/{axis}"))?;
        let offset_px = 0.5 * (n_pixels - 1.0) - number(press, &format!("/centre_px/{axis}"))?;
        Ok(offset_px * (view(axis)? / n_pixels))
    };
    let (x, y) = (middle(0)?, middle(1)?);
    let stem = name.trim_end_matches(".png");
    let rest = format!("REAL/{FOLDER}/gelsight_bg.png");
    let render =
        format!("render ball:4.7 --pose={x:.4},{y:.4},0 --depth-mm {depth_mm:.4} --calibration ball-others.toml");
    lab.run(&format!("{render} --no-contact {rest} --out ball-{stem}.png"))?;
    lab.run(&format!("{render} --fidelity geometry --out ball-{stem}-contact.png"))?;
    let compared = lab.json(&format!(
        "compare REAL/{FOLDER}/images/{name} ball-{stem}.png --no-contact {rest} {rest} \
         --contact ball-{stem}-contact.png --field-of-view-mm {} {} --out ball-{stem}-both.png",
        view(0)?,
        view(1)?
    ))?;
    let figure = |field: &str| number(&compared, &format!("/figures/{field}"));
    let (l1_counts, background_l1_counts) = (figure("l1_counts")?, figure("background_l1_counts")?);
    let correlation = figure("correlation")?;
    let caption = format!(
        "Press {stem}, {depth_mm:.2} mm deep: L1 {l1_counts:.1} of {background_l1_counts:.1} counts, r {correlation:.3}."
    );
    let picture = lab.picture(&format!("ball-{stem}-both.png"), caption);
    Ok(Shown { l1_counts, background_l1_counts, correlation, picture })
}
