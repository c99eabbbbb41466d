//! `tactile-data render`.

use std::path::{Path, PathBuf};

use clap::Args;
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::file::output_lock::OutputLock;
use tactile_data::frame::npy;
use tactile_data::frame::picture;
use tactile_data::light::calibrate::Calibration;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::shape::file::{FileScale, ending};
use tactile_data::scene::shape::heights::GreyScale;
use tactile_data::sensor::render::{Press, Rendered, relief, render};
use tactile_data::sensor::{Fidelity, SensorSpec};
use tactile_data::{Error, Result};

/// The frame of a Mini that is not reduced, pixels.
const FRAME_PX: [usize; 2] = [320, 240];

/// Render one press of one part, to compare it with a photograph.
///
/// The part is letter:A:12 (height in mm), connector:usb-a, ball:4.7 or cylinder:6 (diameter in mm), ring:8:5 (outer
/// and inner diameter), cuboid:10x6 (sides), or a file: an outline (SVG), heights (npy in mm, grey PNG) or a mesh
/// (STL, mm). x runs to the right, y downwards.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    tactile-data render letter:A:12 --as-hole --pose 1,0,30 --depth-mm 0.6 --out a.png\n  \
    tactile-data render punch.npy --map-mm-per-px 0.03,0.03 --calibration mine.toml --no-contact rest.png \
    --out punch.png")]
pub struct Render {
    /// letter:A:12, connector:usb-a, ball:4.7, cylinder:6, ring:8:5, cuboid:10x6, or a file ending in svg, npy, png or stl
    shape: String,
    /// The picture to write
    #[arg(long, value_name = "FILE.png")]
    out: PathBuf,
    /// The part is a plate, not raised: an outline is its opening, heights are its surface with grooves and pockets
    #[arg(long)]
    as_hole: bool,
    /// By how much an outline's opening is wider on every side, mm [default: 0]
    #[arg(long, value_name = "MM", requires = "as_hole", help_heading = "Part")]
    clearance_mm: Option<f64>,
    /// Where the middle of the sensor is on the part, mm, and by how much it is turned, degrees from x to y
    #[arg(long, value_name = "X,Y,DEG", default_value = "0,0,0", allow_hyphen_values = true,
          value_parser = super::parse_numbers::<3>)]
    pose: [f64; 3],
    /// How deep the part's highest point is pressed in, mm
    #[arg(long, value_name = "MM", default_value_t = 0.6)]
    depth_mm: f64,
    /// Size of a pixel of an npy or PNG in x and y, mm
    #[arg(long, value_name = "X,Y", value_parser = super::parse_numbers::<2>, help_heading = "Part")]
    map_mm_per_px: Option<[f64; 2]>,
    /// Height from black to white of a PNG, mm
    #[arg(long, value_name = "MM", help_heading = "Part")]
    full_scale_mm: Option<f64>,
    /// The sensor's light, gel and scale, as calibrate writes them [default: a Mini's]
    #[arg(long, value_name = "FILE.toml", help_heading = "Sensor")]
    calibration: Option<PathBuf>,
    /// A frame of your sensor at rest, which the press then changes
    #[arg(long, value_name = "FRAME", help_heading = "Sensor")]
    no_contact: Option<PathBuf>,
    /// geometry, gel, optics, camera or shadow
    #[arg(long, value_name = "TIER", default_value = "optics", help_heading = "Sensor")]
    fidelity: Fidelity,
    /// Size of the frame, pixels [default: the no-contact frame's, the calibration's, or 320x240]
    #[arg(long, value_name = "WxH", value_parser = super::parse_size, help_heading = "Sensor")]
    frame_px: Option<[usize; 2]>,
    /// What the frame shows along x and y, mm [default: the calibration's, or 18.6 14.3]
    #[arg(long, num_args = 2, value_names = ["X", "Y"], conflicts_with = "mm_per_px", help_heading = "Sensor")]
    field_of_view_mm: Option<Vec<f64>>,
    /// Size of the frame's pixels in x and y, mm, instead of the field of view
    #[arg(long, value_name = "X,Y", value_parser = super::parse_numbers::<2>, help_heading = "Sensor")]
    mm_per_px: Option<[f64; 2]>,
    /// Draws what the camera adds
    #[arg(long, default_value_t = 1, help_heading = "Sensor")]
    seed: u64,
    /// Also write the sensor at rest
    #[arg(long, value_name = "FILE.png", help_heading = "More outputs")]
    at_rest_out: Option<PathBuf>,
    /// Also write how far the gel is pushed in at each pixel, mm
    #[arg(long, value_name = "FILE.npy", help_heading = "More outputs")]
    heights_out: Option<PathBuf>,
}

impl Render {
    /// Renders the press and writes what is asked for.
    pub fn run(self) -> Result<()> {
        let _locks = self.check_outputs()?;
        self.check_part()?;
        let no_contact = self.no_contact.as_deref().map(picture::read).transpose()?;
        let rest_px = no_contact.as_ref().map(|frame| [frame.width_px(), frame.height_px()]);
        let spec = self.sensor(rest_px)?;
        let side = if self.as_hole { Side::Hole } else { Side::Peg };
        let grey = self.full_scale_mm.map(GreyScale::FullScaleMm);
        let scale = FileScale { mm_per_px: self.map_mm_per_px, grey };
        let relief = relief(&self.shape, side, &scale, self.clearance_mm.unwrap_or(0.0))?;
        let [x_mm, y_mm, theta_deg] = self.pose;
        let part_from_sensor = Se2::from_degrees(x_mm, y_mm, theta_deg);
        let press = Press { relief: &relief, side, part_from_sensor, depth_mm: self.depth_mm };
        let Rendered { frame, at_rest, depths_mm } =
            render(&spec, self.fidelity, no_contact.as_ref(), &press, self.seed)?;
        picture::write_png(&self.out, &frame)?;
        if let Some(path) = &self.at_rest_out {
            picture::write_png(path, &at_rest)?;
        }
        if let Some(path) = &self.heights_out {
            npy::write(path, &[spec.frame_px[1], spec.frame_px[0]], &depths_mm)?;
        }
        Ok(())
    }

    /// Refuses flags that a part of this kind does not look at.
    fn check_part(&self) -> Result<()> {
        let ending = ending(Path::new(&self.shape));
        let is_map = matches!(ending.as_str(), "png" | "npy");
        let has_outline = !is_map && ending != "stl" && !self.shape.starts_with("connector:");
        let flags = [
            ("--clearance-mm", self.clearance_mm.is_some() && !has_outline, "an outline: a letter, a solid or an SVG"),
            ("--map-mm-per-px", self.map_mm_per_px.is_some() && !is_map, "heights in npy or PNG"),
            ("--full-scale-mm", self.full_scale_mm.is_some() && ending != "png", "heights in PNG"),
        ];
        match flags.into_iter().find(|(_, does_nothing, _)| *does_nothing) {
            Some((flag, _, expected)) => Err(Error::invalid(flag, expected, &self.shape)),
            None => Ok(()),
        }
    }

    /// Refuses outputs that are inputs or each other.
    fn check_outputs(&self) -> Result<Vec<OutputLock>> {
        let mut taken = vec![Path::new(&self.shape)];
        taken.extend(self.calibration.as_deref());
        taken.extend(self.no_contact.as_deref());
        let mut locks = Vec::new();
        for out in [Some(&self.out), self.at_rest_out.as_ref(), self.heights_out.as_ref()].into_iter().flatten() {
            locks.push(output::check_file(out, &taken)?);
            taken.push(out);
        }
        Ok(locks)
    }

    /// The sensor that the options describe.
    fn sensor(&self, rest_px: Option<[usize; 2]>) -> Result<SensorSpec> {
        let calibration = self.calibration.as_ref().map(Calibration::load).transpose()?;
        let mut spec = SensorSpec { frame_px: FRAME_PX, ..SensorSpec::default() };
        if let Some(calibration) = &calibration {
            spec = calibration.spec(spec)?;
        }
        spec.frame_px = self.frame_px.or(rest_px).unwrap_or(spec.frame_px);
        if let Some(view) = &self.field_of_view_mm {
            spec.field_of_view_mm = [view[0], view[1]];
        }
        if let Some(mm_per_px) = self.mm_per_px {
            spec.field_of_view_mm = [0, 1].map(|axis| mm_per_px[axis] * spec.frame_px[axis] as f64);
        }
        if let Some(calibration) = &calibration {
            spec = calibration.light_for(spec)?;
        }
        spec.validate()?;
        Ok(spec)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::{Command, FromArgMatches};

    fn refusal(line: &str) -> Option<String> {
        let line = format!("render {line} --out o.png");
        let matches = Render::augment_args(Command::new("render")).get_matches_from(line.split_whitespace());
        Render::from_arg_matches(&matches).unwrap().check_part().err().map(|error| error.to_string())
    }

    #[test]
    fn a_flag_that_the_part_does_not_look_at_is_refused() {
        for line in [
            "letter:A:12 --as-hole --clearance-mm 0.2",
            "ball:4.7 --as-hole --clearance-mm 0.2",
            "a.svg --as-hole --clearance-mm 0.2",
            "a.npy --map-mm-per-px 1,1",
            "a.png --map-mm-per-px 1,1 --full-scale-mm 2",
            "connector:usb-a --as-hole",
        ] {
            assert_eq!(refusal(line), None, "{line}");
        }
        for (line, refused) in [
            ("connector:usb-a --as-hole --clearance-mm 0.2", "--clearance-mm: expected an outline"),
            ("a.npy --as-hole --map-mm-per-px 1,1 --clearance-mm 0.2", "--clearance-mm"),
            ("letter:A:12 --map-mm-per-px 1,1", "--map-mm-per-px: expected heights in npy or PNG, got letter:A:12"),
            ("a.npy --map-mm-per-px 1,1 --full-scale-mm 2", "--full-scale-mm"),
            ("a.svg --full-scale-mm 2", "--full-scale-mm: expected heights in PNG, got a.svg"),
        ] {
            let error = refusal(line).unwrap();
            assert!(error.starts_with(refused), "{line}: {error}");
        }
    }
}
