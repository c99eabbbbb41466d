//! `tactile-data calibrate`.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;
use tactile_data::calibrate::ball::BallPress;
use tactile_data::calibrate::circle::Circle;
use tactile_data::calibrate::presses::{Presses, Source};
use tactile_data::calibrate::{Calibration, at_rest, fit, taxim};
use tactile_data::compare::Figures;
use tactile_data::sensor::light::LightRig;
use tactile_data::{Error, Result, output, picture, program};

/// Fit a sensor's lamps to presses of a ball, or to Taxim's table.
///
/// Press a ball of known diameter a dozen times or more, all over the frame, and save a frame of each. The program
/// finds where the ball touched, or reads it from labels: a CSV with the columns file, center_x, center_y and
/// radius, in pixels, some pixels off at most. It prints the error of each press when the others predict it.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    tactile-data calibrate presses --ball-mm 4.70 --mm-per-px 0.058,0.0596 --no-contact rest.png\n  \
    tactile-data calibrate --taxim polycalib.npz --frame-px 640x480 --mm-per-px 0.0295,0.0295")]
pub struct Calibrate {
    /// The folder of frames
    #[arg(required_unless_present = "taxim", requires = "ball_mm", requires = "no_contact")]
    folder: Option<PathBuf>,
    /// Diameter of the ball, mm
    #[arg(long, value_name = "MM", conflicts_with = "taxim")]
    ball_mm: Option<f64>,
    /// Size of a pixel in x and y, mm
    #[arg(long, value_name = "X,Y", value_parser = super::parse_numbers::<2>, required_unless_present = "px_per_mm")]
    mm_per_px: Option<[f64; 2]>,
    /// Pixels per mm, instead of --mm-per-px
    #[arg(long, value_name = "N", conflicts_with = "mm_per_px")]
    px_per_mm: Option<f64>,
    /// A frame of the sensor at rest
    #[arg(long, value_name = "FRAME")]
    no_contact: Option<PathBuf>,
    /// Where the ball touched in each frame [default: it is found]
    #[arg(long, value_name = "CSV", conflicts_with = "taxim")]
    labels: Option<PathBuf>,
    /// The calibration to write
    #[arg(long, value_name = "FILE.toml", default_value = "calibration.toml")]
    out: PathBuf,
    /// Read Taxim's polycalib.npz instead of presses
    #[arg(
        long,
        value_name = "NPZ",
        conflicts_with = "folder",
        requires = "frame_px",
        help_heading = "From a table of Taxim"
    )]
    taxim: Option<PathBuf>,
    /// Size of the frames that Taxim's table was made for, pixels
    #[arg(long, value_name = "WxH", value_parser = super::parse_size, requires = "taxim",
          help_heading = "From a table of Taxim")]
    frame_px: Option<[usize; 2]>,
    /// Print JSON
    #[arg(long, help_heading = "For programs")]
    json: bool,
}

impl Calibrate {
    /// Fits, prints the errors and writes the file.
    pub fn run(self) -> Result<()> {
        let _lock = output::check_file(&self.out, self.inputs())?;
        let mm_per_px = self.mm_per_px.unwrap_or_else(|| [1.0 / self.px_per_mm.unwrap_or(f64::NAN); 2]);
        let (calibration, text, json) = match (&self.taxim, &self.folder) {
            (Some(table), _) => self.fit_table(table, mm_per_px)?,
            (None, Some(folder)) => self.fit_presses(folder, mm_per_px)?,
            (None, None) => return Err(Error::invalid("calibrate", "a folder of presses or --taxim", "neither")),
        };
        calibration.save(&self.out)?;
        let text = if self.json { super::pretty(&json)? } else { format!("{text}{} written", self.out.display()) };
        program::say(text);
        Ok(())
    }

    /// The files that are read.
    fn inputs(&self) -> Vec<PathBuf> {
        let given = [&self.no_contact, &self.labels, &self.taxim].into_iter().flatten().cloned();
        // A folder that cannot be read is reported when its frames are.
        let entries = self.folder.iter().filter_map(|folder| std::fs::read_dir(folder).ok()).flatten();
        let frames = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| picture::is_picture(path));
        given.chain(frames).collect()
    }

    fn fit_presses(&self, folder: &Path, mm_per_px: [f64; 2]) -> Result<Outcome> {
        let source = Source {
            no_contact: self.no_contact.clone().unwrap_or_default(),
            labels: self.labels.clone(),
            ball_mm: self.ball_mm.unwrap_or(f64::NAN),
            mm_per_px,
        };
        let presses = Presses::read(folder, &source)?;
        let fit::Fit { calibration, contacts, left_out } = fit::fit(&presses)?;
        let mut text = format!(
            "{:<24} {:>6} {:>6} {:>6} {:>8} {:>8} {:>6} {:>6} {:>7}\n",
            "press left out", "x px", "y px", "r px", "L1", "at rest", "ratio", "corr", "PSNR"
        );
        let row = |figures: &Figures| {
            let Figures { l1_counts, background_l1_counts, ratio, correlation, psnr_db } = figures;
            format!("{l1_counts:>8.2} {background_l1_counts:>8.2} {ratio:>6.3} {correlation:>6.3} {psnr_db:>7.1}\n")
        };
        let mut rows = Vec::new();
        for (contact, (name, figures)) in contacts.iter().zip(&left_out) {
            let ([x, y], radius) = (contact.centre_px, contact.radius_px);
            text += &format!("{name:<24} {x:>6.1} {y:>6.1} {radius:>6.1} {}", row(figures));
            let depth_mm = depth_mm(&calibration, &presses, contact);
            rows.push(json!({
                "file": name, "centre_px": [x, y], "radius_px": radius, "depth_mm": depth_mm, "left_out": figures,
            }));
        }
        if let Some(mean) = &calibration.leave_one_out {
            text += &format!("{:<45} {}", "mean, counts and dB", row(mean));
        }
        if let (Some(length), Some(share)) = (calibration.gel_length_mm, calibration.contact_share) {
            let moved_px = moved_px(&presses, &contacts);
            text += &format!(
                "gel length {length} mm; contact {share:.2} of the circles' radius, {moved_px:.1} px from them\n"
            );
        }
        let json = json!({ "calibration": calibration, "presses": rows });
        Ok((calibration, text, json))
    }

    fn fit_table(&self, table: &Path, mm_per_px: [f64; 2]) -> Result<Outcome> {
        let at_rest = match &self.no_contact {
            Some(frame) => at_rest(&picture::read(frame)?)?,
            None => LightRig::default().at_rest,
        };
        let read = taxim::read(table, self.frame_px.unwrap_or_default(), mm_per_px, at_rest)?;
        let text = format!(
            "fit to the table's red, green and blue: {:.1?} counts rms left of {:.1?}\n",
            read.error_rms, read.table_rms
        );
        let json = json!({
            "calibration": read.calibration, "table_rms": read.table_rms, "error_rms": read.error_rms,
        });
        Ok((read.calibration, text, json))
    }
}

/// How deep the ball is pressed in by the gel that was fitted, mm.
fn depth_mm(calibration: &Calibration, presses: &Presses, contact: &Circle) -> Option<f64> {
    let contact_mm = presses.geometry.radius_mm(contact);
    let radius_mm = presses.geometry.ball_radius_mm;
    Some(BallPress::new(radius_mm, contact_mm, calibration.gel_length_mm?, 2.0 * radius_mm).depth_mm(0.0))
}

/// How far contacts are from the presses' circles on average, pixels.
fn moved_px(presses: &Presses, contacts: &[Circle]) -> f64 {
    let moved = presses.presses.iter().zip(contacts).map(|(press, contact)| {
        let [dx, dy] = [0, 1].map(|axis| contact.centre_px[axis] - press.circle.centre_px[axis]);
        dx.hypot(dy)
    });
    moved.sum::<f64>() / contacts.len().max(1) as f64
}

/// The calibration, what is said of it to people, and to programs.
type Outcome = (Calibration, String, serde_json::Value);
