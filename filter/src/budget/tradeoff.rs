//! What was measured of each setting (`tradeoff.json`), and the choice of one within a budget.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;
use tactile_infer::Model;

use super::halves::{Half, Halves};
use super::setup::{Knob, Setup};
use super::speeds::Speeds;
use crate::error::{Error, Result};

/// The value of [`Tradeoff::schema`].
pub const SCHEMA: &str = "tactile-filter/tradeoff/2";

/// Setup measured on one scene, on one machine.
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
    /// How long the robot takes, by which points dominate each other.
    pub speeds: Speeds,
    /// A point for each setting and number of touches.
    pub points: Vec<Point>,
}

/// One setting after one number of touches.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// The setting.
    pub settings: Setup,
    /// Touches made.
    pub n_touches: usize,
    /// Share of all episodes that name the right part after these touches, sure or not, 0..=1.
    pub accuracy: f64,
    /// Bounds of its 95 % interval.
    pub accuracy_ci95: [f64; 2],
    /// How many were right, and sure of it, and what the robot spent, in each half of the episodes.
    pub halves: Halves,
    /// The same settings with holes whose part the bank lacks; `None` where they were not touched.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub strangers: Option<Strangers>,
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
    /// Whether another point with the same rate of strangers is no worse in episodes decided and right, in robot seconds for each
    /// of these (both of the choosing half) and in time, and better in one.
    pub dominated: bool,
}

/// Episodes of holes whose part the bank lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Strangers {
    /// Episodes.
    pub n_episodes: usize,
    /// How many the stopping rule ended, by so many touches, sure of a part.
    pub n_named: usize,
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
    /// Robot seconds of an episode, mean.
    pub robot_s: Option<f64>,
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
    /// Robot seconds of an episode, mean, by the half that chooses.
    pub robot_s: f64,
    /// Median time of a decision on this machine with this bank, ms.
    pub decision_ms: f64,
    /// Memory with this bank, 10^6 bytes.
    pub memory_mb: f64,
}

impl Point {
    /// What chooses, the more the better: the shares of the choosing half that are decided and right, and right.
    fn worth(&self) -> [f64; 2] {
        let Halves { choosing, .. } = self.halves;
        [choosing.decided_and_right(), choosing.accuracy()]
    }
}

impl Tradeoff {
    /// Reads what [`serde_json`] wrote of one; `what` names it in an error.
    ///
    /// # Errors
    /// Another schema, numbers that are none, counts of more episodes than there are.
    pub fn from_json(what: &str, text: &str) -> Result<Self> {
        let refused = |e: serde_json::Error| Error::config(what, "a trade-off", e.to_string());
        let Schema { schema } = serde_json::from_str(text).map_err(refused)?;
        if schema != SCHEMA {
            return Err(Error::config(format!("{what}: schema"), SCHEMA, schema));
        }
        let found: Self = serde_json::from_str(text).map_err(refused)?;
        found.speeds.validate()?;
        let finite = |p: &Point| {
            [p.accuracy, p.decision_ms_p50, p.pace_ms, p.memory_mb].iter().all(|x| x.is_finite() && *x >= 0.0)
        };
        let counted = |p: &Point| {
            p.halves.add_up() && p.strangers.is_none_or(|of| of.n_named <= of.n_episodes && of.n_episodes > 0)
        };
        let points = &found.points;
        if let Some(at) = points.iter().position(|point| !finite(point) || point.pace_ms == 0.0) {
            return Err(Error::config(format!("{what}: point {at}"), "numbers above zero", "another"));
        }
        match points.iter().position(|point| !counted(point)) {
            Some(at) => {
                let expected = "counts of some of their episodes";
                Err(Error::config(format!("{what}: point {at}"), expected, "others"))
            }
            None => Ok(found),
        }
    }

    /// The distinct settings that were measured with a model, its maps if it has any, a bank of these steps and this rate of
    /// strangers, in order.
    pub fn settings_of(&self, model: &Model, grid: &PoseGrid, false_accept: Option<f64>) -> Vec<&Setup> {
        let mut found: Vec<&Setup> = Vec::new();
        for Point { settings, .. } in &self.points {
            let is_of_model =
                *settings.model_sha256 == **model.sha256() && settings.verify.is_some() == model.maps().is_some();
            let is_asked = is_of_model && settings.is_of_grid(grid) && settings.false_accept == false_accept;
            if is_asked && !found.contains(&settings) {
                found.push(settings);
            }
        }
        found
    }

    /// The point within a budget with which most episodes of the choosing half end sure and right by the stopping rule;
    /// of equals the most accurate there, then the fastest, then the one of fewest touches. What to expect of it is what the
    /// other half found ([`Halves::promising`]). Robot seconds are by `speeds`.
    ///
    /// `here` gives the cost of a setting and a number of touches; `None` for a setting that cannot be had here.
    ///
    /// # Errors
    /// No setting that can be had, or none within the budget: the error says what the least would be.
    pub fn choose(
        &self,
        budget: &Budget,
        speeds: &Speeds,
        here: &mut dyn FnMut(&Setup, usize) -> Result<Option<Cost>>,
    ) -> Result<Choice> {
        let mut choices = Vec::new();
        for point in &self.points {
            if let Some(Cost { pace_ms, memory_mb }) = here(&point.settings, point.n_touches)? {
                let decision_ms = point.decision_ms_p50 * pace_ms / point.pace_ms;
                let robot_s = point.halves.choosing.seconds(speeds);
                choices.push(Choice { point: point.clone(), robot_s, decision_ms, memory_mb });
            }
        }
        let least = |of: fn(&Choice) -> f64| choices.iter().map(of).fold(f64::INFINITY, f64::min);
        let [ms, mb, s] = [least(|c| c.decision_ms), least(|c| c.memory_mb), least(|c| c.robot_s)];
        if choices.is_empty() {
            let (banks, rates) = (self.told(Knob::BankStep), self.told(Knob::Risk));
            let expected = format!(
                "a model, a bank and a rate that settings were measured with ({}; {banks}; {rates})",
                self.scene
            );
            return Err(Error::config("budget", expected, "others"));
        }
        let fits = |choice: &Choice| {
            budget.decision_ms.is_none_or(|most| choice.decision_ms <= most)
                && budget.memory_mb.is_none_or(|most| choice.memory_mb <= most)
                && budget.max_touches.is_none_or(|most| choice.point.n_touches <= most)
                && budget.robot_s.is_none_or(|most| choice.robot_s <= most)
        };
        let better = |a: Choice, b: Choice| {
            let key = |c: &Choice| (c.point.worth().map(|share| -share), c.decision_ms, c.point.n_touches);
            if key(&b) < key(&a) { b } else { a }
        };
        choices.into_iter().filter(fits).reduce(better).ok_or_else(|| {
            let expected =
                format!("at least {ms:.2} ms, {mb:.1} MB, {s:.1} robot seconds and one touch, all within one setting");
            Error::config("budget", expected, budget.to_string())
        })
    }

    /// The values of a knob that were measured, in words.
    fn told(&self, knob: Knob) -> String {
        let mut told: Vec<String> = Vec::new();
        for value in self.points.iter().map(|point| point.settings.tell(knob)) {
            if !told.contains(&value) {
                told.push(value);
            }
        }
        told.join(", ")
    }

    /// Marks the points that another one dominates ([`Point::dominated`]).
    pub fn mark_dominated(&mut self) {
        let decided = |p: &Point| {
            let of = p.halves.choosing;
            vec![-of.decided_and_right(), p.decision_ms_p50, of.seconds_by_decided(&self.speeds)]
        };
        let dominated = self.dominated_in(decided);
        for (point, dominated) in self.points.iter_mut().zip(dominated) {
            point.dominated = dominated;
        }
    }

    /// What is shipped with a model: its settings of which some point can be the best within a budget, with all their points.
    pub fn frontier(&self, model_sha256: &str) -> Self {
        let keep = |p: &&Point| p.settings.model_sha256 == model_sha256;
        let mut of_model = Self { points: self.points.iter().filter(keep).cloned().collect(), ..self.clone() };
        of_model.mark_dominated();
        let chosen = |p: &Point| {
            let ([decided, right], Half { touches, travel_mm, .. }) = (p.worth(), p.halves.choosing);
            vec![-decided, -right, p.decision_ms_p50, p.memory_mb, p.n_touches as f64, touches as f64, travel_mm]
        };
        let dominated = of_model.dominated_in(chosen);
        let best = of_model.points.iter().zip(dominated).filter(|(_, dominated)| !dominated);
        let kept: Vec<Setup> = best.map(|(point, _)| point.settings.clone()).collect();
        of_model.points.retain(|point| kept.contains(&point.settings));
        of_model
    }

    /// For each point whether another one with the same rate of strangers is no higher in any of these, and lower in one.
    fn dominated_in(&self, least: impl Fn(&Point) -> Vec<f64>) -> Vec<bool> {
        let all: Vec<(Option<f64>, Vec<f64>)> =
            self.points.iter().map(|point| (point.settings.false_accept, least(point))).collect();
        let is_beaten = |(rate, mine): &(Option<f64>, Vec<f64>)| {
            let no_worse = |other: &[f64]| other.iter().zip(mine).all(|(a, b)| a <= b) && other != mine;
            all.iter().any(|(of, other)| of == rate && no_worse(other))
        };
        all.iter().map(is_beaten).collect()
    }
}

/// What is read of a file first.
#[derive(Deserialize)]
struct Schema {
    schema: String,
}

impl std::fmt::Display for Budget {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let parts = [
            self.decision_ms.map(|ms| format!("{ms} ms")),
            self.memory_mb.map(|mb| format!("{mb} MB")),
            self.max_touches.map(|n| format!("{n} touches")),
            self.robot_s.map(|s| format!("{s} robot seconds")),
        ];
        f.write_str(&parts.into_iter().flatten().collect::<Vec<_>>().join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::super::setup::tests::settings;
    use super::*;
    use proptest::prelude::*;

    /// Halves of 20 episodes each of which so many ended sure and right, as many touches each.
    fn halves(accuracy: f64, touches: [usize; 2], n_decided: [usize; 2]) -> Halves {
        let n_right = (20.0 * accuracy).round() as usize;
        let half = |n: usize, touches: usize| Half {
            n_episodes: 20,
            n_right,
            n_decided: n,
            n_decided_and_right: n,
            touches: 20 * touches,
            travel_mm: 0.0,
        };
        Halves { choosing: half(n_decided[0], touches[0]), promising: half(n_decided[1], touches[1]) }
    }

    fn point(n_draws: usize, n_touches: usize, accuracy: f64, ms: f64, mb: f64) -> Point {
        Point {
            settings: Setup { n_draws, ..settings() },
            n_touches,
            accuracy,
            accuracy_ci95: [0.0, 1.0],
            halves: halves(accuracy, [n_touches; 2], [(20.0 * accuracy).round() as usize; 2]),
            strangers: None,
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
            speeds: Speeds::default(),
            points,
        };
        made.mark_dominated();
        made
    }

    /// A machine that takes the same times as the one of the measurements, and as much memory.
    fn same(points: &[Point]) -> impl FnMut(&Setup, usize) -> Result<Option<Cost>> {
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
        // The beaten point of a setting that is the best with more touches stays, too.
        assert_eq!(shipped.points.iter().map(|p| p.accuracy).collect::<Vec<_>>(), [0.5, 0.7, 0.5, 0.9]);
        assert!(tradeoff(points()).frontier("another").points.is_empty());
    }

    #[test]
    fn the_most_accurate_within_the_budget_is_chosen() {
        let choose = |decision_ms, max_touches| {
            let budget = Budget { decision_ms, max_touches, ..Budget::default() };
            let choice = tradeoff(points()).choose(&budget, &Speeds::default(), &mut same(&points()))?;
            Ok::<_, Error>((choice.point.settings.n_draws, choice.point.n_touches))
        };
        assert_eq!(choose(None, None).unwrap(), (9, 3));
        assert_eq!(choose(Some(3.9), None).unwrap(), (1, 3));
        assert_eq!(choose(Some(100.0), Some(2)).unwrap(), (1, 1));
        let error = choose(Some(0.5), None).unwrap_err().to_string();
        assert_eq!(
            error,
            "budget: expected at least 1.00 ms, 10.0 MB, 3.0 robot seconds and one touch, all within one setting, got 0.5 ms"
        );
        // A bank of other steps than any that was measured.
        let (budget, speeds) = (Budget::default(), Speeds::default());
        let error = tradeoff(points()).choose(&budget, &speeds, &mut |_, _| Ok(None)).unwrap_err().to_string();
        assert!(error.contains("(s; bank of 2 mm, 15°; 1 % of strangers)"), "{error}");
        // Three touches take 9 s, or 4.5 s where one takes half as long.
        let within = |robot_s, touch_s| {
            let budget = Budget { robot_s: Some(robot_s), ..Budget::default() };
            let speeds = Speeds { touch_s, ..Speeds::default() };
            tradeoff(points()).choose(&budget, &speeds, &mut same(&points())).unwrap().point.n_touches
        };
        assert_eq!([within(8.0, 3.0), within(9.0, 3.0), within(8.0, 1.5)], [1, 3, 3]);
    }

    /// A point whose choosing half and whose other half ended so many of 20 episodes sure and right.
    fn decided(point: Point, choosing: usize, promising: usize) -> Point {
        Point { halves: halves(point.accuracy, [point.n_touches; 2], [choosing, promising]), ..point }
    }

    #[test]
    fn a_part_named_without_being_sure_does_not_choose() {
        let points = vec![
            decided(point(1, 2, 1.0, 1.0, 10.0), 12, 20),
            decided(point(1, 4, 0.95, 1.0, 12.0), 19, 18),
            decided(point(9, 2, 0.9, 2.0, 10.0), 14, 13),
            decided(point(9, 4, 1.0, 2.0, 12.0), 19, 17),
            decided(point(99, 4, 1.0, 3.0, 12.0), 19, 20),
        ];
        let choose = |points: &[Point], max_touches| {
            let budget = Budget { max_touches, ..Budget::default() };
            tradeoff(points.to_vec()).choose(&budget, &Speeds::default(), &mut same(points)).unwrap().point
        };
        // 19 of 20 three times: the more accurate, then the faster; the other half has no voice.
        assert_eq!(choose(&points, None).settings.n_draws, 9);
        assert_eq!(choose(&points, None).halves.promising.decided_and_right(), 0.85);
        assert_eq!(choose(&points, Some(2)).settings.n_draws, 9);
        let kept: Vec<bool> = tradeoff(points).points.iter().map(|p| !p.dominated).collect();
        assert_eq!(kept, [true, true, true, false, false]);
    }

    #[test]
    fn a_slower_machine_is_promised_longer_times() {
        let budget = Budget { decision_ms: Some(4.0), ..Budget::default() };
        let mut slow = |_: &Setup, _: usize| Ok(Some(Cost { pace_ms: 4.5, memory_mb: 11.0 }));
        // Paces of 4.5 ms where 0.5, 2 and 4.5 were measured: 9, 9 and 9 ms.
        let refused = tradeoff(points()).choose(&budget, &Speeds::default(), &mut slow).unwrap_err().to_string();
        assert!(refused.contains("at least 9.00 ms"), "{refused}");
    }

    /// What decides few within two touches and most within six costs more robot seconds for each that it decides.
    #[test]
    fn a_limit_that_decides_few_is_dominated_by_its_own_setting() {
        let few = Point { halves: halves(0.9, [2, 2], [4, 4]), ..point(1, 2, 0.9, 1.0, 10.0) };
        let most = Point { halves: halves(0.9, [4, 4], [18, 18]), ..point(1, 6, 0.9, 1.0, 14.0) };
        let rarer = Setup { false_accept: Some(0.001), ..few.settings.clone() };
        let other_rate = Point { settings: rarer, halves: halves(0.9, [6, 6], [10, 10]), ..most.clone() };
        let made = tradeoff(vec![few, most, other_rate]);
        assert_eq!(made.points.iter().map(|p| p.dominated).collect::<Vec<_>>(), [true, false, false]);
        // A budget of two touches still finds it.
        assert_eq!(made.frontier("ab").points.len(), 3);
        assert_eq!(made.points[0].halves.choosing.seconds_by_decided(&Speeds::default()), 30.0);
    }

    proptest! {
        /// By trying them all: nothing chosen breaks the budget, and nothing within it decides more.
        #[test]
        fn a_choice_keeps_its_budget_and_none_within_it_is_better(
            raw in prop::collection::vec((1usize..4, 0u8..20, 1u8..50, 1u8..50), 1..12), seed in 0usize..400,
            ms in 1u8..60, mb in 1u8..60, touches in 1usize..5, with_halves: bool,
        ) {
            let points: Vec<Point> = raw.iter().enumerate()
                .map(|(i, (n, a, ms, mb))| point(i + 1, *n, f64::from(*a) / 20.0, f64::from(*ms), f64::from(*mb)))
                .enumerate()
                .map(|(i, p)| if with_halves { decided(p, (seed * (i + 3)) % 21, (seed + i) % 21) } else { p })
                .collect();
            let budget = Budget {
                decision_ms: Some(f64::from(ms)), memory_mb: Some(f64::from(mb)), max_touches: Some(touches), robot_s: None,
            };
            let speeds = Speeds::default();
            let fits = |p: &&Point| {
                p.decision_ms_p50 <= f64::from(ms) && p.memory_mb <= f64::from(mb) && p.n_touches <= touches
            };
            let worth = |p: &Point| p.halves.choosing.n_decided_and_right as f64;
            let best = points.iter().filter(fits).map(worth).reduce(f64::max);
            let made = tradeoff(points.clone());
            match made.choose(&budget, &speeds, &mut same(&points)) {
                Ok(choice) => prop_assert!(fits(&&choice.point) && Some(worth(&choice.point)) == best),
                Err(_) => prop_assert!(best.is_none()),
            }
            // What is shipped holds what would be chosen of all.
            let [of_all, of_shipped] = [&made, &made.frontier("ab")].map(|of| of.choose(&budget, &speeds, &mut same(&points)).ok());
            prop_assert_eq!(of_all.map(|c| worth(&c.point)), of_shipped.map(|c| worth(&c.point)));
        }
    }

    #[test]
    fn a_file_is_read_back_and_a_foreign_one_refused() {
        let made = tradeoff(points());
        let text = serde_json::to_string(&made).unwrap();
        assert_eq!(Tradeoff::from_json("f", &text).unwrap(), made);
        let foreign = text.replace(SCHEMA, "other/1");
        assert!(Tradeoff::from_json("f", &foreign).unwrap_err().to_string().starts_with("f: schema: expected"));
        let halves = tradeoff(points().into_iter().map(|p| decided(p, 9, 8)).collect());
        let counted = serde_json::to_string(&halves).unwrap();
        assert_eq!(Tradeoff::from_json("f", &counted).unwrap(), halves);
        let more = counted.replacen("\"n_decided\":9", "\"n_decided\":21", 1);
        assert!(Tradeoff::from_json("f", &more).unwrap_err().to_string().starts_with("f: point 0: expected counts"));
        let mut strangers = halves;
        strangers.points[3].strangers = Some(Strangers { n_episodes: 2, n_named: 3 });
        let strangers = serde_json::to_string(&strangers).unwrap();
        assert!(
            Tradeoff::from_json("f", &strangers).unwrap_err().to_string().starts_with("f: point 3: expected counts")
        );
        let broken = text.replace("\"pace_ms\":0.5", "\"pace_ms\":0.0");
        assert_eq!(
            Tradeoff::from_json("f", &broken).unwrap_err().to_string(),
            "f: point 0: expected numbers above zero, got another"
        );
    }
}
