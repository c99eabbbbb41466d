//! One press of a cuboid's flat face.

use super::Set;
use super::bench::{Bench, ONE_BALL, Sensor};
use super::twins::{Press, Twins, Views};
use crate::error::Result;
use crate::json::numbers;

const FOLDER: &str = "gsmini-markergel-feats";
const TITLE: &str = "Cuboid of 10 mm (FEATS, marker gel)";
const SOURCE: [&str; 2] = ["https://github.com/feats-ai/feats", "MIT"];
const PART: &str = "cuboid:10x10";

/// What a frame shows, mm: the set's homography has 14 pixels a mm.
const PX_PER_MM: f64 = 14.0;
const VIEW_MM: [f64; 2] = [320.0 / PX_PER_MM, 240.0 / PX_PER_MM];

/// The square's corners by the set's homography, pixels.
const OUTLINE: &str = "90,190,90,50,230,50,230,190";

/// Names the press, and compares it with its twin where its ring was found.
pub fn name(bench: &Bench<'_>) -> Result<Option<Set>> {
    if !bench.has(FOLDER, TITLE) {
        return Ok(None);
    }
    let press = format!("REAL/{FOLDER}/cuboid_10-2-284.png");
    let rest = format!("REAL/{FOLDER}/nocontact_train_sensor_derived.png");
    let [width, height] = VIEW_MM;
    bench.bank("cuboid-bank", &Sensor { balls: ONE_BALL, view_mm: VIEW_MM, depth_mm: None, calibration: None })?;
    bench
        .write("cuboid.csv", &format!("file,part,side,x_mm,y_mm,theta_deg\ncuboid_10-2-284.png,{PART},peg,0,0,0\n"))?;
    bench.run(
        "tactile-data",
        &format!(
            "import REAL/{FOLDER} --index cuboid.csv --no-contact {rest} --field-of-view-mm {width} {height} --out cuboid"
        ),
    )?;
    let named = bench.replay("cuboid-bank", "cuboid")?;
    let ring = bench.json("tactile-data", &format!("ring {press} --no-contact {rest} --outline {OUTLINE}"))?;
    let moved = numbers(&ring, "/moved_px")?;
    // The outline's middle, at 160, 120, as the ring was found: moved from the frame's middle.
    let [x, y] = [0, 1].map(|axis| -(moved.get(axis).copied().unwrap_or(0.0) + 0.5) / PX_PER_MM);
    let render =
        format!("{PART} --pose={x:.4},{y:.4},0 --depth-mm 0.6 --frame-px 320x240 --field-of-view-mm {width} {height}");
    let views = Views { name: "cuboid-twin", rest: &rest, view_mm: VIEW_MM, calibration: None };
    let twins = Twins::of(bench, &views, &[Press { picture: press, render }])?;
    let about = "One press of a printed cuboid's flat face on a Mini whose gel carries marks, named among simulated views \
                 under the default light of a Mini. The frame at rest has its marks elsewhere, so that they show twice. \
                 The twin is where the ring of the press was found, 0.6 mm deep: how deep it was is not known."
        .to_owned();
    Ok(Some(Set { title: TITLE, source: SOURCE, about, named: vec![("one press", named)], twins: Some(twins) }))
}
