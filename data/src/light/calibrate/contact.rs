//! Where and how widely a ball touched, under a light that is known.
//!
//! A press's circle is moved in x and y and made wider or narrower by the method of Gauss and Newton, derivatives taken by
//! differences, until the squared error of the press no longer falls.

use super::ball::BallPress;
use super::circle::{Circle, LEAST_OF_BALL};
use super::light_factors::{bases, change, factors, place};
use super::presses::{Press, Presses};

/// Pixels up to this far outside a circle count in the fit, mm: where the gel's slope fades.
const REACH_MM: f64 = 3.0;

/// The figures are of the circle and half its radius round it: the contact and its coloured band.
pub(super) const CONTACT_RADII: f64 = 1.5;

/// Lengths are chosen, and contacts moved, on every fourth pixel each way.
pub(super) const STRIDE: usize = 4;

/// Steps of the method at most.
const MOST_STEPS: usize = 4;

/// By how much a circle changes in one step at most, as a share of its radius: farther away the light is not linear in it.
const LARGEST_STEP: f64 = 0.05;

/// The change for a derivative, as a share of the radius: half a pixel of a contact of 40.
const DIFFERENCE: f64 = 0.012;

/// The gel and its light.
pub(super) struct Gel<'a> {
    /// Its decay length, mm.
    pub length_mm: f64,
    /// The weight of each factor, counts, for each channel.
    pub weights: &'a [Vec<f64>; 3],
}

/// The contact under which the light predicts a press best, near one that is roughly right.
pub(super) fn move_contact(presses: &Presses, press: &Press, gel: &Gel<'_>, start: Circle) -> Circle {
    let pixels = pixels_near(presses, press, STRIDE);
    let errors_of = |circle: &Circle| errors(presses, press, gel, (circle, &pixels));
    let mut best = start;
    let mut errors = errors_of(&best);
    for _ in 0..MOST_STEPS {
        let difference_px = DIFFERENCE * best.radius_px;
        let slopes = [0, 1, 2].map(|way| {
            let changed = errors_of(&changed(presses, best, one_way(way, difference_px)));
            changed.iter().zip(&errors).map(|(new, old)| (new - old) / difference_px).collect::<Vec<_>>()
        });
        let Some(step_px) = downhill(&slopes, &errors) else { break };
        let most_px = LARGEST_STEP * best.radius_px;
        let candidate = changed(presses, best, step_px.map(|px| px.clamp(-most_px, most_px)));
        let candidate_errors = errors_of(&candidate);
        if squared(&candidate_errors) >= squared(&errors) {
            break;
        }
        (best, errors) = (candidate, candidate_errors);
    }
    best
}

/// The gel round a contact, computed for all pixels near the press's circle, about which it was looked for.
pub(super) fn ball_of(presses: &Presses, press: &Press, contact: &Circle, gel_length_mm: f64) -> BallPress {
    let [contact_mm, given_mm] = [contact, &press.circle].map(|circle| presses.geometry.radius_mm(circle));
    BallPress::new(presses.geometry.ball_radius_mm, contact_mm, gel_length_mm, CONTACT_RADII * given_mm + REACH_MM)
}

/// The pixels that count in the fit of a press: every `stride`-th each way within [`REACH_MM`] of its given circle.
pub(super) fn pixels_near(presses: &Presses, press: &Press, stride: usize) -> Vec<usize> {
    let [width, height] = presses.geometry.frame_px;
    let reach_mm = presses.geometry.radius_mm(&press.circle) + REACH_MM;
    let places = (0..height).step_by(stride).flat_map(|y| (0..width).step_by(stride).map(move |x| y * width + x));
    let is_near = |pixel: &usize| {
        let [x, y] = presses.geometry.from_centre_mm(&press.circle, *pixel);
        x.hypot(y) <= reach_mm
    };
    places.filter(is_near).collect()
}

/// What the light makes of the press less what it is, counts, in each channel of each pixel.
fn errors(presses: &Presses, press: &Press, gel: &Gel<'_>, (contact, pixels): (&Circle, &[usize])) -> Vec<f64> {
    let geometry = &presses.geometry;
    let ball = ball_of(presses, press, contact, gel.length_mm);
    let of_pixel = |pixel: &usize| {
        let bases = bases(&ball, geometry.from_centre_mm(contact, *pixel));
        let factors = factors(bases, place(*pixel, geometry.frame_px));
        let counts = press.counts(*pixel);
        let change = change(gel.weights, &factors);
        [0, 1, 2].map(|channel| change[channel] - counts[channel])
    };
    pixels.iter().flat_map(of_pixel).collect()
}

/// A circle moved in x and y and made wider, pixels; it stays narrower than the ball.
fn changed(presses: &Presses, circle: Circle, [dx, dy, wider]: [f64; 3]) -> Circle {
    let ball_px = presses.geometry.ball_radius_px();
    Circle {
        centre_px: [circle.centre_px[0] + dx, circle.centre_px[1] + dy],
        radius_px: (circle.radius_px + wider).clamp(LEAST_OF_BALL * ball_px, ball_px),
    }
}

fn one_way(way: usize, px: f64) -> [f64; 3] {
    std::array::from_fn(|i| if i == way { px } else { 0.0 })
}

fn squared(errors: &[f64]) -> f64 {
    errors.iter().map(|error| error * error).sum()
}

/// The step of least squares, by Cramer's rule; none where the errors do not tell the three ways apart.
fn downhill(slopes: &[Vec<f64>; 3], errors: &[f64]) -> Option<[f64; 3]> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let squares = slopes.each_ref().map(|a| slopes.each_ref().map(|b| dot(a, b)));
    let towards = slopes.each_ref().map(|a| -dot(a, errors));
    let whole = determinant(&squares);
    // A millionth of what three ways at right angles to each other would have.
    if whole.is_nan() || whole <= 1e-6 * squares[0][0] * squares[1][1] * squares[2][2] {
        return None;
    }
    let replaced = |way: usize| {
        let mut columns = squares;
        for (row, value) in columns.iter_mut().zip(towards) {
            row[way] = value;
        }
        determinant(&columns) / whole
    };
    Some([0, 1, 2].map(replaced))
}

fn determinant(m: &[[f64; 3]; 3]) -> f64 {
    let minor = |i: usize, j: usize| m[1][i] * m[2][j] - m[1][j] * m[2][i];
    m[0][0] * minor(1, 2) - m[0][1] * minor(0, 2) + m[0][2] * minor(0, 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_step_is_that_of_least_squares() {
        // Errors that are linear in the step, and two that no step changes.
        let slopes = [vec![1.0, 2.0, 0.0, 0.0], vec![0.0, 1.0, -1.0, 0.0], vec![3.0, 0.0, 1.0, 0.0]];
        let truth = [0.5, -2.0, 1.5];
        let error =
            |i: usize| 7.0 * f64::from(u8::from(i == 3)) - (0..3).map(|way| slopes[way][i] * truth[way]).sum::<f64>();
        let errors: Vec<f64> = (0..4).map(error).collect();
        let step = downhill(&slopes, &errors).unwrap();
        assert!(step.iter().zip(truth).all(|(step, truth)| (step - truth).abs() < 1e-12), "{step:?}");
        assert!(downhill(&[slopes[0].clone(), slopes[0].clone(), slopes[2].clone()], &errors).is_none());
    }
}
