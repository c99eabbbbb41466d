//! The simulated GelSight Mini, a tier a file: geometry, gel, optics, camera, shadow.

pub mod camera;
pub mod exposure;
pub mod gel;
pub mod geometry;
pub mod jpeg;
pub mod light;
pub mod light_field;
pub mod membrane;
pub mod obstacle;
pub mod optics;
pub mod render;
pub(crate) mod rounding;
pub mod shadow;
pub mod simulator;
pub mod touch_map;

use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use strum::{IntoStaticStr, VariantArray};

use crate::error::{Error, Result};
use crate::light::lamps::Lamps;
use crate::text::suggest;
use light::LightRig;
use light_field::LightField;

/// How much of the sensor is computed; each tier includes the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, IntoStaticStr, VariantArray)]
#[serde(rename_all = "lowercase")]
#[strum(serialize_all = "lowercase")]
pub enum Fidelity {
    /// Where the part touches the gel: two grey levels.
    Geometry,
    /// How far the gel is pushed in: grey.
    Gel,
    /// The lamps' colours on the gel's slopes, without noise.
    Optics,
    /// What a real camera adds: gain drift, noise, dust, texture of printed parts, JPEG.
    Camera,
    /// Shadows that the gel's own surface casts, taken by the camera.
    Shadow,
}

impl Fidelity {
    /// All tiers, the cheapest first.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// The tier's name in scene files.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl FromStr for Fidelity {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        suggest::named("fidelity", name, Self::ALL, Self::name)
    }
}

/// Whether a light is known, as it is unless a scene says otherwise.
#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_known(light_known: &bool) -> bool {
    *light_known
}

/// A tactile sensor. The defaults are a GelSight Mini as the paper has it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorSpec {
    /// Width and height of a frame, pixels. The camera gives 320 x 240; half of it is more than the
    /// network sees, at a quarter of the cost.
    pub frame_px: [usize; 2],
    /// Width and height of what a frame shows, mm (paper, Sec. V-A).
    pub field_of_view_mm: [f64; 2],
    /// Decay length of the gel's surface next to a contact, mm.
    pub gel_length_mm: f64,
    /// How deep a part is pressed in, mm.
    pub depth_mm: f64,
    /// Largest deviation of the depth between touches, mm.
    pub depth_jitter_mm: f64,
    /// Largest tilt between touches, degrees.
    pub tilt_jitter_deg: f64,
    /// Largest deviation of the place touched, mm.
    pub place_jitter_mm: f64,
    /// Lamps and the frame at rest.
    pub light: LightRig,
    /// A calibration file, which [`crate::scene::Scene::load`] puts in the place of the light and, where it has
    /// one, the gel length; none once it is read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration: Option<PathBuf>,
    /// Whether the light above is known to those who use the frames, as after a calibration: then pictures are brought
    /// under the lamps that the network knows.
    #[serde(skip_serializing_if = "is_known")]
    pub light_known: bool,
    /// Counts of the lamps and of the frame at rest as a share of the counts that `light` states: half an exposure is
    /// 0.5. What is read out on top of the light, its noise, stays.
    #[serde(skip_serializing_if = "is_whole")]
    pub exposure: f64,
    /// Where the middle of this sensor's view is in the calibrated frame, mm right of and below its middle; without it they
    /// are the same. None once the calibration is read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub calibration_centre_mm: Option<[f64; 2]>,
    /// Standard deviation of the white noise of each channel, counts.
    pub noise_counts: [f64; 3],
    /// Worst and best JPEG quality.
    pub jpeg_quality: [u8; 2],
    /// Lowest and highest amplitude of a printed part's layer lines, mm.
    pub texture_mm: [f64; 2],
    /// Specks of dust on the gel.
    pub n_specks: usize,
    /// The smooth change of the whole picture that comes with a press.
    pub light_field: LightField,
    /// Seed of what is fixed for one sensor: its specks.
    pub seed: u64,
}

fn is_whole(share: &f64) -> bool {
    *share == 1.0
}

impl Default for SensorSpec {
    fn default() -> Self {
        Self {
            frame_px: [160, 120],
            field_of_view_mm: [18.6, 14.3],
            // Fitted on real flat punches and spheres: a flat optimum between 0.8 and 1.8.
            gel_length_mm: 1.2,
            depth_mm: 0.6,
            depth_jitter_mm: 0.1,
            tilt_jitter_deg: 0.5,
            place_jitter_mm: 0.05,
            light: LightRig::default(),
            calibration: None,
            light_known: true,
            exposure: 1.0,
            calibration_centre_mm: None,
            noise_counts: [1.8, 1.8, 2.5],
            jpeg_quality: [75, 90],
            texture_mm: [0.0, 0.02],
            n_specks: 12,
            light_field: LightField::FITTED,
            seed: 0,
        }
    }
}

/// Shortest and longest exposure, as shares: darker is noise, brighter is white.
const EXPOSURES: std::ops::RangeInclusive<f64> = 0.1..=4.0;

/// More specks of dust than this leave nothing of a frame.
const MOST_SPECKS: usize = 10_000;

impl SensorSpec {
    /// Refuses what no sensor can be, naming the field.
    pub fn validate(&self) -> Result<()> {
        let [width, height] = self.frame_px;
        if !(8..=4_096).contains(&width) || !(8..=4_096).contains(&height) {
            return Err(Error::invalid("sensor.frame_px", "8..=4096 pixels a side", format!("{width}x{height}")));
        }
        let positive = [
            ("field_of_view_mm", self.field_of_view_mm[0].min(self.field_of_view_mm[1])),
            ("gel_length_mm", self.gel_length_mm),
            ("depth_mm", self.depth_mm),
        ];
        let not_negative = [
            ("depth_jitter_mm", self.depth_jitter_mm),
            ("tilt_jitter_deg", self.tilt_jitter_deg),
            ("place_jitter_mm", self.place_jitter_mm),
            ("texture_mm", self.texture_mm[0].min(self.texture_mm[1] - self.texture_mm[0])),
            ("noise_counts", self.noise_counts.into_iter().fold(f64::INFINITY, f64::min)),
        ];
        for (field, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(Error::invalid(format!("sensor.{field}"), "a positive length", value.to_string()));
            }
        }
        for (field, value) in not_negative {
            if !(value.is_finite() && value >= 0.0) {
                return Err(Error::invalid(format!("sensor.{field}"), "0 or more, in order", value.to_string()));
            }
        }
        if !EXPOSURES.contains(&self.exposure) {
            let expected = format!("{} to {}", EXPOSURES.start(), EXPOSURES.end());
            return Err(Error::invalid("sensor.exposure", expected, self.exposure.to_string()));
        }
        if self.n_specks > MOST_SPECKS {
            let expected = format!("at most {MOST_SPECKS}");
            return Err(Error::invalid("sensor.n_specks", expected, self.n_specks.to_string()));
        }
        let [worst, best] = self.jpeg_quality;
        if !(1..=100).contains(&worst) || !(worst..=100).contains(&best) {
            return Err(Error::invalid("sensor.jpeg_quality", "1..=100 in order", format!("{worst}..{best}")));
        }
        self.light_field.validate()?;
        self.light.validate()
    }

    /// The lamps as they answer gentle slopes at this exposure, where they are known and differ from the lamps that the
    /// network knows ([`Lamps::default`]).
    pub fn known_lamps(&self) -> Option<Lamps> {
        let lamps = self.light.exposed(self.exposure as f32).response();
        (self.light_known && lamps != Lamps::default()).then_some(lamps)
    }

    /// Size of a pixel in x and y, mm.
    pub fn mm_per_px(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.field_of_view_mm[axis] / self.frame_px[axis] as f64)
    }
}
