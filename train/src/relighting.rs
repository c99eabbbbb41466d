//! Mirrored pictures, lit as the lamps at their real places would light them.
//!
//! A mirrored picture shows a possible shape, but lit from a direction without a lamp. To first order a channel
//! changes with the gel's slope, `D = A g` with a 3 x 2 matrix `A` of lamps, so that mirroring x must give
//! `A diag(-1, 1) A^+ D` of the mirrored picture; what is outside the lamps' plane (noise, the walls' own
//! brightness) does not change. `A` is computed from the frames ([`Response`]), up to a factor that cancels.

use tactile_data::frame::{Preprocessing, TactileImage};
use tactile_data::light::touch_light::curl::{Moments, Response};

use crate::error::{Error, Result};

/// A 3 x 3 matrix and an offset, for normalised channel values.
pub type Affine = [[f32; 4]; 3];

/// How the colours of a mirrored picture change.
#[derive(Clone, Debug, PartialEq)]
pub struct Relighting {
    /// For red, green and blue the change with a slope along x and along y, up to one common factor.
    lamps: [[f64; 2]; 3],
    flip_x: Affine,
    flip_y: Affine,
    both: Affine,
}

impl Relighting {
    /// Finds the lamps in difference images in counts ([`Preprocessing::counts`]) of `mm_per_px`.
    /// `preprocessing` has the mean and deviation of the values that will be relit.
    ///
    /// # Errors
    /// Frames in which noise hides the slopes of a surface.
    pub fn fit(images: &[TactileImage], mm_per_px: [f64; 2], preprocessing: &Preprocessing) -> Result<Self> {
        let moments: Vec<Moments> = images.iter().map(|image| Moments::of(image, mm_per_px)).collect();
        let response = Response::of(&Moments::sum(&moments));
        if !response.is_known() {
            let share = response.curl_share;
            let got = format!("slopes whose curl is {share:.2} of that of other axes; use --set flips=plain");
            return Err(Error::invalid("flips relit", "frames that show how the lamps light a slope", got));
        }
        let Response { lamps, slopes, .. } = response;
        let affine = |turned: [bool; 2]| -> Affine {
            // I - 2 A diag(turned) A^+ on counts, then on normalised values.
            let on_counts = |i: usize, j: usize| {
                let change: f64 =
                    (0..2).filter(|axis| turned[*axis]).map(|axis| lamps[i][axis] * slopes[axis][j]).sum();
                f64::from(u8::from(i == j)) - 2.0 * change
            };
            let (mean, std) = (preprocessing.mean.map(f64::from), preprocessing.std.map(f64::from));
            [0, 1, 2].map(|i| {
                let offset = (0..3).map(|j| on_counts(i, j) * mean[j]).sum::<f64>() - mean[i];
                let row = [0, 1, 2].map(|j| (on_counts(i, j) * std[j] / std[i]) as f32);
                [row[0], row[1], row[2], (offset / std[i]) as f32]
            })
        };
        Ok(Self { lamps, flip_x: affine([true, false]), flip_y: affine([false, true]), both: affine([true, true]) })
    }

    /// For red, green and blue the line along which the lamp lights a slope, degrees from x towards y, 0..180. The
    /// frames do not show at which end the lamp is, and flips do not need it.
    pub fn lines_deg(&self) -> [f64; 3] {
        self.lamps.map(|[x, y]| y.atan2(x).to_degrees().rem_euclid(180.0))
    }

    /// How the colours of a picture change that was mirrored; `None` where it was not.
    pub fn of_flips(&self, flip_x: bool, flip_y: bool) -> Option<&Affine> {
        match (flip_x, flip_y) {
            (false, false) => None,
            (true, false) => Some(&self.flip_x),
            (false, true) => Some(&self.flip_y),
            (true, true) => Some(&self.both),
        }
    }

    /// Relights a picture that was mirrored: `[3, height, width]` normalised values, in place.
    pub fn apply(&self, flip_x: bool, flip_y: bool, planes: &mut [f32]) {
        let Some(affine) = self.of_flips(flip_x, flip_y) else { return };
        let (red, rest) = planes.split_at_mut(planes.len() / 3);
        let (green, blue) = rest.split_at_mut(rest.len() / 2);
        for ((r, g), b) in red.iter_mut().zip(green).zip(blue) {
            let old = [*r, *g, *b];
            let new = affine.map(|row| row[0] * old[0] + row[1] * old[1] + row[2] * old[2] + row[3]);
            [*r, *g, *b] = new;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use tactile_data::dataset::touch::Side;
    use tactile_data::frame::Background;
    use tactile_data::pose::se2::Se2;
    use tactile_data::scene::shape::Relief;
    use tactile_data::scene::shape::glyph::glyph;
    use tactile_data::sensor::render::{Press, render};
    use tactile_data::sensor::{Fidelity, SensorSpec};

    const SIZE: [usize; 2] = [40, 30];

    /// The difference image of a surface of bumps under lamps, linear in its slope.
    fn bumps(lamps: &[[f64; 2]; 3], seed: f64, mirror: f64) -> TactileImage {
        let waves = [[0.5, 0.3], [0.2, -0.6], [0.4, 0.0], [-0.3, 0.4], [0.1, 0.5]];
        let slope = |x: f64, y: f64| {
            let mut slope = [0.0; 2];
            for (i, [kx, ky]) in waves.into_iter().enumerate() {
                let wave = (kx * mirror * x + ky * y + (i + 1) as f64 * seed).cos();
                slope = [slope[0] + kx * mirror * wave, slope[1] + ky * wave];
            }
            slope
        };
        let plane = |c: usize| {
            (0..SIZE[0] * SIZE[1]).map(move |i| {
                let (x, y) = ((i % SIZE[0]) as f64 - 19.5, (i / SIZE[0]) as f64 - 14.5);
                let [gx, gy] = slope(x, y);
                (20.0 * (lamps[c][0] * gx + lamps[c][1] * gy)) as f32
            })
        };
        TactileImage { size_px: SIZE, planes: (0..3).flat_map(plane).collect(), edge_share: 1.0 }
    }

    #[test]
    fn lamps_are_found_in_frames_and_a_mirrored_surface_is_lit_right() {
        let lamps = [[0.2, 1.9], [-1.0, -0.1], [-0.3, -1.2]];
        let images: Vec<_> = (0..20).map(|i| bumps(&lamps, f64::from(i), 1.0)).collect();
        let preprocessing =
            Preprocessing { mean: [1.0, -2.0, 0.5], std: [4.0, 2.0, 3.0], ..Preprocessing::counts(SIZE) };
        let relighting = Relighting::fit(&images, [1.0, 1.0], &preprocessing).unwrap();
        // atan2(1.9, 0.2), and the ends that point to positive y of (-1, -0.1) and (-0.3, -1.2).
        for (found, deg) in relighting.lines_deg().into_iter().zip([84.0, 5.7, 76.0]) {
            assert!((found - deg).abs() < 3.0, "{:?}", relighting.lines_deg());
        }
        let factor = relighting.lamps[1][0] / lamps[1][0];
        for (found, lamp) in relighting.lamps.iter().zip(lamps) {
            for (found, lamp) in found.iter().zip(lamp) {
                // Central differences of waves of 10 px leave a few per cent of curl.
                assert!((found / factor - lamp).abs() < 0.05, "{:?}", relighting.lamps);
            }
        }
        let normal = |planes: &[f32]| -> Vec<f32> {
            let n = planes.len() / 3;
            planes.iter().enumerate().map(|(i, p)| (p - preprocessing.mean[i / n]) / preprocessing.std[i / n]).collect()
        };
        let mut lit = normal(&images[3].planes);
        lit.chunks_exact_mut(SIZE[0]).for_each(<[f32]>::reverse);
        relighting.apply(true, false, &mut lit);
        let truth = normal(&bumps(&lamps, 3.0, -1.0).planes);
        assert!(lit.iter().zip(&truth).all(|(a, b)| (a - b).abs() < 0.5), "{:?}", &lit[..5]);
    }

    #[test]
    fn noise_shows_no_lamps() {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let planes = (0..3 * SIZE[0] * SIZE[1]).map(|_| rng.random::<f32>() - 0.5).collect();
        let image = TactileImage { size_px: SIZE, planes, edge_share: 0.0 };
        let error = Relighting::fit(&[image], [1.0, 1.0], &Preprocessing::counts(SIZE)).unwrap_err().to_string();
        assert!(error.contains("flips relit"), "{error}");
    }

    /// The simulator as the judge: a press of a shape, mirrored and relit, against a press of the mirrored shape.
    #[test]
    fn a_simulated_press_mirrored_and_relit_is_near_a_press_of_the_mirrored_shape() {
        let spec = SensorSpec { frame_px: [80, 60], ..SensorSpec::default() };
        let image = |side: f64, turn: f64| {
            let relief = Relief::peg(glyph('F', 12.0, 16.0).unwrap().map(|[x, y]| [side * x, y]));
            let pose = Se2::from_degrees(0.0, 0.0, turn);
            let press = Press { relief: &relief, side: Side::Peg, part_from_sensor: pose, depth_mm: 0.6 };
            let shown = render(&spec, Fidelity::Optics, None, &press, 1).unwrap();
            let background = Background::new(&shown.at_rest, &Preprocessing::counts(SIZE)).unwrap();
            background.tactile_image(&shown.frame).unwrap()
        };
        let images: Vec<_> = (0..12).map(|i| image(1.0, 30.0 * f64::from(i))).collect();
        let relighting = Relighting::fit(&images, [18.6 / 40.0, 14.3 / 30.0], &Preprocessing::counts(SIZE)).unwrap();
        let mut planes = image(1.0, 20.0).planes;
        planes.chunks_exact_mut(SIZE[0]).for_each(<[f32]>::reverse);
        let truth = image(-1.0, -20.0).planes;
        let error = |planes: &[f32]| {
            let sum = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v * v)).sum::<f64>();
            (sum(&mut planes.iter().zip(&truth).map(|(a, b)| a - b)) / sum(&mut truth.iter().copied())).sqrt()
        };
        let plain = error(&planes);
        relighting.apply(true, false, &mut planes);
        let relit = error(&planes);
        println!("plain {plain:.3}, relit {relit:.3}, lamps {:?}", relighting.lamps);
        // What remains: walls, and that the light changes over the frame.
        assert!(relit < 0.5 * plain && relit < 0.6, "{relit} {plain}");
    }
}
