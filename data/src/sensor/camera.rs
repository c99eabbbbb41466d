//! What a real camera and a real print add: gain drift, white noise, dust, layer lines, JPEG.

use std::sync::{Arc, OnceLock};

use multiversion::multiversion;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

use super::gel::TiltedPress;
use super::light_field::LightField;
use super::rounding::to_byte;
use super::{SensorSpec, jpeg};
use crate::frame::Frame;

/// A dark spot on the gel, the same in every frame of one sensor.
#[derive(Clone, Copy, Debug)]
struct Speck {
    at_px: [f64; 2],
    radius_px: f64,
    depth: f32,
}

/// One sensor's camera.
#[derive(Clone, Debug)]
pub struct Camera {
    size_px: [usize; 2],
    noise_counts: [f32; 3],
    jpeg_quality: [u8; 2],
    light_field: LightField,
    /// Share of the light that dust leaves, for each pixel and channel.
    dust: Arc<[f32]>,
}

/// Normal variates drawn once; a frame reads them from a random place on, which is a thousand times
/// cheaper than drawing and, at a quarter of a million, never the same twice in a row.
fn normals() -> &'static [f32] {
    static NORMALS: OnceLock<Vec<f32>> = OnceLock::new();
    NORMALS.get_or_init(|| {
        let mut rng = ChaCha8Rng::seed_from_u64(0x6e6f_726d);
        (0..1 << 18).map(|_| StandardNormal.sample(&mut rng)).collect()
    })
}

impl Camera {
    /// A camera with the specks of its sensor's seed.
    pub fn new(spec: &SensorSpec) -> Self {
        let [width, height] = spec.frame_px;
        let mut rng = ChaCha8Rng::seed_from_u64(spec.seed);
        let specks: Vec<Speck> = (0..spec.n_specks)
            .map(|_| Speck {
                at_px: [rng.random::<f64>() * width as f64, rng.random::<f64>() * height as f64],
                radius_px: (0.3 + 0.7 * rng.random::<f64>()) * width as f64 / 160.0,
                depth: 0.1 + 0.25 * rng.random::<f32>(),
            })
            .collect();
        let light = |i: usize| {
            let (x, y) = ((i % width) as f64, (i / width) as f64);
            let shade = |s: &Speck| {
                let distance = (x - s.at_px[0]).hypot(y - s.at_px[1]) / s.radius_px;
                1.0 - s.depth * (-0.5 * distance * distance).exp() as f32
            };
            specks.iter().map(shade).product()
        };
        Self {
            size_px: spec.frame_px,
            noise_counts: spec.noise_counts.map(|n| n as f32),
            jpeg_quality: spec.jpeg_quality,
            light_field: spec.light_field,
            dust: (0..width * height).flat_map(|i| [light(i); 3]).collect(),
        }
    }

    /// The same camera and dust, with the noise, compression and light field of another sensor of this size.
    #[must_use]
    pub fn varied(&self, spec: &SensorSpec) -> Self {
        Self {
            size_px: self.size_px,
            noise_counts: spec.noise_counts.map(|n| n as f32),
            jpeg_quality: spec.jpeg_quality,
            light_field: spec.light_field,
            dust: self.dust.clone(),
        }
    }

    /// Adds what a press changes over the whole picture; `depth_mm` is its deepest point in view.
    pub fn add_light_field(&self, rgb: &mut [f32], depth_mm: f64, rng: &mut ChaCha8Rng) {
        self.light_field.add(rgb, self.size_px, depth_mm, rng);
    }

    /// Takes the picture: shaded RGB counts to a frame.
    ///
    /// Gain drift as measured on real sensors: common N(1, 0.03), a quarter of the time 1.05..1.18,
    /// and N(0, 0.01) for each channel.
    pub fn expose(&self, mut rgb: Vec<f32>, rng: &mut ChaCha8Rng) -> Frame {
        let mut normal = || -> f32 { StandardNormal.sample(rng) };
        let drift = 1.0 + 0.03 * normal();
        let channels = [0, 1, 2].map(|_| 0.01 * normal());
        let common = if rng.random_bool(0.25) { 1.05 + 0.13 * rng.random::<f32>() } else { drift };
        let gains = channels.map(|channel| common + channel);
        let table = normals();
        let mut start = rng.random_range(0..table.len());
        let row_length = 3 * self.size_px[0];
        let pattern = |values: [f32; 3]| -> Vec<f32> { (0..row_length).map(|i| values[i % 3]).collect() };
        let (gains, noise_counts) = (pattern(gains), pattern(self.noise_counts));
        for (line, dust) in rgb.chunks_exact_mut(row_length).zip(self.dust.chunks_exact(row_length)) {
            if start + row_length > table.len() {
                start = rng.random_range(0..table.len() - row_length);
            }
            expose_row(line, &gains, dust, &noise_counts, &table[start..start + row_length]);
            start += row_length;
        }
        let quality = rng.random_range(self.jpeg_quality[0]..=self.jpeg_quality[1]);
        let [width, height] = self.size_px;
        Frame::from_parts(width, height, jpeg::compress(&rgb, self.size_px, quality))
    }
}

/// Gain and noise on a row, a value for each pixel and channel.
#[multiversion(targets("x86_64+avx2"))]
fn expose_row(line: &mut [f32], gains: &[f32], dust: &[f32], noise_counts: &[f32], normals: &[f32]) {
    let factors = gains.iter().zip(dust).zip(noise_counts.iter().zip(normals));
    for (value, ((gain, light), (counts, normal))) in line.iter_mut().zip(factors) {
        *value = *value * gain * light + counts * normal;
    }
}

/// Rounds counts to bytes.
pub fn to_frame(rgb: &[f32], [width, height]: [usize; 2]) -> Frame {
    let mut bytes = vec![0; rgb.len()];
    round(rgb, &mut bytes);
    Frame::from_parts(width, height, bytes)
}

#[multiversion(targets("x86_64+avx2"))]
fn round(counts: &[f32], bytes: &mut [u8]) {
    bytes.iter_mut().zip(counts).for_each(|(byte, counts)| *byte = to_byte(*counts));
}

/// A depth above this share of the press is contact: the gel falls below it 0.04 mm from an edge.
const CONTACT: f32 = 0.97;

/// The layer lines of one printed face: fixed for the part, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerLines {
    /// Distance between lines, mm: 0.1 to 0.3, as printers make them.
    pub pitch_mm: f64,
    /// Direction across the lines in the part's frame, radians.
    pub across_rad: f64,
}

impl LayerLines {
    /// Draws the lines of a part.
    pub fn draw(rng: &mut ChaCha8Rng) -> Self {
        Self { pitch_mm: 0.1 + 0.2 * rng.random::<f64>(), across_rad: std::f64::consts::PI * rng.random::<f64>() }
    }

    /// The wave that a sensor turned by `sensor_rad` on the part sees. Its amplitude and phase are drawn: the
    /// lines repeat every few pixels.
    pub fn seen(&self, spec: &SensorSpec, sensor_rad: f64, rng: &mut ChaCha8Rng) -> Wave {
        let [lowest, highest] = spec.texture_mm;
        let amplitude_mm = lowest + (highest - lowest) * rng.random::<f64>();
        let phase_rad = std::f64::consts::TAU * rng.random::<f64>();
        let mm_per_px = spec.mm_per_px();
        let (sin, cos) = (self.across_rad - sensor_rad).sin_cos();
        let k = [cos * mm_per_px[0], sin * mm_per_px[1]].map(|v| v * std::f64::consts::TAU / self.pitch_mm);
        // A wave finer than two pixels is below what the camera resolves.
        let resolved = (1.0 - (k[0].abs().max(k[1].abs()) / std::f64::consts::PI)).clamp(0.0, 1.0);
        Wave { amplitude_mm: amplitude_mm * resolved, phase_rad, rad_per_px: k }
    }
}

/// Layer lines as one frame shows them.
#[derive(Clone, Copy, Debug)]
pub struct Wave {
    amplitude_mm: f64,
    phase_rad: f64,
    /// How fast its angle grows in x and y, radians a pixel.
    rad_per_px: [f64; 2],
}

impl Wave {
    /// Raises what is in contact. `depths` is `[height + 2, width + 2]` in mm of a `press`, as
    /// [`Surface::depths`](super::gel::Surface::depths) gives it.
    pub fn raise(&self, depths: &mut [f32], spec: &SensorSpec, press: TiltedPress) {
        let Self { amplitude_mm, phase_rad, rad_per_px: k } = *self;
        if amplitude_mm < 1e-5 {
            return;
        }
        let (width, mm_per_px) = (spec.frame_px[0] + 2, spec.mm_per_px());
        // sin(a + n k) = sin a cos n k + cos a sin n k: one sine a row and one a column.
        let columns: Vec<[f32; 2]> = (0..width)
            .map(|column| (column as f64 * k[0]).sin_cos())
            .map(|(sin, cos)| [amplitude_mm * cos, amplitude_mm * sin].map(|v| v as f32))
            .collect();
        let step = (press.tilt[0] * mm_per_px[0]) as f32;
        for (row, line) in depths.chunks_exact_mut(width).enumerate() {
            let y_mm = (row as f64 - 0.5 * (spec.frame_px[1] + 1) as f64) * mm_per_px[1];
            let x_mm = -0.5 * (width - 1) as f64 * mm_per_px[0];
            let (sin, cos) = (phase_rad + row as f64 * k[1]).sin_cos();
            raise(line, &columns, [sin as f32, cos as f32], [press.at(x_mm, y_mm) as f32, step]);
        }
    }
}

/// Adds a wave to a row where it is in contact; the press is `press[0]` at its first pixel and `press[1]`
/// more at each next one.
#[multiversion(targets("x86_64+avx2"))]
fn raise(line: &mut [f32], columns: &[[f32; 2]], row: [f32; 2], press: [f32; 2]) {
    for (i, (depth, column)) in line.iter_mut().zip(columns).enumerate() {
        let wave = row[0] * column[0] + row[1] * column[1];
        let touches = *depth > CONTACT * (press[0] + i as f32 * press[1]).max(0.0);
        *depth += if touches { wave } else { 0.0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flat_field_comes_back_with_the_stated_noise() {
        let spec = SensorSpec { n_specks: 0, jpeg_quality: [100, 100], ..SensorSpec::default() };
        let camera = Camera::new(&spec);
        let frame = camera.expose(vec![100.0; 3 * 160 * 120], &mut ChaCha8Rng::seed_from_u64(3));
        let green: Vec<f64> = frame.rgb().iter().skip(1).step_by(3).map(|v| f64::from(*v)).collect();
        let mean = green.iter().sum::<f64>() / green.len() as f64;
        let deviation = (green.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / green.len() as f64).sqrt();
        assert!((85.0..120.0).contains(&mean));
        // 1.8 counts, with rounding's 0.29 added in quadrature and some chroma lost to halving.
        assert!((deviation - 1.8).abs() < 0.4, "{deviation}");
    }

    #[test]
    fn dust_is_the_same_in_every_frame() {
        let spec = SensorSpec { noise_counts: [0.0; 3], ..SensorSpec::default() };
        assert_eq!(Camera::new(&spec).dust, Camera::new(&spec).dust);
        assert!(Camera::new(&spec).dust.iter().any(|light| *light < 0.95));
    }
}
