//! Flags that say how the pictures of a recording become frames.

use std::path::PathBuf;

use clap::Args;
use tactile_data::dataset::store::{Channels, Mirror};
use tactile_data::light::calibrate::Calibration;
use tactile_data::recording::geometry::{Crop, Geometry};

/// How pictures become frames; the steps are made in this order.
#[derive(Args)]
#[command(next_help_heading = "Frames")]
pub struct GeometryArgs {
    /// The order of the pictures' colours: rgb, or bgr where OpenCV wrote them the other way round
    #[arg(long, value_name = "rgb|bgr", default_value = "rgb", hide_default_value = true)]
    channels: Channels,
    /// Turn pictures counter-clockwise by this many degrees
    #[arg(long, value_name = "90|180|270", value_parser = parse_turn, default_value = "0", hide_default_value = true)]
    turn: u8,
    /// Mirror pictures: x swaps left and right, y swaps top and bottom
    #[arg(long, value_name = "x|y")]
    mirror: Option<Mirror>,
    /// Keep a part of each picture, pixels after turning; or cut a share away at each side: border:1/7
    #[arg(long, value_name = "LEFT,TOP,WIDTH,HEIGHT")]
    crop: Option<Crop>,
    /// Cut away the black bars at the sides of the frame at rest, from all pictures
    #[arg(long)]
    letterbox: bool,
    /// What the kept picture shows along x and y, mm [default: 18.6 x 14.3, with one scale along x and y]
    #[arg(long, num_args = 2, value_names = ["X", "Y"])]
    field_of_view_mm: Option<Vec<f64>>,
    /// Resize frames to this, pixels [default: the size of the kept picture]
    #[arg(long, value_name = "WxH", value_parser = super::parse_size)]
    frame_px: Option<[usize; 2]>,
    /// The sensor's light, as `calibrate` measured it on pictures turned and mirrored as these are: they are then brought
    /// under the lamps that the network knows
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
}

impl GeometryArgs {
    /// The geometry that was asked for.
    ///
    /// # Errors
    /// A calibration that cannot be read.
    pub fn geometry(self) -> tactile_data::Result<Geometry> {
        let lamps = self.calibration.map(|path| Ok(Calibration::load(path)?.lamps())).transpose()?;
        Ok(Geometry {
            channels: self.channels,
            quarter_turns: self.turn,
            mirror: self.mirror,
            crop: self.crop,
            letterbox: self.letterbox,
            field_of_view_mm: self.field_of_view_mm.and_then(|mm| mm.try_into().ok()),
            frame_px: self.frame_px,
            lamps,
        })
    }
}

/// Degrees to quarter turns.
fn parse_turn(text: &str) -> std::result::Result<u8, String> {
    match text {
        "0" => Ok(0),
        "90" => Ok(1),
        "180" => Ok(2),
        "270" => Ok(3),
        _ => Err("expected 90, 180 or 270 degrees counter-clockwise".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(Parser)]
    struct Program {
        #[command(flatten)]
        geometry: GeometryArgs,
    }

    fn parsed(line: &str) -> Result<Geometry, String> {
        let words = std::iter::once("program").chain(line.split_whitespace());
        Program::try_parse_from(words)
            .map_err(|error| error.to_string())?
            .geometry
            .geometry()
            .map_err(|error| error.to_string())
    }

    #[test]
    fn every_flag_says_what_is_done() {
        let line = "--channels bgr --turn 270 --mirror y --crop 1,2,30,40 --letterbox --field-of-view-mm 9 7 \
                    --frame-px 80x60";
        let expected = Geometry {
            channels: Channels::Bgr,
            quarter_turns: 3,
            mirror: Some(Mirror::Y),
            crop: Some(Crop::Rectangle([1, 2, 30, 40])),
            letterbox: true,
            field_of_view_mm: Some([9.0, 7.0]),
            frame_px: Some([80, 60]),
            lamps: None,
        };
        assert_eq!(parsed(line), Ok(expected));
        assert_eq!(parsed(""), Ok(Geometry::default()));
        assert_eq!(parsed("--crop border:1/7").unwrap().crop, Some(Crop::Border(1.0 / 7.0)));
    }

    #[test]
    fn every_bad_value_is_refused_with_its_flag() {
        for (line, flag) in [
            ("--channels gbr", "--channels"),
            ("--turn 45", "--turn"),
            ("--mirror z", "--mirror"),
            ("--crop 1,2,3", "--crop"),
            ("--field-of-view-mm 9", "--field-of-view-mm"),
            ("--frame-px 80", "--frame-px"),
        ] {
            assert!(parsed(line).unwrap_err().contains(flag), "{line}");
        }
    }
}
