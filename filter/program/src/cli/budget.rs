//! Flags of a budget, and the choice of settings for it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::Args;
use tactile_data::file::bounded_file::{self, Kind};
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::text::printable::printable;
use tactile_eval::report::knobs::in_words;
use tactile_eval::result::{Promise, PromisedShare};
use tactile_eval::{Error, Result};
use tactile_filter::budget::{Budget, Cost, Pace, Setup, Speeds, Tradeoff};
use tactile_filter::{EpisodeConfig, Sensor};
use tactile_infer::Bank;
use tactile_infer::Model;

use super::arguments::positive;
use super::numbers::{Numbers, assignment, refuse_given};

/// Seconds to find how fast this machine is.
const CALIBRATION_S: f64 = 10.0;

/// What there is to spend.
#[derive(Args)]
#[command(next_help_heading = "Budget")]
pub struct BudgetArgs {
    /// Choose the settings with which most episodes end sure and right within this, such as ms=4,touches=4: ms of a decision
    /// (median, one core), mb of memory (10^6 bytes), s of touches and ways (mean), touches. Ten seconds go into finding how fast
    /// this machine is
    #[arg(long, value_name = "NAME=VALUE,...", value_parser = parse_budget)]
    budget: Option<Budget>,
    /// With a budget: what tactile-filter tradeoff measured; rough: the model's file with the ending .rough.frontier.json, for a sensor
    /// that is rough or pressed unevenly [default: the one with the ending .frontier.json]
    #[arg(long, value_name = "FILE|rough", requires = "budget")]
    frontier: Option<PathBuf>,
}

/// The value of `--frontier` that stands for the model's file for rough sensors.
const ROUGH: &str = "rough";

/// What the settings were chosen for.
pub struct Task<'a> {
    /// File of the model.
    pub model_path: &'a Path,
    /// The model.
    pub model: &'a Arc<Model>,
    /// The bank, as it was loaded.
    pub bank: &'a Arc<Bank>,
    /// A frame of the sensor at rest.
    pub no_contact: &'a Frame,
    /// The motions that will be offered.
    pub reach: PoseGrid,
    /// Whether poses lie between recorded ones.
    pub between_poses: bool,
    /// How long the robot takes.
    pub speeds: Speeds,
}

impl BudgetArgs {
    /// Whether settings are to be chosen.
    pub fn is_given(&self) -> bool {
        self.budget.is_some()
    }

    /// Refuses flags and numbers that a budget chooses itself.
    pub fn check_chosen(&self, flags: &[(&str, bool)], numbers: &Numbers) -> Result<()> {
        if !self.is_given() {
            return Ok(());
        }
        refuse_given(flags, "no budget, which chooses it", "one")?;
        numbers.check_budget()
    }

    /// Chooses settings; returns the bank in the format that they take, what they are, and what they promise.
    pub fn choose(&self, task: &Task<'_>, base: &EpisodeConfig) -> Result<(Arc<Bank>, EpisodeConfig, Promise)> {
        let path = match &self.frontier {
            Some(file) if file.as_os_str() != ROUGH => file.clone(),
            rough => {
                task.model_path.with_extension(if rough.is_some() { "rough.frontier.json" } else { "frontier.json" })
            }
        };
        if !path.exists() {
            let expected = "a frontier of this model, as tactile-filter tradeoff measures it";
            return Err(Error::invalid(path.display().to_string(), expected, "no such file"));
        }
        let text = bounded_file::read_to_string(&path, Kind::FIGURES)?;
        let tradeoff = Tradeoff::from_json(&path.display().to_string(), &text)?;
        let paces = self.paces(&tradeoff, task, base)?;
        let budget = self.budget.unwrap_or_default();
        let choice = tradeoff.choose(&budget, &task.speeds, &mut |settings, n_touches| {
            let Some((_, pace_ms)) = paces.iter().find(|(of, _)| of == settings) else { return Ok(None) };
            let memory_mb = settings.memory_mb(task.model, task.bank, n_touches)?;
            Ok(Some(Cost { pace_ms: *pace_ms, memory_mb }))
        })?;
        let settings = &choice.point.settings;
        let config = settings.applied_to(base).changed(|settings, _, _| settings.max_touches = choice.point.n_touches);
        config.validate()?;
        let promise = Promise::of(&choice, &tradeoff, &task.speeds, in_words(settings));
        print(&promise, &tradeoff);
        Ok((with_rows(task.bank, settings)?, config, promise))
    }

    /// How long a made-up decision takes here, for each setting that can be had.
    fn paces(&self, tradeoff: &Tradeoff, task: &Task<'_>, base: &EpisodeConfig) -> Result<Vec<(Setup, f64)>> {
        let settings = tradeoff.settings_of(task.model, task.bank.grid(), base.settings.false_accept);
        let sensor = Sensor::new(task.model.clone(), task.no_contact)?;
        let begun = Instant::now();
        let share_s = CALIBRATION_S / settings.len().max(1) as f64;
        let of = |settings: &Setup| {
            let bank = with_rows(task.bank, settings)?;
            let config = settings.applied_to(base).changed(|_, _, method| method.between_poses = task.between_poses);
            let pace = Pace { sensor: &sensor, frame: task.no_contact, bank: &bank, reach: &task.reach };
            let pace_ms = pace.decision_ms(&config, share_s, &mut || begun.elapsed().as_secs_f64())?;
            Ok((settings.clone(), pace_ms))
        };
        settings.into_iter().map(of).collect()
    }
}

/// The bank with its rows in the format of some settings.
fn with_rows(bank: &Bank, settings: &Setup) -> Result<Arc<Bank>> {
    Ok(Arc::new(bank.clone().with_precision(settings.rows)?))
}

/// Limits by name, each once.
fn parse_budget(text: &str) -> std::result::Result<Budget, String> {
    let names = "expected some of ms=, mb=, s= and touches=, with commas between, such as ms=4,touches=4";
    let mut budget = Budget::default();
    for limit in text.split(',') {
        let (name, value) = assignment(limit).map_err(|_| names)?;
        let set =
            |limit: &mut Option<f64>| limit.replace(positive(&value)?).map_or(Ok(()), |_| Err("expected once".into()));
        let set = match name.as_str() {
            "ms" => set(&mut budget.decision_ms),
            "mb" => set(&mut budget.memory_mb),
            "s" => set(&mut budget.robot_s),
            "touches" => {
                let n = value.parse().ok().filter(|n| *n > 0).ok_or("touches: expected a whole number above 0")?;
                budget.max_touches.replace(n).map_or(Ok(()), |_| Err("expected once".into()))
            }
            _ => return Err(names.into()),
        };
        set.map_err(|expected: String| format!("{name}: {expected}"))?;
    }
    Ok(budget)
}

fn print(promise: &Promise, tradeoff: &Tradeoff) {
    let Promise { settings, decision_ms, memory_mb, n_touches, .. } = promise;
    let robot_s = promise.robot_s.map_or_else(String::new, |s| format!(", {s:.1} robot seconds on average"));
    eprintln!(
        "budget: {decision_ms:.2} ms a decision and {memory_mb:.1} MB here, at most {n_touches} touches{robot_s}; {} on {}, {}: \
         {settings}",
        promised(promise),
        printable(&tradeoff.scene),
        printable(&tradeoff.poses),
    );
}

/// The shares that are promised, in words.
fn promised(promise: &Promise) -> String {
    let share = |share: PromisedShare, what: &str| {
        let PromisedShare { share, ci95: [low, high], n_episodes } = share;
        let [share, low, high] = [share, low, high].map(|of| 100.0 * of);
        format!("{share:.1} % {what} ({low:.1} to {high:.1}, {n_episodes} episodes)")
    };
    let decided = promise.decided_and_right.map(|of| share(of, "sure and right"));
    decided.into_iter().chain(promise.accuracy.map(|of| share(of, "right, sure or not"))).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_some_limits_by_name() {
        let all = parse_budget("ms=4.5, mb=100,s=20,touches=4").unwrap();
        let expected =
            Budget { decision_ms: Some(4.5), memory_mb: Some(100.0), max_touches: Some(4), robot_s: Some(20.0) };
        assert_eq!(all, expected);
        assert_eq!(parse_budget("touches=1").unwrap(), Budget { max_touches: Some(1), ..Budget::default() });
        for (text, said) in [
            ("", "some of ms="),
            ("4", "some of ms="),
            ("gb=1", "some of ms="),
            ("ms=4,", "some of ms="),
            ("ms=0", "ms: expected a number above 0"),
            ("touches=0", "touches: expected a whole number above 0"),
            ("touches=1.5", "touches: expected a whole number above 0"),
            ("ms=4,ms=5", "ms: expected once"),
        ] {
            assert!(parse_budget(text).unwrap_err().contains(said), "{text}");
        }
    }
}
