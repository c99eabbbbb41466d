//! Presses of a ball: the light fitted to all but one predicts that one.

use std::fs;

use serde_json::Value;

use super::{Lab, Picture, Row, Set, Verdict, entries, number};
use crate::error::{Error, Result};

const FOLDER: &str = "gelsight-ball-fots";
const TITLE: &str = "Ball presses (FOTS)";
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
    let mean = |name: &str| number(&fitted, &format!("/calibration/leave_one_out/{name}"));
    let (ratio, correlation) = (mean("ratio")?, mean("correlation")?);
    let presses = entries(&fitted, "/presses")?;

    // The same fit without the presses shown.
    let (others, labels) = (lab.out.join("ball-others"), lab.out.join("ball-others.csv"));
    super::remove(&others)?;
    fs::create_dir(&others).map_err(Error::io(&others))?;
    for press in presses.iter().filter(|press| !SHOWN.iter().any(|name| press["file"] == *name)) {
        let name = press["file"].as_str().unwrap_or_default();
        let (from, to) = (folder.join("images").join(name), others.join(name));
        fs::copy(&from, &to).map_err(Error::io(&from))?;
    }
    let all = folder.join("labels_derived.csv");
    let text = fs::read_to_string(&all).map_err(Error::io(&all))?;
    let kept: String = (text.lines())
        .filter(|line| !SHOWN.iter().any(|name| line.starts_with(name)))
        .flat_map(|line| [line, "\n"])
        .collect();
    fs::write(&labels, kept).map_err(Error::io(&labels))?;
    let refitted =
        lab.json(&format!("calibrate ball-others {given} --labels ball-others.csv --out ball-others.toml"))?;

    let mut figures = Vec::new();
    let mut pictures = Vec::new();
    for name in SHOWN {
        let press = presses.iter().find(|press| press["file"] == name);
        let press = press.ok_or_else(|| Error::invalid(TITLE, name, "no such press"))?;
        let (compared, picture) = rendered(lab, &refitted, press, name)?;
        figures.push([number(&compared, "/figures/l1_counts")?, number(&compared, "/figures/background_l1_counts")?]);
        pictures.push((compared, picture));
    }
    let [l1, bare] = [0, 1].map(|i| figures.iter().map(|figures| figures[i]).sum::<f64>());
    let correlations: Vec<f64> =
        pictures.iter().map(|(compared, _)| number(compared, "/figures/correlation")).collect::<Result<_>>()?;
    let mean_correlation = correlations.iter().sum::<f64>() / correlations.len() as f64;
    let of = |ratio: f64, correlation: f64| Verdict::of(ratio <= 0.25 && correlation >= 0.95);
    let rows = vec![
        Row {
            what: LEFT_OUT,
            target: TARGET,
            measured: format!(
                "L1 {:.2} counts, {ratio:.3} of {:.2}; r {correlation:.3}; PSNR {:.1} dB; {} presses",
                mean("l1_counts")?,
                mean("background_l1_counts")?,
                mean("psnr_db")?,
                presses.len()
            ),
            verdict: of(ratio, correlation),
        },
        Row {
            what: RENDERED,
            target: TARGET,
            measured: format!(
                "L1 {:.2} counts, {:.3} of {:.2}; r {mean_correlation:.3}",
                l1 / SHOWN.len() as f64,
                l1 / bare,
                bare / SHOWN.len() as f64
            ),
            verdict: of(l1 / bare, mean_correlation),
        },
    ];
    Ok(Set {
        title: TITLE,
        about: format!(
            "A home-made sensor with three lamps, {} presses of a ball of 4.70 mm. The light, the gel's decay length \
             ({} mm) and the contact's share of the labelled circles ({}) are fitted to all presses but one, which is \
             then predicted: on the circle and half its radius round it, exposure compensated on pixels more than \
             4 mm away. The pictures are of presses that the light was not fitted to, rendered by tactile-data \
             render and judged by tactile-data compare within 1 mm of the contact; the gel's length and the depths \
             are of all presses.",
            presses.len(),
            number(&fitted, "/calibration/gel_length_mm")?,
            number(&fitted, "/calibration/contact_share")?
        ),
        rows,
        pictures: pictures.into_iter().map(|(_, picture)| picture).collect(),
    })
}

/// Renders one press over the real sensor's background and compares the two.
fn rendered(lab: &Lab, fitted: &Value, press: &Value, name: &str) -> Result<(Value, Picture)> {
    let depth_mm = number(press, "/depth_mm")?;
    let mut pose_mm = [0.0; 2];
    for (axis, mm) in pose_mm.iter_mut().enumerate() {
        let n_pixels = number(fitted, &format!("/calibration/frame_px/{axis}"))?;
        let mm_per_px = number(fitted, &format!("/calibration/field_of_view_mm/{axis}"))? / n_pixels;
        // The sensor's middle, seen from the ball's.
        *mm = (0.5 * (n_pixels - 1.0) - number(press, &format!("/centre_px/{axis}"))?) * mm_per_px;
    }
    let [x, y] = pose_mm;
    let view = |axis: usize| number(fitted, &format!("/calibration/field_of_view_mm/{axis}"));
    let stem = name.trim_end_matches(".png");
    let shape = format!("ball:4.7 --as-peg --pose={x:.4},{y:.4},0 --depth-mm {depth_mm:.4}");
    lab.run(&format!(
        "render {shape} --calibration ball-others.toml --no-contact REAL/{FOLDER}/gelsight_bg.png --out ball-{stem}.png"
    ))?;
    lab.run(&format!(
        "render {shape} --calibration ball-others.toml --fidelity geometry --out ball-{stem}-contact.png"
    ))?;
    let compared = lab.json(&format!(
        "compare REAL/{FOLDER}/images/{name} ball-{stem}.png --real-background REAL/{FOLDER}/gelsight_bg.png \
         --simulated-background REAL/{FOLDER}/gelsight_bg.png --contact ball-{stem}-contact.png \
         --field-of-view-mm {} {} --out ball-{stem}-both.png",
        view(0)?,
        view(1)?
    ))?;
    let figure = |field: &str| number(&compared, &format!("/figures/{field}"));
    let caption = format!(
        "Press {stem}, {depth_mm:.2} mm deep: L1 {:.1} of {:.1} counts, r {:.3}.",
        figure("l1_counts")?,
        figure("background_l1_counts")?,
        figure("correlation")?
    );
    Ok((compared, Picture { path: lab.out.join(format!("ball-{stem}-both.png")), caption }))
}
