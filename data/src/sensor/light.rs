//! A sensor's lamps: how each channel answers a slope of the gel.
//!
//! For a slope `g = (g_x, g_y)`, `g = tan(theta) (cos phi, sin phi)` towards deeper gel, a channel changes by
//!
//! ```text
//! dI = a_x 2 g_x/(1 + g^2) + a_y 2 g_y/(1 + g^2)                               sin 2 theta: a lamp from one side
//!    + b g^2/(1 + g^2) + b_2 (g_x^2 - g_y^2)/(1 + g^2) + b_11 2 g_x g_y/(1 + g^2)        sin^2 theta: walls
//!    + d D                                                                           how deep it is pressed in
//! ```
//!
//! where each factor is a quadratic of the place in the frame. These are the spherical harmonics of the
//! surface's normal up to the second order, which hold 98 % of diffuse light (Ramamoorthi and Hanrahan,
//! 2001), less the constant, which is the frame at rest. Of a real Mini's Taxim table they leave 2 to 4 counts
//! (root mean square over the frame and slopes up to 58 degrees) of 22 to 32: `tactile-data calibrate polycalib.npz`.
//!
//! The last is no matter of slopes: where the gel is pressed in and level, it is nearer to the camera and
//! thinner, and some sensors show it darker or brighter. It is different for each sensor and is known from presses alone.

mod known;

use serde::{Deserialize, Deserializer, Serialize};

use crate::error::{Error, Result};
use crate::light::lamps::{Lamps, fading, on_view, turned};
pub use crate::light::lamps::{Quadratic, value};
use crate::text::suggest::with_closest;

/// The most that a factor may be, counts: a lamp's change cannot leave the 8 bits by much.
const MAX_COUNTS: f32 = 4_096.0;

/// The frame at rest: quadratics fitted to a real Mini's no-contact frame, within 2 to 8 counts.
const MINI_AT_REST: [Quadratic; 3] = [
    [121.5, -5.9, 24.6, -61.9, 0.1, -65.2],
    [109.4, -2.9, -6.1, -27.3, 1.0, -15.9],
    [133.8, -4.3, -19.3, -42.2, 2.7, -41.7],
];

/// A sensor's light, each factor for red, green and blue. In a scene it is written out or given by the name
/// of a known rig: `light = "mini-table"`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LightRig {
    /// The frame at rest, counts.
    pub at_rest: [Quadratic; 3],
    /// Response to `2 g_x / (1 + g^2)`, counts.
    pub along_x: [Quadratic; 3],
    /// Response to `2 g_y / (1 + g^2)`, counts.
    pub along_y: [Quadratic; 3],
    /// Response to steep walls; without it none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub walls: Option<Walls>,
    /// Response to how deep the gel is pressed in, counts per mm; without it none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pressed: Option<[Quadratic; 3]>,
    /// How lamps cast shadows, for [`super::Fidelity::Shadow`].
    pub shadow: Shadow,
}

/// The second order of a rig's response, each factor for red, green and blue, counts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Walls {
    /// Response to `g^2 / (1 + g^2)`.
    pub steep: [Quadratic; 3],
    /// Response to `(g_x^2 - g_y^2) / (1 + g^2)`.
    pub across: [Quadratic; 3],
    /// Response to `2 g_x g_y / (1 + g^2)`.
    pub diagonal: [Quadratic; 3],
}

/// How a rig's lamps cast shadows: one value for all lamps.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Shadow {
    /// How high the lamps are above the gel's plane, degrees, 1..=89.
    pub elevation_deg: f64,
    /// Share of a channel's light that full shadow takes away, 0..=1.
    pub strength: f64,
    /// How far below the line of the lamp the surface must be for full shadow, mm: the lamps are not points.
    pub soft_mm: f64,
}

impl Default for Shadow {
    fn default() -> Self {
        Self { elevation_deg: 50.0, strength: 0.1, soft_mm: 0.3 }
    }
}

impl Shadow {
    /// Refuses what no lamp can do, naming the field.
    pub fn validate(&self) -> Result<()> {
        let within = [
            ("elevation_deg", self.elevation_deg, 1.0..=89.0),
            ("strength", self.strength, 0.0..=1.0),
            ("soft_mm", self.soft_mm, 1e-3..=10.0),
        ];
        for (field, value, range) in within {
            if !range.contains(&value) {
                let expected = format!("{} to {}", range.start(), range.end());
                return Err(Error::invalid(format!("light.shadow.{field}"), expected, value.to_string()));
            }
        }
        Ok(())
    }
}

impl Default for LightRig {
    /// A GelSight Mini as its calibration table has it, walls included.
    fn default() -> Self {
        known::mini_by_table()
    }
}

impl LightRig {
    /// Names of the known rigs.
    pub const NAMES: [&str; 3] = ["mini-table", "mini", "cmu"];

    /// One lamp for each channel: its brightness at the frame's centre in counts, and the direction in which
    /// it lights a slope, degrees from x towards y. Background and fall-off are a Mini's.
    pub fn lamps(counts: [f64; 3], towards_deg: [f64; 3]) -> Self {
        Self::of(Lamps::towards(counts, towards_deg))
    }

    /// Lamps over a Mini's frame at rest.
    fn of(Lamps { along_x, along_y }: Lamps) -> Self {
        Self { at_rest: MINI_AT_REST, along_x, along_y, walls: None, pressed: None, shadow: Shadow::default() }
    }

    /// How it answers gentle slopes.
    pub fn response(&self) -> Lamps {
        Lamps { along_x: self.along_x, along_y: self.along_y }
    }

    /// A known rig: `mini-table`, a GelSight Mini's calibration table fitted again, the default; `mini`, a closed form of
    /// it with one direction for each lamp and no walls, farther from real frames; or `cmu`, the lamps of an older
    /// GelSight (fitted on Taxim's table of it).
    pub fn named(name: &str) -> Result<Self> {
        match name {
            "mini-table" => Ok(Self::default()),
            "mini" => Ok(Self::lamps([97.0, 50.0, 53.0], [83.0, -174.0, -97.0])),
            "cmu" => Ok(Self::lamps([65.0, 45.0, 47.0], [178.0, 62.0, -54.0])),
            _ => {
                let got = with_closest(name, Self::NAMES);
                Err(Error::invalid("light", format!("one of {}", Self::NAMES.join(", ")), got))
            }
        }
    }

    /// The same rig with each channel's response `strength` times as strong and turned by `turn_deg` degrees
    /// from x towards y; the frame at rest stays.
    pub fn varied(&self, strength: [f64; 3], turn_deg: [f64; 3]) -> Self {
        let [along_x, along_y] = turned([&self.along_x, &self.along_y], strength, turn_deg);
        let stronger =
            |part: [Quadratic; 3]| [0, 1, 2].map(|c| part[c].map(|factor| (strength[c] * f64::from(factor)) as f32));
        let walls = self.walls.as_ref().map(|walls| {
            let [across, diagonal] = turned([&walls.across, &walls.diagonal], strength, turn_deg.map(|deg| 2.0 * deg));
            Walls { steep: stronger(walls.steep), across, diagonal }
        });
        let pressed = self.pressed.map(stronger);
        Self { at_rest: self.at_rest, along_x, along_y, walls, pressed, shadow: self.shadow }
    }

    /// The same rig with each channel's response `share` times as strong, as a longer or shorter exposure has it; the
    /// frame at rest stays.
    pub fn exposed(&self, share: f32) -> Self {
        self.changed(|factors| factors.map(|channel| channel.map(|counts| share * counts)))
    }

    /// The same rig where each channel gains a share of its response at the frame's middle from there to the border, along x and
    /// along y; the frame at rest stays.
    pub fn fading(&self, uneven: [[f64; 2]; 3]) -> Self {
        self.changed(|part| fading(part, uneven))
    }

    /// The same light as another view of the same gel has it, whose place `u` (-1..=1 in x and y) is at `centre + half * u`
    /// of this one: every factor re-expressed, exactly. A view of the same size about the same middle changes no bit.
    pub fn on_view(&self, centre: [f64; 2], half: [f64; 2]) -> Self {
        let part = |part: &[Quadratic; 3]| part.each_ref().map(|factor| on_view(factor, centre, half));
        Self { at_rest: part(&self.at_rest), ..self.changed(part) }
    }

    /// The same rig with each part of its response changed alike; the frame at rest stays.
    fn changed(&self, part: impl Fn(&[Quadratic; 3]) -> [Quadratic; 3]) -> Self {
        let walls = self.walls.as_ref().map(|walls| Walls {
            steep: part(&walls.steep),
            across: part(&walls.across),
            diagonal: part(&walls.diagonal),
        });
        Self {
            at_rest: self.at_rest,
            along_x: part(&self.along_x),
            along_y: part(&self.along_y),
            walls,
            pressed: self.pressed.as_ref().map(part),
            shadow: self.shadow,
        }
    }

    /// Refuses numbers that no light can be, naming the field.
    pub fn validate(&self) -> Result<()> {
        let walls = self.walls.as_ref();
        let mut fields = vec![("at_rest", &self.at_rest), ("along_x", &self.along_x), ("along_y", &self.along_y)];
        fields.extend(walls.into_iter().flat_map(|walls| {
            [("walls.steep", &walls.steep), ("walls.across", &walls.across), ("walls.diagonal", &walls.diagonal)]
        }));
        fields.extend(self.pressed.iter().map(|pressed| ("pressed", pressed)));
        for (field, factors) in fields {
            if let Some(value) = factors.iter().flatten().find(|value| value.is_nan() || value.abs() > MAX_COUNTS) {
                let expected = format!("at most {MAX_COUNTS} counts either way");
                return Err(Error::invalid(format!("light.{field}"), expected, value.to_string()));
            }
        }
        self.shadow.validate()
    }
}

impl<'de> Deserialize<'de> for LightRig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Factors {
            at_rest: [Quadratic; 3],
            along_x: [Quadratic; 3],
            along_y: [Quadratic; 3],
            walls: Option<Walls>,
            pressed: Option<[Quadratic; 3]>,
            #[serde(default)]
            shadow: Shadow,
        }
        #[derive(Deserialize)]
        #[serde(untagged, expecting = "the name of a light rig, or at_rest, along_x and along_y of each channel")]
        enum Given {
            Named(String),
            Factors(Box<Factors>),
        }
        match Given::deserialize(deserializer)? {
            Given::Named(name) => Self::named(&name).map_err(serde::de::Error::custom),
            Given::Factors(given) => {
                let Factors { at_rest, along_x, along_y, walls, pressed, shadow } = *given;
                Ok(Self { at_rest, along_x, along_y, walls, pressed, shadow })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `atan2` of the response at the frame's centre, degrees.
    fn direction(rig: &LightRig, channel: usize) -> f64 {
        f64::from(rig.along_y[channel][0]).atan2(f64::from(rig.along_x[channel][0])).to_degrees()
    }

    #[test]
    fn a_varied_rig_is_turned_and_scaled() {
        let rig = LightRig::named("mini").unwrap().varied([1.1, 0.9, 1.0], [10.0, -20.0, 0.0]);
        for (channel, (deg, counts)) in [(93.0, 106.7), (166.0, 45.0), (-97.0, 53.0)].into_iter().enumerate() {
            assert!((direction(&rig, channel) - deg).abs() < 1e-4, "{}", direction(&rig, channel));
            let strength = rig.along_x[channel][0].hypot(rig.along_y[channel][0]);
            assert!((f64::from(strength) - counts).abs() < 1e-4);
        }
        // sin^2 theta cos 2 (phi - phi_c) turns by twice the angle.
        let walls = Walls { steep: [[0.0; 6]; 3], across: [[8.0; 6]; 3], diagonal: [[0.0; 6]; 3] };
        let turned = LightRig { walls: Some(walls), ..rig }.varied([1.0; 3], [45.0; 3]).walls.unwrap();
        assert!(turned.across[0][0].abs() < 1e-5 && (turned.diagonal[0][0] - 8.0).abs() < 1e-5);
    }

    #[test]
    fn a_rig_that_fades_otherwise_is_as_it_was_in_the_middle() {
        let rig = LightRig::default();
        let other = rig.fading([[0.3, -0.2], [0.0; 2], [0.0, 0.1]]);
        for (c, [along_x, along_y]) in [[0.3, -0.2], [0.0; 2], [0.0, 0.1]].into_iter().enumerate() {
            for (x, y) in [(0.0, 0.0), (1.0, 0.0), (-0.5, 0.8)] {
                let expected = value(&rig.along_y[c], x, y) + rig.along_y[c][0] * (along_x * x + along_y * y);
                assert!((value(&other.along_y[c], x, y) - expected).abs() < 1e-4, "{c} {x} {y}");
            }
        }
        assert_eq!((rig.fading([[0.0; 2]; 3]), other.at_rest), (rig.clone(), rig.at_rest));
    }

    #[test]
    fn a_place_of_the_gel_has_the_same_light_in_every_view() {
        let flat = |counts: f32| [[counts, 3.0, -5.0, 2.0, 7.0, -4.0]; 3];
        let walls = Walls { steep: flat(25.0), across: flat(-9.0), diagonal: flat(4.0) };
        let rig = LightRig { walls: Some(walls), pressed: Some(flat(-8.0)), ..LightRig::named("cmu").unwrap() };
        assert_eq!(rig.on_view([0.0; 2], [1.0; 2]), rig);
        let (centre, half) = ([0.3, -0.2], [0.6, 1.1]);
        let seen = rig.on_view(centre, half);
        let factors = |rig: &LightRig| {
            let walls = rig.walls.clone().unwrap();
            let pressed = rig.pressed.unwrap();
            [rig.at_rest, rig.along_x, rig.along_y, walls.steep, walls.across, walls.diagonal, pressed].concat()
        };
        for (x, y) in [(-1.0, -1.0), (-0.4, 0.7), (0.0, 0.0), (0.9, -0.3), (1.0, 1.0)] {
            let there = [centre[0] + half[0] * x, centre[1] + half[1] * y].map(|at| at as f32);
            for (own, other) in factors(&rig).iter().zip(factors(&seen)) {
                let (direct, again) = (value(own, there[0], there[1]), value(&other, x as f32, y as f32));
                // Sums of six terms of up to 150 counts in f32.
                assert!((direct - again).abs() < 1e-4, "{direct} {again}");
            }
        }
    }

    #[test]
    fn a_rig_is_read_by_name_or_in_full() {
        #[derive(Debug, PartialEq, Serialize, Deserialize)]
        struct Sensor {
            light: LightRig,
        }
        let cmu: Sensor = toml::from_str("light = \"cmu\"").unwrap();
        assert!((direction(&cmu.light, 1) - 62.0).abs() < 1e-4);
        assert_eq!(toml::from_str::<Sensor>(&toml::to_string(&cmu).unwrap()).unwrap(), cmu);
        let json = serde_json::to_string(&cmu).unwrap();
        assert_eq!(serde_json::from_str::<Sensor>(&json).unwrap(), cmu);
        let error = toml::from_str::<Sensor>("light = \"sun\"").unwrap_err().to_string();
        assert!(error.contains("expected one of mini-table, mini, cmu, got sun"), "{error}");
    }

    #[test]
    fn light_that_is_no_number_is_refused_by_field() {
        let mut rig = LightRig::default();
        rig.along_y[1][2] = f32::NAN;
        assert!(rig.validate().unwrap_err().to_string().starts_with("light.along_y"));
    }
}
