//! `tactile-infer map`: what the network that draws maps sees in a touch.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::frame::picture;
use tactile_data::frame::{Background, Frame};
use tactile_data::light::calibrate::Calibration;
use tactile_data::program::{self, named};
use tactile_infer::maps::picture::{of_contact, of_distance};
use tactile_infer::maps::{DrawnMap, MapDrawer};
use tactile_infer::{Error, Result};

use super::print_json;

#[derive(Args)]
pub struct MapArgs {
    /// Picture of a touch, PNG or JPEG, of the size of the no-contact frame
    #[arg(value_name = "IMAGE")]
    image: PathBuf,
    /// The network, written by tactile-train --maps
    #[arg(long, value_name = "FILE")]
    maps: PathBuf,
    /// Picture of the sensor at rest, from the same camera; the network sees the difference from it
    #[arg(long, value_name = "IMAGE")]
    no_contact: PathBuf,
    /// The sensor's light over these pictures, as `tactile-data calibrate` measured it [default: a GelSight Mini's]
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// The side that is touched
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = named::<Side>(Side::NAMES))]
    side: Side,
    /// Draw the touch, the distance to the peg's outline (blue inside, red outside, pale where it is not sure) and what touches the
    /// gel (dark), side by side
    #[arg(long, value_name = "FILE.png")]
    out: Option<PathBuf>,
    /// Print the map as JSON, rows from the top
    #[arg(long)]
    json: bool,
}

/// What `--json` prints, `[height, width]` each.
#[derive(Serialize)]
struct Map<'a> {
    size_px: [usize; 2],
    mm_per_px: [f64; 2],
    distance_mm: &'a [f32],
    error_mm: &'a [f32],
    inside: &'a [f32],
    contact: &'a [f32],
}

/// Pixels of the picture for each of the map.
const ENLARGED: usize = 8;

impl MapArgs {
    /// Draws and prints.
    pub fn run(&self) -> Result<()> {
        if self.out.is_none() && !self.json {
            return Err(Error::invalid("map", "--out FILE.png, --json, or both", "neither"));
        }
        let inputs = [&self.image, &self.no_contact, &self.maps].into_iter().chain(&self.calibration);
        let _lock = self.out.as_ref().map(|path| output::check_file(path, inputs)).transpose()?;
        let drawer = MapDrawer::load(&self.maps)?;
        let rest = &self.no_contact;
        let background = Background::new(&picture::read(rest)?, drawer.preprocessing());
        let background = background.map_err(|error| Error::from(error).within(rest.display()))?;
        let calibration = self.calibration.as_ref().map(Calibration::load).transpose()?;
        let view_mm = calibration.as_ref().map_or(drawer.view_mm(), |of| of.field_of_view_mm);
        let background = background.lit_by(&calibration.map(|of| of.light.response()))?;
        let frame = picture::read(&self.image)?;
        let seen = background.tactile_image(&frame).map_err(|error| Error::from(error).within(self.image.display()))?;
        for map in drawer.draw(std::slice::from_ref(&seen), self.side, view_mm)? {
            if let Some(out) = &self.out {
                picture::write_png(out, &side_by_side(&frame, &map)?)?;
                program::say(format_args!("{}: {}", out.display(), said(&map)));
            }
            if self.json {
                let DrawnMap { size_px, view_mm, distance_mm, error_mm, inside, contact } = &map;
                let mm_per_px = [0, 1].map(|axis| view_mm[axis] / size_px[axis] as f64);
                print_json(&Map { size_px: *size_px, mm_per_px, distance_mm, error_mm, inside, contact })?;
            }
        }
        Ok(())
    }
}

/// A map in a line.
fn said(map: &DrawnMap) -> String {
    let share = |values: &[f32]| 100.0 * values.iter().sum::<f32>() / values.len() as f32;
    let mut errors = map.error_mm.clone();
    errors.sort_by(f32::total_cmp);
    format!(
        "{:.0} % of the view is inside the peg's outline, {:.0} % touches the gel; the outline is known to {:.2} mm (median)",
        share(&map.inside),
        share(&map.contact),
        errors[errors.len() / 2]
    )
}

/// The touch, the distance and the contact.
fn side_by_side(frame: &Frame, map: &DrawnMap) -> Result<Frame> {
    let size = map.size_px.map(|n| ENLARGED * n);
    let touch = picture::resize(frame, size)?;
    let [width, height] = size;
    let mut rgb = Vec::with_capacity(9 * width * height);
    for row in 0..height {
        rgb.extend_from_slice(&touch.rgb()[3 * row * width..3 * (row + 1) * width]);
        let at = |column: usize| row / ENLARGED * map.size_px[0] + column / ENLARGED;
        rgb.extend((0..width).flat_map(|column| of_distance(map.distance_mm[at(column)], map.error_mm[at(column)])));
        rgb.extend((0..width).flat_map(|column| of_contact(map.contact[at(column)])));
    }
    Ok(Frame::new(3 * width, height, rgb)?)
}
