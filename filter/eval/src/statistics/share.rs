//! 95 % intervals of a share: Wilson's, of draws that are independent or that come in groups.

use super::Z_95;

/// Wilson's 95 % interval of a share (Wilson 1927): right at shares near zero and one.
pub fn wilson_95(n_right: usize, n: usize) -> [f64; 2] {
    wilson_of(n_right as f64 / n.max(1) as f64, n as f64)
}

/// Wilson's 95 % interval of a share, 0..=1, of `n` draws, which may be a part of a draw: their effective number.
pub fn wilson_of(share: f64, n: f64) -> [f64; 2] {
    if n <= 0.0 {
        return [0.0, 1.0];
    }
    let z = Z_95;
    let centre = share + z * z / (2.0 * n);
    let half = z * (share * (1.0 - share) / n + z * z / (4.0 * n * n)).sqrt();
    [centre - half, centre + half].map(|bound| (bound / (1.0 + z * z / n)).clamp(0.0, 1.0))
}

/// Wilson's 95 % interval where draws come in groups that resemble each other: of the number of independent draws that
/// would say as much (Korn and Graubard 1998). `groups` are the right and all draws of each, none empty.
///
/// That number is the variance of a share of independent draws, `p (1 - p)`, by the variance of this one between the
/// groups, linearised; at most the number of draws, and the number of groups where all or none are right.
pub fn grouped_95(groups: &[[usize; 2]]) -> [f64; 2] {
    let sum = |of: usize| groups.iter().map(|group| group[of]).sum::<usize>() as f64;
    let ([n_right, n], n_groups) = ([sum(0), sum(1)], groups.len() as f64);
    let share = n_right / n.max(1.0);
    let between: f64 = groups.iter().map(|group| (group[0] as f64 - share * group[1] as f64).powi(2)).sum();
    let independent = share * (1.0 - share) * n * n * (n_groups - 1.0) / (n_groups * between);
    // Of one group, or with no differences, nothing is known of the variance.
    let known = independent.is_finite() && independent > 0.0;
    wilson_of(share, if known { independent.min(n) } else { n_groups })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilsons_interval_agrees_with_published_values() {
        // 81 of 263: (0.2553, 0.3662), Newcombe 1998, Table I, method 3.
        let [low, high] = wilson_95(81, 263);
        assert!((low - 0.2553).abs() < 5e-5 && (high - 0.3662).abs() < 5e-5, "{low} {high}");
        // 0 of 20: (0, 0.1611).
        assert!(wilson_95(0, 20)[0] < 1e-12 && (wilson_95(0, 20)[1] - 0.1611).abs() < 5e-5);
        assert_eq!(wilson_95(0, 0), [0.0, 1.0]);
    }

    #[test]
    fn groups_of_equals_count_once_and_groups_of_one_as_they_are() {
        let close = |a: [f64; 2], b: [f64; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
        // 400 draws, one a group: the variance between them is that of independent draws, but for (m - 1) / m.
        let alone: Vec<_> = (0..400).map(|i| [usize::from(i % 4 > 0), 1]).collect();
        assert!(close(grouped_95(&alone), wilson_95(300, 400)));
        // Each of them four times over.
        let same: Vec<_> = alone.iter().map(|group| group.map(|n| 4 * n)).collect();
        assert!(close(grouped_95(&same), grouped_95(&alone)));
        // Groups that are all alike inside say no more than they are; the draws are never exceeded.
        assert_eq!(grouped_95(&[[5, 5]; 6]), wilson_95(6, 6));
        assert_eq!(grouped_95(&[[3, 4]]), wilson_of(0.75, 1.0));
        assert_eq!(grouped_95(&[[1, 2]; 8]), wilson_of(0.5, 8.0));
    }
}
