//! A sensor's light and gel, from touches whose part and pose are known: no ball is needed.
//!
//! What touches of anything leave open ([`touch_light`](crate::light::touch_light)) such touches tell. The gel over each part is simulated for some
//! lengths of it and some depths of press; how each channel answers its slopes and its depth over the frame is then linear
//! ([`LightRig`]), and fitted by least squares, with the light that is given as what is known before. Which
//! terms the light has, and how strongly what is known holds, is what predicts touches left out best. The gel's length is that under which
//! touches left out are most like their twins: the share of a picture's energy that a multiple of its twin explains, the mean over the
//! touches, each with the depth of press that suits it best. The light is fitted at the scene's depth, at which its bank is simulated: a deeper
//! press and a stronger light show flat parts alike.

use rayon::prelude::*;
use serde::Serialize;

use super::Calibration;
use super::fit::{MODELS, Model};
use super::least_squares::Sums;
use super::light_factors::{N_BASES, N_TERMS, change, depth_bases, factors, light, place, weights_of};
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::frame::{Background, Frame, Preprocessing};
use crate::light::lamps::Lamps;
use crate::light::touch_light::Change;
use crate::pose::se2::{Se2, wrap_angle};
use crate::scene::Scene;
use crate::sensor::light::LightRig;
use crate::sensor::simulator::Simulator;
use crate::sensor::{Fidelity, SensorSpec};

/// Fewer touches say too little.
pub const MIN_TOUCHES: usize = 10;

/// More than this many hardly say more.
pub const MOST_TOUCHES: usize = 60;

/// Lengths of the gel that are tried, mm, each 1.2 times the one before, and depths of press, mm.
const GEL_LENGTHS_MM: [f64; 11] = [0.69, 0.83, 1.0, 1.2, 1.44, 1.73, 2.07, 2.49, 2.99, 3.58, 4.3];
const DEPTHS_MM: [f64; 5] = [0.35, 0.7, 1.1, 1.7, 2.6];

/// The size at which pictures are compared, pixels, and how many pixels of the simulated gel are one of these along each axis.
const SIZE_PX: [usize; 2] = [40, 30];
const BLOCK: usize = 4;

/// How much a weight's square may cost that is not as it is given, counts squared a pixel.
const RIDGES: [f64; 3] = [1e-4, 1e-3, 1e-2];

/// Times that multiples and light are fitted in turn.
const ROUNDS: usize = 3;

/// Pictures of which more is unlike their twins are of other parts or poses.
const MOST_UNEXPLAINED: f64 = 0.5;

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
    /// How each lamp differs from a Mini's in the frame's middle.
    pub lamps: [Change; 3],
    /// Standard deviations of these, had others been made.
    pub lamp_errors: [Change; 3],
    /// The mean correlation of pictures with their twins, of differences from rest, under a light that has not seen them, -1..=1.
    pub correlation: f64,
    /// Touches that this is of.
    pub n_touches: usize,
}

/// What a touch shows, RGB counts, and what the light of each of its pixels depends on.
type Picture = Vec<[f64; 3]>;
type Bases = Vec<[f64; N_BASES]>;

/// The share of a picture's energy that no multiple of its twin explains, by the gel's length.
type Unexplained = [f64; GEL_LENGTHS_MM.len()];

/// A sensor's pictures of parts that are known.
struct Touched<'a> {
    scene: &'a Scene,
    field_of_view_mm: [f64; 2],
    given: LightRig,
    touches: &'a [KnownTouch],
    /// At rest, RGB counts.
    rest: Picture,
    /// What each touch shows more than that, its exposure compensated.
    pictures: Vec<Picture>,
}

/// A light that was fitted.
struct Lit {
    model: Model,
    ridge: f64,
    /// What was given, as strong as the touches are.
    given: [Vec<f64>; 3],
    /// What each touch says of how the light differs from that.
    sums: Vec<Sums>,
}

/// Fits gel and light to touches of a scene's parts under a sensor at rest, whose light is `calibration`'s so far. What is found is put
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
    let field_of_view_mm = calibration.field_of_view_mm;
    let counts = Preprocessing { field_of_view_mm, ..Preprocessing::counts(SIZE_PX) };
    let background = Background::new(no_contact, &counts)?;
    let pictures = touches.iter().map(|touch| Ok(pixels(&background.tactile_image(&touch.frame)?.planes)));
    let pictures = pictures.collect::<Result<Vec<_>>>()?;
    let rest = pixels(background.at_rest());
    let touched = Touched { scene, field_of_view_mm, given: calibration.light.clone(), touches, rest, pictures };
    let mut unexplained = vec![[1.0; GEL_LENGTHS_MM.len()]; touches.len()];
    for (at, gel_length_mm) in GEL_LENGTHS_MM.into_iter().enumerate() {
        let of_gel = touched.unexplained(gel_length_mm)?;
        unexplained.iter_mut().zip(of_gel).for_each(|(touch, share)| touch[at] = share);
    }
    let gel_length_mm = gel(&unexplained)?;
    let lit = touched.light(gel_length_mm)?;
    let weights = lit.without(&[])?;
    calibration.gel_length_mm = Some(gel_length_mm);
    let shadow = calibration.light.shadow;
    calibration.light = LightRig { shadow, ..light(&weights, calibration.light.at_rest) };
    calibration.source = format!("{}; {} of known parts", calibration.source, touches.len());
    let left_out = |out: usize| {
        let others = unexplained.iter().enumerate().filter(|(i, _)| *i != out).map(|(_, one)| *one);
        let gel_length_mm = gel(&others.collect::<Vec<_>>()).ok()?;
        Some(LeftOut { gel_length_mm, lamps: lamps(&lit.without(&[out]).ok()?) })
    };
    let left_out: Vec<LeftOut> = (0..touches.len()).into_par_iter().filter_map(left_out).collect();
    let correlation = |one: &Unexplained| (1.0 - between(one, gel_length_mm)).max(0.0).sqrt();
    Ok(TwinFit {
        gel_length_mm,
        gel_error: jackknife(&left_out, |one| one.gel_length_mm.ln()),
        lamps: lamps(&weights),
        lamp_errors: [0, 1, 2].map(|lamp| Change {
            strength: jackknife(&left_out, |one| one.lamps[lamp].strength),
            turn_deg: jackknife(&left_out, |one| one.lamps[lamp].turn_deg),
        }),
        correlation: unexplained.iter().map(correlation).sum::<f64>() / touches.len() as f64,
        n_touches: touches.len(),
    })
}

impl Touched<'_> {
    /// What no twin explains of each touch under a gel of a length, by a light that the touch had no part in: the odd touches by the even
    /// ones, and the other way round.
    fn unexplained(&self, gel_length_mm: f64) -> Result<Vec<f64>> {
        let lit = self.light(gel_length_mm)?;
        let half = |first: usize| lit.without(&(first..self.touches.len()).step_by(2).collect::<Vec<_>>());
        let weights = [half(0)?, half(1)?];
        let mut least = vec![1.0_f64; self.touches.len()];
        let simulator = self.simulator(gel_length_mm, DEPTHS_MM)?;
        for depth_mm in DEPTHS_MM.into_iter().chain([self.scene.sensor.depth_mm]) {
            let of_touch = |((at, bases), picture): ((usize, Bases), &Picture)| {
                let twin = self.compensated(&shown(&weights[at % 2], &bases));
                let [own, both, of_twin] = products(picture, &twin);
                if both > 0.0 { 1.0 - both * both / (own * of_twin) } else { 1.0 }
            };
            let bases = self.bases(&simulator, depth_mm)?;
            let found: Vec<f64> = bases.into_par_iter().enumerate().zip(&self.pictures).map(of_touch).collect();
            least.iter_mut().zip(found).for_each(|(least, found)| *least = least.min(found));
        }
        Ok(least)
    }

    /// The light under a gel of a length, all touches as deep as the scene's; each counts as strongly as it shows.
    fn light(&self, gel_length_mm: f64) -> Result<Lit> {
        let depth_mm = self.scene.sensor.depth_mm;
        let bases = self.bases(&self.simulator(gel_length_mm, [depth_mm])?, depth_mm)?;
        let mut given = weights_of(&self.given);
        let mut times = self.times(&given, &bases);
        let middle = median(&times);
        given.iter_mut().flatten().for_each(|weight| *weight *= middle);
        let mut found: Option<Lit> = None;
        for _ in 0..ROUNDS {
            if let Some(lit) = &found {
                times = self.times(&lit.without(&[])?, &bases);
            }
            let middle = median(&times);
            let weights = found.as_ref().map_or_else(|| Ok(given.clone()), |lit| lit.without(&[]))?;
            let of_touch = |((bases, picture), times): ((&Bases, &Picture), &f64)| {
                let times = (times / middle).clamp(1.0 / 3.0, 3.0);
                let bases: Bases = bases.iter().map(|bases| bases.map(|basis| times * basis)).collect();
                let gains = gains(&self.rest, &shown(&weights, &bases));
                sums_of(&given, &bases, &exposed(&self.rest, picture, gains))
            };
            let sums: Vec<Sums> = bases.par_iter().zip(&self.pictures).zip(&times).map(of_touch).collect();
            let candidates = MODELS.into_iter().flat_map(|model| RIDGES.map(|ridge| (model, ridge)));
            let errors = candidates.filter_map(|(model, ridge)| {
                Some((model, ridge, super::fit::left_out_error(&sums, model, ridge).ok()?))
            });
            let Some((model, ridge, _)) = errors.min_by(|a, b| a.2.total_cmp(&b.2)) else {
                return Err(Error::invalid(
                    "calibration",
                    "touches spread over the frame",
                    "touches that say too little",
                ));
            };
            found = Some(Lit { model, ridge, given: given.clone(), sums });
        }
        found.ok_or_else(|| Error::invalid("calibration", "at least one round", "none"))
    }

    /// What a picture shows once [`Background`] has compensated its exposure.
    fn compensated(&self, more: &Picture) -> Picture {
        exposed(&self.rest, more, gains(&self.rest, more).map(f64::recip))
    }

    /// The multiple of what each touch should show that is most like what it shows.
    fn times(&self, weights: &[Vec<f64>; 3], bases: &[Bases]) -> Vec<f64> {
        let of_touch = |(bases, picture): (&Bases, &Picture)| {
            let [_, both, of_twin] = products(picture, &self.compensated(&shown(weights, bases)));
            if of_twin > 0.0 && both > 0.0 { both / of_twin } else { 0.0 }
        };
        bases.iter().zip(&self.pictures).map(of_touch).collect()
    }

    /// The scene's parts under a gel of a length, pressed to depths from the least to the most of some.
    fn simulator<const N: usize>(&self, gel_length_mm: f64, depths_mm: [f64; N]) -> Result<Simulator> {
        let mut scene = self.scene.clone();
        scene.fidelity = Fidelity::Optics;
        let [least, most] = [f64::min, f64::max].map(|of| depths_mm.into_iter().fold(depths_mm[0], of));
        scene.sensor = SensorSpec {
            frame_px: SIZE_PX.map(|n| BLOCK * n),
            field_of_view_mm: self.field_of_view_mm,
            gel_length_mm,
            depth_mm: 0.5 * (least + most),
            depth_jitter_mm: 0.5 * (most - least),
            tilt_jitter_deg: 0.0,
            place_jitter_mm: 0.0,
            ..SensorSpec::default()
        };
        Simulator::new(scene, 1)
    }

    /// What the light of each touch's pixels depends on, at a depth of press, mm.
    fn bases(&self, simulator: &Simulator, depth_mm: f64) -> Result<Vec<Bases>> {
        let mm_per_px = simulator.scene().sensor.mm_per_px();
        let bases = |touch: &KnownTouch| {
            let depths = simulator.depths((touch.part, touch.side), &touch.part_from_sensor, depth_mm)?;
            Ok(block_bases(&depths, mm_per_px))
        };
        self.touches.par_iter().map(bases).collect()
    }
}

impl Lit {
    /// The light by all touches but some.
    fn without(&self, left_out: &[usize]) -> Result<[Vec<f64>; 3]> {
        let columns = self.model.columns();
        let mut sums = Sums::new(columns.len());
        let kept = self.sums.iter().enumerate().filter(|(at, _)| !left_out.contains(at));
        kept.for_each(|(_, one)| sums.combine(&one.select(&columns), 1.0));
        let mut weights = self.model.spread(&sums.solve(self.ridge)?);
        weights.iter_mut().flatten().zip(self.given.iter().flatten()).for_each(|(weight, given)| *weight += given);
        Ok(weights)
    }
}

/// What a touch says of how the light differs from the one that is given.
fn sums_of(given: &[Vec<f64>; 3], bases: &Bases, picture: &Picture) -> Sums {
    let mut sums = Sums::new(N_BASES * N_TERMS);
    for (pixel, (bases, seen)) in bases.iter().zip(picture).enumerate() {
        let factors = factors(*bases, place(pixel, SIZE_PX));
        let expected = change(given, &factors);
        sums.add(factors.as_flattened(), [0, 1, 2].map(|channel| seen[channel] - expected[channel]));
    }
    sums
}

/// What a light shows, RGB counts.
fn shown(weights: &[Vec<f64>; 3], bases: &Bases) -> Picture {
    let pixel = |(pixel, bases): (usize, &[f64; N_BASES])| change(weights, &factors(*bases, place(pixel, SIZE_PX)));
    bases.iter().enumerate().map(pixel).collect()
}

/// The exposures that [`Background`] takes a picture for that shows so much more than at rest: medians over the pixels.
fn gains(rest: &Picture, more: &Picture) -> [f64; 3] {
    [0, 1, 2].map(|channel| {
        let ratio = |(rest, more): (&[f64; 3], &[f64; 3])| 1.0 + more[channel] / rest[channel].max(1.0);
        let mut ratios: Vec<f64> = rest.iter().zip(more).map(ratio).collect();
        let middle = ratios.len() / 2;
        ratios.select_nth_unstable_by(middle, f64::total_cmp).1.clamp(0.5, 2.0)
    })
}

/// What a picture shows more than at rest, exposed so many times as much.
fn exposed(rest: &Picture, more: &Picture, times: [f64; 3]) -> Picture {
    let pixel = |(rest, more): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|c| (rest[c] + more[c]) * times[c] - rest[c]);
    rest.iter().zip(more).map(pixel).collect()
}

/// The bases of blocks of pixels: their means.
fn block_bases(depths: &[f32], mm_per_px: [f64; 2]) -> Bases {
    let [columns, rows] = SIZE_PX;
    let width = BLOCK * columns;
    let share = 1.0 / (BLOCK * BLOCK) as f64;
    let mut bases = vec![[0.0; N_BASES]; columns * rows];
    for pixel in 0..BLOCK * BLOCK * columns * rows {
        let (row, column) = (pixel / width, pixel % width);
        let of_pixel = depth_bases(depths, width, [column, row], mm_per_px);
        let block = &mut bases[row / BLOCK * columns + column / BLOCK];
        block.iter_mut().zip(of_pixel).for_each(|(sum, basis)| *sum += share * basis);
    }
    bases
}

/// `[3, height, width]` as pixels.
fn pixels(planes: &[f32]) -> Picture {
    let n = planes.len() / 3;
    (0..n).map(|pixel| [0, 1, 2].map(|channel| f64::from(planes[channel * n + pixel]))).collect()
}

/// The square of a picture, its product with a twin, and the square of that.
fn products(picture: &Picture, twin: &Picture) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (a, b) in picture.as_flattened().iter().zip(twin.as_flattened()) {
        [a * a, a * b, b * b].into_iter().zip(&mut sums).for_each(|(product, sum)| *sum += product);
    }
    sums
}

/// How lamps differ from a Mini's in the frame's middle.
fn lamps(weights: &[Vec<f64>; 3]) -> [Change; 3] {
    let Lamps { along_x, along_y } = LightRig::default().response();
    [0, 1, 2].map(|lamp| {
        let [own, mini] =
            [[weights[lamp][0], weights[lamp][N_TERMS]], [f64::from(along_x[lamp][0]), f64::from(along_y[lamp][0])]];
        let [length, of_mini] = [own, mini].map(|[x, y]| x.hypot(y).max(1e-6));
        let turned = own[1].atan2(own[0]) - mini[1].atan2(mini[0]);
        Change { strength: (length / of_mini).ln(), turn_deg: wrap_angle(turned).to_degrees() }
    })
}

/// What is found without one of the touches.
struct LeftOut {
    gel_length_mm: f64,
    lamps: [Change; 3],
}

/// The standard deviation of what was found, by what is found without each of the touches.
fn jackknife(left_out: &[LeftOut], of: impl Fn(&LeftOut) -> f64) -> f64 {
    let n = left_out.len().max(1) as f64;
    let mean = left_out.iter().map(&of).sum::<f64>() / n;
    (left_out.iter().map(|one| (of(one) - mean).powi(2)).sum::<f64>() * (n - 1.0) / n).sqrt()
}

/// The middle one of what is above zero; 1 where nothing is.
fn median(values: &[f64]) -> f64 {
    let mut positive: Vec<f64> = values.iter().copied().filter(|value| *value > 0.0).collect();
    positive.sort_by(f64::total_cmp);
    positive.get(positive.len() / 2).copied().unwrap_or(1.0)
}

/// The gel's length, mm.
fn gel(unexplained: &[Unexplained]) -> Result<f64> {
    let mean = |at: usize| unexplained.iter().map(|one| one[at]).sum::<f64>() / unexplained.len() as f64;
    let means: Unexplained = std::array::from_fn(mean);
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

/// What is known for the lengths tried, at a length between them: linear in its logarithm.
fn between(values: &Unexplained, length_mm: f64) -> f64 {
    let last = GEL_LENGTHS_MM.len() - 2;
    let low = GEL_LENGTHS_MM.iter().rposition(|known| *known <= length_mm).unwrap_or(0).min(last);
    let share = (length_mm / GEL_LENGTHS_MM[low]).ln() / (GEL_LENGTHS_MM[low + 1] / GEL_LENGTHS_MM[low]).ln();
    values[low] + share.clamp(0.0, 1.0) * (values[low + 1] - values[low])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::calibrate::SCHEMA;
    use crate::scene::random::{around_zero, frame_rng};
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
            for lamp in found.lamps {
                let strength = lamp.strength - f64::from(times).ln();
                assert!(strength.abs() < 0.1 && lamp.turn_deg.abs() < 4.0, "{times}: {found:?}");
            }
            assert!(found.correlation > 0.9, "{times}: {found:?}");
            assert_eq!(calibration.gel_length_mm, Some(found.gel_length_mm));
        }
    }

    #[test]
    fn a_gel_beyond_those_tried_is_refused() {
        let of = |unexplained: [f64; 11]| gel(&[unexplained]);
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
