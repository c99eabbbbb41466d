//! Mean, spread and low end of few values, with what was known before them.

use crate::calibration::{Prior, Spread};

/// The normal distribution's quantile of one in a hundred values, in standard deviations.
const ONE_IN_100: f64 = 2.326;

/// So many touches show by themselves which cosine 99 in 100 reach.
const ENOUGH: usize = 100;

/// The spread of values together with the prior's touches, as if those had been values of the spread that it has.
pub(super) fn pooled(values: &[f64], prior: Option<&Prior>) -> Option<Spread> {
    let before = prior.and_then(|prior| prior.matched.map(|spread| (prior.n_touches, spread)));
    let Some((weight, before)) = before else { return (!values.is_empty()).then(|| Spread::from_values(values)) };
    if values.is_empty() {
        return Some(before);
    }
    let (own, n) = (Spread::from_values(values), values.len() as f64);
    let pooled = |a: f64, b: f64| (weight * a + n * b) / (weight + n);
    let mean = pooled(before.mean, own.mean);
    let square = |spread: Spread| spread.sd.powi(2) + (spread.mean - mean).powi(2);
    Some(Spread { mean, sd: pooled(square(before), square(own)).sqrt() })
}

/// The cosine that 99 in 100 touches reach, by their best cosines. From fewer than a hundred it is the cosine below
/// which the next touch falls with a chance of one in a hundred, if the best cosines are normally distributed; the
/// prior's value counts as its touches.
pub(super) fn low_similarity(bests: &[f32], prior: Option<&Prior>) -> Option<f32> {
    let mut sorted = bests.to_vec();
    sorted.sort_by(f32::total_cmp);
    let own = sorted.get(sorted.len() / 100).copied();
    let Some(prior) = prior else { return own };
    let Some(least) = own else { return Some(prior.low_similarity) };
    let n = bests.len() as f64;
    let own = if bests.len() >= ENOUGH { f64::from(least) } else { next_of_100(bests).unwrap_or(f64::from(least)) };
    let before = f64::from(prior.low_similarity);
    let n_before = prior.n_touches;
    Some(((n_before * before + n * own) / (n_before + n)).clamp(-1.0, 1.0) as f32)
}

/// Below this the next of normal values falls with a chance of one in a hundred; `None` of fewer than three.
fn next_of_100(values: &[f32]) -> Option<f64> {
    if values.len() < 3 {
        return None;
    }
    let n = values.len() as f64;
    let Spread { mean, sd } = Spread::from_values(&values.iter().map(|v| f64::from(*v)).collect::<Vec<_>>());
    let freedom = n - 1.0;
    let of_sample = sd * (n / freedom).sqrt();
    Some(mean - student(freedom) * of_sample * (1.0 + 1.0 / n).sqrt())
}

/// Student's 99 % quantile (Abramowitz and Stegun 26.7.5, two terms): within 4 % from four degrees of freedom, too small below.
fn student(freedom: f64) -> f64 {
    let z = ONE_IN_100;
    let first = (z.powi(3) + z) / 4.0;
    let second = (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / 96.0;
    z + first / freedom + second / freedom.powi(2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::views::Views;

    fn prior(n_touches: f64) -> Prior {
        Prior {
            n_touches,
            low_similarity: 0.7,
            matched: Some(Spread { mean: 2.0, sd: 1.0 }),
            between_sensors: None,
            views: Views::Pegs,
        }
    }

    #[test]
    fn a_spread_with_a_prior_is_that_of_all_values_together() {
        // By hand: 1, 2 and 6 have a mean of 3 and squares of 4, 1 and 9 from it.
        assert_eq!(Spread::from_values(&[1.0, 2.0, 6.0]), Spread { mean: 3.0, sd: (14.0_f64 / 3.0).sqrt() });
        // Values of mean 2 and spread 1, as the prior's four touches would be: 1, 3, 1, 3.
        let all = Spread::from_values(&[1.0, 3.0, 1.0, 3.0, 1.0, 2.0, 6.0]);
        let both = pooled(&[1.0, 2.0, 6.0], Some(&prior(4.0))).unwrap();
        assert!((both.mean - all.mean).abs() < 1e-12 && (both.sd - all.sd).abs() < 1e-12, "{both:?} {all:?}");
        assert_eq!(pooled(&[], Some(&prior(4.0))), prior(4.0).matched);
        assert_eq!(pooled(&[], None), None);
    }

    #[test]
    fn student_is_the_tables() {
        for (freedom, table) in [(4.0, 3.747), (9.0, 2.821), (20.0, 2.528), (60.0, 2.390)] {
            assert!((student(freedom) / table - 1.0).abs() < 0.04, "{freedom}: {}", student(freedom));
        }
    }

    #[test]
    fn the_low_end_of_few_is_below_them_and_drawn_to_the_prior() {
        assert_eq!(low_similarity(&[], Some(&prior(10.0))), Some(0.7));
        let ten: Vec<f32> = (0..10).map(|i| 0.80 + 0.01 * i as f32).collect();
        // Mean 0.845, sample deviation 0.0303: 0.845 - 2.82 x 0.0303 x 1.049 = 0.755, half way to 0.7.
        let low = low_similarity(&ten, Some(&prior(10.0))).unwrap();
        assert!((low - 0.728).abs() < 0.002, "{low}");
        assert_eq!(low_similarity(&ten, None), Some(0.80));
        let many: Vec<f32> = (0..400).map(|i| 0.5 + 0.001 * i as f32).collect();
        // 400 of its own and the prior's ten.
        let low = low_similarity(&many, Some(&prior(10.0))).unwrap();
        assert!((f64::from(low) - (400.0 * 0.504 + 7.0) / 410.0).abs() < 1e-6, "{low}");
    }
}
