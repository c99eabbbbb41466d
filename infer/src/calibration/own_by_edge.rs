//! How far touches are from their own views by how much edge they show: under a rough sensor those with little edge are farther.

use serde::{Deserialize, Serialize};

use crate::calibration::match_odds::MatchOdds;

/// No sensor's distances change by a higher power of the share of edge.
pub const MOST_BY_EDGE: f64 = 2.0;

/// A slope is believed as far as it is beyond so many of its standard errors: chance gives more in one of twenty. Ten touches seldom say.
#[cfg(feature = "datasets")]
const ERRORS: f64 = 1.96;

/// Own distances that fall with the logarithm `l` of the share of edge ([`MatchOdds::log_edge`]): `own exp(-b (l - usual))`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OwnByEdge {
    /// b.
    pub by_edge: f64,
    /// The mean `l`, where touches are as far from their own views as they are on average.
    pub usual_edge: f64,
}

impl OwnByEdge {
    /// The straight line of least squares through touches: the `l` and the distance of each. Its slope is drawn towards none by how much of it
    /// chance may give (James and Stein, positive part). `None` where that is all of it, and of touches that do not say.
    #[cfg(feature = "datasets")]
    pub(super) fn from_touches(touches: impl Iterator<Item = [f64; 2]> + Clone) -> Option<Self> {
        let n = touches.clone().count() as f64;
        let mean = |of: &dyn Fn([f64; 2]) -> f64| touches.clone().map(of).sum::<f64>() / n;
        let (usual_edge, own) = (mean(&|[log_edge, _]| log_edge), mean(&|[_, distance]| distance));
        let square = mean(&|[log_edge, _]| (log_edge - usual_edge).powi(2));
        let slope = mean(&|[log_edge, distance]| (log_edge - usual_edge) * (distance - own)) / square;
        let left = mean(&|[log_edge, distance]| (distance - own - slope * (log_edge - usual_edge)).powi(2));
        // The variance of the slope: what is left has n - 2 degrees of freedom.
        let by_chance = left / ((n - 2.0) * square);
        let beyond_chance = 1.0 - ERRORS * ERRORS * by_chance / slope.powi(2);
        let by_edge = (-beyond_chance * slope / own).clamp(-MOST_BY_EDGE, MOST_BY_EDGE);
        (n > 2.0 && beyond_chance > 0.0 && by_edge.is_finite()).then_some(Self { by_edge, usual_edge })
    }

    /// How many times as far as on average a touch with this share of edge is from its own view.
    pub fn factor(&self, edge_share: f32) -> f64 {
        self.factor_at(MatchOdds::log_edge(edge_share))
    }

    pub(super) fn factor_at(&self, log_edge: f64) -> f64 {
        (-self.by_edge * (log_edge - self.usual_edge)).exp()
    }
}

#[cfg(all(test, feature = "datasets"))]
mod tests {
    use super::*;

    /// Forty touches along a line, each with one of two errors, which cancel out.
    fn along(by_edge: f64, error: f64) -> impl Iterator<Item = [f64; 2]> + Clone {
        (0..40).map(move |i| {
            let log_edge = 1.0 + 0.1 * f64::from(i / 2) - 0.95;
            [log_edge, 0.7 * (1.0 - by_edge * (log_edge - 1.0)) + if i % 2 == 0 { error } else { -error }]
        })
    }

    #[test]
    fn it_is_the_line_less_what_chance_gives() {
        let found = OwnByEdge::from_touches(along(0.4, 0.0)).unwrap();
        assert!((found.by_edge - 0.4).abs() < 1e-12 && (found.usual_edge - 1.0).abs() < 1e-12, "{found:?}");
        // By hand: squares of 0.05, 0.15, .. 0.95 are 6.65 / 20 on average; errors of 0.1 have a variance of 0.01 * 40 / 38.
        let (slope, by_chance) = (0.7 * 0.4, 0.01 / (38.0 * 0.3325));
        let expected = 0.4 * (1.0 - 1.96 * 1.96 * by_chance / (slope * slope));
        let noisy = OwnByEdge::from_touches(along(0.4, 0.1)).unwrap();
        assert!((noisy.by_edge - expected).abs() < 1e-12 && noisy.by_edge < 0.4, "{noisy:?} {expected}");
        // Half as far as on average where l is more by ln 2 / 0.4.
        assert!((found.factor_at(1.0 + 2.0_f64.ln() / 0.4) - 0.5).abs() < 1e-12);
        assert!((found.factor(0.047) - (0.4_f64).exp()).abs() < 1e-7);
    }

    #[test]
    fn touches_that_do_not_say_give_none() {
        assert_eq!(OwnByEdge::from_touches(along(0.01, 0.3)), None);
        assert_eq!(OwnByEdge::from_touches(along(0.0, 0.0)), None);
        for few in [&[][..], &[[1.0, 0.5]], &[[1.0, 0.5], [2.0, 0.4]], &[[1.0, 0.5], [1.0, 0.4], [1.0, 0.3]]] {
            assert_eq!(OwnByEdge::from_touches(few.iter().copied()), None, "{few:?}");
        }
        // A bank that was made of the touches themselves.
        assert_eq!(OwnByEdge::from_touches((0..9).map(|i| [f64::from(i), 0.0])), None);
    }
}
