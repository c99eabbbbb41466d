//! `tactile-data export`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use tactile_data::dataset::export;
use tactile_data::dataset::store::Dataset;
use tactile_data::file::output;
use tactile_data::program::progress;
use tactile_data::{Error, Result, program};

/// Export a dataset as a folder of pictures, as NumPy arrays, as a ROS 2 bag in MCAP, or as a LeRobot dataset.
///
/// folder: 000000.png and so on, index.csv and no_contact.png, which `import` reads back. npy: frames.npy, poses.npy
/// (x_mm, y_mm, theta_rad; NaN unknown), no_contact.npy and touches.json. mcap: /gelsight/image and /tool_pose. lerobot
/// (a build with --features lerobot): version 3, pictures as dtype image, every bit kept.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-data export letters --to mcap --out letters.mcap")]
pub struct Export {
    /// The dataset
    dir: PathBuf,
    /// What to write
    #[arg(long)]
    to: To,
    /// The new folder, or the new .mcap file; must not exist
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Compress the frames as JPEG of this quality, 1 to 100; folder and mcap only [default: every bit is kept]
    #[arg(long, value_name = "QUALITY", value_parser = clap::value_parser!(u8).range(1..=100))]
    jpeg: Option<u8>,
}

/// What an export is.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum To {
    Folder,
    Npy,
    Mcap,
    #[cfg(feature = "lerobot")]
    Lerobot,
}

impl Export {
    /// Exports and says how to read it back.
    pub fn run(self) -> Result<()> {
        if !matches!(self.to, To::Folder | To::Mcap) && self.jpeg.is_some() {
            return Err(Error::invalid("--jpeg", "--to folder or mcap", "another, which keeps every bit"));
        }
        let dataset = Dataset::open(&self.dir)?;
        output::check_room(&self.out, dataset.len(), dataset.meta().frame_px)?;
        let (out, progress) = (self.out.as_path(), progress::reporter("frames"));
        match self.to {
            To::Folder => export::folder::export(&dataset, out, self.jpeg, &progress)?,
            To::Npy => export::arrays::export(&dataset, out, &progress)?,
            To::Mcap => export::bag::export(&dataset, out, self.jpeg, &progress)?,
            #[cfg(feature = "lerobot")]
            To::Lerobot => export::lerobot::export(&dataset, out, &progress)?,
        }
        program::say(format_args!("{} frames in {}", dataset.len(), out.display()));
        let meta = dataset.meta();
        let [x_mm, y_mm] = meta.field_of_view_mm();
        let rest = match self.to {
            To::Folder => format!("--no-contact {}", out.join(export::folder::NO_CONTACT).display()),
            To::Mcap if dataset.touches().iter().any(|touch| touch.part_from_sensor.is_some()) => {
                "--touches poses".to_owned()
            }
            To::Mcap => "--touches each".to_owned(),
            To::Npy => return Ok(()),
            #[cfg(feature = "lerobot")]
            To::Lerobot => {
                program::say(format_args!("back again: tactile-data import {} --out NEW", out.display()));
                return Ok(());
            }
        };
        let import = format!("tactile-data import {} {rest} --field-of-view-mm {x_mm} {y_mm} --out NEW", out.display());
        program::say(format_args!("back again: {import}"));
        Ok(())
    }
}
