//! The dimensions of connectors, mm.

use super::{Connector, Contour, rectangle};

/// Straight pieces of half a circle.
const ARC_PIECES: usize = 24;

/// What the two sides of a connector look like.
pub(super) struct Drawing {
    pub plug: Contour,
    pub opening: Contour,
    /// The receptacle's shell or block.
    pub body: Contour,
    pub inside: Inside,
}

/// What is within a plug's outline, and what answers it in the receptacle.
pub(super) enum Inside {
    /// A shell round the slot for a tongue.
    Shell {
        /// The plug's inside, which takes the tongue.
        cavity: Contour,
        /// What fills a part of the cavity, flush with the shell (assumed).
        insulator: Option<Contour>,
        tongue: Contour,
    },
    /// A block.
    Solid,
    /// Half a ball.
    Ball {
        /// Its diameter, mm.
        diameter_mm: f64,
    },
}

impl Drawing {
    /// The drawing of a connector.
    pub fn of(connector: Connector) -> Self {
        use Outline::{Chamfered, Stadium, Trapezoid};
        match connector {
            // USB 2.0, Series A plug 12.0 x 4.5 mm of 0.3 mm sheet; receptacle 12.6 x 5.08 in 13.25 x 6.5 mm. The insulator fills
            // one half, 1.95 mm thick (assumed), the tongue the other: 1.84 mm of 1.95, 11.1 of 11.4 (assumed).
            Connector::UsbA => Self {
                plug: box_of([12.0, 4.5], 0.0),
                opening: box_of([12.6, 5.08], 0.0),
                body: box_of([13.25, 6.5], 0.0),
                inside: Inside::Shell {
                    cavity: box_of([11.4, 3.9], 0.0),
                    insulator: Some(box_of([11.4, 1.95], -0.975)),
                    tongue: box_of([11.1, 1.84], 0.975),
                },
            },
            // HDMI 1.4, type A: plug 13.9 x 4.45, receptacle 14.0 above, 10.0 below x 4.55 mm, walls of 0.5 mm,
            // the plug's assumed. The tongue is assumed.
            Connector::Hdmi => {
                Self::shells(Trapezoid([13.9, 9.9, 4.45]), Trapezoid([14.0, 10.0, 4.55]), 0.5, [10.0, 1.2])
            }
            // HDMI 1.4, type D: plug 5.83 x 2.20 mm. The receptacle, the lower side, the walls of 0.3 mm and the
            // tongue are assumed.
            Connector::MicroHdmi => {
                Self::shells(Trapezoid([5.83, 4.15, 2.20]), Trapezoid([5.93, 4.25, 2.30]), 0.3, [3.9, 0.6])
            }
            // Micro-USB 1.01, B plug 6.85 x 1.80 mm, receptacle 7.0 above, 5.7 below x 1.85 mm, walls of 0.4 mm.
            // The plug's lower side and the tongue are assumed.
            Connector::MicroUsbB => {
                Self::shells(Trapezoid([6.85, 5.55, 1.80]), Trapezoid([7.0, 5.7, 1.85]), 0.4, [3.7, 0.6])
            }
            // USB type C 1.0: plug 8.25 x 2.40, receptacle 8.34 x 2.56, tongue 6.7 x 0.7 mm. Walls of 0.3 mm assumed.
            Connector::UsbC => Self::shells(Stadium([8.25, 2.40]), Stadium([8.34, 2.56]), 0.3, [6.7, 0.7]),
            // USB 2.0, Series B: receptacle 8.45 x 7.78 mm. The plug, the cut corners, the walls and the tongue are assumed.
            Connector::UsbB => {
                let cuts = [1.6, 1.6, 0.0, 0.0];
                Self::shells(Chamfered([8.0, 7.3], cuts), Chamfered([8.45, 7.78], cuts), 0.4, [5.6, 3.2])
            }
            // Mini-USB, B: plug 6.8 x 3.0 mm. The rest is assumed.
            Connector::MiniUsbB => {
                let cuts = [0.0, 0.0, 0.9, 0.9];
                Self::shells(Chamfered([6.8, 3.0], cuts), Chamfered([6.9, 3.1], cuts), 0.3, [4.2, 0.7])
            }
            // DisplayPort: plug 16.1 x 4.76 mm, one corner cut. The rest is assumed.
            Connector::Displayport => {
                let cuts = [0.0, 0.0, 2.0, 0.0];
                Self::shells(Chamfered([16.1, 4.76], cuts), Chamfered([16.25, 4.9], cuts), 0.4, [12.4, 1.2])
            }
            // Mini DisplayPort: plug 7.4 x 4.5 mm. The rest is assumed.
            Connector::MiniDisplayport => {
                let cuts = [0.0, 0.0, 1.3, 1.3];
                Self::shells(Chamfered([7.4, 4.5], cuts), Chamfered([7.5, 4.6], cuts), 0.3, [5.0, 0.9])
            }
            // Lightning: plug 6.7 x 1.5 mm, solid. The receptacle is assumed.
            Connector::Lightning => Self::solid(stadium(6.7, 1.5), stadium(6.9, 1.7), stadium(7.9, 2.7)),
            // IEC 60603-7: the modular plug is 11.68 mm wide; opening and block. Latch and slot: 4 mm wide, the rest assumed.
            Connector::Rj45 => Self::solid(
                latched([11.68, 6.5], [3.2, 1.2]),
                latched([12.0, 6.8], [4.0, 1.5]),
                box_of([16.0, 13.5], 0.0),
            ),
            // The same with six places: the plug is 9.65 mm wide. The rest is assumed.
            Connector::Rj11 => Self::solid(
                latched([9.65, 6.5], [3.2, 1.2]),
                latched([9.95, 6.8], [4.0, 1.5]),
                box_of([13.2, 13.5], 0.0),
            ),
            // IEC 60603-11: a sleeve of 3.5 mm, its tip half a ball (assumed), a bore of nominally the same
            // diameter in a barrel of 6 mm.
            Connector::Jack => Self {
                plug: stadium(3.5, 3.5),
                opening: stadium(3.5, 3.5),
                body: stadium(6.0, 6.0),
                inside: Inside::Ball { diameter_mm: 3.5 },
            },
        }
    }

    /// A plug's and a receptacle's shell of one wall, round a tongue in the middle.
    fn shells(plug: Outline, opening: Outline, wall_mm: f64, tongue: [f64; 2]) -> Self {
        let (cavity, tongue) = (plug.drawn_in(wall_mm), box_of(tongue, 0.0));
        Self {
            plug: plug.drawn_in(0.0),
            opening: opening.drawn_in(0.0),
            body: opening.drawn_in(-wall_mm),
            inside: Inside::Shell { cavity, insulator: None, tongue },
        }
    }

    fn solid(plug: Contour, opening: Contour, body: Contour) -> Self {
        Self { plug, opening, body, inside: Inside::Solid }
    }
}

/// An outline that can be drawn in or out.
enum Outline {
    /// [`trapezoid`].
    Trapezoid([f64; 3]),
    /// [`stadium`] of a width and a height.
    Stadium([f64; 2]),
    /// [`chamfered`].
    Chamfered([f64; 2], [f64; 4]),
}

impl Outline {
    /// The outline drawn in by `wall_mm` on every side.
    fn drawn_in(&self, wall_mm: f64) -> Contour {
        match self {
            Self::Trapezoid(sides) => trapezoid(*sides, wall_mm),
            Self::Stadium([width, height]) => stadium(width - 2.0 * wall_mm, height - 2.0 * wall_mm),
            Self::Chamfered(sides, cuts_mm) => chamfered(*sides, *cuts_mm, wall_mm),
        }
    }
}

/// A rectangle whose middle is `y_mm` below the part's.
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

/// A rectangle with its corners cut at 45 degrees, from the upper left clockwise, by legs of `cuts_mm`; drawn in by
/// `wall_mm` on every side.
fn chamfered([width, height]: [f64; 2], cuts_mm: [f64; 4], wall_mm: f64) -> Contour {
    let [x, y] = [0.5 * width - wall_mm, 0.5 * height - wall_mm];
    let corners = [([-x, -y], [0.0, 1.0], [1.0, 0.0]), ([x, -y], [-1.0, 0.0], [0.0, 1.0])];
    let others = [([x, y], [0.0, -1.0], [-1.0, 0.0]), ([-x, y], [1.0, 0.0], [0.0, -1.0])];
    let ends = corners.into_iter().chain(others).zip(cuts_mm).flat_map(|((corner, before, after), cut)| {
        if cut == 0.0 {
            return vec![corner];
        }
        let leg = (cut - (2.0 - std::f64::consts::SQRT_2) * wall_mm).max(0.0);
        [before, after].map(|along| [0, 1].map(|axis| corner[axis] + leg * along[axis])).to_vec()
    });
    ends.collect()
}
