//! How a recorded view counts against the view that would be touched.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_infer::Bank;

use super::inputs::ChoiceInputs;
use super::rule::ActionRule;
use crate::likelihood::unrecorded;
use crate::simd;
use crate::touch_model::TouchModel;

/// How a recorded view counts against the view that would be touched.
#[derive(Clone, Copy)]
pub(super) struct Pairing<'a> {
    rule: ActionRule,
    model: &'a TouchModel,
    bank: &'a Bank,
    /// Temperature, what a view of any cosine adds, and agreement and disagreement of blank views, as they count together
    /// with the touches made.
    temperature: f64,
    floor: f64,
    agrees: f64,
    disagrees: f64,
    /// What [`Self::similarity`] is over edged views at random.
    average: f64,
    /// What a state whose view is unknown adds where an edged one would be seen.
    unknown: f64,
}

impl<'a> Pairing<'a> {
    pub(super) fn new(inputs: &ChoiceInputs<'a>, rng: &mut ChaCha8Rng) -> Self {
        let ChoiceInputs { config, model, bank, belief, .. } = *inputs;
        let joint = belief.joint_weight(1.0, None);
        let TouchModel { temperature, outlier_share, blank_agreement, unknown_similarity, .. } = *model;
        let mut pairing = Self {
            rule: config.method.rule,
            model,
            bank,
            temperature: temperature / joint,
            floor: 0.0,
            agrees: blank_agreement.powf(joint),
            disagrees: (1.0 - blank_agreement).powf(joint),
            average: 1.0,
            unknown: 1.0,
        };
        let felt: Vec<f64> = belief.touches().iter().filter_map(|touch| touch.likelihood.mean_match()).collect();
        if felt.is_empty() || config.method.rule == ActionRule::Paper {
            pairing.average = pairing.mean_of_pairs(rng);
            pairing.floor = outlier_share * pairing.average;
        } else {
            // What the filter measured matches by.
            let mean = felt.iter().sum::<f64>() / felt.len() as f64;
            pairing.average = mean.powf(joint);
            pairing.floor = (outlier_share / (1.0 - outlier_share) * mean).powf(joint);
        }
        pairing.unknown = match (config.method.rule, unknown_similarity) {
            (ActionRule::Paper, _) => pairing.average,
            (_, Some(cosine)) if model.interpolation.is_cubic(bank.grid()) => {
                (1.0 - unrecorded::blank_share(bank, model)).powf(joint)
                    * unrecorded::likely(pairing.likely(cosine) / pairing.average)
            }
            _ => 1.0,
        };
        pairing
    }

    /// The mean of [`Self::similarity`] over pairs of edged views; 1 where there is none.
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
        (0..N_SAMPLED).map(|_| self.similarity(any(), any())).sum::<f64>() / N_SAMPLED as f64
    }

    /// For the paper's rule 1 / f_PP, scaled so that it cannot overflow; else the filter's likelihood of
    /// seeing one view where the other is recorded, without its blank part.
    fn similarity(&self, row_a: usize, row_b: usize) -> f64 {
        self.of_cosine(f64::from(self.bank.peg_similarity(row_a, row_b)).clamp(-1.0, 1.0))
    }

    /// [`Self::similarity`] of two rows of a cosine.
    fn of_cosine(&self, cosine: f64) -> f64 {
        match self.rule {
            ActionRule::Paper => (-(cosine + 1.0) / self.temperature).exp(),
            _ => self.likely(cosine),
        }
    }

    /// [`Self::similarity`] of one row with some others.
    fn similarities(&self, touched: usize, rows: &[usize]) -> Vec<f64> {
        let cosines = self.bank.rows().cosines(touched, rows);
        let cosines = cosines.into_iter().map(|cosine| f64::from(cosine).clamp(-1.0, 1.0));
        if self.rule == ActionRule::Paper {
            return cosines.map(|cosine| self.of_cosine(cosine)).collect();
        }
        // As [`Self::likely`] finds each.
        let logs: Vec<f64> = cosines.map(|cosine| (cosine - 1.0) / self.temperature).collect();
        let mut likely = simd::powers(&logs, 0.0, 1.0);
        likely.iter_mut().for_each(|likely| *likely += self.floor);
        likely
    }

    /// The filter's likelihood of a view of this cosine, relative to its likelihood of the same view.
    fn likely(&self, cosine: f64) -> f64 {
        simd::power((cosine - 1.0) / self.temperature, 0.0, 1.0) + self.floor
    }

    /// What a state whose recorded view (row, trust) is `view` adds, where the edged row `touched` would be seen.
    pub(super) fn value(&self, view: Option<(usize, f64)>, touched: usize) -> f64 {
        self.mixed(view.map(|(row, trust)| (self.ratio(row, touched, self.similarity(row, touched)), trust)))
    }

    /// What states add whose views are these rows, where the edged row `touched` would be seen.
    pub(super) fn ratios(&self, rows: &[usize], touched: usize) -> Vec<f64> {
        let similarities = self.similarities(touched, rows);
        rows.iter().zip(similarities).map(|(row, similarity)| self.ratio(*row, touched, similarity)).collect()
    }

    /// What a state whose view is the row `row` adds, where the edged row `touched` would be seen, by their similarity.
    fn ratio(&self, row: usize, touched: usize, similarity: f64) -> f64 {
        if self.rule == ActionRule::Paper {
            return similarity;
        }
        let is_blank = |row: usize| self.model.is_blank(self.bank.edge_shares()[row]);
        match (is_blank(row), is_blank(touched)) {
            (false, false) => self.agrees * similarity / self.average,
            (true, true) => self.agrees,
            _ => self.disagrees,
        }
    }

    /// What a state adds by the [`Self::ratio`] of its view and how far that is trusted; `None`: its view is unknown.
    pub(super) fn mixed(&self, view: Option<(f64, f64)>) -> f64 {
        match (self.rule, view) {
            (_, None) => self.unknown,
            (ActionRule::Paper, Some((ratio, _))) => ratio,
            (_, Some((ratio, trust))) => trust * ratio + (1.0 - trust) * self.unknown,
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
