//! How strong a sensor's lamps are together, and its gel, from touches whose part and pose are known.
//!
//! What touches of anything leave open ([`touch_light`](crate::touch_light)) their simulated twins tell: pictures of the same parts at the
//! same poses, under the lamps so far, for each of some lengths of the gel. The length is that at which pictures are most alike: the share
//! of a picture's energy that a multiple of its twin explains, the mean over the touches, each with the depth of press that suits it best.
//! How strong the lamps are is the median of those multiples at the scene's depth, at which its bank is simulated: a deeper press and a
//! stronger light show flat parts alike.

use rayon::prelude::*;
use serde::Serialize;

use super::Calibration;
use crate::error::{Error, Result};
use crate::frame::{Background, Frame, Preprocessing};
use crate::random::frame_rng;
use crate::scene::Scene;
use crate::se2::Se2;
use crate::sensor::{Fidelity, SensorSpec};
use crate::simulator::Simulator;
use crate::touch::Side;

/// Fewer touches say too little.
pub const MIN_TOUCHES: usize = 10;

/// More than this many hardly say more.
pub const MOST_TOUCHES: usize = 60;

/// Lengths of the gel that are tried, mm, each 1.2 times the one before, and depths of press, mm.
const GEL_LENGTHS_MM: [f64; 11] = [0.69, 0.83, 1.0, 1.2, 1.44, 1.73, 2.07, 2.49, 2.99, 3.58, 4.3];
const DEPTHS_MM: [f64; 5] = [0.35, 0.7, 1.1, 1.7, 2.6];

/// The size at which pictures are compared, pixels, and that of the simulated frames.
const SIZE_PX: [usize; 2] = [40, 30];
const FRAME_PX: [usize; 2] = [160, 120];

/// A touch of a part that is known.
#[derive(Clone, Debug)]
pub struct KnownTouch {
    /// The frame.
    pub frame: Frame,
    /// The part, a number of the scene's.
    pub part: usize,
    /// The side of it.
    pub side: Side,
    /// Where it was touched.
    pub part_from_sensor: Se2,
}

/// What such touches tell.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TwinFit {
    /// The length over which the gel's surface falls next to a contact, mm.
    pub gel_length_mm: f64,
    /// The standard deviation of its logarithm, had others been made.
    pub gel_error: f64,
    /// How much stronger the lamps are than those given, the natural logarithm.
    pub strength: f64,
    /// Its standard deviation, had others been made.
    pub strength_error: f64,
    /// The mean correlation of pictures with their twins, of differences from rest, -1..=1.
    pub correlation: f64,
    /// Touches that this is of.
    pub n_touches: usize,
}

/// How one picture compares with its twins.
#[derive(Clone, Copy, Debug)]
struct Compared {
    /// The share of its energy that no multiple of a twin explains, by the gel's length.
    unexplained: [f64; GEL_LENGTHS_MM.len()],
    /// The multiple that explains it best at the scene's depth, by the gel's length.
    times: [f64; GEL_LENGTHS_MM.len()],
}

/// Fits gel and strength to touches of a scene's parts under a sensor at rest, whose light is `calibration`'s so far. What is found is put
/// into it.
///
/// # Errors
/// Fewer than [`MIN_TOUCHES`], frames of another size, parts that the scene does not have, pictures unlike their twins, and a gel longer than
/// those that are tried.
pub fn fit(
    calibration: &mut Calibration,
    scene: &Scene,
    no_contact: &Frame,
    touches: &[KnownTouch],
) -> Result<TwinFit> {
    if touches.len() < MIN_TOUCHES {
        let expected = format!("{MIN_TOUCHES} touches or more of the scene's parts, whose pose is known");
        return Err(Error::invalid("calibration", expected, touches.len().to_string()));
    }
    let counts = Preprocessing { field_of_view_mm: calibration.field_of_view_mm, ..Preprocessing::counts(SIZE_PX) };
    let background = Background::new(no_contact, &counts)?;
    let pictures = touches.iter().map(|touch| Ok(background.tactile_image(&touch.frame)?.planes));
    let pictures = pictures.collect::<Result<Vec<_>>>()?;
    let usual_mm = scene.sensor.depth_mm;
    let mut found =
        vec![Compared { unexplained: [1.0; GEL_LENGTHS_MM.len()], times: [0.0; GEL_LENGTHS_MM.len()] }; touches.len()];
    for (at, gel_length_mm) in GEL_LENGTHS_MM.into_iter().enumerate() {
        for depth_mm in DEPTHS_MM.into_iter().chain([usual_mm]) {
            let twins = twins(&still(scene, calibration, [gel_length_mm, depth_mm])?, &counts, touches)?;
            for ((found, picture), twin) in found.iter_mut().zip(&pictures).zip(&twins) {
                let [own, both, of_twin] = [(picture, picture), (picture, twin), (twin, twin)].map(product);
                if of_twin > 0.0 && own > 0.0 && both > 0.0 {
                    let unexplained = 1.0 - both * both / (own * of_twin);
                    found.unexplained[at] = found.unexplained[at].min(unexplained);
                    if depth_mm == usual_mm {
                        found.times[at] = both / of_twin;
                    }
                }
            }
        }
    }
    let length = gel(&found)?;
    let strength = strength(&found, length);
    let n = found.len() as f64;
    let left_out = (0..found.len()).filter_map(|out| {
        let rest: Vec<Compared> = found.iter().enumerate().filter(|(i, _)| *i != out).map(|(_, one)| *one).collect();
        let of_rest = gel(&rest).ok()?;
        Some([(of_rest / length).ln(), self::strength(&rest, of_rest) - strength])
    });
    let left_out: Vec<[f64; 2]> = left_out.collect();
    let error = |of: usize| {
        let mean = left_out.iter().map(|errors| errors[of]).sum::<f64>() / n;
        (left_out.iter().map(|errors| (errors[of] - mean).powi(2)).sum::<f64>() * (n - 1.0) / n).sqrt()
    };
    calibration.gel_length_mm = Some(length);
    calibration.light = calibration.light.exposed(strength.exp() as f32);
    calibration.source = format!("{}; {} of known parts", calibration.source, found.len());
    Ok(TwinFit {
        gel_length_mm: length,
        gel_error: error(0),
        strength,
        strength_error: error(1),
        correlation: found.iter().map(|one| (1.0 - between(&one.unexplained, length)).sqrt()).sum::<f64>() / n,
        n_touches: found.len(),
    })
}

/// The gel's length, mm.
fn gel(found: &[Compared]) -> Result<f64> {
    let mean = |at: usize| found.iter().map(|one| one.unexplained[at]).sum::<f64>() / found.len() as f64;
    let means: [f64; GEL_LENGTHS_MM.len()] = std::array::from_fn(mean);
    let best = (0..means.len()).min_by(|a, b| means[*a].total_cmp(&means[*b])).unwrap_or(0);
    if means[best] > MOST_UNEXPLAINED {
        let got = format!("{:.0} % of what they show unlike it", 100.0 * means[best]);
        return Err(Error::invalid("calibration", "touches like the simulated ones of their parts", got));
    }
    let last = means.len() - 1;
    if best == last {
        let expected = format!("a gel whose length is less than {} mm", GEL_LENGTHS_MM[last]);
        return Err(Error::invalid("calibration", expected, "touches that are the more alike the longer it is"));
    }
    // The least of the parabola through it and its neighbours, in the logarithm.
    let middle = best.max(1);
    let [before, here, after] = [middle - 1, middle, middle + 1].map(|at| means[at]);
    let bend = before + after - 2.0 * here;
    let off = if bend > 0.0 { (0.5 * (before - after) / bend).clamp(-1.0, 1.0) } else { best as f64 - middle as f64 };
    let ratio = (GEL_LENGTHS_MM[middle + 1] / GEL_LENGTHS_MM[middle]).ln();
    Ok(GEL_LENGTHS_MM[middle] * (off * ratio).exp())
}

/// Pictures of which more is unlike their twins are of other parts or poses.
const MOST_UNEXPLAINED: f64 = 0.5;

/// How much stronger the lamps are under a gel of a length, a logarithm: the median of the touches.
fn strength(found: &[Compared], length_mm: f64) -> f64 {
    let times = found.iter().map(|one| between(&one.times, length_mm));
    let mut times: Vec<f64> = times.filter(|times| *times > 0.0).collect();
    times.sort_by(f64::total_cmp);
    times.get(times.len() / 2).map_or(0.0, |median| median.ln())
}

/// What is known for the lengths tried, at a length between them: linear in its logarithm.
fn between(values: &[f64; GEL_LENGTHS_MM.len()], length_mm: f64) -> f64 {
    let last = GEL_LENGTHS_MM.len() - 2;
    let low = GEL_LENGTHS_MM.iter().rposition(|known| *known <= length_mm).unwrap_or(0).min(last);
    let share = (length_mm / GEL_LENGTHS_MM[low]).ln() / (GEL_LENGTHS_MM[low + 1] / GEL_LENGTHS_MM[low]).ln();
    values[low] + share.clamp(0.0, 1.0) * (values[low + 1] - values[low])
}

/// A scene under a calibrated light and a gel, pressed to a depth, without all that varies from touch to touch.
fn still(scene: &Scene, calibration: &Calibration, [gel_length_mm, depth_mm]: [f64; 2]) -> Result<Simulator> {
    let mut scene = scene.clone();
    scene.fidelity = Fidelity::Camera;
    scene.sensor = SensorSpec {
        frame_px: FRAME_PX,
        field_of_view_mm: calibration.field_of_view_mm,
        light: calibration.light.clone(),
        gel_length_mm,
        depth_mm,
        depth_jitter_mm: 0.0,
        tilt_jitter_deg: 0.0,
        place_jitter_mm: 0.0,
        ..SensorSpec::default()
    };
    Simulator::new(scene, 1)
}

/// What the touches would show, `[3, height, width]` each, counts.
fn twins(simulator: &Simulator, counts: &Preprocessing, touches: &[KnownTouch]) -> Result<Vec<Vec<f32>>> {
    let background = Background::new(&simulator.no_contact(0), counts)?;
    let twin = |(number, touch): (usize, &KnownTouch)| {
        let KnownTouch { part, side, part_from_sensor, .. } = touch;
        let frame = simulator.touch(*part, *side, part_from_sensor, &mut frame_rng(0, number as u64))?;
        Ok(background.tactile_image(&frame)?.planes)
    };
    touches.par_iter().enumerate().map(twin).collect()
}

fn product((a, b): (&Vec<f32>, &Vec<f32>)) -> f64 {
    a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::SCHEMA;
    use crate::random::around_zero;
    use crate::sensor::light::LightRig;

    /// Touches of letters under a light `times` as strong as a Mini's, and a gel.
    fn touches(times: f32, gel_length_mm: f64, n: usize) -> (Calibration, Scene, Frame, Vec<KnownTouch>) {
        let scene = Scene::load("alphabet-small").unwrap();
        let light = LightRig::default();
        let mut other = scene.clone();
        other.sensor = SensorSpec { light: light.exposed(times), gel_length_mm, ..other.sensor };
        let simulator = Simulator::new(other, 3).unwrap();
        let touch = |i: usize| {
            let mut rng = frame_rng(5, i as u64);
            let [x, y] = [0, 1].map(|_| around_zero(&mut rng, 5.0));
            let part_from_sensor = Se2::from_degrees(x, y, around_zero(&mut rng, 90.0));
            let (part, side) = (i % 12, if i.is_multiple_of(2) { Side::Hole } else { Side::Peg });
            KnownTouch {
                frame: simulator.touch(part, side, &part_from_sensor, &mut rng).unwrap(),
                part,
                side,
                part_from_sensor,
            }
        };
        let calibration = Calibration {
            schema: SCHEMA.to_owned(),
            frame_px: [160, 120],
            field_of_view_mm: scene.sensor.field_of_view_mm,
            source: "touches".to_owned(),
            gel_length_mm: None,
            contact_share: None,
            leave_one_out: None,
            light,
        };
        let touches = (0..n).map(touch).collect();
        (calibration, scene, simulator.no_contact(3), touches)
    }

    #[test]
    fn gel_and_strength_are_found_from_touches_of_known_parts() {
        for (times, gel_mm) in [(0.75, 0.9), (1.3, 1.9)] {
            let (mut calibration, scene, no_contact, touches) = touches(times, gel_mm, 16);
            let found = fit(&mut calibration, &scene, &no_contact, &touches).unwrap();
            println!("{times} {gel_mm}: {found:?}");
            assert!((found.gel_length_mm / gel_mm).ln().abs() < 0.12, "{gel_mm}: {found:?}");
            assert!(
                (found.strength - f64::from(times).ln()).abs() < 0.1 && found.correlation > 0.9,
                "{times}: {found:?}"
            );
            assert_eq!(calibration.gel_length_mm, Some(found.gel_length_mm));
        }
    }

    #[test]
    fn a_gel_beyond_those_tried_is_refused() {
        let of = |unexplained: [f64; 11]| gel(&[Compared { unexplained, times: [1.0; 11] }]);
        let rising = std::array::from_fn(|at| 0.1 + 0.01 * at as f64);
        assert!((of(rising).unwrap() / 0.69).ln().abs() < 0.1);
        let falling = std::array::from_fn(|at| 0.4 - 0.01 * at as f64);
        assert!(of(falling).unwrap_err().to_string().contains("a gel whose length is less than 4.3 mm"));
    }

    #[test]
    fn few_touches_and_touches_of_other_parts_are_refused() {
        let (mut calibration, scene, no_contact, touches) = touches(1.0, 1.2, 12);
        let mut fit =
            |touches: &[KnownTouch]| fit(&mut calibration, &scene, &no_contact, touches).unwrap_err().to_string();
        assert!(fit(&touches[..9]).contains("10 touches or more") && fit(&touches[..9]).ends_with("got 9"));
        let moved = |touch: &KnownTouch| KnownTouch { part: (touch.part + 5) % 12, ..touch.clone() };
        let others: Vec<KnownTouch> = touches.iter().map(moved).collect();
        assert!(fit(&others).contains("touches like the simulated ones of their parts"), "{}", fit(&others));
    }
}
