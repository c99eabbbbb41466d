//! `tactile-infer calibrate`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tactile_data::dataset::store::{Dataset, FILES};
use tactile_data::dataset::touch::{Side, instead_of};
use tactile_data::file::output;
use tactile_data::program;
use tactile_infer::bank::Bank;
use tactile_infer::calibration::calibrate::{Choice, Judgement, PRIOR_TOUCHES, Touches, calibrate};
use tactile_infer::calibration::own_by_edge::OwnByEdge;
use tactile_infer::calibration::{Calibration, OfVerifier, Prior, Spread};
use tactile_infer::embedding::checkpoint::Checkpoint;
use tactile_infer::embedding::model::Model;
use tactile_infer::maps::Maps;
use tactile_infer::{Error, Result};

use super::{ModelArgs, print_json};

/// Measure how well touches match the views that they are made at, on parts for tuning, and store it with the model.
///
/// What the model knows of that already counts as two touches, since it differs much from sensor to sensor: ten touches of your own
/// move it as far as they can tell. A model without a calibration needs fifty.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-infer calibrate --model model/model.safetensors --bank dev.bank --holes dev-holes"
)]
pub struct CalibrateArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Bank of pegs made by the model: parts for tuning, never the parts of an evaluation
    #[arg(long, value_name = "FILE")]
    bank: PathBuf,
    /// Dataset of touches of the same parts, between the recorded poses: holes, or with --side peg pegs. Several, one of each
    /// sensor: how far sensors differ is measured, too, for a model that is to be used with any
    #[arg(long, value_name = "DIR", required = true)]
    holes: Vec<PathBuf>,
    /// Which side is touched: each has a calibration of its own
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = program::named::<Side>(Side::NAMES))]
    side: Side,
    /// Measure what a verifier says of one sensor's touches, too: the networks that the bank was made with
    #[arg(long, value_name = "FILE")]
    maps: Option<PathBuf>,
    /// Write the calibrated checkpoint here [default: into the model's own file, whose identity stays the same]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// How many touches the model's own calibration counts as; 0 forgets it
    #[arg(long, value_name = "N", default_value_t = PRIOR_TOUCHES, help_heading = "Few touches")]
    prior_touches: f64,
    /// Use only so many of the holes of a dataset, evenly spread
    #[arg(long, value_name = "N", help_heading = "Few touches")]
    touches: Option<usize>,
    /// Judge the calibration by these holes, of the bank's parts, too, before and after
    #[arg(long, value_name = "DIR", help_heading = "Few touches")]
    judge: Option<PathBuf>,
    /// Print the calibration as JSON
    #[arg(long)]
    json: bool,
}

/// A calibration for programs.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    calibration: Calibration,
    judged: Option<Judged>,
}

/// What other touches say of it.
#[derive(Clone, Copy, Serialize)]
struct Judged {
    n_holes: usize,
    before: Option<Judgement>,
    after: Judgement,
}

impl CalibrateArgs {
    /// Fits, prints what it is worth and writes the model.
    pub fn run(&self) -> Result<()> {
        let path = &self.model.path;
        let out = self.out.as_ref().unwrap_or(path);
        let datasets = self.holes.iter().chain(&self.judge);
        let files = datasets.flat_map(|data| FILES.map(|file| data.join(file)));
        // A calibration may be written into the model that it is of.
        let _lock = output::prepare_file(out, files.chain([self.bank.clone()]).chain(self.maps.clone()))?;
        let model = self.model.load()?;
        let model = match &self.maps {
            Some(path) => model.with_maps(Maps::load(path)?)?,
            None => model,
        };
        let bank = Bank::load(&self.bank, &model)?;
        let prior = self.prior(model.calibration(self.side))?;
        self.check_judged(&bank)?;
        let touches = self.touches(&model, &bank)?;
        let others = self.judge.as_ref().map(|path| {
            let choice = Choice { side: self.side, ..Choice::default() };
            Touches::new(&model, &bank, &Dataset::open(path)?, choice)
        });
        let calibration = calibrate(&touches, prior.as_ref())?;
        let judged = others.transpose()?.and_then(|others| judged(&others, &calibration));
        let (checkpoint, _) = Checkpoint::load(path)?;
        checkpoint.with_calibration(self.side, calibration.clone()).save(out)?;
        if self.json {
            return print_json(&Report { calibration, judged });
        }
        program::say(format_args!("{}: {}", out.display(), text(&calibration)));
        if let Some(Judged { n_holes, before, after }) = judged {
            let low = |of: &Judgement| format!("{:.1}", 100.0 * of.low_share);
            let before = before.map_or(String::new(), |before| format!("{} -> ", low(&before)));
            let own = after.matched.map_or(String::new(), |Spread { mean, sd }| {
                format!("; the cosine with the view touched is {mean:.3}, standard deviation {sd:.3}")
            });
            println!("  of {n_holes} other holes {before}{} % are below the low cosine{own}", low(&after));
        }
        Ok(())
    }

    /// Refuses maps by which nothing can be judged.
    fn check_judged(&self, bank: &Bank) -> Result<()> {
        let Some(maps) = &self.maps else { return Ok(()) };
        if bank.mosaics().is_none() {
            let expected = "a bank with a map of each part (tactile-infer bank --maps)";
            return Err(Error::invalid(self.bank.display().to_string(), expected, "one without"));
        }
        if bank.presence(self.side).is_some() {
            return Ok(());
        }
        let expected = "a verifier (tactile-train --verifier) whose words were fitted (tactile-filter certify --maps)";
        let got = if bank.verifier().is_none() { "none" } else { "no fit" };
        Err(Error::invalid(maps.display().to_string(), expected, got))
    }

    /// The touches of all sensors.
    fn touches(&self, model: &Model, bank: &Bank) -> Result<Touches> {
        let choice = Choice { side: self.side, n: self.touches };
        let mut found: Option<Touches> = None;
        let mut known: Vec<String> = Vec::new();
        for path in &self.holes {
            let holes = Dataset::open(path)?;
            let sha256 = holes.sha256()?;
            if known.contains(&sha256) {
                let expected = "other touches in each dataset";
                return Err(Error::invalid("--holes", expected, format!("those of {} again", path.display())));
            }
            known.push(sha256);
            if let Some(why) = bank.other_light(holes.meta().lamps.as_ref()) {
                program::warning(format_args!("{}: {why}", path.display()));
            }
            let touches = Touches::new(model, bank, &holes, choice)?;
            if touches.is_empty() {
                let expected = format!("{}s that show an edge within the bank's poses", self.side);
                let other = if self.side.is_hole() { "--side peg calibrates with them" } else { "--side hole does" };
                let got = instead_of(self.side, holes.touches(), other);
                return Err(Error::invalid(path.display().to_string(), expected, got));
            }
            found = Some(match found {
                Some(others) => others.and(touches)?,
                None => touches,
            });
        }
        found.ok_or_else(|| Error::invalid("--holes", "a dataset", "none"))
    }

    /// What the model knows already.
    fn prior(&self, known: Option<&Calibration>) -> Result<Option<Prior>> {
        let n = self.prior_touches;
        if !(n.is_finite() && n >= 0.0) {
            return Err(Error::invalid("--prior-touches", "a number, not negative", n.to_string()));
        }
        Ok(known.map(|known| known.as_prior(n)).filter(|_| n > 0.0))
    }
}

fn judged(others: &Touches, calibration: &Calibration) -> Option<Judged> {
    let before = calibration.prior.and_then(|prior| others.judge(prior.low_similarity));
    Some(Judged { n_holes: others.len(), before, after: others.judge(calibration.low_similarity)? })
}

/// How far 95 of 100 other draws of as many touches are from a mean, where what was known before counts as touches that stay.
fn by_other_touches(n_holes: usize, n_before: f64, sd: f64) -> [f64; 2] {
    let n = n_holes as f64;
    let half = 1.96 * sd * n.sqrt() / (n + n_before).max(1.0);
    [-half, half]
}

/// A calibration, and what was known before it.
fn text(calibration: &Calibration) -> String {
    let Calibration {
        low_similarity, n_holes, matched, between_sensors, steepness, own_by_edge, verifier, prior, ..
    } = calibration;
    let before =
        |of: &dyn Fn(&Prior) -> String| prior.as_ref().map_or(String::new(), |prior| format!("{} -> ", of(prior)));
    let counted = prior.map_or(String::new(), |prior| format!(", and as much as {} from before", prior.n_touches));
    let low = before(&|prior| format!("{:.2}", prior.low_similarity));
    let mut text =
        format!("{n_holes} touches with an edge{counted}\n  99 in 100 reach cosine {low}{low_similarity:.2}");
    if let Some(Spread { mean, sd }) = matched {
        let was = |prior: &Prior| prior.matched.map_or("unknown".into(), |matched| format!("{:.3}", matched.mean));
        let [least, most] =
            by_other_touches(*n_holes, prior.map_or(0.0, |prior| prior.n_touches), *sd).map(|off| mean + off);
        text += &format!(
            "\n  the cosine with the view touched is {}{mean:.3} ({least:.3} to {most:.3} had others been made), standard deviation {sd:.3}",
            before(&was)
        );
    }
    if let Some(between) = between_sensors {
        text += &format!(", of it {between:.3} from sensor to sensor");
    }
    if let Some(OfVerifier { nats, n_touches, strain, misfit, .. }) = verifier {
        text += &format!(
            "\n  the verifier says {nats:+.2} nats of each of {n_touches} touches more than of simulated ones; parts seem {:+.1} % larger, and {misfit:+.2} nats farther off",
            100.0 * strain
        );
    }
    if let Some(steepness) = steepness {
        text += &format!("\n  a distance costs {steepness:.2} times as much as was fitted");
    }
    if let Some(OwnByEdge { by_edge, .. }) = own_by_edge {
        let times = 2.0_f64.powf(*by_edge);
        text += &format!("\n  touches with half as much edge are {times:.2} times as far from their own views");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mean_of_touches_varies_as_such_means_do() {
        // Thirty-six touches with a deviation of 0.06: means vary by 0.01, less by what stays.
        let half = |n_before| by_other_touches(36, n_before, 0.06)[1];
        assert!((half(0.0) - 1.96 * 0.01).abs() < 1e-12 && (half(36.0) - 0.98 * 0.01).abs() < 1e-12);
    }
}
