//! Exact Bayes over all states: the default engine.

use crate::resample::normalize;

/// The posterior of every state, `[n_states]`, normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct Exact {
    log_posterior: Vec<f64>,
    posterior: Vec<f64>,
}

impl Exact {
    /// Every state equally likely, before any touch.
    pub fn uniform(n_states: usize) -> Self {
        let n = n_states as f64;
        Self { log_posterior: vec![-n.ln(); n_states], posterior: vec![1.0 / n; n_states] }
    }

    /// Bayes' rule (paper, Eq. 4): adds each state's log-likelihood, normalises once, and returns the
    /// log-evidence of the touch.
    ///
    /// A touch that no state explains (-inf everywhere) says nothing: the posterior stays, and the
    /// log-evidence is -inf.
    pub fn update(&mut self, log_likelihood: impl Fn(usize) -> f64) -> f64 {
        let updated = |(state, log): (usize, &f64)| log + log_likelihood(state);
        let largest = self.log_posterior.iter().enumerate().map(updated).fold(f64::NEG_INFINITY, f64::max);
        if !largest.is_finite() {
            return f64::NEG_INFINITY;
        }
        self.log_posterior.iter_mut().enumerate().for_each(|(state, log)| *log += log_likelihood(state));
        normalize(&mut self.log_posterior, &mut self.posterior).unwrap_or(f64::NEG_INFINITY)
    }

    /// The posterior of each state, which sums to 1.
    pub fn posterior(&self) -> &[f64] {
        &self.posterior
    }

    /// The log-posterior of each state; exp of it sums to 1.
    pub fn log_posterior(&self) -> &[f64] {
        &self.log_posterior
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_posterior_is_the_normalised_product(
            touches in prop::collection::vec(prop::collection::vec(0.01..1.0_f64, 6), 1..8),
        ) {
            let mut exact = Exact::uniform(6);
            for touch in &touches {
                exact.update(|state| touch[state].ln());
            }
            let product = |state: usize| touches.iter().map(|touch| touch[state]).product::<f64>();
            let sum: f64 = (0..6).map(product).sum();
            for (state, (log, mass)) in exact.log_posterior().iter().zip(exact.posterior()).enumerate() {
                prop_assert!((log.exp() - product(state) / sum).abs() < 1e-12);
                prop_assert!((mass - product(state) / sum).abs() < 1e-12);
            }
        }

        #[test]
        fn an_impossible_state_changes_nothing(touch in prop::collection::vec(-50.0..0.0_f64, 4)) {
            let (mut without, mut with) = (Exact::uniform(4), Exact::uniform(5));
            without.update(|state| touch[state]);
            with.update(|state| touch.get(state).copied().unwrap_or(f64::NEG_INFINITY));
            for (a, b) in without.log_posterior().iter().zip(with.log_posterior()) {
                prop_assert!((a - b).abs() < 1e-12);
            }
            prop_assert_eq!(with.log_posterior()[4], f64::NEG_INFINITY);
        }
    }

    #[test]
    fn a_touch_that_nothing_explains_leaves_the_posterior() {
        // PythonRobotics#200, Gen.jl#117: all weights -inf became NaN.
        let mut exact = Exact::uniform(3);
        exact.update(|state| -(state as f64));
        let before = exact.clone();
        assert_eq!(exact.update(|_| f64::NEG_INFINITY), f64::NEG_INFINITY);
        assert_eq!(exact, before);
    }

    #[test]
    fn the_evidence_is_the_average_likelihood() {
        let log_evidence = Exact::uniform(2).update(|state| [0.2_f64, 0.6][state].ln());
        assert!((log_evidence - 0.4_f64.ln()).abs() < 1e-12);
    }
}
