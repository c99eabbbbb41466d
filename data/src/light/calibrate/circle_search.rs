//! Finding where a ball touches, without a label.
//!
//! The response of any lamps is linear in five functions of the slope, and a ball's slopes are known except for
//! where it is and how wide it touches. So for a circle the best lamps follow by least squares, their fall-off
//! included, and the circle whose slopes explain most of the difference image is where the ball is.

use super::ball::BallPress;
use super::circle::{Circle, LEAST_OF_BALL, PressGeometry};
use super::least_squares::Sums;
use super::light_factors::bases;

/// The gel's decay length: the least, where the search begins, and the largest, mm.
const GEL_LENGTH_MM: [f64; 3] = [0.5, 1.6, 6.0];

/// The least share of the difference round a circle that the ball's slopes must explain.
const LEAST_EXPLAINED: f64 = 0.5;

/// Two lamps' functions, each constant and linear over the circle, and three walls'.
const N_FACTORS: usize = 9;

/// The circle that explains most of a difference image, interleaved RGB in counts; none where no circle
/// explains half of what is round it.
pub fn find(geometry: &PressGeometry, difference: &[f32]) -> Option<Circle> {
    let ball_px = geometry.ball_radius_px();
    let start = brightest_square(difference, geometry.frame_px[0], ball_px);
    let mut best =
        Guess { circle: Circle { centre_px: start, radius_px: 0.6 * ball_px }, gel_length_mm: GEL_LENGTH_MM[1] };
    let mut explained = 0.0;
    // Circles are compared on the same pixels; once the ball is found, on those round it.
    for (first_step_px, reach_radii) in [(0.3 * ball_px, 2.0), (0.1 * ball_px, 1.7)] {
        let view = View::new(geometry, difference, best.circle.centre_px, reach_radii);
        explained = view.explained(&best);
        let mut step_px = first_step_px;
        while step_px >= 0.2 {
            let mut moved = false;
            for candidate in neighbours(best, step_px, ball_px) {
                let share = view.explained(&candidate);
                if share > explained {
                    (best, explained, moved) = (candidate, share, true);
                }
            }
            if !moved {
                step_px *= 0.5;
            }
        }
    }
    (explained >= LEAST_EXPLAINED).then_some(best.circle)
}

/// Where the ball may be.
#[derive(Clone, Copy)]
struct Guess {
    circle: Circle,
    gel_length_mm: f64,
}

/// A guess moved, made wider or narrower by a step, or with a longer or shorter skirt by the step's share of the
/// ball; the contact stays narrower than the ball.
fn neighbours(guess: Guess, step_px: f64, ball_px: f64) -> Vec<Guess> {
    let steps = [-step_px, 0.0, step_px];
    let changed = |dx: f64, dy: f64, wider: f64, longer: f64| Guess {
        circle: Circle {
            centre_px: [guess.circle.centre_px[0] + dx, guess.circle.centre_px[1] + dy],
            radius_px: (guess.circle.radius_px + wider).clamp(LEAST_OF_BALL * ball_px, 0.98 * ball_px),
        },
        gel_length_mm: (guess.gel_length_mm * (2.0 * longer / ball_px).exp()).clamp(GEL_LENGTH_MM[0], GEL_LENGTH_MM[2]),
    };
    let places = steps.into_iter().flat_map(|dx| steps.map(|dy| changed(dx, dy, 0.0, 0.0)));
    let shapes = steps.into_iter().flat_map(|wider| steps.map(|longer| changed(0.0, 0.0, wider, longer)));
    places.chain(shapes).collect()
}

/// The middle of the square of the ball's size with the largest sum of absolute differences, pixels.
fn brightest_square(difference: &[f32], width: usize, radius_px: f64) -> [f64; 2] {
    let height = difference.len() / (3 * width);
    let strength = |pixel: usize| difference[3 * pixel..3 * pixel + 3].iter().map(|v| f64::from(v.abs())).sum::<f64>();
    // Sums over all above and to the left.
    let mut sums = vec![0.0; (width + 1) * (height + 1)];
    for row in 0..height {
        let mut line = 0.0;
        for column in 0..width {
            line += strength(row * width + column);
            sums[(row + 1) * (width + 1) + column + 1] = sums[row * (width + 1) + column + 1] + line;
        }
    }
    let half = (0.7 * radius_px) as usize;
    let total = |x: usize, y: usize| {
        let (left, right) = (x.saturating_sub(half), (x + half).min(width));
        let (top, bottom) = (y.saturating_sub(half), (y + half).min(height));
        let at = |x: usize, y: usize| sums[y * (width + 1) + x];
        at(right, bottom) - at(left, bottom) - at(right, top) + at(left, top)
    };
    let places = (0..height).step_by(2).flat_map(|y| (0..width).step_by(2).map(move |x| (x, y)));
    let best = places.max_by(|a, b| total(a.0, a.1).total_cmp(&total(b.0, b.1))).unwrap_or((0, 0));
    [best.0 as f64, best.1 as f64]
}

/// The pixels on which circles are compared: some eight to the ball's radius each way.
struct View<'a> {
    geometry: &'a PressGeometry,
    reach_mm: f64,
    /// Each pixel and its difference from rest, counts.
    pixels: Vec<(usize, [f64; 3])>,
}

impl<'a> View<'a> {
    /// The pixels within `reach_radii` of the ball's from a place.
    fn new(geometry: &'a PressGeometry, difference: &[f32], centre_px: [f64; 2], reach_radii: f64) -> Self {
        let [width, height] = geometry.frame_px;
        let reach_mm = reach_radii * geometry.ball_radius_mm;
        let middle = Circle { centre_px, radius_px: 0.0 };
        let ball_px = geometry.ball_radius_px();
        let stride = (ball_px / 8.0).max(1.0) as usize;
        let places = (0..height).step_by(stride).flat_map(|y| (0..width).step_by(stride).map(move |x| y * width + x));
        let near = places.filter(|pixel| {
            let [x, y] = geometry.from_centre_mm(&middle, *pixel);
            x.hypot(y) <= reach_mm
        });
        let counts = |pixel: usize| (pixel, [0, 1, 2].map(|channel| f64::from(difference[3 * pixel + channel])));
        Self { geometry, reach_mm, pixels: near.map(counts).collect() }
    }

    /// The share of the squared difference that a ball's slopes explain with the best lamps.
    fn explained(&self, Guess { circle, gel_length_mm }: &Guess) -> f64 {
        let (radius_mm, contact_mm) = (self.geometry.ball_radius_mm, self.geometry.radius_mm(circle));
        let ball = BallPress::new(radius_mm, contact_mm, *gel_length_mm, self.reach_mm);
        let mut sums = Sums::new(N_FACTORS);
        for (pixel, counts) in &self.pixels {
            let offset_mm = self.geometry.from_centre_mm(circle, *pixel);
            let [along_x, along_y, steep, across, diagonal, _] = bases(&ball, offset_mm);
            let [x, y] = offset_mm.map(|mm| mm / self.reach_mm);
            let lamps = [along_x, along_x * x, along_x * y, along_y, along_y * x, along_y * y];
            let mut factors = [steep, across, diagonal, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            factors[3..].copy_from_slice(&lamps);
            sums.add(&factors, *counts);
        }
        let Ok(weights) = sums.solve(1e-6) else { return 0.0 };
        let all = sums.squared_error(&[0; 3].map(|_| vec![0.0; N_FACTORS]));
        if all > 0.0 { 1.0 - sums.squared_error(&weights) / all } else { 0.0 }
    }
}
