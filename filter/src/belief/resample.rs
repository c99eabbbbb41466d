//! Log weights: normalisation, effective sample size, systematic resampling.

use crate::simd;

/// log(sum(exp(x))), without overflow; -inf for no weights at all. NaN counts as -inf.
pub fn log_sum_exp(logs: &[f64]) -> f64 {
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if !largest.is_finite() {
        return largest;
    }
    let sum: f64 = logs.iter().filter(|log| !log.is_nan()).map(|log| (log - largest).exp()).sum();
    largest + sum.ln()
}

/// Makes the weights sum to 1 and returns the log of their former sum. NaN becomes -inf.
///
/// `None` where no weight is finite and above -inf, or one is +inf: nothing can be normalised, and the
/// weights stay as they are.
pub fn log_normalize(log_weights: &mut [f64]) -> Option<f64> {
    normalize(log_weights, &mut Vec::new())
}

/// Like [`log_normalize`]; `weights` becomes what the log weights are the logs of, `[n]`.
pub fn normalize(log_weights: &mut [f64], weights: &mut Vec<f64>) -> Option<f64> {
    let largest = simd::largest(log_weights);
    if !largest.is_finite() {
        return None;
    }
    // Next to weights of e^-1e300 the log of their number would be lost: the largest goes first.
    simd::lower(log_weights, largest, weights);
    let sum = simd::sum(weights);
    let log_sum = sum.ln();
    log_weights.iter_mut().for_each(|log| *log -= log_sum);
    weights.iter_mut().for_each(|weight| *weight /= sum);
    Some(largest + log_sum)
}

/// 1 / sum(w^2) of normalised log weights, 1..=n: how many equal weights would be as good.
pub fn effective_sample_size(log_weights: &[f64]) -> f64 {
    (-log_sum_exp(&log_weights.iter().map(|log| 2.0 * log).collect::<Vec<_>>())).exp()
}

/// Systematic resampling: `n` indices, ascending; index `i` comes up `floor` or `ceil` of
/// `n * weights[i] / sum` times.
///
/// `weights`: not negative, of any finite sum; a weight that is no positive number is never drawn.
/// `offset`: one uniform draw in 0..1. Where no weight is positive, all count as equal; no weights give
/// no indices.
pub fn systematic(weights: &[f64], n: usize, offset: f64) -> Vec<usize> {
    /// Weights summed at once: what is not drawn from is passed over so.
    const BLOCK: usize = 256;
    let positive = |weight: f64| if weight.is_finite() && weight > 0.0 { weight } else { 0.0 };
    let blocks: Vec<f64> = weights.chunks(BLOCK).map(simd::sum_of_positive).collect();
    let sum: f64 = blocks.iter().sum();
    let Some(last) = weights.iter().rposition(|w| positive(*w) > 0.0) else {
        return (0..n).filter(|_| !weights.is_empty()).map(|k| k * weights.len() / n).collect();
    };
    let (mut index, mut cumulative) = (0, positive(weights[0]));
    (0..n)
        .map(|k| {
            let position = (k as f64 + offset) / n as f64 * sum;
            // Rounding may leave the last position above the sum of all: `last` takes it.
            while index < last && (cumulative <= position || positive(weights[index]) == 0.0) {
                index += 1;
                let passed_over = |index: usize, cumulative: f64| {
                    let is_whole = index.is_multiple_of(BLOCK) && index + BLOCK <= last;
                    is_whole && cumulative + blocks[index / BLOCK] <= position
                };
                while passed_over(index, cumulative) {
                    cumulative += blocks[index / BLOCK];
                    index += BLOCK;
                }
                cumulative += positive(weights[index]);
            }
            index
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn tiny_weights_keep_their_number() {
        let mut logs = [-1e300; 4];
        assert_eq!(log_normalize(&mut logs), Some(-1e300));
        assert!(logs.iter().all(|log| (log.exp() - 0.25).abs() < 1e-15), "{logs:?}");
    }

    #[test]
    fn dead_weights_cannot_be_normalised_and_stay() {
        for mut dead in [vec![], vec![f64::NEG_INFINITY; 3], vec![f64::NAN; 2], vec![f64::INFINITY, 0.0]] {
            let before = format!("{dead:?}");
            assert_eq!(log_normalize(&mut dead), None);
            assert_eq!(format!("{dead:?}"), before);
        }
    }

    #[test]
    fn one_nan_does_not_spoil_the_others() {
        let mut logs = [0.0, f64::NAN, 0.0];
        log_normalize(&mut logs);
        assert_eq!(logs, [0.5_f64.ln(), f64::NEG_INFINITY, 0.5_f64.ln()]);
    }

    #[test]
    fn weights_far_below_the_smallest_float_keep_their_ratio() {
        // multicalc#205: exp(-1e6) is 0, the ratio 1:3 is not.
        let mut logs = [-1e6, -1e6 + 3.0_f64.ln()];
        log_normalize(&mut logs);
        // -1e6 is stored to 1.2e-10.
        assert!((logs[0].exp() - 0.25).abs() < 1e-9 && (logs[1].exp() - 0.75).abs() < 1e-9);
    }

    #[test]
    fn effective_sample_size_of_equal_weights_is_their_number() {
        assert!((effective_sample_size(&[0.25_f64.ln(); 4]) - 4.0).abs() < 1e-12);
        assert!((effective_sample_size(&[0.0, f64::NEG_INFINITY]) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn no_positive_weight_spreads_evenly() {
        assert_eq!(systematic(&[0.0, f64::NAN, -1.0], 3, 0.5), [0, 1, 2]);
        assert!(systematic(&[], 3, 0.5).is_empty());
    }

    #[test]
    fn zero_weights_never_come_up_even_at_the_ends() {
        // ParticleFilters.jl#51: an offset near 1 ran past the last weight.
        let weights = [0.0, 0.3, 0.0, 0.7 - f64::EPSILON, 0.0];
        for offset in [0.0, 0.5, 1.0 - f64::EPSILON] {
            let drawn = systematic(&weights, 1000, offset);
            assert_eq!(drawn.len(), 1000);
            assert!(drawn.iter().all(|i| *i == 1 || *i == 3));
        }
    }

    proptest! {
        #[test]
        fn counts_are_within_one_of_their_expectation(
            few in prop::collection::vec(0.0..1.0_f64, 1..50), times in 1..30_usize, n in 1..500_usize,
            offset in 0.0..1.0_f64,
        ) {
            let weights = few.repeat(times);
            let sum: f64 = weights.iter().sum();
            prop_assume!(sum > 1e-3);
            let drawn = systematic(&weights, n, offset);
            for (index, weight) in weights.iter().enumerate() {
                let count = drawn.iter().filter(|i| **i == index).count() as f64;
                prop_assert!((count - n as f64 * weight / sum).abs() < 1.0 + 1e-9);
            }
        }
    }
}
