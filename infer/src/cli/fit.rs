//! `tactile-infer fit`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::progress::reporter;
use tactile_data::store::{Dataset, FILES};
use tactile_data::touch::Side;
use tactile_data::{output, program};
use tactile_infer::Result;
use tactile_infer::bank::Bank;
use tactile_infer::checkpoint::Checkpoint;
use tactile_infer::fit::{Samples, fit};
use tactile_infer::match_odds::MatchOdds;

use super::{ModelArgs, print_json};

/// Fit the log-odds of a match, by which the filter weighs a touch, and store them with the model.
///
/// The touches are of parts that are neither trained on nor evaluated, made anywhere, best under several sensors. Each is
/// compared with the banks' first twelve parts, the next twelve, and so on.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-infer fit --model model/model.safetensors --bank parts.bank --holes holes holes-2"
)]
pub struct FitArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Bank of the parts, simulated, at most 2.5 mm and 20 degrees a step; several, of pegs and of both sides: the numbers suit all
    #[arg(long, value_name = "FILE", required = true, num_args = 1..)]
    bank: Vec<PathBuf>,
    /// Datasets of touches of the same parts, between the recorded poses: holes, or with --side peg pegs; one for each sensor
    #[arg(long, value_name = "DIR", required = true, num_args = 1..)]
    holes: Vec<PathBuf>,
    /// Which side is touched: each has numbers of its own
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = super::side())]
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
        let files = self.holes.iter().flat_map(|data| FILES.map(|file| data.join(file)));
        // The numbers may be written into the model that they are of.
        let _lock = output::prepare_file(out, files.chain(self.bank.iter().cloned()))?;
        let model = self.model.load()?;
        let datasets = self.holes.iter().map(|path| Ok(Dataset::open(path)?)).collect::<Result<Vec<_>>>()?;
        let mut samples = Samples::new(&model, self.side);
        for path in &self.bank {
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
