//! Other sensors than the scene's own, one drawn for each MAZE board.

use rand::rngs::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::scene::random::{around_zero, frame_rng, uniform};
use crate::sensor::SensorSpec;

/// What differs from sensor to sensor, lowest and highest. Other lamps are not among it: pictures are
/// brought under the lamps that the network knows ([`Lamps`](crate::light::lamps::Lamps)).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SensorRange {
    /// How deep a board is pressed, mm.
    pub depth_mm: [f64; 2],
    /// Whether the depth's logarithm is drawn evenly, so that as many sensors press less deep than the geometric mean as deeper.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub log_depth: bool,
    /// The camera's noise, as a multiple of the scene's.
    pub noise: [f64; 2],
    /// Worst JPEG quality of a sensor; the best is [`Self::QUALITIES`] more.
    pub jpeg_quality: [u8; 2],
    /// Width and height of what a frame shows, as a multiple of the scene's: other drivers scale and crop.
    pub scale: [f64; 2],
    /// The smooth change that comes with a press, as a multiple of the scene's
    /// [`light_field`](SensorSpec::light_field).
    pub light_field: [f64; 2],
    /// Holes are felt by another sensor than pegs, drawn in the same ranges, as touches are compared with a bank that was
    /// made under another sensor. The size of its view is drawn in this range, as a factor of the view of the pegs'
    /// sensor. Without this one sensor feels both sides of a board.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub hole_scale: Option<[f64; 2]>,
}

/// How far a lamp that nobody measured is turned at most, degrees ...
const TURN_DEG: f64 = 20.0;

/// ... how strong it is, as a multiple of the scene's ...
const STRENGTH: [f64; 2] = [0.7, 1.4];

/// ... and what share of that it gains or loses from the middle of the frame to its border, along x and along y, at most.
const UNEVEN: f64 = 0.3;

/// Decay lengths of other gels, mm.
const GEL_LENGTH_MM: [f64; 2] = [0.8, 1.8];

impl Default for SensorRange {
    fn default() -> Self {
        Self {
            depth_mm: [0.35, 0.9],
            log_depth: false,
            noise: [0.5, 3.0],
            jpeg_quality: [30, 88],
            scale: [0.92, 1.1],
            light_field: [0.0, 4.0],
            hole_scale: None,
        }
    }
}

impl SensorRange {
    /// From the worst to the best JPEG quality of one sensor.
    pub const QUALITIES: u8 = 12;

    /// Width and height of the widest view that can be drawn, as a multiple of the scene's.
    pub fn widest(&self) -> f64 {
        self.scale[1] * self.hole_scale.map_or(1.0, |[_, most]| most.max(1.0))
    }

    /// The `number`-th of the sensors that a user may have instead of `spec`: other press, camera, gel and smooth light field,
    /// of the same view and lamps, which are stated or measured. Drawn from the default ranges; of the depth as a multiple of the
    /// default one, so that what is pressed deep stays so.
    pub fn another(spec: &SensorSpec, number: u64) -> SensorSpec {
        let mut rng = frame_rng(u64::from_be_bytes(*b"sensors "), number);
        let gel_length_mm = uniform(&mut rng, GEL_LENGTH_MM);
        let (range, times) = (Self::default(), spec.depth_mm / SensorSpec::default().depth_mm);
        let depth_mm = range.depth_mm.map(|mm| times * mm);
        Self { scale: [1.0; 2], depth_mm, ..range }.draw(SensorSpec { gel_length_mm, ..spec.clone() }, &mut rng)
    }

    /// `spec` with the `number`-th of the lights that a unit may have which nobody measured: each lamp turned, stronger or weaker, and
    /// fading otherwise over the frame. Two Minis' lamps differ by some 4 to 17 degrees and 10 %.
    pub fn another_light(spec: &SensorSpec, number: u64) -> SensorSpec {
        let mut rng = frame_rng(u64::from_be_bytes(*b"lights  "), number);
        let (strength, turn_deg) =
            ([0; 3].map(|_| uniform(&mut rng, STRENGTH)), [0; 3].map(|_| around_zero(&mut rng, TURN_DEG)));
        let uneven = [0; 3].map(|_| [0; 2].map(|_| around_zero(&mut rng, UNEVEN)));
        SensorSpec { light: spec.light.varied(strength, turn_deg).fading(uneven), light_known: false, ..spec.clone() }
    }

    /// A sensor drawn round `spec`.
    pub fn draw(&self, spec: SensorSpec, rng: &mut ChaCha8Rng) -> SensorSpec {
        let depth_mm =
            if self.log_depth { uniform(rng, self.depth_mm.map(f64::ln)).exp() } else { uniform(rng, self.depth_mm) };
        let noise = uniform(rng, self.noise);
        let worst = uniform(rng, self.jpeg_quality.map(f64::from)).round() as u8;
        let scale = uniform(rng, self.scale);
        SensorSpec {
            depth_mm,
            // As uneven as the scene's, for its depth.
            depth_jitter_mm: spec.depth_jitter_mm * depth_mm / spec.depth_mm,
            noise_counts: spec.noise_counts.map(|counts| noise * counts),
            jpeg_quality: [worst, (worst + Self::QUALITIES).min(100)],
            field_of_view_mm: spec.field_of_view_mm.map(|mm| scale * mm),
            light_field: spec.light_field.times(uniform(rng, self.light_field)),
            ..spec
        }
    }

    /// Refuses ranges that no sensor has, naming the field.
    pub(super) fn validate(&self) -> Result<()> {
        let quality = self.jpeg_quality.map(f64::from);
        for (field, [low, high], least, most) in [
            ("depth_mm", self.depth_mm, 0.05, 5.0),
            ("noise", self.noise, 0.0, 100.0),
            ("jpeg_quality", quality, 1.0, 100.0),
            ("scale", self.scale, 0.5, 2.0),
            ("light_field", self.light_field, 0.0, 100.0),
            ("hole_scale", self.hole_scale.unwrap_or([1.0; 2]), 0.5, 2.0),
        ] {
            if !(low >= least && high >= low && high <= most) {
                let expected = format!("{least} to {most}, in order");
                return Err(Error::invalid(format!("parts.maze.sensors.{field}"), expected, format!("{low}..{high}")));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::touch::Side;
    use crate::frame::Frame;
    use crate::pose::se2::Se2;
    use crate::scene::{Parts, Scene};
    use crate::sensor::light_field::LightField;
    use crate::sensor::simulator::Simulator;

    #[test]
    fn a_sensor_is_drawn_in_the_ranges_and_all_over_them() {
        let range = SensorRange::default();
        let scene = SensorSpec { light_field: LightField::FITTED, ..SensorSpec::default() };
        let drawn: Vec<SensorSpec> = (0..400).map(|i| range.draw(scene.clone(), &mut frame_rng(3, i))).collect();
        let covers = |value: &dyn Fn(&SensorSpec) -> f64, [low, high]: [f64; 2]| {
            let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
            for spec in &drawn {
                (least, most) = (least.min(value(spec)), most.max(value(spec)));
                spec.validate().unwrap();
            }
            // Of 400 the extreme ones are within a twentieth of the ends but for one time in 10^8.
            let near = 0.05 * (high - low);
            assert!(
                least >= low - 1e-9 && least < low + near && most <= high + 1e-9 && most > high - near,
                "{least} {most}"
            );
        };
        covers(&|spec| spec.depth_mm, range.depth_mm);
        covers(&|spec| spec.noise_counts[2] / scene.noise_counts[2], range.noise);
        covers(&|spec| spec.field_of_view_mm[0] / scene.field_of_view_mm[0], range.scale);
        covers(&|spec| spec.light_field.linear_counts / LightField::FITTED.linear_counts, range.light_field);
        assert!(drawn.iter().all(|spec| (spec.mm_per_px()[0] / spec.mm_per_px()[1] - 0.975_f64).abs() < 0.01));
    }

    #[test]
    fn another_sensor_is_the_same_for_a_number_and_shows_as_much() {
        let scene = SensorSpec::default();
        let drawn: Vec<SensorSpec> = (0..20).map(|number| SensorRange::another(&scene, number)).collect();
        assert_eq!(SensorRange::another(&scene, 7), drawn[7]);
        let gels: Vec<f64> = drawn.iter().map(|spec| spec.gel_length_mm).collect();
        assert!(gels.iter().all(|mm| (0.8..=1.8).contains(mm)) && gels.iter().any(|mm| *mm < 1.1));
        assert!(gels.iter().any(|mm| *mm > 1.5));
        // Three times as deep, and as uneven for that.
        let deep = SensorSpec { depth_mm: 1.8, depth_jitter_mm: 0.3, ..scene.clone() };
        for (number, drawn) in (0..).zip(&drawn) {
            let deep = SensorRange::another(&deep, number);
            assert!((deep.depth_mm - 3.0 * drawn.depth_mm).abs() < 1e-9, "{number}");
            assert!((deep.depth_jitter_mm - 0.5 * drawn.depth_mm).abs() < 1e-9, "{number}");
        }
        assert!(drawn.iter().all(|spec| spec.field_of_view_mm == scene.field_of_view_mm && spec.light == scene.light));
        drawn.iter().for_each(|spec| spec.validate().unwrap());
    }

    #[test]
    fn a_light_that_nobody_measured_is_near_the_scenes_and_changes_nothing_else() {
        let scene = SensorSpec::default();
        let towards = |spec: &SensorSpec, c: usize| {
            let [x, y] = [spec.light.along_x[c][0], spec.light.along_y[c][0]].map(f64::from);
            (x.hypot(y), y.atan2(x).to_degrees())
        };
        let (mut turns, mut strengths) = (Vec::new(), Vec::new());
        for number in 0..40 {
            let drawn = SensorRange::another_light(&scene, number);
            drawn.validate().unwrap();
            assert!(!drawn.light_known && drawn.known_lamps().is_none());
            assert_eq!(drawn.light.at_rest, scene.light.at_rest);
            for c in 0..3 {
                let ((strength, deg), (own, own_deg)) = (towards(&drawn, c), towards(&scene, c));
                turns.push((deg - own_deg + 540.0).rem_euclid(360.0) - 180.0);
                strengths.push(strength / own);
            }
            assert_eq!(SensorSpec { light: scene.light.clone(), light_known: true, ..drawn }, scene);
        }
        let range = |of: &[f64]| of.iter().fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(*v), b.max(*v)));
        let (((least, most), (weak, strong)), near) = ((range(&turns), range(&strengths)), 1e-3);
        assert!(least > -20.0 - near && least < -17.0 && most < 20.0 + near && most > 17.0, "{least} {most}");
        assert!(weak > 0.7 - near && weak < 0.75 && strong < 1.4 + near && strong > 1.35, "{weak} {strong}");
    }

    fn touch(sensors: Option<SensorRange>) -> Frame {
        let mut scene = Scene::preset("maze").unwrap();
        scene.sensor.frame_px = [40, 30];
        if let Parts::Maze(boards) = &mut scene.parts {
            (boards.n_boards, boards.n_held_out, boards.sensors) = (2, 1, sensors);
        }
        let simulator = Simulator::new(scene, 5).unwrap();
        simulator.touch(0, Side::Peg, &Se2::new(3.0, -4.0, 0.3), &mut frame_rng(1, 1_000)).unwrap()
    }

    #[test]
    fn a_range_of_nothing_leaves_each_pixel_and_another_does_not() {
        let fixed = SensorRange {
            depth_mm: [0.6; 2],
            log_depth: false,
            noise: [1.0; 2],
            jpeg_quality: [75; 2],
            scale: [1.0; 2],
            light_field: [1.0; 2],
            hole_scale: None,
        };
        let quality = SensorSpec::default().jpeg_quality;
        assert_eq!(quality, [75, 90]);
        let (own, same, other) = (touch(None), touch(Some(fixed)), touch(Some(SensorRange::default())));
        // The worst quality is the scene's, the best 3 less: a pixel differs by what compression loses.
        let far = |a: &Frame, b: &Frame| a.rgb().iter().zip(b.rgb()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
        assert!(far(&own, &same) <= 12, "{}", far(&own, &same));
        assert!(far(&own, &other) > 20, "{}", far(&own, &other));
    }

    #[test]
    fn a_depth_s_logarithm_is_drawn_evenly() {
        let range = SensorRange { depth_mm: [0.35, 2.5], log_depth: true, ..SensorRange::default() };
        let mut rng = frame_rng(5, 6);
        let depths: Vec<f64> = (0..4_000).map(|_| range.draw(SensorSpec::default(), &mut rng).depth_mm).collect();
        assert!(depths.iter().all(|depth| (0.35..=2.5).contains(depth)));
        // A quarter of the draws below each quarter of the logarithms, within four standard errors.
        for quarter in 1..4 {
            let bound = 0.35 * (2.5_f64 / 0.35).powf(0.25 * f64::from(quarter));
            let share = depths.iter().filter(|depth| **depth < bound).count() as f64 / 4_000.0;
            assert!((share - 0.25 * f64::from(quarter)).abs() < 0.032, "{bound} {share}");
        }
    }

    #[test]
    fn a_range_that_no_sensor_has_is_refused_by_name() {
        let mut scene = Scene::preset("maze").unwrap();
        let mut refusal = |sensors| {
            if let Parts::Maze(boards) = &mut scene.parts {
                boards.sensors = Some(sensors);
            }
            scene.validate().unwrap_err().to_string()
        };
        let range = SensorRange::default();
        assert!(refusal(SensorRange { scale: [1.1, 0.9], ..range }).starts_with("parts.maze.sensors.scale: expected"));
        assert!(refusal(SensorRange { depth_mm: [f64::NAN, 1.0], ..range }).contains("sensors.depth_mm"));
        assert!(refusal(SensorRange { jpeg_quality: [0, 90], ..range }).contains("sensors.jpeg_quality"));
    }
}
