//! Nearest neighbour after one touch: the paper's baselines, Pixel and MoCo (Sec. V-B).

use rayon::prelude::*;
use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::{Side, instead_of};
use tactile_data::frame::{Background, Preprocessing, TactileImage};
use tactile_data::pose::se2::wrap_angle;

use crate::bank::Bank;
use crate::bank::recorded::{frames_by_row, tactile_images};
use crate::embedding::model::Model;
use crate::error::{Error, Result};

/// What one touch alone tells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MatchReport {
    /// Holes matched.
    pub n_holes: usize,
    /// Share whose nearest peg is of the right class, 0..=1.
    pub accuracy: f64,
    /// Share whose nearest peg is of the right class at the right pose, 0..=1.
    pub exact_cell: f64,
    /// Mean distance of the poses where the class is right, mm.
    pub xy_mm_mean: f64,
    /// Mean angle between the poses where the class is right, degrees.
    pub theta_deg_mean: f64,
}

/// What the model's similarities are like, for choosing thresholds and models.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Similarities {
    /// Correlation, over all rows `j` and all holes with a pose on the grid, of f_PP(peg at the hole's
    /// pose, `j`) with f_HP(hole, `j`): how well the keys alone tell which pegs a hole is confused with.
    pub peg_similarity_correlation: f64,
    /// The best cosine that 99 in 100 holes with an edge in view reach.
    pub best_cosine_p01: f64,
}

/// What one touch tells by each way of comparing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Matches {
    /// By L1 distance of the difference images.
    pub pixel: MatchReport,
    /// By L1 distance to the peg's image with its sign turned: a hole is not the negative of its peg.
    pub pixel_flipped: MatchReport,
    /// By cosine of query and key.
    pub moco: MatchReport,
    /// What the model's cosines are like.
    pub similarities: Similarities,
}

/// The touches to be named.
#[derive(Clone, Copy)]
pub struct Touched<'a> {
    /// What was touched: holes, or pegs of another dataset than the bank's.
    pub dataset: &'a Dataset,
    /// Which of its touches are meant.
    pub side: Side,
    /// At most so many of them, evenly spread over the dataset.
    pub limit: usize,
}

/// Matches touches of known part and pose against the pegs that the bank was made of.
///
/// # Errors
/// No such touch, or frames that cannot be used.
pub fn match_single_touches(model: &Model, bank: &Bank, pegs: &Dataset, touched: Touched<'_>) -> Result<Matches> {
    let Touched { dataset: holes, side, limit } = touched;
    let known = |index: &usize| {
        let touch = holes.touch(*index);
        touch.side == Some(side) && touch.part.is_some() && touch.part_from_sensor.is_some()
    };
    let candidates: Vec<usize> = (0..holes.len()).filter(known).collect();
    if candidates.is_empty() || limit == 0 {
        let other = if side.is_hole() { "--side peg matches them" } else { "--side hole matches them" };
        let got = instead_of(side, holes.touches(), other);
        return Err(Error::invalid(&holes.meta().name, format!("{side} touches with part and pose"), got));
    }
    let n_holes = limit.min(candidates.len());
    let chosen: Vec<usize> = (0..n_holes).map(|i| candidates[i * candidates.len() / n_holes]).collect();
    let (nearest, similarities) = nearest_by_model(model, bank, touched, &chosen)?;

    let counts = Preprocessing::counts(model.config().input_px);
    let peg_images = images_by_row(&Background::new(pegs.no_contact(), &counts)?, pegs, bank)?;
    let hole_images = tactile_images(&Background::new(holes.no_contact(), &counts)?, holes, &chosen)?;
    let by_pixel = |sign: f32| {
        let nearest = hole_images.par_iter().map(|hole| nearest_by_pixel(hole, &peg_images, sign));
        report(bank, holes, &chosen, &nearest.collect::<Vec<_>>())
    };
    Ok(Matches {
        pixel: by_pixel(1.0),
        pixel_flipped: by_pixel(-1.0),
        moco: report(bank, holes, &chosen, &nearest),
        similarities,
    })
}

/// What recorded each row of a bank, where something did.
///
/// # Errors
/// Pegs whose part or pose is not known, or frames that cannot be used.
pub fn images_by_row(background: &Background, pegs: &Dataset, bank: &Bank) -> Result<Vec<Option<TactileImage>>> {
    let image = |frame: &Option<usize>| match frame {
        Some(frame) => Ok(Some(background.tactile_image(&pegs.frame(*frame))?)),
        None => Ok(None),
    };
    frames_by_row(pegs, bank)?.par_iter().map(image).collect()
}

/// The cosine of a query with each row of a bank that was recorded; NaN, which is no match, with the others.
pub fn recorded_cosines(bank: &Bank, query: &[f32]) -> Vec<f32> {
    let mut cosines = Vec::new();
    bank.similarities(query, &mut cosines);
    bank.missing().iter().for_each(|row| cosines[*row] = f32::NAN);
    cosines
}

/// A view with fewer edge pixels shows no edge to judge a similarity by.
const EDGED: f32 = 0.01;

fn nearest_by_model(
    model: &Model,
    bank: &Bank,
    Touched { dataset: holes, side, .. }: Touched<'_>,
    chosen: &[usize],
) -> Result<(Vec<usize>, Similarities)> {
    let images = tactile_images(&model.background_of(holes)?, holes, chosen)?;
    let queries = model.embed_side(&images, side)?;
    let mut correlation = Correlation::default();
    let (mut nearest, mut best_cosines) = (Vec::new(), Vec::new());
    for ((query, frame), image) in queries.chunks_exact(bank.dim()).zip(chosen).zip(&images) {
        let cosines = recorded_cosines(bank, query);
        let row = best(cosines.iter().copied());
        nearest.push(row);
        if image.edge_share >= EDGED {
            best_cosines.push(f64::from(cosines[row]));
        }
        if let Some(row) = true_row(bank, holes, *frame) {
            for (j, cosine) in cosines.iter().enumerate().filter(|(_, cosine)| !cosine.is_nan()) {
                correlation.add(f64::from(bank.peg_similarity(row, j)), f64::from(*cosine));
            }
        }
    }
    best_cosines.sort_by(f64::total_cmp);
    let best_cosine_p01 = best_cosines.get(best_cosines.len() / 100).copied().unwrap_or(0.0);
    Ok((nearest, Similarities { peg_similarity_correlation: correlation.value(), best_cosine_p01 }))
}

/// The peg image nearest to a hole image by L1 distance; `sign` -1 turns the pegs inside out first.
pub fn nearest_by_pixel(hole: &TactileImage, pegs: &[Option<TactileImage>], sign: f32) -> usize {
    let distance =
        |peg: &TactileImage| hole.planes.iter().zip(&peg.planes).map(|(h, p)| (h - sign * p).abs()).sum::<f32>();
    best(pegs.iter().map(|peg| peg.as_ref().map_or(f32::NAN, |peg| -distance(peg))))
}

/// The first index of the largest score; a NaN never wins.
pub fn best(scores: impl Iterator<Item = f32>) -> usize {
    let mut best = (0, f32::NEG_INFINITY);
    for (index, score) in scores.enumerate() {
        if score > best.1 {
            best = (index, score);
        }
    }
    best.0
}

fn true_row(bank: &Bank, holes: &Dataset, frame: usize) -> Option<usize> {
    let touch = holes.touch(frame);
    bank.row_at(touch.part.as_deref()?, &touch.part_from_sensor?)
}

fn report(bank: &Bank, holes: &Dataset, chosen: &[usize], nearest: &[usize]) -> MatchReport {
    let mut report = MatchReport { n_holes: chosen.len(), ..MatchReport::default() };
    let mut n_right = 0.0;
    for (frame, row) in chosen.iter().zip(nearest) {
        let touch = holes.touch(*frame);
        let Some(truth) = touch.part_from_sensor else { continue };
        if touch.part.as_ref() != Some(&bank.parts()[row / bank.grid().len()]) {
            continue;
        }
        let found = bank.grid().pose(row % bank.grid().len());
        n_right += 1.0;
        report.exact_cell += f64::from(true_row(bank, holes, *frame) == Some(*row));
        report.xy_mm_mean += found.distance_mm(&truth);
        report.theta_deg_mean += wrap_angle(found.theta_rad - truth.theta_rad).to_degrees().abs();
    }
    let n = chosen.len() as f64;
    report.accuracy = n_right / n;
    report.exact_cell /= n;
    if n_right > 0.0 {
        report.xy_mm_mean /= n_right;
        report.theta_deg_mean /= n_right;
    }
    report
}

/// Pearson's correlation, summed in f64.
#[derive(Default)]
struct Correlation {
    n: f64,
    x: f64,
    y: f64,
    xx: f64,
    yy: f64,
    xy: f64,
}

impl Correlation {
    fn add(&mut self, x: f64, y: f64) {
        self.n += 1.0;
        self.x += x;
        self.y += y;
        self.xx += x * x;
        self.yy += y * y;
        self.xy += x * y;
    }

    fn value(&self) -> f64 {
        if self.n < 2.0 {
            return 0.0;
        }
        let covariance = self.xy - self.x * self.y / self.n;
        let spread = (self.xx - self.x * self.x / self.n) * (self.yy - self.y * self.y / self.n);
        if spread > 0.0 { covariance / spread.sqrt() } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlation_of_a_line_is_one_and_of_nothing_is_nought() {
        let mut line = Correlation::default();
        let mut flat = Correlation::default();
        for i in 0..10 {
            line.add(f64::from(i), 3.0 - 2.0 * f64::from(i));
            flat.add(f64::from(i), 1.0);
        }
        assert!((line.value() + 1.0).abs() < 1e-12);
        assert_eq!(flat.value(), 0.0);
    }

    #[test]
    fn a_nan_never_wins() {
        assert_eq!(best([f32::NAN, 0.5, f32::NAN, 0.7].into_iter()), 3);
    }
}
