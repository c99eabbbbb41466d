//! `tactile-infer mosaics`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::dataset::touch::OUTLINE_REACH_MM;
use tactile_data::file::output;
use tactile_data::frame::Frame;
use tactile_data::frame::picture;
use tactile_data::program;
use tactile_infer::maps::mosaic::{CELL_MM, Mosaic, Place};
use tactile_infer::maps::picture::{of_contact, of_distance, row_of};
use tactile_infer::{Bank, Error, Result};

use super::ModelArgs;

/// Pixels of the picture a cell.
const ENLARGED: usize = 2;

/// Draw the maps of a bank's parts (`tactile-infer bank --maps`): a row for each, how far each place is from the outline of the
/// peg, and what touches the gel, by touches of the peg and then, where the bank has them, of the hole; grey where no touch was made.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-infer mosaics --model infer/models/maze-small.safetensors --bank parts.bank --out parts.png"
)]
pub struct MosaicsArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// The bank
    #[arg(long, value_name = "FILE")]
    bank: PathBuf,
    /// The picture to write
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// Only this part
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
}

impl MosaicsArgs {
    pub fn run(&self) -> Result<()> {
        let _lock = output::check_file(&self.out, [&self.bank, &self.model.path])?;
        let bank = Bank::load(&self.bank, &self.model.load()?)?;
        let expected = "a bank with a map of each part (tactile-infer bank --maps)";
        let mosaics =
            bank.mosaics().ok_or_else(|| Error::invalid(self.bank.display().to_string(), expected, "one without"))?;
        let parts: Vec<usize> = match &self.part {
            None => (0..bank.parts().len()).collect(),
            Some(name) => {
                let part = bank.parts().iter().position(|part| part == name);
                let unknown = || Error::invalid("--part", format!("one of {}", bank.parts().join(" ")), name.clone());
                vec![part.ok_or_else(unknown)?]
            }
        };
        let n = mosaics.shape()[2];
        let mut rgb = Vec::new();
        for part in &parts {
            for (row, side) in (0..ENLARGED * n).flat_map(|row| mosaics.sides().iter().map(move |side| (row, *side))) {
                let mosaic = mosaics.of(*part, side);
                rgb.extend(row_of(&mosaic, row, ENLARGED, |place| of_distance(place.distance_mm, place.error_mm)));
                rgb.extend(row_of(&mosaic, row, ENLARGED, |place| of_contact(place.contact)));
            }
        }
        let width = 2 * mosaics.sides().len() * ENLARGED * n;
        let frame = Frame::new(width, parts.len() * ENLARGED * n, rgb)?;
        picture::write_png(&self.out, &frame)?;
        for (part, side) in parts.iter().flat_map(|part| mosaics.sides().iter().map(move |side| (*part, *side))) {
            let name = &bank.parts()[part];
            let name = if side.is_hole() { format!("{name}, hole") } else { name.clone() };
            program::say(format_args!("{name}: {}", said(&mosaics.of(part, side))));
        }
        program::say(format_args!("{}", self.out.display()));
        Ok(())
    }
}

/// A mosaic in a line.
fn said(mosaic: &Mosaic<'_>) -> String {
    let n = mosaic.n();
    let cells = (0..n * n).map(|at| mosaic.cell(at % n, at / n).1).filter(|place| place.n_seen > 0.0);
    let places: Vec<Place> = cells.collect();
    let area = |is: fn(&Place) -> bool| places.iter().filter(|place| is(place)).count() as f64 * CELL_MM * CELL_MM;
    let near = places.iter().filter(|place| f64::from(place.distance_mm.abs()) < 0.5 * OUTLINE_REACH_MM);
    let mut errors: Vec<f32> = near.map(|place| place.error_mm).collect();
    errors.sort_by(f32::total_cmp);
    format!(
        "{:.0} mm2 of {:.0} seen are inside the outline, which is known to {:.2} mm (median)",
        area(|place| place.inside > 0.5),
        area(|_| true),
        errors.get(errors.len() / 2).copied().unwrap_or(f32::NAN)
    )
}
