//! `tactile-data import`.

use std::path::PathBuf;

use clap::Args;
use tactile_data::program;
use tactile_data::program::progress;
use tactile_data::recording::folder::{self, NoContact};
use tactile_data::recording::lerobot;
use tactile_data::recording::parquet;
use tactile_data::{Error, Result};

use super::geometry::GeometryArgs;
use super::import_bag::{BagArgs, Frames};

/// Import a recording, a folder of PNG, JPEG and GIF frames or a ROS 2 bag in MCAP, as a dataset.
///
/// A build with --features ros1,lerobot reads ROS 1 bags, Parquet with Hugging Face's images and LeRobot datasets as well.
///
/// Every frame of an animated GIF counts. The index, CSV with a header or JSON lines, has the columns
/// file, part, side, x_mm, y_mm, theta_deg, moved_x_mm, moved_y_mm, moved_theta_deg, pair, episode, time_s;
/// all are optional but file. Without one, all pictures are taken by name, or from folders PART/hole and
/// PART/peg.
#[derive(Args)]
#[command(
    after_help = "Example:\n  tactile-data import recordings/letters --no-contact recordings/rest.png --out letters\n  \
                  tactile-data import raw --channels bgr --turn 180 --crop border:1/7 --frame-px 160x120 --out mini"
)]
pub struct Import {
    /// The folder, or one picture, animation, .mcap, .bag or .parquet file
    source: PathBuf,
    /// The dataset to write; must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// A picture of the sensor at rest, or the number of first frames in which it is at rest: their median is used
    /// [default: as many as look the same]
    #[arg(long, value_name = "FILE|N", value_parser = no_contact)]
    no_contact: Option<NoContact>,
    /// What is known of the frames [default: index.csv or index.jsonl in the folder, if there]
    #[arg(long, value_name = "FILE")]
    index: Option<PathBuf>,
    #[command(flatten)]
    geometry: GeometryArgs,
    #[command(flatten)]
    bag: BagArgs,
    /// The names in observation.state of x, y and the angle of the sensor's pose, each with its unit, such as x:m,y:m,yaw:rad
    /// [default: x_mm,y_mm,theta_deg where there]
    #[arg(long, value_name = "X,Y,ANGLE", help_heading = "LeRobot datasets")]
    state: Option<String>,
}

impl Import {
    /// Imports and says what came of it.
    pub fn run(self) -> Result<()> {
        let no_contact = self.no_contact.unwrap_or(NoContact::Guess);
        let geometry = self.geometry.geometry()?;
        let is_lerobot = lerobot::is_lerobot(&self.source);
        if self.state.is_some() && !is_lerobot {
            return Err(Error::invalid("--state", "a LeRobot dataset", "another source"));
        }
        if BagArgs::is_bag(&self.source) {
            if let Some(index) = &self.index {
                let expected = "pictures or Parquet, of which an index says what they show";
                return Err(Error::invalid("--index", expected, format!("{} for a bag", index.display())));
            }
            return self.bag.run(&self.source, &self.out, Frames { no_contact, geometry });
        }
        let how = folder::Import { index: self.index, no_contact, geometry };
        let imported = if is_lerobot {
            let how = self.bag.of_lerobot(how, self.state)?;
            lerobot::import(&self.source, &how, &self.out, &progress::reporter("rows"))?
        } else {
            self.bag.refuse_for_pictures()?;
            match parquet::is_parquet(&self.source) {
                true => parquet::import(&self.source, &how, &self.out, &progress::reporter("rows"))?,
                false => folder::import(&self.source, &how, &self.out, &progress::reporter("files"))?,
            }
        };
        for warning in imported.warnings {
            program::warning(warning);
        }
        program::say(format_args!("{} frames in {}", imported.n_frames, self.out.display()));
        Ok(())
    }
}

fn no_contact(text: &str) -> std::result::Result<NoContact, std::convert::Infallible> {
    Ok(text.parse().map_or_else(|_| NoContact::File(text.into()), NoContact::First))
}
