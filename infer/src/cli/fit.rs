//! `tactile-infer fit`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::dataset::store::{Dataset, FILES};
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::program;
use tactile_data::program::progress::reporter;
use tactile_infer::Result;
use tactile_infer::bank::Bank;
use tactile_infer::calibration::fit::{Samples, fit};
use tactile_infer::calibration::match_odds::MatchOdds;
use tactile_infer::calibration::touches_of_bank::TouchesOfBank;
use tactile_infer::embedding::checkpoint::Checkpoint;

use super::{ModelArgs, print_json};

/// Fit the log-odds of a match, by which the filter weighs a touch, and store them with the model.
///
/// The touches are of parts that are neither trained on nor evaluated, made anywhere, best under several sensors. Each is
/// compared with its bank's first twelve parts, the next twelve, and so on.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-infer fit --model model/model.safetensors --touches parts.bank=holes,holes-2 rough.bank=rough-holes"
)]
pub struct FitArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// A simulated bank, at most 2.5 mm and 20 degrees a step, and datasets of touches of its parts between the recorded poses:
    /// holes, or with --side peg pegs; one dataset for each sensor. Several, of pegs, of both sides, of a rough sensor: the
    /// numbers suit all
    #[arg(long, value_name = "BANK=DIR,...", required = true, num_args = 1..)]
    touches: Vec<TouchesOfBank>,
    /// Which side is touched: each has numbers of its own
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = program::named::<Side>(Side::NAMES))]
    side: Side,
    /// Write the checkpoint here [default: into the model's own file, whose identity stays the same]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print the numbers as JSON
    #[arg(long)]
    json: bool,
}

impl FitArgs {
    /// Fits, and writes the model.
    pub fn run(&self) -> Result<()> {
        let path = &self.model.path;
        let out = self.out.as_ref().unwrap_or(path);
        let datasets = self.touches.iter().flat_map(|of| &of.datasets);
        let files = datasets.flat_map(|data| FILES.map(|file| data.join(file)));
        // The numbers may be written into the model that they are of.
        let _lock = output::prepare_file(out, files.chain(self.touches.iter().map(|of| of.bank.clone())))?;
        let model = self.model.load()?;
        let mut samples = Samples::new(&model, self.side);
        for TouchesOfBank { bank: path, datasets } in &self.touches {
            let datasets = datasets.iter().map(|path| Ok(Dataset::open(path)?)).collect::<Result<Vec<_>>>()?;
            let bank = Bank::load(path, &model)?;
            samples.add(&model, &bank, &datasets, &reporter("parts")).map_err(|error| error.within(path.display()))?;
        }
        let odds = fit(&samples)?;
        let (checkpoint, _) = Checkpoint::load(path)?;
        checkpoint.with_match_odds(self.side, odds.clone()).save(out)?;
        if self.json {
            return print_json(&odds);
        }
        let MatchOdds { offset, steepness, steepness_by_edge, own_distance, distance_by_own, .. } = odds;
        let MatchOdds { rarity_by_edge, log_probability, .. } = odds;
        program::say(format_args!(
            "{}: {} touches, {log_probability:.4} nats each\n  offset {offset:.2}, steepness {steepness:.2}, by edge \
             {steepness_by_edge:.3}, own distance {own_distance:.3}, by own {distance_by_own:.3}, rarity by edge {rarity_by_edge:.2}",
            out.display(),
            odds.n_touches
        ));
        Ok(())
    }
}
