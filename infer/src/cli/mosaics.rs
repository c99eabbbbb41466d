//! `tactile-infer mosaics`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::frame::Frame;
use tactile_data::touch::{OUTLINE_REACH_MM, Side};
use tactile_data::{output, picture, program};
use tactile_infer::maps::mosaic::{CELL_MM, Place};
use tactile_infer::maps::picture::{of_contact, of_distance, row_of};
use tactile_infer::{Bank, Error, Result};

use super::ModelArgs;

/// Pixels of the picture a cell.
const ENLARGED: usize = 2;

/// Draw the maps of a bank's parts (`tactile-infer bank --maps`): a row for each, how far each place is from the outline of the
/// peg, and what touches the gel; grey where no touch was made.
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
            let mosaic = mosaics.of(*part, Side::Peg);
            for row in 0..ENLARGED * n {
                rgb.extend(row_of(&mosaic, row, ENLARGED, |place| of_distance(place.distance_mm, place.error_mm)));
                rgb.extend(row_of(&mosaic, row, ENLARGED, |place| of_contact(place.contact)));
            }
        }
        let frame = Frame::new(2 * ENLARGED * n, parts.len() * ENLARGED * n, rgb)?;
        picture::write_png(&self.out, &frame)?;
        for part in parts {
            let mosaic = mosaics.of(part, Side::Peg);
            let cells = (0..n * n).map(|at| mosaic.cell(at % n, at / n).1).filter(|place| place.n_seen > 0.0);
            let places: Vec<Place> = cells.collect();
            let area =
                |is: fn(&Place) -> bool| places.iter().filter(|place| is(place)).count() as f64 * CELL_MM * CELL_MM;
            let near = places.iter().filter(|place| f64::from(place.distance_mm.abs()) < 0.5 * OUTLINE_REACH_MM);
            let mut errors: Vec<f32> = near.map(|place| place.error_mm).collect();
            errors.sort_by(f32::total_cmp);
            program::say(format_args!(
                "{}: {:.0} mm2 of {:.0} seen are inside the outline, which is known to {:.2} mm (median)",
                bank.parts()[part],
                area(|place| place.inside > 0.5),
                area(|_| true),
                errors.get(errors.len() / 2).copied().unwrap_or(f32::NAN)
            ));
        }
        program::say(format_args!("{}", self.out.display()));
        Ok(())
    }
}
