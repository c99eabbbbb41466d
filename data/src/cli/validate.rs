//! `tactile-data ring` and `tactile-data walls`, hidden: what `cargo xtask validate` asks of real pictures.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use tactile_data::dataset::compare::Press;
use tactile_data::dataset::compare::ring::{self, Ring};
use tactile_data::dataset::compare::walls::{self, Shading};
use tactile_data::frame::Frame;
use tactile_data::frame::picture;
use tactile_data::scene::shape::file::{Drawn, FileScale, read};
use tactile_data::scene::shape::heights::GreyScale;
use tactile_data::{Error, Result};

/// Measure how far from a predicted outline the ring is that a face's edge makes in a frame.
#[derive(Args)]
#[command(after_help = "Example:\n  \
    tactile-data ring press.png --no-contact rest.png --outline 90,190,90,50,230,50,230,190")]
pub struct FindRing {
    /// The frame of the press
    frame: PathBuf,
    /// The same sensor at rest
    #[arg(long, value_name = "FRAME")]
    no_contact: PathBuf,
    /// Corners of the outline in order, pixels from the middle of the first one
    #[arg(long, value_name = "X,Y,X,Y,...", value_delimiter = ',', required = true)]
    outline: Vec<f64>,
    /// How far from the outline to look, pixels
    #[arg(long, value_name = "N", default_value_t = 10)]
    reach_px: usize,
    /// Print JSON for programs
    #[arg(long)]
    json: bool,
}

impl FindRing {
    /// Finds the ring and prints where it is.
    pub fn run(self) -> Result<()> {
        let (corners, rest) = self.outline.as_chunks::<2>();
        if !rest.is_empty() {
            return Err(Error::invalid("--outline", "an x and a y for each corner", self.outline.len().to_string()));
        }
        let (frame, at_rest) = (picture::read(&self.frame)?, picture::read(&self.no_contact)?);
        let ring = ring::find(Press { frame: &frame, at_rest: &at_rest }, corners, self.reach_px)?;
        let Ring { offset_px, moved_px, moved_offset_px, sides_px, counts } = ring;
        let text = if self.json {
            super::pretty(&json!({
                "schema": "tactile-filter/ring/1", "offset_px": offset_px, "moved_px": moved_px,
                "moved_offset_px": moved_offset_px, "sides_px": sides_px, "counts": counts,
            }))?
        } else {
            format!(
                "as predicted  {offset_px:+} pixels outside\n\
                 moved         by {:+}, {:+} pixels: {moved_offset_px:+} outside, {counts:.1} counts\n\
                 side by side  {sides_px:+?}",
                moved_px[0], moved_px[1]
            )
        };
        println!("{text}");
        Ok(())
    }
}

/// Check whether pictures shade the walls of a known surface as its height map says.
///
/// Each channel of each picture is taken for one lamp. The direction of the lamp is taken from one wall of the map
/// and tested on every other.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-data walls plate.npy --mm-per-px 0.0275,0.0275 light1.png light2.png")]
pub struct Walls {
    /// The heights: npy in mm or grey PNG
    map: PathBuf,
    /// Pictures of the same size
    #[arg(required = true)]
    pictures: Vec<PathBuf>,
    /// Size of a pixel in x and y, mm
    #[arg(long, value_name = "X,Y", value_parser = super::parse_numbers::<2>)]
    mm_per_px: [f64; 2],
    /// Height from black to white of a PNG, mm
    #[arg(long, value_name = "MM")]
    full_scale_mm: Option<f64>,
    /// What is steeper than this is a wall, mm a mm
    #[arg(long, value_name = "SLOPE", default_value_t = 0.1)]
    steeper_than: f64,
    /// The sensor at rest, against which changes are taken [default: what is next to a wall]
    #[arg(long, value_name = "FRAME")]
    no_contact: Option<PathBuf>,
    /// Print JSON for programs
    #[arg(long)]
    json: bool,
}

impl Walls {
    /// Finds the walls and prints what each picture shows of them.
    pub fn run(self) -> Result<()> {
        let scale = FileScale { mm_per_px: Some(self.mm_per_px), grey: self.full_scale_mm.map(GreyScale::FullScaleMm) };
        let Drawn::Heights(map) = read(&self.map, &scale)? else {
            return Err(Error::invalid(self.map.display().to_string(), "heights", "an outline"));
        };
        if !(self.steeper_than.is_finite() && self.steeper_than > 0.0) {
            return Err(Error::invalid("--steeper-than", "a positive slope", self.steeper_than.to_string()));
        }
        let walls = walls::find(&map, self.steeper_than);
        if walls.len() < 2 {
            let expected = format!("two walls steeper than {} or more", self.steeper_than);
            return Err(Error::invalid(self.map.display().to_string(), expected, walls.len().to_string()));
        }
        let at_rest = self.no_contact.as_deref().map(picture::read).transpose()?;
        let mut text = format!("{} walls, the largest first; by what share each is brighter:\n", walls.len());
        let mut pictures = Vec::new();
        for path in &self.pictures {
            let frame = picture::read(path)?;
            let mut channels = Vec::new();
            for (name, values) in lamps(&frame) {
                let rest = at_rest.as_ref().map(|rest| channel(rest, name.unwrap_or(0)));
                let shown =
                    walls::shading(&walls, &map, &values, rest.as_deref()).map_err(|e| e.within(path.display()))?;
                let [n_right, n_tested] = walls::signs(&walls, &shown);
                let mean = |value: fn(&Shading) -> f64| shown.iter().map(value).sum::<f64>() / shown.len() as f64;
                let (strength, inside) = (mean(|shading| shading.change.abs()), mean(|shading| shading.inside));
                let changes: Vec<f64> = shown.iter().map(|shading| shading.change).collect();
                let lamp = name.map_or("grey", |channel| ["red", "green", "blue"][channel]);
                text += &format!(
                    "{} {lamp}: {n_right} of {n_tested} signs right, {:.0} % inside, {changes:+.2?}\n",
                    path.display(),
                    100.0 * inside
                );
                channels.push(json!({
                    "channel": lamp, "changes": changes, "n_right": n_right, "n_tested": n_tested,
                    "strength": strength, "inside": inside,
                }));
            }
            pictures.push(json!({ "file": path, "channels": channels }));
        }
        if self.json {
            let walls = walls
                .iter()
                .map(|wall| json!({ "n_pixels": wall.pixels.len(), "centre_px": wall.centre_px, "slope": wall.slope }));
            let walls: Vec<_> = walls.collect();
            text = super::pretty(&json!({ "schema": "tactile-filter/walls/1", "walls": walls, "pictures": pictures }))?;
        }
        println!("{}", text.trim_end());
        Ok(())
    }
}

/// The channels of a picture that differ, each with its number; a grey picture's only one.
fn lamps(frame: &Frame) -> Vec<(Option<usize>, Vec<f32>)> {
    let is_grey = frame.rgb().as_chunks::<3>().0.iter().all(|[r, g, b]| r == g && g == b);
    let of = |c: usize| (Some(c).filter(|_| !is_grey), channel(frame, c));
    if is_grey { vec![of(0)] } else { (0..3).map(of).collect() }
}

fn channel(frame: &Frame, channel: usize) -> Vec<f32> {
    frame.rgb().iter().skip(channel).step_by(3).map(|counts| f32::from(*counts)).collect()
}
