//! `tactile-data import`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::Result;
use tactile_data::progress;
use tactile_data::recording::folder::{self, FIELD_OF_VIEW_MM, NoContact};

use super::import_bag::{BagArgs, Frames};

/// Import a recording, a folder of PNG, JPEG and GIF frames or a ROS 2 bag in MCAP, as a dataset.
///
/// Every frame of an animated GIF counts. The index, CSV with a header or JSON lines, has the columns
/// file, part, side, x_mm, y_mm, theta_deg, moved_x_mm, moved_y_mm, moved_theta_deg; all are optional
/// but file. Without one, all pictures are taken by name.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-data import recordings/letters --no-contact recordings/rest.png --out letters"
)]
pub struct Import {
    /// The folder, or one picture, animation or .mcap file
    source: PathBuf,
    /// The dataset to write; must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A picture of the sensor at rest
    #[arg(long, value_name = "FILE", conflicts_with = "no_contact_first")]
    no_contact: Option<PathBuf>,
    /// What is known of the frames [default: index.csv or index.jsonl in the folder, if there]
    #[arg(long, value_name = "FILE")]
    index: Option<PathBuf>,
    /// The sensor is at rest in the first N frames; their median is used [default: as many as look the same]
    #[arg(long, value_name = "N", help_heading = "Frames")]
    no_contact_first: Option<usize>,
    /// Resize frames to this, pixels [default: their own size]
    #[arg(long, value_name = "WxH", value_parser = super::parse_size, help_heading = "Frames")]
    frame_px: Option<[usize; 2]>,
    /// What a frame shows along x and y, mm
    #[arg(long, num_args = 2, value_names = ["X", "Y"], default_values_t = FIELD_OF_VIEW_MM,
          help_heading = "Frames")]
    field_of_view_mm: Vec<f64>,
    #[command(flatten)]
    bag: BagArgs,
}

impl Import {
    /// Imports and says what came of it.
    pub fn run(self) -> Result<()> {
        let no_contact = match (self.no_contact, self.no_contact_first) {
            (Some(file), _) => NoContact::File(file),
            (None, Some(n)) => NoContact::First(n),
            (None, None) => NoContact::Guess,
        };
        let field_of_view_mm = [self.field_of_view_mm[0], self.field_of_view_mm[1]];
        if BagArgs::is_bag(&self.source) {
            let frames = Frames { no_contact, frame_px: self.frame_px, field_of_view_mm };
            return self.bag.run(&self.source, &self.out, frames);
        }
        let how = folder::Import { index: self.index, no_contact, frame_px: self.frame_px, field_of_view_mm };
        let imported = folder::import(&self.source, &how, &self.out, &progress::reporter("files"))?;
        for warning in imported.warnings {
            eprintln!("warning: {warning}");
        }
        println!("{} frames in {}", imported.n_frames, self.out.display());
        Ok(())
    }
}
