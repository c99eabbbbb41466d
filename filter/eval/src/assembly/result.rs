//! What an assembly found, as other programs read it: `assembly.json`.

use serde::{Deserialize, Serialize};
use tactile_data::pose::grid::PoseGrid;

use tactile_filter::StopReason;

use super::attempt::{Attempt, Insertion, STOPS, Task};
use crate::result::{ModelRecord, Quantiles};
use crate::statistics::quantile;
use crate::statistics::share::wilson_95;
use tactile_filter::budget::Speeds;

/// The value of [`Assembly::schema`].
pub const SCHEMA: &str = "tactile-filter/assembly/2";

/// All trials of a task on one scene with one model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Assembly {
    /// [`SCHEMA`].
    pub schema: String,
    /// How it was run.
    #[serde(flatten)]
    pub run: Run,
    /// Trials in all; in each all holes are tried in turn.
    pub n_trials: usize,
    /// Seeds of the trials.
    pub seeds: Vec<u64>,
    /// A held peg was off by up to this in x and in y, mm ...
    pub grasp_error_mm: f64,
    /// ... and turned by up to this, degrees.
    pub grasp_error_deg: f64,
    /// A hole's plate was tilted against the tool by this, towards any side, degrees.
    pub tilt_deg: f64,
    /// How pegs were put in.
    pub insertion: Insertion,
    /// How long what the robot does takes.
    pub speeds: Speeds,
    /// Trials that ended with each hole's own peg in it.
    pub all_inserted: Share,
    /// All holes.
    pub holes: Group,
    /// The holes of each part, in the scene's order.
    pub parts: Vec<Group>,
    /// The holes by why the touching ended; the robot tries its best estimate whatever that was.
    pub stops: Vec<Group>,
    /// The holes by the number of pegs that the robot still had, the most first.
    pub pegs_left: Vec<Group>,
    /// The holes without their peg, in the order they were tried.
    pub failures: Vec<Failure>,
    /// From a touch's frame to the decision what to do next, milliseconds.
    pub decision_ms: Quantiles,
}

/// How the trials were run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// Name of the scene.
    pub scene: String,
    /// By how much a hole is wider than its peg on every side, mm.
    pub clearance_mm: f64,
    /// The model that embedded the touches.
    pub model: ModelRecord,
    /// Device of the network.
    pub device: String,
    /// The poses at which the bank's pegs were recorded.
    pub recorded: PoseGrid,
    /// The command line that makes this again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub command: Option<String>,
}

/// So many of so many.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Share {
    /// How many.
    pub n: usize,
    /// How many there are in all.
    pub of: usize,
    /// `n / of`, 0..=1; zero of none.
    pub share: f64,
    /// Bounds of its 95 % interval (Wilson's).
    pub ci95: [f64; 2],
}

/// What happened at some of the holes. Errors are of the pegs of the right part, where they were brought: grasp errors
/// included, those that did not go in too; zero where there are none.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Group {
    /// What they have in common: a part, a reason, a number.
    pub name: String,
    /// Holes that got their own peg.
    pub inserted: Share,
    /// Half of the holes took no more touches.
    pub touches_median: f64,
    /// Touches a hole.
    pub touches_mean: f64,
    /// Pegs tried, a hole.
    pub tries_mean: f64,
    /// What a robot takes for a hole, seconds.
    pub seconds_mean: f64,
    /// Distance of the peg from its hole's centre, mm.
    pub xy_mm_mean: f64,
    /// Its median, mm.
    pub xy_mm_median: f64,
    /// Angle of the peg against its hole, degrees.
    pub theta_deg_mean: f64,
    /// Its median, degrees.
    pub theta_deg_median: f64,
    /// Holes whose peg was the right one and did not go in.
    pub wrong_pose: usize,
    /// Holes for which another part was named.
    pub wrong_part: usize,
    /// How many of them a wrong peg went into all the same.
    pub wrong_part_went_in: usize,
}

/// A hole that did not get its own peg.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Failure {
    /// Number of the trial, from 1.
    pub trial: usize,
    /// Which of the trial's holes it was, from 1.
    pub hole: usize,
    /// The hole's own part.
    pub part: String,
    /// The part whose peg was tried.
    pub named: String,
    /// Whether that peg went in.
    pub went_in: bool,
    /// Pegs that the robot chose from.
    pub n_pegs: usize,
    /// Why the touching ended.
    pub stop: StopReason,
    /// Touches made.
    pub n_touches: usize,
    /// Probability of the part that was named, 0..=1.
    pub probability: f64,
    /// How well it explains what was felt; absent where no edge was felt.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fit: Option<f64>,
    /// How far from the hole's centre the peg was brought, mm.
    pub xy_mm: f64,
    /// How far it was turned, degrees.
    pub theta_deg: f64,
}

impl Assembly {
    /// The figures of some trials; `parts` are the names of the scene's parts.
    pub fn of(run: Run, task: &Task, parts: &[String], trials: &[Vec<Attempt>]) -> Self {
        let all: Vec<&Attempt> = trials.iter().flatten().collect();
        let some = |name: String, which: &dyn Fn(&Attempt) -> bool| {
            let of: Vec<&Attempt> = all.iter().copied().filter(|attempt| which(attempt)).collect();
            (!of.is_empty()).then(|| Group::of(name, &of, task))
        };
        let whole = trials.iter().filter(|trial| trial.iter().all(Attempt::is_done)).count();
        let failures = trials.iter().enumerate().flat_map(|(trial, attempts)| {
            let failed = attempts.iter().enumerate().filter(|(_, attempt)| !attempt.is_done());
            failed.map(move |(hole, attempt)| failure(trial, hole, attempt, parts))
        });
        let times = || all.iter().flat_map(|attempt| attempt.decision_ms.iter().copied()).collect();
        Self {
            schema: SCHEMA.into(),
            run,
            n_trials: trials.len(),
            seeds: task.seeds.clone(),
            grasp_error_mm: task.grasp_error_mm,
            grasp_error_deg: task.grasp_error_deg,
            tilt_deg: task.tilt_deg,
            insertion: task.insertion,
            speeds: task.speeds,
            all_inserted: Share::new(whole, trials.len()),
            holes: Group::of("all".into(), &all, task),
            parts: parts
                .iter()
                .enumerate()
                .filter_map(|(part, name)| some(name.clone(), &|attempt| attempt.part == part))
                .collect(),
            stops: STOPS
                .iter()
                .filter_map(|(stop, name)| some((*name).into(), &|attempt| attempt.stop == *stop))
                .collect(),
            pegs_left: (1..=parts.len())
                .rev()
                .filter_map(|n_pegs| some(n_pegs.to_string(), &|attempt| attempt.n_pegs == n_pegs))
                .collect(),
            failures: failures.collect(),
            decision_ms: Quantiles { p50: quantile(times(), 0.5), p99: quantile(times(), 0.99) },
        }
    }
}

impl Share {
    /// `n` of `of`, with its interval.
    pub fn new(n: usize, of: usize) -> Self {
        Self { n, of, share: n as f64 / of.max(1) as f64, ci95: wilson_95(n, of) }
    }
}

impl Group {
    fn of(name: String, attempts: &[&Attempt], task: &Task) -> Self {
        let seconds = |attempt: &&Attempt| attempt.seconds(&task.speeds, task.insertion.slide_mm_s);
        let values = |of: fn(&Attempt) -> f64, right: bool| -> Vec<f64> {
            attempts
                .iter()
                .filter(|attempt| !right || attempt.named == attempt.part)
                .map(|attempt| of(attempt))
                .collect()
        };
        let count = |which: fn(&Attempt) -> bool| attempts.iter().filter(|attempt| which(attempt)).count();
        let touches = values(|attempt| attempt.n_touches as f64, false);
        let (xy_mm, theta_deg) = (values(|attempt| attempt.xy_mm, true), values(|attempt| attempt.theta_deg, true));
        Self {
            name,
            inserted: Share::new(count(Attempt::is_done), attempts.len()),
            touches_mean: mean(&touches),
            tries_mean: mean(&values(|attempt| attempt.n_tries as f64, false)),
            seconds_mean: mean(&attempts.iter().map(seconds).collect::<Vec<_>>()),
            touches_median: quantile(touches, 0.5),
            xy_mm_mean: mean(&xy_mm),
            xy_mm_median: quantile(xy_mm, 0.5),
            theta_deg_mean: mean(&theta_deg),
            theta_deg_median: quantile(theta_deg, 0.5),
            wrong_pose: count(|attempt| attempt.named == attempt.part && !attempt.went_in),
            wrong_part: count(|attempt| attempt.named != attempt.part),
            wrong_part_went_in: count(|attempt| attempt.named != attempt.part && attempt.went_in),
        }
    }
}

fn failure(trial: usize, hole: usize, attempt: &Attempt, parts: &[String]) -> Failure {
    let name = |part: usize| parts.get(part).cloned().unwrap_or_default();
    Failure {
        trial: trial + 1,
        hole: hole + 1,
        part: name(attempt.part),
        named: name(attempt.named),
        went_in: attempt.went_in,
        n_pegs: attempt.n_pegs,
        stop: attempt.stop,
        n_touches: attempt.n_touches,
        probability: attempt.probability,
        fit: attempt.fit,
        xy_mm: attempt.xy_mm,
        theta_deg: attempt.theta_deg,
    }
}

/// Zero of none.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    fn attempt(part: usize, named: usize, went_in: bool, n_touches: usize) -> Attempt {
        let stop = if n_touches > 9 { StopReason::TouchLimit } else { StopReason::Confident };
        Attempt {
            part,
            named,
            n_pegs: 2,
            stop,
            n_touches,
            n_peg_touches: 2,
            n_tries: 1,
            travel_mm: 100.0,
            slide_mm: 5.0,
            probability: 0.97,
            fit: None,
            went_in,
            xy_mm: n_touches as f64,
            theta_deg: 0.5 * n_touches as f64,
            decision_ms: vec![4.0; n_touches],
        }
    }

    /// Four trials with two holes: all in, a wrong place, a wrong part that goes in and leaves the other out.
    pub(crate) fn example() -> Assembly {
        let trials = [
            vec![attempt(0, 0, true, 3), Attempt { n_pegs: 1, ..attempt(1, 1, true, 4) }],
            vec![attempt(0, 0, false, 10), attempt(1, 1, true, 3)],
            vec![attempt(1, 0, true, 2), Attempt { n_pegs: 1, ..attempt(0, 1, false, 3) }],
            vec![attempt(1, 1, true, 5), Attempt { n_pegs: 1, ..attempt(0, 0, true, 3) }],
        ];
        let run = Run {
            scene: "two <letters>".into(),
            clearance_mm: 2.0,
            model: ModelRecord { name: "m".into(), sha256: "abc".into(), parameters: 7, input_px: [80, 60] },
            device: "flex".into(),
            recorded: PoseGrid::LARGE,
            command: Some("tactile-filter assemble --trials 4".into()),
        };
        let task = Task {
            n_trials: 4,
            seeds: vec![1],
            grasp_error_mm: 0.5,
            grasp_error_deg: 1.0,
            tilt_deg: 0.0,
            insertion: Insertion::default(),
            speeds: Speeds::default(),
        };
        Assembly::of(run, &task, &["M".into(), "L<".into()], &trials)
    }

    #[test]
    fn every_hole_is_counted_where_it_belongs() {
        let made = example();
        assert_eq!(made.all_inserted, Share { n: 2, of: 4, share: 0.5, ci95: wilson_95(2, 4) });
        assert_eq!((made.holes.inserted.n, made.holes.inserted.of), (5, 8));
        // 2, 3, 3, 3, 3, 4, 5, 10.
        assert_eq!((made.holes.touches_median, made.holes.touches_mean), (3.0, 33.0 / 8.0));
        // Touches of holes and pegs and tries of 3 s, 100 mm at 50 mm/s, 5 mm at 10 mm/s.
        let seconds = (33.0 / 8.0 + 2.0 + 1.0) * 3.0 + 2.0 + 0.5;
        assert!((made.holes.seconds_mean - seconds).abs() < 1e-12 && made.holes.tries_mean == 1.0);
        assert_eq!((made.holes.wrong_pose, made.holes.wrong_part, made.holes.wrong_part_went_in), (1, 2, 1));
        let [m, l] = &made.parts[..] else { panic!() };
        assert_eq!((m.inserted.n, m.inserted.of, m.wrong_pose, m.wrong_part), (2, 4, 1, 1));
        // Of the right part: 3, 10 and 3 mm.
        assert_eq!((m.xy_mm_mean, m.xy_mm_median, m.theta_deg_mean), (16.0 / 3.0, 3.0, 8.0 / 3.0));
        assert_eq!((l.inserted.n, l.inserted.of, l.wrong_part_went_in), (3, 4, 1));
        let names = |groups: &[Group]| groups.iter().map(|g| (g.name.clone(), g.inserted.of)).collect::<Vec<_>>();
        assert_eq!(names(&made.stops), [("confident".into(), 7), ("touch limit".into(), 1)]);
        assert_eq!(names(&made.pegs_left), [("2".into(), 5), ("1".into(), 3)]);
        assert_eq!((made.decision_ms.p50, made.decision_ms.p99), (4.0, 4.0));
    }

    #[test]
    fn each_failure_comes_with_its_trial_and_hole() {
        let failures = example().failures;
        let of = |f: &Failure| (f.trial, f.hole, f.part.clone(), f.named.clone(), f.went_in);
        let (m, l) = ("M".to_owned(), "L<".to_owned());
        let expected = [(2, 1, m.clone(), m.clone(), false), (3, 1, l.clone(), m.clone(), true), (3, 2, m, l, false)];
        assert_eq!(failures.iter().map(of).collect::<Vec<_>>(), expected);
    }

    #[test]
    fn it_comes_back_from_json() {
        let json = serde_json::to_string(&example()).unwrap();
        assert!(json.starts_with(r#"{"schema":"tactile-filter/assembly/2","scene":"two <letters>""#));
        assert_eq!(serde_json::from_str::<Assembly>(&json).unwrap(), example());
    }
}
