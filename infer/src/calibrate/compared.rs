//! One touch of a hole against all recorded pegs.

/// One hole against all recorded pegs, by how far each cosine is below the best.
#[derive(Clone, Debug)]
pub(super) struct Compared {
    /// Edged rows of the bank in each range of [`GAP`], the best first.
    rows_by_gap: Vec<u32>,
    /// The cosines around the true pose, on the right part.
    near: Vec<f32>,
    /// The best cosine.
    pub best: f32,
}

/// Ranges of cosine that are distinguished: a tenth of the smallest temperature tried.
const GAP: f32 = 0.0005;

impl Compared {
    /// Compares by the cosines with all edged rows; `near` are those around the true pose.
    pub fn new(cosines: &[f32], near: &[usize]) -> Self {
        let best = cosines.iter().copied().fold(-1.0, f32::max);
        let mut rows_by_gap = vec![0; (2.0 / GAP) as usize + 2];
        cosines.iter().for_each(|s| rows_by_gap[((best - s) / GAP) as usize] += 1);
        rows_by_gap.truncate(rows_by_gap.iter().rposition(|n| *n > 0).map_or(0, |last| last + 1));
        Self { rows_by_gap, near: near.iter().map(|at| best - cosines[*at]).collect(), best }
    }

    /// How far the best of the rows around the true pose is below the best.
    pub fn gap(&self) -> f64 {
        f64::from(self.near.iter().copied().fold(f32::INFINITY, f32::min))
    }

    /// Negative log-probability of the rows around the true pose where all are equally likely, nats.
    pub fn chance(&self) -> f64 {
        let n_rows: f64 = self.rows_by_gap.iter().map(|n| f64::from(*n)).sum();
        (n_rows / self.near.len() as f64).ln()
    }

    /// Negative log-probability of the rows around the true pose, nats.
    pub fn nll(&self, weights: &Weights) -> f64 {
        let of_range = |(n, weight): (&u32, &f64)| f64::from(*n) * weight;
        let all: f64 = self.rows_by_gap.iter().zip(&weights.of_range).map(of_range).sum();
        let near: f64 = self.near.iter().map(|gap| weights.weight(f64::from(*gap))).sum();
        let by_chance = (-self.chance()).exp();
        -((1.0 - weights.outlier_share) * near / all + weights.outlier_share * by_chance).ln()
    }
}

/// What a row weighs by how far it is below the best, `exp(-gap / temperature)`, but for a share of touches that may be
/// of any row.
#[derive(Clone, Debug)]
pub(super) struct Weights {
    temperature: f64,
    outlier_share: f64,
    /// In the middle of each range.
    of_range: Vec<f64>,
}

impl Weights {
    /// The weights at a temperature, and the share of outliers.
    pub fn new(temperature: f64, outlier_share: f64) -> Self {
        let mut weights = Self { temperature, outlier_share, of_range: Vec::new() };
        let n_ranges = (2.0 / GAP) as usize + 2;
        weights.of_range = (0..n_ranges).map(|i| weights.weight((i as f64 + 0.5) * f64::from(GAP))).collect();
        weights
    }

    fn weight(&self, gap: f64) -> f64 {
        (-gap / self.temperature).exp()
    }
}
