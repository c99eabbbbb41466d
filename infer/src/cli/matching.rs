//! `tactile-infer match`.

use std::path::{Path, PathBuf};

use clap::Args;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::program::named;
use tactile_infer::calibration::matching::{Touched, match_single_touches};
use tactile_infer::{Error, Precision, Result};

use super::{ModelArgs, PosesArgs, embed_pegs, print_json};

/// What is matched with what.
#[derive(Args)]
pub struct MatchArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Dataset of pegs touched on a grid of poses, simulated or recorded
    #[arg(long, value_name = "DIR")]
    pegs: PathBuf,
    /// Dataset of touches whose part is known: holes, or with --side peg pegs
    #[arg(long, visible_alias = "touches", value_name = "DIR")]
    holes: PathBuf,
    /// Which side of it is matched; pegs of another dataset than --pegs, as each would find itself
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = named::<Side>(Side::NAMES))]
    side: Side,
    /// Match at most this many touches, evenly spread over the dataset
    #[arg(long, value_name = "N", default_value_t = 500)]
    limit: usize,
    /// Format of the rows that are compared with
    #[arg(long, value_name = "FORMAT", default_value_t = Precision::F32, value_parser = named::<Precision>(Precision::ROWS))]
    rows: Precision,
    #[command(flatten)]
    poses: PosesArgs,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl MatchArgs {
    pub fn run(&self) -> Result<()> {
        if self.side == Side::Peg && same_folder(&self.pegs, &self.holes) {
            let got = self.holes.display().to_string();
            return Err(Error::invalid("--holes", "pegs of another dataset than --pegs: each would find itself", got));
        }
        let model = self.model.load()?;
        let (pegs, holes) = (Dataset::open(&self.pegs)?, Dataset::open(&self.holes)?);
        let bank = embed_pegs(&model, &pegs, &self.poses)?.with_precision(self.rows)?;
        let touched = Touched { dataset: &holes, side: self.side, limit: self.limit };
        let found = match_single_touches(&model, &bank, &pegs, touched)?;
        if self.json {
            return print_json(&found);
        }
        let side = self.side;
        println!("one touch, nearest neighbour among {} pegs, {} {side}s:", bank.n_rows(), found.moco.n_holes);
        let rows = [("Pixel", &found.pixel), ("Pixel, sign-flipped", &found.pixel_flipped), ("MoCo", &found.moco)];
        for (name, report) in rows {
            println!(
                "  {name:20} class {:5.1} %   exact cell {:5.1} %   xy {:4.1} mm   theta {:4.1} deg (means over right classes)",
                100.0 * report.accuracy,
                100.0 * report.exact_cell,
                report.xy_mm_mean,
                report.theta_deg_mean
            );
        }
        println!("  correlation of f_PP with f_HP: {:.3}", found.similarities.peg_similarity_correlation);
        println!(
            "  99 in 100 {side}s with an edge reach cosine {:.2} with some peg",
            found.similarities.best_cosine_p01
        );
        Ok(())
    }
}

/// Whether two paths lead to one folder.
fn same_folder(one: &Path, other: &Path) -> bool {
    one.canonicalize().is_ok_and(|one| other.canonicalize().is_ok_and(|other| one == other))
}
