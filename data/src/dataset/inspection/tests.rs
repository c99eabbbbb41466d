//! Each fault is found in a simulated recording that has it, and nothing in one that has none.

use super::*;
use crate::dataset::generate::{Places, Sampling, generate};
use crate::dataset::store::DatasetWriter;
use crate::dataset::touch::Side;
use crate::frame::Frame;
use crate::recording::contact;
use crate::scene::{Parts, Scene};
use crate::sensor::simulator::{Simulator, frame_rng};
use std::sync::OnceLock;

/// A clean recording: letters of `alphabet-small`, holes and pegs, at poses drawn from their reach.
fn clean() -> &'static Dataset {
    static CLEAN: OnceLock<Dataset> = OnceLock::new();
    CLEAN.get_or_init(|| simulated("alphabet-small", Places::Anywhere(10)))
}

fn simulated(preset: &str, places: Places) -> Dataset {
    let mut scene = Scene::preset(preset).unwrap();
    scene.sensor.frame_px = [80, 60];
    if let Parts::Maze(boards) = &mut scene.parts {
        (boards.n_boards, boards.n_held_out, boards.n_pairs) = (20, 2, 210);
    }
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let sampling = Sampling { sides: &[Side::Hole, Side::Peg], places, seed: 5, lab: None };
    generate(&scene, &sampling, &out, &|_, _| ()).unwrap();
    // The frames stay mapped when the folder is gone.
    Dataset::open(&out).unwrap()
}

fn found(dataset: &Dataset) -> Vec<Finding> {
    findings(dataset, &contact::measure(dataset).unwrap()).unwrap()
}

/// What is found in the clean recording after each of its touches was changed or, where `None`, left out.
fn found_after(change: impl Fn(usize, Frame, Touch) -> Option<(Frame, Touch)>) -> Vec<Finding> {
    found(&changed(clean().no_contact(), change))
}

fn changed(at_rest: &Frame, change: impl Fn(usize, Frame, Touch) -> Option<(Frame, Touch)>) -> Dataset {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let mut writer = DatasetWriter::create(&out, clean().meta().clone(), at_rest).unwrap();
    for i in 0..clean().len() {
        if let Some((frame, touch)) = change(i, clean().frame(i), clean().touch(i).clone()) {
            writer.push(&frame, &touch).unwrap();
        }
    }
    writer.finish().unwrap();
    Dataset::open(&out).unwrap()
}

fn kinds(findings: &[Finding]) -> Vec<Kind> {
    for finding in findings {
        assert!(!finding.message.contains('\n') && !finding.message.contains("  "), "{}", finding.message);
    }
    findings.iter().map(|finding| finding.kind).collect()
}

/// A frame whose values are computed from its own by place and value.
fn map(frame: &Frame, value: impl Fn(usize, usize, usize) -> f32) -> Frame {
    let (width, height) = (frame.width_px(), frame.height_px());
    let rgb = (0..3 * width * height).map(|at| value(at / 3 % width, at / 3 / width, at % 3).round() as u8).collect();
    Frame::new(width, height, rgb).unwrap()
}

fn value(frame: &Frame, x: usize, y: usize, channel: usize) -> f32 {
    f32::from(frame.rgb()[3 * (y * frame.width_px() + x) + channel])
}

#[test]
fn nothing_is_found_in_clean_recordings() {
    assert_eq!(found(clean()), []);
    // On its grid, part after part.
    assert_eq!(found(&simulated("alphabet-small", Places::EachPose)), []);
    assert_eq!(found(&simulated("maze", Places::EachPose)), []);
}

#[test]
fn sides_that_are_missing_are_named_unless_one_side_is_all_there_is() {
    let is = |touch: &Touch, part: &str, side| touch.part.as_deref() == Some(part) && touch.side == Some(side);
    let some = found_after(|_, frame, touch| {
        (!is(&touch, "A", Side::Peg) && !is(&touch, "C", Side::Hole)).then_some((frame, touch))
    });
    assert_eq!(kinds(&some), [Kind::MissingSide, Kind::MissingSide]);
    assert!(some[0].message.ends_with("with holes and without pegs: A"), "{}", some[0].message);
    assert!(some[1].message.ends_with("with pegs and without holes: C"), "{}", some[1].message);
    let pegs = found_after(|_, frame, touch| (touch.side == Some(Side::Peg)).then_some((frame, touch)));
    assert_eq!(kinds(&pegs), []);
}

#[test]
fn unequal_numbers_of_touches_are_told() {
    let is_a = |touch: &Touch| touch.part.as_deref() == Some("A") && touch.side == Some(Side::Hole);
    let some = found_after(|i, frame, touch| (!is_a(&touch) || i >= 2).then_some((frame, touch)));
    assert_eq!(kinds(&some), [Kind::UnequalTouches]);
    assert!(some[0].message.contains("8 of A hole, 10 of"), "{}", some[0].message);
    let one = found_after(|i, frame, touch| (i > 0).then_some((frame, touch)));
    assert_eq!(kinds(&one), []);
}

#[test]
fn times_that_go_back_are_told_within_their_episode() {
    let at = |episode: fn(usize) -> usize, time: fn(usize) -> f64| {
        found_after(move |i, frame, touch| {
            let (episode, time_s) = (Some(episode(i).to_string()), Some(time(i)));
            Some((frame, Touch { episode, time_s, ..touch }))
        })
    };
    assert_eq!(kinds(&at(|i| i / 10, |i| (i % 10) as f64)), []);
    let back = at(|_| 0, |i| if i == 33 { 30.5 } else { i as f64 });
    assert_eq!((kinds(&back), &back[0].frames), (vec![Kind::TimesGoBack], &vec![33]));
    assert!(back[0].message.contains("by up to 1.500 s"), "{}", back[0].message);
}

#[test]
fn a_pose_with_two_pictures_is_found_and_a_film_is_not() {
    let second = |moved: Option<Se2>, x_mm: f64| {
        found_after(move |i, frame, touch| {
            let pose = clean().touch(3).part_from_sensor.map(|pose| Se2 { x_mm: pose.x_mm + x_mm, ..pose });
            let touch = if i == 5 { Touch { part_from_sensor: pose, moved, ..touch } } else { touch };
            Some((frame, touch))
        })
    };
    let same = second(None, 0.04);
    assert_eq!((kinds(&same), &same[0].frames), (vec![Kind::RepeatedPose], &vec![5]));
    assert!(same[0].message.contains("first frames 3 and 5"), "{}", same[0].message);
    assert_eq!(kinds(&second(None, 0.1)), []);
    assert!(!kinds(&second(Some(Se2::IDENTITY), 0.0)).contains(&Kind::RepeatedPose));
}

#[test]
fn a_pose_far_from_every_other_is_found() {
    let moved_by = |mm: f64| {
        found_after(move |i, frame, mut touch| {
            if let Some(pose) = touch.part_from_sensor.as_mut().filter(|_| i == 7) {
                pose.x_mm += mm;
            }
            Some((frame, touch))
        })
    };
    let far = moved_by(60.0);
    assert_eq!((kinds(&far), &far[0].frames), (vec![Kind::LonelyPose], &vec![7]));
    assert_eq!(kinds(&moved_by(0.5)), []);
}

#[test]
fn frames_of_a_frozen_camera_are_found() {
    let frozen =
        found_after(|i, frame, touch| Some((if i == 21 || i == 22 { clean().frame(20) } else { frame }, touch)));
    assert_eq!((kinds(&frozen), &frozen[0].frames), (vec![Kind::FrozenCamera], &vec![21, 22]));
    assert!(frozen[0].message.contains("first that of frame 20"), "{}", frozen[0].message);
}

#[test]
fn a_frame_at_rest_of_another_exposure_is_found() {
    let with_rest = |gain: f32| {
        let rest = clean().no_contact();
        let at_rest = map(rest, |x, y, channel| (value(rest, x, y, channel) / gain).min(255.0));
        found(&changed(&at_rest, |_, frame, touch| Some((frame, touch))))
    };
    let other = with_rest(1.15);
    assert_eq!(kinds(&other), [Kind::RestExposure]);
    // Red is 79 counts at rest: 79 - 79 / 1.15 is 10.3, less what the touches themselves change.
    assert!(other[0].message.contains("from the frame at rest by +9"), "{}", other[0].message);
    assert_eq!(kinds(&with_rest(0.85)), [Kind::RestExposure]);
    assert_eq!(kinds(&with_rest(1.02)), []);
}

/// The clean recording, with the frames of a range taken with another exposure.
fn exposed(range: std::ops::Range<usize>, gain: f32) -> Vec<Finding> {
    found_after(move |i, frame, touch| {
        let brighter = map(&frame, |x, y, channel| (gain * value(&frame, x, y, channel)).min(255.0));
        Some((if range.contains(&i) { brighter } else { frame }, touch))
    })
}

#[test]
fn frames_of_another_exposure_are_named() {
    let n = clean().len();
    for gain in [1.06_f32, 1.1, 1.17, 0.94, 0.9, 0.83] {
        for range in [n / 2..n, 0..n / 2, n / 3..2 * n / 3] {
            // A third of 240 frames, each of which drifts by 6 % by itself.
            if range.len() < n / 2 && (gain - 1.0).abs() < 0.09 {
                continue;
            }
            let some = exposed(range.clone(), gain);
            assert_eq!(kinds(&some), [Kind::ChangedExposure], "{range:?} {gain}");
            // Frames drift by more than that, each by itself: the group's ends are known to a few frames.
            let (named, as_made) = (&some[0].frames, range.len());
            let n_right = named.iter().filter(|frame| range.contains(frame)).count();
            assert!(10 * n_right >= 8 * as_made && 10 * n_right >= 8 * named.len(), "{range:?} {gain}: {some:?}");
            let word = if gain > 1.0 { "brighter" } else { "darker" };
            let ends = format!("frames {} to {} are", named[0], named[named.len() - 1]);
            assert!(some[0].message.contains(word) && some[0].message.starts_with(&ends), "{some:?}");
        }
    }
}

#[test]
fn a_change_of_exposure_below_the_noise_or_of_few_frames_is_none() {
    let n = clean().len();
    for (range, gain) in [(n / 2..n, 1.02), (n / 2..n, 0.98), (0..n, 1.02), (7..12, 1.17)] {
        assert_eq!(kinds(&exposed(range.clone(), gain)), [], "{range:?} {gain}");
    }
}

#[test]
fn a_sensor_that_moved_or_was_changed_is_found() {
    let n = clean().len();
    let moved_by = |mm: f64| {
        let px = (mm / clean().meta().mm_per_px[0]).round() as usize;
        found_after(move |i, frame, touch| {
            let shifted = map(&frame, |x, y, channel| value(&frame, (x + px).min(frame.width_px() - 1), y, channel));
            Some((if i > n / 2 { shifted } else { frame }, touch))
        })
    };
    assert_eq!(kinds(&moved_by(0.93)), [Kind::ChangedSensor]);
    assert_eq!(kinds(&moved_by(0.2)), []);
    // A lamp that fades from left to right.
    let lamp = found_after(|i, frame, touch| {
        let dimmed = map(&frame, |x, y, channel| {
            value(&frame, x, y, channel) * if channel == 0 { 1.0 - 0.003 * x as f32 } else { 1.0 }
        });
        Some((if i > n / 2 { dimmed } else { frame }, touch))
    });
    assert!(kinds(&lamp).contains(&Kind::ChangedSensor), "{lamp:?}");
    // Another exposure is no other sensor.
    let gain = found_after(|i, frame, touch| {
        let dimmed = map(&frame, |x, y, channel| value(&frame, x, y, channel) * 0.95);
        Some((if i > n / 2 { dimmed } else { frame }, touch))
    });
    assert_eq!(kinds(&gain), [Kind::ChangedExposure]);
}

#[test]
fn touches_that_missed_are_counted() {
    let mut scene = Scene::preset("alphabet-small").unwrap();
    scene.sensor.frame_px = [80, 60];
    let simulator = Simulator::new(scene, 1).unwrap();
    let missed = |every: usize| {
        found_after(|i, frame, touch| {
            // Beside the letter, over nothing.
            let beside = |rng: &mut _| simulator.touch(0, Side::Peg, &Se2::new(60.0, 60.0, 0.0), rng).unwrap();
            Some((if i % every == 0 { beside(&mut frame_rng(9, i as u64)) } else { frame }, touch))
        })
    };
    let some = missed(10);
    assert_eq!(kinds(&some), [Kind::NoContact]);
    // Those that were replaced, and hardly another.
    assert!((0..240).step_by(10).all(|i| some[0].frames.contains(&i)) && some[0].frames.len() <= 26, "{some:?}");
    assert_eq!(kinds(&missed(60)), []);
}
