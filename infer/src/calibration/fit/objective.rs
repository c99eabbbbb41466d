//! How probable touches are by log-odds of a match, and how that changes with each number.

use rayon::prelude::*;

use super::sample::{Kind, Sample, Seen};

/// A touch counts half each as one of a part, and of a pose, that the bank lacks.
const LEFT_OUT: f64 = 0.5;

/// How strongly the directions of rarity are drawn to none: as if a touch of each had said so.
const RIDGE: f64 = 1e-6;

/// The mean negative log-probability of touches by the numbers
/// `[offset, ln steepness, steepness by edge, rarity by edge, distance by own, rarity...]`.
///
/// With a chance of one half each, a touch is of one of the bank's states, all equally likely, or of the world. It is at its own
/// state where the bank has it, and of the world where its part, or its pose, is left out.
pub(super) struct Objective<'a> {
    pub samples: &'a [Sample],
    /// Share of touches that are of something else.
    pub outlier_share: f64,
    /// The usual distance of touches from their own views.
    pub usual_distance: f64,
}

/// No log-odds are more, on the way to those that are sought, nats.
const HIGHEST: f64 = 600.0;

/// Numbers before the rarity's.
pub(super) const N_FIRST: usize = 5;

impl Objective<'_> {
    /// The value, and its derivative by each number.
    pub fn at(&self, numbers: &[f64]) -> (f64, Vec<f64>) {
        let n = self.samples.len() as f64;
        let zero = || (0.0, vec![0.0; numbers.len()]);
        let add = |(a, mut da): (f64, Vec<f64>), (b, db): (f64, Vec<f64>)| {
            da.iter_mut().zip(db).for_each(|(a, b)| *a += b);
            (a + b, da)
        };
        // In pieces of a fixed size, so that sums are the same on any number of threads.
        let pieces: Vec<(f64, Vec<f64>)> = self
            .samples
            .par_chunks(64)
            .map(|samples| samples.iter().fold(zero(), |sum, sample| add(sum, self.of_sample(sample, numbers))))
            .collect();
        let (sum, mut derivative) = pieces.into_iter().fold(zero(), add);
        derivative.iter_mut().for_each(|value| *value /= n);
        let ridge: f64 = numbers[N_FIRST..].iter().map(|h| RIDGE * h * h).sum();
        derivative[N_FIRST..].iter_mut().zip(&numbers[N_FIRST..]).for_each(|(d, h)| *d += 2.0 * RIDGE * h);
        (sum / n + ridge, derivative)
    }

    fn of_sample(&self, sample: &Sample, numbers: &[f64]) -> (f64, Vec<f64>) {
        let [offset, log_steepness, by_edge, rarity_by_edge, by_own] = [0, 1, 2, 3, 4].map(|at| numbers[at]);
        let Sample { query, log_edge, own_distance, n_states: [n_all, n_others], seen } = sample;
        let rarity: f64 = numbers[N_FIRST..].iter().zip(query).map(|(h, q)| h * f64::from(*q)).sum();
        let steepness = (log_steepness + by_edge * log_edge).exp();
        let level = offset + rarity + rarity_by_edge * log_edge;
        let at_own = level + (-self.outlier_share).ln_1p();
        let log_own = (self.usual_distance / own_distance).ln();
        let scale = (by_own * log_own).exp();
        // Of each kind of state: the odds of all, and what they change by with the level and with the distance.
        let mut sums = [Sums::default(); 4];
        for Seen { distance, count, kind } in seen {
            let counted = scale * distance;
            let off = counted - self.usual_distance;
            let matched = count * (at_own - steepness * off).min(HIGHEST).exp();
            let sum = &mut sums[*kind as usize];
            sum.odds += matched + count * self.outlier_share;
            sum.by_level += matched;
            sum.by_distance += matched * off;
            sum.by_counted += matched * counted;
            sum.n += 1.0;
        }
        let of = |kinds: &[Kind]| kinds.iter().fold(Sums::default(), |sum, kind| sum.and(sums[*kind as usize]));
        let touched = of(&[Kind::Touched]);
        // Each with the number of states that it is the mean of, and how much it counts.
        let means = [
            (of(&[Kind::Touched, Kind::Near, Kind::Own, Kind::Other]), n_all, 1.0),
            (of(&[Kind::Other]), n_others, LEFT_OUT),
            (of(&[Kind::Own, Kind::Other]), n_all, LEFT_OUT),
        ];
        let mut value = -(touched.odds / touched.n).ln();
        let [mut by_level, mut by_distance, mut by_counted] =
            [touched.by_level, touched.by_distance, touched.by_counted].map(|sum| -sum / touched.odds);
        for (sum, n, counts) in means.into_iter().filter(|(sum, ..)| sum.n > 0.0) {
            value += counts * (sum.odds / n).ln_1p();
            by_level += counts * sum.by_level / (n + sum.odds);
            by_distance += counts * sum.by_distance / (n + sum.odds);
            by_counted += counts * sum.by_counted / (n + sum.odds);
        }
        let mut derivative = vec![0.0; numbers.len()];
        derivative[0] = by_level;
        derivative[1] = -steepness * by_distance;
        derivative[2] = -steepness * by_distance * log_edge;
        derivative[3] = by_level * log_edge;
        derivative[4] = -steepness * by_counted * log_own;
        derivative[N_FIRST..].iter_mut().zip(query).for_each(|(d, q)| *d = by_level * f64::from(*q));
        (value, derivative)
    }
}

/// Sums over states of one kind.
#[derive(Clone, Copy, Default)]
struct Sums {
    odds: f64,
    by_level: f64,
    by_distance: f64,
    by_counted: f64,
    n: f64,
}

impl Sums {
    fn and(self, other: Self) -> Self {
        Self {
            odds: self.odds + other.odds,
            by_level: self.by_level + other.by_level,
            by_distance: self.by_distance + other.by_distance,
            by_counted: self.by_counted + other.by_counted,
            n: self.n + other.n,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> Vec<Sample> {
        let kinds = [Kind::Touched, Kind::Touched, Kind::Near, Kind::Own, Kind::Other, Kind::Other];
        (0..70)
            .map(|at| {
                let noise = |k: usize| ((at * 31 + k * 17) % 23) as f64 / 23.0;
                let seen = kinds.iter().enumerate().map(|(k, kind)| Seen {
                    distance: 0.2 + 0.2 * k as f64 + 0.3 * noise(k),
                    count: if k > 2 { 4.5 } else { 1.0 },
                    kind: *kind,
                });
                Sample {
                    query: vec![noise(7) as f32, noise(8) as f32],
                    log_edge: noise(9) - 0.5,
                    own_distance: 0.3,
                    n_states: [20.0, 12.0],
                    seen: seen.collect(),
                }
            })
            .collect()
    }

    #[test]
    fn derivatives_are_differences() {
        let samples = samples();
        let objective = Objective { samples: &samples, outlier_share: 0.01, usual_distance: 0.4 };
        let numbers = [1.3, 1.7, 0.3, 0.4, 0.7, -0.6, 0.9];
        let (_, derivative) = objective.at(&numbers);
        for at in 0..numbers.len() {
            let moved = |by: f64| {
                let mut moved = numbers;
                moved[at] += by;
                objective.at(&moved).0
            };
            let difference = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((derivative[at] - difference).abs() < 1e-8, "{at}: {} {difference}", derivative[at]);
        }
    }

    #[test]
    fn a_value_is_its_definition() {
        let samples = &samples()[..1];
        let numbers = [1.3, 1.7, 0.3, 0.4, 0.7, -0.6, 0.9];
        let sample = &samples[0];
        let odds = |seen: &Seen| {
            let rarity = -0.6 * f64::from(sample.query[0]) + 0.9 * f64::from(sample.query[1]) + 0.4 * sample.log_edge;
            let steepness = 1.7_f64.exp() * (0.3 * sample.log_edge).exp();
            0.99 * (1.3 + rarity - steepness * ((4.0_f64 / 3.0).powf(0.7) * seen.distance - 0.4)).exp() + 0.01
        };
        let sum = |kinds: &[Kind]| {
            let seen = sample.seen.iter().filter(|seen| kinds.contains(&seen.kind));
            seen.map(|seen| odds(seen) * seen.count).sum::<f64>()
        };
        use Kind::{Near, Other, Own, Touched};
        let present = sum(&[Touched]) / 2.0 / (1.0 + sum(&[Touched, Near, Own, Other]) / 20.0);
        let [no_part, no_pose] = [sum(&[Other]) / 12.0, sum(&[Own, Other]) / 20.0].map(|mean| 1.0 / (1.0 + mean));
        let by_hand = -(present.ln() + 0.5 * no_part.ln() + 0.5 * no_pose.ln());
        let ridge = 1e-6 * (0.36 + 0.81);
        let (found, _) = Objective { samples, outlier_share: 0.01, usual_distance: 0.4 }.at(&numbers);
        assert!((found - by_hand - ridge).abs() < 1e-12, "{found} {by_hand}");
    }
}
