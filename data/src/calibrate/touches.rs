//! A sensor's lamps from touches of anything: neither what was touched nor where is known.
//!
//! [`Response`] says how strong each lamp is next to the others and where it shines from, about: light that fades over the frame and
//! steep walls are not in it. So the lamps are those under which simulated touches of MAZE parts give the response that the sensor's
//! gave (indirect inference; Gourieroux, Monfort and Renault, 1993). What this leaves open is one factor, how steep the slopes were: the
//! lamps are taken to be as strong as a Mini's on average (their geometric mean). How each lamp fades over the frame is a Mini's.

use std::collections::HashSet;

use rand::RngExt;
use rayon::prelude::*;
use serde::Serialize;

use super::curl::{Moments, Response};
use super::{Calibration, SCHEMA, at_rest};
use crate::error::{Error, FrameFault, Result};
use crate::frame::{Background, EDGE_COUNTS, Frame, Preprocessing};
use crate::grid::PoseGrid;
use crate::random::{around_zero, frame_rng};
use crate::scene::{Kit, MazeParts, Parts, Scene};
use crate::se2::{Se2, wrap_angle};
use crate::sensor::light::LightRig;
use crate::sensor::{Fidelity, SensorSpec};
use crate::simulator::Simulator;
use crate::touch::Side;

/// Fewer touches do not show slopes in all directions.
pub const MIN_TOUCHES: usize = 20;

/// A touch of less than this share of edges shows no slopes.
const MIN_EDGE_SHARE: f32 = 0.02;

/// The size at which touches are looked at, pixels, as the model looks at them.
const SIZE_PX: [usize; 2] = [40, 30];

/// Simulated touches that are compared with, and how often.
const N_SIMULATED: usize = 60;
const N_ROUNDS: usize = 3;

/// Simulated frames are at most so wide, pixels.
const MOST_WIDTH_PX: usize = 320;

/// How far from a part's middle it is touched, mm.
const REACH_MM: f64 = 8.0;

/// Draws of the touches, with replacement, from which intervals are made (Efron and Tibshirani, An Introduction to the Bootstrap).
const N_DRAWS: u64 = 200;

/// How far lamps of other sensors are turned from a Mini's, and how much stronger they are, as a logarithm, before any touch: standard
/// deviations.
const PRIOR: Change = Change { strength: 0.3, turn_deg: 20.0 };

/// The standard deviation of how strong three lamps are together, as a logarithm: that of a mean of three.
pub const TOGETHER: f64 = 0.17;

/// How one lamp differs from a Mini's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Change {
    /// How much stronger it is, the natural logarithm.
    pub strength: f64,
    /// How far it is turned, degrees from x towards y.
    pub turn_deg: f64,
}

impl Change {
    /// Strength with strength, turn with turn.
    fn with(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self { strength: of(self.strength, other.strength), turn_deg: of(self.turn_deg, other.turn_deg) }
    }

    /// One change after the other.
    fn and(self, other: Self) -> Self {
        let sum = self.with(other, |a, b| a + b);
        Self { turn_deg: wrap_angle(sum.turn_deg.to_radians()).to_degrees(), ..sum }
    }
}

/// What touches tell of the lamps.
#[derive(Clone, Debug)]
pub struct TouchFit {
    /// The light.
    pub calibration: Calibration,
    /// How each lamp differs from a Mini's.
    pub changes: [Change; 3],
    /// Standard deviations of these, had others been touched; of how strong a lamp is next to the others, since how strong they are
    /// together ([`TOGETHER`]) no touch tells.
    pub errors: [Change; 3],
    /// Touches that show slopes.
    pub n_touches: usize,
    /// [`Response::curl_share`].
    pub curl_share: f64,
}

/// Fits lamps to frames of touches under a sensor at rest, which show `field_of_view_mm`. Frames that show no edge, and dark ones, are left
/// out.
///
/// # Errors
/// Frames of another size than the one at rest, fewer than [`MIN_TOUCHES`] that show an edge, and touches that do not say which
/// lamps they were lit by.
pub fn fit(no_contact: &Frame, frames: &[Frame], field_of_view_mm: [f64; 2]) -> Result<TouchFit> {
    let background =
        Background::new(no_contact, &Preprocessing { field_of_view_mm, ..Preprocessing::counts(SIZE_PX) })?;
    // A picture that comes twice is one touch.
    let mut known = HashSet::new();
    let different: Vec<&Frame> = frames.iter().filter(|frame| known.insert(frame.rgb())).collect();
    let seen = seen(&background, &different, field_of_view_mm)?;
    let n_touches = seen.len();
    if n_touches < MIN_TOUCHES {
        let expected = format!("{MIN_TOUCHES} touches of edges or more, all over the frame");
        let got = format!("{n_touches} of {} frames that change by more than {EDGE_COUNTS} counts", frames.len());
        return Err(Error::invalid("calibration", expected, got));
    }
    let response = Response::of(&Moments::sum(&seen));
    if !response.is_known() {
        let got = format!("slopes whose curl is {:.2} of that of other lamps", response.curl_share);
        return Err(Error::invalid(
            "calibration",
            "touches that show how each lamp lights slopes in all directions",
            got,
        ));
    }
    // Touches under lamps that differ so much would show this, and so the lamps differ by the rest as well.
    let mut told = [Change::default(); 3];
    let mut simulated = Vec::new();
    for _ in 0..N_ROUNDS {
        simulated = simulate(&told, background.frame_px(), field_of_view_mm)?;
        let rest = apart(&response, &Response::of(&Moments::sum(&simulated)));
        told.iter_mut().zip(rest).for_each(|(change, rest)| *change = change.and(rest));
    }
    let [seen_by, simulated_by] = [&seen, &simulated].map(|touches| spread(touches));
    let spread = [0, 1, 2].map(|c| seen_by[c].with(simulated_by[c], f64::hypot));
    let share = spread.map(|error| PRIOR.with(error, |prior, error| prior.powi(2) / (prior.powi(2) + error.powi(2))));
    let changes = [0, 1, 2].map(|c| share[c].with(told[c], |share, told| share * told));
    let errors = [0, 1, 2].map(|c| share[c].with(spread[c], |share, error| share.sqrt() * error));
    let calibration = Calibration {
        schema: SCHEMA.to_owned(),
        frame_px: [no_contact.width_px(), no_contact.height_px()],
        field_of_view_mm,
        source: format!("{n_touches} touches, without labels"),
        gel_length_mm: None,
        contact_share: None,
        leave_one_out: None,
        light: LightRig { at_rest: at_rest(no_contact)?, ..lit(&changes) },
    };
    Ok(TouchFit { calibration, changes, errors, n_touches, curl_share: response.curl_share })
}

/// What frames that show an edge tell.
fn seen(background: &Background, frames: &[&Frame], field_of_view_mm: [f64; 2]) -> Result<Vec<Moments>> {
    let mm_per_px = [0, 1].map(|axis| field_of_view_mm[axis] / SIZE_PX[axis] as f64);
    let of = |frame: &&Frame| {
        let image = match background.tactile_image(frame) {
            Ok(image) => image,
            Err(error @ Error::Frame { fault: FrameFault::WrongSize { .. }, .. }) => return Err(error),
            // A picture that shows nothing tells nothing.
            Err(_) => return Ok(None),
        };
        Ok((image.edge_share >= MIN_EDGE_SHARE).then(|| Moments::of(&image, mm_per_px)))
    };
    let seen = frames.par_iter().map(of).collect::<Result<Vec<_>>>()?;
    Ok(seen.into_iter().flatten().collect())
}

/// What touches of MAZE parts tell under lamps that differ from a Mini's by so much.
fn simulate(changes: &[Change; 3], frame_px: [usize; 2], field_of_view_mm: [f64; 2]) -> Result<Vec<Moments>> {
    let parts = MazeParts {
        n: N_SIMULATED,
        first: 0,
        seed: 0,
        size_mm: [8.0, 40.0],
        play_mm: None,
        cut_share: None,
        bar_mm: None,
    };
    let reach = PoseGrid { xy_half_mm: REACH_MM, xy_step_mm: REACH_MM, theta_half_deg: 180.0, theta_step_deg: 90.0 };
    let (frame_px, light) = (smaller(frame_px), lit(changes));
    let sensor = SensorSpec { frame_px, field_of_view_mm, light, ..SensorSpec::default() };
    let scene = Scene {
        name: "calibration".to_owned(),
        parts: Parts::Kit(Kit { maze_parts: Some(parts), ..Kit::default() }),
        board: None,
        reach: Some(reach),
        clearance_mm: 0.0,
        gauge_mm: 0.0,
        fidelity: Fidelity::Camera,
        sensor,
    };
    let simulator = Simulator::new(scene, 0)?;
    let touch = |part: usize| {
        let mut rng = frame_rng(0, part as u64);
        let [x, y] = [0, 1].map(|_| around_zero(&mut rng, REACH_MM));
        let pose = Se2::from_degrees(x, y, around_zero(&mut rng, 180.0));
        simulator.touch(part, Side::Peg, &pose, &mut rng)
    };
    let frames = (0..N_SIMULATED).into_par_iter().map(touch).collect::<Result<Vec<_>>>()?;
    let counts = Preprocessing { field_of_view_mm, ..Preprocessing::counts(SIZE_PX) };
    let frames: Vec<&Frame> = frames.iter().collect();
    seen(&Background::new(&simulator.no_contact(0), &counts)?, &frames, field_of_view_mm)
}

/// Frames of a size at which simulation is quick: a camera's JPEG, whose colours are coarser than its pixels, is not that of few pixels.
fn smaller(frame_px: [usize; 2]) -> [usize; 2] {
    let times = frame_px[0].div_ceil(MOST_WIDTH_PX);
    frame_px.map(|n| n / times)
}

/// A Mini's light with lamps that differ by so much.
fn lit(changes: &[Change; 3]) -> LightRig {
    LightRig::default().varied(changes.map(|change| change.strength.exp()), changes.map(|change| change.turn_deg))
}

/// How lamps differ from others by what both answered: as strong on average.
fn apart(response: &Response, other: &Response) -> [Change; 3] {
    let changes = [0, 1, 2].map(|c| {
        let ([x, y], [other_x, other_y]) = (response.lamps[c], other.lamps[c]);
        Change {
            strength: (x.hypot(y) / other_x.hypot(other_y)).ln(),
            turn_deg: wrap_angle(y.atan2(x) - other_y.atan2(other_x)).to_degrees(),
        }
    });
    let mean = changes.iter().map(|change| change.strength).sum::<f64>() / 3.0;
    changes.map(|change| Change { strength: change.strength - mean, ..change })
}

/// Standard deviations of what touches say, had others been drawn.
fn spread(seen: &[Moments]) -> [Change; 3] {
    let told = Response::of(&Moments::sum(seen));
    let draw = |number: u64| {
        let mut rng = frame_rng(0, number);
        let drawn: Vec<&Moments> = (0..seen.len()).map(|_| &seen[rng.random_range(0..seen.len())]).collect();
        apart(&Response::of(&Moments::sum(drawn)), &told)
    };
    let draws: Vec<[Change; 3]> = (0..N_DRAWS).into_par_iter().map(draw).collect();
    [0, 1, 2].map(|c| {
        let sd = |of: fn(&Change) -> f64| {
            (draws.iter().map(|draw| of(&draw[c]).powi(2)).sum::<f64>() / draws.len() as f64).sqrt()
        };
        Change { strength: sd(|change| change.strength), turn_deg: sd(|change| change.turn_deg) }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Letters;

    /// Touches of letters, which are no MAZE parts, under a Mini's light that was changed.
    fn touches(changes: &[Change; 3], side: Side, n: usize) -> (Frame, Vec<Frame>, [f64; 2]) {
        let mut scene = Scene::load("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit {
            letters: Some(Letters {
                letters: "AEFKMRSX".into(),
                font: crate::shape::glyph::Font::default(),
                height_mm: 12.0,
                max_width_mm: 16.0,
            }),
            ..Kit::default()
        });
        scene.sensor.light = lit(changes);
        let view = scene.sensor.field_of_view_mm;
        let simulator = Simulator::new(scene, 1).unwrap();
        let frames = (0..n).map(|i| {
            let mut rng = frame_rng(5, i as u64);
            let pose =
                Se2::from_degrees(around_zero(&mut rng, 5.0), around_zero(&mut rng, 5.0), around_zero(&mut rng, 180.0));
            simulator.touch(i % 8, side, &pose, &mut rng).unwrap()
        });
        (simulator.no_contact(3), frames.collect(), view)
    }

    /// Sensors as other Minis may be, and one whose lamps are all elsewhere.
    fn units() -> Vec<[Change; 3]> {
        let drawn = |unit: u64| {
            let rng = &mut frame_rng(11, unit);
            let lamps =
                [0, 1, 2].map(|_| Change { strength: around_zero(rng, 0.35), turn_deg: around_zero(rng, 20.0) });
            let mean = lamps.iter().map(|lamp| lamp.strength).sum::<f64>() / 3.0;
            lamps.map(|lamp| Change { strength: lamp.strength - mean, ..lamp })
        };
        let turned = |strength: f64, turn_deg: f64| Change { strength, turn_deg };
        (0..6).map(drawn).chain([[turned(-0.2, 95.0), turned(0.1, -125.0), turned(0.1, 41.0)]]).collect()
    }

    #[test]
    fn lamps_that_were_turned_and_dimmed_are_found_from_touches_of_letters() {
        let mut errors = Vec::new();
        for (unit, (lamps, side)) in units().into_iter().zip([Side::Hole, Side::Peg].into_iter().cycle()).enumerate() {
            let (at_rest, frames, view) = touches(&lamps, side, 40);
            let found = fit(&at_rest, &frames, view).unwrap();
            for ((found, error), truth) in found.changes.iter().zip(&found.errors).zip(lamps) {
                let strength = found.strength - truth.strength;
                let turn_deg = wrap_angle((found.turn_deg - truth.turn_deg).to_radians()).to_degrees();
                println!(
                    "{unit} {side:?}: {truth:?}, off by {strength:.3} +- {:.3}, {turn_deg:.1} +- {:.1} degrees",
                    error.strength, error.turn_deg
                );
                errors.push([strength, turn_deg, strength / error.strength, turn_deg / error.turn_deg]);
            }
            assert!(found.n_touches > 30 && found.curl_share < 0.5);
            assert_eq!(found.calibration.light.response(), lit(&found.changes).response());
        }
        let rms = |k: usize| (errors.iter().map(|of| of[k] * of[k]).sum::<f64>() / errors.len() as f64).sqrt();
        let [strength, turn_deg, strength_z, turn_z] = [0, 1, 2, 3].map(rms);
        println!("rms {strength:.3}, {turn_deg:.1} degrees; of the stated errors {strength_z:.2}, {turn_z:.2}");
        assert!(strength < 0.08 && turn_deg < 5.0, "{strength} {turn_deg}");
        assert!(strength_z < 2.0 && turn_z < 2.0, "{strength_z} {turn_z}");
    }

    #[test]
    fn too_few_touches_and_touches_of_nothing_are_refused() {
        let (at_rest, frames, view) = touches(&Default::default(), Side::Peg, 19);
        let error = fit(&at_rest, &frames, view).unwrap_err().to_string();
        assert!(error.starts_with("calibration: expected 20 touches of edges or more"), "{error}");
        let twice = [&frames[..], &frames[..]].concat();
        assert!(fit(&at_rest, &twice, view).unwrap_err().to_string().contains("of 38 frames"));
        let blank = vec![at_rest.clone(); 30];
        let error = fit(&at_rest, &blank, view).unwrap_err().to_string();
        assert!(error.contains("got 0 of 30 frames"), "{error}");
        let small = Frame::new(80, 60, vec![90; 3 * 80 * 60]).unwrap();
        assert!(fit(&at_rest, &[small], view).is_err());
    }
}
