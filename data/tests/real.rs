//! Frames of real sensors: where they show contact, and how well a fitted light predicts them.
//!
//! The recordings are not part of this project. The tests look for them where `TACTILE_REAL_GELSIGHT` says; a test
//! whose recordings are missing counts as ignored.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]

use std::env;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use libtest_mimic::{Arguments, Trial};
use tactile_data::dataset::compare::Figures;
use tactile_data::dataset::store::Dataset;
use tactile_data::light::calibrate::ball::BallPress;
use tactile_data::light::calibrate::fit::fit;
use tactile_data::light::calibrate::presses::{Press, Presses, Source};
use tactile_data::recording::contact::{contact_runs, measure};
use tactile_data::recording::folder::{Import, NoContact, import};
use tactile_data::sensor::SensorSpec;
use tactile_data::sensor::light::Shadow;
use tactile_data::sensor::optics::Optics;
use tactile_data::sensor::shadow::cast;

/// One press on a printed digit.
const DIGIT: &str = "gsmini-digits-tactilemnist/tactile-mnist-touch-real-seq-t256-320x240.gif";

/// Presses of a cuboid and of a ball.
const CUBOID: &str = "gsmini-markergel-feats";
const BALL: &str = "gelsight-ball-fots";

fn main() -> ExitCode {
    let tests = vec![
        test("a_press_is_contact_exactly_while_the_digit_is_seen", &[DIGIT], digit_is_contact_while_seen),
        test("other_presses_are_contact", &[CUBOID, BALL], other_presses_are_contact),
        test("presses_of_a_ball_left_out_of_the_fit_are_predicted", &[BALL], presses_left_out_are_predicted),
        test("shadows_add_nothing_to_presses_of_a_ball", &[BALL], shadows_add_nothing),
    ];
    libtest_mimic::run(&Arguments::from_args(), tests).exit_code()
}

/// A test that is ignored where one of the recordings it needs is missing.
fn test(name: &'static str, needs: &[&str], claim: fn()) -> Trial {
    let is_missing = needs.iter().any(|needed| !recording(needed).exists());
    let run = move || {
        claim();
        Ok(())
    };
    Trial::test(name, run).with_ignored_flag(is_missing)
}

/// The file or folder of a recording.
fn recording(name: &str) -> PathBuf {
    let default = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/real-gelsight");
    env::var_os("TACTILE_REAL_GELSIGHT").map_or_else(default, PathBuf::from).join(name)
}

fn contact_in(source: &Path, no_contact: NoContact) -> (usize, Vec<RangeInclusive<usize>>) {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let how = Import { no_contact, ..Import::default() };
    import(source, &how, &out, &|_, _| {}).unwrap();
    let dataset = Dataset::open(&out).unwrap();
    (dataset.len(), contact_runs(&measure(&dataset).unwrap()))
}

fn digit_is_contact_while_seen() {
    // By eye: a point of the stroke appears in frame 32 and the last of it fades after frame 50.
    for no_contact in [NoContact::Guess, NoContact::First(1)] {
        assert_eq!(contact_in(&recording(DIGIT), no_contact), (56, vec![32..=50]));
    }
}

fn other_presses_are_contact() {
    let cuboid = recording(CUBOID);
    let at_rest = cuboid.join("nocontact_train_sensor_derived.png");
    assert_eq!(contact_in(&cuboid, NoContact::File(at_rest)), (1, vec![0..=0]));
    let balls = recording(BALL);
    let at_rest = balls.join("gelsight_bg.png");
    assert_eq!(contact_in(&balls.join("images"), NoContact::File(at_rest)), (42, vec![0..=41]));
}

fn presses_of_a_ball(has_labels: bool) -> Presses {
    let folder = recording(BALL);
    let source = Source {
        no_contact: folder.join("gelsight_bg.png"),
        labels: has_labels.then(|| folder.join("annotate.csv")),
        ball_mm: 4.7,
        mm_per_px: [1.0 / 19.58; 2],
    };
    Presses::read(&folder.join("images"), &source).unwrap()
}

fn presses_left_out_are_predicted() {
    for has_labels in [true, false] {
        let figures = fit(&presses_of_a_ball(has_labels)).unwrap().calibration.leave_one_out.unwrap();
        assert!(figures.ratio <= 0.25 && figures.correlation >= 0.95, "{figures:?}");
    }
}

/// Six of the 42 presses rendered by the light of the others, as the simulator renders, with the shadows cast and
/// without.
fn shadows_add_nothing() {
    let mut presses = presses_of_a_ball(true);
    let (held, kept): (Vec<_>, Vec<_>) = presses.presses.drain(..).enumerate().partition(|(index, _)| index % 7 == 0);
    presses.presses = kept.into_iter().map(|(_, press)| press).collect();
    let calibration = fit(&presses).unwrap().calibration;
    let (geometry, gel_length_mm) = (presses.geometry, calibration.gel_length_mm.unwrap());
    let ([width, height], mm_per_px) = (geometry.frame_px, geometry.mm_per_px);
    let mean_l1 = |shadow: Option<Shadow>| {
        let mut calibration = calibration.clone();
        calibration.light.shadow = shadow.unwrap_or_default();
        let optics = Optics::new(&calibration.spec(SensorSpec::default()).unwrap());
        let optics = optics.over(&presses.no_contact).unwrap();
        let l1 = |press: &Press| {
            let radius_mm = geometry.radius_mm(&press.circle);
            let contact_mm = calibration.contact_share.unwrap() * radius_mm;
            let ball = BallPress::new(geometry.ball_radius_mm, contact_mm, gel_length_mm, 1.5 * radius_mm + 3.0);
            let depth = |i: usize| {
                let place = [(i % (width + 2)) as f64 - 1.0, (i / (width + 2)) as f64 - 1.0];
                let [x, y] = [0, 1].map(|axis| (place[axis] - press.circle.centre_px[axis]) * mm_per_px[axis]);
                ball.depth_mm(x.hypot(y)) as f32
            };
            let depths: Vec<f32> = (0..(width + 2) * (height + 2)).map(depth).collect();
            let mut rgb = optics.shade(&depths, mm_per_px);
            if shadow.is_some() {
                cast(&mut rgb, &depths, &optics, mm_per_px);
            }
            let near = |pixel: &usize| {
                let [x, y] = geometry.from_centre_mm(&press.circle, *pixel);
                x.hypot(y) <= 1.5 * radius_mm
            };
            let pairs = (0..width * height).filter(near).flat_map(|pixel| 3 * pixel..3 * pixel + 3).map(|i| {
                let rest = f64::from(optics.at_rest()[i]);
                [f64::from(rgb[i].clamp(0.0, 255.0)) - rest, f64::from(press.difference[i])]
            });
            Figures::of(&pairs.collect::<Vec<_>>()).l1_counts
        };
        held.iter().map(|(_, press)| l1(press)).sum::<f64>() / held.len() as f64
    };
    let (without, with) = (mean_l1(None), mean_l1(Some(Shadow::default())));
    let low = mean_l1(Some(Shadow { elevation_deg: 10.0, strength: 0.03, soft_mm: 0.05 }));
    assert!(without < 7.0 && (with - without).abs() < 0.05 && low > without, "{without}, {with}, {low} counts");
}
