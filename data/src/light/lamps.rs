//! How a sensor's lamps light a slope, and pictures brought under the lamps that the network knows.
//!
//! To first order a channel changes with the gel's slope, `D = A g` with a 3 x 2 matrix `A` at each place of the frame.
//! A picture taken under lamps `A` shows under others, `B`, what it shows here and `(B - A) g`, where `g` is what the
//! picture itself says of the slope: `g = (A^T A + s)^-1 A^T D`, the least-squares slope with a little doubt `s`, so
//! that a corner without light is not made of noise. Hence one network for sensors with any lamps, if they are known
//! (`tactile-data calibrate`).
//!
//! Not modelled: that steep slopes answer less than linearly, and in other colours.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};

/// Factors of `1, x, y, x^2, x y, y^2` over the frame, x and y in -1..=1, x right and y down; counts.
pub type Quadratic = [f32; 6];

/// A quadratic's value at a place of the frame, -1..=1 in x and y.
pub fn value(k: &Quadratic, x: f32, y: f32) -> f32 {
    k[0] + k[1] * x + k[2] * y + k[3] * x * x + k[4] * x * y + k[5] * y * y
}

/// How far each lamp of a Mini reaches, as a share of its strength at the centre: quadratics through a real
/// calibration table's values at the centre and the four sides.
pub(crate) const MINI_FALL_OFF: [Quadratic; 3] =
    [[1.0, 0.0, 0.12, -0.33, 0.0, -0.45], [1.0, 0.0, 0.0, -0.30, 0.0, -0.30], [1.0, 0.0, -0.28, -0.30, 0.0, -0.40]];

/// Response of a GelSight Mini, fitted to the Taxim table of one in TacEx (640x480, MIT), of whose
/// 32.3, 21.6 and 23.2 counts (root mean square for red, green and blue) it leaves 4.4, 1.9 and 2.5:
///
/// ```text
/// tactile-data calibrate polycalib.npz --frame-px 640x480 --mm-per-px 0.0295,0.0295
/// ```
pub(crate) const MINI_ALONG_X: [Quadratic; 3] =
    [[8.8, -0.2, 0.5, -9.7, 4.8, -4.5], [-50.1, 9.8, 3.8, 34.6, -6.9, 9.2], [-4.9, 8.6, 1.3, -2.4, -8.9, -2.9]];
pub(crate) const MINI_ALONG_Y: [Quadratic; 3] =
    [[96.9, 1.8, 22.1, -66.2, -3.1, -99.3], [-6.2, -1.2, 6.3, 6.1, -1.9, 6.4], [-53.6, -0.5, 26.9, 20.2, -6.1, 44.8]];

/// The doubt in a slope, as a share of the lamps' mean square at the centre. Chosen on tuning letters under the lamps
/// of two other sensors: without any doubt, as many letters are named to half a point.
const DOUBT: f64 = 0.04;

/// The lamps must tell two directions apart: the smaller axis of their ellipse is at least this share of the larger.
const LEAST_ROUND: f64 = 0.05;

/// How far a view may reach from the calibrated one's middle, in halves of the calibrated side. What is beyond was not
/// measured, and a quadratic goes on falling there: the quadratic of a Mini's red lamp is zero in the corner at 1.04
/// halves and -0.08 of the middle's at 1.1. Drivers of one sensor differ by 1.09.
const MOST_HALVES: f64 = 1.1;

/// A lamp changes a picture by at most this, counts.
const MOST_COUNTS: f32 = 4_096.0;

/// How each channel answers a slope `(g_x, g_y)` towards deeper gel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lamps {
    /// Response of red, green and blue to `2 g_x / (1 + g^2)`, counts.
    pub along_x: [Quadratic; 3],
    /// Response to `2 g_y / (1 + g^2)`, counts.
    pub along_y: [Quadratic; 3],
}

impl Default for Lamps {
    /// The lamps of a GelSight Mini, fitted on a real calibration table: the lamps that the network knows.
    fn default() -> Self {
        Self { along_x: MINI_ALONG_X, along_y: MINI_ALONG_Y }
    }
}

impl Lamps {
    /// One lamp for each channel: its brightness at the frame's centre in counts, and the direction in which it lights a
    /// slope, degrees from x towards y. Over the frame it gets weaker as a Mini's.
    pub fn towards(counts: [f64; 3], towards_deg: [f64; 3]) -> Self {
        let lamp = |share: fn(f64) -> f64| {
            [0, 1, 2].map(|c| {
                let strength = counts[c] * share(towards_deg[c].to_radians());
                MINI_FALL_OFF[c].map(|factor| (strength * f64::from(factor)) as f32)
            })
        };
        Self { along_x: lamp(f64::cos), along_y: lamp(f64::sin) }
    }

    /// The same lamps, each `strength` times as strong and turned by `turn_deg` degrees from x towards y.
    pub fn varied(&self, strength: [f64; 3], turn_deg: [f64; 3]) -> Self {
        let [along_x, along_y] = turned([&self.along_x, &self.along_y], strength, turn_deg);
        Self { along_x, along_y }
    }

    /// The same lamps, where each gains a share of its strength at the middle from there to the border, along x and along y.
    pub fn fading(&self, uneven: [[f64; 2]; 3]) -> Self {
        Self { along_x: fading(&self.along_x, uneven), along_y: fading(&self.along_y, uneven) }
    }

    /// The lamps under which a mirrored picture is, left and right or top and bottom exchanged.
    pub fn mirrored(&self, mirrored: [bool; 2]) -> Self {
        let sign = mirrored.map(|is| if is { -1.0 } else { 1.0 });
        let part = |part: &[Quadratic; 3], axis: usize| {
            part.each_ref().map(|factor| on_view(factor, [0.0; 2], sign).map(|value| sign[axis] as f32 * value))
        };
        Self { along_x: part(&self.along_x, 0), along_y: part(&self.along_y, 1) }
    }

    /// Refuses lamps that no sensor has, and lamps in one line: they do not show the slope across it.
    pub fn validate(&self) -> Result<()> {
        for (field, factors) in [("along_x", &self.along_x), ("along_y", &self.along_y)] {
            if let Some(value) = factors.iter().flatten().find(|value| value.is_nan() || value.abs() > MOST_COUNTS) {
                let expected = format!("at most {MOST_COUNTS} counts either way");
                return Err(Error::invalid(format!("light.{field}"), expected, value.to_string()));
            }
        }
        let [[xx, xy], [_, yy]] = square(&self.at(0.0, 0.0));
        let (mean, apart) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        // Axes are square roots of the eigenvalues.
        let round = ((mean - apart).max(0.0) / (mean + apart)).sqrt();
        if round.is_nan() || round < LEAST_ROUND {
            let got = format!("lamps of which a slope across changes {:.1} % of one along", 100.0 * round.max(0.0));
            return Err(Error::invalid("light", "lamps that show slopes in all directions", got));
        }
        Ok(())
    }

    /// The response of each channel to a slope along x and y at a place of the frame.
    fn at(&self, x: f32, y: f32) -> [[f64; 2]; 3] {
        [0, 1, 2].map(|c| [&self.along_x[c], &self.along_y[c]].map(|factors| f64::from(value(factors, x, y))))
    }

    /// For each pixel of a picture under these lamps the matrix that gives its colours under `others`, rows from the
    /// top. Of equal lamps it is one to the bit.
    pub fn change_to(&self, others: &Self, [width, height]: [usize; 2]) -> Vec<[[f32; 3]; 3]> {
        let [[xx, _], [_, yy]] = square(&self.at(0.0, 0.0));
        let doubt = DOUBT * 0.5 * (xx + yy);
        let place = |at: usize, n: usize| (at as f32 + 0.5) / n as f32 * 2.0 - 1.0;
        let pixel = |i: usize| {
            let (x, y) = (place(i % width, width), place(i / width, height));
            let (here, there) = (self.at(x, y), others.at(x, y));
            let [[xx, xy], [_, yy]] = square(&here);
            let (xx, yy) = (xx + doubt, yy + doubt);
            let determinant = xx * yy - xy * xy;
            // From colours to slopes: (A^T A + s)^-1 A^T.
            let slopes = here.map(|[x, y]| [(yy * x - xy * y) / determinant, (xx * y - xy * x) / determinant]);
            std::array::from_fn(|i| {
                std::array::from_fn(|j| {
                    let [x, y] = [0, 1].map(|axis| (there[i][axis] - here[i][axis]) * slopes[j][axis]);
                    (f64::from(u8::from(i == j)) + x + y) as f32
                })
            })
        };
        (0..width * height).map(pixel).collect()
    }
}

/// Changes the colours of `[3, height, width]` values pixel by pixel, as [`Lamps::change_to`] has them.
pub fn recolour(colours: &[[[f32; 3]; 3]], planes: &mut [f32]) {
    let (red, rest) = planes.split_at_mut(colours.len());
    let (green, blue) = rest.split_at_mut(colours.len());
    for (((r, g), b), matrix) in red.iter_mut().zip(green).zip(blue).zip(colours) {
        let new = matrix.map(|[from_r, from_g, from_b]| from_r * *r + from_g * *g + from_b * *b);
        [*r, *g, *b] = new;
    }
}

/// Each channel's answers along two directions, `strength` times as strong and turned by `turn_deg` degrees from the first towards the
/// second.
pub(crate) fn turned(along: [&[Quadratic; 3]; 2], strength: [f64; 3], turn_deg: [f64; 3]) -> [[Quadratic; 3]; 2] {
    let [x, y] = along;
    let part = |c: usize, along_x: f64, along_y: f64| -> Quadratic {
        std::array::from_fn(|i| (strength[c] * (along_x * f64::from(x[c][i]) + along_y * f64::from(y[c][i]))) as f32)
    };
    let angle = turn_deg.map(|deg| deg.to_radians().sin_cos());
    [[0, 1, 2].map(|c| part(c, angle[c].1, -angle[c].0)), [0, 1, 2].map(|c| part(c, angle[c].0, angle[c].1))]
}

/// Each channel's answers, which gain a share of theirs at the middle from there to the border, along x and along y.
pub(crate) fn fading(part: &[Quadratic; 3], uneven: [[f64; 2]; 3]) -> [Quadratic; 3] {
    [0, 1, 2].map(|c| {
        let ([one, x, y, xx, xy, yy], [along_x, along_y]) = (part[c], uneven[c].map(|share| share as f32));
        [one, x + along_x * one, y + along_y * one, xx, xy, yy]
    })
}

/// Lamps, with the size of the frame over which they are stated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibratedLamps {
    /// The lamps over the calibrated frame.
    pub lamps: Lamps,
    /// Width and height of what that frame shows, mm.
    pub field_of_view_mm: [f64; 2],
}

impl CalibratedLamps {
    /// The lamps over another view of the same gel about the same middle, `field_of_view_mm` wide and high, mm.
    ///
    /// # Errors
    /// A view that reaches more than 1.1 times as far as the calibrated one: nothing was measured there.
    pub fn on(&self, field_of_view_mm: [f64; 2]) -> Result<Lamps> {
        let half = [0, 1].map(|axis| field_of_view_mm[axis] / self.field_of_view_mm[axis]);
        check_reach("field of view", half, self.field_of_view_mm, || {
            let [width, height] = field_of_view_mm;
            format!("{width:.1} x {height:.1} mm")
        })?;
        let part = |part: &[Quadratic; 3]| part.each_ref().map(|factor| on_view(factor, [0.0; 2], half));
        Ok(Lamps { along_x: part(&self.lamps.along_x), along_y: part(&self.lamps.along_y) })
    }
}

/// Refuses a view that reaches further from the calibrated one's middle than [`MOST_HALVES`] along x or y.
pub(crate) fn check_reach(
    field: &str,
    [x, y]: [f64; 2],
    [width, height]: [f64; 2],
    got: impl Fn() -> String,
) -> Result<()> {
    let reach = x.max(y);
    if reach.is_nan() || reach > MOST_HALVES {
        let expected =
            format!("a view within {MOST_HALVES} times the {width:.1} x {height:.1} mm that were calibrated");
        return Err(Error::invalid(field, expected, got()));
    }
    Ok(())
}

/// The factors by which `centre + half * u` gives what `k` gives at its own place.
pub(crate) fn on_view(k: &Quadratic, [cx, cy]: [f64; 2], [hx, hy]: [f64; 2]) -> Quadratic {
    let [one, x, y, xx, xy, yy] = k.map(f64::from);
    [
        one + x * cx + y * cy + xx * cx * cx + xy * cx * cy + yy * cy * cy,
        hx * (x + 2.0 * xx * cx + xy * cy),
        hy * (y + xy * cx + 2.0 * yy * cy),
        hx * hx * xx,
        hx * hy * xy,
        hy * hy * yy,
    ]
    .map(|factor| factor as f32)
}

/// `A^T A` of a 3 x 2 matrix.
fn square(lamps: &[[f64; 2]; 3]) -> [[f64; 2]; 2] {
    std::array::from_fn(|i| std::array::from_fn(|j| lamps.iter().map(|lamp| lamp[i] * lamp[j]).sum()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cmu() -> Lamps {
        Lamps::towards([65.0, 45.0, 47.0], [178.0, 62.0, -54.0])
    }

    #[test]
    fn equal_lamps_change_nothing_to_the_bit() {
        let one = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert!(cmu().change_to(&cmu(), [40, 30]).iter().all(|matrix| *matrix == one));
    }

    /// A slope at a place, shown by one set of lamps, brought under another.
    #[test]
    fn a_slope_looks_as_under_the_other_lamps() {
        let (here, there) = (cmu(), Lamps::towards([97.0, 50.0, 53.0], [83.0, -174.0, -97.0]));
        let size = [9, 7];
        let changes = here.change_to(&there, size);
        for (pixel, slope) in [(31, [0.3, -0.2]), (0, [-0.1, 0.4]), (62, [0.2, 0.2])] {
            let (x, y) = ((pixel % 9) as f32 / 4.5 + 1.0 / 9.0 - 1.0, (pixel / 9) as f32 / 3.5 + 1.0 / 7.0 - 1.0);
            let shown = |lamps: &Lamps| lamps.at(x, y).map(|lamp: [f64; 2]| lamp[0] * slope[0] + lamp[1] * slope[1]);
            let (from, expected) = (shown(&here), shown(&there));
            let length = expected.iter().map(|v| v * v).sum::<f64>().sqrt();
            let error: f64 = (0..3)
                .map(|i| (0..3).map(|j| f64::from(changes[pixel][i][j]) * from[j]).sum::<f64>() - expected[i])
                .map(|error| error * error)
                .sum::<f64>()
                .sqrt();
            // The doubt keeps a part of the picture as it was: most where the light is weak.
            let bound = if pixel == 31 { 0.08 } else { 0.35 };
            assert!(error < bound * length, "pixel {pixel}: {error} of {length}");
        }
    }

    #[test]
    fn a_view_of_half_the_frame_sees_its_middle() {
        let whole = CalibratedLamps { lamps: cmu(), field_of_view_mm: [20.0, 16.0] };
        let half = whole.on([10.0, 16.0]).unwrap();
        let [here, there] = [half.at(0.6, -0.3), cmu().at(0.3, -0.3)];
        assert!(here.iter().flatten().zip(there.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-4));
        assert_eq!(whole.on([20.0, 16.0]).unwrap(), cmu());
        let error = whole.on([20.0, 18.0]).unwrap_err().to_string();
        assert!(error.contains("within 1.1 times the 20.0 x 16.0 mm") && error.contains("18.0 mm"), "{error}");
    }

    #[test]
    fn lamps_in_one_line_and_lamps_of_no_number_are_refused() {
        cmu().validate().unwrap();
        let line = Lamps::towards([60.0, 50.0, 40.0], [30.0, -150.0, 30.0]);
        assert!(line.validate().unwrap_err().to_string().contains("in all directions"));
        assert!(Lamps::towards([0.0; 3], [0.0; 3]).validate().is_err());
        let mut bad = cmu();
        bad.along_y[1][3] = f32::NAN;
        assert!(bad.validate().unwrap_err().to_string().starts_with("light.along_y"));
    }
}
