//! `tactile-infer calibrate`.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tactile_data::store::{Dataset, FILES};
use tactile_data::touch::{Side, instead_of};
use tactile_data::{output, program};
use tactile_infer::bank::Bank;
use tactile_infer::calibrate::{Calibrated, Choice, Gain, Judgement, PRIOR_TOUCHES, Touches, calibrate};
use tactile_infer::calibration::{Calibration, Prior, Spread};
use tactile_infer::checkpoint::Checkpoint;
use tactile_infer::model::Model;
use tactile_infer::{Error, Result};

use super::{ModelArgs, print_json};

/// Measure how far the model's cosines can be believed, on parts for tuning, and store it with the model.
///
/// What the model knows of that already counts as twenty touches, and as two for how well views match, which differs most
/// from sensor to sensor: ten touches of your own move it as far as they can tell. A model without a calibration needs
/// fifty.
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
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = super::side())]
    side: Side,
    /// Write the calibrated checkpoint here [default: into the model's own file, whose identity stays the same]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// How many touches the model's own calibration counts as (for how well views match, a tenth); 0 forgets it
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
    temperature_interval: [f64; 2],
    gap_interval: Option<[f64; 2]>,
    gain: Option<Gain>,
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
        let _lock = output::prepare_file(out, files.chain([self.bank.clone()]))?;
        let model = self.model.load()?;
        let bank = Bank::load(&self.bank, &model)?;
        let prior = self.prior(model.calibration(self.side))?;
        let touches = self.touches(&model, &bank)?;
        let others = self.judge.as_ref().map(|path| {
            let choice = Choice { side: self.side, ..Choice::default() };
            Touches::new(&model, &bank, &Dataset::open(path)?, choice)
        });
        let found = calibrate(&touches, prior.as_ref())?;
        let judged = others.transpose()?.and_then(|others| judged(&others, &found.calibration));
        let (checkpoint, _) = Checkpoint::load(path)?;
        checkpoint.with_calibration(self.side, found.calibration).save(out)?;
        if self.json {
            let Calibrated { calibration, temperature_interval, gap_interval, gain } = found;
            return print_json(&Report { calibration, temperature_interval, gap_interval, gain, judged });
        }
        program::say(format_args!("{}: {}", out.display(), text(&found)));
        if let Some(Judged { n_holes, before, after }) = judged {
            let before = before.map_or(String::new(), |before| format!("{:.3} nats before, ", before.nll_nats));
            println!(
                "  by {n_holes} other holes: {before}{:.3} after; {:.1} % of them below the low cosine",
                after.nll_nats,
                100.0 * after.low_share
            );
        }
        Ok(())
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
    let Calibration { temperature, outlier_share, low_similarity, prior, .. } = *calibration;
    let before = prior.and_then(|prior| others.judge(prior.temperature, prior.outlier_share, prior.low_similarity));
    let after = others.judge(temperature, outlier_share, low_similarity)?;
    Some(Judged { n_holes: others.len(), before, after })
}

/// A calibration before and after, and what it is worth.
fn text(found: &Calibrated) -> String {
    let Calibrated { calibration, temperature_interval: [low, high], gap_interval, gain } = found;
    let Calibration {
        temperature,
        outlier_share,
        blank_agreement,
        low_similarity,
        n_holes,
        gap,
        matched,
        between_sensors,
        prior,
        ..
    } = calibration;
    let before =
        |of: &dyn Fn(&Prior) -> String| prior.as_ref().map_or(String::new(), |prior| format!("{} -> ", of(prior)));
    let counted = prior.map_or(String::new(), |prior| format!(", and as much as {} from before", prior.n_touches));
    let mut text = format!("{n_holes} touches with an edge{counted}\n");
    text += &format!(
        "  temperature {}{temperature:.4} (95 % {low:.4} to {high:.4}), share of outliers {}{outlier_share:.1e}\n",
        before(&|prior| format!("{:.4}", prior.temperature)),
        before(&|prior| format!("{:.1e}", prior.outlier_share))
    );
    text += &format!(
        "  blank agreement {}{blank_agreement:.3}; 99 in 100 holes reach cosine {}{low_similarity:.2}\n",
        before(&|prior| format!("{:.3}", prior.blank_agreement)),
        before(&|prior| format!("{:.2}", prior.low_similarity))
    );
    text += &format!(
        "  {:.3} nats to find the pose by one touch ({:.2} by chance)",
        calibration.nll_nats, calibration.chance_nats
    );
    if let (Some(Spread { mean, sd }), Some([low, high])) = (gap, gap_interval) {
        let was = |prior: &Prior| prior.gap.map_or("unknown".into(), |gap| format!("{:.3}", gap.mean));
        text += &format!(
            "\n  the view touched is {}{mean:.3} (95 % {low:.3} to {high:.3}) below the best, standard deviation {sd:.3}",
            before(&was)
        );
    }
    if let Some(Spread { mean, sd }) = matched {
        let was = |prior: &Prior| prior.matched.map_or("unknown".into(), |matched| format!("{:.3}", matched.mean));
        text += &format!("\n  the cosine with it is {}{mean:.3}, standard deviation {sd:.3}", before(&was));
    }
    if let Some(between) = between_sensors {
        text += &format!(", of it {between:.3} from sensor to sensor");
    }
    if let Some(Gain { before_nats, after_nats, standard_error }) = gain {
        let difference = after_nats - before_nats;
        text += &format!(
            "\n  touches left out in turn: {before_nats:.3} nats before, {after_nats:.3} after: {difference:+.3} \
             (95 % {:+.3} to {:+.3})",
            difference - 1.96 * standard_error,
            difference + 1.96 * standard_error
        );
    }
    text
}
