//! How a recorded view counts against the view that would be touched.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_infer::Bank;

use super::inputs::ChoiceInputs;
use super::rule::ActionRule;
use crate::likelihood::Foreseen;
use crate::touch_model::{PAPER_TEMPERATURE, TouchModel};

/// How a recorded view counts against the view that would be touched.
#[derive(Clone, Copy)]
pub(super) struct Pairing<'a> {
    model: &'a TouchModel,
    bank: &'a Bank,
    by: By,
}

/// What views are compared by.
#[derive(Clone, Copy)]
enum By {
    /// The paper's 1 / f_PP, at a temperature; `average` is over edged views at random.
    Paper { temperature: f64, average: f64 },
    /// The likelihood that the filter will weigh them by, to the power with which it counts together with the touches made:
    /// of a touch as rare as those so far, in a bank whose touches are so far from their own views.
    Odds { joint: f64, rarity: f64, own_distance: f64 },
}

impl<'a> Pairing<'a> {
    pub(super) fn new(inputs: &ChoiceInputs<'a>, rng: &mut ChaCha8Rng) -> Self {
        let ChoiceInputs { config, model, bank, belief, .. } = *inputs;
        if config.method.rule == ActionRule::Paper {
            let temperature = model.temperature.unwrap_or(PAPER_TEMPERATURE) / belief.joint_weight(1.0, None);
            let pairing = Self { model, bank, by: By::Paper { temperature, average: 1.0 } };
            let average = pairing.mean_of_pairs(rng);
            return Self { by: By::Paper { temperature, average }, ..pairing };
        }
        let felt = || belief.touches().iter().map(|touch| &touch.likelihood).filter(|touch| !touch.blank);
        let rarity = felt().map(|touch| touch.rarity).sum::<f64>() / felt().count().max(1) as f64;
        let own_distance = belief.touches().first().map_or(model.own_distance, |touch| touch.likelihood.own_distance);
        Self { model, bank, by: By::Odds { joint: belief.joint_weight(1.0, None), rarity, own_distance } }
    }

    /// The mean of what pairs of edged views count; 1 where there is none.
    fn mean_of_pairs(&self, rng: &mut ChaCha8Rng) -> f64 {
        /// Pairs sampled: the mean's relative error, some 6 %, moves no score by more.
        const N_SAMPLED: usize = 256;
        let shares = self.bank.edge_shares();
        let is_edged = |row: &usize| !self.model.is_blank(shares[*row]) && self.bank.is_recorded(*row);
        let edged: Vec<usize> = (0..shares.len()).filter(is_edged).collect();
        if edged.is_empty() {
            return 1.0;
        }
        let mut any = || edged[rng.random_range(0..edged.len())];
        (0..N_SAMPLED).map(|_| self.ratios(&[any()], any())[0]).sum::<f64>() / N_SAMPLED as f64
    }

    /// What a state whose recorded view (row, trust) is `view` adds, where the row `touched` would be seen.
    pub(super) fn value(&self, view: Option<(usize, f64)>, touched: usize) -> f64 {
        self.mixed(view.map(|(row, trust)| (self.ratios(&[row], touched)[0], trust)))
    }

    /// What states add whose views are these rows, where the row `touched` would be seen.
    pub(super) fn ratios(&self, rows: &[usize], touched: usize) -> Vec<f64> {
        let cosines = self.bank.rows().cosines(touched, rows);
        let cosines = cosines.into_iter().map(|cosine| f64::from(cosine).clamp(-1.0, 1.0));
        match self.by {
            // Scaled so that it cannot overflow.
            By::Paper { temperature, .. } => cosines.map(|cosine| (-(cosine + 1.0) / temperature).exp()).collect(),
            By::Odds { joint, rarity, own_distance } => {
                let edge_share = self.bank.edge_shares()[touched];
                Foreseen::new(self.model, [rarity, own_distance], edge_share, joint).likely(cosines)
            }
        }
    }

    /// What a state adds by the ratio of its view and how far that is trusted; `None`: its view is unknown.
    pub(super) fn mixed(&self, view: Option<(f64, f64)>) -> f64 {
        match (self.by, view) {
            (By::Paper { average, .. }, None) => average,
            (By::Paper { .. }, Some((ratio, _))) => ratio,
            // As likely as the world.
            (By::Odds { .. }, None) => 1.0,
            (By::Odds { .. }, Some((ratio, trust))) => trust * ratio + (1.0 - trust),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::choose::tests::bank;
    use super::*;
    use crate::belief::{Belief, EngineConfig};
    use crate::config::EpisodeConfig;
    use crate::likelihood::TouchLikelihood;
    use crate::likelihood::interpolation::Interpolation;
    use crate::touch::Observation;
    use rand::SeedableRng;

    /// What is made of a bank whose rows of one part all show edges, once one of them was touched.
    fn with_pairing<T>(rule: ActionRule, model: &TouchModel, take: impl FnOnce(&Pairing, f64) -> T) -> T {
        let bank = bank(0.2);
        let touch = TouchLikelihood::new(&Observation::new(bank.row(2).into_owned(), 0.2), &bank, model).unwrap();
        let mean = touch.mean_match().unwrap();
        let belief = Belief::new(&bank, EngineConfig::Exact, 1, 1, touch);
        let config = EpisodeConfig::default().changed(|_, _, method| method.rule = rule);
        let inputs = ChoiceInputs { config: &config, model, belief: &belief, bank: &bank, candidates: &[] };
        take(&Pairing::new(&inputs, &mut ChaCha8Rng::seed_from_u64(1)), mean)
    }

    #[test]
    fn the_papers_score_agrees_with_hand_arithmetic() {
        let likelihood = TouchModel { temperature: 0.5, ..TouchModel::paper() };
        with_pairing(ActionRule::Paper, &likelihood, |pairing, _| {
            // 1 / exp(cos / tau), scaled by exp(-1 / tau): cosines -1, 0 and 1.
            for (row, cosine) in [(5, -1.0_f64), (1, 0.0), (2, 1.0)] {
                assert!((pairing.value(Some((row, 1.0)), 2) - (-(cosine + 1.0) / 0.5).exp()).abs() < 1e-6);
            }
            assert_eq!(pairing.value(None, 2), pairing.average);
        });
    }

    #[test]
    fn a_view_counts_as_the_filter_will_weigh_it_with_the_touch_made() {
        let independent = TouchModel { shared_error: 0.0, temperature: 0.5, ..TouchModel::default() };
        let value = |likelihood: &TouchModel, row| {
            with_pairing(ActionRule::Information, likelihood, |pairing, mean| {
                (pairing.value(Some((row, 1.0)), 2), mean)
            })
        };
        for (row, cosine) in [(5, -1.0_f64), (1, 0.0), (2, 1.0)] {
            let (got, mean) = value(&independent, row);
            // Up to 1 - eps, which all share.
            let by_hand = 0.96 * (((cosine - 1.0) / 0.5).exp() / mean + 0.02 / 0.98);
            assert!((got - by_hand).abs() < 1e-6, "{got} {by_hand}");
            // Of two touches that share all of their error either counts as half a touch.
            let alike = value(&TouchModel { shared_error: 1.0, outlier_share: 0.0, ..independent }, row).0;
            let whole = value(&TouchModel { outlier_share: 0.0, ..independent }, row).0;
            assert!((alike - whole.sqrt()).abs() < 1e-6, "{alike} {whole}");
        }
    }

    #[test]
    fn an_unknown_view_is_worth_what_the_filter_takes_it_for_where_views_are_interpolated() {
        let unknown = |rule, likelihood: &TouchModel| {
            with_pairing(rule, likelihood, |pairing, _| (pairing.value(None, 2), pairing.average))
        };
        let fine = TouchModel {
            interpolation: Interpolation::Cubic,
            shared_error: 0.0,
            unknown_similarity: Some(0.9),
            ..TouchModel::default()
        };
        let (got, average) = unknown(ActionRule::Information, &fine);
        // Edged in every second case.
        let least_alike = ((-0.1 / fine.temperature).exp() + 0.02 / 0.98 * average) / average;
        assert!((got - 0.5 * (0.8 + 0.2 * least_alike)).abs() < 1e-6 && got < 1.0, "{got}");
        // An average one, where none are interpolated or nothing is known of them.
        let coarse = TouchModel { interpolation: Interpolation::Nearest, ..fine };
        let average_one = TouchModel { unknown_similarity: None, ..fine };
        assert_eq!([coarse, average_one].map(|likelihood| unknown(ActionRule::Information, &likelihood).0), [1.0; 2]);
        let (paper, average) = unknown(ActionRule::Paper, &fine);
        assert_eq!(paper, average);
    }
}
