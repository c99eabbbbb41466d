//! From the pictures of a recording to frames: colours, turn, mirror, crop, scale and size.

use std::ffi::OsStr;
use std::str::FromStr;

use crate::dataset::store::{Channels, Meta, Mirror, Recording};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::frame::picture;
use crate::light::lamps::{CalibratedLamps, Lamps};

/// Field of view of a GelSight Mini along x and y, mm (data sheet; FEATS' homography of 14 px/mm at
/// 320x240 gives about the same height).
pub const FIELD_OF_VIEW_MM: [f64; 2] = [18.6, 14.3];

/// Pictures whose shape (width by height) differs from the field of view's by no more than this factor are
/// taken to show it: 4:3 differs from 18.6 x 14.3 mm by 1.025.
const SAME_SHAPE: f64 = 1.03;

/// A bar's lines have a mean of at most this, counts: black in video is 16.
const BLACK_MEAN: f64 = 16.0;

/// No value of a bar is above this, counts: what JPEG carries over from the picture to a bar's last lines.
const BLACK_MOST: u8 = 64;

/// How pictures become frames, as it was asked for. The steps are made in the order of the fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Geometry {
    /// The order of the pictures' colours.
    pub channels: Channels,
    /// Quarter turns counter-clockwise, as the picture is looked at; 0..=3.
    pub quarter_turns: u8,
    /// The axis that is turned round.
    pub mirror: Option<Mirror>,
    /// What is kept; `None` keeps all.
    pub crop: Option<Crop>,
    /// Whether the black bars at the sides of the frame at rest are cut away, from all pictures.
    pub letterbox: bool,
    /// What the kept picture shows along x and y, mm. `None`: [`FIELD_OF_VIEW_MM`], or, of a picture of another
    /// shape, as much of it as touches two opposite sides of that view, with one scale along x and y.
    pub field_of_view_mm: Option<[f64; 2]>,
    /// Width and height to bring the frames to, pixels; `None` keeps theirs.
    pub frame_px: Option<[usize; 2]>,
    /// The sensor's lamps, calibrated on pictures turned and mirrored as these are.
    pub lamps: Option<CalibratedLamps>,
}

/// What is kept of a picture after turning and mirroring.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Crop {
    /// Left, top, width and height, pixels.
    Rectangle([usize; 4]),
    /// All but this share of the width at the left and at the right, and of the height at the top and at the
    /// bottom, rounded down to whole pixels as the drivers of the GelSight Mini do; 0.0..0.5.
    Border(f64),
}

impl FromStr for Crop {
    type Err = Error;

    /// Reads `LEFT,TOP,WIDTH,HEIGHT`, `border:1/7` or `border:0.15`.
    fn from_str(text: &str) -> Result<Self> {
        let refusal = || Error::invalid("crop", "LEFT,TOP,WIDTH,HEIGHT in pixels, or border:1/7", text);
        if let Some(share) = text.strip_prefix("border:") {
            let number = |text: &str| text.trim().parse::<f64>().map_err(|_| refusal());
            let share = match share.split_once('/') {
                Some((part, whole)) => number(part)? / number(whole)?,
                None => number(share)?,
            };
            return if (0.0..0.5).contains(&share) { Ok(Self::Border(share)) } else { Err(refusal()) };
        }
        let numbers: Option<Vec<usize>> = text.split(',').map(|number| number.trim().parse().ok()).collect();
        let numbers = numbers.and_then(|numbers| <[usize; 4]>::try_from(numbers).ok());
        numbers.map(Self::Rectangle).ok_or_else(refusal)
    }
}

impl Crop {
    /// Left, top, width and height in a picture of this size.
    fn of(self, [width, height]: [usize; 2]) -> Result<[usize; 4]> {
        let kept @ [left, top, kept_width, kept_height] = match self {
            Self::Rectangle(kept) => kept,
            Self::Border(share) => {
                // Shares such as 1/7 have no exact binary form: 245 * (1/7) must be 35.
                let [left, top] = [width, height].map(|side| (side as f64 * share + 1e-9) as usize);
                [left, top, width.saturating_sub(2 * left), height.saturating_sub(2 * top)]
            }
        };
        let is_inside =
            |at: usize, length: usize, side| length > 0 && at.checked_add(length).is_some_and(|e| e <= side);
        if is_inside(left, kept_width, width) && is_inside(top, kept_height, height) {
            return Ok(kept);
        }
        let got = format!("{kept_width}x{kept_height} from {left},{top}");
        Err(Error::invalid("crop", format!("a part of the {width}x{height} pixels (after turning)"), got))
    }
}

/// The geometry of one recording: [`Geometry`] settled for the size of its pictures.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    source_px: [usize; 2],
    channels: Channels,
    quarter_turns: u8,
    mirror: Option<Mirror>,
    crop_px: [usize; 4],
    frame_px: [usize; 2],
    field_of_view_mm: [f64; 2],
    lamps: Option<Lamps>,
}

impl View {
    /// The whole picture as it is, brought to `frame_px`.
    pub fn whole(source_px: [usize; 2], frame_px: [usize; 2]) -> Self {
        Self {
            source_px,
            channels: Channels::Rgb,
            quarter_turns: 0,
            mirror: None,
            crop_px: [0, 0, source_px[0], source_px[1]],
            frame_px,
            field_of_view_mm: FIELD_OF_VIEW_MM,
            lamps: None,
        }
    }

    /// The sensor's lamps over the frame, where they are known.
    pub fn lamps(&self) -> Option<&Lamps> {
        self.lamps.as_ref()
    }

    /// Width and height that every picture has, pixels.
    pub fn source_px(&self) -> [usize; 2] {
        self.source_px
    }

    /// Width and height of the frames, pixels.
    pub fn frame_px(&self) -> [usize; 2] {
        self.frame_px
    }

    /// Width and height of what a frame shows, mm.
    pub fn field_of_view_mm(&self) -> [f64; 2] {
        self.field_of_view_mm
    }

    /// Size of a frame's pixel along x and y, mm.
    pub fn mm_per_px(&self) -> [f64; 2] {
        [0, 1].map(|axis| self.field_of_view_mm[axis] / self.frame_px[axis] as f64)
    }

    /// What holds for a dataset of its frames.
    pub fn meta(&self, name: &OsStr, source: String) -> Meta {
        let meta = Meta::new(name.to_string_lossy(), source, self.frame_px, self.mm_per_px());
        Meta { lamps: self.lamps.clone(), ..meta }
    }

    /// What a dataset's meta data keep of it.
    pub fn recording(&self, source_sha256: String) -> Recording {
        Recording {
            source_sha256,
            source_px: self.source_px,
            crop_px: self.crop_px,
            quarter_turns: self.quarter_turns,
            mirror: self.mirror,
            channels: self.channels,
        }
    }

    /// The frame that a picture becomes; `place` names it.
    ///
    /// # Errors
    /// A picture of another size than `source_px`.
    pub fn frame(&self, picture: &Frame, place: &str) -> Result<Frame> {
        check_px(picture, self.source_px, place)?;
        if Self::whole(self.source_px, self.frame_px) == (Self { field_of_view_mm: FIELD_OF_VIEW_MM, ..self.clone() }) {
            return picture::resize(picture, self.frame_px);
        }
        picture::resize(&self.kept(picture)?, self.frame_px)
    }

    /// What is kept of a picture, in the picture's own pixels.
    fn kept(&self, picture: &Frame) -> Result<Frame> {
        let [left, top, width, height] = self.crop_px;
        let mut rgb = Vec::with_capacity(3 * width * height);
        for v in top..top + height {
            for u in left..left + width {
                let [x, y] = self.source_of([u, v]);
                let at = 3 * (y * self.source_px[0] + x);
                let pixel = &picture.rgb()[at..at + 3];
                match self.channels {
                    Channels::Rgb => rgb.extend_from_slice(pixel),
                    Channels::Bgr => rgb.extend(pixel.iter().rev()),
                }
            }
        }
        Frame::new(width, height, rgb)
    }

    /// The pixel of the source that becomes a pixel of the turned and mirrored picture.
    fn source_of(&self, [mut u, mut v]: [usize; 2]) -> [usize; 2] {
        let [last_x, last_y] = self.source_px.map(|side| side - 1);
        let [last_u, last_v] = if self.quarter_turns % 2 == 1 { [last_y, last_x] } else { [last_x, last_y] };
        match self.mirror {
            Some(Mirror::X) => u = last_u - u,
            Some(Mirror::Y) => v = last_v - v,
            None => {}
        }
        match self.quarter_turns {
            1 => [last_x - v, u],
            2 => [last_x - u, last_y - v],
            3 => [v, last_y - u],
            _ => [u, v],
        }
    }
}

impl Geometry {
    /// Settles the geometry for pictures of the size of `rest`, the sensor at rest as its source holds it. What a
    /// person should know is added to `warnings`, one line each.
    ///
    /// # Errors
    /// A crop that is not inside the picture, nothing but black, or sizes that make no sense.
    pub fn settle(&self, rest: &Frame, warnings: &mut Vec<String>) -> Result<View> {
        if self.quarter_turns > 3 {
            return Err(Error::invalid("turn", "0 to 3 quarter turns", self.quarter_turns.to_string()));
        }
        let source_px = [rest.width_px(), rest.height_px()];
        let [width, height] = source_px;
        let turned_px = if self.quarter_turns % 2 == 1 { [height, width] } else { source_px };
        let mut view = View {
            channels: self.channels,
            quarter_turns: self.quarter_turns,
            mirror: self.mirror,
            crop_px: self.crop.map_or(Ok([0, 0, turned_px[0], turned_px[1]]), |crop| crop.of(turned_px))?,
            ..View::whole(source_px, turned_px)
        };
        view.crop_px = self.without_bars(&view, rest, warnings)?;
        let kept_px = [view.crop_px[2], view.crop_px[3]];
        view.frame_px = self.frame_px.unwrap_or(kept_px);
        if view.frame_px.contains(&0) {
            return Err(Error::invalid("frame size", "1 pixel or more each way", show(view.frame_px)));
        }
        view.field_of_view_mm = self.field_of_view(kept_px, warnings)?;
        view.lamps = self.lamps.as_ref().map(|lamps| lamps.on(view.field_of_view_mm)).transpose()?;
        view.lamps.as_ref().map_or(Ok(()), Lamps::validate)?;
        if !is_same_shape(shape(view.frame_px), shape(kept_px)) {
            let [x, y] = view.mm_per_px();
            let frame = show(view.frame_px);
            warnings.push(format!(
                "pictures of {} are brought to frames of {frame}, another shape: a pixel shows {x:.4} x {y:.4} mm",
                show(kept_px)
            ));
        }
        Ok(view)
    }

    /// What is kept once black bars are cut away, where that was asked for.
    fn without_bars(&self, view: &View, rest: &Frame, warnings: &mut Vec<String>) -> Result<[usize; 4]> {
        let [left, top, width, height] = view.crop_px;
        let Some(bars) = black_bars(&view.kept(rest)?) else {
            let got = "a frame at rest that is black all over";
            return if self.letterbox {
                Err(Error::invalid("letterbox", "a lit picture", got))
            } else {
                Ok(view.crop_px)
            };
        };
        let [at_left, at_right, at_top, at_bottom] = bars;
        match (self.letterbox, bars == [0; 4]) {
            (false, true) => Ok(view.crop_px),
            (true, true) => {
                warnings.push("--letterbox: the frame at rest has no black bars".to_owned());
                Ok(view.crop_px)
            }
            (false, false) => {
                warnings.push(format!(
                    "the frame at rest has black bars of {at_left}, {at_right}, {at_top} and {at_bottom} pixels at the \
                     left, right, top and bottom: --letterbox cuts them away"
                ));
                Ok(view.crop_px)
            }
            (true, false) => {
                Ok([left + at_left, top + at_top, width - at_left - at_right, height - at_top - at_bottom])
            }
        }
    }

    fn field_of_view(&self, kept_px: [usize; 2], warnings: &mut Vec<String>) -> Result<[f64; 2]> {
        if let Some(asked_mm) = self.field_of_view_mm {
            if asked_mm.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
                return Ok(asked_mm);
            }
            return Err(Error::invalid("field of view", "positive sizes in mm", format!("{asked_mm:?}")));
        }
        let [x_mm, y_mm] = FIELD_OF_VIEW_MM;
        if is_same_shape(shape(kept_px), x_mm / y_mm) {
            return Ok(FIELD_OF_VIEW_MM);
        }
        let is_upright = kept_px[0] < kept_px[1];
        let [within_x, within_y] = if is_upright { [y_mm, x_mm] } else { [x_mm, y_mm] };
        let kept_mm = if is_same_shape(shape(kept_px), within_x / within_y) {
            [within_x, within_y]
        } else {
            let scale = (within_x / kept_px[0] as f64).min(within_y / kept_px[1] as f64);
            kept_px.map(|side| side as f64 * scale)
        };
        warnings.push(format!(
            "a kept picture of {} has another shape than {x_mm} x {y_mm} mm: taking it to show {:.2} x {:.2} mm; \
             --field-of-view-mm says what it shows",
            show(kept_px),
            kept_mm[0],
            kept_mm[1]
        ));
        Ok(kept_mm)
    }
}

/// Refuses a picture of another size than the frame at rest; `place` names it.
pub fn check_px(frame: &Frame, expected: [usize; 2], place: &str) -> Result<()> {
    let got = [frame.width_px(), frame.height_px()];
    if got == expected {
        return Ok(());
    }
    Err(Error::invalid(place, format!("{}, as the no-contact frame", show(expected)), show(got)))
}

/// Width by height.
fn shape([width, height]: [usize; 2]) -> f64 {
    width as f64 / height as f64
}

fn is_same_shape(a: f64, b: f64) -> bool {
    (a / b).max(b / a) <= SAME_SHAPE
}

fn show([width, height]: [usize; 2]) -> String {
    format!("{width}x{height} pixels")
}

/// Width of the black bars at the left and right, height of the bars at the top and bottom, pixels; `None` of a frame
/// that is black all over.
fn black_bars(frame: &Frame) -> Option<[usize; 4]> {
    let (width, height) = (frame.width_px(), frame.height_px());
    let pixel = |x: usize, y: usize| &frame.rgb()[3 * (y * width + x)..3 * (y * width + x) + 3];
    let is_black = |line: &mut dyn Iterator<Item = &u8>| {
        let (mut sum, mut most, mut n) = (0_u64, 0, 0_u64);
        for value in line {
            (sum, most, n) = (sum + u64::from(*value), most.max(*value), n + 1);
        }
        most <= BLACK_MOST && sum as f64 <= BLACK_MEAN * n as f64
    };
    let is_column = |x: usize| is_black(&mut (0..height).flat_map(|y| pixel(x, y)));
    let is_row = |y: usize| is_black(&mut (0..width).flat_map(|x| pixel(x, y)));
    let (left, top) = ((0..width).position(|x| !is_column(x))?, (0..height).position(|y| !is_row(y))?);
    let right = (0..width).rev().position(|x| !is_column(x))?;
    Some([left, right, top, (0..height).rev().position(|y| !is_row(y))?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{RgbImage, imageops};

    /// A picture whose pixels all differ.
    fn picture(width: usize, height: usize) -> Frame {
        let rgb = (0..width * height).flat_map(|i| [(i % 251) as u8, (i / 251) as u8, (i * 7 % 249) as u8]);
        Frame::new(width, height, rgb.collect()).unwrap()
    }

    fn settled(geometry: &Geometry, rest: &Frame) -> (View, Vec<String>) {
        let mut warnings = Vec::new();
        (geometry.settle(rest, &mut warnings).unwrap(), warnings)
    }

    fn refusal(geometry: &Geometry, rest: &Frame) -> String {
        geometry.settle(rest, &mut Vec::new()).unwrap_err().to_string()
    }

    /// The same steps with the picture library's own, one after the other.
    fn one_after_the_other(geometry: &Geometry, frame: &Frame, [left, top, width, height]: [usize; 4]) -> Vec<u8> {
        let size = [frame.width_px(), frame.height_px()].map(|side| side as u32);
        let mut image = RgbImage::from_raw(size[0], size[1], frame.rgb().to_vec()).unwrap();
        if geometry.channels == Channels::Bgr {
            image.pixels_mut().for_each(|pixel| pixel.0.reverse());
        }
        for _ in 0..geometry.quarter_turns {
            // Three quarters clockwise.
            image = imageops::rotate270(&image);
        }
        match geometry.mirror {
            Some(Mirror::X) => imageops::flip_horizontal_in_place(&mut image),
            Some(Mirror::Y) => imageops::flip_vertical_in_place(&mut image),
            None => {}
        }
        let [left, top, width, height] = [left, top, width, height].map(|side| side as u32);
        imageops::crop_imm(&image, left, top, width, height).to_image().into_raw()
    }

    #[test]
    fn every_turn_mirror_crop_and_order_of_colours_is_as_made_one_after_the_other() {
        let source = picture(13, 9);
        for quarter_turns in 0..4 {
            for mirror in [None, Some(Mirror::X), Some(Mirror::Y)] {
                for channels in [Channels::Rgb, Channels::Bgr] {
                    for crop in [None, Some(Crop::Rectangle([1, 2, 5, 4])), Some(Crop::Border(1.0 / 7.0))] {
                        let geometry = Geometry { quarter_turns, mirror, channels, crop, ..Geometry::default() };
                        let (view, _) = settled(&geometry, &source);
                        let frame = view.frame(&source, "a picture").unwrap();
                        assert_eq!([frame.width_px(), frame.height_px()], view.frame_px());
                        let expected = one_after_the_other(&geometry, &source, view.crop_px);
                        assert!(frame.rgb() == expected, "{geometry:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_share_of_the_border_is_rounded_down_as_the_drivers_do() {
        // int(240 * (1 / 7)) and floor(320 * (1 / 7)) in Python; 245 / 7 is whole.
        for (size, kept) in [([320, 240], [45, 34, 230, 172]), ([245, 7], [35, 1, 175, 5]), ([6, 6], [0, 0, 6, 6])] {
            assert_eq!("border:1/7".parse::<Crop>().unwrap().of(size).unwrap(), kept);
        }
        assert_eq!("border:0.25".parse::<Crop>().unwrap(), Crop::Border(0.25));
        assert_eq!("1, 2,30,40".parse::<Crop>().unwrap(), Crop::Rectangle([1, 2, 30, 40]));
    }

    #[test]
    fn crops_that_make_no_sense_are_refused() {
        for bad in [
            "1,2,3",
            "1,2,3,4,5",
            "-1,0,3,4",
            "a",
            "",
            "border:",
            "border:1/2",
            "border:1/0",
            "border:-1",
            "border:nan",
        ] {
            assert!(bad.parse::<Crop>().unwrap_err().to_string().contains("LEFT,TOP,WIDTH,HEIGHT"), "{bad}");
        }
        let rest = picture(16, 12);
        for outside in [[10, 0, 7, 12], [0, 0, 0, 12], [0, 12, 1, 1], [usize::MAX, 0, 2, 2]] {
            let message = refusal(&Geometry { crop: Some(Crop::Rectangle(outside)), ..Geometry::default() }, &rest);
            assert!(message.contains("a part of the 16x12 pixels"), "{message}");
        }
        // After a turn the picture is upright.
        let upright = Some(Crop::Rectangle([0, 0, 12, 16]));
        assert!(refusal(&Geometry { crop: upright, ..Geometry::default() }, &rest).contains("12x16 from 0,0"));
        settled(&Geometry { crop: upright, quarter_turns: 1, ..Geometry::default() }, &rest);
    }

    #[test]
    fn a_picture_of_another_shape_keeps_one_scale_unless_told() {
        for (size, expected_mm) in [
            ([320, 240], [18.6, 14.3]),
            ([240, 320], [14.3, 18.6]),
            ([640, 360], [18.6, 18.6 * 9.0 / 16.0]),
            ([200, 200], [14.3, 14.3]),
            ([360, 640], [18.6 * 9.0 / 16.0, 18.6]),
        ] {
            let (view, warnings) = settled(&Geometry::default(), &picture(size[0], size[1]));
            let got_mm = [0, 1].map(|axis| view.mm_per_px()[axis] * size[axis] as f64);
            assert!((0..2).all(|axis| (got_mm[axis] - expected_mm[axis]).abs() < 1e-9), "{size:?}: {got_mm:?}");
            // Only 4:3 is what a Mini's data sheet says.
            assert_eq!(warnings.len(), usize::from(size != [320, 240]), "{warnings:?}");
            let named = format!("{}x{} pixels has another shape than 18.6 x 14.3 mm", size[0], size[1]);
            assert!(warnings.iter().all(|warning| warning.contains(&named)), "{warnings:?}");
            let told = Geometry { field_of_view_mm: Some([9.0, 5.0]), ..Geometry::default() };
            let (view, warnings) = settled(&told, &picture(size[0], size[1]));
            assert!((view.mm_per_px()[0] * size[0] as f64 - 9.0).abs() < 1e-9 && warnings.is_empty());
        }
        for bad in [[0.0, 3.0], [f64::NAN, 3.0], [3.0, f64::INFINITY], [-1.0, 3.0]] {
            let message = refusal(&Geometry { field_of_view_mm: Some(bad), ..Geometry::default() }, &picture(16, 12));
            assert!(message.contains("positive sizes in mm"), "{message}");
        }
    }

    #[test]
    fn frames_of_another_shape_than_the_kept_picture_are_told() {
        let geometry = Geometry { frame_px: Some([16, 16]), ..Geometry::default() };
        let (view, warnings) = settled(&geometry, &picture(32, 24));
        assert_eq!(view.mm_per_px(), [18.6 / 16.0, 14.3 / 16.0]);
        assert!(warnings[0].contains("32x24 pixels are brought to frames of 16x16 pixels"), "{warnings:?}");
        assert!(refusal(&Geometry { frame_px: Some([0, 4]), ..geometry }, &picture(32, 24)).contains("1 pixel"));
    }

    /// A lit picture with bars of 3, 2, 1 and 0 pixels at the left, right, top and bottom, of up to `black` counts.
    fn letterboxed(black: u8) -> Frame {
        let rgb = (0..24 * 16).flat_map(|i| {
            let (x, y) = (i % 24, i / 24);
            let is_bar = !(3..22).contains(&x) || y == 0;
            [if is_bar { ((x + y) % 2) as u8 * black } else { 120 }; 3]
        });
        Frame::new(24, 16, rgb.collect()).unwrap()
    }

    #[test]
    fn black_bars_are_cut_away_where_asked_and_told_where_not() {
        for black in [0, 16, 30] {
            let rest = letterboxed(black);
            let asked = Geometry { letterbox: true, ..Geometry::default() };
            let (view, _) = settled(&asked, &rest);
            assert_eq!(view.crop_px, [3, 1, 19, 15]);
            assert!(view.frame(&rest, "rest").unwrap().rgb().iter().all(|value| *value == 120));
            // With a crop, what is left of the bars within it.
            let within = Geometry { crop: Some(Crop::Rectangle([1, 0, 23, 16])), ..asked };
            assert_eq!(settled(&within, &rest).0.crop_px, [3, 1, 19, 15]);
            let (view, warnings) = settled(&Geometry::default(), &rest);
            assert_eq!(view.crop_px, [0, 0, 24, 16]);
            assert!(warnings[0].contains("bars of 3, 2, 1 and 0 pixels"), "{warnings:?}");
        }
        // A dark picture is no bar.
        let (view, _) = settled(&Geometry { letterbox: true, ..Geometry::default() }, &letterboxed(90));
        assert_eq!(view.crop_px, [0, 0, 24, 16]);
        let black = Frame::new(16, 12, vec![3; 16 * 12 * 3]).unwrap();
        assert!(refusal(&Geometry { letterbox: true, ..Geometry::default() }, &black).contains("black all over"));
    }

    #[test]
    fn bars_and_turn_go_into_the_meta_data() {
        let geometry = Geometry { letterbox: true, quarter_turns: 2, ..Geometry::default() };
        let recording = settled(&geometry, &letterboxed(0)).0.recording("ab".to_owned());
        assert_eq!((recording.source_px, recording.crop_px, recording.quarter_turns), ([24, 16], [2, 0, 19, 15], 2));
    }
}
