//! `tactile-infer align`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::dataset::store::{self, Dataset};
use tactile_data::pose::se2::Se2;
use tactile_data::program;
use tactile_data::program::progress::reporter;
use tactile_infer::Result;
use tactile_infer::calibration::offset::{Offset, estimate};

use super::{ModelArgs, print_json};

/// Find where the hole board was mounted against the peg board, and note it with the pegs.
///
/// What is found is noted in meta.json of the pegs; whoever opens the dataset then gets their poses in the hole board's
/// frame. The index stays as it was recorded.
#[derive(Args)]
#[command(after_help = "Examples:\n  tactile-infer align --model infer/models/maze-small.safetensors --data board\n  \
                        tactile-infer align --model infer/models/maze-small.safetensors --data pegs --holes holes --dry-run")]
pub struct AlignArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// Dataset with peg touches of known part and pose
    #[arg(long, value_name = "DIR", alias = "pegs")]
    data: PathBuf,
    /// Dataset with hole touches of the same parts [default: the dataset of the pegs]
    #[arg(long, value_name = "DIR")]
    holes: Option<PathBuf>,
    /// Note this offset instead: pose of the hole board in the peg board's frame, mm and degrees
    #[arg(long, value_name = "X,Y,DEG", allow_hyphen_values = true, value_parser = pose,
          conflicts_with_all = ["holes", "json", "device"])]
    given: Option<Se2>,
    /// Find the offset and print it, but note nothing
    #[arg(long, conflicts_with = "given")]
    dry_run: bool,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
}

impl AlignArgs {
    /// Runs the command.
    pub fn run(&self) -> Result<()> {
        if let Some(given) = self.given {
            store::set_peg_from_hole(&self.data, given)?;
            let data = self.data.display();
            program::say(format_args!("{data}: the hole board is noted at {} of the peg board", text(&given)));
            return Ok(());
        }
        let (model, pegs) = (self.model.load()?, Dataset::open(&self.data)?);
        let other = self.holes.as_ref().map(|path| Dataset::open(path)).transpose()?;
        let found = estimate(&model, other.as_ref().unwrap_or(&pegs), &pegs, &reporter("%"))?;
        // Poses of pegs are in the frame of what was noted before.
        let noted = pegs.meta().peg_from_hole.unwrap_or(Se2::IDENTITY);
        let peg_from_hole = noted * found.peg_from_hole;
        let keeps = self.dry_run || !found.is_significant();
        if !keeps {
            store::set_peg_from_hole(&self.data, peg_from_hole)?;
        }
        if self.json {
            return print_json(&found);
        }
        let Offset { error: [x, y, turn], n_pairs, cosine: [with, without], .. } = found;
        println!("{n_pairs} pairs: the hole board is at {} of the peg board", text(&found.peg_from_hole));
        println!(
            "  standard errors {x:.3} mm, {y:.3} mm, {turn:.2} degrees; mean cosine {without:.3} before, {with:.3} after"
        );
        match (keeps, self.dry_run) {
            (true, true) => println!("  noted nothing"),
            (true, false) => println!("  no more than chance: noted nothing"),
            _ => program::say(format_args!("  noted in {}: {} in all", self.data.display(), text(&peg_from_hole))),
        }
        Ok(())
    }
}

fn text(pose: &Se2) -> String {
    format!("x {:.2} mm, y {:.2} mm, {:.2} degrees", pose.x_mm, pose.y_mm, pose.theta_deg())
}

fn pose(text: &str) -> std::result::Result<Se2, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|number| number.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, deg] if [x, y, deg].iter().all(|n| n.is_finite() && n.abs() < 1e4) => Ok(Se2::from_degrees(x, y, deg)),
        _ => Err("expected three numbers with commas between, such as 0.5,-0.2,1".into()),
    }
}
