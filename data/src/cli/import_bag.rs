//! `tactile-data import` of a bag: its flags.

use std::path::Path;

use clap::Args;
use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_data::program::progress;
use tactile_data::recording::folder::{self, NoContact};
use tactile_data::recording::geometry::Geometry;
use tactile_data::recording::lerobot::LeRobot;
use tactile_data::recording::ros::bag;
use tactile_data::recording::ros::import::{self, PoseSource};
use tactile_data::recording::ros::touches::Touches;
use tactile_data::{Error, Result, program};

/// What an import of a bag asks for.
#[derive(Args)]
#[command(next_help_heading = "Bags and LeRobot datasets")]
pub struct BagArgs {
    /// The topic of pictures, Image or CompressedImage, or LeRobot's feature [default: the only one]
    #[arg(long, value_name = "TOPIC")]
    image_topic: Option<String>,
    /// The topic of poses, PoseStamped or TransformStamped [default: the only one]
    #[arg(long, value_name = "TOPIC", conflicts_with = "frames")]
    pose_topic: Option<String>,
    /// Take the poses of SENSOR in BASE from the transforms (tf)
    #[arg(long, value_name = "BASE,SENSOR", value_parser = parse_frames)]
    frames: Option<[String; 2]>,
    /// Which frames are touches: each, contact (one a press), poses (one a pose) [default: by what is in the bag]
    #[arg(long, value_name = "WHICH", value_parser = parse_touches)]
    touches: Option<Touches>,
    /// Farthest in time that a pose may be from its frame, ms [default: 100]
    #[arg(long, value_name = "MS")]
    max_gap_ms: Option<f64>,
    /// The part that was touched [default: from the poses' frame, hole/NAME or peg/NAME]
    #[arg(long, value_name = "NAME")]
    part: Option<String>,
    /// Its side [default: from the poses' frame]
    #[arg(long, value_name = "SIDE", value_parser = program::named::<Side>(Side::NAMES))]
    side: Option<Side>,
    /// Pose of the sensor in the frame that the poses are of, mm and degrees
    #[arg(long, value_name = "X,Y,DEG", value_parser = parse_pose, allow_hyphen_values = true)]
    tool_from_sensor: Option<Se2>,
    /// Pose of the part in the frame that the poses are in, mm and degrees
    #[arg(long, value_name = "X,Y,DEG", value_parser = parse_pose, allow_hyphen_values = true)]
    board: Option<Se2>,
}

/// Farthest in time that a pose may be from its frame where nothing is said, ms.
const MAX_GAP_MS: f64 = 100.0;

/// What holds for every source.
pub struct Frames {
    /// Where the frame at rest comes from.
    pub no_contact: NoContact,
    /// How pictures become frames.
    pub geometry: Geometry,
}

impl BagArgs {
    /// Whether a source is a bag.
    pub fn is_bag(source: &Path) -> bool {
        bag::is_bag(source)
    }

    /// Refuses the flags of bags where pictures or Parquet are imported, which would do nothing.
    pub fn refuse_for_pictures(&self) -> Result<()> {
        let got = "pictures or Parquet, whose index or folders PART/hole and PART/peg say what was touched";
        self.refuse_topics(got)?;
        let flags = [
            ("--image-topic", self.image_topic.is_some()),
            ("--part", self.part.is_some()),
            ("--side", self.side.is_some()),
            ("--tool-from-sensor", self.tool_from_sensor.is_some()),
            ("--board", self.board.is_some()),
        ];
        refuse(&flags, got)
    }

    /// Refuses the flags of messages with times, which only bags have.
    fn refuse_topics(&self, got: &str) -> Result<()> {
        let flags = [
            ("--pose-topic", self.pose_topic.is_some()),
            ("--frames", self.frames.is_some()),
            ("--touches", self.touches.is_some()),
            ("--max-gap-ms", self.max_gap_ms.is_some()),
        ];
        refuse(&flags, got)
    }

    /// What these flags ask of a LeRobot dataset.
    pub fn of_lerobot(self, frames: folder::Import, state: Option<String>) -> Result<LeRobot> {
        self.refuse_topics("a LeRobot dataset, whose rows have poses and are touches (--state)")?;
        let Self { image_topic, part, side, tool_from_sensor, board, .. } = self;
        Ok(LeRobot { pictures: image_topic, state, part, side, tool_from_sensor, board, frames })
    }

    /// Imports a bag and says what came of it.
    pub fn run(self, source: &Path, out: &Path, frames: Frames) -> Result<()> {
        let poses = match (self.pose_topic, self.frames) {
            (Some(topic), _) => PoseSource::Topic(topic),
            (None, Some(frames)) => PoseSource::Frames(frames),
            (None, None) => PoseSource::Guess,
        };
        let how = import::Import {
            image_topic: self.image_topic,
            poses,
            touches: self.touches,
            max_gap_ms: self.max_gap_ms.unwrap_or(MAX_GAP_MS),
            part: self.part,
            side: self.side,
            tool_from_sensor: self.tool_from_sensor,
            board: self.board,
            no_contact: frames.no_contact,
            geometry: frames.geometry,
        };
        let imported = import::import(source, &how, out, &progress::reporter("touches"))?;
        for warning in &imported.warnings {
            program::warning(warning);
        }
        for note in &imported.notes {
            program::say(note);
        }
        program::say(format_args!("{} frames in {}", imported.n_frames, out.display()));
        Ok(())
    }
}

/// Refuses the first of some flags that is given.
fn refuse(flags: &[(&str, bool)], got: &str) -> Result<()> {
    match flags.iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(Error::invalid(*flag, "a bag", got)),
        None => Ok(()),
    }
}

fn parse_frames(text: &str) -> std::result::Result<[String; 2], String> {
    let names = text.split_once(',').map(|(base, sensor)| [base.trim(), sensor.trim()]);
    let names = names.filter(|names| names.iter().all(|name| !name.is_empty() && !name.contains(',')));
    let names = names.map(|names| names.map(|name| name.trim_start_matches('/').to_owned()));
    names.ok_or_else(|| "expected two names with a comma between, such as base,gelsight".into())
}

fn parse_touches(text: &str) -> std::result::Result<Touches, String> {
    let found = Touches::NAMES.into_iter().find(|(name, _)| *name == text);
    found.map(|(_, touches)| touches).ok_or_else(|| "expected each, contact or poses".into())
}

fn parse_pose(text: &str) -> std::result::Result<Se2, String> {
    super::parse_numbers(text).map(|[x_mm, y_mm, theta_deg]| Se2::from_degrees(x_mm, y_mm, theta_deg))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_say_what_they_expect() {
        assert_eq!(parse_frames("base, /gel").unwrap(), ["base", "gel"]);
        assert_eq!(parse_touches("poses"), Ok(Touches::Poses));
        assert_eq!(parse_pose("-1,2,90"), Ok(Se2::from_degrees(-1.0, 2.0, 90.0)));
        for bad in ["base", "a,b,c", ",b", ""] {
            assert!(parse_frames(bad).unwrap_err().contains("base,gelsight"));
        }
        assert!(parse_touches("all").is_err() && parse_pose("1,2").is_err());
    }
}
