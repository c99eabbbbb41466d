//! `tactile-data ring`.

use std::path::PathBuf;

use clap::Args;
use serde_json::json;
use tactile_data::compare::Press;
use tactile_data::compare::ring::{Ring, find};
use tactile_data::{Error, Result, picture};

/// Tell how far beside a predicted outline the ring lies that a face's edge makes in a frame.
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
    /// How far beside the outline to look, pixels
    #[arg(long, value_name = "N", default_value_t = 10)]
    reach_px: usize,
    /// Print JSON for programs
    #[arg(long)]
    json: bool,
}

impl FindRing {
    /// Finds the ring and prints where it lies.
    pub fn run(self) -> Result<()> {
        let (corners, rest) = self.outline.as_chunks::<2>();
        if !rest.is_empty() {
            return Err(Error::invalid("--outline", "an x and a y for each corner", self.outline.len().to_string()));
        }
        let (frame, at_rest) = (picture::read(&self.frame)?, picture::read(&self.no_contact)?);
        let ring = find(Press { frame: &frame, at_rest: &at_rest }, corners, self.reach_px)?;
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
