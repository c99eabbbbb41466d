//! Signs that a run has diverged: it stops while its last good checkpoint is still there.

use crate::config::TrainConfig;
use crate::history::Row;
use crate::validation::Validation;

/// Steps over which a loss or a gradient is averaged.
const WINDOW: usize = 100;

/// A loss this far above 4 tau ln N is not the loss of an untrained network: the cosine with the own peg is half a unit
/// below the others' mean.
const FAR_ABOVE: f64 = 2.0;

/// A gradient this many times the run's median has exploded, where it lasts.
const EXPLODED: f64 = 1e4;

/// Steps in a row for which it must last.
const EXPLODED_STEPS: usize = 20;

/// The spread of a collapsed embedding; an untrained network has about 0.3.
const COLLAPSED: f64 = 0.02;

/// A retrieval below this many times chance counts as chance: with 900 holes and 150 pegs its standard deviation is
/// a third of chance.
const NEAR_CHANCE: f64 = 2.0;

/// A sign of divergence, and what to try.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Divergence {
    /// What was seen, for people.
    pub seen: String,
    /// What to try, for people.
    pub advice: &'static str,
}

const LOWER_RATE: &str = "a lower learning_rate or a longer warmup";

/// A loss or a gradient that is not finite, before it changes any weight.
pub fn of_gradient(loss: f64, gradient_norm: f64) -> Option<Divergence> {
    if !loss.is_finite() {
        return Some(Divergence { seen: format!("the loss is not finite ({loss})"), advice: LOWER_RATE });
    }
    if !gradient_norm.is_finite() {
        let seen = format!("the gradient exploded: its length is not finite, at a loss of {loss:.3}");
        return Some(Divergence { seen, advice: LOWER_RATE });
    }
    None
}

/// What losses and gradients of all steps so far show.
pub fn of_steps(rows: &[Row], config: &TrainConfig) -> Option<Divergence> {
    let mean = |rows: &[Row]| rows.iter().map(|row| row.loss).sum::<f64>() / rows.len() as f64;
    if rows.len() >= 2 * WINDOW + config.n_warmup {
        let (first, last) = (mean(&rows[..WINDOW]), mean(&rows[rows.len() - WINDOW..]));
        let chance = config.chance_loss();
        if last > chance + FAR_ABOVE && last > first {
            let seen = format!(
                "the run diverged: over the last {WINDOW} steps the loss is {last:.2}, far above the {chance:.2} of a \
                 network that has learned nothing, and no better than the {first:.2} it began with"
            );
            return Some(Divergence { seen, advice: LOWER_RATE });
        }
    }
    if rows.len() >= WINDOW + EXPLODED_STEPS {
        let (before, last) = rows.split_at(rows.len() - EXPLODED_STEPS);
        let mut norms: Vec<f64> = before.iter().map(|row| row.gradient_norm).collect();
        let at = norms.len() / 2;
        let (_, median, _) = norms.select_nth_unstable_by(at, f64::total_cmp);
        let least = last.iter().map(|row| row.gradient_norm).fold(f64::INFINITY, f64::min);
        if *median > 0.0 && least > EXPLODED * *median {
            let seen = format!(
                "the gradient exploded: its length has been above {least:.1e} for {EXPLODED_STEPS} steps, and {median:.1e} \
                 was usual"
            );
            return Some(Divergence { seen, advice: LOWER_RATE });
        }
    }
    None
}

/// A tensor of the network that holds values that are not finite, by its name.
pub fn of_tensor(name: String) -> Divergence {
    Divergence { seen: format!("'{name}' holds values that are not finite"), advice: "a lower learning_rate" }
}

/// A network with finite weights whose embeddings of held-out views are not finite.
pub fn of_embeddings(validation: &Validation) -> Option<Divergence> {
    (!(validation.cosine_gap.is_finite() && validation.spread.is_finite())).then(|| Divergence {
        seen: "embeddings of held-out views are not finite: the weights have grown too large".into(),
        advice: LOWER_RATE,
    })
}

/// A collapsed embedding in two validations in a row, after the warm-up.
pub fn of_validations(rows: &[Row], config: &TrainConfig) -> Option<Divergence> {
    let mut latest =
        rows.iter().rev().filter(|row| row.step > config.n_warmup).filter_map(|row| row.validation.as_ref());
    let (last, before) = (latest.next()?, latest.next()?);
    let is_collapsed = [last, before].iter().all(|v| {
        v.n_holes > 0 && (v.spread <= COLLAPSED || v.spread.is_nan()) && v.retrieval_1 <= NEAR_CHANCE * v.chance_1
    });
    is_collapsed.then(|| Divergence {
        seen: format!(
            "the embedding collapsed: spread {:.3}, retrieval@1 {:.1} %, and chance is {:.1} %",
            last.spread,
            100.0 * last.retrieval_1,
            100.0 * last.chance_1
        ),
        advice: "a lower learning_rate, a higher temperature or a larger --batch",
    })
}

/// A warning at a validation: a run that may still recover, but has learned nothing so far.
pub fn concern(rows: &[Row], config: &TrainConfig) -> Option<String> {
    let last = rows.last()?;
    let validation = last.validation.as_ref()?;
    if validation.n_holes == 0 {
        let is_first = rows.iter().filter(|row| row.validation.is_some()).count() == 1;
        return is_first.then(|| "no board is held out, so the quality of this model is not measured".into());
    }
    let is_late = last.step > config.n_warmup.max(config.n_steps / 4).max(WINDOW);
    let is_chance = validation.retrieval_1 <= NEAR_CHANCE * validation.chance_1;
    (is_late && is_chance).then(|| {
        format!(
            "nothing learned yet: retrieval@1 {:.1} % at step {}, and chance is {:.1} %; try a lower learning_rate, a \
             temperature of 0.05 to 0.2 or a larger --batch",
            100.0 * validation.retrieval_1,
            last.step,
            100.0 * validation.chance_1
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(n: usize, loss: impl Fn(usize) -> f64, norm: impl Fn(usize) -> f64) -> Vec<Row> {
        (1..=n).map(|step| Row { step, loss: loss(step), gradient_norm: norm(step), ..Row::default() }).collect()
    }

    #[test]
    fn what_is_not_finite_is_named() {
        assert!(of_gradient(f64::NAN, 1.0).unwrap().seen.contains("loss"));
        assert!(of_gradient(2.0, f64::INFINITY).unwrap().seen.contains("gradient exploded"));
        assert_eq!(of_gradient(2.0, 1e30), None);
    }

    #[test]
    fn a_loss_that_rises_far_above_chance_is_divergence_and_a_high_start_is_not() {
        let config = TrainConfig { n_warmup: 10, ..TrainConfig::tiny() }; // 4 x 0.1 x ln 192 = 2.10
        let diverged = rows(300, |step| if step < 150 { 2.0 } else { 6.0 }, |_| 1.0);
        assert!(of_steps(&diverged, &config).unwrap().seen.contains("far above the 2.10"));
        assert_eq!(of_steps(&diverged[..170], &config), None);
        let falling = rows(300, |step| 8.0 - 0.01 * step as f64, |_| 1.0);
        assert_eq!(of_steps(&falling, &config), None);
    }

    #[test]
    fn nineteen_large_gradients_are_none_and_twenty_are_an_explosion() {
        let config = TrainConfig::tiny();
        let wild = |from: usize| rows(200, |_| 1.0, move |step| if step > from { 1e5 } else { 0.5 });
        assert!(of_steps(&wild(180), &config).unwrap().seen.contains("exploded"));
        assert_eq!(of_steps(&wild(181), &config), None);
    }

    #[test]
    fn embeddings_that_are_not_finite_are_named() {
        assert_eq!(of_embeddings(&Validation::default()), None);
        let broken = Validation { spread: f64::NAN, ..Validation::default() };
        assert!(of_embeddings(&broken).unwrap().seen.contains("not finite"));
    }

    #[test]
    fn a_collapse_needs_two_validations_after_the_warm_up() {
        let config = TrainConfig { n_warmup: 10, ..TrainConfig::tiny() };
        let validation = |spread: f64| Validation {
            spread,
            n_holes: 100,
            chance_1: 0.01,
            retrieval_1: 0.01,
            ..Validation::default()
        };
        let run = |spreads: [f64; 3]| {
            let mut rows = rows(15, |_| 1.0, |_| 1.0);
            for (at, spread) in [4, 11, 14].into_iter().zip(spreads) {
                rows[at].validation = Some(validation(spread));
            }
            of_validations(&rows, &config)
        };
        assert!(run([0.5, 0.0, 0.01]).unwrap().seen.contains("collapsed"));
        assert!(run([0.5, f64::NAN, f64::NAN]).is_some());
        assert_eq!(run([0.0, 0.3, 0.0]), None);
        assert_eq!(run([0.0, 0.0, 0.3]), None);
    }
}
