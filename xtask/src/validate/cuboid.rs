//! The flat face of a cuboid: whether its ring is where the outline is predicted.

use std::fs;

use serde_json::Value;

use super::{Lab, Row, Set, Source};
use crate::error::{Error, Result};
use crate::json::{number, numbers};

const FOLDER: &str = "gsmini-markergel-feats";
const TITLE: &str = "Cuboid of 10 mm (FEATS, marker gel)";
const SOURCE: Source = Source { repository: "https://github.com/feats-ai/feats", path: None, licence: "MIT" };
const SIZE: &str = "cuboid outline, moved as a whole to its ring";
const PLACE: &str = "cuboid outline, where the homography puts it";
const TARGET: &str = "within 3 px";
const PX: f64 = 3.0;

/// The square's corners by the set's homography, 14 pixels a mm.
const OUTLINE: &str = "90,190,90,50,230,50,230,190";

/// A square of 10 mm.
const SQUARE: &str = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"10mm\" height=\"10mm\" \
                      viewBox=\"0 0 10 10\"><path d=\"M0 0H10V10H0Z\"/></svg>\n";

/// Finds the ring, really and simulated.
pub fn check(lab: &Lab) -> Result<Set> {
    if lab.real(FOLDER).is_none() {
        return Ok(Set::missing(TITLE, &[(SIZE, TARGET), (PLACE, TARGET)]));
    }
    let press = format!("REAL/{FOLDER}/cuboid_10-2-284.png");
    let rest = format!("REAL/{FOLDER}/nocontact_train_sensor_derived.png");
    let real = lab.json(&format!("ring {press} --no-contact {rest} --outline {OUTLINE}"))?;
    let (moved, sides) = (numbers(&real, "/moved_px")?, numbers(&real, "/sides_px")?);
    let size = number(&real, "/moved_offset_px")?;
    let ring = simulated(lab, &press, &rest, &moved)?;
    let worst = sides.iter().map(|px| px.abs()).fold(0.0, f64::max);
    let simulated_px = number(&ring, "/moved_offset_px")?;
    let measured_size = format!("the ring is {size:+} px outside it (the simulated square's {simulated_px:+} px)");
    let [x, y] = [moved[0], moved[1]];
    let away_mm = x.hypot(y) / 14.0;
    let measured_place = format!("{worst} px at worst: the whole ring is {x:+}, {y:+} px away, {away_mm:.2} mm");
    let rows = vec![
        Row::new(SIZE, TARGET, measured_size, size.abs() <= PX),
        Row::new(PLACE, TARGET, measured_place, worst <= PX),
    ];
    Ok(Set {
        title: TITLE,
        source: Some(SOURCE),
        about: "One press of a printed cuboid's flat face on a Mini whose gel carries marks. The homography that \
                comes with the set puts a square of 10 mm on the frame; the ring is where what the press changed \
                differs most from what is 8 px to both sides, between the marks. The frame at rest \
                has its marks elsewhere, so that they show twice in the difference. Where this face was pressed, \
                the set does not say: hence the outline in place, and moved."
            .into(),
        rows,
        pictures: vec![lab.picture(
            "cuboid-both.png",
            "Simulated where the ring was found, 0.6 mm deep: how deep the real face was pressed is not \
                      known. The simulated gel has its marks where the frame at rest has them.",
        )],
    })
}

/// Renders the square with its middle where the real ring was found; measures the ring and draws both.
fn simulated(lab: &Lab, press: &str, rest: &str, moved: &[f64]) -> Result<Value> {
    let svg = lab.out.join("square.svg");
    fs::write(&svg, SQUARE).map_err(Error::io(&svg))?;
    // The outline's middle, at 160, 120, as the real ring was found: moved from the frame's middle.
    let [x, y] = [0, 1].map(|axis| -(moved[axis] + 0.5) / 14.0);
    let given = format!("square.svg --frame-px 320x240 --mm-per-px 0.0714286,0.0714286 --pose={x:.4},{y:.4},0");
    lab.run(&format!("render {given} --no-contact {rest} --out cuboid.png"))?;
    lab.run(&format!("render {given} --fidelity geometry --out cuboid-contact.png"))?;
    lab.run(&format!(
        "compare {press} cuboid.png --no-contact {rest} {rest} \
         --contact cuboid-contact.png --field-of-view-mm 22.857 17.143 --out cuboid-both.png"
    ))?;
    lab.json(&format!("ring cuboid.png --no-contact {rest} --outline {OUTLINE}"))
}
