//! Intervals of figures whose episodes come in clusters: whole clusters are drawn again (cluster bootstrap).
//!
//! Clusters are parts. Prints of a part belong to it and no print is shared, so that parts are drawn, each with all of
//! its prints and episodes, and nothing below them: what prints differ by is within what parts differ by (Field and
//! Welsh 2007, J. R. Stat. Soc. B 69:369; Davison and Hinkley 1997, 3.8). Were the same print of all parts one thing, both
//! ways would have to be drawn (Owen 2007). Drawing pairs of part and print as if they were independent would say too
//! little: prints of a part resemble each other.

use rand::RngExt;
use tactile_data::sensor::simulator::frame_rng;

use super::{Z_95, quantile};

/// Times that all clusters are drawn anew.
const N_RESAMPLES: u64 = 2_000;

/// Seed of the draws: the same for every figure, so that the same episodes give the same interval.
const SEED: u64 = 0x626f_6f74;

/// The 95 % interval of a figure of some clusters: percentiles of the figure of clusters drawn with replacement, as far
/// from it as few clusters ask for. `sums` are what each cluster adds to the sums that `figure` takes. `None` for
/// fewer than two clusters.
pub fn clustered_95<const K: usize>(sums: &[[f64; K]], figure: impl Fn(&[f64; K]) -> f64) -> Option<[f64; 2]> {
    if sums.len() < 2 {
        return None;
    }
    let add = |total: [f64; K], cluster: &[f64; K]| std::array::from_fn(|k| total[k] + cluster[k]);
    let resampled = (0..N_RESAMPLES).map(|stream| {
        let mut rng = frame_rng(SEED, stream);
        let drawn = (0..sums.len()).map(|_| &sums[rng.random_range(0..sums.len())]);
        figure(&drawn.fold([0.0; K], add))
    });
    let resampled: Vec<f64> = resampled.collect();
    let of_all = figure(&sums.iter().fold([0.0; K], add));
    Some([0.025, 0.975].map(|share| of_all + few(sums.len()) * (quantile(resampled.clone(), share) - of_all)))
}

/// By how much percentiles of a bootstrap lie too near for `n` clusters, 2 or more: a variance of them is `(n - 1) / n`
/// of the right one, and is itself drawn, so that Student's t takes the place of the normal distribution (Hesterberg
/// 2015, Am. Stat. 69:371, 4.3, who moves the percentiles instead). 1.17 for 12 clusters, 1.44 for 6.
fn few(n: usize) -> f64 {
    let n = n as f64;
    student_95(n - 1.0) / Z_95 * (n / (n - 1.0)).sqrt()
}

/// The 97.5th percentile of Student's t (Abramowitz and Stegun 26.7.5): to 0.2 % from 3 degrees of freedom on, 1 % at 2;
/// 11 % too little at 1.
fn student_95(degrees: f64) -> f64 {
    let power = |n| Z_95.powi(n);
    let terms = [
        (power(3) + Z_95) / 4.0,
        (5.0 * power(5) + 16.0 * power(3) + 3.0 * Z_95) / 96.0,
        (3.0 * power(7) + 19.0 * power(5) + 17.0 * power(3) - 15.0 * Z_95) / 384.0,
        (79.0 * power(9) + 776.0 * power(7) + 1_482.0 * power(5) - 1_920.0 * power(3) - 945.0 * Z_95) / 92_160.0,
    ];
    terms.into_iter().zip(1..).fold(Z_95, |t, (term, n)| t + term / degrees.powi(n))
}

#[cfg(test)]
mod tests {
    use super::super::share::wilson_95;
    use super::*;

    fn mean([sum, n]: &[f64; 2]) -> f64 {
        sum / n
    }

    #[test]
    fn students_percentile_is_that_of_tables() {
        for (degrees, t) in [(2.0, 4.303), (3.0, 3.182), (5.0, 2.571), (11.0, 2.201), (29.0, 2.045), (120.0, 1.980)] {
            assert!((student_95(degrees) / t - 1.0).abs() < if degrees < 3.0 { 0.01 } else { 0.002 }, "{degrees}");
        }
    }

    #[test]
    fn an_interval_is_as_wide_as_the_variance_between_clusters_says() {
        // Shares 0.5, 0.51, ... of clusters of equal size: nearly normal, so that the bounds are those of Student's t.
        let sums: Vec<[f64; 2]> = (0..40).map(|i| [50.0 + f64::from(i), 100.0]).collect();
        let [low, high] = clustered_95(&sums, mean).unwrap();
        let all = sums.iter().map(|[sum, n]| sum / n).sum::<f64>() / 40.0;
        let variance = sums.iter().map(|[sum, n]| (sum / n - all).powi(2)).sum::<f64>() / 39.0;
        let half = 2.0227 * (variance / 40.0).sqrt();
        assert!((low - all + half).abs() < 0.05 * half && (high - all - half).abs() < 0.05 * half, "{low} {high}");
        assert_eq!(clustered_95(&sums, mean), Some([low, high]), "the same again");
        assert_eq!(clustered_95(&sums[..1], mean), None);
        assert_eq!(clustered_95(&[[7.0, 7.0]; 12], mean), Some([1.0, 1.0]));
    }

    /// Twelve parts, each of its own difficulty, with twenty episodes each: how often the mean difficulty, 0.7, is within.
    #[test]
    fn an_interval_of_parts_covers_what_one_of_episodes_does_not() {
        let (mut covered, n_trials) = ([0, 0], 300);
        for trial in 0..n_trials {
            let mut rng = frame_rng(5, trial);
            let sums: Vec<[f64; 2]> = (0..12)
                .map(|_| {
                    let share = 0.4 + 0.6 * rng.random::<f64>();
                    [(0..20).filter(|_| rng.random::<f64>() < share).count() as f64, 20.0]
                })
                .collect();
            let n_right = sums.iter().map(|[n_right, _]| *n_right as usize).sum();
            let intervals = [clustered_95(&sums, mean).unwrap(), wilson_95(n_right, 240)];
            for (covered, [low, high]) in covered.iter_mut().zip(intervals) {
                *covered += usize::from((low..=high).contains(&0.7));
            }
        }
        let [by_parts, by_episodes] = covered.map(|n| n as f64 / n_trials as f64);
        assert!((0.92..=0.98).contains(&by_parts) && by_episodes < 0.8, "{by_parts} {by_episodes}");
    }
}
