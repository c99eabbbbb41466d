//! What a real camera and a real print add: gain drift, white noise, dust, layer lines, JPEG.

use std::sync::OnceLock;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

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
    /// Share of the light that dust leaves, for each pixel.
    dust: Vec<f32>,
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
            dust: (0..width * height).map(light).collect(),
        }
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
        for (line, dust) in rgb.chunks_exact_mut(row_length).zip(self.dust.chunks_exact(self.size_px[0])) {
            if start + row_length > table.len() {
                start = rng.random_range(0..table.len() - row_length);
            }
            let noise = table[start..start + row_length].as_chunks::<3>().0;
            start += row_length;
            for ((pixel, noise), light) in line.as_chunks_mut::<3>().0.iter_mut().zip(noise).zip(dust) {
                for channel in 0..3 {
                    pixel[channel] =
                        pixel[channel] * gains[channel] * light + self.noise_counts[channel] * noise[channel];
                }
            }
        }
        jpeg::compress(&mut rgb, self.size_px, rng.random_range(self.jpeg_quality[0]..=self.jpeg_quality[1]));
        to_frame(&rgb, self.size_px)
    }
}

/// Rounds counts to bytes.
pub fn to_frame(rgb: &[f32], [width, height]: [usize; 2]) -> Frame {
    let bytes = rgb.iter().map(|value| jpeg::round(value.clamp(0.0, 255.0)) as u8).collect();
    Frame::from_parts(width, height, bytes)
}

/// A unit depth above this is contact: the gel falls below it 0.04 mm beside an edge.
pub const CONTACT: f32 = 0.97;

/// The layer lines of one printed face: fixed for the part, in its own frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LayerLines {
    /// Distance between lines, mm: 0.1 to 0.3, as printers lay them.
    pub pitch_mm: f64,
    /// Direction across the lines in the part's frame, radians.
    pub across_rad: f64,
}

impl LayerLines {
    /// Draws the lines of a part.
    pub fn draw(rng: &mut ChaCha8Rng) -> Self {
        Self { pitch_mm: 0.1 + 0.2 * rng.random::<f64>(), across_rad: std::f64::consts::PI * rng.random::<f64>() }
    }

    /// Raises what is in contact by a wave, as a sensor turned by `sensor_rad` on the part sees it.
    ///
    /// `depths` is `[height + 2, width + 2]` of a unit press; `amplitude` is a share of the press; the
    /// phase of the wave is drawn, since it repeats every few pixels.
    pub fn add(&self, depths: &mut [f32], spec: &SensorSpec, sensor_rad: f64, amplitude: f64, rng: &mut ChaCha8Rng) {
        let (width, mm_per_px) = (spec.frame_px[0] + 2, spec.mm_per_px());
        let phase = std::f64::consts::TAU * rng.random::<f64>();
        let (sin, cos) = (self.across_rad - sensor_rad).sin_cos();
        let k = [cos * mm_per_px[0], sin * mm_per_px[1]].map(|v| v * std::f64::consts::TAU / self.pitch_mm);
        // A wave finer than two pixels is below what the camera resolves.
        let resolved = (1.0 - (k[0].abs().max(k[1].abs()) / std::f64::consts::PI)).clamp(0.0, 1.0);
        let amplitude = (amplitude * resolved) as f32;
        if amplitude < 1e-4 {
            return;
        }
        for (row, line) in depths.chunks_exact_mut(width).enumerate() {
            // sin(a + n k) by rotation: one sine a row.
            let (mut sin, mut cos) = (phase + row as f64 * k[1]).sin_cos();
            let (turn_sin, turn_cos) = k[0].sin_cos();
            for depth in line {
                if *depth > CONTACT {
                    *depth += amplitude * sin as f32;
                }
                (sin, cos) = (sin * turn_cos + cos * turn_sin, cos * turn_cos - sin * turn_sin);
            }
        }
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
