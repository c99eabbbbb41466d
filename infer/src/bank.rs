//! The bank: one embedding for each recorded pose of each peg.
//!
//! In: rows of recorded or simulated touches at their poses. Out: [`Bank`], its cosines with a touch, and what it knows of its
//! parts: views, metric, symmetry, how well touches match. It must not know beliefs.

pub mod between;
mod file;
pub mod learn_from;
pub mod matches;
pub mod metric;
#[cfg(feature = "datasets")]
mod nearest_touches;
pub mod neighbours;
mod part_maps;
#[cfg(feature = "datasets")]
pub mod recorded;
#[cfg(feature = "datasets")]
mod resampling;
pub mod rows;
pub mod similarity;
#[cfg(feature = "sim")]
pub mod simulated;
mod symmetry;
pub mod views;

use std::borrow::Cow;
use std::collections::HashSet;
use std::sync::Arc;

use tactile_data::dataset::origin::Origin;
use tactile_data::dataset::touch::Side;
use tactile_data::light::lamps::Lamps;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::pose::symmetry::Symmetry;
use tactile_data::text::printable::is_printable;

use crate::bank::matches::Matches;
use crate::bank::metric::Metric;
use crate::bank::neighbours::{Neighbours, neighbours};
use crate::bank::rows::Rows;
use crate::bank::views::Views;
use crate::calibration::BLANK_SHARE;
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};
use part_maps::PartMaps;

/// The version of the bank's layout.
pub const SCHEMA: &str = "tactile-filter/bank/2";

/// How far a recorded pose may lie from its grid cell, mm and degrees: the robot's own repeatability.
pub(crate) const POSE_TOLERANCE: (f64, f64) = (0.5, 2.0);

/// Peg embeddings on a grid of poses: rows part-major, then grid cell, each of unit length.
///
/// What an episode needs to know of them (symmetries, likeness of neighbouring views) is found when a bank is built or
/// loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct Bank {
    parts: Vec<String>,
    grid: PoseGrid,
    /// The poses among them at which a part may be touched first.
    start: PoseGrid,
    /// As the metric has them.
    rows: Rows,
    metric: Option<Arc<Metric>>,
    edge_shares: Vec<f32>,
    /// Rows that were not recorded, in order; what they hold is interpolated from those around them.
    missing: Vec<usize>,
    model_sha256: Arc<str>,
    views: Views,
    origin: Option<Origin>,
    symmetries: Vec<Symmetry>,
    matches: Arc<Matches>,
    maps: Option<Arc<PartMaps>>,
    neighbours: Arc<[Neighbours]>,
}

impl Bank {
    /// A bank from its rows, `[parts * grid.len(), dim]` in f32, and the share of each view that shows an edge.
    ///
    /// # Errors
    /// Numbers of rows or shares that do not fit parts and grid, rows that are not finite, shares outside 0..=1, and
    /// parts without a name of their own.
    pub fn from_rows(
        parts: Vec<String>,
        grid: PoseGrid,
        rows: Rows,
        edge_shares: Vec<f32>,
        model_sha256: impl Into<Arc<str>>,
    ) -> Result<Self> {
        Ok(Self::of_rows(parts, grid, rows, edge_shares, model_sha256.into())?.with_found_symmetries())
    }

    /// Like [`Self::from_rows`], where something else than the views tells the symmetries: none is claimed yet.
    pub(crate) fn of_rows(
        parts: Vec<String>,
        grid: PoseGrid,
        rows: Rows,
        edge_shares: Vec<f32>,
        model_sha256: Arc<str>,
    ) -> Result<Self> {
        check_names(&parts)?;
        let bank = Self::checked(parts, grid, rows, edge_shares, model_sha256)?;
        let symmetries = vec![Symmetry::NONE; bank.parts.len()];
        let neighbours = neighbours(&bank.grid, &bank.rows).into();
        Ok(Self { symmetries, neighbours, ..bank })
    }

    /// The same bank, with symmetries that are known to be valid, one for each part.
    pub(crate) fn of_symmetries(self, symmetries: Vec<Symmetry>) -> Self {
        Self { symmetries, ..self }
    }

    /// A bank that does not know its symmetries and neighbours yet.
    fn checked(
        parts: Vec<String>,
        grid: PoseGrid,
        rows: Rows,
        edge_shares: Vec<f32>,
        model_sha256: Arc<str>,
    ) -> Result<Self> {
        grid.validate()?;
        let n_rows = parts.len() * grid.len();
        if n_rows == 0 || rows.len() != n_rows || edge_shares.len() != n_rows {
            return Err(Error::invalid(
                "bank",
                format!("{} parts x {} poses", parts.len(), grid.len()),
                format!("{} rows and {} edge shares", rows.len(), edge_shares.len()),
            ));
        }
        if let Some(row) = edge_shares.iter().position(|share| !(0.0..=1.0).contains(share)) {
            let got = edge_shares[row].to_string();
            return Err(Error::invalid(format!("bank row {row}"), "an edge share in 0..=1", got));
        }
        let (origin, missing, symmetries, neighbours) = (None, Vec::new(), Vec::new(), Arc::default());
        let (matches, views) = (Arc::default(), Views::Pegs);
        Ok(Self {
            parts,
            start: grid,
            grid,
            rows,
            metric: None,
            edge_shares,
            missing,
            model_sha256,
            views,
            origin,
            symmetries,
            matches,
            maps: None,
            neighbours,
        })
    }

    /// The same bank with some rows that were not recorded: the filter takes what is seen there as unknown. The values
    /// of these rows serve only the interpolation between the views around them.
    ///
    /// # Errors
    /// A row that the bank does not hold, or a part none of whose rows was recorded.
    pub fn with_missing(self, missing: Vec<usize>) -> Result<Self> {
        if missing.is_empty() {
            return Ok(Self { missing, ..self });
        }
        Ok(self.lacking(missing)?.with_found_symmetries())
    }

    /// The same bank, with its symmetries as they are.
    pub(crate) fn lacking(self, mut missing: Vec<usize>) -> Result<Self> {
        missing.sort_unstable();
        missing.dedup();
        if let Some(odd) = missing.iter().find(|row| **row >= self.n_rows()) {
            return Err(Error::invalid("bank", format!("one of {} rows", self.n_rows()), format!("row {odd}")));
        }
        let n_cells = self.grid.len();
        let n_missing = |part: usize| missing.iter().filter(|row| **row / n_cells == part).count();
        if let Some(part) = (0..self.parts.len()).find(|part| n_missing(*part) == n_cells) {
            return Err(Error::invalid("bank", format!("a recorded view of part {}", self.parts[part]), "none"));
        }
        Ok(Self { missing, ..self })
    }

    /// The same bank, some of whose poses are not where a part is touched first: what is there is seen by later touches alone.
    ///
    /// # Errors
    /// Poses that are not a part of the bank's.
    pub fn with_start(self, start: PoseGrid) -> Result<Self> {
        let has_its_steps =
            (start.xy_step_mm, start.theta_step_deg) == (self.grid.xy_step_mm, self.grid.theta_step_deg);
        let is_within = start.xy_half_mm <= self.grid.xy_half_mm && start.theta_half_deg <= self.grid.theta_half_deg;
        start.validate()?;
        if !has_its_steps || !is_within {
            return Err(Error::invalid("start", format!("poses among {:?}", self.grid), format!("{start:?}")));
        }
        Ok(Self { start, ..self })
    }

    /// The same bank, with what its touches were made of.
    #[must_use]
    pub fn with_origin(self, origin: Origin) -> Self {
        Self { origin: Some(origin), ..self }
    }

    /// The same bank, whose rows are of such views.
    #[must_use]
    pub fn with_views(self, views: Views) -> Self {
        Self { views, ..self }
    }

    /// The same bank, with the symmetries of its parts as they are known, `[n_parts]`: from their geometry, say.
    ///
    /// # Errors
    /// Another number of them, or one that no part has.
    pub fn with_symmetries(self, symmetries: Vec<Symmetry>) -> Result<Self> {
        if symmetries.len() != self.parts.len() || !symmetries.iter().all(Symmetry::is_valid) {
            let got = format!("{symmetries:?}");
            return Err(Error::invalid("symmetries", format!("one for each of {} parts", self.parts.len()), got));
        }
        Ok(self.of_symmetries(symmetries))
    }

    /// The same bank, with how well the touches of each part match its views.
    ///
    /// # Errors
    /// Another number of parts, or numbers that no touches give.
    pub fn with_matches(self, matches: Matches) -> Result<Self> {
        matches.validate(self.parts.len())?;
        Ok(Self { matches: Arc::new(matches), ..self })
    }

    /// The same bank, whose embeddings are compared in a metric of its own instead of by the cosine alone.
    ///
    /// # Errors
    /// A bank that has one, and a metric of embeddings of another length.
    pub fn with_metric(self, metric: Metric) -> Result<Self> {
        if self.metric.is_some() || metric.dim() != self.dim() {
            let expected = format!("rows without a metric, of {} values", metric.dim());
            return Err(Error::invalid("bank", expected, format!("rows of {} values", self.dim())));
        }
        let rows = metric.rows(&self.rows)?.to_precision(self.rows.precision())?;
        Ok(Self { metric: Some(Arc::new(metric)), ..self.with_rows(rows) })
    }

    /// The same bank, each row in the place of the one that it was made from.
    fn with_rows(self, rows: Rows) -> Self {
        let neighbours = neighbours(&self.grid, &rows).into();
        Self { rows, neighbours, ..self }
    }

    /// The same bank with its rows kept in another format: less memory, and cosines a little off
    /// (NOTES.md gives what each costs).
    ///
    /// # Errors
    /// A value beyond the format's range.
    pub fn with_precision(self, precision: Precision) -> Result<Self> {
        if precision == self.rows.precision() {
            return Ok(self);
        }
        let rows = self.rows.to_precision(precision)?;
        Ok(self.with_rows(rows))
    }

    /// The bank of some of its parts, given by their indices, in this order. What was found of them is kept, and the rows are
    /// shared: no copy is made of them, and they stay in memory for as long as one of the banks does.
    ///
    /// # Errors
    /// No part at all, or one that the bank does not hold.
    pub fn with_parts(&self, parts: &[usize]) -> Result<Self> {
        let n_parts = self.parts.len();
        if let Some(odd) = parts.iter().find(|part| **part >= n_parts) {
            return Err(Error::invalid("bank", format!("one of {n_parts} parts"), format!("part {odd}")));
        }
        let n_cells = self.grid.len();
        let range = |part: &usize| part * n_cells..(part + 1) * n_cells;
        let rows = self.rows.ranges(&parts.iter().map(range).collect::<Vec<_>>());
        let edge_shares = parts.iter().flat_map(|part| self.edge_shares[range(part)].iter().copied()).collect();
        let names = parts.iter().map(|part| self.parts[*part].clone()).collect();
        let some = Self::checked(names, self.grid, rows, edge_shares, self.model_sha256.clone())?;
        let origin = self.origin.clone().map(|origin| {
            let of_parts = parts.iter().filter_map(|part| origin.parts.get(*part).cloned()).collect();
            Origin { parts: of_parts, ..origin }
        });
        let symmetries = parts.iter().map(|part| self.symmetries[*part]).collect();
        let neighbours = parts.iter().map(|part| self.neighbours[*part].clone()).collect();
        let mut missing = Vec::new();
        for (new, part) in parts.iter().enumerate() {
            let of_part = self.missing.iter().filter(|row| range(part).contains(*row));
            missing.extend(of_part.map(|row| row - part * n_cells + new * n_cells));
        }
        let matches = Arc::new(self.matches.of_parts(parts));
        let metric = self.metric.clone();
        let maps = self.maps.as_ref().map(|maps| Arc::new(maps.of_parts(parts)));
        let (views, start) = (self.views, self.start);
        Ok(Self { views, start, metric, origin, missing, symmetries, matches, maps, neighbours, ..some })
    }

    /// The bank without one part, by its index. A metric stays as that part, too, taught it: a
    /// `simulated::learner::Learner` learns without it.
    ///
    /// # Errors
    /// A part that the bank does not hold, or the only one that it holds.
    pub fn without(&self, part: usize) -> Result<Self> {
        if part >= self.parts.len() {
            let got = format!("part {part}");
            return Err(Error::invalid("bank", format!("one of {} parts", self.parts.len()), got));
        }
        self.with_parts(&(0..self.parts.len()).filter(|other| *other != part).collect::<Vec<_>>())
    }

    /// How embeddings are compared; `None`: by their cosine alone.
    pub fn metric(&self) -> Option<&Metric> {
        self.metric.as_deref()
    }

    /// What its views are of.
    pub fn views(&self) -> Views {
        self.views
    }

    /// Names of the parts, in row order.
    pub fn parts(&self) -> &[String] {
        &self.parts
    }

    /// The poses at which each part was recorded.
    pub fn grid(&self) -> &PoseGrid {
        &self.grid
    }

    /// The poses among them at which a part may be touched first; later touches may be at any of [`Self::grid`].
    pub fn start(&self) -> &PoseGrid {
        &self.start
    }

    /// Length of a row.
    pub fn dim(&self) -> usize {
        self.rows.dim()
    }

    /// Number of rows: parts times poses.
    pub fn n_rows(&self) -> usize {
        self.edge_shares.len()
    }

    /// The rows that were not recorded, in order: their views are unknown.
    pub fn missing(&self) -> &[usize] {
        &self.missing
    }

    /// Whether a row was recorded; `row` is below [`Self::n_rows`].
    pub fn is_recorded(&self, row: usize) -> bool {
        self.missing.binary_search(&row).is_err()
    }

    /// All rows, `[n_rows, dim]`, as the bank's metric has them, in the format they are kept in.
    pub fn rows(&self) -> &Rows {
        &self.rows
    }

    /// One row, `[dim]`, as the bank's metric has it, in f32.
    ///
    /// # Panics
    /// Where `row` is not below [`Self::n_rows`].
    pub fn row(&self, row: usize) -> Cow<'_, [f32]> {
        self.rows.row(row)
    }

    /// The plain cosine of an embedding, `[dim]`, with one row, as if the bank had no metric, -1..=1; 0 where either has no
    /// direction.
    ///
    /// # Panics
    /// Where `row` is not below [`Self::n_rows`].
    pub fn plain_cosine(&self, embedding: &[f32], row: usize) -> f32 {
        let own = self.row(row);
        let own = self.metric.as_ref().map_or(own.clone(), |metric| Cow::Owned(metric.undo(&own)));
        // In f64: the squares of long and short embeddings leave the range of f32.
        let inner = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let cosine = inner(embedding, &own) / (inner(embedding, embedding).sqrt() * inner(&own, &own).sqrt());
        if cosine.is_finite() { cosine.clamp(-1.0, 1.0) as f32 } else { 0.0 }
    }

    /// The row recorded of a part at a pose, to within the robot's repeatability; `None` where there is none.
    pub fn row_at(&self, part: &str, part_from_sensor: &Se2) -> Option<usize> {
        let part = self.parts.iter().position(|name| name == part)?;
        let cell = self.grid.exact(part_from_sensor, POSE_TOLERANCE.0, POSE_TOLERANCE.1)?;
        Some(part * self.grid.len() + cell).filter(|row| self.is_recorded(*row))
    }

    /// f_HP (paper, Eq. 2): the cosine of one query with each row, in the bank's metric. `query`: `[dim]`, of unit length;
    /// `out` is cleared and filled with `[n_rows]` values in -1..=1.
    pub fn similarities(&self, query: &[f32], out: &mut Vec<f32>) {
        self.rows.similarities(&self.in_rows_metric(query), out);
    }

    /// A query as the rows are.
    pub(crate) fn in_rows_metric<'q>(&self, query: &'q [f32]) -> Cow<'q, [f32]> {
        self.metric.as_ref().map_or(Cow::Borrowed(query), |metric| Cow::Owned(metric.apply(query)))
    }

    /// f_PP (paper, Eq. 6): the cosine of two rows, -1..=1, in the bank's metric. One network serves both functions: the
    /// contrastive loss spreads keys apart wherever the peg views differ.
    ///
    /// # Panics
    /// Where a row is not below [`Self::n_rows`].
    pub fn peg_similarity(&self, row_a: usize, row_b: usize) -> f32 {
        self.rows.cosine(row_a, row_b)
    }

    /// For each row, the share of the view that shows an edge, 0..=1; zero for a blank view.
    pub fn edge_shares(&self) -> &[f32] {
        &self.edge_shares
    }

    /// The rows whose views were recorded and show an edge, in order.
    pub fn edged_rows(&self) -> Vec<usize> {
        let is_edged = |row: &usize| self.edge_shares[*row] >= BLANK_SHARE && self.is_recorded(*row);
        (0..self.n_rows()).filter(is_edged).collect()
    }

    /// The turns under which a part stays the same.
    ///
    /// # Panics
    /// Where `part` is not below the number of parts.
    pub fn symmetry(&self, part: usize) -> Symmetry {
        self.symmetries[part]
    }

    /// How well the touches of each part match its views; empty where nothing is known of it.
    pub fn matches(&self) -> &Arc<Matches> {
        &self.matches
    }

    /// How alike each part's neighbouring views are, `[n_parts]`.
    pub fn neighbours(&self) -> &Arc<[Neighbours]> {
        &self.neighbours
    }

    /// Why touches of a side do not suit this bank or its maps, and what to do, for people; `None` where they do, as far as is known.
    pub fn other_side(&self, touched: Side) -> Option<&'static str> {
        let learning = self.metric().and_then(Metric::learning);
        let is_learnt_from_others = learning.is_some_and(|learning| !learning.from.sides().contains(&touched));
        match touched {
            Side::Hole if is_learnt_from_others => Some(
                "holes are touched, and the bank learnt to compare touches of pegs: make one with --learn-from hole",
            ),
            Side::Peg if !self.views.is_pegs() || is_learnt_from_others => {
                Some("pegs are touched, and the bank is made for holes: make one with --views pegs --learn-from peg")
            }
            _ if self.verifier().is_none() || self.presence(touched).is_some() => None,
            Side::Hole => {
                Some("holes are touched, for which these maps have no fit: cosines alone say how sure a name is")
            }
            Side::Peg => {
                Some("pegs are touched, for which these maps have no fit: cosines alone say how sure a name is")
            }
        }
    }

    /// Why touches under `lamps` do not suit this bank, for people; `None` where they do, as far as is known.
    pub fn other_light(&self, lamps: Option<&Lamps>) -> Option<&'static str> {
        let of_bank = &self.origin()?.sensor;
        match (of_bank.is_relit, lamps) {
            (true, None) => Some(
                "the bank's views were brought under a GelSight Mini's lamps, and nothing says how these touches are lit: \
                 import them with --calibration, unless the sensor is a Mini",
            ),
            (false, Some(_)) if of_bank.light.is_none() => Some(
                "these touches are brought under a GelSight Mini's lamps, and nothing says how the bank's views were lit: \
                 import those with --calibration, too",
            ),
            _ => None,
        }
    }

    /// What its touches were made of, where that is known.
    pub fn origin(&self) -> Option<&Origin> {
        self.origin.as_ref()
    }

    /// Checksum of the model that made the rows.
    pub fn model_sha256(&self) -> &Arc<str> {
        &self.model_sha256
    }
}

/// Refuses names that two parts have, empty names, and names that a terminal would obey instead of show.
fn check_names(parts: &[String]) -> Result<()> {
    let mut known = HashSet::with_capacity(parts.len());
    for name in parts {
        if name.trim().is_empty() || !is_printable(name) {
            let expected = "a name for each part, without control characters";
            return Err(Error::invalid("parts", expected, format!("{name:?}")));
        }
        if !known.insert(name) {
            return Err(Error::invalid("parts", "each part's name once", format!("'{name}' twice")));
        }
    }
    Ok(())
}

#[cfg(all(test, feature = "burn"))]
mod tests {
    use super::*;
    use crate::bank::matches::PartMatch;
    use crate::bank::metric::Measured;
    use crate::bank::similarity::normalize_rows;
    use crate::calibration::Spread;
    use crate::embedding::architecture::NetworkConfig;
    use crate::embedding::checkpoint::{Checkpoint, Provenance};
    use crate::embedding::device::DeviceKind;
    use crate::embedding::model::Model;
    use crate::safefile::SafeFile;
    use tactile_data::dataset::touch::Side;
    use tactile_data::frame::Preprocessing;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    fn bank(edge_shares: Vec<f32>, model_sha256: &str) -> Result<Bank> {
        let mut rows: Vec<f32> = (0..54).map(|i| (i as f32 * 0.7).sin()).collect();
        normalize_rows(&mut rows, 6);
        Bank::from_rows(["A", "B", "C"].map(String::from).into(), GRID, Rows::new(6, rows)?, edge_shares, model_sha256)
    }

    #[test]
    fn a_share_that_is_none_is_refused_with_its_row() {
        for odd in [-0.1, 1.1, f32::NAN, f32::INFINITY] {
            let shares = (0..9).map(|row| if row == 7 { odd } else { 0.5 }).collect();
            let error = bank(shares, "").unwrap_err().to_string();
            assert_eq!(error, format!("bank row 7: expected an edge share in 0..=1, got {odd}"));
        }
        assert!(bank([0.0, 1.0].into_iter().cycle().take(9).collect(), "").is_ok());
    }

    const FORMATS: [Precision; 4] = [Precision::F32, Precision::F16, Precision::Bf16, Precision::I8];

    fn model() -> Model {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        Model::new(checkpoint, "mine".into(), DeviceKind::Flex).unwrap()
    }

    #[test]
    fn a_bank_comes_back_in_the_format_it_was_kept_in() {
        let model = model();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bank");
        for precision in FORMATS {
            let kept = bank(vec![0.2; 9], "mine").unwrap().with_views(Views::Both).with_precision(precision).unwrap();
            assert_eq!((kept.rows().precision(), kept.views()), (precision, Views::Both));
            let matched = Some(PartMatch { matched: Spread { mean: 0.9, sd: 0.1 } });
            let matches = Matches { holes: vec![matched, None, matched], pegs: vec![None; 3] };
            let kept = kept.with_matches(matches).unwrap();
            let kept = kept.with_declared("B", None).unwrap().with_declared("C", Some(5)).unwrap();
            assert_eq!([0, 1, 2].map(|part| kept.symmetry(part).order), [Some(1), None, Some(5)]);
            kept.save(&path).unwrap();
            assert_eq!(Bank::load(&path, &model).unwrap(), kept);
            let without = kept.without(1).unwrap();
            assert_eq!((without.parts().join(""), without.row(3)), ("AC".into(), kept.row(6)));
        }
        let other = bank(vec![0.2; 9], "another").unwrap();
        other.save(&path).unwrap();
        assert!(Bank::load(&path, &model).unwrap_err().to_string().contains("made by another"));
    }

    #[test]
    fn a_bank_with_a_metric_compares_in_it_and_comes_back() {
        let measured = Measured { error_scale: 0.7 };
        // Twice the second value, and the third with a share of the first.
        let mut matrix = vec![0.0; 36];
        (0..6).for_each(|i| matrix[7 * i] = if i == 1 { 2.0 } else { 1.0 });
        matrix[12] = -0.5;
        let by_hand = |v: &[f32]| {
            let turned = [v[0], 2.0 * v[1], v[2] - 0.5 * v[0], v[3], v[4], v[5]].map(f64::from);
            let norm = turned.iter().map(|v| v * v).sum::<f64>().sqrt();
            turned.map(|v| v / norm)
        };
        let plain = bank(vec![0.2; 9], "mine").unwrap();
        let query = [0.1, -0.4, 0.3, 0.8, 0.2, 0.24];
        let model = model();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bank");
        for precision in [Precision::F32, Precision::I8] {
            let metric = Metric::new(6, matrix.clone(), measured).unwrap();
            let kept = plain.clone().with_metric(metric.clone()).unwrap().with_precision(precision).unwrap();
            let mut cosines = Vec::new();
            kept.similarities(&query, &mut cosines);
            for (row, cosine) in cosines.iter().enumerate() {
                let length = f64::from(crate::bank::similarity::dot(&plain.row(row), &plain.row(row))).sqrt();
                let touched = f64::from(crate::bank::similarity::dot(&query, &query)).sqrt();
                let expected: f64 = by_hand(&query).iter().zip(by_hand(&plain.row(row))).map(|(a, b)| a * b).sum();
                let tolerance = if precision == Precision::F32 { 1e-6 } else { 4e-3 };
                assert!((f64::from(*cosine) - expected * length * touched).abs() < tolerance, "{cosine} {expected}");
            }
            kept.save(&path).unwrap();
            assert_eq!(Bank::load(&path, &model).unwrap(), kept);
            assert_ne!(kept.sha256().unwrap(), plain.sha256().unwrap());
            assert_eq!(kept.with_parts(&[2, 0]).unwrap().metric(), Some(&metric));
            assert!(kept.with_metric(metric).unwrap_err().to_string().contains("rows without a metric"));
        }
    }

    #[test]
    fn where_parts_are_touched_first_is_kept() {
        let start = PoseGrid { theta_half_deg: 0.0, ..GRID };
        let whole = bank(vec![0.2; 9], "mine").unwrap();
        assert_eq!(whole.start(), &GRID);
        let kept = whole.clone().with_start(start).unwrap();
        assert_eq!((kept.start(), kept.grid()), (&start, &GRID));
        assert_ne!(kept.sha256().unwrap(), whole.sha256().unwrap());
        assert_eq!(kept.with_parts(&[2, 0]).unwrap().start(), &start);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bank");
        kept.save(&path).unwrap();
        assert_eq!(Bank::load(&path, &model()).unwrap(), kept);
        for odd in [
            PoseGrid { theta_half_deg: 60.0, ..GRID },
            PoseGrid { xy_half_mm: 4.0, ..GRID },
            PoseGrid { theta_step_deg: 15.0, ..GRID },
            PoseGrid { theta_half_deg: f64::NAN, ..GRID },
        ] {
            assert!(whole.clone().with_start(odd).is_err(), "{odd:?}");
        }
    }

    #[test]
    fn a_file_written_in_pieces_is_the_one_that_is_written_at_once() {
        let folder = tempfile::tempdir().unwrap();
        let [path, other] = ["pieces", "whole"].map(|name| folder.path().join(name));
        for precision in FORMATS {
            let kept = bank(vec![0.2; 9], "mine").unwrap().with_precision(precision).unwrap();
            for kept in [kept.without(1).unwrap(), kept] {
                kept.save(&path).unwrap();
                let (mut file, found) = SafeFile::load_as(&path, SCHEMA).unwrap();
                file.save_as(&other, SCHEMA, found).unwrap();
                assert_eq!((found, std::fs::read(&path).unwrap()), (precision, std::fs::read(&other).unwrap()));
                file.text.retain(|(name, _)| name != "symmetries" && name != "part_sha256");
                assert_eq!(kept.sha256().unwrap(), file.sha256());
            }
        }
    }

    #[test]
    fn a_spoilt_part_is_named() {
        let (model, folder) = (model(), tempfile::tempdir().unwrap());
        let path = folder.path().join("bank");
        for (precision, size) in FORMATS.into_iter().zip([4, 2, 2, 1]) {
            let kept = bank(vec![0.2; 9], "mine").unwrap().with_precision(precision).unwrap();
            kept.save(&path).unwrap();
            let good = std::fs::read(&path).unwrap();
            // The rows come last, three of each part.
            let spoilt = |rows: &[usize]| {
                let mut bytes = good.clone();
                rows.iter().for_each(|row| bytes[good.len() - (9 - row) * 6 * size] ^= 1);
                std::fs::write(&path, bytes).unwrap();
                Bank::load(&path, &model).unwrap_err().to_string()
            };
            let [one, two, all] = [&[4][..], &[1, 8], &[0, 5, 8]].map(spoilt);
            assert!(one.contains("bank: part B: expected checksum") && one.contains("make the bank again"), "{one}");
            assert!(two.contains("bank: part A: ") && two.contains("views of 2 parts"), "{two}");
            // All parts at once: what they are compared with may be what is spoilt.
            assert!(!all.contains("part A") && all.contains("checksum"), "{all}");
            // A file of before has no checksums of parts.
            std::fs::write(&path, &good).unwrap();
            let (mut file, _) = SafeFile::load_as(&path, SCHEMA).unwrap();
            file.text.retain(|(name, _)| name != "part_sha256");
            file.save_as(&path, SCHEMA, precision).unwrap();
            assert_eq!(Bank::load(&path, &model).unwrap(), kept);
        }
    }

    #[test]
    fn the_bank_of_some_parts_is_the_one_made_of_their_rows() {
        let whole = bank(vec![0.2; 9], "mine").unwrap();
        let spread = |mean| Spread { mean, sd: 0.1 };
        let of_part = |mean| Some(PartMatch { matched: spread(mean) });
        let matches = Matches { holes: vec![of_part(0.1), None, of_part(0.3)], pegs: vec![None; 3] };
        let known = whole.clone().with_matches(matches.clone()).unwrap();
        assert_ne!(known.sha256().unwrap(), whole.sha256().unwrap());
        let some = known.with_parts(&[2, 0]).unwrap();
        let of_hole = |part: usize| some.matches().of(part, Side::Hole);
        assert_eq!([of_hole(0), of_hole(1), of_hole(2)], [of_part(0.3), of_part(0.1), None]);
        assert!(some.with_matches(matches).unwrap_err().to_string().contains("each of 2 parts"));
        let afresh = |names: &[&str], from: usize| {
            let rows = (from..from + names.len() * 3).flat_map(|row| whole.row(row).into_owned()).collect();
            let names: Vec<String> = names.iter().map(|name| (*name).into()).collect();
            let shares = vec![0.2; 3 * names.len()];
            Bank::from_rows(names, GRID, Rows::new(6, rows).unwrap(), shares, "mine").unwrap()
        };
        let two = whole.without(0).unwrap();
        let one = two.without(1).unwrap();
        let turned = whole.with_parts(&[2, 0]).unwrap();
        assert_eq!((two, one), (afresh(&["B", "C"], 3), afresh(&["B"], 3)));
        assert_eq!((turned.parts().concat(), turned.row(0)), ("CA".into(), whole.row(6)));
        assert!(whole.with_parts(&[3]).is_err() && whole.with_parts(&[]).is_err());
    }
}
