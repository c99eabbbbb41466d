//! The temperature at which a bank's own touches tell its parts best.

use crate::rows::Rows;
use crate::threads;

/// Temperatures that are tried, the warmest first.
const WARMEST: f64 = 0.06;
const COLDER: f64 = 0.85;
const N_TRIED: usize = 18;

/// So many touches may be of any part, as the filter has it.
const OUTLIER_SHARE: f64 = 0.02;

/// A colder temperature has to explain a touch better by so many nats: what chance gives is no reason to be surer.
const GAIN: f64 = 1e-3;

/// Cosines so far below the best weigh nothing at any of the temperatures.
const FARTHEST: f32 = 0.8;

/// The negative log-probability of one touch's part at each temperature that is tried, nats; `edged` are the
/// rows of edged views.
///
/// The probability of a part is the sum over its views, each as likely as any other beforehand.
fn surprises(query: &[f32], part: usize, (rows, edged, n_cells): (&Rows, &[usize], usize)) -> Vec<f64> {
    let (mut cosines, n_parts) = (Vec::new(), rows.len() / n_cells);
    rows.similarities(query, &mut cosines);
    let best = edged.iter().map(|row| cosines[*row]).fold(-1.0, f32::max);
    let near = edged.iter().filter(|row| best - cosines[**row] < FARTHEST);
    let near: Vec<(usize, f64)> = near.map(|row| (row / n_cells, f64::from(cosines[*row] - best))).collect();
    let surprise = |temperature: f64| {
        let (mut own, mut all) = (0.0, 0.0);
        for (of, below_best) in &near {
            let weight = (below_best / temperature).exp();
            all += weight;
            own += if *of == part { weight } else { 0.0 };
        }
        -((1.0 - OUTLIER_SHARE) * own / all + OUTLIER_SHARE / n_parts as f64).ln()
    };
    temperatures().map(surprise).collect()
}

fn temperatures() -> impl Iterator<Item = f64> {
    (0..N_TRIED).map(|step| WARMEST * COLDER.powi(step as i32))
}

/// What touches say of each temperature, summed.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    sums: Vec<f64>,
    n_touches: usize,
}

impl Tried {
    /// Nothing was touched.
    pub fn new() -> Self {
        Self { sums: vec![0.0; N_TRIED], n_touches: 0 }
    }

    /// Adds touches, by their parts and queries, which are as the rows are.
    pub fn add(&mut self, touches: &[(usize, Vec<f32>)], rows: (&Rows, &[usize], usize)) {
        let of_touch = |touch: usize| surprises(&touches[touch].1, touches[touch].0, rows);
        for surprises in threads::map(touches.len(), of_touch) {
            self.sums.iter_mut().zip(surprises).for_each(|(sum, surprise)| *sum += surprise);
        }
        self.n_touches += touches.len();
    }

    /// The warmest temperature that nearly explains the touches best; `None` where none does better than the warmest tried.
    pub fn best(&self) -> Option<f64> {
        let least = self.sums.iter().copied().fold(f64::INFINITY, f64::min);
        let is_enough = |sum: &f64| sum - least <= GAIN * self.n_touches as f64;
        let first = self.sums.iter().position(is_enough)?;
        temperatures().nth(first).filter(|_| first > 0)
    }
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Touches whose part is drawn with the probability that cosines at a known temperature give it.
    #[test]
    fn the_temperature_that_touches_were_drawn_with_is_found() {
        let (n_parts, n_cells, dim) = (4, 5, 6);
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let unit = |rng: &mut ChaCha8Rng| {
            let mut values: Vec<f32> = (0..dim).map(|_| rng.random::<f32>() - 0.5).collect();
            crate::similarity::normalize_rows(&mut values, dim);
            values
        };
        let values: Vec<f32> = (0..n_parts * n_cells).flat_map(|_| unit(&mut rng)).collect();
        let rows = Rows::new(dim, values).unwrap();
        let edged: Vec<usize> = (0..rows.len()).collect();
        for temperature in [0.02, 0.035] {
            let touches: Vec<(usize, Vec<f32>)> = (0..4000)
                .map(|_| {
                    let query = unit(&mut rng);
                    let mut cosines = Vec::new();
                    rows.similarities(&query, &mut cosines);
                    let weights = cosines.iter().map(|s| (f64::from(s - 1.0) / temperature).exp()).collect::<Vec<_>>();
                    let mut left = rng.random::<f64>() * weights.iter().sum::<f64>();
                    let drawn = weights.iter().position(|weight| {
                        left -= weight;
                        left <= 0.0
                    });
                    let is_outlier = rng.random::<f64>() < OUTLIER_SHARE;
                    let part = if is_outlier { rng.random_range(0..n_parts) } else { drawn.unwrap_or(0) / n_cells };
                    (part, query)
                })
                .collect();
            let mut tried = Tried::new();
            tried.add(&touches[..1000], (&rows, &edged, n_cells));
            tried.add(&touches[1000..], (&rows, &edged, n_cells));
            let found = tried.best().unwrap();
            assert!((0.8..1.4).contains(&(found / temperature)), "{found} {temperature}");
        }
    }

    #[test]
    fn one_part_has_no_temperature() {
        let rows = Rows::new(2, vec![1.0, 0.0, 0.0, 1.0]).unwrap();
        let mut tried = Tried::new();
        tried.add(&[(0, vec![1.0, 0.0]), (0, vec![0.6, 0.8])], (&rows, &[0, 1], 2));
        assert_eq!((tried.best(), Tried::new().best()), (None, None));
    }
}
