//! How likely one touch is at each recorded view: the log-odds that it was made there, against a touch of anything in the
//! world of parts ([`tactile_infer::calibration::match_odds`]).
//!
//! What was not recorded is as likely as the mean of the bank's views, and no less than the world; all is measured against it. A share
//! of all touches (`outlier_share`) is of something else than it was meant for, so that one touch cannot rule a state out.

use std::ops::Range;
use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_infer::Bank;
use tactile_infer::bank::matches::{Matches, PartMatch};
use tactile_infer::bank::neighbours::Neighbours;
use tactile_infer::bank::similarity::dot;
use tactile_infer::bank::views::Views;
use tactile_infer::calibration::Spread;

use crate::error::{Error, Result};
use crate::likelihood::cosine_bounds::{CosineBounds, PartBounds};
use crate::likelihood::interpolation::ViewWeights;
use crate::likelihood::lattice::LatticeWeights;
use crate::likelihood::match_model::MatchModel;
use crate::likelihood::nearest::Nearest;
use crate::touch::Observation;
use crate::touch_model::TouchModel;

/// Other parts than the calibration's match with so much more variance, a standard deviation of the cosine: 0.050 on
/// outlines drawn at random instead of 0.034 on the tuning letters. Where a bank knows how well each of its parts matches,
/// that counts instead.
const OTHER_PARTS: f64 = 0.0325;

/// Where a touch may be no more than so many nats likelier than an outlier, it is one.
const OUTLIER_NATS: f64 = 2e-3;

/// The log-likelihood of a touch at the states of a lattice.
#[derive(Clone, Debug)]
pub(crate) struct OnLattice {
    /// Outside the window, where it is an outlier; finite.
    pub log_outlier: f64,
    /// The places along x and along y where it may match.
    pub window: [Range<usize>; 2],
    n_ys: usize,
    /// Within the window, x slowest, above an outlier's.
    above_outlier: Vec<f64>,
}

impl OnLattice {
    /// At the places of the window at one of the xs, how far it is above an outlier; `None` outside the window.
    pub fn above_outlier(&self, x: usize) -> Option<&[f64]> {
        let [xs, ys] = &self.window;
        xs.contains(&x).then(|| &self.above_outlier[(x - xs.start) * ys.len()..][..ys.len()])
    }

    /// At a place of the lattice, x slowest.
    pub fn at(&self, place: usize) -> f64 {
        let (x, y) = (place / self.n_ys, place % self.n_ys);
        let line = self.above_outlier(x).filter(|_| self.window[1].contains(&y));
        self.log_outlier + line.map_or(0.0, |line| line[y - self.window[1].start])
    }
}

/// The log-likelihood of one touch at each recorded view and between them, against that of what nobody recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct TouchLikelihood {
    /// The cosine with each row of the bank, `[n_rows]`, -1..=1.
    pub similarities: Vec<f32>,
    /// The largest of them with each part's views at each angle.
    bounds: CosineBounds,
    /// The plain cosine with the recorded view that it resembles most, -1..=1, in whichever metric the bank compares; -1 where
    /// nothing was recorded.
    pub best_cosine: f32,
    /// Whether the touch showed no edge.
    pub blank: bool,
    /// How rare it is in the world, nats.
    pub(crate) rarity: f64,
    /// How far touches are from their own views in this bank.
    pub(crate) own_distance: f64,
    /// The log-odds of what nobody recorded, against the world: at least 0.
    pub(crate) unknown: f64,
    /// Which rows of the bank were recorded; `None`: all.
    recorded: Option<Vec<bool>>,
    /// How well the touches of each part match its views, as far as the bank knows.
    matches: Arc<Matches>,
    /// What the bank's views are of.
    views: Views,
    side: Side,
    /// How alike the bank's neighbouring views are, `[n_parts]`; `None` where none are interpolated.
    neighbours: Option<Arc<[Neighbours]>>,
    model: MatchModel,
    config: TouchModel,
}

impl TouchLikelihood {
    /// The model of this module, by what is measured or fixed, in the bank's metric ([`TouchModel::in_metric_of`]). A
    /// similarity that is not finite counts as the worst, -1.
    ///
    /// # Errors
    /// A query of another length than the bank's rows, one with no finite similarity at all, an edge share or a rarity
    /// that is not a number.
    pub fn new(observation: &Observation, bank: &Bank, config: &TouchModel) -> Result<Self> {
        let similarities = cosines(observation, bank)?; // [n_rows]
        let recorded = (!bank.missing().is_empty()).then(|| {
            let mut recorded = vec![true; similarities.len()];
            bank.missing().iter().for_each(|row| recorded[*row] = false);
            recorded
        });
        let known = || (0..similarities.len()).filter(|row| recorded.as_ref().is_none_or(|recorded| recorded[*row]));
        let best_row = known().reduce(|best, row| if similarities[row] > similarities[best] { row } else { best });
        let best_cosine = best_row.map_or(-1.0, |row| bank.plain_cosine(&observation.query, row));
        let own_distance = bank.matches().own_distance(observation.side).unwrap_or(config.own_distance);
        let rarity = f64::from(observation.rarity);
        let model = match config.temperature {
            Some(temperature) => {
                let cosines: Vec<f64> = known().map(|row| f64::from(similarities[row])).collect();
                MatchModel::of_cosines(temperature, &cosines)
            }
            None => MatchModel::of_odds(config, [rarity, own_distance], observation.edge_share),
        };
        let unknown = model.log_mean(known().map(|row| similarities[row]));
        let neighbours = config.interpolation.is_cubic(bank.grid()).then(|| bank.neighbours().clone());
        let bounds = CosineBounds::of(&similarities, bank.grid());
        Ok(Self {
            similarities,
            bounds,
            best_cosine,
            blank: config.is_blank(observation.edge_share),
            rarity,
            own_distance,
            unknown,
            recorded,
            matches: bank.matches().clone(),
            views: bank.views(),
            side: observation.side,
            neighbours,
            model: model.against(unknown),
            config: *config,
        })
    }

    /// What is expected of a touch of a part: its cosine with the view that it is made at, as the bank measured it of this part,
    /// and as widely spread as under the sensors of the calibration. Where that is of the user's own sensor and of such views, no
    /// more than it says.
    pub fn expected(&self, part: usize) -> Spread {
        let TouchModel { matched_mean, matched_sd, sensor_views, .. } = self.config;
        match self.matches.of(part, self.side) {
            Some(PartMatch { matched, .. }) => {
                let most = if sensor_views == Some(self.views) { matched_mean } else { f64::INFINITY };
                Spread { mean: matched.mean.min(most), sd: matched.sd.max(matched_sd) }
            }
            None => Spread { mean: matched_mean, sd: matched_sd.hypot(OTHER_PARTS) },
        }
    }

    /// The log-likelihood at one row of the bank; finite.
    pub fn log_row(&self, row: usize) -> f64 {
        self.log_between(self.similarities[row], row)
    }

    /// The log-likelihood at a view of a given cosine near one row of the bank: 0 where that was not recorded.
    pub fn log_between(&self, similarity: f32, row: usize) -> f64 {
        if self.is_recorded(row) { self.model.log(f64::from(similarity)) } else { 0.0 }
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
    pub(crate) fn on_few(
        &self,
        lattice: &LatticeWeights,
        part: usize,
        n_cells: usize,
    ) -> impl Iterator<Item = Option<(Nearest, f32)>> {
        let neighbours = self.neighbours.as_ref().map(|neighbours| &neighbours[part]);
        let cosines = lattice.cosines_of_few(&self.similarities[part * n_cells..(part + 1) * n_cells], neighbours);
        lattice.nearest().zip(cosines).map(|(nearest, cosine)| Some((nearest?, cosine)))
    }

    /// The log-likelihood at the states of a lattice, as [`Self::log_between`] would find each near a row that was recorded,
    /// but for two: what is far above the recorded views around counts less
    /// ([`LatticeWeights::most_on_lines`]), and where that leaves less than [`OUTLIER_NATS`], the touch is an outlier.
    /// `planes` are the cosines with the part's views, [`in_planes`](crate::likelihood::lattice::in_planes).
    pub(crate) fn on_lattice(&self, lattice: &LatticeWeights, part: usize, planes: &[f32]) -> OnLattice {
        let bounds = self.bounds(part);
        // Without outliers the window is all there is.
        let log_outlier = self.model.log_outlier();
        let log_outlier = if log_outlier.is_finite() { log_outlier } else { 0.0 };
        let least = self.model.above_outliers(OUTLIER_NATS) as f32;
        let may_match = |most: &f32| *most >= least;
        let outlier = OnLattice { log_outlier, n_ys: lattice.n_ys(), window: [0..0, 0..0], above_outlier: Vec::new() };
        if !may_match(&lattice.most(bounds.of_angles)) {
            return outlier;
        }
        let most = lattice.most_on_lines(bounds);
        let [xs, ys] = [0, 1].map(|axis: usize| {
            let start = most[axis].iter().position(may_match).unwrap_or(0);
            start..most[axis].iter().rposition(may_match).map_or(start, |last| last + 1)
        });
        if xs.is_empty() || ys.is_empty() {
            return outlier;
        }
        let neighbours = self.neighbours.as_ref().map(|neighbours| &neighbours[part]);
        let mut cosines = lattice.cosines(planes, neighbours, [xs.clone(), ys.clone()]);
        for (most_x, line) in most[0][xs.clone()].iter().zip(cosines.chunks_exact_mut(ys.len())) {
            for (cosine, most_y) in line.iter_mut().zip(&most[1][ys.clone()]) {
                *cosine = cosine.min(most_x.min(*most_y));
            }
        }
        let above_outlier = self.model.logs(cosines, -log_outlier);
        OnLattice { above_outlier, window: [xs, ys], ..outlier }
    }

    /// The largest cosines with a part's recorded views.
    pub(crate) fn bounds(&self, part: usize) -> PartBounds<'_> {
        self.bounds.of_part(part)
    }

    /// The log-likelihood at no view is above this, where none has a larger cosine.
    pub(crate) fn highest(&self, most: f32) -> f64 {
        // Those of many states are found in f32, to so many nats.
        const ROUNDING: f64 = 1e-5;
        (self.model.log(f64::from(most)) + ROUNDING).max(0.0)
    }

    /// The settings it was made with.
    pub fn config(&self) -> &TouchModel {
        &self.config
    }

    /// Whether the view of a row was recorded.
    pub fn is_recorded(&self, row: usize) -> bool {
        self.recorded.as_ref().is_none_or(|recorded| recorded[row])
    }

    /// Whether the view of some row was not.
    pub(crate) fn lacks_views(&self) -> bool {
        self.recorded.is_some()
    }
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
    if !observation.rarity.is_finite() {
        return Err(Error::observation("a finite rarity", observation.rarity.to_string()));
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
    use tactile_data::pose::grid::PoseGrid;
    use tactile_infer::bank::metric::{Measured, Metric};
    use tactile_infer::bank::rows::Rows;

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

    /// Logs against that of their mean likelihood, or of the world's 0, if that is more.
    fn against_mean(logs: &[f64]) -> Vec<f64> {
        let mean = logs.iter().map(|log| log.exp()).sum::<f64>() / logs.len() as f64;
        logs.iter().map(|log| log - mean.ln().max(0.0)).collect()
    }

    /// The defaults but for round numbers: a touch that shows an edge on [`FOUR_TIMES`] costs 20 nats a distance of 1.
    fn round() -> TouchModel {
        TouchModel {
            match_offset: 2.0,
            steepness: 10.0,
            steepness_by_edge: 0.5,
            own_distance: 0.3,
            outlier_share: 0.01,
            ..TouchModel::default()
        }
    }

    /// A share of edge that is, with the noise, four times the usual one.
    const FOUR_TIMES: f32 = 0.197;

    /// Four rows by their cosines 1, 0.8, 0 and -1 with the first.
    const ROWS: [[f32; 2]; 4] = [[1.0, 0.0], [0.8, 0.6], [0.0, 1.0], [-1.0, 0.0]];
    const DISTANCES: [f64; 4] = [0.0, 0.632_455_532, std::f64::consts::SQRT_2, 2.0];

    fn assert_close(found: &[f64], expected: &[f64], most: f64) {
        let apart = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(found.len() == expected.len() && apart < most, "{found:?} {expected:?}");
    }

    #[test]
    fn the_odds_agree_with_hand_arithmetic_for_edged_and_for_blank_touches() {
        let bank = bank(&ROWS, &[0.2, 0.0, 0.2, 0.2]);
        // No edge is, with the noise, 0.06 of the usual share.
        for (edge_share, steepness) in [(FOUR_TIMES, 20.0), (0.0, 10.0 * 0.06_f64.sqrt())] {
            let seen = TouchLikelihood::new(&touch([1.0, 0.0], edge_share), &bank, &round()).unwrap();
            assert_eq!(seen.blank, edge_share == 0.0);
            let odds = |distance: f64| (2.0 - steepness * (distance - 0.3)).exp();
            let by_hand = DISTANCES.map(|distance| (0.99 * odds(distance) + 0.01).ln());
            // The cosine 0.8 is off by 1.2e-8, times a steepness of 20 over its distance.
            assert_close(&log_rows(&seen), &against_mean(&by_hand), 1e-6);
        }
    }

    /// Blank or not; views that match hardly are less likely than the world.
    #[test]
    fn what_was_not_recorded_is_as_likely_as_the_mean_of_what_was_or_the_world() {
        // Two parts at three angles.
        let grid = PoseGrid { theta_half_deg: 30.0, ..ONE_POSE };
        let rows = [[1.0, 0.0], [0.8, 0.6], [0.0, 1.0], [0.0, 1.0], [-1.0, 0.0], [0.6, 0.8]];
        let rows = Rows::new(2, rows.concat()).unwrap();
        let whole = Bank::from_rows(vec!["A".into(), "B".into()], grid, rows, vec![0.2; 6], "").unwrap();
        let lacking = whole.clone().with_missing(vec![0, 2]).unwrap();
        for edge_share in [FOUR_TIMES, 0.0] {
            for rarity in [0.0, -1.5] {
                let observation = Observation { rarity, ..touch([1.0, 0.0], edge_share) };
                let seen = |bank| TouchLikelihood::new(&observation, bank, &round()).unwrap();
                let (whole, lacking) = (seen(&whole), seen(&lacking));
                let odds: Vec<f64> = log_rows(&whole).iter().map(|log| log + whole.unknown).collect();
                let mut expected = vec![0.0; 6];
                let known = [1, 3, 4, 5];
                let against = against_mean(&known.map(|row: usize| odds[row]));
                known.iter().zip(against).for_each(|(row, log)| expected[*row] = log);
                assert_close(&log_rows(&lacking), &expected, 1e-8);
                // Without an edge a distance costs little, and the mean view is likelier than the world.
                assert_eq!(lacking.unknown > 0.0, edge_share == 0.0 && rarity == 0.0);
                assert_eq!([lacking.log_between(1.0, 2), lacking.log_between(-1.0, 0)], [0.0; 2]);
                // Nor does it resemble what nobody recorded.
                assert_eq!((whole.best_cosine, lacking.best_cosine), (1.0, 0.8));
            }
        }
    }

    #[test]
    fn a_bank_that_knows_its_matches_says_how_far_touches_are_from_their_own_views() {
        let part = |mean| Some(PartMatch { matched: Spread { mean, sd: 0.02 } });
        // Distances of 0.2 and 0.4; of pegs nothing is known.
        let holes = vec![part(0.98), None, part(0.92), None];
        let known = bank(&ROWS, &[0.2; 4]).with_matches(Matches { holes, pegs: vec![None; 4] }).unwrap();
        let model = TouchModel { outlier_share: 0.0, own_distance: 0.7, distance_by_own: 1.0, ..round() };
        let logs = |bank: &Bank, side| {
            let seen = TouchLikelihood::new(&touch([1.0, 0.0], FOUR_TIMES).of_side(side), bank, &model).unwrap();
            (log_rows(&seen), seen.own_distance)
        };
        // Counted by the power 1 of 0.7 over its own.
        let by_hand = |own: f64| against_mean(&DISTANCES.map(|distance| 2.0 - 20.0 * (0.7 / own * distance - 0.7)));
        for (side, own) in [(Side::Hole, 0.3), (Side::Peg, 0.7)] {
            let (found, found_own) = logs(&known, side);
            assert!((found_own - own).abs() < 1e-12, "{found_own}");
            // The share in f32 is off by 2^-25 of itself, and a power of it costs up to 65 nats.
            assert_close(&found, &by_hand(own), 4e-6);
        }
        assert_close(&logs(&bank(&ROWS, &[0.2; 4]), Side::Hole).0, &by_hand(0.7), 1e-6);
    }

    #[test]
    fn a_rare_touch_is_likelier_at_every_view_alike() {
        let bank = bank(&ROWS, &[0.2; 4]);
        let logs = |rarity: f32, outlier_share: f64| {
            let observation = Observation { rarity, ..touch([1.0, 0.0], FOUR_TIMES) };
            let model = TouchModel { outlier_share, ..round() };
            let seen = TouchLikelihood::new(&observation, &bank, &model).unwrap();
            log_rows(&seen).iter().map(|log| log + seen.unknown).collect::<Vec<f64>>()
        };
        for rarity in [1.5_f32, -2.25] {
            let more: Vec<f64> = logs(0.0, 0.0).iter().map(|log| log + f64::from(rarity)).collect();
            assert_close(&logs(rarity, 0.0), &more, 1e-12);
            // Outliers are as rare as they are.
            let mixed: Vec<f64> = more.iter().map(|log| (0.99 * log.exp() + 0.01).ln()).collect();
            assert_close(&logs(rarity, 0.01), &mixed, 1e-8);
        }
    }

    #[test]
    fn a_part_is_expected_to_match_as_well_as_it_was_seen_to() {
        let spread = |mean, sd| Spread { mean, sd };
        let poor = PartMatch { matched: spread(0.7, 0.08) };
        let good = PartMatch { matched: spread(0.99, 0.01) };
        let known = Matches { holes: vec![Some(poor), Some(good), None], pegs: vec![None; 3] };
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0], [0.6, 0.8]], &[0.3; 3]).with_matches(known).unwrap();
        let config = TouchModel { matched_mean: 0.94, matched_sd: 0.03, ..round() };
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.3), &bank, &config).unwrap();
        assert_eq!(seen.expected(0), poor.matched);
        assert_eq!(seen.expected(1), Spread { sd: 0.03, ..good.matched });
        // Nothing is known of the third: as of other parts, but less surely.
        let Spread { mean, sd } = seen.expected(2);
        assert_eq!(mean, 0.94);
        assert!((sd - 0.03_f64.hypot(OTHER_PARTS)).abs() < 1e-15);
    }

    #[test]
    fn a_part_matches_as_the_bank_saw_it_and_no_better_than_the_users_own_sensor_does() {
        let spread = |mean| Spread { mean, sd: 0.01 };
        let part = |mean| Some(PartMatch { matched: spread(mean) });
        let known = Matches { holes: vec![part(0.98), part(0.8)], pegs: vec![None; 2] };
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0]], &[0.3; 2]).with_matches(known).unwrap();
        let mean = |bank_views: Views, sensor_views, part| {
            let bank = bank.clone().with_views(bank_views);
            let config = TouchModel { matched_mean: 0.92, sensor_views, ..round() };
            TouchLikelihood::new(&touch([1.0, 0.0], 0.3), &bank, &config).unwrap().expected(part).mean
        };
        use Views::{Both, Pegs};
        for (of_bank, of_sensor, [first, second]) in [
            (Pegs, None, [0.98, 0.8]),
            (Pegs, Some(Pegs), [0.92, 0.8]),
            (Both, Some(Both), [0.92, 0.8]),
            (Both, Some(Pegs), [0.98, 0.8]),
        ] {
            assert!((mean(of_bank, of_sensor, 0) - first).abs() < 1e-12, "{of_bank:?} {of_sensor:?}");
            assert!((mean(of_bank, of_sensor, 1) - second).abs() < 1e-12, "{of_bank:?} {of_sensor:?}");
        }
    }

    #[test]
    fn the_papers_likelihood_is_the_cosine_over_the_temperature_against_the_mean_of_all_views() {
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], &[0.0, 0.1, 0.2]);
        let config = TouchModel { temperature: Some(0.1), ..TouchModel::paper() };
        let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.0), &bank, &config).unwrap();
        let mean = (10.0_f64.exp() + 1.0 + (-10.0_f64).exp()) / 3.0;
        assert_close(&log_rows(&seen), &[10.0, 0.0, -10.0].map(|log| log - mean.ln()), 1e-9);
    }

    #[test]
    fn one_bad_match_costs_at_most_the_share_of_outliers() {
        let bank = bank(&ROWS, &[0.2; 4]);
        for steepness in [10.0, 1e3, 1e6] {
            let model = TouchModel { steepness, ..round() };
            let seen = TouchLikelihood::new(&touch([1.0, 0.0], FOUR_TIMES), &bank, &model).unwrap();
            let outlier = 0.01_f64.ln() - seen.unknown;
            assert!(log_rows(&seen).iter().all(|log| *log >= outlier - 1e-12), "{:?}", log_rows(&seen));
            // Two views apart it is no match at all.
            assert!((log_rows(&seen)[3] - outlier).abs() < 1e-9);
        }
    }

    #[test]
    fn any_numbers_give_finite_ones() {
        let bank = bank(&[[1.0, 0.0], [-1.0, 0.0]], &[0.2, 0.2]);
        let default = TouchModel::default();
        for number in [f64::MIN_POSITIVE, 1e-4, 1.0, 1e4, f64::MAX] {
            for model in [
                TouchModel { temperature: Some(number), ..default },
                TouchModel { steepness: number, ..default },
                TouchModel { own_distance: number.min(2.0), ..default },
                TouchModel { match_offset: -number, ..default },
                TouchModel { match_offset: number, ..default },
            ] {
                for outlier_share in [0.0, 0.01] {
                    let config = TouchModel { outlier_share, ..model };
                    config.validate().unwrap();
                    let seen = TouchLikelihood::new(&touch([1.0, 0.0], 0.2), &bank, &config).unwrap();
                    assert!(log_rows(&seen).iter().all(|log| log.is_finite()), "{config:?}");
                    // An outlier is as likely at either, where an offset or a distance leaves nothing else.
                    assert!(log_rows(&seen)[0] >= log_rows(&seen)[1], "{config:?}");
                }
            }
        }
    }

    #[test]
    fn a_query_of_zeros_says_nothing() {
        let bank = bank(&[[1.0, 0.0], [0.0, 1.0]], &[0.2, 0.2]);
        let seen = TouchLikelihood::new(&touch([0.0, 0.0], 0.2), &bank, &TouchModel::default()).unwrap();
        assert_eq!(log_rows(&seen)[0], log_rows(&seen)[1]);
    }

    #[test]
    fn a_long_query_counts_by_its_direction() {
        let bank = bank(&[[1.0, 0.0], [0.6, 0.8]], &[0.2, 0.2]);
        let seen = |query| TouchLikelihood::new(&touch(query, 0.2), &bank, &TouchModel::default()).unwrap();
        for (long, unit) in log_rows(&seen([300.0, 0.0])).iter().zip(log_rows(&seen([1.0, 0.0]))) {
            assert!((long - unit).abs() < 1e-5);
        }
    }

    #[test]
    fn a_similarity_that_overflows_is_the_worst_and_all_of_them_are_an_error() {
        let bank = bank(&[[1.0, 0.0], [0.0, 0.5]], &[0.2, 0.2]);
        let config = TouchModel::default();
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
        let measured = Measured { error_scale: 0.64 };
        let metric = Metric::new(2, vec![1.0, 0.0, 0.75, 3.0], measured).unwrap();
        let rows = [[1.0, 0.0], [0.6, 0.8], [-0.28, 0.96]];
        let by_hand = |[x, y]: [f32; 2]| {
            let turned = [x, 0.75 * x + 3.0 * y];
            turned.map(|value| value / turned[0].hypot(turned[1]))
        };
        let shares = [0.2, 0.2, 0.0];
        let learnt = bank(&rows, &shares).with_metric(metric).unwrap();
        let config = TouchModel::default();
        // Half of 0.64 on a logarithmic scale is 0.8.
        let scaled = |cosine: f64| 1.0 - 0.8 * (1.0 - cosine);
        let same =
            TouchModel { matched_mean: scaled(config.matched_mean), matched_sd: 0.8 * config.matched_sd, ..config };
        let seen = TouchLikelihood::new(&touch([0.8, 0.6], 0.2), &learnt, &config.in_metric_of(&learnt)).unwrap();
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
        let error = TouchLikelihood::new(&short, &bank, &TouchModel::default()).unwrap_err();
        assert_eq!(error.to_string(), "touch: expected a query of 2 values, as the bank's rows, got 1 values");
        assert!(TouchLikelihood::new(&touch([1.0, 0.0], f32::NAN), &bank, &TouchModel::default()).is_err());
        for rarity in [f32::NAN, f32::INFINITY] {
            let odd = Observation { rarity, ..touch([1.0, 0.0], 0.2) };
            let error = TouchLikelihood::new(&odd, &bank, &TouchModel::default()).unwrap_err();
            assert_eq!(error.to_string(), format!("touch: expected a finite rarity, got {rarity}"));
        }
        let cold = TouchModel { temperature: Some(0.0), ..TouchModel::default() };
        assert!(cold.validate().unwrap_err().to_string().starts_with("touch_model.temperature: expected a positive"));
    }
}
