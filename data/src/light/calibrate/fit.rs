//! From presses of a ball to the light that made them, and its error on presses left out.

use rayon::prelude::*;

use super::ball::BallPress;
use super::circle::Circle;
use super::contact::{CONTACT_RADII, Gel, STRIDE, ball_of, move_contact, pixels_near};
use super::least_squares::Sums;
use super::light_factors::{N_BASES, N_SLOPES, N_TERMS, bases, change, factors, light, place};
use super::presses::{Press, Presses};
use super::{Calibration, SCHEMA, at_rest};
use crate::dataset::compare::Figures;
use crate::error::{Error, Result};

/// Squared weights' price, counts squared a pixel.
const RIDGE: f64 = 1e-4;

/// Contacts are moved this often at most.
const MOST_ROUNDS: usize = 4;

/// Candidates for the contact's radius as a share of the circle's: a person takes the bright ring for its edge, and
/// some of the ring is outside.
const CONTACT_SHARES: [f64; 6] = [0.80, 0.84, 0.88, 0.92, 0.96, 1.0];

/// Candidates for the gel's decay length, mm.
const GEL_LENGTHS_MM: [f64; 7] = [0.8, 1.2, 1.6, 2.0, 2.5, 3.2, 4.5];

/// What a fit gives.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The light fitted to all presses, and the means of the figures.
    pub calibration: Calibration,
    /// The circle in which the ball touched in each press, as fitted; the presses' own say where it was looked for.
    pub contacts: Vec<Circle>,
    /// How well each press, by its name, is predicted by the light fitted to the others, on the circle and half
    /// its radius round it, exposure compensated on pixels more than 4 mm from it. Where and how widely the ball
    /// touches, three numbers, is fitted to the press itself.
    pub left_out: Vec<(String, Figures)>,
}

/// Which factors of the light are fitted.
#[derive(Clone, Copy, Debug)]
pub(super) struct Model {
    n_bases: usize,
    n_polynomials: usize,
}

/// All factors.
const N_FACTORS: usize = N_BASES * N_TERMS;

/// Linear in the slope, with walls, or with the depth as well; constant, linear or quadratic over the frame.
pub(super) const MODELS: [Model; 9] = {
    const fn model(n_bases: usize, n_polynomials: usize) -> Model {
        Model { n_bases, n_polynomials }
    }
    [
        model(2, 1),
        model(2, 3),
        model(2, 6),
        model(N_SLOPES, 1),
        model(N_SLOPES, 3),
        model(N_SLOPES, 6),
        model(N_BASES, 1),
        model(N_BASES, 3),
        model(N_BASES, 6),
    ]
};

impl Model {
    /// Its factors among all.
    pub(super) fn columns(self) -> Vec<usize> {
        (0..self.n_bases).flat_map(|basis| (0..self.n_polynomials).map(move |i| N_TERMS * basis + i)).collect()
    }

    /// Puts weights in their place among all.
    pub(super) fn spread(self, weights: &[Vec<f64>; 3]) -> [Vec<f64>; 3] {
        weights.each_ref().map(|weights| {
            let mut all = vec![0.0; N_FACTORS];
            self.columns().into_iter().zip(weights).for_each(|(column, weight)| all[column] = *weight);
            all
        })
    }

    /// The weights of all factors; a factor that is not fitted has zero.
    fn weights(self, sums: &Sums) -> Result<[Vec<f64>; 3]> {
        Ok(self.spread(&sums.select(&self.columns()).solve(RIDGE)?))
    }
}

/// How the presses came about.
#[derive(Clone, Debug)]
struct Guess {
    gel_length_mm: f64,
    model: Model,
    /// The circle in which the ball touched in each press.
    contacts: Vec<Circle>,
    /// What each press then says of all factors, on every [`STRIDE`]-th pixel each way.
    sums: Vec<Sums>,
    /// Squared error of presses left out, one at a time, counts squared.
    error: f64,
}

/// Fits the light to a ball's presses.
///
/// Circles drawn by hand are off by some pixels, which blurs the light that is fitted to them. So for each decay length
/// of the gel the presses' circles are moved and resized until presses left out are predicted no better; the share of
/// each circle that is in contact is the one that predicts best. The length and the number of factors are the ones that
/// predict the presses left out with the least squared error; the figures are of the same presses left out again, by
/// lamps that have not seen them.
///
/// # Errors
/// Presses that say too little of the light.
pub fn fit(presses: &Presses) -> Result<Fit> {
    let guesses = GEL_LENGTHS_MM.into_iter().filter_map(|gel_length_mm| best_share(presses, gel_length_mm));
    let guesses = guesses.map(|guess| moved(presses, guess));
    let Some(guess) = guesses.min_by(|a, b| a.error.total_cmp(&b.error)) else {
        return Err(Error::invalid("calibration", "presses spread over the frame", "presses that say too little"));
    };
    let sums = all_sums(presses, guess.gel_length_mm, &guess.contacts, 2);
    let total = total(&sums);
    let weights = |sums: &Sums| guess.model.weights(sums);
    let judge = |(i, own): (usize, &Sums)| {
        let mut others = total.clone();
        others.combine(own, -1.0);
        let (press, contact) = (&presses.presses[i], &guess.contacts[i]);
        let ball = ball_of(presses, press, contact, guess.gel_length_mm);
        Ok((press.name.clone(), figures(presses, press, (&ball, contact.centre_px), &weights(&others)?)))
    };
    let left_out = sums.par_iter().enumerate().map(judge).collect::<Result<Vec<_>>>()?;
    let widths = presses.presses.iter().zip(&guess.contacts).map(|(press, own)| own.radius_px / press.circle.radius_px);
    let calibration = Calibration {
        schema: SCHEMA.to_owned(),
        frame_px: presses.geometry.frame_px,
        field_of_view_mm: [
            presses.geometry.mm_per_px[0] * presses.no_contact.width_px() as f64,
            presses.geometry.mm_per_px[1] * presses.no_contact.height_px() as f64,
        ],
        source: format!("{} presses of a ball of {} mm", left_out.len(), 2.0 * presses.geometry.ball_radius_mm),
        gel_length_mm: Some(guess.gel_length_mm),
        contact_share: Some(widths.sum::<f64>() / left_out.len() as f64),
        leave_one_out: Some(mean(&left_out)),
        light: light(&weights(&total)?, at_rest(&presses.no_contact)?),
    };
    Ok(Fit { calibration, contacts: guess.contacts, left_out })
}

/// The share of the presses' circles that is in contact, and the factors, under which presses left out are predicted best.
fn best_share(presses: &Presses, gel_length_mm: f64) -> Option<Guess> {
    let of_share = |share: f64| {
        let circles = presses.presses.iter().map(|press| press.circle);
        let contacts = circles.map(|circle| Circle { radius_px: share * circle.radius_px, ..circle }).collect();
        judged(presses, gel_length_mm, contacts)
    };
    let guesses = CONTACT_SHARES.into_iter().filter_map(of_share);
    guesses.min_by(|a, b| a.error.total_cmp(&b.error))
}

/// The factors under which presses left out are predicted best with these contacts, and their error.
fn judged(presses: &Presses, gel_length_mm: f64, contacts: Vec<Circle>) -> Option<Guess> {
    let sums = all_sums(presses, gel_length_mm, &contacts, STRIDE);
    let errors = MODELS.into_iter().filter_map(|model| Some((model, left_out_error(&sums, model, RIDGE).ok()?)));
    let (model, error) = errors.min_by(|a, b| a.1.total_cmp(&b.1))?;
    Some(Guess { gel_length_mm, model, contacts, sums, error })
}

/// Moves and resizes the contacts, each under the light that is fitted to the others, as long as that lessens the error of
/// presses left out.
fn moved(presses: &Presses, mut guess: Guess) -> Guess {
    for _ in 0..MOST_ROUNDS {
        let total = total(&guess.sums);
        let move_one = |(i, own): (usize, &Sums)| {
            let mut others = total.clone();
            others.combine(own, -1.0);
            let Ok(weights) = guess.model.weights(&others) else { return guess.contacts[i] };
            let gel = Gel { length_mm: guess.gel_length_mm, weights: &weights };
            move_contact(presses, &presses.presses[i], &gel, guess.contacts[i])
        };
        let contacts = guess.sums.par_iter().enumerate().map(move_one).collect();
        match judged(presses, guess.gel_length_mm, contacts) {
            Some(better) if better.error < guess.error => guess = better,
            _ => break,
        }
    }
    guess
}

/// What each press says of all factors, by every `stride`-th pixel each way.
fn all_sums(presses: &Presses, gel_length_mm: f64, contacts: &[Circle], stride: usize) -> Vec<Sums> {
    let of_press = |(press, contact): (&Press, &Circle)| {
        let ball = ball_of(presses, press, contact, gel_length_mm);
        let mut sums = Sums::new(N_FACTORS);
        for pixel in pixels_near(presses, press, stride) {
            let offset_mm = presses.geometry.from_centre_mm(contact, pixel);
            let factors = factors(bases(&ball, offset_mm), place(pixel, presses.geometry.frame_px));
            sums.add(factors.as_flattened(), press.counts(pixel));
        }
        sums
    };
    presses.presses.par_iter().zip(contacts).map(of_press).collect()
}

fn total(sums: &[Sums]) -> Sums {
    let mut total = Sums::new(N_FACTORS);
    sums.iter().for_each(|press| total.combine(press, 1.0));
    total
}

/// Squared error of presses left out, one at a time.
pub(super) fn left_out_error(sums: &[Sums], model: Model, ridge: f64) -> Result<f64> {
    let columns = model.columns();
    let total = total(sums).select(&columns);
    let errors = sums.iter().map(|press| {
        let own = press.select(&columns);
        let mut others = total.clone();
        others.combine(&own, -1.0);
        Ok(own.squared_error(&others.solve(ridge)?))
    });
    errors.sum()
}

/// How well `weights` predict a press of a ball about a place of the frame.
fn figures(
    presses: &Presses,
    press: &Press,
    (ball, centre_px): (&BallPress, [f64; 2]),
    weights: &[Vec<f64>; 3],
) -> Figures {
    let [width, height] = presses.geometry.frame_px;
    let rest = presses.no_contact.rgb();
    let radius_mm = presses.geometry.radius_mm(&press.circle);
    let contact = Circle { centre_px, ..press.circle };
    let mut pairs = Vec::new();
    for pixel in 0..width * height {
        let [x, y] = presses.geometry.from_centre_mm(&press.circle, pixel);
        if x.hypot(y) > CONTACT_RADII * radius_mm {
            continue;
        }
        let offset_mm = presses.geometry.from_centre_mm(&contact, pixel);
        let factors = factors(bases(ball, offset_mm), place(pixel, [width, height]));
        for (channel, change) in change(weights, &factors).into_iter().enumerate() {
            let (rest, gain) = (f64::from(rest[3 * pixel + channel]), f64::from(press.gain[channel]));
            // The camera clips what it exposes, not what we compensate.
            let predicted = ((rest + change) * gain).clamp(0.0, 255.0) / gain - rest;
            pairs.push([predicted, f64::from(press.difference[3 * pixel + channel])]);
        }
    }
    Figures::of(&pairs)
}

/// Means over presses; the ratio is of the means.
fn mean(left_out: &[(String, Figures)]) -> Figures {
    let mean = |value: fn(&Figures) -> f64| left_out.iter().map(|(_, f)| value(f)).sum::<f64>() / left_out.len() as f64;
    let (l1_counts, background_l1_counts) = (mean(|f| f.l1_counts), mean(|f| f.background_l1_counts));
    Figures {
        l1_counts,
        background_l1_counts,
        ratio: l1_counts / background_l1_counts,
        correlation: mean(|f| f.correlation),
        psnr_db: mean(|f| f.psnr_db),
    }
}

#[cfg(test)]
mod tests {
    use super::super::circle::Circle;
    use super::super::synthetic;
    use super::*;
    use crate::sensor::SensorSpec;
    use crate::sensor::light::LightRig;
    use crate::sensor::optics::Optics;

    fn synthetic_presses(seed: u64, is_labelled: bool) -> Presses {
        let (no_contact, mut frames) = synthetic::presses(seed);
        if !is_labelled {
            frames.iter_mut().for_each(|(_, _, circle)| *circle = None);
        }
        Presses::new(no_contact, frames, synthetic::BALL_MM, synthetic::spec().mm_per_px()).unwrap()
    }

    /// Largest difference of two lights over slopes and the middle of the frame, counts.
    fn largest_difference(a: &LightRig, b: &LightRig) -> f32 {
        let spec = |light: &LightRig| SensorSpec { frame_px: [16, 16], light: light.clone(), ..SensorSpec::default() };
        let optics = [a, b].map(|light| Optics::new(&spec(light)));
        let slopes = (0..49).map(|i| [f64::from(i % 7 - 3), f64::from(i / 7 - 3)].map(|g| 0.35 * g));
        let differences = slopes.flat_map(|[gx, gy]| {
            let depths: Vec<f32> =
                (0..18 * 18).map(|i| (gx * f64::from(i % 18) + gy * f64::from(i / 18)) as f32).collect();
            let [a, b] = optics.each_ref().map(|optics| {
                let rgb = optics.shade(&depths, [1.0; 2]).into_iter().zip(optics.at_rest());
                rgb.map(|(rgb, rest)| rgb - rest).collect::<Vec<_>>()
            });
            // Rows and columns 4 to 11: half the frame each way, where there are presses.
            let inner = (0..3 * 256).filter(|i| (4..12).contains(&(i / 3 % 16)) && (4..12).contains(&(i / 48)));
            inner.map(|i| (a[i] - b[i]).abs()).collect::<Vec<_>>()
        });
        differences.fold(0.0, f32::max)
    }

    #[test]
    fn a_known_light_is_recovered_from_other_noise_and_found_circles() {
        let truth = synthetic::spec();
        for (seed, is_labelled) in [(1, true), (2, false)] {
            let presses = synthetic_presses(seed, is_labelled);
            let Fit { calibration, left_out, .. } = fit(&presses).unwrap();
            let figures = calibration.leave_one_out.as_ref().unwrap();
            // Noise of 1.8 counts alone has a mean of 1.8 sqrt(2 / pi) = 1.4, and rounding adds to it.
            assert!(figures.l1_counts < 2.0 && figures.correlation > 0.99, "{figures:?}");
            assert_eq!(left_out.len(), 12);
            let off = largest_difference(&calibration.light, &truth.light);
            // Of some 100 counts at most.
            assert!(off < if is_labelled { 4.0 } else { 8.0 }, "{off} counts off, labelled: {is_labelled}");
            if is_labelled {
                assert_eq!(calibration.gel_length_mm, Some(1.2));
                // Half a pixel of 14.
                assert!((calibration.contact_share.unwrap() - 1.0).abs() < 0.035, "{:?}", calibration.contact_share);
            }
        }
    }

    #[test]
    fn circles_that_were_drawn_beside_the_contact_are_moved_to_it() {
        let truth = synthetic_presses(6, true);
        let mut drawn = truth.clone();
        for (i, press) in drawn.presses.iter_mut().enumerate() {
            // Two pixels off in all directions, and wider or narrower by a pixel: as hands draw them.
            let (sin, cos) = (2.4 * i as f64).sin_cos();
            press.circle.centre_px[0] += 2.0 * cos;
            press.circle.centre_px[1] += 2.0 * sin;
            press.circle.radius_px += if i % 2 == 0 { 1.0 } else { -1.0 };
        }
        let Fit { contacts, left_out, .. } = fit(&drawn).unwrap();
        for (press, contact) in truth.presses.iter().zip(&contacts) {
            let [dx, dy] = [0, 1].map(|axis| contact.centre_px[axis] - press.circle.centre_px[axis]);
            assert!(dx.hypot(dy) < 0.7, "{}: {contact:?}, not {:?}", press.name, press.circle);
            assert!((contact.radius_px - press.circle.radius_px).abs() < 0.7, "{contact:?}, not {:?}", press.circle);
        }
        // As good as where the circles are right: noise and rounding are 1.5 counts.
        assert!(mean(&left_out).l1_counts < 2.0, "{:?}", mean(&left_out));
    }

    #[test]
    fn how_a_deeper_gel_is_darker_is_recovered() {
        let mut truth = synthetic::spec();
        truth.light.pressed = Some([-9.0, 4.0, -2.0].map(|counts| [counts, 0.0, 0.0, 0.0, 0.0, 0.0]));
        let (no_contact, frames) = synthetic::presses_on(&truth, 4);
        let presses = Presses::new(no_contact, frames, synthetic::BALL_MM, truth.mm_per_px()).unwrap();
        let Fit { calibration, .. } = fit(&presses).unwrap();
        assert_eq!(calibration.gel_length_mm, Some(1.2));
        let found = calibration.light.pressed.unwrap();
        for (found, truth) in found.iter().zip([-9.0, 4.0, -2.0]) {
            // Of some 1.5 mm: 1.5 counts, as much as the noise.
            assert!((found[0] - truth).abs() < 1.0, "{found:?}, not {truth}");
        }
    }

    #[test]
    fn circles_are_found_where_the_ball_was() {
        let (labelled, found) = (synthetic_presses(3, true), synthetic_presses(3, false));
        for (truth, found) in labelled.presses.iter().zip(&found.presses) {
            let Circle { centre_px: [x, y], radius_px } = truth.circle;
            let [dx, dy] = [found.circle.centre_px[0] - x, found.circle.centre_px[1] - y];
            assert!(dx.hypot(dy) < 1.0, "{}: {:?}, not {:?}", truth.name, found.circle, truth.circle);
            assert!((found.circle.radius_px - radius_px).abs() < 2.0, "{:?}, not {:?}", found.circle, truth.circle);
        }
    }
}
