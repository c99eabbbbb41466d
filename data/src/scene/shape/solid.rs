//! Simple bodies by their name and size: `ball:4.7`, `cylinder:6`, `ring:8:5`, `cuboid:10x10`, all mm.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::relief::rectangle;
use super::{Contour, HeightMap, Layer, Relief, Shape};
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::text::suggest::with_closest;

/// Straight pieces of a circle: 0.003 mm off at most on a circle of 20 mm.
const CIRCLE_PIECES: usize = 128;

/// Least and greatest length of a body, mm.
const LENGTHS_MM: std::ops::RangeInclusive<f64> = 0.2..=200.0;

/// The thinnest wall of a ring, mm: a cell of the gel.
const LEAST_WALL_MM: f64 = 0.1;

/// Side of a pixel of a ball's height map, mm; of a large ball a thousandth of its diameter.
const BALL_CELL_MM: f64 = 0.05;

/// What is this far below a ball's middle is never touched, mm: the deepest press that can be solved.
const OPEN_MM: f64 = 100.0;

/// A body on a board with its axis towards the sensor. All but the ball are flat on top.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Solid {
    /// `ball:4.7`: a ball by its diameter; the upper half is touched.
    Ball {
        /// Diameter, mm.
        diameter_mm: f64,
    },
    /// `cylinder:6`: a cylinder by its diameter.
    Cylinder {
        /// Diameter, mm.
        diameter_mm: f64,
    },
    /// `ring:8:5`: a tube by its outer and inner diameter.
    Ring {
        /// Outer diameter, mm.
        outer_mm: f64,
        /// Inner diameter, mm.
        inner_mm: f64,
    },
    /// `cuboid:10x6`: a block by its sides along x and y.
    Cuboid {
        /// The sides along x and y, mm.
        sides_mm: [f64; 2],
    },
}

/// The kinds, each with an example of its name.
const KINDS: [(&str, &str); 4] =
    [("ball", "ball:4.7"), ("cylinder", "cylinder:6"), ("ring", "ring:8:5"), ("cuboid", "cuboid:10x6")];

impl Solid {
    /// Whether a part's name begins as a body's does: `ball:`, `cylinder:`, `ring:`, `cuboid:`.
    pub fn is_name(part: &str) -> bool {
        part.split_once(':').is_some_and(|(kind, _)| Self::kinds().any(|known| known == kind))
    }

    /// The kinds of solids, as their names begin.
    pub fn kinds() -> impl Iterator<Item = &'static str> {
        KINDS.iter().map(|(kind, _)| *kind)
    }

    /// The outline of its face, or of a ball's widest section, mm round its centre.
    pub fn outline(&self) -> Shape {
        let contours = match *self {
            Self::Ball { diameter_mm } | Self::Cylinder { diameter_mm } => vec![circle(diameter_mm)],
            Self::Ring { outer_mm, inner_mm } => vec![circle(outer_mm), circle(inner_mm)],
            Self::Cuboid { sides_mm: [x, y] } => return rectangle([-0.5 * x, -0.5 * y, 0.5 * x, 0.5 * y]),
        };
        Shape { regions: vec![contours] }
    }

    /// One of its sides. A hole is a plate with an opening of its outline, wider by `clearance_mm` on every side; a
    /// ball's is round, as a cylinder's is.
    pub fn relief(&self, side: Side, clearance_mm: f64) -> Result<Relief> {
        match (side, self) {
            (Side::Peg, Self::Ball { diameter_mm }) => {
                Ok(Relief { layers: vec![Layer::Heights(upper_half(*diameter_mm)?)] })
            }
            (Side::Peg, _) => Ok(Relief::peg(self.outline())),
            (Side::Hole, _) => Ok(Relief::hole(self.outline(), clearance_mm)),
        }
    }
}

impl FromStr for Solid {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let (kind, sizes) = name.split_once(':').unwrap_or((name, ""));
        let Some((_, example)) = KINDS.iter().find(|(known, _)| *known == kind) else {
            let expected = KINDS.map(|(_, example)| example).join(", ");
            return Err(Error::invalid("solid", format!("such as {expected}"), with_closest(kind, KINDS.map(|k| k.0))));
        };
        let length = |text: &str| text.parse().ok().filter(|mm| LENGTHS_MM.contains(mm));
        let pair = |by: char| sizes.split_once(by).and_then(|(a, b)| Some([length(a)?, length(b)?]));
        let solid = match kind {
            "ball" => length(sizes).map(|diameter_mm| Self::Ball { diameter_mm }),
            "cylinder" => length(sizes).map(|diameter_mm| Self::Cylinder { diameter_mm }),
            "ring" => {
                let tube = pair(':').filter(|[outer, inner]| outer - inner >= 2.0 * LEAST_WALL_MM);
                tube.map(|[outer_mm, inner_mm]| Self::Ring { outer_mm, inner_mm })
            }
            _ => pair('x').map(|sides_mm| Self::Cuboid { sides_mm }),
        };
        solid.ok_or_else(|| {
            let wall = if kind == "ring" { ", outer diameter first, walls of 0.1 mm or more" } else { "" };
            let expected = format!("such as {example}: {} to {} mm{wall}", LENGTHS_MM.start(), LENGTHS_MM.end());
            Error::invalid("solid", expected, name)
        })
    }
}

impl TryFrom<String> for Solid {
    type Error = Error;

    fn try_from(name: String) -> Result<Self> {
        name.parse()
    }
}

impl From<Solid> for String {
    fn from(solid: Solid) -> Self {
        solid.to_string()
    }
}

impl fmt::Display for Solid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Ball { diameter_mm } => write!(f, "ball:{diameter_mm}"),
            Self::Cylinder { diameter_mm } => write!(f, "cylinder:{diameter_mm}"),
            Self::Ring { outer_mm, inner_mm } => write!(f, "ring:{outer_mm}:{inner_mm}"),
            Self::Cuboid { sides_mm: [x, y] } => write!(f, "cuboid:{x}x{y}"),
        }
    }
}

fn circle(diameter_mm: f64) -> Contour {
    let at = |i: usize| {
        let (sin, cos) = (std::f64::consts::TAU * i as f64 / CIRCLE_PIECES as f64).sin_cos();
        [0.5 * diameter_mm * cos, 0.5 * diameter_mm * sin]
    };
    (0..CIRCLE_PIECES).map(at).collect()
}

/// The upper half of a ball, with nothing round it.
fn upper_half(diameter_mm: f64) -> Result<HeightMap> {
    let (radius_mm, cell_mm) = (0.5 * diameter_mm, BALL_CELL_MM.min(diameter_mm / 20.0).max(diameter_mm / 1_000.0));
    let n = (diameter_mm / cell_mm).ceil() as usize;
    let centre = |i: usize| (i as f64 + 0.5 - 0.5 * n as f64) * cell_mm;
    let height = |i: usize| {
        let square = radius_mm.powi(2) - centre(i % n).powi(2) - centre(i / n).powi(2);
        (if square >= 0.0 { square.sqrt() } else { -OPEN_MM }) as f32
    };
    HeightMap::new([n, n], [cell_mm; 2], &(0..n * n).map(height).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::scene::shape::Raster;

    const HALF_MM: f64 = 6.0;
    const CELL_MM: f64 = 0.05;

    fn solid(name: &str) -> Solid {
        name.parse().unwrap()
    }

    /// The area of an outline by the cells it covers, mm^2.
    fn area(shape: &Shape) -> f64 {
        Raster::coverage(shape, HALF_MM, CELL_MM).values.iter().map(|v| f64::from(*v) * CELL_MM * CELL_MM).sum()
    }

    #[test]
    fn outlines_have_the_areas_and_sizes_of_the_closed_forms() {
        for (name, expected, [width, height]) in [
            ("ball:4.7", PI * 2.35 * 2.35, [4.7, 4.7]),
            ("cylinder:6", PI * 9.0, [6.0, 6.0]),
            ("ring:8:5", PI * (16.0 - 6.25), [8.0, 8.0]),
            ("cuboid:10x4", 40.0, [10.0, 4.0]),
        ] {
            let outline = solid(name).outline();
            // A polygon of 128 corners has 0.04 % less than its circle; a cell's coverage is known to a few per cent.
            assert!((area(&outline) / expected - 1.0).abs() < 3e-3, "{name}: {} of {expected}", area(&outline));
            let [x_min, y_min, x_max, y_max] = outline.bounds();
            assert!((x_max - x_min - width).abs() < 1e-9 && (y_max - y_min - height).abs() < 1e-9, "{name}");
        }
    }

    #[test]
    fn an_opening_is_wider_than_its_body_by_the_clearance() {
        // By the distance from the edge: the same grown outline for a ball and a cylinder of its diameter.
        for name in ["ball:4.7", "cylinder:4.7"] {
            let Layer::Face(face) = &solid(name).relief(Side::Hole, 0.15).unwrap().layers[0] else { panic!("{name}") };
            assert!(face.outside && face.grow_mm == 0.15 && face.drop_mm == 0.0);
            let distance = Raster::distance(&face.outline, HALF_MM, CELL_MM, 1.0);
            let open = distance.values.iter().filter(|away| f64::from(**away) < face.grow_mm).count() as f64;
            // Cells on the edge: a share of CELL_MM / radius.
            assert!((open * CELL_MM * CELL_MM / (PI * 2.5 * 2.5) - 1.0).abs() < 0.02, "{name}: {open}");
        }
    }

    #[test]
    fn a_ball_is_as_high_as_its_radius_says() {
        let relief = solid("ball:8").relief(Side::Peg, 0.0).unwrap();
        let [Layer::Heights(map)] = &relief.layers[..] else { panic!("a height map") };
        let drop = |x: f64, y: f64| map.drop_at([x, y]).map(f64::from);
        for from_axis in [0.0_f64, 1.0, 2.0, 3.0] {
            let expected = 4.0 - (16.0 - from_axis * from_axis).sqrt();
            for (x, y) in [(from_axis, 0.0), (0.0, -from_axis), (-0.6 * from_axis, 0.8 * from_axis)] {
                assert!((drop(x, y).unwrap() - expected).abs() < 0.003, "{from_axis}");
            }
        }
        assert!(drop(3.9, 3.9).unwrap() > 99.0 && drop(4.2, 0.0).is_none());
    }

    #[test]
    fn names_are_read_back_and_wrong_ones_are_refused_with_an_example() {
        for name in ["ball:4.7", "cylinder:6", "ring:8:5", "cuboid:10x10", "cuboid:2.5x7"] {
            assert_eq!(solid(name).to_string(), name);
            assert_eq!(serde_json::to_value(solid(name)).unwrap(), name);
            assert!(Solid::is_name(name));
        }
        for (name, named) in [
            ("bal:4.7", "did you mean ball?"),
            ("cone:4", "cylinder:6"),
            ("ball", "ball:4.7"),
            ("ball:nan", "ball:4.7"),
            ("ball:0", "0.2 to 200"),
            ("cylinder:6:5", "cylinder:6"),
            ("ring:5:8", "outer diameter first"),
            ("ring:5:4.9", "walls of 0.1 mm"),
            ("cuboid:10", "cuboid:10x6"),
            ("cuboid:10x-1", "cuboid:10x6"),
        ] {
            let error = name.parse::<Solid>().unwrap_err().to_string();
            assert!(error.contains(named) && error.contains(name.split(':').next().unwrap()), "{error}");
        }
        assert!(!Solid::is_name("letter:A:12") && !Solid::is_name("ball"));
    }
}
