//! Connectors: the faces of plugs and the openings that take them.
//!
//! Dimensions are taken from the plugs' public drawings as far as they are known; what is marked *assumed* is not
//! in them, or was not found, and may be off by some tenths of a mm. A plug and its receptacle are seen in one
//! orientation, the wide side of a trapezoid at the top. A receptacle's shell or block has nothing round it: what
//! it is mounted on is deeper than a press. So the two sides are two rings of nearly one size, and the nearest peg
//! by pixels is the right one for about half of the hole images, as in the paper (50.0 %); a panel
//! flush with the shells takes that down to chance.

use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

mod drawing;

use super::relief::rectangle;
use super::{Contour, Face, HeightMap, Layer, Relief, Shape};
use crate::error::{Error, Result};
use crate::text::suggest;
use drawing::{Drawing, Inside};

/// How far a tongue ends behind the face of its receptacle, mm.
const RECESS_MM: f64 = 0.5;

/// Pixel of the map of a rounded tip, mm.
const TIP_CELL_MM: f64 = 0.05;

/// Depth at which a tip's map is open, mm: deeper than any press.
const OPEN_MM: f64 = 10.0;

/// A connector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr, VariantArray)]
#[serde(try_from = "String", into = "&'static str")]
#[strum(serialize_all = "kebab-case")]
pub enum Connector {
    /// USB type A, SuperSpeed or not.
    UsbA,
    /// HDMI type A.
    Hdmi,
    /// HDMI type D.
    MicroHdmi,
    /// USB micro B.
    MicroUsbB,
    /// USB type C: looks the same after half a turn.
    UsbC,
    /// The modular plug of Ethernet.
    Rj45,
    /// The 3.5 mm audio jack: looks the same at any angle.
    #[strum(serialize = "jack-3.5mm")]
    Jack,
    /// USB type B.
    UsbB,
    /// USB mini B.
    MiniUsbB,
    /// DisplayPort.
    Displayport,
    /// Mini DisplayPort.
    MiniDisplayport,
    /// Lightning: looks the same after half a turn.
    Lightning,
    /// The modular plug of telephones.
    Rj11,
}

impl Connector {
    /// All of them.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Six of a single-board computer, for evaluation: never trained or tuned on.
    pub const EVALUATION: [Self; 6] =
        [Self::UsbA, Self::Hdmi, Self::MicroHdmi, Self::MicroUsbB, Self::UsbC, Self::Rj45];

    /// Six others, for tuning.
    pub const TUNING: [Self; 6] =
        [Self::UsbB, Self::MiniUsbB, Self::Displayport, Self::MiniDisplayport, Self::Lightning, Self::Rj11];

    /// Its name in scenes.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The connector of a name. Fails with the names that there are.
    pub fn named(name: &str) -> Result<Self> {
        suggest::named("connector", name, Self::ALL, Self::name)
    }

    /// The face of the plug.
    pub fn plug(self) -> Result<Relief> {
        let Drawing { plug, inside, .. } = Drawing::of(self);
        Ok(match inside {
            Inside::Shell { cavity, insulator, .. } => {
                let shell = Shape { regions: vec![vec![plug, cavity]] };
                let faces = std::iter::once(shell).chain(insulator.map(one));
                Relief { layers: faces.map(|outline| Layer::Face(face(outline, 0.0))).collect() }
            }
            Inside::Solid => Relief::peg(one(plug)),
            Inside::Ball { diameter_mm } => Relief { layers: vec![Layer::Heights(rounded_tip(0.5 * diameter_mm)?)] },
        })
    }

    /// The receptacle: its shell or block round the opening, and what is in it.
    pub fn receptacle(self) -> Relief {
        let Drawing { opening, body, inside, .. } = Drawing::of(self);
        let rim = Shape { regions: vec![vec![body, opening]] };
        let tongue = match inside {
            Inside::Shell { tongue, .. } => Some(face(one(tongue), RECESS_MM)),
            Inside::Solid | Inside::Ball { .. } => None,
        };
        Relief { layers: std::iter::once(face(rim, 0.0)).chain(tongue).map(Layer::Face).collect() }
    }

    /// Outline of the plug, mm.
    pub fn outline(self) -> Contour {
        Drawing::of(self).plug
    }

    /// Outline of the receptacle's opening, mm.
    pub fn opening(self) -> Contour {
        Drawing::of(self).opening
    }

    /// Outline of the receptacle, mm.
    pub fn body(self) -> Contour {
        Drawing::of(self).body
    }
}

fn face(outline: Shape, drop_mm: f64) -> Face {
    Face { drop_mm, ..Face::of(outline) }
}

fn one(contour: Contour) -> Shape {
    Shape { regions: vec![vec![contour]] }
}

/// A tip as half a ball of `radius_mm`.
fn rounded_tip(radius_mm: f64) -> Result<HeightMap> {
    // An odd number of pixels puts one on the tip.
    let n = 2 * (radius_mm / TIP_CELL_MM).ceil() as usize + 1;
    let place = |i: usize| (i as f64 - 0.5 * (n - 1) as f64) * TIP_CELL_MM;
    let height = |i: usize| {
        let from_axis = place(i % n).hypot(place(i / n));
        if from_axis < radius_mm { (radius_mm * radius_mm - from_axis * from_axis).sqrt() } else { -OPEN_MM }
    };
    let heights: Vec<f32> = (0..n * n).map(|i| height(i) as f32).collect();
    HeightMap::new([n, n], [TIP_CELL_MM, TIP_CELL_MM], &heights)
}

impl TryFrom<String> for Connector {
    type Error = Error;

    fn try_from(name: String) -> Result<Self> {
        Self::named(&name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::Raster;

    const HALF_MM: f64 = 10.0;
    const CELL_MM: f64 = 0.04;

    fn covered(shape: &Shape) -> Vec<f32> {
        Raster::coverage(shape, HALF_MM, CELL_MM).values
    }

    /// Area that two shapes share, mm^2.
    fn common(a: &Shape, b: &Shape) -> f32 {
        let cell = (CELL_MM * CELL_MM) as f32;
        covered(a).iter().zip(covered(b)).map(|(a, b)| a * b * cell).sum()
    }

    #[test]
    fn every_plug_goes_into_its_receptacle_and_round_its_tongue() {
        for &connector in Connector::ALL {
            let [plug, opening, body] = [connector.outline(), connector.opening(), connector.body()].map(one);
            for (inner, outer) in [(&plug, &opening), (&opening, &body)] {
                let cells = covered(inner).into_iter().zip(covered(outer));
                let beyond: f32 = cells.map(|(inner, outer)| (inner - outer).max(0.0)).sum();
                assert!(beyond * (CELL_MM * CELL_MM) as f32 <= 1e-3, "{connector:?}");
            }
            let Drawing { plug, inside: Inside::Shell { cavity, insulator, tongue }, .. } = Drawing::of(connector)
            else {
                continue;
            };
            let (solid, tongue) = (Shape { regions: vec![vec![plug, cavity]] }, one(tongue));
            assert!(common(&solid, &tongue) < 1e-3, "{connector:?}: the shell meets the tongue");
            if let Some(insulator) = insulator {
                assert!(common(&one(insulator), &tongue) < 1e-3, "{connector:?}: the insulator meets the tongue");
            }
        }
    }

    #[test]
    fn plugs_have_the_walls_they_are_said_to_have() {
        for (connector, wall_mm) in [
            (Connector::UsbA, 0.3),
            (Connector::Hdmi, 0.5),
            (Connector::MicroHdmi, 0.3),
            (Connector::MicroUsbB, 0.4),
            (Connector::UsbC, 0.3),
            (Connector::UsbB, 0.4),
            (Connector::MiniUsbB, 0.3),
            (Connector::Displayport, 0.4),
            (Connector::MiniDisplayport, 0.3),
        ] {
            let Drawing { plug, inside: Inside::Shell { cavity, .. }, .. } = Drawing::of(connector) else {
                panic!("{connector:?} has no shell")
            };
            let outside = Raster::distance(&one(plug), HALF_MM, CELL_MM, 1.0);
            let inside = covered(&one(cavity));
            let nearest = outside.values.iter().zip(&inside).filter(|(_, covered)| **covered >= 1.0);
            let wall = -nearest.map(|(distance, _)| f64::from(*distance)).fold(f64::NEG_INFINITY, f64::max);
            // Cells' centres are up to a cell inside the cavity.
            assert!((wall_mm - 0.02..wall_mm + 1.5 * CELL_MM).contains(&wall), "{connector:?}: {wall}");
        }
    }

    #[test]
    fn names_are_those_of_scene_files() {
        for &connector in Connector::ALL {
            assert_eq!(serde_json::to_value(connector).unwrap(), connector.name());
            assert_eq!(Connector::named(connector.name()).unwrap(), connector);
        }
    }

    #[test]
    fn only_usb_c_lightning_and_the_jack_look_the_same_upside_down() {
        for &connector in Connector::ALL {
            let symmetric = matches!(connector, Connector::UsbC | Connector::Lightning | Connector::Jack);
            assert_eq!(connector.plug().unwrap().symmetry().is_any(), symmetric, "{connector:?}");
            assert_eq!(connector.receptacle().symmetry().is_any(), symmetric, "{connector:?}");
        }
    }

    #[test]
    fn a_jacks_tip_is_half_a_ball() {
        let tip = rounded_tip(1.75).unwrap();
        for x in [0.0_f64, 0.5, 1.0, 1.5] {
            let expected = 1.75 - (1.75_f64 * 1.75 - x * x).sqrt();
            assert!((f64::from(tip.drop_at([0.0, x]).unwrap()) - expected).abs() < 0.002);
        }
    }
}
