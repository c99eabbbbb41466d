//! Presses of a ball by a simulated sensor: what a real one is calibrated from, to try it out.

use rand::RngExt;
use rayon::prelude::*;

use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::pose::se2::Se2;
use crate::scene::random::{frame_rng, uniform};
use crate::scene::shape::file::FileScale;
use crate::sensor::render::{Press, relief, render};
use crate::sensor::{Fidelity, SensorSpec};

/// How deep a ball is pressed in, as shares of its diameter.
const DEPTH_SHARES: [f64; 2] = [0.08, 0.15];

/// How far a contact stays from the view's border, as a share of the ball's diameter.
const MARGIN_SHARE: f64 = 0.12;

/// A ball's presses by a simulated sensor.
#[derive(Clone, Debug)]
pub struct BallPresses {
    /// The sensor at rest.
    pub at_rest: Frame,
    /// The presses.
    pub frames: Vec<Frame>,
}

/// Presses a ball `n` times, all over the view and to depths of 8 to 15 % of its diameter, with the camera's noise. `seed`
/// draws places, depths and noise.
///
/// # Errors
/// No press or more than 1,000, a ball that is none, or one whose contact does not fit into the view.
pub fn ball_presses(spec: &SensorSpec, ball_mm: f64, n: usize, seed: u64) -> Result<BallPresses> {
    if !(1..=1_000).contains(&n) {
        return Err(Error::invalid("presses", "1 to 1,000", n.to_string()));
    }
    let ball = relief(&format!("ball:{ball_mm}"), Side::Peg, &FileScale::default(), 0.0)?;
    // The contact of the deepest press, and the margin round it.
    let radius_mm = 0.5 * ball_mm;
    let deepest_mm = DEPTH_SHARES[1] * ball_mm;
    let border_mm = (radius_mm.powi(2) - (radius_mm - deepest_mm).powi(2)).sqrt() + MARGIN_SHARE * ball_mm;
    let half_mm = spec.field_of_view_mm.map(|side| 0.5 * side - border_mm);
    if !(half_mm[0] > 0.0 && half_mm[1] > 0.0) {
        let [width, height] = spec.field_of_view_mm;
        return Err(Error::invalid(
            "ball",
            format!("one that fits into {width:.1} x {height:.1} mm"),
            format!("{ball_mm} mm"),
        ));
    }
    let one = |i: usize| {
        let rng = &mut frame_rng(seed, i as u64);
        let [x, y] = place(i, n, rng.random());
        let depth_mm = ball_mm * uniform(rng, DEPTH_SHARES);
        // The sensor's middle on the ball, whose contact is then on the other side of the view.
        let part_from_sensor = Se2::from_degrees(-x * half_mm[0], -y * half_mm[1], 0.0);
        let press = Press { relief: &ball, side: Side::Peg, part_from_sensor, depth_mm };
        render(spec, Fidelity::Camera, None, &press, seed.wrapping_add(1 + i as u64))
    };
    let rendered = (0..n).into_par_iter().map(one).collect::<Result<Vec<_>>>()?;
    let at_rest = rendered[0].at_rest.clone();
    Ok(BallPresses { at_rest, frames: rendered.into_iter().map(|rendered| rendered.frame).collect() })
}

/// The place of a press in -1..=1: points of the sequence of Roberts (2018), which fill a square evenly, moved by `start`.
fn place(i: usize, n: usize, start: [f64; 2]) -> [f64; 2] {
    /// Powers of the root of x^3 = x + 1.
    const STEP: [f64; 2] = [0.754_877_666, 0.569_840_291];
    // Each press is moved by less than the others are apart.
    let jitter = 0.5 / (n as f64).sqrt();
    [0, 1].map(|axis| {
        let even = (0.5 + (i + 1) as f64 * STEP[axis]).fract();
        (2.0 * even - 1.0 + jitter * (start[axis] - 0.5)).clamp(-1.0, 1.0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::calibrate::fit::fit;
    use crate::light::calibrate::presses::Presses;
    use crate::sensor::light::{LightRig, value};

    #[test]
    fn the_light_is_found_again_from_presses_alone() {
        let spec = SensorSpec {
            frame_px: [160, 120],
            light: LightRig::named("cmu").unwrap(),
            gel_length_mm: 1.6,
            ..SensorSpec::default()
        };
        let made = ball_presses(&spec, 4.7, 16, 5).unwrap();
        let named = made.frames.into_iter().enumerate().map(|(i, frame)| (format!("{i}.png"), frame, None)).collect();
        let presses = Presses::new(made.at_rest, named, 4.7, spec.mm_per_px()).unwrap();
        let found = fit(&presses).unwrap().calibration.light;
        for channel in 0..3 {
            for (x, y) in [(0.0, 0.0), (-0.6, 0.5), (0.6, -0.5)] {
                let strength =
                    |rig: &LightRig| [&rig.along_x, &rig.along_y].map(|part| f64::from(value(&part[channel], x, y)));
                let ([x, y], [x_found, y_found]) = (strength(&spec.light), strength(&found));
                // Noise, JPEG and a gel length chosen from seven: some 10 % of 45 to 65 counts.
                assert!((x - x_found).hypot(y - y_found) < 8.0, "{channel}: {x} {y}, {x_found} {y_found}");
            }
        }
    }

    #[test]
    fn places_fill_the_view_and_a_ball_must_fit() {
        let quarters: std::collections::BTreeSet<_> =
            (0..8).map(|i| place(i, 8, [0.5; 2]).map(|at| at > 0.0)).collect();
        assert_eq!(quarters.len(), 4);
        let spec = SensorSpec::default();
        assert!(ball_presses(&spec, 30.0, 5, 1).unwrap_err().to_string().contains("fits into 18.6 x 14.3 mm"));
        assert!(ball_presses(&spec, 4.7, 0, 1).is_err());
    }
}
