//! The lamps' light on the gel's slopes: depths to colours.

use multiversion::multiversion;

use super::SensorSpec;
use super::light::{LightRig, Quadratic, value};
use crate::error::{Error, Result};
use crate::frame::Frame;

/// The light of one sensor on frames of one size.
#[derive(Clone, Debug)]
pub struct Optics {
    size_px: [usize; 2],
    /// Interleaved RGB of the frame at rest, counts.
    at_rest: Vec<f32>,
    rig: LightRig,
}

impl Optics {
    /// Computes the frame at rest and the lamps, both at the sensor's exposure.
    pub fn new(spec: &SensorSpec) -> Self {
        let [width, height] = spec.frame_px;
        let exposure = spec.exposure as f32;
        let rest = |i: usize| {
            let (x, y) = (place(i % width, width), place(i / width, height));
            spec.light.at_rest.iter().map(move |channel| exposure * value(channel, x, y).max(2.0))
        };
        let at_rest = (0..width * height).flat_map(rest).collect();
        Self { size_px: spec.frame_px, at_rest, rig: spec.light.exposed(exposure) }
    }

    /// The same light over a real sensor's no-contact frame, of the same size and already at the sensor's exposure.
    pub fn over(mut self, no_contact: &Frame) -> Result<Self> {
        let [width, height] = self.size_px;
        let got = [no_contact.width_px(), no_contact.height_px()];
        if got != self.size_px {
            let expected = format!("{width}x{height} pixels");
            return Err(Error::invalid("no-contact frame", expected, format!("{}x{}", got[0], got[1])));
        }
        self.at_rest = no_contact.rgb().iter().map(|counts| f32::from(*counts)).collect();
        Ok(self)
    }

    /// Interleaved RGB of the frame at rest, counts.
    pub fn at_rest(&self) -> &[f32] {
        &self.at_rest
    }

    /// Width and height of a frame, pixels.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// The lamps.
    pub fn rig(&self) -> &LightRig {
        &self.rig
    }

    /// Shades depths `[height + 2, width + 2]` in mm into interleaved RGB counts, not yet clipped.
    pub fn shade(&self, depths: &[f32], mm_per_px: [f64; 2]) -> Vec<f32> {
        let [width, height] = self.size_px;
        let scale = mm_per_px.map(|mm| (0.5 / mm) as f32);
        let mut rgb = self.at_rest.clone();
        // Basis functions of one row, then one channel's change, planar: loops that vectorise.
        let mut bases = vec![0.0; 5 * width];
        let mut change = vec![0.0; width];
        let n_bases = if self.rig.walls.is_some() { 5 } else { 2 };
        for (row, line) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let y = place(row, height);
            slopes(&depths[row * (width + 2)..(row + 3) * (width + 2)], scale, &mut bases[..n_bases * width]);
            for channel in 0..3 {
                change.fill(0.0);
                let walls = self.rig.walls.iter().flat_map(|walls| [&walls.steep, &walls.across, &walls.diagonal]);
                let factors = [&self.rig.along_x, &self.rig.along_y].into_iter().chain(walls);
                for (factors, basis) in factors.zip(bases.chunks_exact(width)) {
                    answer(&factors[channel], y, basis, &mut change);
                }
                if let Some(pressed) = &self.rig.pressed {
                    let middle = &depths[(row + 1) * (width + 2) + 1..][..width];
                    answer(&pressed[channel], y, middle, &mut change);
                }
                for (pixel, change) in line.as_chunks_mut::<3>().0.iter_mut().zip(&change) {
                    pixel[channel] += change;
                }
            }
        }
        rgb
    }
}

/// Where the middle of one of `n` pixels is in the frame, -1..=1.
fn place(pixel: usize, n: usize) -> f32 {
    (pixel as f32 + 0.5) / n as f32 * 2.0 - 1.0
}

/// The basis functions of [`LightRig`] for a row, one after another: the first two or all five, as
/// `bases` has room. `depths` holds the row above, its own and the one below, each with its margin.
#[multiversion(targets("x86_64+avx2"))]
fn slopes(depths: &[f32], scale: [f32; 2], bases: &mut [f32]) {
    let width = depths.len() / 3 - 2;
    let (above, rest) = depths.split_at(width + 2);
    let (middle, below) = rest.split_at(width + 2);
    let (left, right) = (&middle[..width], &middle[2..]);
    let (above, below) = (&above[1..=width], &below[1..=width]);
    let (first, rest) = bases.split_at_mut(width);
    let (second, walls) = rest.split_at_mut(width);
    for i in 0..width {
        let (gx, gy) = ((right[i] - left[i]) * scale[0], (below[i] - above[i]) * scale[1]);
        let share = 2.0 / (1.0 + gx * gx + gy * gy);
        first[i] = gx * share;
        second[i] = gy * share;
    }
    if walls.is_empty() {
        return;
    }
    let (steep, rest) = walls.split_at_mut(width);
    let (across, diagonal) = rest.split_at_mut(width);
    for i in 0..width {
        let (gx, gy) = ((right[i] - left[i]) * scale[0], (below[i] - above[i]) * scale[1]);
        let share = 1.0 / (1.0 + gx * gx + gy * gy);
        steep[i] = (gx * gx + gy * gy) * share;
        across[i] = (gx * gx - gy * gy) * share;
        diagonal[i] = 2.0 * gx * gy * share;
    }
}

/// Adds to a row's `change` the answer to one basis function.
#[multiversion(targets("x86_64+avx2"))]
fn answer(factors: &Quadratic, y: f32, basis: &[f32], change: &mut [f32]) {
    // Along a row the quadratic is one of x alone.
    let constant = factors[0] + factors[2] * y + factors[5] * y * y;
    let linear = factors[1] + factors[4] * y;
    let square = factors[3];
    let (step, first) = (2.0 / change.len() as f32, 1.0 / change.len() as f32 - 1.0);
    for (i, (change, basis)) in change.iter_mut().zip(basis).enumerate() {
        let x = first + step * i as f32;
        *change += (constant + (linear + square * x) * x) * basis;
    }
}

#[cfg(test)]
mod tests {
    use super::super::light::Walls;
    use super::*;

    /// Depths of a plane of one slope.
    fn plane([gx, gy]: [f64; 2], [width, height]: [usize; 2], mm_per_px: [f64; 2]) -> Vec<f32> {
        let depth =
            |i: usize| gx * mm_per_px[0] * (i % (width + 2)) as f64 + gy * mm_per_px[1] * (i / (width + 2)) as f64;
        (0..(width + 2) * (height + 2)).map(|i| depth(i) as f32).collect()
    }

    #[test]
    fn the_closed_form_is_the_trigonometric_law() {
        let (counts, deg) = ([97.0, 50.0, 53.0], [83.0, -174.0, -97.0]);
        let spec = SensorSpec { frame_px: [9, 9], light: LightRig::lamps(counts, deg), ..SensorSpec::default() };
        let optics = Optics::new(&spec);
        let (gx, gy) = (0.4_f64, -0.7_f64);
        let rgb = optics.shade(&plane([gx, gy], [9, 9], [0.1, 0.2]), [0.1, 0.2]);
        let centre = 4 * 9 + 4;
        let (theta, phi) = (gx.hypot(gy).atan(), gy.atan2(gx));
        for channel in 0..3 {
            let law = counts[channel] * (2.0 * theta).sin() * (phi - f64::to_radians(deg[channel])).cos();
            let got = f64::from(rgb[3 * centre + channel] - optics.at_rest[3 * centre + channel]);
            // f32 differences of depths of order 1 over 0.2 mm.
            assert!((got - law).abs() < 2e-3, "channel {channel}: {got}, not {law}");
        }
    }

    #[test]
    fn walls_add_the_second_order_and_the_place_counts() {
        let mut steep = [[0.0; 6]; 3];
        steep[0] = [0.0, 3.0, 5.0, 7.0, 11.0, 13.0];
        let walls = Walls { steep, across: [[20.0, 0.0, 0.0, 0.0, 0.0, 0.0]; 3], diagonal: [[0.0; 6]; 3] };
        let light = LightRig { walls: None, ..LightRig::default() };
        let mini = SensorSpec { frame_px: [12, 10], light: light.clone(), ..SensorSpec::default() };
        let spec = SensorSpec { light: LightRig { walls: Some(walls), ..light }, ..mini.clone() };
        let slope = [0.9_f64, 0.5];
        let depths = plane(slope, [12, 10], [0.1, 0.1]);
        let added: Vec<f32> = (Optics::new(&spec).shade(&depths, [0.1, 0.1]).iter())
            .zip(Optics::new(&mini).shade(&depths, [0.1, 0.1]))
            .map(|(with, without)| with - without)
            .collect();
        let theta = slope[0].hypot(slope[1]).atan();
        let cos_2_phi = (2.0 * slope[1].atan2(slope[0])).cos();
        for (column, row) in [(0_usize, 0_usize), (11, 9), (5, 2)] {
            let (x, y) = ((column as f64 + 0.5) / 6.0 - 1.0, (row as f64 + 0.5) / 5.0 - 1.0);
            let steep = 3.0 * x + 5.0 * y + 7.0 * x * x + 11.0 * x * y + 13.0 * y * y;
            let law = theta.sin().powi(2) * (steep + 20.0 * cos_2_phi);
            assert!((f64::from(added[3 * (row * 12 + column)]) - law).abs() < 2e-3);
        }
    }

    #[test]
    fn what_is_pressed_in_and_level_changes_by_its_depth() {
        let pressed = [[-8.0, 2.0, 0.0, 0.0, 0.0, 0.0], [0.0; 6], [3.0, 0.0, 0.0, 0.0, 0.0, 1.0]];
        let light = LightRig { pressed: Some(pressed), ..LightRig::default() };
        let spec = SensorSpec { frame_px: [16, 12], light, ..SensorSpec::default() };
        let optics = Optics::new(&spec);
        let rgb = optics.shade(&[0.5; 18 * 14], spec.mm_per_px());
        for (column, row) in [(0_usize, 0_usize), (15, 3), (7, 11)] {
            let (x, y) = ((column as f32 + 0.5) / 8.0 - 1.0, (row as f32 + 0.5) / 6.0 - 1.0);
            let law = [0.5 * (-8.0 + 2.0 * x), 0.0, 0.5 * (3.0 + y * y)];
            for (channel, law) in law.into_iter().enumerate() {
                let at = 3 * (row * 16 + column) + channel;
                assert!((rgb[at] - optics.at_rest[at] - law).abs() < 1e-4, "{column}, {row}, channel {channel}");
            }
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

    #[test]
    fn half_an_exposure_halves_the_frame_at_rest_and_what_a_slope_adds() {
        let light = LightRig {
            walls: Some(Walls {
                steep: [[20.0, 1.0, 0.0, -3.0, 0.0, 0.0]; 3],
                across: [[-7.0, 0.0, 0.0, 0.0, 0.0, 0.0]; 3],
                diagonal: [[4.0, 0.0, 2.0, 0.0, 0.0, 0.0]; 3],
            }),
            ..LightRig::default()
        };
        let spec = SensorSpec { frame_px: [12, 10], light, ..SensorSpec::default() };
        let depths = plane([0.9, -0.5], [12, 10], [0.1, 0.1]);
        let shaded = |exposure| Optics::new(&SensorSpec { exposure, ..spec.clone() }).shade(&depths, [0.1, 0.1]);
        for (half, whole) in shaded(0.5).iter().zip(shaded(1.0)) {
            // Rounding of f32 near 256 counts.
            assert!((2.0 * half - whole).abs() < 1e-3, "{half} of {whole}");
        }
    }

    #[test]
    fn a_no_contact_frame_takes_the_place_of_the_model_s() {
        let spec = SensorSpec { frame_px: [8, 8], ..SensorSpec::default() };
        let frame = Frame::from_parts(8, 8, (0..192).collect());
        let optics = Optics::new(&spec).over(&frame).unwrap();
        assert_eq!(optics.shade(&[0.0; 100], spec.mm_per_px())[100], 100.0);
        let other = Frame::from_parts(4, 4, vec![9; 48]);
        assert!(Optics::new(&spec).over(&other).unwrap_err().to_string().contains("8x8 pixels, got 4x4"));
    }
}
