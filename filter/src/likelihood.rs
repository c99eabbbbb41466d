//! How likely one touch is at each recorded view: f_HP made into a probability.
//!
//! A touch is two observations. Whether the view is blank (shows no edge) agrees with the bank's view
//! at the true pose with probability `blank_agreement`. The picture of the edges is judged by the
//! cosine `s` between hole query and peg key: `exp(s / temperature)` relative to its mean over the edged views says how
//! much likelier the touch is there than anywhere, and two touches in a hundred (`outlier_share`) may look like any view,
//! so that a likelihood is a mixture of that and 1, which says nothing. A blank view has no such picture: there the second
//! factor is 1.
//!
//! Outside the recorded area the view is unknown. Where views are interpolated it counts as one of
//! `unknown_similarity`. Were it worth as much as an average view, a touch whose own view was not recorded would speak
//! for the best of the recorded ones, even a poor one.

use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tactile_data::touch::Side;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::calibration::{BLANK_SHARE, Calibration, Spread};
use tactile_infer::matches::{Matches, PartMatch};
use tactile_infer::neighbours::Neighbours;
use tactile_infer::similarity::dot;
use tactile_infer::views::Views;

use crate::error::{Error, Result};
use crate::interpolation::{Interpolation, LatticeWeights, ViewWeights};
use crate::match_model::MatchModel;
use crate::nearest::Nearest;
use crate::observation::Observation;
use crate::overlap::Overlap;
use crate::simd;

/// How similarities become probabilities.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LikelihoodConfig {
    /// tau: the difference of cosine that changes a probability by a factor e. Positive.
    pub temperature: f64,
    /// Share of the touches that look like any view rather than like their own, 0 to below 1: a slip, a crumb. It bounds
    /// what one touch can cost a state, to the log of it. Zero: one bad match can rule a state out for good.
    pub outlier_share: f64,
    /// A view with a smaller share of edge pixels is blank, 0..=1. Zero: no view is blank.
    pub blank_share: f32,
    /// Probability that hole and peg at one pose are both blank or both edged; above 0 and below 1.
    pub blank_agreement: f64,
    /// Where the nearest recorded view is taken: how far from its pose it is still trusted wholly, in steps of the
    /// grid; positive.
    /// No pose inside the recorded area is farther than 0.71 steps, so 1 trusts every view.
    pub nearest_tolerance: f64,
    /// How views between recorded poses are judged.
    pub interpolation: Interpolation,
    /// Where views are interpolated, one outside the recorded area is as likely as a recorded one whose cosine with an
    /// edged touch is this, -1..=1. `None`, and where they are not: as an average recorded one, the same for every touch.
    pub unknown_similarity: Option<f64>,
    /// What a part's fit is measured by ([`crate::Estimate::fit`]): the cosine of an edged touch with the view that it was
    /// made at, mean ...
    pub matched_mean: f64,
    /// ... and standard deviation, positive ...
    pub matched_sd: f64,
    /// ... of whose square the touches of one hole have this share in common, 0..=1: the same print, the same sensor ...
    pub matched_shared: f64,
    /// ... of a bank with such views. In one of others a part's own mean counts, as far as it is known.
    pub matched_views: Views,
    /// Share of their error that the touches of one hole have in common, 0..=1: the same print, the same network. Zero:
    /// all they say is multiplied. Else n touches count as n / (1 + share (n - 1)), each likelihood taken to that power of
    /// n, as the mean of n numbers of which any two correlate so much.
    pub shared_error: f64,
    /// Touches nearer than this share evidence, mm, not negative; zero: all count as independent.
    pub overlap_mm: f64,
    /// Touches at one place turned by less than this share evidence, degrees; positive.
    pub overlap_deg: f64,
}

impl Default for LikelihoodConfig {
    /// Bounded, blank-aware. Temperature and share of outliers for a model without calibration; agreement from 94-99 %
    /// measured at equal poses.
    fn default() -> Self {
        Self {
            temperature: 0.03,
            outlier_share: 0.02,
            blank_share: BLANK_SHARE,
            blank_agreement: 0.96,
            nearest_tolerance: 0.25,
            interpolation: Interpolation::Auto,
            unknown_similarity: Some(0.74),
            matched_mean: 0.94,
            matched_sd: 0.03,
            matched_shared: SHARED_VARIANCE,
            matched_views: Views::Pegs,
            shared_error: 0.15,
            overlap_mm: 3.0,
            overlap_deg: 15.0,
        }
    }
}

impl LikelihoodConfig {
    /// The paper's weight (Eq. 2, Alg. 1 line 14) read as log-likelihood = cosine / temperature: no
    /// outliers, no blank views, every view inside the recorded area trusted.
    pub fn paper() -> Self {
        Self {
            outlier_share: 0.0,
            blank_share: 0.0,
            nearest_tolerance: 1.0,
            interpolation: Interpolation::Nearest,
            unknown_similarity: None,
            shared_error: 0.0,
            overlap_mm: 0.0,
            ..Self::default()
        }
    }

    /// The defaults with what was measured of a model where this side is touched, where it was. A model without a
    /// calibration for touched pegs is believed as for holes: measured, the two hardly differ (`infer/NOTES.md`).
    ///
    /// The share of outliers never falls below the default: few touches of a calibration have any.
    pub fn of_side(model: &Model, side: Side) -> Self {
        let default = Self::default();
        let Some(calibration) = calibration_of(model, side) else { return default };
        let Spread { mean, sd } = calibration.matched.unwrap_or_else(|| matched_by_best(calibration, &default));
        let matched = Spread { mean, sd: sd.max(LEAST_SD) };
        Self {
            temperature: calibration.temperature,
            outlier_share: calibration.outlier_share.max(default.outlier_share),
            blank_agreement: calibration.blank_agreement.clamp(0.5, default.blank_agreement),
            unknown_similarity: Some((matched.mean - UNKNOWN_SDS * matched.sd).max(-1.0)),
            matched_mean: matched.mean,
            matched_sd: matched.sd,
            matched_shared: shared_variance(calibration),
            matched_views: calibration.views,
            ..default
        }
    }

    /// [`Self::of_side`] where holes are touched.
    pub fn of(model: &Model) -> Self {
        Self::of_side(model, Side::Hole)
    }

    /// The same where a bank compares embeddings in a metric of its own: what was measured by the cosine alone, scaled as the
    /// bank's own touches are. Half of what these ask for counts, on a logarithmic scale: how much of it another sensor
    /// leaves is not known (`NOTES.md`).
    #[must_use]
    pub fn in_metric_of(&self, bank: &Bank) -> Self {
        let Some(metric) = bank.metric() else { return *self };
        let scaled = |cosine: f64| (1.0 - metric.counted_scale() * (1.0 - cosine)).max(-1.0);
        let calibrated = metric.counted_scale() * self.temperature;
        Self {
            temperature: metric.measured().temperature.map_or(calibrated, |own| (own * calibrated).sqrt()),
            unknown_similarity: self.unknown_similarity.map(scaled),
            matched_mean: scaled(self.matched_mean),
            matched_sd: metric.counted_scale() * self.matched_sd,
            ..*self
        }
    }

    /// Refuses numbers outside their ranges.
    pub fn validate(&self) -> Result<()> {
        let positive = |value: f64| value.is_finite() && value > 0.0;
        let check = |name: &str, expected: &str, got: f64, fine: bool| {
            if fine { Ok(()) } else { Err(Error::config(format!("likelihood.{name}"), expected, got.to_string())) }
        };
        check("temperature", "a positive number", self.temperature, positive(self.temperature))?;
        check("outlier_share", "0 to below 1", self.outlier_share, (0.0..1.0).contains(&self.outlier_share))?;
        let share = f64::from(self.blank_share);
        check("blank_share", "0..=1", share, (0.0..=1.0).contains(&share))?;
        let agreement = self.blank_agreement;
        check("blank_agreement", "above 0 and below 1", agreement, agreement > 0.0 && agreement < 1.0)?;
        check("nearest_tolerance", "a positive number", self.nearest_tolerance, positive(self.nearest_tolerance))?;
        let cosines = -1.0..=1.0;
        if let Some(unknown) = self.unknown_similarity {
            check("unknown_similarity", "-1..=1", unknown, cosines.contains(&unknown))?;
        }
        check("matched_mean", "-1..=1", self.matched_mean, cosines.contains(&self.matched_mean))?;
        check("matched_sd", "a positive number", self.matched_sd, positive(self.matched_sd))?;
        check("matched_shared", "0..=1", self.matched_shared, (0.0..=1.0).contains(&self.matched_shared))?;
        check("shared_error", "0..=1", self.shared_error, (0.0..=1.0).contains(&self.shared_error))?;
        let apart = self.overlap_mm.is_finite() && self.overlap_mm >= 0.0;
        check("overlap_mm", "a number, not negative", self.overlap_mm, apart)?;
        check("overlap_deg", "a positive number", self.overlap_deg, positive(self.overlap_deg))
    }

    /// How touches share evidence.
    pub fn overlap(&self) -> Overlap {
        Overlap { mm: self.overlap_mm, deg: self.overlap_deg }
    }

    /// Whether a view with this share of edge pixels is blank.
    pub fn is_blank(&self, edge_share: f32) -> bool {
        edge_share < self.blank_share
    }
}

/// What was measured of a model where a side is touched; without it, what was measured where holes are.
pub(crate) fn calibration_of(model: &Model, side: Side) -> Option<&Calibration> {
    model.calibration(side).or_else(|| model.calibration(Side::Hole))
}

/// The cosine with the view touched, of a calibration made before that was measured. It says which best cosine 99 in 100
/// touches reach: were they normal, it is 2.33 standard deviations below the mean.
fn matched_by_best(calibration: &Calibration, default: &LikelihoodConfig) -> Spread {
    let sd = calibration.gap.map_or(default.matched_sd, |gap| gap.sd.max(default.matched_sd));
    Spread { mean: (f64::from(calibration.low_similarity) + 2.33 * sd).min(default.matched_mean), sd }
}

/// Share of the cosines' variance that the touches of one hole under one sensor have in common: the same print, the same
/// network. On the tuning letters anywhere the mean of eight has a standard deviation of 0.015, each one of 0.034.
const SHARED_VARIANCE: f64 = 0.1;

/// The share with what sensors differ by, which all touches of one have in common.
fn shared_variance(calibration: &Calibration) -> f64 {
    match (calibration.between_sensors, calibration.matched) {
        (Some(between), Some(matched)) if matched.sd > 0.0 => {
            let between = (between / matched.sd).powi(2).min(1.0);
            between + (1.0 - between) * SHARED_VARIANCE
        }
        _ => SHARED_VARIANCE,
    }
}

/// Few touches may agree by chance; cosines of no sensor lie nearer together.
const LEAST_SD: f64 = 0.01;

/// A recorded view whose cosine is so many standard deviations below that of the view touched is less likely than one that
/// nobody recorded. With 4 more parts of the bank are taken for none of these (`NOTES.md`).
const UNKNOWN_SDS: f64 = 5.0;

/// Probability that a view outside the recorded area is blank. Around a small part nearly all are and on a
/// large one few; were it the recorded views' own share, a blank touch outside would speak for a wrong
/// state that sees the touch at one of the few blank views inside.
const UNKNOWN_IS_BLANK: f64 = 0.5;

/// Parts unlike those that were calibrated on match with so much more variance, a standard deviation of the cosine: 0.050 on
/// outlines drawn at random instead of 0.034 on the tuning letters. Where a bank knows how well each of its parts matches,
/// that counts instead.
const OTHER_PARTS: f64 = 0.0325;

/// What a row of the bank shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Shows {
    /// An edge.
    Edge,
    /// No edge.
    Nothing,
    /// It was not recorded.
    Unknown,
}

/// The log-likelihood of one touch at each recorded view and between them, up to a constant of the touch.
#[derive(Clone, Debug, PartialEq)]
pub struct TouchLikelihood {
    /// The cosine with each row of the bank, `[n_rows]`, -1..=1.
    pub similarities: Vec<f32>,
    /// The largest of them with each part's views at each angle, `[n_parts, n_theta]`.
    best_of_angles: Vec<f32>,
    n_angles: usize,
    /// Outside the recorded area, where the view is unknown: the log of the likelihood of an edged or a blank view,
    /// either as likely as the other.
    pub log_unknown: f64,
    /// The largest cosine with any edged view, -1..=1; -1 where no view is edged.
    pub best_similarity: f32,
    /// The cosine that matches are measured from: the best, or an unknown view's where that is more.
    reference: f32,
    /// Whether the touch showed no edge.
    pub blank: bool,
    /// What each row of the bank shows, `[n_rows]`.
    shows: Vec<Shows>,
    /// How well the touches of each part match its views, as far as the bank knows.
    matches: Arc<Matches>,
    /// What the bank's views are of.
    views: Views,
    side: Side,
    /// How alike the bank's neighbouring views are, `[n_parts]`; `None` where none are interpolated.
    neighbours: Option<Arc<[Neighbours]>>,
    /// Logs of the probabilities that blank and edged agree and that they do not.
    log_agrees: f64,
    log_disagrees: f64,
    model: MatchModel,
    config: LikelihoodConfig,
}

impl TouchLikelihood {
    /// The two-part model of this module. A similarity that is not finite counts as the worst, -1.
    ///
    /// # Errors
    /// A query of another length than the bank's rows, one with no finite similarity at all, or an
    /// edge share that is not a number.
    pub fn new(observation: &Observation, bank: &Bank, config: &LikelihoodConfig) -> Result<Self> {
        let config = &config.in_metric_of(bank);
        let similarities = cosines(observation, bank)?; // [n_rows]
        let of_share = |share: &f32| if config.is_blank(*share) { Shows::Nothing } else { Shows::Edge };
        let mut shows: Vec<Shows> = bank.edge_shares().iter().map(of_share).collect();
        bank.missing().iter().for_each(|row| shows[*row] = Shows::Unknown);
        let blank = config.is_blank(observation.edge_share);
        let of_edged = similarities.iter().zip(&shows).filter(|(_, shows)| **shows == Shows::Edge);
        let mut above_best: Vec<f64> = of_edged.map(|(similarity, _)| f64::from(*similarity)).collect();
        let best_similarity = simd::largest(&above_best).max(-1.0) as f32;
        // Where no recorded view matches better than an unknown one, that is the best match.
        let is_cubic = config.interpolation.is_cubic(bank.grid());
        let unknown_similarity = config.unknown_similarity.filter(|_| is_cubic).map(|cosine| cosine as f32);
        let reference = unknown_similarity.map_or(best_similarity, |unknown| unknown.max(best_similarity));
        above_best.iter_mut().for_each(|similarity| *similarity -= f64::from(reference));
        // A view outside the recorded area is one more that a touch may be made at.
        let beside = unknown_similarity.map(|unknown| f64::from(unknown - reference));
        above_best.extend(beside);
        let model = MatchModel::new(config.temperature, config.outlier_share, above_best);
        let log_unknown = match unknown_similarity {
            _ if blank => UNKNOWN_IS_BLANK.ln(),
            Some(unknown) => (1.0 - UNKNOWN_IS_BLANK).ln() + model.log(f64::from(unknown - reference)),
            None => (1.0 - UNKNOWN_IS_BLANK).ln(),
        };
        let neighbours = is_cubic.then(|| bank.neighbours().clone());
        let n_angles = bank.grid().n_theta();
        let best_of_angles = best_of_angles(&similarities, bank.grid().len(), n_angles);
        let (log_agrees, log_disagrees) = (config.blank_agreement.ln(), (1.0 - config.blank_agreement).ln());
        Ok(Self {
            similarities,
            best_of_angles,
            n_angles,
            log_unknown,
            best_similarity,
            reference,
            blank,
            shows,
            matches: bank.matches().clone(),
            views: bank.views(),
            side: observation.side,
            neighbours,
            log_agrees,
            log_disagrees,
            model,
            config: *config,
        })
    }

    /// What is expected of a touch of a part: its cosine with the view that it is made at. As the calibration measured it
    /// on other parts and the bank of this one, whichever expects less.
    ///
    /// A bank of both sides matches better than the bank of pegs that a model is calibrated with, and how much better the
    /// sensor leaves it is not known: half of it is counted on (`NOTES.md`), until touches calibrate it.
    pub fn expected(&self, part: usize) -> Spread {
        let LikelihoodConfig { matched_mean, matched_sd, matched_views, .. } = self.config;
        match self.matches.of(part, self.side) {
            Some(PartMatch { matched, .. }) => {
                let least = matched.mean.min(matched_mean);
                let mean = match (self.views, matched_views) {
                    (Views::Both, Views::Pegs) => 0.5 * (matched.mean + least),
                    (Views::Pegs, Views::Both) => matched.mean,
                    _ => least,
                };
                Spread { mean, sd: matched.sd.max(matched_sd) }
            }
            None => Spread { mean: matched_mean, sd: matched_sd.hypot(OTHER_PARTS) },
        }
    }

    /// The mean of `exp((s - best) / tau)` over the views, 0..=1; `None` where the touch is blank.
    pub(crate) fn mean_match(&self) -> Option<f64> {
        (!self.blank).then_some(self.model.mean)
    }

    /// The log-likelihood at one row of the bank; finite.
    pub fn log_row(&self, row: usize) -> f64 {
        self.log_between(self.similarities[row], row)
    }

    /// The log-likelihood at a view of a given cosine, near one row of the bank that says whether it is
    /// blank; about 0 where the touch says nothing.
    pub fn log_between(&self, similarity: f32, row: usize) -> f64 {
        match (self.shows[row], self.blank) {
            (Shows::Unknown, _) => self.log_unknown,
            (Shows::Edge, true) | (Shows::Nothing, false) => self.log_disagrees,
            (Shows::Nothing, true) => self.log_agrees,
            (Shows::Edge, false) => {
                let above = f64::from(similarity - self.reference);
                self.log_agrees + self.model.log(above)
            }
        }
    }

    /// The same of an edged touch at views of these cosines, near rows that show an edge too.
    pub(crate) fn match_logs(&self, similarities: &[f32]) -> Vec<f64> {
        let above_best = similarities.iter().map(|similarity| similarity - self.reference).collect();
        self.model.logs(above_best, self.log_agrees)
    }

    /// The cosine at a pose between the views of one part, whose rows start at `start`.
    pub(crate) fn between(&self, weights: &ViewWeights, start: usize, n_cells: usize) -> f32 {
        let similarities = &self.similarities[start..start + n_cells];
        match &self.neighbours {
            Some(neighbours) => weights.cosine(similarities, &neighbours[start / n_cells]),
            None => weights.value(similarities),
        }
    }

    /// [`Self::between`] at each place of a lattice of few places, x slowest, with the nearest view; `None` where the view
    /// is unknown.
    pub(crate) fn on_few(&self, lattice: &LatticeWeights, part: usize, n_cells: usize) -> Vec<Option<(Nearest, f32)>> {
        let values = lattice.values_of_few(&self.similarities[part * n_cells..(part + 1) * n_cells]);
        let at = |(place, value): (usize, f32)| {
            let weights = lattice.weights(place / lattice.n_ys(), place % lattice.n_ys())?;
            let directed = |neighbours: &Arc<[Neighbours]>| weights.directed(value, &neighbours[part]);
            let cosine = self.neighbours.as_ref().map_or(value, directed);
            Some((Nearest { cell: weights.cell, trust: weights.trust }, cosine))
        };
        values.into_iter().enumerate().map(at).collect()
    }

    /// The cosines at the states of a lattice, as [`Self::between`] would find each but for those far above any recorded
    /// view ([`LatticeWeights::most`]); `planes` are the cosines with the
    /// part's views, [`in_planes`](crate::interpolation::in_planes).
    pub(crate) fn on_lattice(&self, lattice: &LatticeWeights, part: usize, planes: &[f32]) -> Vec<f32> {
        let neighbours = self.neighbours.as_ref().map(|neighbours| &neighbours[part]);
        let (mut cosines, most) = (lattice.cosines(planes, neighbours), lattice.most(self.best_of_angles(part)));
        cosines.iter_mut().for_each(|cosine| *cosine = cosine.min(most));
        cosines
    }

    /// The largest cosine with a part's recorded views at each angle, `[n_theta]`.
    pub(crate) fn best_of_angles(&self, part: usize) -> &[f32] {
        &self.best_of_angles[part * self.n_angles..(part + 1) * self.n_angles]
    }

    /// The log-likelihood at no view is above this, where none has a larger cosine.
    pub(crate) fn highest(&self, most: f32) -> f64 {
        if self.blank {
            return self.log_unknown.max(self.log_agrees).max(self.log_disagrees);
        }
        // Those of many states are found in f32, to so many nats.
        const ROUNDING: f64 = 1e-5;
        let matched = self.log_agrees + self.model.log(f64::from(most - self.reference)) + ROUNDING;
        self.log_unknown.max(self.log_disagrees).max(matched)
    }

    /// The settings it was made with.
    pub fn config(&self) -> &LikelihoodConfig {
        &self.config
    }

    /// Whether the view of a row shows an edge.
    pub fn is_edged(&self, row: usize) -> bool {
        self.shows[row] == Shows::Edge
    }

    /// Whether the view of a row was recorded.
    pub fn is_recorded(&self, row: usize) -> bool {
        self.shows[row] != Shows::Unknown
    }
}

/// The largest of the cosines with each part's views at each angle, `[n_parts, n_theta]`; `[n_parts, n_x, n_y, n_theta]`.
fn best_of_angles(similarities: &[f32], n_views: usize, n_angles: usize) -> Vec<f32> {
    let of_part = |views: &[f32]| {
        let mut best = vec![-1.0_f32; n_angles];
        for line in views.chunks_exact(n_angles) {
            best.iter_mut().zip(line).for_each(|(best, cosine)| *best = if *cosine > *best { *cosine } else { *best });
        }
        best
    };
    similarities.chunks_exact(n_views).flat_map(of_part).collect()
}

fn cosines(observation: &Observation, bank: &Bank) -> Result<Vec<f32>> {
    let query = &observation.query;
    if query.len() != bank.dim() {
        let expected = format!("a query of {} values, as the bank's rows", bank.dim());
        return Err(Error::observation(expected, format!("{} values", query.len())));
    }
    if !(0.0..=1.0).contains(&observation.edge_share) {
        return Err(Error::observation("an edge share in 0..=1", observation.edge_share.to_string()));
    }
    // By its largest value first: the squares of long and short queries leave the range of f32.
    let largest = query.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
    let query: Vec<f32> = query.iter().map(|value| if largest > 0.0 { value / largest } else { *value }).collect();
    let mut similarities = Vec::new();
    bank.similarities(&query, &mut similarities);
    if similarities.iter().all(|s| !s.is_finite()) {
        return Err(Error::observation("a finite similarity with some part", "none"));
    }
    let norm = dot(&query, &query).sqrt();
    let scale = if norm > 0.0 && norm.is_finite() { norm.recip() } else { 1.0 };
    for similarity in &mut similarities {
        *similarity = if similarity.is_finite() { (*similarity * scale).clamp(-1.0, 1.0) } else { -1.0 };
    }
    Ok(similarities)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::grid::PoseGrid;
    use tactile_infer::metric::{Measured, Metric};
    use tactile_infer::rows::Rows;

    const ONE_POSE: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };

    /// One part and one pose a row.
    fn bank(rows: &[[f32; 2]], edge_shares: &[f32]) -> Bank {
        let names = (0..rows.len()).map(|row| row.to_string()).collect();
        Bank::from_rows(names, ONE_POSE, Rows::new(2, rows.concat()).unwrap(), edge_shares.to_vec(), "").unwrap()
    }

    fn touch(query: [f32; 2], edge_share: f32) -> Observation {
        Observation::new(query.to_vec(), edge_share)
    }

    fn log_rows(seen: &TouchLikelihood) -> Vec<f64> {
        (0..seen.similarities.len()).map(|row| seen.log_row(row)).collect()
    }

    /// The defaults but for round numbers.
    fn round() -> LikelihoodConfig {
        LikelihoodConfig { temperature: 0.1, outlier_share: 0.01, ..LikelihoodConfig::default() }
    }

    #[test]
    fn the_two_parts_multiply() {
        let bank = bank(&[[1.0, 0.0], [0.8, 0.6], [1.0, 0.0]], &[0.2, 0.2, 0.0]);
        let config = round();
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.3), &bank, &config).unwrap();
        let (best, other) = (1.0, (-2.0_f64).exp()); // cosines 1 and 0.8, tau 0.1, eps 0.01
        let mean = (best + other) / 2.0;
        let [best, other] = [best, other].map(|look| 0.99 * look / mean + 0.01);
        let by_hand = [0.96 * best, 0.96 * other, 0.04];
        for (log, expected) in log_rows(&seen).iter().zip(by_hand) {
            // Cosines are f32: 6e-8 over a temperature of 0.1.
            assert!((log.exp() - expected).abs() < 2e-6, "{} {expected}", log.exp());
        }
        assert_eq!(seen.log_unknown, 0.5_f64.ln());
    }

    #[test]
    fn a_part_is_expected_to_match_as_well_as_it_was_seen_to_and_no_better_than_others() {
        let spread = |mean, sd| Spread { mean, sd };
        let poor = PartMatch { matched: spread(0.7, 0.08) };
        let good = PartMatch { matched: spread(0.99, 0.01) };
        let known = Matches { holes: vec![Some(poor), Some(good), None], pegs: vec![None; 3] };
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]], &[0.3; 3]).with_matches(known).unwrap();
        let config = LikelihoodConfig { matched_mean: 0.94, matched_sd: 0.03, ..round() };
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.3), &bank, &config).unwrap();
        assert_eq!(seen.expected(0), poor.matched);
        assert_eq!(seen.expected(1), spread(0.94, 0.03));
        // Nothing is known of the third: as of other parts, but less surely.
        let Spread { mean, sd } = seen.expected(2);
        assert_eq!(mean, 0.94);
        assert!((sd - 0.03_f64.hypot(OTHER_PARTS)).abs() < 1e-15);
    }

    #[test]
    fn half_is_counted_on_of_what_a_bank_of_both_sides_matches_better_than_one_of_pegs() {
        let spread = |mean| Spread { mean, sd: 0.01 };
        let part = |mean| Some(PartMatch { matched: spread(mean) });
        let known = Matches { holes: vec![part(0.98), part(0.8)], pegs: vec![None; 2] };
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0]], &[0.3; 2]).with_matches(known).unwrap();
        let mean = |bank_views: Views, matched_views, part| {
            let bank = bank.clone().with_views(bank_views);
            let config = LikelihoodConfig { matched_mean: 0.92, matched_views, ..round() };
            TouchLikelihood::new(&touch([1.0, 0.0], 0.3), &bank, &config).unwrap().expected(part).mean
        };
        use Views::{Both, Pegs};
        for (of_bank, of_calibration, [first, second]) in
            [(Pegs, Pegs, [0.92, 0.8]), (Both, Both, [0.92, 0.8]), (Both, Pegs, [0.95, 0.8]), (Pegs, Both, [0.98, 0.8])]
        {
            assert!((mean(of_bank, of_calibration, 0) - first).abs() < 1e-12, "{of_bank:?} {of_calibration:?}");
            assert!((mean(of_bank, of_calibration, 1) - second).abs() < 1e-12, "{of_bank:?} {of_calibration:?}");
        }
    }

    #[test]
    fn a_blank_touch_tells_blank_views_from_edged_ones_and_no_more() {
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], &[0.0, 0.0, 0.2]);
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.0), &bank, &LikelihoodConfig::default()).unwrap();
        assert!(seen.blank);
        assert_eq!(log_rows(&seen)[0], log_rows(&seen)[1]);
        assert!((log_rows(&seen)[0] - log_rows(&seen)[2] - (0.96_f64 / 0.04).ln()).abs() < 1e-12);
    }

    #[test]
    fn the_papers_likelihood_is_the_cosine_over_the_temperature() {
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], &[0.0, 0.1, 0.2]);
        let config = LikelihoodConfig { temperature: 0.1, ..LikelihoodConfig::paper() };
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.0), &bank, &config).unwrap();
        assert!((log_rows(&seen)[0] - log_rows(&seen)[1] - 10.0).abs() < 1e-5);
        assert!((log_rows(&seen)[1] - log_rows(&seen)[2] - 10.0).abs() < 1e-5);
    }

    #[test]
    fn one_bad_match_costs_at_most_the_share_of_outliers() {
        let bank = bank(&[[1.0, 0.0], [-1.0, 0.0]], &[0.2, 0.2]);
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.2), &bank, &round()).unwrap();
        // Half of the views match: twice as likely as anywhere.
        assert!((log_rows(&seen)[0] - log_rows(&seen)[1] - ((0.99 * 2.0 + 0.01) / 0.01_f64).ln()).abs() < 1e-6);
    }

    #[test]
    fn any_temperature_gives_finite_numbers() {
        let bank = bank(&[[1.0, 0.0], [-1.0, 0.0]], &[0.2, 0.2]);
        for temperature in [1e-4, 1.0, 1e4] {
            for outlier_share in [0.0, 0.01] {
                let config = LikelihoodConfig { temperature, outlier_share, ..LikelihoodConfig::default() };
                config.validate().unwrap();
                let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.2), &bank, &config).unwrap();
                assert!(log_rows(&seen).iter().chain([&seen.log_unknown]).all(|log| log.is_finite()));
                assert!(log_rows(&seen)[0] > log_rows(&seen)[1]);
            }
        }
    }

    #[test]
    fn a_query_of_zeros_says_nothing() {
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0]], &[0.2, 0.2]);
        let seen = TouchLikelihood::new(&touch([0.0, 0.0], 0.2), &bank, &LikelihoodConfig::default()).unwrap();
        assert_eq!(log_rows(&seen)[0], log_rows(&seen)[1]);
    }

    #[test]
    fn a_long_query_counts_by_its_direction() {
        let bank = bank(&[[1.0, 0.0], [0.6, 0.8]], &[0.2, 0.2]);
        let seen = |query| TouchLikelihood::new(&touch(query, 0.2), &bank, &LikelihoodConfig::default()).unwrap();
        for (long, unit) in log_rows(&seen([300.0, 0.0])).iter().zip(log_rows(&seen([1.0, 0.0]))) {
            assert!((long - unit).abs() < 1e-5);
        }
    }

    #[test]
    fn a_similarity_that_overflows_is_the_worst_and_all_of_them_are_an_error() {
        let bank = bank(&[[1.0, 0.0], [0.0, 0.5]], &[0.2, 0.2]);
        let config = LikelihoodConfig::default();
        for query in [[f32::NAN, 1.0], [f32::INFINITY, f32::INFINITY]] {
            assert!(TouchLikelihood::new(&touch(query, 0.2), &bank, &config).is_err());
        }
        // 3e38 + 3e38 overflows in the first row only.
        let steep = super::tests::bank(&[[3e38, 3e38], [0.0, 1.0]], &[0.2, 0.2]);
        let seen = TouchLikelihood::new(&touch([1.0, 1.0], 0.2), &steep, &config).unwrap();
        assert!(log_rows(&seen)[0] < log_rows(&seen)[1]);
    }

    /// A bank with a metric judges as one whose rows, and a touch, were turned by hand.
    #[test]
    fn a_metric_is_what_it_makes_of_rows_and_touches() {
        let measured = Measured { error_scale: 0.64, temperature: Some(0.02) };
        let metric = Metric::new(2, vec![1.0, 0.0, 0.75, 3.0], measured).unwrap();
        let rows = [[1.0, 0.0], [0.6, 0.8], [-0.28, 0.96]];
        let by_hand = |[x, y]: [f32; 2]| {
            let turned = [x, 0.75 * x + 3.0 * y];
            turned.map(|value| value / turned[0].hypot(turned[1]))
        };
        let shares = [0.2, 0.2, 0.0];
        let learnt = bank(&rows, &shares).with_metric(metric).unwrap();
        let config =
            LikelihoodConfig { temperature: 0.05, unknown_similarity: Some(0.5), ..LikelihoodConfig::default() };
        // Half of 0.64 on a logarithmic scale is 0.8, half way from 0.8 * 0.05 to 0.02 the root of their product.
        let scaled = |cosine: f64| 1.0 - 0.8 * (1.0 - cosine);
        let same = LikelihoodConfig {
            temperature: (0.04_f64 * 0.02).sqrt(),
            unknown_similarity: Some(scaled(0.5)),
            matched_mean: scaled(config.matched_mean),
            matched_sd: 0.8 * config.matched_sd,
            ..config
        };
        let seen = TouchLikelihood::new(&touch([0.8, 0.6], 0.2), &learnt, &config).unwrap();
        let turned = TouchLikelihood::new(&touch(by_hand([0.8, 0.6]), 0.2), &bank(&rows.map(by_hand), &shares), &same);
        let turned = turned.unwrap();
        for row in 0..rows.len() {
            assert!((seen.log_row(row) - turned.log_row(row)).abs() < 1e-4, "{row}");
        }
        let (a, b) = (seen.expected(0), turned.expected(0));
        assert!((a.mean - b.mean).abs() < 1e-12 && (a.sd - b.sd).abs() < 1e-12);
    }

    #[test]
    fn misfits_are_refused_in_one_line() {
        let bank = bank(&[[1.0, 0.0]], &[0.2]);
        let short = Observation::new(vec![1.0], 0.2);
        let error = TouchLikelihood::new(&short, &bank, &LikelihoodConfig::default()).unwrap_err();
        assert_eq!(error.to_string(), "touch: expected a query of 2 values, as the bank's rows, got 1 values");
        assert!(TouchLikelihood::new(&touch([1.0, 0.0], f32::NAN), &bank, &LikelihoodConfig::default()).is_err());
        let cold = LikelihoodConfig { temperature: 0.0, ..LikelihoodConfig::default() };
        assert!(cold.validate().unwrap_err().to_string().starts_with("likelihood.temperature: expected a positive"));
    }
}
