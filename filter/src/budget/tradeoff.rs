//! What was measured of each setting (`tradeoff.json`), and the choice of one within a budget.

use serde::{Deserialize, Serialize};
use tactile_data::grid::PoseGrid;

use super::settings::Settings;
use crate::error::{Error, Result};

/// The value of [`Tradeoff::schema`].
pub const SCHEMA: &str = "tactile-filter/tradeoff/1";

/// Settings measured on one scene, on one machine.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tradeoff {
    /// [`SCHEMA`].
    pub schema: String,
    /// Name of the scene, or of the recording of the holes.
    pub scene: String,
    /// Whether pegs and holes were recorded; else they were simulated, and the field is left out of the file. The intervals
    /// of recorded ones cover which touches an episode draws, not other sensors, parts or prints.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub recorded: bool,
    /// Where holes were touched: `on-grid` or `off-grid`.
    pub poses: String,
    /// Parts to choose from.
    pub n_classes: usize,
    /// Episodes behind each point.
    pub n_episodes: usize,
    /// Seeds of the episodes.
    pub seeds: Vec<u64>,
    /// The machine, as far as the system tells.
    pub machine: String,
    /// The command line that makes this again.
    pub command: String,
    /// A point for each setting and number of touches.
    pub points: Vec<Point>,
}

/// One setting after one number of touches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// The setting.
    pub settings: Settings,
    /// Touches made.
    pub n_touches: usize,
    /// Share of episodes that name the right part, 0..=1.
    pub accuracy: f64,
    /// Bounds of its 95 % interval.
    pub accuracy_ci95: [f64; 2],
    /// Mean distance to the true place where the part is right, mm.
    pub xy_mm_mean: f64,
    /// Mean angle to the true angle there, degrees.
    pub theta_deg_mean: f64,
    /// Median time of a whole decision (encode, update, choose) on one core, ms.
    pub decision_ms_p50: f64,
    /// 99 in 100 take no longer.
    pub decision_ms_p99: f64,
    /// Median time of a made-up decision ([`super::Pace`]) on the same core, ms: what another machine compares itself by.
    pub pace_ms: f64,
    /// What an episode of these touches holds, 10^6 bytes.
    pub memory_mb: f64,
    /// Whether another point is no worse in accuracy, time, touches and memory, and better in one.
    pub dominated: bool,
}

/// What there is to spend; `None`: as much as it takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Budget {
    /// Median time of a decision, ms.
    pub decision_ms: Option<f64>,
    /// Memory of an episode, 10^6 bytes.
    pub memory_mb: Option<f64>,
    /// Touches.
    pub max_touches: Option<usize>,
}

/// What a setting costs on this machine with this bank.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cost {
    /// Time of a made-up decision ([`super::Pace`]), ms.
    pub pace_ms: f64,
    /// Memory of an episode, 10^6 bytes.
    pub memory_mb: f64,
}

/// A setting chosen, with what it promises here.
#[derive(Clone, Debug, PartialEq)]
pub struct Choice {
    /// As it was measured.
    pub point: Point,
    /// Median time of a decision on this machine with this bank, ms.
    pub decision_ms: f64,
    /// Memory with this bank, 10^6 bytes.
    pub memory_mb: f64,
}

impl Tradeoff {
    /// Reads what [`serde_json`] wrote of one; `what` names it in an error.
    pub fn from_json(what: &str, text: &str) -> Result<Self> {
        let found: Self = serde_json::from_str(text).map_err(|e| Error::config(what, "a trade-off", e.to_string()))?;
        if found.schema != SCHEMA {
            return Err(Error::config(format!("{what}: schema"), SCHEMA, found.schema));
        }
        let finite = |p: &Point| {
            [p.accuracy, p.decision_ms_p50, p.pace_ms, p.memory_mb].iter().all(|x| x.is_finite() && *x >= 0.0)
        };
        match found.points.iter().position(|point| !finite(point) || point.pace_ms == 0.0) {
            Some(at) => Err(Error::config(format!("{what}: point {at}"), "numbers above zero", "another")),
            None => Ok(found),
        }
    }

    /// The distinct settings that were measured with a model and a bank of these steps, in order.
    pub fn settings_of(&self, model_sha256: &str, grid: &PoseGrid) -> Vec<&Settings> {
        let mut found: Vec<&Settings> = Vec::new();
        for Point { settings, .. } in &self.points {
            if settings.model_sha256 == model_sha256 && settings.is_of_grid(grid) && !found.contains(&settings) {
                found.push(settings);
            }
        }
        found
    }

    /// The most accurate point within a budget; of equals the fastest, then the one of fewest touches.
    ///
    /// `here` gives the cost of a setting and a number of touches; `None` for a setting that cannot be had here.
    ///
    /// # Errors
    /// No setting that can be had, or none within the budget: the error says what the least would be.
    pub fn choose(
        &self,
        budget: &Budget,
        here: &mut dyn FnMut(&Settings, usize) -> Result<Option<Cost>>,
    ) -> Result<Choice> {
        let mut choices = Vec::new();
        for point in &self.points {
            if let Some(Cost { pace_ms, memory_mb }) = here(&point.settings, point.n_touches)? {
                let decision_ms = point.decision_ms_p50 * pace_ms / point.pace_ms;
                choices.push(Choice { point: point.clone(), decision_ms, memory_mb });
            }
        }
        let least = |of: fn(&Choice) -> f64| choices.iter().map(of).fold(f64::INFINITY, f64::min);
        let (ms, mb) = (least(|c| c.decision_ms), least(|c| c.memory_mb));
        if choices.is_empty() {
            let expected = format!("a model and a bank that settings were measured with ({})", self.scene);
            return Err(Error::config("budget", expected, "others"));
        }
        let fits = |choice: &Choice| {
            budget.decision_ms.is_none_or(|most| choice.decision_ms <= most)
                && budget.memory_mb.is_none_or(|most| choice.memory_mb <= most)
                && budget.max_touches.is_none_or(|most| choice.point.n_touches <= most)
        };
        let better = |a: Choice, b: Choice| {
            let key = |c: &Choice| (-c.point.accuracy, c.decision_ms, c.point.n_touches as f64);
            if key(&b) < key(&a) { b } else { a }
        };
        choices.into_iter().filter(fits).reduce(better).ok_or_else(|| {
            let expected = format!("at least {ms:.2} ms, {mb:.1} MB and one touch, all within one setting");
            Error::config("budget", expected, budget.to_string())
        })
    }

    /// Marks the points that another one dominates.
    pub fn mark_dominated(&mut self) {
        let of = |p: &Point| [-p.accuracy, p.decision_ms_p50, p.n_touches as f64, p.memory_mb];
        let all: Vec<[f64; 4]> = self.points.iter().map(of).collect();
        let dominates = |a: &[f64; 4], b: &[f64; 4]| a.iter().zip(b).all(|(a, b)| a <= b) && a != b;
        for (point, mine) in self.points.iter_mut().zip(&all) {
            point.dominated = all.iter().any(|other| dominates(other, mine));
        }
    }

    /// The points that none dominates, of one model: what is shipped with it.
    pub fn frontier(&self, model_sha256: &str) -> Self {
        let keep = |p: &&Point| p.settings.model_sha256 == model_sha256;
        let mut of_model = Self { points: self.points.iter().filter(keep).cloned().collect(), ..self.clone() };
        of_model.mark_dominated();
        of_model.points.retain(|point| !point.dominated);
        of_model
    }
}

impl std::fmt::Display for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts = [
            self.decision_ms.map(|ms| format!("{ms} ms")),
            self.memory_mb.map(|mb| format!("{mb} MB")),
            self.max_touches.map(|n| format!("{n} touches")),
        ];
        f.write_str(&parts.into_iter().flatten().collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::super::settings::tests::settings;
    use super::*;
    use proptest::prelude::*;

    fn point(n_draws: usize, n_touches: usize, accuracy: f64, ms: f64, mb: f64) -> Point {
        Point {
            settings: Settings { n_draws, ..settings() },
            n_touches,
            accuracy,
            accuracy_ci95: [0.0, 1.0],
            xy_mm_mean: 0.0,
            theta_deg_mean: 0.0,
            decision_ms_p50: ms,
            decision_ms_p99: ms,
            pace_ms: ms / 2.0,
            memory_mb: mb,
            dominated: false,
        }
    }

    fn tradeoff(points: Vec<Point>) -> Tradeoff {
        let mut made = Tradeoff {
            schema: SCHEMA.into(),
            scene: "s".into(),
            recorded: false,
            poses: "off-grid".into(),
            n_classes: 2,
            n_episodes: 100,
            seeds: vec![1],
            machine: "m".into(),
            command: "c".into(),
            points,
        };
        made.mark_dominated();
        made
    }

    /// A machine that takes the same times as the one of the measurements, and as much memory.
    fn same(points: &[Point]) -> impl FnMut(&Settings, usize) -> Result<Option<Cost>> {
        let points = points.to_vec();
        move |settings, n_touches| {
            let found = points.iter().find(|p| p.settings == *settings && p.n_touches == n_touches);
            Ok(found.map(|p| Cost { pace_ms: p.pace_ms, memory_mb: p.memory_mb }))
        }
    }

    fn points() -> Vec<Point> {
        vec![
            point(1, 1, 0.5, 1.0, 10.0),
            point(1, 3, 0.7, 1.0, 12.0),
            point(9, 1, 0.5, 4.0, 10.0),
            point(9, 3, 0.9, 4.0, 12.0),
            point(99, 3, 0.9, 9.0, 12.0),
        ]
    }

    #[test]
    fn what_is_beaten_in_nothing_stays() {
        let dominated: Vec<bool> = tradeoff(points()).points.iter().map(|p| p.dominated).collect();
        assert_eq!(dominated, [false, false, true, false, true]);
        let shipped = tradeoff(points()).frontier("ab");
        assert_eq!(shipped.points.iter().map(|p| p.accuracy).collect::<Vec<_>>(), [0.5, 0.7, 0.9]);
        assert!(tradeoff(points()).frontier("another").points.is_empty());
    }

    #[test]
    fn the_most_accurate_within_the_budget_is_chosen() {
        let choose = |decision_ms, max_touches| {
            let budget = Budget { decision_ms, memory_mb: None, max_touches };
            let choice = tradeoff(points()).choose(&budget, &mut same(&points()))?;
            Ok::<_, Error>((choice.point.settings.n_draws, choice.point.n_touches))
        };
        assert_eq!(choose(None, None).unwrap(), (9, 3));
        assert_eq!(choose(Some(3.9), None).unwrap(), (1, 3));
        assert_eq!(choose(Some(100.0), Some(2)).unwrap(), (1, 1));
        let error = choose(Some(0.5), None).unwrap_err().to_string();
        assert_eq!(
            error,
            "budget: expected at least 1.00 ms, 10.0 MB and one touch, all within one setting, got 0.5 ms"
        );
    }

    #[test]
    fn a_slower_machine_is_promised_longer_times() {
        let budget = Budget { decision_ms: Some(4.0), ..Budget::default() };
        let mut slow = |_: &Settings, _: usize| Ok(Some(Cost { pace_ms: 4.5, memory_mb: 11.0 }));
        // Paces of 4.5 ms where 0.5, 2 and 4.5 were measured: 9, 9 and 9 ms.
        assert!(tradeoff(points()).choose(&budget, &mut slow).unwrap_err().to_string().contains("at least 9.00 ms"));
        let mut other_bank = |_: &Settings, _: usize| Ok(None);
        assert!(tradeoff(points()).choose(&budget, &mut other_bank).unwrap_err().to_string().contains("others"));
    }

    proptest! {
        /// By trying them all: nothing chosen breaks the budget, and nothing within it is more accurate.
        #[test]
        fn a_choice_keeps_its_budget_and_none_within_it_is_better(
            raw in prop::collection::vec((1usize..4, 0u8..20, 1u8..50, 1u8..50), 1..12),
            ms in 1u8..60, mb in 1u8..60, touches in 1usize..5,
        ) {
            let points: Vec<Point> = raw.iter().enumerate()
                .map(|(i, (n, a, ms, mb))| point(i + 1, *n, f64::from(*a) / 20.0, f64::from(*ms), f64::from(*mb)))
                .collect();
            let budget = Budget {
                decision_ms: Some(f64::from(ms)), memory_mb: Some(f64::from(mb)), max_touches: Some(touches),
            };
            let fits = |p: &&Point| {
                p.decision_ms_p50 <= f64::from(ms) && p.memory_mb <= f64::from(mb) && p.n_touches <= touches
            };
            let best = points.iter().filter(fits).map(|p| p.accuracy).reduce(f64::max);
            match tradeoff(points.clone()).choose(&budget, &mut same(&points)) {
                Ok(choice) => prop_assert!(fits(&&choice.point) && Some(choice.point.accuracy) == best),
                Err(_) => prop_assert!(best.is_none()),
            }
        }
    }

    #[test]
    fn a_file_is_read_back_and_a_foreign_one_refused() {
        let made = tradeoff(points());
        let text = serde_json::to_string(&made).unwrap();
        assert_eq!(Tradeoff::from_json("f", &text).unwrap(), made);
        let foreign = text.replace(SCHEMA, "other/1");
        assert!(Tradeoff::from_json("f", &foreign).unwrap_err().to_string().starts_with("f: schema: expected"));
        let broken = text.replace("\"pace_ms\":0.5", "\"pace_ms\":0.0");
        assert_eq!(
            Tradeoff::from_json("f", &broken).unwrap_err().to_string(),
            "f: point 0: expected numbers above zero, got another"
        );
    }
}
