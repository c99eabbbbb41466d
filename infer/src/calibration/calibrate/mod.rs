//! Fits a [`Calibration`] to touches of holes, or of pegs, whose parts and poses are known.

mod sample;
mod sensors;
mod steepness;
mod verified;

use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};

use crate::bank::Bank;
use crate::bank::metric::by_cosine;
use crate::bank::recorded::tactile_images;
use crate::bank::views::Views;
use crate::calibration::own_by_edge::OwnByEdge;
use crate::calibration::{BLANK_SHARE, Calibration, OfVerifier, Prior, Spread};
use crate::embedding::model::Model;
use crate::error::{Error, Result};
use sample::low_similarity;
use sensors::Matched;
use steepness::AmongViews;
use verified::Judge;

/// Without a prior fewer holes with an edge than this say too little.
const MIN_HOLES: usize = 50;

/// More than this many holes are thinned out evenly.
const MAX_HOLES: usize = 1_500;

/// What a model's own calibration counts as, in touches, when a sensor's touches are few: matches differ from sensor to sensor by
/// several times, so that what is known of one says little of another. Chosen on tuning letters (`NOTES.md`, Calibration).
pub const PRIOR_TOUCHES: f64 = 2.0;

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
    /// The best cosine of each with any edged view.
    bests: Vec<f32>,
    /// The cosine with the view that was touched, of those for which the bank has one, sensor by sensor.
    matched: Vec<Vec<f64>>,
    /// The same touches next to all views, where the model has a fitted likelihood.
    among_views: Vec<AmongViews>,
    /// What a verifier says of the first sensor's touches; `None` where none judged any.
    verified: Option<OfVerifier>,
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
        let edged = bank.edged_rows();
        let mut found = Self {
            name,
            side,
            bests: Vec::new(),
            matched: vec![Vec::new()],
            among_views: Vec::new(),
            verified: None,
            views: bank.views(),
        };
        let mut judge = Judge::new(model, bank, side, holes.meta().field_of_view_mm());
        let mut all = Vec::new();
        let odds = model.match_odds(side).or_else(|| model.match_odds(Side::Hole));
        let plain = |cosine: f32| by_cosine(bank.metric(), cosine);
        for (i, frame) in frames.iter().enumerate() {
            let touch = holes.touch(*frame);
            let known = touch.part.as_ref().and_then(|part| bank.parts().iter().position(|name| name == part));
            let (Some(part), Some(pose)) = (known, touch.part_from_sensor) else {
                let (of, expected) = (&found.name, format!("{side}s of the bank's parts, with their poses"));
                return Err(Error::invalid(format!("{of}: index row {frame}"), expected, format!("{:?}", touch.part)));
            };
            let nearest = bank.grid().nearest(&pose);
            let is_known = nearest.is_some_and(|cell| bank.is_recorded(part * bank.grid().len() + cell));
            if !is_known || images[i].edge_share < BLANK_SHARE {
                continue;
            }
            let query = &queries[i * model.dim()..(i + 1) * model.dim()];
            let is_of_part_near = |row: &usize| {
                let (of, cell) = (row / bank.grid().len(), row % bank.grid().len());
                of == part && is_near(bank.grid(), &bank.grid().pose(cell), &pose)
            };
            if edged.iter().any(is_of_part_near) {
                bank.similarities(query, &mut all);
                let best = edged.iter().map(|row| all[*row].clamp(-1.0, 1.0)).fold(-1.0, f32::max);
                found.bests.push(plain(best));
                let Some(own) = bank.cosine_at(query, part, &pose) else { continue };
                found.matched[0].push(f64::from(plain(own)));
                let edge_share = images[i].edge_share;
                let of_touch = |odds| AmongViews::new((odds, side), bank, (query, edge_share), (own, &all));
                found.among_views.extend(odds.map(of_touch));
                if let Some(judge) = &mut judge {
                    judge.judge(&images[i], part, &pose)?;
                }
            }
        }
        found.verified = judge.and_then(|judge| judge.of_sensor());
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
        self.bests.extend(other.bests);
        self.matched.extend(other.matched);
        self.among_views.extend(other.among_views);
        Ok(self)
    }

    /// Touches that show an edge within the bank's poses: what a calibration is made of.
    pub fn len(&self) -> usize {
        self.bests.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.bests.is_empty()
    }

    /// How well a calibration suits these touches; `None` without any.
    pub fn judge(&self, low_similarity: f32) -> Option<Judgement> {
        let n_low = self.bests.iter().filter(|best| **best < low_similarity).count();
        let matched: Vec<f64> = self.matched.iter().flatten().copied().collect();
        (!self.is_empty()).then(|| Judgement {
            low_share: n_low as f64 / self.len() as f64,
            matched: (!matched.is_empty()).then(|| Spread::from_values(&matched)),
        })
    }
}

/// How well a calibration suits touches.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Judgement {
    /// Share of touches below its low similarity, 0..=1: one in a hundred is meant.
    pub low_share: f64,
    /// Their cosines with the views that were touched.
    pub matched: Option<Spread>,
}

/// Measures how touches match the views that they were made at. The holes should lie between the recorded poses, as a robot's
/// do. With a prior every number is of the touches and the prior's together: ten touches move it as far as they can.
///
/// # Errors
/// Too few touches: none with a prior, fewer than fifty without.
pub fn calibrate(touches: &Touches, prior: Option<&Prior>) -> Result<Calibration> {
    let least = if prior.is_some() { 1 } else { MIN_HOLES };
    if touches.len() < least {
        let expected = format!("{least} or more {}s that show an edge within the bank's poses", touches.side);
        return Err(Error::invalid(&touches.name, expected, touches.len().to_string()));
    }
    // What touches match by against views of pegs alone says nothing of views of both sides.
    let of_such_views =
        prior.copied().map(|prior| Prior { matched: prior.matched.filter(|_| prior.views == touches.views), ..prior });
    let matched = Matched::from_touches(&touches.matched, of_such_views.as_ref());
    // What is for any sensor stays as it was fitted over many.
    let is_one_sensor = touches.matched.len() == 1;
    let n_before = prior.map_or(0.0, |prior| prior.n_touches);
    let own = touches.among_views.iter().map(AmongViews::own);
    let own_by_edge = is_one_sensor.then(|| OwnByEdge::from_touches(own)).flatten();
    let by_edge = |own: OwnByEdge| touches.among_views.iter().map(|touch| touch.by_edge(&own)).collect();
    let by_edge: Option<Vec<AmongViews>> = own_by_edge.map(by_edge);
    let among_views = by_edge.as_deref().unwrap_or(&touches.among_views);
    let steepness = is_one_sensor.then(|| steepness::steepness(among_views, n_before)).flatten();
    Ok(Calibration {
        low_similarity: low_similarity(&touches.bests, prior).unwrap_or(-1.0),
        matched: matched.map(|matched| matched.all),
        between_sensors: matched.and_then(|matched| matched.between),
        steepness,
        own_by_edge,
        views: touches.views,
        n_holes: touches.len(),
        verifier: touches.verified.clone().filter(|_| is_one_sensor),
        prior: prior.copied(),
    })
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

    fn touches(bests: &[f32]) -> Touches {
        let matched = vec![bests.iter().map(|best| f64::from(*best) - 0.1).collect()];
        Touches {
            name: "mine".into(),
            side: Side::Hole,
            matched,
            bests: bests.into(),
            among_views: Vec::new(),
            verified: None,
            views: Views::Pegs,
        }
    }

    const PRIOR: Prior = Prior {
        n_touches: 2.0,
        low_similarity: 0.7,
        matched: Some(Spread { mean: 0.9, sd: 0.0 }),
        between_sensors: None,
        views: Views::Pegs,
    };

    #[test]
    fn few_touches_are_enough_with_a_prior_only() {
        let two = touches(&[0.9; 2]);
        let refused = calibrate(&two, None).unwrap_err().to_string();
        assert!(refused.contains("50 or more holes") && refused.ends_with("got 2"), "{refused}");
        let calibration = calibrate(&two, Some(&PRIOR)).unwrap();
        // Two of 0.9 and two of 0.8; two lows of 0.7 and two of 0.9.
        let Spread { mean, sd } = calibration.matched.unwrap();
        assert!((mean - 0.85).abs() < 1e-6 && (sd - 0.05).abs() < 1e-6, "{calibration:?}");
        assert!((calibration.low_similarity - 0.8).abs() < 1e-6, "{calibration:?}");
        let none = calibrate(&touches(&[]), Some(&PRIOR)).unwrap_err().to_string();
        assert!(none.contains("1 or more holes"), "{none}");
    }

    #[test]
    fn touches_of_one_sensor_say_how_steep_and_of_several_nothing() {
        let one = || Touches { among_views: steepness::tests::touches(0.1), ..touches(&[0.9; 60]) };
        let found = calibrate(&one(), None).unwrap();
        assert!((found.steepness.unwrap() - 0.5).abs() < 0.03, "{found:?}");
        assert_eq!(calibrate(&one().and(one()).unwrap(), None).unwrap().steepness, None);
        assert_eq!(calibrate(&touches(&[0.9; 60]), None).unwrap().steepness, None);
    }

    #[test]
    fn other_touches_judge_it_by_their_own() {
        let Judgement { low_share, matched } = touches(&[0.9, 0.6, 0.8, 0.9]).judge(0.7).unwrap();
        assert!(low_share == 0.25 && (matched.unwrap().mean - 0.7).abs() < 1e-6, "{matched:?}");
        assert_eq!(touches(&[]).judge(0.7), None);
    }

    #[test]
    fn the_same_touches_again_change_nothing() {
        let two = touches(&[0.9, 0.8]);
        let once = calibrate(&two, Some(&PRIOR)).unwrap();
        let again = calibrate(&two, Some(&once.as_prior(2.0))).unwrap();
        assert_eq!(again, once);
        // The touches of a calibration without a prior are one themselves.
        let alone = Calibration { prior: None, ..once };
        assert_eq!(alone.as_prior(3.0).matched, once.matched);
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
