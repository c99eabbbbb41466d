//! Exact Bayes over all states: the default engine.

use crate::resample::normalize;

/// How much of what several touches say counts, since touches of one hole share a part of their error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchWeights {
    /// The power to which the likelihood of each touch is taken, above 0, at most 1.
    pub joint: f64,
    /// That power by what it was without the last touch.
    pub of_earlier: f64,
}

impl TouchWeights {
    /// A first touch; or touches that share no error.
    pub const FULL: Self = Self { joint: 1.0, of_earlier: 1.0 };
}

/// The posterior of every state, `[n_states]`, normalised.
#[derive(Clone, Debug, PartialEq)]
pub struct Exact {
    log_posterior: Vec<f64>,
    posterior: Vec<f64>,
    /// log p(all touches) as they count together.
    log_evidence: f64,
    /// The log-posterior of the first states after the touch being taken in, not normalised.
    weighed: Vec<f64>,
}

impl Exact {
    /// Every state equally likely, before any touch.
    pub fn uniform(n_states: usize) -> Self {
        let n = n_states as f64;
        let (log_posterior, posterior) = (vec![-n.ln(); n_states], vec![1.0 / n; n_states]);
        Self { log_posterior, posterior, log_evidence: 0.0, weighed: Vec::with_capacity(n_states) }
    }

    /// Takes in a touch's log-likelihood at the next states, from the first on; [`Self::update`] follows once all have it.
    pub fn weigh(&mut self, log_likelihoods: &[f64], weights: TouchWeights) {
        let TouchWeights { joint, of_earlier } = weights;
        let of_next = &self.log_posterior[self.weighed.len()..];
        let weigh = |(log, likelihood): (&f64, &f64)| of_earlier * log + joint * likelihood;
        self.weighed.extend(of_next.iter().zip(log_likelihoods).map(weigh));
    }

    /// Bayes' rule (paper, Eq. 4): the posterior becomes what was weighed, normalised once; returns the log-evidence
    /// of the touch, log p(all touches) - log p(all before), each as they count together.
    ///
    /// A touch that no state explains (-inf everywhere) says nothing: the posterior stays, and the
    /// log-evidence is -inf.
    ///
    /// # Panics
    /// Where not each state was weighed.
    pub fn update(&mut self, TouchWeights { of_earlier, .. }: TouchWeights) -> f64 {
        assert_eq!(self.weighed.len(), self.log_posterior.len(), "states weighed");
        let log_sum = normalize(&mut self.weighed, &mut self.posterior);
        if log_sum.is_some() {
            std::mem::swap(&mut self.log_posterior, &mut self.weighed);
        }
        self.weighed.clear();
        let Some(log_sum) = log_sum else { return f64::NEG_INFINITY };
        // What was weighed is normalised and starts at one in as many states: both count by `of_earlier` too.
        let log_states = (self.posterior.len() as f64).ln();
        let log_evidence = log_sum + (of_earlier - 1.0) * (self.log_evidence + log_states);
        self.log_evidence += log_evidence;
        log_evidence
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

    fn update(exact: &mut Exact, log_likelihood: impl Fn(usize) -> f64) -> f64 {
        let logs: Vec<f64> = (0..exact.posterior().len()).map(log_likelihood).collect();
        logs.chunks(2).for_each(|logs| exact.weigh(logs, TouchWeights::FULL));
        exact.update(TouchWeights::FULL)
    }

    proptest! {
        #[test]
        fn the_posterior_is_the_normalised_product(
            touches in prop::collection::vec(prop::collection::vec(0.01..1.0_f64, 6), 1..8),
        ) {
            let mut exact = Exact::uniform(6);
            for touch in &touches {
                update(&mut exact, |state| touch[state].ln());
            }
            let product = |state: usize| touches.iter().map(|touch| touch[state]).product::<f64>();
            let sum: f64 = (0..6).map(product).sum();
            for (state, (log, mass)) in exact.log_posterior().iter().zip(exact.posterior()).enumerate() {
                prop_assert!((log.exp() - product(state) / sum).abs() < 1e-12);
                prop_assert!((mass - product(state) / sum).abs() < 1e-12);
            }
        }

        #[test]
        fn touches_that_share_an_error_count_as_powers(
            touches in prop::collection::vec(prop::collection::vec(0.01..1.0_f64, 6), 1..8),
            share in 0.0..1.0_f64,
        ) {
            let (mut exact, mut joint, mut total) = (Exact::uniform(6), 1.0, 0.0);
            for (index, touch) in touches.iter().enumerate() {
                let next = 1.0 / (1.0 + share * index as f64);
                let weights = TouchWeights { joint: next, of_earlier: next / joint };
                let logs: Vec<f64> = touch.iter().map(|p| p.ln()).collect();
                exact.weigh(&logs, weights);
                total += exact.update(weights);
                joint = next;
            }
            let product = |state: usize| touches.iter().map(|touch| touch[state].powf(joint)).product::<f64>();
            let sum: f64 = (0..6).map(product).sum();
            for (state, mass) in exact.posterior().iter().enumerate() {
                prop_assert!((mass - product(state) / sum).abs() < 1e-12);
            }
            prop_assert!((total - (sum / 6.0).ln()).abs() < 1e-10);
        }

        #[test]
        fn an_impossible_state_changes_nothing(touch in prop::collection::vec(-50.0..0.0_f64, 4)) {
            let (mut without, mut with) = (Exact::uniform(4), Exact::uniform(5));
            update(&mut without, |state| touch[state]);
            update(&mut with, |state| touch.get(state).copied().unwrap_or(f64::NEG_INFINITY));
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
        update(&mut exact, |state| -(state as f64));
        let before = exact.clone();
        assert_eq!(update(&mut exact, |_| f64::NEG_INFINITY), f64::NEG_INFINITY);
        assert_eq!(exact, before);
    }

    #[test]
    fn the_evidence_is_the_average_likelihood() {
        let log_evidence = update(&mut Exact::uniform(2), |state| [0.2_f64, 0.6][state].ln());
        assert!((log_evidence - 0.4_f64.ln()).abs() < 1e-12);
    }
}
