//! How a recorded view counts against the view that would be touched.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_infer::Bank;

use super::inputs::ChoiceInputs;
use super::rule::ActionRule;
use crate::likelihood::{Felt, Foreseen, TouchLikelihood};
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
    /// The likelihood that the filter will weigh them by, of a touch like those so far, as far as that touch is new.
    Odds { felt: Felt, new_share: f64 },
}

impl<'a> Pairing<'a> {
    pub(super) fn new(inputs: &ChoiceInputs<'a>, rng: &mut ChaCha8Rng) -> Self {
        let ChoiceInputs { config, model, bank, belief, .. } = *inputs;
        if config.method.rule == ActionRule::Paper {
            let temperature = model.temperature.unwrap_or(PAPER_TEMPERATURE);
            let pairing = Self { model, bank, by: By::Paper { temperature, average: 1.0 } };
            let average = pairing.mean_of_pairs(rng);
            return Self { by: By::Paper { temperature, average }, ..pairing };
        }
        let edged = || belief.touches().iter().map(|touch| &touch.likelihood).filter(|touch| !touch.blank);
        let mean = |of: fn(&TouchLikelihood) -> f64| edged().map(of).sum::<f64>() / edged().count().max(1) as f64;
        let own_distance = belief.touches().first().map_or(model.own_distance, |touch| touch.likelihood.own_distance);
        let felt = Felt { rarity: mean(|touch| touch.rarity), own_distance, unknown: mean(|touch| touch.unknown) };
        Self { model, bank, by: By::Odds { felt, new_share: 1.0 } }
    }

    /// The same where so much of the touch would be new, 0..=1; the paper's rule does not ask.
    pub(super) fn with_new_share(self, new_share: f64) -> Self {
        match self.by {
            By::Paper { .. } => self,
            By::Odds { felt, .. } => Self { by: By::Odds { felt, new_share }, ..self },
        }
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
            By::Odds { felt, new_share } => {
                let edge_share = self.bank.edge_shares()[touched];
                Foreseen::new(self.model, felt, edge_share, new_share).likely(cosines)
            }
        }
    }

    /// What a state adds by the ratio of its view and how far that is trusted; `None`: its view is unknown.
    pub(super) fn mixed(&self, view: Option<(f64, f64)>) -> f64 {
        match (self.by, view) {
            (By::Paper { average, .. }, None) => average,
            (By::Paper { .. }, Some((ratio, _))) => ratio,
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
    use crate::likelihood::interpolation::Interpolation;
    use crate::touch::Observation;
    use rand::SeedableRng;

    /// What is made of a bank whose rows all show edges, once one of them was touched.
    fn with_pairing<T>(rule: ActionRule, model: &TouchModel, take: impl FnOnce(&Pairing) -> T) -> T {
        let bank = bank(0.2);
        let touch = Observation { rarity: 0.75, ..Observation::new(bank.row(2).into_owned(), 0.2) };
        let touch = TouchLikelihood::new(&touch, &bank, model).unwrap();
        let belief = Belief::new(&bank, EngineConfig::Exact, 1, 1, touch);
        let config = EpisodeConfig::default().changed(|_, _, method| method.rule = rule);
        let inputs =
            ChoiceInputs { config: &config, model, belief: &belief, bank: &bank, candidates: &[], unfelt: None };
        take(&Pairing::new(&inputs, &mut ChaCha8Rng::seed_from_u64(1)))
    }

    fn average(pairing: &Pairing) -> f64 {
        let By::Paper { average, .. } = pairing.by else { panic!("not the paper's rule") };
        average
    }

    #[test]
    fn the_papers_score_agrees_with_hand_arithmetic() {
        let model = TouchModel { temperature: Some(0.5), ..TouchModel::paper() };
        with_pairing(ActionRule::Paper, &model, |pairing| {
            // 1 / exp(cos / tau), scaled by exp(-1 / tau): cosines -1, 0 and 1.
            for (row, cosine) in [(5, -1.0_f64), (1, 0.0), (2, 1.0)] {
                assert!((pairing.value(Some((row, 1.0)), 2) - (-(cosine + 1.0) / 0.5).exp()).abs() < 1e-6);
            }
            assert_eq!(pairing.value(None, 2), average(pairing));
            // Of two rows at random 5 in 18 pairs are alike and 1 in 18 opposite.
            let mean = (-4.0_f64).exp() * 5.0 / 18.0 + (-2.0_f64).exp() * 12.0 / 18.0 + 1.0 / 18.0;
            // The standard error of the mean of 256 is 0.014; four of those.
            assert!((average(pairing) - mean).abs() < 0.056, "{} {mean}", average(pairing));
        });
    }

    #[test]
    fn the_papers_rule_has_its_own_temperature_where_the_model_has_none() {
        let value = |temperature| {
            let model = TouchModel { temperature, ..TouchModel::default() };
            with_pairing(ActionRule::Paper, &model, |pairing| pairing.value(Some((1, 1.0)), 2))
        };
        assert_eq!(value(None), value(Some(PAPER_TEMPERATURE)));
        assert!(value(None) != value(Some(2.0 * PAPER_TEMPERATURE)));
    }

    #[test]
    fn a_view_counts_as_the_filter_will_weigh_it_with_the_touch_made() {
        let model = TouchModel { steepness: 4.0, ..TouchModel::default() };
        let value = |model: &TouchModel, new_share, row| {
            let value = |pairing: &Pairing| pairing.with_new_share(new_share).value(Some((row, 1.0)), 2);
            with_pairing(ActionRule::Information, model, value)
        };
        // As rare as the touch made, as far from its own view as touches are, as edged as the view.
        let steepness = 4.0 * (0.203_f64 / 0.05).powf(model.steepness_by_edge);
        let own = model.own_distance;
        let odds = |distance: f64| 0.995 * (model.match_offset + 0.75 - steepness * (distance - own)).exp();
        // The touch made was at one of six rows of cosines 1, 0 (four times) and -1.
        let unknown = (odds(0.0) + 4.0 * odds(2.0_f64.sqrt()) + odds(2.0)) / 6.0 + 0.005;
        for (row, cosine) in [(5, -1.0_f64), (1, 0.0), (2, 1.0)] {
            let apart = (2.0 * (1.0 - cosine) + own * own).sqrt();
            let [odds, outliers] = [odds(apart) / unknown, 0.005 / unknown];
            for new_share in [1.0, 0.5] {
                let (got, by_hand) = (value(&model, new_share, row), odds.powf(new_share) + outliers.powf(new_share));
                assert!((got / by_hand - 1.0).abs() < 1e-5, "{got} {by_hand}");
            }
        }
    }

    #[test]
    fn an_unknown_view_is_worth_what_nobody_recorded_and_what_is_half_trusted_half_of_it() {
        for interpolation in [Interpolation::Cubic, Interpolation::Nearest] {
            let model = TouchModel { interpolation, ..TouchModel::default() };
            with_pairing(ActionRule::Information, &model, |pairing| {
                let known = pairing.value(Some((2, 1.0)), 2);
                assert_eq!(pairing.value(None, 2), 1.0);
                assert!((pairing.value(Some((2, 0.25)), 2) - (0.25 * known + 0.75)).abs() < 1e-12 * known);
            });
            with_pairing(ActionRule::Paper, &model, |pairing| {
                assert_eq!(pairing.value(None, 2), average(pairing));
                // Alg. 1 trusts every view.
                assert_eq!(pairing.value(Some((1, 0.25)), 2), pairing.value(Some((1, 1.0)), 2));
            });
        }
    }
}
