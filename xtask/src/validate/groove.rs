//! The groove plate: which way walls are shaded, really and simulated.

use std::fs;
use std::path::Path;

use serde_json::Value;

use super::{Lab, Picture, Row, Set, Source};
use crate::error::{Error, Result};
use crate::json::{entries, number, numbers};

const FOLDER: &str = "gelsight-groove-gsmatlab";
const TITLE: &str = "Groove plate (bench scanner, six lights)";
const SOURCE: Source =
    Source { repository: "https://github.com/gelsightinc/gsmatlab", path: Some("demo/groove/"), licence: "MIT" };
const MAP: &str = "REAL/gelsight-groove-gsmatlab/heightmap_derived_514x616_f32_mm.npy";
const REAL_SIGNS: &str = "real walls, light taken from one and tested on the others";
const RIDGE: &str = "simulated grooves against a ridge of the same walls";
const BAND: &str = "simulated band inside the grooves' outline";
const TARGETS: [&str; 3] =
    ["all signs as the height map's", "all signs opposite", "more at a wall's foot than at its top"];

/// Walls of a picture lit along them turn brighter or darker by less than this share of its level, and both
/// walls of a groove alike: such a lamp says nothing about their sides.
const LEAST_STRENGTH: f64 = 0.15;

/// A simulated channel whose walls change by less than this is lit along them.
const LEAST_SIMULATED: f64 = 0.03;

/// Scale, slope of a wall, and how the plate is pressed.
const SCALE: &str = "--mm-per-px 0.0274581,0.0274581 --steeper-than 0.05";
const SENSOR: &str = "--map-mm-per-px 0.0274581,0.0274581 --frame-px 616x514 --mm-per-px 0.0274581,0.0274581 \
                      --depth-mm 0.5";

/// Checks the signs of real and simulated walls.
pub fn check(lab: &Lab) -> Result<Set> {
    let Some(map) = lab.real(MAP.trim_start_matches("REAL/")) else {
        return Ok(Set::missing(TITLE, &[(REAL_SIGNS, TARGETS[0]), (RIDGE, TARGETS[1]), (BAND, TARGETS[2])]));
    };
    let images: Vec<String> = (1..=6).map(|i| format!("REAL/{FOLDER}/image{i:02}.png")).collect();
    let real = lab.json(&format!("walls {MAP} {} {SCALE}", images.join(" ")))?;
    let mut rows = vec![real_row(&real)?];
    rows.extend(simulated_rows(&simulated(lab, &map)?)?);
    let real_picture =
        |name: &str, caption: &str| Picture { path: lab.real.join(FOLDER).join(name), caption: caption.into() };
    Ok(Set {
        title: TITLE,
        source: Some(SOURCE),
        about: format!(
            "A flat plate with three grooves (0.35 to 0.41, 0.19 and 0.016 mm deep) and its measured height map, the \
             only real recess found. Each of its {} walls gives the side on which a lamp is, which every other wall \
             must confirm. The map is pressed 0.5 mm deep into the simulated gel of a Mini, as a plate with grooves \
             and upside down as ridges. The map was measured with these very images, so that the real row checks that \
             we read heights, slopes and images the right way round.",
            entries(&real, "/walls")?.len()
        ),
        rows,
        pictures: vec![
            real_picture("image02.png", "Real, light 2."),
            real_picture("image05.png", "Real, light 5, from the other side."),
            lab.picture("groove.png", "Simulated under a Mini's lamps: the plate with its grooves."),
            lab.picture("ridge.png", "The same surface upside down, as ridges: colours change sides."),
        ],
    })
}

/// The signs of the real walls, in the images that are lit across the grooves.
fn real_row(real: &Value) -> Result<Row> {
    let (mut across, mut along, mut n_right, mut n_tested) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for (i, channel) in channels(real)?.into_iter().enumerate() {
        if number(channel, "/strength")? < LEAST_STRENGTH {
            along.push(i + 1);
            continue;
        }
        across.push(i + 1);
        n_right += number(channel, "/n_right")?;
        n_tested += number(channel, "/n_tested")?;
    }
    let measured = format!(
        "{n_right} of {n_tested} right in images {across:?}; images {along:?} are lit along the grooves and show no side"
    );
    Ok(Row::new(REAL_SIGNS, TARGETS[0], measured, n_tested > 0.0 && n_right == n_tested))
}

/// Renders the plate, and the same surface upside down, where grooves are ridges; finds the walls of both.
fn simulated(lab: &Lab, map: &Path) -> Result<Value> {
    upside_down(map, &lab.out.join("ridge.npy"))?;
    lab.run(&format!("render {MAP} --as-hole {SENSOR} --out groove.png --at-rest-out groove-rest.png"))?;
    lab.run(&format!("render ridge.npy {SENSOR} --out ridge.png"))?;
    lab.json(&format!("walls {MAP} groove.png ridge.png --no-contact groove-rest.png {SCALE}"))
}

fn simulated_rows(simulated: &Value) -> Result<[Row; 2]> {
    let (mut n_opposite, mut n_compared, mut inside, mut lamps) = (0, 0, Vec::new(), Vec::new());
    for (channel, name) in ["red", "green", "blue"].into_iter().enumerate() {
        let at = |picture: usize, field: &str| format!("/pictures/{picture}/channels/{channel}/{field}");
        if number(simulated, &at(0, "strength"))? < LEAST_SIMULATED {
            continue;
        }
        let [groove, ridge] = [numbers(simulated, &at(0, "changes"))?, numbers(simulated, &at(1, "changes"))?];
        lamps.push(name);
        n_compared += groove.len();
        n_opposite += groove.iter().zip(&ridge).filter(|(groove, ridge)| *groove * *ridge < 0.0).count();
        inside.push(number(simulated, &at(0, "inside"))?);
    }
    let inside = inside.iter().sum::<f64>() / inside.len().max(1) as f64;
    let lamps = lamps.join(" and ");
    let opposite = format!("{n_opposite} of {n_compared} opposite, in {lamps}, which is across the grooves");
    let in_band = format!("{:.0} % inside", 100.0 * inside);
    Ok([
        Row::new(RIDGE, TARGETS[1], opposite, n_compared > 0 && n_opposite == n_compared),
        Row::new(BAND, TARGETS[2], in_band, inside > 0.5),
    ])
}

/// The only channel of each grey picture.
fn channels(walls: &Value) -> Result<Vec<&Value>> {
    let pictures = entries(walls, "/pictures")?;
    pictures.iter().map(|picture| entries(picture, "/channels").map(|channels| &channels[0])).collect()
}

/// Turns an `.npy` file of 4-byte floats upside down: each value's sign is the highest bit of its last byte.
fn upside_down(from: &Path, to: &Path) -> Result<()> {
    let mut bytes = fs::read(from).map_err(Error::io(from))?;
    // Ten bytes of magic, version and the header's length come before the header.
    let header = match bytes.get(8..10) {
        Some([low, high]) => 10 + usize::from(u16::from_le_bytes([*low, *high])),
        _ => 0,
    };
    let is_float = bytes.get(..header).is_some_and(|header| header.windows(5).any(|word| word == b"'<f4'"));
    if !is_float {
        return Err(Error::invalid(from.display().to_string(), "an .npy file of <f4", "another"));
    }
    bytes[header..].as_chunks_mut::<4>().0.iter_mut().for_each(|value| value[3] ^= 0x80);
    fs::write(to, bytes).map_err(Error::io(to))
}
