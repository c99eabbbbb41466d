//! How much a touch would tell that is new.

use super::rule::ActionRule;
use crate::likelihood::TouchLikelihood;
use crate::likelihood::evidence::Evidence;
use crate::likelihood::shared_error::mismatch;

/// How much of what a view tells is new. The network errs in the same way at all places where an unknown part or sensor looks the
/// same, so the worse the touches so far match, the less is new in views that look like them.
pub(super) struct NewShare<'a> {
    /// The touches that showed an edge.
    touches: Vec<&'a TouchLikelihood>,
    /// The share that a view repeats which looks just like one of them, 0..=1.
    share: f64,
}

impl<'a> NewShare<'a> {
    /// After some touches, for a rule: only expected information asks how much is new.
    pub fn of(rule: ActionRule, touches: &'a [Evidence]) -> Self {
        let edged = touches.iter().map(|touch| &touch.likelihood).filter(|likelihood| !likelihood.blank);
        let touches: Vec<&TouchLikelihood> = edged.collect();
        let share = if rule == ActionRule::Information { mismatch(touches.iter().copied()) } else { 0.0 };
        Self { touches, share }
    }

    /// How much of what a row of the bank tells is new, 0..=1: less by its cosine with the touch most like it.
    pub fn new_share(&self, row: usize) -> f64 {
        if self.share == 0.0 {
            return 1.0;
        }
        let most_alike = self.touches.iter().map(|touch| touch.similarities[row]).fold(0.0, f32::max);
        1.0 - self.share * f64::from(most_alike)
    }
}

#[cfg(test)]
mod tests {
    use tactile_data::se2::Se2;

    use super::super::choose::tests::bank;
    use super::*;
    use crate::touch::Observation;
    use crate::touch_model::TouchModel;

    const X: [f32; 3] = [1.0, 0.0, 0.0];
    const Y: [f32; 3] = [0.0, 1.0, 0.0];
    const UP: [f32; 3] = [0.0, 0.0, 1.0];

    /// Three rows at right angles: what each tells that is new after touches of these queries.
    fn new_shares(queries: &[[f32; 3]]) -> [f64; 3] {
        let bank = bank(0.2);
        let touch = |query: &[f32; 3]| {
            let observation = Observation::new(query.to_vec(), if *query == UP { 0.0 } else { 0.2 });
            let likelihood = TouchLikelihood::new(&observation, &bank, &TouchModel::default()).unwrap();
            Evidence::of(bank.grid(), Se2::IDENTITY, 1.0, likelihood)
        };
        let touches: Vec<Evidence> = queries.iter().map(touch).collect();
        let new_share = NewShare::of(ActionRule::Information, &touches);
        [0, 1, 2].map(|row| new_share.new_share(row))
    }

    #[test]
    fn views_like_touches_that_match_badly_tell_less() {
        let close = |found: [f64; 3], expected: [f64; 3]| {
            found.iter().zip(expected).for_each(|(a, b)| assert!((a - b).abs() < 1e-6, "{found:?} {expected:?}"));
        };
        // No touch, touches that match well, and blank ones, which are up here, say nothing of it.
        close(new_shares(&[]), [1.0; 3]);
        close(new_shares(&[X, Y]), [1.0; 3]);
        close(new_shares(&[UP]), [1.0; 3]);
        // Its best match has a cosine of 0.8, 0.12 of 0.22 below 0.92; the row at its side 0.6.
        let mismatch = 0.12 / 0.22;
        close(new_shares(&[[0.8, 0.6, 0.0]]), [1.0 - mismatch * 0.8, 1.0 - mismatch * 0.6, 1.0]);
        // 0.9 on average; each row by the touch most like it.
        let mismatch = 0.02 / 0.22;
        close(new_shares(&[[0.8, 0.6, 0.0], Y, UP]), [1.0 - mismatch * 0.8, 1.0 - mismatch, 1.0]);
        // Below 0.7 everything, and no row less than nothing.
        close(new_shares(&[[0.5, -0.7, -0.509_901_95]]), [1.0 - 0.5, 1.0, 1.0]);
    }
}
