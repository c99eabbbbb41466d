//! `tactile-data compare`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;
use tactile_data::dataset::compare::region::Region;
use tactile_data::dataset::compare::{Press, compare};
use tactile_data::file::output;
use tactile_data::frame::Frame;
use tactile_data::frame::picture;
use tactile_data::recording::geometry::FIELD_OF_VIEW_MM;
use tactile_data::{Error, Result, program};

/// A picture of contact is white where a part touches, counts.
const WHITE: u8 = 128;

/// Pixels up to this far from the contact are compared too, mm.
const BAND_MM: f64 = 1.0;

/// Compare a simulated picture with a real one of the same press.
///
/// Compared is how each differs from its own sensor at rest, up to 1 mm from the contact. Exposure is
/// compensated first, on pixels more than 4 mm from the contact.
#[derive(Args)]
#[command(after_help = "Example:\n  \
    tactile-data render letter:A:12 --depth-mm 0.6 --out a.png --at-rest-out rest.png\n  \
    tactile-data compare photo.png a.png --no-contact no-contact.png rest.png \
    --out both.png")]
pub struct Compare {
    /// The real frame
    real: PathBuf,
    /// The simulated one, of the same size
    simulated: PathBuf,
    /// The real and the simulated sensor at rest
    #[arg(long, num_args = 2, required = true, value_names = ["REAL", "SIMULATED"])]
    no_contact: Vec<PathBuf>,
    /// Draw real, simulated and their difference side by side, what each changes and the pixels compared below
    #[arg(long, value_name = "FILE.png")]
    out: Option<PathBuf>,
    /// A picture that is white where the part touches, such as render makes with --fidelity geometry [default:
    /// where the real frame shows an edge]
    #[arg(long, value_name = "FILE.png", help_heading = "Compared pixels")]
    contact: Option<PathBuf>,
    /// What a frame shows along x and y, mm
    #[arg(long, num_args = 2, value_names = ["X", "Y"], default_values_t = FIELD_OF_VIEW_MM,
          help_heading = "Compared pixels")]
    field_of_view_mm: Vec<f64>,
    /// Print JSON
    #[arg(long, help_heading = "For programs")]
    json: bool,
}

impl Compare {
    /// Compares, prints the figures and draws the pictures.
    pub fn run(self) -> Result<()> {
        let [real_rest, simulated_rest] = &self.no_contact[..] else {
            return Err(Error::invalid("--no-contact", "two frames", self.no_contact.len().to_string()));
        };
        let frames = [&self.real, &self.simulated, real_rest, simulated_rest];
        let inputs = frames.into_iter().chain(&self.contact);
        let _lock = self.out.as_ref().map(|out| output::check_file(out, inputs)).transpose()?;
        let [real, simulated, real_rest, simulated_rest] = frames.map(|path| picture::read(path));
        let (real, simulated, real_rest, simulated_rest) = (real?, simulated?, real_rest?, simulated_rest?);
        let size_px = [real.width_px(), real.height_px()];
        let mm_per_px = super::mm_per_px(&self.field_of_view_mm, size_px)?;
        let pressed = Press { frame: &real, at_rest: &real_rest };
        let contact = match &self.contact {
            Some(path) => touched(path)?,
            None => pressed.contact()?,
        };
        let rendered = Press { frame: &simulated, at_rest: &simulated_rest };
        let compared = compare(pressed, rendered, &contact, mm_per_px, BAND_MM)?;
        if let Some(path) = &self.out {
            picture::write_png(path, &compared.picture(&real, &simulated)?)?;
        }
        let (figures, [real_gain, simulated_gain]) = (&compared.figures, compared.gains);
        let share = compared.pixels.len() as f64 / (size_px[0] * size_px[1]) as f64;
        let text = if self.json {
            let json = json!({
                "schema": "tactile-filter/comparison/1", "figures": figures, "n_pixels": compared.pixels.len(),
                "share": share, "n_exposure_pixels": compared.n_exposure_pixels, "far_counts": compared.far_counts,
                "real_gain": real_gain, "simulated_gain": simulated_gain,
            });
            super::pretty(&json)?
        } else {
            format!(
                "compared     {} pixels, {:.0} % of the frame\n\
                 error        {:.2} counts mean absolute; the bare background {:.2}, ratio {:.3}\n\
                 correlation  {:.3}\n\
                 PSNR         {:.1} dB\n\
                 exposure     real {real_gain:.3?}, simulated {simulated_gain:.3?} of that at rest",
                compared.pixels.len(),
                100.0 * share,
                figures.l1_counts,
                figures.background_l1_counts,
                figures.ratio,
                figures.correlation,
                figures.psnr_db,
            )
        };
        program::say(text);
        Ok(())
    }
}

/// The white pixels of a picture.
fn touched(path: &Path) -> Result<Region> {
    let frame: Frame = picture::read(path)?;
    let is_white = frame.rgb().as_chunks::<3>().0.iter().map(|rgb| rgb.iter().all(|v| *v >= WHITE));
    Region::new([frame.width_px(), frame.height_px()], is_white.collect())
}
