//! The lamps' light on the gel's slopes, in closed form.
//!
//! `dI_c = A_c(x, y) sin(2 theta) cos(phi - phi_c)` with `theta = atan |grad D|` and `phi` the direction
//! of `grad D`, towards deeper gel. Since `sin(2 theta) = 2 g / (1 + g^2)` for a slope `g`, it needs no
//! angle: `dI_c = A_c 2 (g_x cos phi_c + g_y sin phi_c) / (1 + g^2)`.

use super::SensorSpec;

/// `1, x, y, x^2, x y, y^2` over the frame, x and y in -1..=1, x right and y down.
type Quadratic = [f32; 6];

/// The frame at rest: quadratics fitted to a real Mini's no-contact frame, within 2 to 8 counts.
const AT_REST: [Quadratic; 3] = [
    [121.5, -5.9, 24.6, -61.9, 0.1, -65.2],
    [109.4, -2.9, -6.1, -27.3, 1.0, -15.9],
    [133.8, -4.3, -19.3, -42.2, 2.7, -41.7],
];

/// How far each lamp reaches, as a share of its strength at the centre: quadratics through a real
/// calibration table's values at the centre and the four sides.
const FALL_OFF: [Quadratic; 3] =
    [[1.0, 0.0, 0.12, -0.33, 0.0, -0.45], [1.0, 0.0, 0.0, -0.30, 0.0, -0.30], [1.0, 0.0, -0.28, -0.30, 0.0, -0.40]];

/// The lamps of one sensor, worked out for each pixel.
#[derive(Clone, Debug)]
pub struct Optics {
    size_px: [usize; 2],
    /// Interleaved RGB of the frame at rest, counts.
    at_rest: Vec<f32>,
    /// For each pixel and channel `(2 A_c cos phi_c, 2 A_c sin phi_c)`, interleaved.
    lamps: Vec<[f32; 2]>,
}

impl Optics {
    /// Works out background and lamps for each pixel of the sensor's frame.
    pub fn new(spec: &SensorSpec) -> Self {
        let [width, height] = spec.frame_px;
        let (mut at_rest, mut lamps) = (Vec::new(), Vec::new());
        for row in 0..height {
            for column in 0..width {
                let x = (column as f32 + 0.5) / width as f32 * 2.0 - 1.0;
                let y = (row as f32 + 0.5) / height as f32 * 2.0 - 1.0;
                for channel in 0..3 {
                    at_rest.push(value(&AT_REST[channel], x, y).max(2.0));
                    let strength = spec.lamp_counts[channel] as f32 * value(&FALL_OFF[channel], x, y).max(0.1);
                    let (sin, cos) = (spec.lamp_deg[channel].to_radians() as f32).sin_cos();
                    lamps.push([2.0 * strength * cos, 2.0 * strength * sin]);
                }
            }
        }
        Self { size_px: spec.frame_px, at_rest, lamps }
    }

    /// Interleaved RGB of the frame at rest, counts.
    pub fn at_rest(&self) -> &[f32] {
        &self.at_rest
    }

    /// Shades depths `[height + 2, width + 2]` in mm into interleaved RGB counts, not yet clipped.
    pub fn shade(&self, depths: &[f32], mm_per_px: [f64; 2]) -> Vec<f32> {
        let [width, height] = self.size_px;
        let scale = mm_per_px.map(|mm| (0.5 / mm) as f32);
        let mut rgb = self.at_rest.clone();
        for row in 0..height {
            let line = |offset: usize| &depths[(row + offset) * (width + 2)..(row + offset + 1) * (width + 2)];
            let (above, middle, below) = (line(0), line(1), line(2));
            let pixels = rgb[3 * row * width..3 * (row + 1) * width].as_chunks_mut::<3>().0;
            let lamps = self.lamps[3 * row * width..3 * (row + 1) * width].as_chunks::<3>().0;
            for (column, (pixel, lamp)) in pixels.iter_mut().zip(lamps).enumerate() {
                let gx = (middle[column + 2] - middle[column]) * scale[0];
                let gy = (below[column + 1] - above[column + 1]) * scale[1];
                let share = 1.0 / (1.0 + gx * gx + gy * gy);
                for channel in 0..3 {
                    pixel[channel] += (gx * lamp[channel][0] + gy * lamp[channel][1]) * share;
                }
            }
        }
        rgb
    }
}

fn value(k: &Quadratic, x: f32, y: f32) -> f32 {
    k[0] + k[1] * x + k[2] * y + k[3] * x * x + k[4] * x * y + k[5] * y * y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_closed_form_is_the_trigonometric_law() {
        let spec = SensorSpec { frame_px: [9, 9], ..SensorSpec::default() };
        let optics = Optics::new(&spec);
        let (gx, gy) = (0.4_f64, -0.7_f64);
        let mm_per_px = [0.1, 0.2];
        let depths: Vec<f32> =
            (0..11 * 11).map(|i| (gx * 0.1 * f64::from(i % 11) + gy * 0.2 * f64::from(i / 11)) as f32).collect();
        let rgb = optics.shade(&depths, mm_per_px);
        let centre = 4 * 9 + 4;
        let (theta, phi) = (gx.hypot(gy).atan(), gy.atan2(gx));
        for channel in 0..3 {
            let law =
                spec.lamp_counts[channel] * (2.0 * theta).sin() * (phi - spec.lamp_deg[channel].to_radians()).cos();
            let got = f64::from(rgb[3 * centre + channel] - optics.at_rest[3 * centre + channel]);
            // f32 differences of depths of order 1 over 0.2 mm.
            assert!((got - law).abs() < 2e-3, "channel {channel}: {got}, not {law}");
        }
    }

    #[test]
    fn flat_gel_shows_the_frame_at_rest() {
        let spec = SensorSpec { frame_px: [16, 12], ..SensorSpec::default() };
        let optics = Optics::new(&spec);
        assert_eq!(optics.shade(&[0.5; 18 * 14], spec.mm_per_px()), optics.at_rest);
    }

    #[test]
    fn the_frame_at_rest_has_the_means_of_a_real_mini() {
        let optics = Optics::new(&SensorSpec::default());
        for (channel, real) in [79.0, 95.0, 106.0].into_iter().enumerate() {
            let values = optics.at_rest.iter().skip(channel).step_by(3);
            let mean = values.sum::<f32>() / (160.0 * 120.0);
            assert!((mean - real).abs() < 3.0, "channel {channel}: {mean}");
        }
    }
}
