//! Fits a [`Calibration`] to touches of holes, or of pegs, whose parts and poses are known.

mod compared;
mod fit;
mod sample;
mod sensors;

use rayon::prelude::*;
use serde::Serialize;
use tactile_data::grid::PoseGrid;
use tactile_data::se2::{Se2, wrap_angle};
use tactile_data::store::Dataset;
use tactile_data::touch::Side;

use crate::bank::Bank;
use crate::calibration::{BLANK_SHARE, Calibration, Prior, Spread};
use crate::error::{Error, Result};
use crate::metric::by_cosine;
use crate::model::Model;
use crate::recorded::tactile_images;
use crate::views::Views;
use compared::{Compared, Weights};
use sample::{low_similarity, n_counted, pooled};
use sensors::Matched;

/// Without a prior fewer holes with an edge than this say too little.
const MIN_HOLES: usize = 50;

/// More than this many holes are thinned out evenly.
const MAX_HOLES: usize = 1_500;

/// What a model's own calibration counts as, in touches, when a sensor's touches are few. Chosen on tuning letters
/// under three sensors (`NOTES.md`); of the gap and the best cosines a tenth of it counts.
pub const PRIOR_TOUCHES: f64 = 20.0;

/// Groups that touches are left out in, to judge a calibration by what it has not seen.
const N_GROUPS: usize = 10;

/// Which touches of a dataset are compared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// The side of the touches. Touches of pegs should not be the ones that the bank was made of.
    pub side: Side,
    /// So many of them, evenly spread; `None`: all, at most 1,500.
    pub n: Option<usize>,
}

impl Choice {
    fn spread_over(self, holes: &[usize]) -> Vec<usize> {
        let step = self.n.map_or(holes.len().div_ceil(MAX_HOLES), |n| holes.len() / n.max(1)).max(1);
        let n = self.n.unwrap_or(MAX_HOLES);
        holes.iter().step_by(step).take(n).copied().collect()
    }
}

/// Touches of one side, each compared with all views of a bank.
#[derive(Clone, Debug)]
pub struct Touches {
    name: String,
    side: Side,
    compared: Vec<Compared>,
    /// The cosine with the view that was touched, of those for which the bank has one, sensor by sensor.
    matched: Vec<Vec<f64>>,
    /// How many lie at a recorded pose, and how many of them are blank or edged as the recorded view.
    n_placed: usize,
    n_agree: usize,
    /// What the bank's views are of.
    views: Views,
}

impl Touches {
    /// Compares holes of a dataset with a bank. Holes beyond the recorded poses say nothing and are left out.
    ///
    /// # Errors
    /// A bank of another model, or holes of parts that the bank does not hold or without their poses.
    pub fn new(model: &Model, bank: &Bank, holes: &Dataset, choice: Choice) -> Result<Self> {
        let name = holes.meta().name.clone();
        let side = choice.side;
        let of_side: Vec<usize> = (0..holes.len()).filter(|i| holes.touch(*i).side == Some(side)).collect();
        let frames = choice.spread_over(&of_side);
        let images = tactile_images(&model.background_of(holes)?, holes, &frames)?;
        let queries = model.embed_side(&images, side)?;
        let is_edged = |share: f32| share >= BLANK_SHARE;
        let edged = bank.edged_rows();
        let (compared, matched, views) = (Vec::new(), vec![Vec::new()], bank.views());
        let mut found = Self { name, side, compared, matched, n_placed: 0, n_agree: 0, views };
        let mut all = Vec::new();
        let plain = |cosine: f32| by_cosine(bank.metric(), cosine);
        for (i, frame) in frames.iter().enumerate() {
            let touch = holes.touch(*frame);
            let known = touch.part.as_ref().and_then(|part| bank.parts().iter().position(|name| name == part));
            let (Some(part), Some(pose)) = (known, touch.part_from_sensor) else {
                let (of, expected) = (&found.name, format!("{side}s of the bank's parts, with their poses"));
                return Err(Error::invalid(format!("{of}: index row {frame}"), expected, format!("{:?}", touch.part)));
            };
            let nearest = bank.grid().nearest(&pose);
            let Some(cell) = nearest.filter(|cell| bank.is_recorded(part * bank.grid().len() + cell)) else { continue };
            let shows_edge = is_edged(images[i].edge_share);
            found.n_placed += 1;
            found.n_agree += usize::from(is_edged(bank.edge_shares()[part * bank.grid().len() + cell]) == shows_edge);
            if !shows_edge {
                continue;
            }
            let query = &queries[i * model.dim()..(i + 1) * model.dim()];
            let near = (0..edged.len()).filter(|at| {
                let (of, cell) = (edged[*at] / bank.grid().len(), edged[*at] % bank.grid().len());
                of == part && is_near(bank.grid(), &bank.grid().pose(cell), &pose)
            });
            let near: Vec<usize> = near.collect();
            if !near.is_empty() {
                bank.similarities(query, &mut all);
                let cosines: Vec<f32> = edged.iter().map(|row| plain(all[*row].clamp(-1.0, 1.0))).collect();
                found.compared.push(Compared::new(&cosines, &near));
                found.matched[0].extend(bank.cosine_at(query, part, &pose).map(|cosine| f64::from(plain(cosine))));
            }
        }
        Ok(found)
    }

    /// These touches and the touches of another sensor, compared with the same bank.
    ///
    /// # Errors
    /// Touches of the other side, or compared with views of another kind.
    pub fn and(mut self, other: Self) -> Result<Self> {
        if (other.side, other.views) != (self.side, self.views) {
            let expected = format!("{}s, compared with the same bank as those of {}", self.side, self.name);
            return Err(Error::invalid(other.name, expected, format!("{}s", other.side)));
        }
        self.compared.extend(other.compared);
        self.matched.extend(other.matched);
        self.n_placed += other.n_placed;
        self.n_agree += other.n_agree;
        Ok(self)
    }

    /// Touches that show an edge within the bank's poses: what a calibration is made of.
    pub fn len(&self) -> usize {
        self.compared.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.compared.is_empty()
    }

    /// How well a temperature, a share of outliers and a low similarity suit these touches; `None` without any.
    pub fn judge(&self, temperature: f64, outlier_share: f64, low_similarity: f32) -> Option<Judgement> {
        let n = self.len() as f64;
        let n_low = self.compared.iter().filter(|hole| hole.best < low_similarity).count();
        (!self.is_empty()).then(|| Judgement {
            nll_nats: fit::nll(&self.compared, temperature, outlier_share),
            low_share: n_low as f64 / n,
            gap: Spread::from_values(&self.gaps()),
        })
    }

    fn gaps(&self) -> Vec<f64> {
        self.compared.iter().map(Compared::gap).collect()
    }
}

/// How well a calibration suits touches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// Mean negative log-probability of the recorded poses around the true one, nats.
    pub nll_nats: f64,
    /// Share of touches below its low similarity, 0..=1: one in a hundred is meant.
    pub low_share: f64,
    /// How far the views touched were below the best.
    pub gap: Spread,
}

/// A calibration, and what it is worth.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Calibrated {
    /// The calibration.
    pub calibration: Calibration,
    /// 95 % interval of its temperature.
    pub temperature_interval: [f64; 2],
    /// 95 % interval of its mean gap.
    pub gap_interval: Option<[f64; 2]>,
    /// By how much it explains touches that it has not seen better than the prior does; `None` without a prior or with
    /// fewer than two touches.
    pub gain: Option<Gain>,
}

/// What touches left out in turn say of a calibration by the others.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Gain {
    /// Mean negative log-probability of the recorded poses around the true one by the prior, nats.
    pub before_nats: f64,
    /// The same by the other touches and the prior.
    pub after_nats: f64,
    /// Standard error of the difference, nats.
    pub standard_error: f64,
}

/// Fits temperature and share of outliers by maximum likelihood: for each hole the recorded poses within one step of
/// the true one, on the right part, are to be found among all rows of the bank, each weighing
/// `exp((s - s_max) / tau) + eps`. The holes should lie between the recorded poses, as a robot's do.
///
/// With a prior both maximise the posterior, and every other number of a calibration is measured on the touches and the
/// prior's together: ten touches move it as far as they can, and no touch would leave it.
///
/// # Errors
/// Too few touches: none with a prior, fewer than fifty without.
pub fn calibrate(touches: &Touches, prior: Option<&Prior>) -> Result<Calibrated> {
    let compared = &touches.compared;
    let least = if prior.is_some() { 1 } else { MIN_HOLES };
    if compared.len() < least {
        let expected = format!("{least} or more {}s that show an edge within the bank's poses", touches.side);
        return Err(Error::invalid(&touches.name, expected, compared.len().to_string()));
    }
    let found = fit::fit(compared, prior);
    let bests: Vec<f32> = compared.iter().map(|hole| hole.best).collect();
    let gap = pooled(&touches.gaps(), prior, |prior| prior.gap);
    // What touches match by against views of pegs alone says nothing of views of both sides.
    let of_such_views =
        prior.copied().map(|prior| Prior { matched: prior.matched.filter(|_| prior.views == touches.views), ..prior });
    let matched = Matched::from_touches(&touches.matched, of_such_views.as_ref());
    let n_gaps = compared.len() as f64 + prior.map_or(0.0, n_counted);
    let calibration = Calibration {
        temperature: found.temperature,
        outlier_share: found.share,
        blank_agreement: blank_agreement(touches, prior),
        low_similarity: low_similarity(&bests, prior).unwrap_or(-1.0),
        nll_nats: fit::nll(compared, found.temperature, found.share),
        gap,
        matched: matched.map(|matched| matched.all),
        between_sensors: matched.and_then(|matched| matched.between),
        views: touches.views,
        chance_nats: compared.iter().map(Compared::chance).sum::<f64>() / compared.len() as f64,
        n_holes: compared.len(),
        prior: prior.copied(),
    };
    Ok(Calibrated {
        calibration,
        temperature_interval: fit::temperature_interval(compared, prior, &found),
        gap_interval: gap.map(|Spread { mean, sd }| [-1.96, 1.96].map(|z| mean + z * sd / n_gaps.sqrt())),
        gain: prior.and_then(|prior| gain(compared, prior)),
    })
}

/// How often blank and edged agree, the prior's touches counted. Alone by Laplace's rule: no finite sample makes
/// disagreement impossible.
fn blank_agreement(touches: &Touches, prior: Option<&Prior>) -> f64 {
    let (agree, placed) = (f64::from(touches.n_agree as u32), f64::from(touches.n_placed as u32));
    match prior {
        Some(prior) => (prior.n_touches * prior.blank_agreement + agree) / (prior.n_touches + placed),
        None => (agree + 1.0) / (placed + 2.0),
    }
}

/// Leaves each tenth of the touches out in turn.
fn gain(compared: &[Compared], prior: &Prior) -> Option<Gain> {
    let n_groups = N_GROUPS.min(compared.len());
    if n_groups < 2 {
        return None;
    }
    let of_group = |group: usize| {
        let is_out = |i: &usize| i % n_groups == group;
        let (out, others): (Vec<usize>, Vec<usize>) = (0..compared.len()).partition(is_out);
        let others: Vec<Compared> = others.into_iter().map(|i| compared[i].clone()).collect();
        let fit = fit::fit(&others, Some(prior));
        let [before, after] = [(prior.temperature, prior.outlier_share), (fit.temperature, fit.share)]
            .map(|(temperature, share)| Weights::new(temperature, share));
        let nats = |i: usize| [compared[i].nll(&before), compared[i].nll(&after)];
        out.into_iter().map(nats).collect::<Vec<_>>()
    };
    let nats: Vec<[f64; 2]> = (0..n_groups).into_par_iter().flat_map_iter(of_group).collect();
    let n = nats.len() as f64;
    let mean = |which: usize| nats.iter().map(|nats| nats[which]).sum::<f64>() / n;
    let differences: Vec<f64> = nats.iter().map(|[before, after]| before - after).collect();
    let standard_error = Spread::from_values(&differences).sd / (n - 1.0).sqrt();
    Some(Gain { before_nats: mean(0), after_nats: mean(1), standard_error })
}

/// Whether a recorded pose is within one step of another pose on every axis.
fn is_near(grid: &PoseGrid, recorded: &Se2, pose: &Se2) -> bool {
    let turn = wrap_angle(recorded.theta_rad - pose.theta_rad).to_degrees().abs();
    let shift = (recorded.x_mm - pose.x_mm).abs().max((recorded.y_mm - pose.y_mm).abs());
    shift < grid.xy_step_mm && turn < grid.theta_step_deg
}

#[cfg(test)]
mod tests {
    use super::*;

    fn touches(compared: Vec<Compared>) -> Touches {
        Touches {
            name: "mine".into(),
            side: Side::Hole,
            n_placed: compared.len(),
            n_agree: compared.len(),
            matched: vec![Vec::new()],
            compared,
            views: Views::Pegs,
        }
    }

    const PRIOR: Prior = Prior {
        n_touches: 8.0,
        temperature: 0.03,
        outlier_share: 1e-4,
        blank_agreement: 0.95,
        low_similarity: 0.7,
        gap: Some(Spread { mean: 0.01, sd: 0.01 }),
        matched: None,
        between_sensors: None,
        views: Views::Pegs,
    };

    #[test]
    fn a_gap_is_to_the_best_row_of_those_round_the_true_pose() {
        let gaps = [&[2, 1][..], &[0, 2]].map(|near| Compared::new(&[0.9, 0.4, 0.6], near).gap());
        assert!((gaps[0] - 0.3).abs() < 1e-6 && gaps[1] == 0.0, "{gaps:?}");
    }

    #[test]
    fn few_touches_are_enough_with_a_prior_only() {
        let two = touches(vec![Compared::new(&[0.9, 0.85, 0.3], &[1]); 2]);
        let refused = calibrate(&two, None).unwrap_err().to_string();
        assert!(refused.contains("50 or more holes") && refused.ends_with("got 2"), "{refused}");
        let Calibrated { calibration, temperature_interval: [low, high], gain, .. } =
            calibrate(&two, Some(&PRIOR)).unwrap();
        // A tenth of the prior's eight and two of 0.05 each: 0.108 / 2.8; (8 x 0.95 + 2) / 10.
        assert!((calibration.gap.unwrap().mean - 0.108 / 2.8).abs() < 1e-6, "{calibration:?}");
        assert!((calibration.blank_agreement - 0.96).abs() < 1e-12);
        assert!(low < calibration.temperature && calibration.temperature < high);
        assert!(calibration.temperature > 0.03 && gain.unwrap().after_nats < gain.unwrap().before_nats);
        let none = calibrate(&touches(Vec::new()), Some(&PRIOR)).unwrap_err().to_string();
        assert!(none.contains("1 or more holes"), "{none}");
    }

    #[test]
    fn the_same_touches_again_change_nothing() {
        let two = touches(vec![Compared::new(&[0.9, 0.85, 0.3], &[1]); 2]);
        let once = calibrate(&two, Some(&PRIOR)).unwrap().calibration;
        let again = calibrate(&two, Some(&once.as_prior(8.0))).unwrap().calibration;
        assert_eq!(again, once);
        // The touches of a calibration without a prior are one themselves.
        let alone = Calibration { prior: None, ..once };
        assert_eq!(alone.as_prior(3.0).temperature, once.temperature);
    }

    #[test]
    fn a_choice_is_spread_over_all_holes() {
        let holes: Vec<usize> = (0..480).collect();
        let of = |n| Choice { n, ..Choice::default() }.spread_over(&holes);
        assert_eq!(of(Some(10)), (0..10).map(|i| 48 * i).collect::<Vec<_>>());
        assert_eq!(of(None), holes);
        assert_eq!(of(Some(1_000)).len(), 480);
        let many: Vec<usize> = (0..4_000).collect();
        assert_eq!(Choice::default().spread_over(&many).len(), 1_334);
    }
}
