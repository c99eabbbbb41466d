//! Flags of a budget, and the choice of settings for it.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use clap::{ArgGroup, Args};
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
use super::numbers::{Numbers, refuse_given};

/// Seconds to find how fast this machine is.
const CALIBRATION_S: f64 = 10.0;

/// What there is to spend.
#[derive(Args)]
#[command(next_help_heading = "Budget", group = ArgGroup::new("spent").multiple(true))]
pub struct BudgetArgs {
    /// Choose the settings with which most episodes end sure and right within --max-touches and whose decisions take at
    /// most this (median, one core), ms. Ten seconds go into finding how fast this machine is
    #[arg(long, value_name = "MS", value_parser = positive, group = "spent")]
    budget_ms: Option<f64>,
    /// Choose the settings with which most episodes end sure and right and that take at most this much memory, 10^6 bytes
    #[arg(long, value_name = "MB", value_parser = positive, group = "spent")]
    budget_mb: Option<f64>,
    /// Choose the settings with which most episodes end sure and right and whose touches and ways take at most this, mean of
    /// the episodes measured, seconds
    #[arg(long, value_name = "S", value_parser = positive, group = "spent")]
    budget_s: Option<f64>,
    /// Stop after this many touches [default: 10]
    #[arg(long, value_name = "N")]
    max_touches: Option<usize>,
    /// With a budget: what tactile-filter tradeoff measured [default: the model's file with the ending .frontier.json]
    #[arg(long, value_name = "FILE", requires = "spent")]
    frontier: Option<PathBuf>,
    /// With a budget: the sensor is rough or pressed unevenly, so that a touch says little: choose by what was measured with such a one
    /// (the model's file with the ending .rough.frontier.json)
    #[arg(long, conflicts_with = "frontier", requires = "spent")]
    rough_sensor: bool,
}

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
        self.budget_ms.is_some() || self.budget_mb.is_some() || self.budget_s.is_some()
    }

    /// Refuses flags and numbers that a budget chooses itself.
    pub fn check_chosen(&self, flags: &[(&str, bool)], numbers: &Numbers) -> Result<()> {
        if !self.is_given() {
            return Ok(());
        }
        refuse_given(flags, "no budget, which chooses it", "one")?;
        numbers.check_budget()
    }

    /// A config with this budget's limit on touches.
    pub fn limited(&self, config: EpisodeConfig) -> Result<EpisodeConfig> {
        let config = config
            .changed(|settings, _, _| settings.max_touches = self.max_touches.unwrap_or(config.settings.max_touches));
        config.validate()?;
        Ok(config)
    }

    /// Chooses settings; returns the bank in the format that they take, what they are, and what they promise.
    pub fn choose(&self, task: &Task<'_>, base: &EpisodeConfig) -> Result<(Arc<Bank>, EpisodeConfig, Promise)> {
        let ending = if self.rough_sensor { "rough.frontier.json" } else { "frontier.json" };
        let path = self.frontier.clone().unwrap_or_else(|| task.model_path.with_extension(ending));
        if !path.exists() {
            let expected = "a frontier of this model, as tactile-filter tradeoff measures it";
            return Err(Error::invalid(path.display().to_string(), expected, "no such file"));
        }
        let text = bounded_file::read_to_string(&path, Kind::FIGURES)?;
        let tradeoff = Tradeoff::from_json(&path.display().to_string(), &text)?;
        let paces = self.paces(&tradeoff, task, base)?;
        let budget = Budget {
            decision_ms: self.budget_ms,
            memory_mb: self.budget_mb,
            max_touches: self.max_touches,
            robot_s: self.budget_s,
        };
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
