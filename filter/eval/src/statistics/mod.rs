//! What chance can explain: intervals of shares, resampled clusters, and the test of paired counts.

pub mod bootstrap;
pub mod mcnemar;
pub mod share;

/// 95 % of a normal variable is within so many standard deviations.
pub const Z_95: f64 = 1.959_963_985;

/// The value below which a share of the values is: the nearest rank. Zero for no values.
pub fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    let rank = (share * values.len() as f64).ceil() as usize;
    values.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_ranks() {
        let values = || (1..=100).map(f64::from).collect::<Vec<_>>();
        assert_eq!((quantile(values(), 0.5), quantile(values(), 0.99)), (50.0, 99.0));
    }
}
