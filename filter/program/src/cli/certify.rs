//! `tactile-filter certify`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::program;
use tactile_eval::certify::{Certified, certify};
use tactile_eval::{Error, Result};
use tactile_filter::Settings;
use tactile_infer::bank::views::Views;
use tactile_infer::embedding::checkpoint::Checkpoint;
use tactile_infer::maps::MapFile;
use tactile_infer::maps::verifier::Verifier;

use super::merge::{merged, shards_at};

/// Fit how sure it is that a named part is there, so that strangers are named as rarely as `false_accept` says; stored with the model,
/// or with what draws and verifies maps.
///
/// The evaluations are of parts that are neither trained on nor evaluated: some with --absent, whose holes are strangers to their
/// banks, some without; best under several sensors. No rate can be told below one in their number.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter evaluate ... --shard 1/1 --out there\n  \
                        tactile-filter evaluate ... --absent --shard 1/1 --out strangers\n  \
                        tactile-filter certify there strangers --model model/model.safetensors")]
pub struct Certify {
    /// Folders of shards that `tactile-filter evaluate --shard` wrote, or single ones; each is a whole evaluation
    #[arg(required = true, value_name = "SHARD|DIR")]
    evaluations: Vec<PathBuf>,
    /// Store the numbers with this model, by which the episodes were inferred
    #[arg(long, value_name = "FILE", required_unless_present = "maps", conflicts_with = "maps")]
    model: Option<PathBuf>,
    /// Store them with this verifier, which judged the episodes' touches (evaluate --maps)
    #[arg(long, value_name = "FILE")]
    maps: Option<PathBuf>,
    /// Write the file here [default: into the file itself]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl Certify {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let shards = self.evaluations.iter().map(|path| shards_at(path)).collect::<Result<Vec<_>>>()?;
        let Some(path) = self.maps.as_ref().or(self.model.as_ref()) else {
            return Err(Error::invalid("certify", "--model or --maps", "neither"));
        };
        let out = self.out.as_ref().unwrap_or(path);
        let _lock = output::prepare_file(out, shards.iter().flatten())?;
        let evaluations = shards.iter().map(|files| merged(files)).collect::<Result<Vec<_>>>()?;
        let false_accept = Settings::default().false_accept.unwrap_or(0.01);
        let certified = certify(&evaluations, self.maps.is_some(), false_accept)?;
        let setup = &evaluations[0].setup;
        let side = setup.side;
        let is_of = |what: &str, file: &str, episodes: &str| match file == episodes {
            true => Ok(()),
            false => {
                Err(Error::invalid(what, format!("{file:.12}, as {} has", path.display()), format!("{episodes:.12}")))
            }
        };
        if self.maps.is_some() {
            let file = MapFile::load(path)?;
            let verifier = Verifier::new(&file)?;
            let judged = setup.verifier_sha256.as_deref().unwrap_or("no verifier");
            is_of(
                "the episodes' verifier",
                verifier.as_ref().map_or("no verifier", |verifier| verifier.sha256()),
                judged,
            )?;
            let on = if setup.views == Views::Both { side } else { Side::Peg };
            file.with_presence((side, on), certified.odds).save(out)?;
        } else {
            let (checkpoint, sha256) = Checkpoint::load(path)?;
            is_of("the episodes' model", &sha256, &setup.model.sha256)?;
            checkpoint.with_presence(side, certified.odds).save(out)?;
        }
        say(&certified, &format!("{}: {side}s", out.display()));
        Ok(())
    }
}

fn say(certified: &Certified, place: &str) {
    let Certified { odds, cost_bits, hardest, n_stranger_parts } = certified;
    let kind =
        hardest.as_ref().map_or_else(|| "of all kinds".to_owned(), |kind| format!("of {kind}, the hardest kind,"));
    let shared = odds.shared.map_or("no outline is known".to_owned(), |shared| {
        format!(
            "against strangers that share what was felt {:.2} and {:.2} by what is left",
            shared.offset, shared.by_felt
        )
    });
    program::say(format_args!(
        "{place}: {} episodes with strangers, {} with parts that are there; C_llr {cost_bits:.3} bits\n  \
         offset {:.2}, by fit {:.2}, by touch {:.2}, by verifier {:.2}, by what is expected of it {:.2}, by a known size {:.2}, by one that is off {:.2}, by maps that are {:.2}; {}\n  \
         strangers {kind} {:.2} and {:.2} beyond, against {} parts; parts that are there {:.2} and {:.2}",
        odds.n_strangers,
        odds.n_present,
        odds.offset,
        odds.by_fit,
        odds.by_touch,
        odds.by_verifier,
        odds.by_expected,
        odds.by_size,
        odds.by_strain,
        odds.by_misfit,
        shared,
        odds.strangers.at,
        odds.strangers.scale,
        odds.n_parts,
        odds.present.at,
        odds.present.scale,
    ));
    let least = 100.0 / (n_stranger_parts + 1) as f64;
    program::note(format!(
        "{n_stranger_parts} strangers {kind} certify no rate below {least:.2} %; what is beyond is the tail's"
    ));
}
