//! Connectors: the faces of plugs and the openings that take them.
//!
//! Dimensions are those of the plugs' public drawings as far as they are known; what is marked *assumed* is not
//! in them, or was not found, and may be off by some tenths of a mm. A plug and its receptacle are seen in one
//! orientation, the wide side of a trapezoid at the top. A receptacle's shell or block stands free: what it is
//! mounted on lies deeper than a press. So the two sides are two rings of nearly one size, and the nearest peg
//! by pixels is the right one for about half of the hole images, as in the paper (50.0 %); a panel
//! flush with the shells takes that down to chance.

use serde::{Deserialize, Serialize};

use super::relief::rectangle;
use super::{Contour, Face, HeightMap, Layer, Relief, Shape};
use crate::error::Result;

/// How far a tongue ends behind the face of its receptacle, mm.
const RECESS_MM: f64 = 0.5;

/// Pixel of the map of a rounded tip, mm.
const TIP_CELL_MM: f64 = 0.05;

/// Depth at which a tip's map is open, mm: deeper than any press.
const OPEN_MM: f64 = 10.0;

/// Straight pieces of half a circle.
const ARC_PIECES: usize = 24;

/// A connector.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Connector {
    /// USB type A, SuperSpeed or not.
    #[serde(rename = "usb-a")]
    UsbA,
    /// HDMI type A.
    #[serde(rename = "hdmi")]
    Hdmi,
    /// HDMI type D.
    #[serde(rename = "micro-hdmi")]
    MicroHdmi,
    /// USB micro B.
    #[serde(rename = "micro-usb-b")]
    MicroUsbB,
    /// USB type C: looks the same after half a turn.
    #[serde(rename = "usb-c")]
    UsbC,
    /// The modular plug of Ethernet.
    #[serde(rename = "rj45")]
    Rj45,
    /// The 3.5 mm audio jack: looks the same at any angle.
    #[serde(rename = "jack-3.5mm")]
    Jack,
}

/// A plug with a shell round a tongue's slot, and the opening that takes it; mm.
struct Shelled {
    plug: Contour,
    /// The plug's inside, which takes the tongue.
    cavity: Contour,
    /// What fills a part of the cavity, flush with the shell (assumed).
    insulator: Option<Shape>,
    opening: Contour,
    /// The receptacle's shell.
    shell: Contour,
    tongue: Shape,
}

impl Connector {
    /// All of them.
    pub const ALL: [Self; 7] =
        [Self::UsbA, Self::Hdmi, Self::MicroHdmi, Self::MicroUsbB, Self::UsbC, Self::Rj45, Self::Jack];

    /// Its name in scenes.
    pub fn name(self) -> &'static str {
        match self {
            Self::UsbA => "usb-a",
            Self::Hdmi => "hdmi",
            Self::MicroHdmi => "micro-hdmi",
            Self::MicroUsbB => "micro-usb-b",
            Self::UsbC => "usb-c",
            Self::Rj45 => "rj45",
            Self::Jack => "jack-3.5mm",
        }
    }

    /// The connector of a name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|connector| connector.name() == name)
    }

    /// The face of the plug.
    pub fn plug(self) -> Result<Relief> {
        Ok(match self.shelled() {
            Some(Shelled { plug, cavity, insulator, .. }) => {
                let shell = Shape { regions: vec![vec![plug, cavity]] };
                let faces = std::iter::once(shell).chain(insulator);
                Relief { layers: faces.map(|outline| Layer::Face(face(outline, 0.0))).collect() }
            }
            None if self == Self::Jack => Relief { layers: vec![Layer::Heights(rounded_tip(0.5 * JACK_MM)?)] },
            None => Relief::peg(one(self.outline())),
        })
    }

    /// The receptacle: its shell or block round the opening, and what stands in it.
    pub fn receptacle(self) -> Relief {
        let rim = Shape { regions: vec![vec![self.body(), self.opening()]] };
        let tongue = self.shelled().map(|shelled| face(shelled.tongue, RECESS_MM));
        Relief { layers: std::iter::once(face(rim, 0.0)).chain(tongue).map(Layer::Face).collect() }
    }

    /// Outline of the plug, mm.
    pub fn outline(self) -> Contour {
        match self.shelled() {
            Some(shelled) => shelled.plug,
            None if self == Self::Jack => stadium(JACK_MM, JACK_MM),
            None => latched(RJ45_PLUG_MM, RJ45_LATCH_MM),
        }
    }

    /// Outline of the receptacle's opening, mm.
    pub fn opening(self) -> Contour {
        match self.shelled() {
            Some(shelled) => shelled.opening,
            None if self == Self::Jack => stadium(JACK_BORE_MM, JACK_BORE_MM),
            None => latched(RJ45_OPENING_MM, RJ45_SLOT_MM),
        }
    }

    /// Outline of the receptacle, mm.
    pub fn body(self) -> Contour {
        match self.shelled() {
            Some(shelled) => shelled.shell,
            None if self == Self::Jack => stadium(JACK_BARREL_MM, JACK_BARREL_MM),
            None => box_of(RJ45_BLOCK_MM, 0.0),
        }
    }

    /// The dimensions of those that have a shell and a tongue.
    fn shelled(self) -> Option<Shelled> {
        Some(match self {
            // USB 2.0, Series A plug 12.0 x 4.5 mm of 0.3 mm sheet; receptacle 12.6 x 5.08 in 13.25 x 6.5 mm. The insulator fills
            // one half, 1.95 mm thick (assumed), the tongue the other: 1.84 mm of 1.95, 11.1 of 11.4 (assumed).
            Self::UsbA => Shelled {
                plug: box_of([12.0, 4.5], 0.0),
                cavity: box_of([11.4, 3.9], 0.0),
                insulator: Some(one(box_of([11.4, 1.95], -0.975))),
                opening: box_of([12.6, 5.08], 0.0),
                shell: box_of([13.25, 6.5], 0.0),
                tongue: one(box_of([11.1, 1.84], 0.975)),
            },
            // HDMI 1.4, type A: plug 13.9 x 4.45, receptacle 14.0 above, 10.0 below x 4.55 mm, walls of 0.5 mm,
            // the plug's assumed.
            // The tongue is assumed.
            Self::Hdmi => Shelled {
                plug: trapezoid([13.9, 9.9, 4.45], 0.0),
                cavity: trapezoid([13.9, 9.9, 4.45], 0.5),
                insulator: None,
                opening: trapezoid([14.0, 10.0, 4.55], 0.0),
                shell: trapezoid([14.0, 10.0, 4.55], -0.5),
                tongue: one(box_of([10.0, 1.2], 0.0)),
            },
            // HDMI 1.4, type D: plug 5.83 x 2.20 mm. The receptacle, the lower side, the walls of 0.3 mm and the
            // tongue are assumed.
            Self::MicroHdmi => Shelled {
                plug: trapezoid([5.83, 4.15, 2.20], 0.0),
                cavity: trapezoid([5.83, 4.15, 2.20], 0.3),
                insulator: None,
                opening: trapezoid([5.93, 4.25, 2.30], 0.0),
                shell: trapezoid([5.93, 4.25, 2.30], -0.3),
                tongue: one(box_of([3.9, 0.6], 0.0)),
            },
            // Micro-USB 1.01, B plug 6.85 x 1.80 mm, receptacle 7.0 above, 5.7 below x 1.85 mm, walls of 0.4 mm.
            // The plug's lower side and the tongue are assumed.
            Self::MicroUsbB => Shelled {
                plug: trapezoid([6.85, 5.55, 1.80], 0.0),
                cavity: trapezoid([6.85, 5.55, 1.80], 0.4),
                insulator: None,
                opening: trapezoid([7.0, 5.7, 1.85], 0.0),
                shell: trapezoid([7.0, 5.7, 1.85], -0.4),
                tongue: one(box_of([3.7, 0.6], 0.0)),
            },
            // USB type C 1.0: plug 8.25 x 2.40, receptacle 8.34 x 2.56, tongue 6.7 x 0.7 mm. Walls of 0.3 mm assumed.
            Self::UsbC => Shelled {
                plug: stadium(8.25, 2.40),
                cavity: stadium(7.65, 1.80),
                insulator: None,
                opening: stadium(8.34, 2.56),
                shell: stadium(8.34 + 0.6, 2.56 + 0.6),
                tongue: one(box_of([6.7, 0.7], 0.0)),
            },
            Self::Rj45 | Self::Jack => return None,
        })
    }
}

/// IEC 60603-7: the modular plug, mm; 11.68 is its width.
const RJ45_PLUG_MM: [f64; 2] = [11.68, 6.5];
/// The latch below the plug where it meets the receptacle (assumed), mm.
const RJ45_LATCH_MM: [f64; 2] = [3.2, 1.2];
/// The receptacle's opening, mm.
const RJ45_OPENING_MM: [f64; 2] = [12.0, 6.8];
/// The slot for the latch, 4 mm wide; its height is assumed, mm.
const RJ45_SLOT_MM: [f64; 2] = [4.0, 1.5];
/// The block round the opening, mm.
const RJ45_BLOCK_MM: [f64; 2] = [16.0, 13.5];

/// IEC 60603-11: diameter of the jack's sleeve, mm. Its tip is half a ball (assumed).
const JACK_MM: f64 = 3.5;
/// Its bore, nominally of the same diameter, mm.
const JACK_BORE_MM: f64 = 3.5;
/// The barrel round the bore, mm.
const JACK_BARREL_MM: f64 = 6.0;

fn face(outline: Shape, drop_mm: f64) -> Face {
    Face { outline, grow_mm: 0.0, outside: false, drop_mm, band_mm: None }
}

fn one(contour: Contour) -> Shape {
    Shape { regions: vec![vec![contour]] }
}

/// A rectangle whose middle lies `y_mm` below the part's.
fn box_of([width, height]: [f64; 2], y_mm: f64) -> Contour {
    let [x, y] = [0.5 * width, 0.5 * height];
    rectangle([-x, y_mm - y, x, y_mm + y]).regions.remove(0).remove(0)
}

/// A rectangle in the middle with a smaller one hanging from its lower side.
fn latched([width, height]: [f64; 2], [tab_width, tab_height]: [f64; 2]) -> Contour {
    let ([x, y], tab, low) = ([0.5 * width, 0.5 * height], 0.5 * tab_width, 0.5 * height + tab_height);
    vec![[-x, -y], [x, -y], [x, y], [tab, y], [tab, low], [-tab, low], [-tab, y], [-x, y]]
}

/// A trapezoid with upright axis, its wider side at the top, drawn in by `wall_mm` on every side.
fn trapezoid([top, bottom, height]: [f64; 3], wall_mm: f64) -> Contour {
    let slope = 0.5 * (top - bottom) / height;
    let sideways = wall_mm * (1.0 + slope * slope).sqrt();
    let y = 0.5 * height - wall_mm;
    let [top, bottom] = [0.5 * top - slope * wall_mm - sideways, 0.5 * bottom + slope * wall_mm - sideways];
    vec![[-top, -y], [top, -y], [bottom, y], [-bottom, y]]
}

/// A rectangle with round ends; a circle where it is as high as wide.
fn stadium(width: f64, height: f64) -> Contour {
    let (radius, straight) = (0.5 * height, 0.5 * (width - height));
    let end = |side: f64| {
        (0..=ARC_PIECES).map(move |i| {
            let angle = std::f64::consts::PI * i as f64 / ARC_PIECES as f64;
            [side * (straight + radius * angle.sin()), -side * radius * angle.cos()]
        })
    };
    end(1.0).chain(end(-1.0)).collect()
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Raster;

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
        for connector in Connector::ALL {
            let [plug, opening, body] = [connector.outline(), connector.opening(), connector.body()].map(one);
            for (inner, outer) in [(&plug, &opening), (&opening, &body)] {
                let cells = covered(inner).into_iter().zip(covered(outer));
                let beyond: f32 = cells.map(|(inner, outer)| (inner - outer).max(0.0)).sum();
                assert!(beyond * (CELL_MM * CELL_MM) as f32 <= 1e-3, "{connector:?}");
            }
            let Some(shelled) = connector.shelled() else { continue };
            let solid = Shape { regions: vec![vec![shelled.plug, shelled.cavity]] };
            assert!(common(&solid, &shelled.tongue) < 1e-3, "{connector:?}: the shell meets the tongue");
            if let Some(insulator) = &shelled.insulator {
                assert!(common(insulator, &shelled.tongue) < 1e-3, "{connector:?}: the insulator meets the tongue");
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
        ] {
            let shelled = connector.shelled().unwrap();
            let outside = Raster::distance(&one(shelled.plug), HALF_MM, CELL_MM, 1.0);
            let inside = covered(&one(shelled.cavity));
            let nearest = outside.values.iter().zip(&inside).filter(|(_, covered)| **covered >= 1.0);
            let wall = -nearest.map(|(distance, _)| f64::from(*distance)).fold(f64::NEG_INFINITY, f64::max);
            // Cells' centres lie up to a cell inside the cavity.
            assert!((wall_mm - 0.02..wall_mm + 1.5 * CELL_MM).contains(&wall), "{connector:?}: {wall}");
        }
    }

    #[test]
    fn names_are_those_of_scene_files() {
        for connector in Connector::ALL {
            assert_eq!(serde_json::to_value(connector).unwrap(), connector.name());
            assert_eq!(Connector::named(connector.name()), Some(connector));
        }
    }

    #[test]
    fn only_usb_c_and_the_jack_look_the_same_upside_down() {
        for connector in Connector::ALL {
            let symmetric = matches!(connector, Connector::UsbC | Connector::Jack);
            assert_eq!(connector.plug().unwrap().is_half_turn_symmetric(), symmetric, "{connector:?}");
            assert_eq!(connector.receptacle().is_half_turn_symmetric(), symmetric, "{connector:?}");
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
