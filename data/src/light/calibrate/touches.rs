//! A calibration from touches of anything: neither what was touched nor where is known ([`touch_light`](crate::light::touch_light)).

use super::{Calibration, SCHEMA, at_rest};
use crate::error::Result;
use crate::frame::Frame;
use crate::light::lamps::Lamps;
use crate::light::touch_light::{SensorLight, TouchFit};
use crate::sensor::light::LightRig;

/// Fits lamps to frames of touches under a sensor at rest, which show `field_of_view_mm`. Frames that show no edge, and dark ones, are left
/// out.
///
/// # Errors
/// Frames of another size than the one at rest, fewer than [`MIN_TOUCHES`](crate::light::touch_light::MIN_TOUCHES) that show an edge, and
/// touches that do not say which lamps they were lit by.
pub fn fit(no_contact: &Frame, frames: &[Frame], field_of_view_mm: [f64; 2]) -> Result<(Calibration, TouchFit)> {
    let mut light = SensorLight::new(no_contact, field_of_view_mm)?;
    frames.iter().try_for_each(|frame| light.add(frame))?;
    let fit = light.fit()?;
    let [strength, turn_deg] = fit.factors();
    let light = LightRig::default().varied(strength, turn_deg);
    let source = format!("{} touches, without labels", fit.n_touches);
    let calibration = under(no_contact, light, field_of_view_mm, source)?;
    Ok((calibration, fit))
}

/// A calibration whose lamps are known, for touches of known parts to go on from ([`twins`](super::twins)).
///
/// # Errors
/// A frame at rest that no light has.
pub fn of_lamps(no_contact: &Frame, lamps: &Lamps, field_of_view_mm: [f64; 2]) -> Result<Calibration> {
    let Lamps { along_x, along_y } = *lamps;
    let light = LightRig { along_x, along_y, ..LightRig::default() };
    under(no_contact, light, field_of_view_mm, "known lamps".to_owned())
}

/// A light over a frame at rest, of a gel that is not known.
fn under(no_contact: &Frame, light: LightRig, field_of_view_mm: [f64; 2], source: String) -> Result<Calibration> {
    Ok(Calibration {
        schema: SCHEMA.to_owned(),
        frame_px: [no_contact.width_px(), no_contact.height_px()],
        field_of_view_mm,
        source,
        gel_length_mm: None,
        contact_share: None,
        leave_one_out: None,
        light: LightRig { at_rest: at_rest(no_contact)?, ..light },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::touch::Side;
    use crate::light::touch_light::Change;
    use crate::pose::se2::{Se2, wrap_angle};
    use crate::scene::random::{around_zero, frame_rng};
    use crate::scene::{Kit, Letters, MazeParts, Parts, Scene};
    use crate::sensor::simulator::Simulator;

    /// Touches of letters, which are no MAZE parts, under a Mini's light that was changed.
    fn touches_of_letters(changes: &[Change; 3], side: Side, n: usize) -> (Frame, Vec<Frame>, [f64; 2]) {
        let mut scene = Scene::load("alphabet-small").unwrap();
        scene.parts = Parts::Kit(Kit {
            letters: Some(Letters {
                letters: "AEFKMRSX".into(),
                font: crate::scene::shape::glyph::Font::default(),
                height_mm: 12.0,
                max_width_mm: 16.0,
            }),
            ..Kit::default()
        });
        scene.sensor.light = LightRig::default()
            .varied(changes.map(|change| change.strength.exp()), changes.map(|change| change.turn_deg));
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
            let (at_rest, frames, view) = touches_of_letters(&lamps, side, 40);
            let found = fit(&at_rest, &frames, view).unwrap().1;
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
        }
        let rms = |k: usize| (errors.iter().map(|of| of[k] * of[k]).sum::<f64>() / errors.len() as f64).sqrt();
        let [strength, turn_deg, strength_z, turn_z] = [0, 1, 2, 3].map(rms);
        println!("rms {strength:.3}, {turn_deg:.1} degrees; of the stated errors {strength_z:.2}, {turn_z:.2}");
        assert!(strength < 0.08 && turn_deg < 5.0, "{strength} {turn_deg}");
        assert!(strength_z < 2.0 && turn_z < 2.0, "{strength_z} {turn_z}");
    }

    #[test]
    fn too_few_touches_and_touches_of_nothing_are_refused() {
        let (at_rest, frames, view) = touches_of_letters(&Default::default(), Side::Peg, 19);
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

    /// Touches of MAZE parts, holes and pegs in turn, under a Mini's light.
    fn touches_of_parts(n: usize) -> (Frame, Vec<Frame>, [f64; 2]) {
        let mut scene = Scene::load("alphabet-small").unwrap();
        let (size_mm, reach_mm) = ([8.0, 40.0], 8.0);
        let parts =
            MazeParts { n, first: 0, seed: 0, size_mm, play_mm: None, cut_share: None, bar_mm: None, stretch_mm: None };
        scene.parts = Parts::Kit(Kit { maze_parts: Some(parts), ..Kit::default() });
        scene.clearance_mm = 0.0;
        let (simulator, view) = (Simulator::new(scene.clone(), 0).unwrap(), scene.sensor.field_of_view_mm);
        let frames = (0..n).map(|part| {
            let mut rng = frame_rng(0, part as u64);
            let [x, y] = [0, 1].map(|_| around_zero(&mut rng, reach_mm));
            let pose = Se2::from_degrees(x, y, around_zero(&mut rng, 180.0));
            let side = if part.is_multiple_of(2) { Side::Peg } else { Side::Hole };
            simulator.touch(part, side, &pose, &mut rng).unwrap()
        });
        (simulator.no_contact(0), frames.collect(), view)
    }

    /// The numbers that a Mini is known by, of fewer touches.
    #[test]
    fn touches_under_a_minis_lamps_say_so() {
        let (at_rest, frames, view) = touches_of_parts(400);
        let (calibration, found) = fit(&at_rest, &frames, view).unwrap();
        for (change, error) in found.changes.iter().zip(&found.errors) {
            println!("{change:?} +- {error:?}");
            assert!(change.strength.abs() < 0.03 && change.turn_deg.abs() < 2.0, "{change:?}");
        }
        assert_eq!(calibration.light.response(), found.lamps());
        assert!(found.line().starts_with("red 1.0") || found.line().starts_with("red 0.9"), "{}", found.line());
    }

    #[test]
    fn a_run_learns_after_twenty_forty_and_eighty_touches_and_forgets_under_another_light() {
        let (at_rest, frames, view) = touches_of_letters(&Default::default(), Side::Peg, 100);
        let mut light = SensorLight::new(&at_rest, view).unwrap();
        let mut learnt = Vec::new();
        for frame in &frames {
            light.add(frame).unwrap();
            learnt.extend(light.learn().map(|found| found.n_touches));
        }
        assert_eq!((learnt, light.learns()), (vec![20, 40, 80], false));
        assert!(light.lamps().is_some());
        let brighter = |times: f32| {
            let [width, height] = [at_rest.width_px(), at_rest.height_px()];
            let rgb = at_rest.rgb().iter().enumerate().map(|(i, value)| {
                let times = if i / 3 % width < width / 2 { times } else { 1.0 };
                (f32::from(*value) * times) as u8
            });
            Frame::new(width, height, rgb.collect()).unwrap()
        };
        let same = light.clone().with_rest(&brighter(1.01)).unwrap();
        assert_eq!((same.lamps(), same.learns()), (light.lamps(), false));
        let other = light.with_rest(&brighter(0.7)).unwrap();
        assert!(other.lamps().is_none() && other.learns());
    }
}
