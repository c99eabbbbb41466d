//! `tactile-data calibrate`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::lamp_table::LampTable;
use tactile_data::dataset::compare::Figures;
use tactile_data::dataset::store::{self, Dataset};
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::frame::Frame;
use tactile_data::frame::picture;
use tactile_data::light::calibrate::ball::BallPress;
use tactile_data::light::calibrate::circle::Circle;
use tactile_data::light::calibrate::presses::{Presses, Source};
use tactile_data::light::calibrate::twins::{self, KnownTouch};
use tactile_data::light::calibrate::{Calibration, at_rest, fit, taxim};
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::light::LightRig;
use tactile_data::{Error, Result, program};

/// Fit a sensor's lamps to presses of a ball, to touches of anything, or to Taxim's table.
///
/// Press a ball of known diameter 20 times or more, all over the frame (its edge may cut a ball whose middle is in
/// view), and save a frame of each. The program finds where the ball touched, or reads it from labels: a CSV with the
/// columns file, center_x, center_y and radius, in pixels, some pixels off at most. It prints the error of each press
/// when the others predict it.
///
/// Without a ball: 20 touches of edges or more, of whatever parts, in a dataset or a folder of frames (--touches).
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    tactile-data calibrate presses --ball-mm 4.70 --mm-per-px 0.058,0.0596 --no-contact rest.png\n  \
    tactile-data calibrate touches --touches --px-per-mm 17.2 --no-contact rest.png\n  \
    tactile-data calibrate polycalib.npz --frame-px 640x480 --mm-per-px 0.0295,0.0295")]
pub struct Calibrate {
    /// The folder of frames, with --touches also a dataset, or Taxim's polycalib.npz
    source: PathBuf,
    /// The frames are touches of anything; a dataset brings its scale and frame at rest
    #[arg(long, conflicts_with_all = ["ball_mm", "labels", "frame_px"])]
    touches: bool,
    /// The dataset's touches are of this scene's parts: where it says which and where, they tell the gel, and how strong the lamps are
    /// together
    #[arg(long, value_name = "PRESET|FILE.toml", requires = "touches")]
    scene: Option<String>,
    /// Diameter of the ball, mm
    #[arg(long, value_name = "MM", requires = "no_contact")]
    ball_mm: Option<f64>,
    /// Size of a pixel in x and y, mm
    #[arg(long, value_name = "X,Y", value_parser = super::parse_numbers::<2>, required_unless_present_any = ["px_per_mm", "touches"])]
    mm_per_px: Option<[f64; 2]>,
    /// Pixels per mm, instead of --mm-per-px
    #[arg(long, value_name = "N", conflicts_with = "mm_per_px")]
    px_per_mm: Option<f64>,
    /// A frame of the sensor at rest
    #[arg(long, value_name = "FRAME")]
    no_contact: Option<PathBuf>,
    /// Where the ball touched in each frame [default: it is found]
    #[arg(long, value_name = "CSV")]
    labels: Option<PathBuf>,
    /// The calibration to write
    #[arg(long, value_name = "FILE.toml", default_value = "calibration.toml")]
    out: PathBuf,
    /// Size of the frames that Taxim's table was made for, pixels
    #[arg(long, value_name = "WxH", value_parser = super::parse_size, conflicts_with_all = ["ball_mm", "labels"],
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
        let mm_per_px = self.mm_per_px().unwrap_or([f64::NAN; 2]);
        let is_table = self.source.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz"));
        let (calibration, text, json) = match (is_table, self.frame_px, self.ball_mm) {
            _ if self.touches => self.fit_touches()?,
            (true, Some(frame_px), _) => self.fit_table(frame_px, mm_per_px)?,
            (true, None, _) => return Err(self.lacks("--frame-px, the size of the frames that the table was made for")),
            (false, None, Some(ball_mm)) => self.fit_presses(ball_mm, mm_per_px)?,
            (false, None, None) => return Err(self.lacks("--ball-mm, the diameter of the ball, or --touches")),
            (false, Some(_), _) => return Err(self.lacks("Taxim's table, whose name ends in npz, for --frame-px")),
        };
        calibration.save(&self.out)?;
        let text = if self.json { super::pretty(&json)? } else { format!("{text}{} written", self.out.display()) };
        program::say(text);
        Ok(())
    }

    /// The files that are read.
    fn inputs(&self) -> Vec<PathBuf> {
        let given = [Some(&self.source), self.no_contact.as_ref(), self.labels.as_ref()].into_iter().flatten().cloned();
        let given = given.chain(store::FILES.map(|file| self.source.join(file)));
        // A folder that cannot be read is reported when its frames are.
        let entries = std::fs::read_dir(&self.source).into_iter().flatten();
        let frames = entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| picture::is_picture(path));
        given.chain(frames).collect()
    }

    /// The size of a pixel in x and y, mm, where it is stated.
    fn mm_per_px(&self) -> Option<[f64; 2]> {
        self.mm_per_px.or(self.px_per_mm.map(|n| [1.0 / n; 2]))
    }

    /// What is missing for a source.
    fn lacks(&self, expected: &str) -> Error {
        Error::invalid(self.source.display().to_string(), expected, "none")
    }

    fn fit_presses(&self, ball_mm: f64, mm_per_px: [f64; 2]) -> Result<Outcome> {
        let no_contact = self.no_contact.clone().unwrap_or_default();
        let source = Source { no_contact, labels: self.labels.clone(), ball_mm, mm_per_px };
        let presses = Presses::read(&self.source, &source)?;
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

    fn fit_touches(&self) -> Result<Outcome> {
        let (calibration, lamps) = match (Dataset::is_at(&self.source), &self.scene) {
            (true, None) => LampTable::fit(&Dataset::open(&self.source)?)?,
            (true, Some(scene)) => {
                let (dataset, scene) = (Dataset::open(&self.source)?, Scene::load(scene)?);
                let (mut calibration, lamps) = LampTable::known_or_fit(&dataset)?;
                let touches = known_touches(&dataset, &scene);
                let found = twins::fit(&mut calibration, &scene, dataset.no_contact(), &touches)?;
                (calibration, lamps.with(found))
            }
            (false, None) => {
                let (at_rest, frames, view_mm) = self.folder()?;
                LampTable::of_frames(&at_rest, &frames, view_mm)?
            }
            (false, Some(_)) => return Err(self.lacks("a dataset, whose touches have parts and poses, for --scene")),
        };
        let json = json!({ "calibration": calibration, "lamps": lamps });
        Ok((calibration, lamps.to_string(), json))
    }

    /// The frame at rest, the other frames of the folder and what they show, mm.
    fn folder(&self) -> Result<(Frame, Vec<Frame>, [f64; 2])> {
        let Some(no_contact) = &self.no_contact else {
            return Err(self.lacks("a dataset, or --no-contact, a frame of the sensor at rest"));
        };
        let Some(mm_per_px) = self.mm_per_px() else {
            return Err(self.lacks("a dataset, or --mm-per-px, the size of a pixel"));
        };
        let at_rest = picture::read(no_contact)?;
        let frames = picture::read_folder(&self.source, no_contact)?.into_values().collect();
        let view_mm = [at_rest.width_px() as f64 * mm_per_px[0], at_rest.height_px() as f64 * mm_per_px[1]];
        Ok((at_rest, frames, view_mm))
    }

    fn fit_table(&self, frame_px: [usize; 2], mm_per_px: [f64; 2]) -> Result<Outcome> {
        let at_rest = match &self.no_contact {
            Some(frame) => at_rest(&picture::read(frame)?)?,
            None => LightRig::default().at_rest,
        };
        let read = taxim::read(&self.source, frame_px, mm_per_px, at_rest)?;
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

/// The touches of a dataset that are of a scene's parts and whose pose it knows, evenly spread: as many as are compared with their twins.
fn known_touches(dataset: &Dataset, scene: &Scene) -> Vec<KnownTouch> {
    let parts = scene.part_names();
    let known = |at: usize| {
        let touch = dataset.touch(at);
        let part = touch.part.as_ref().and_then(|part| parts.iter().position(|name| name == part))?;
        Some((at, part, touch.side?, touch.part_from_sensor?))
    };
    let known: Vec<_> = (0..dataset.len()).filter_map(known).collect();
    let spread = known.iter().step_by(known.len().div_ceil(twins::MOST_TOUCHES).max(1));
    let touch = |&(at, part, side, part_from_sensor): &(usize, usize, Side, Se2)| {
        let frame = dataset.frame(at);
        KnownTouch { frame, part, side, part_from_sensor }
    };
    spread.map(touch).collect()
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
