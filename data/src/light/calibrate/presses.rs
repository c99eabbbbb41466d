//! Presses of a ball: frames with the circle in which the ball touched, read and checked.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use super::circle::{Circle, PressGeometry};
use super::circle_search;
use crate::dataset::compare::{self, FAR_MM, far_pixels};
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::frame::Frame;
use crate::frame::picture;

/// Fewer presses do not separate the light's fall-off over the frame from the presses' own faults.
const MIN_PRESSES: usize = 5;

/// The most of a contact's values at 0 or 255 that still show its colours.
const MAX_SATURATED: f64 = 0.25;

/// The least mean difference in a contact, as a multiple of that far from it.
const MIN_CONTRAST: f64 = 2.0;

/// One press, its exposure brought to the no-contact frame's.
#[derive(Clone, Debug)]
pub struct Press {
    /// The frame's file name.
    pub name: String,
    /// Where the ball touches.
    pub circle: Circle,
    /// The exposure of each channel as a multiple of the no-contact frame's.
    pub gain: [f32; 3],
    /// What the press changed of the frame at rest, interleaved RGB, counts.
    pub difference: Vec<f32>,
}

impl Press {
    /// What the press changed of one pixel, RGB, counts.
    pub fn counts(&self, pixel: usize) -> [f64; 3] {
        [0, 1, 2].map(|channel| f64::from(self.difference[3 * pixel + channel]))
    }
}

/// A set of presses fit to calibrate from.
#[derive(Clone, Debug)]
pub struct Presses {
    /// The sensor at rest.
    pub no_contact: Frame,
    /// The frame's scale and the ball.
    pub geometry: PressGeometry,
    /// The presses, by name.
    pub presses: Vec<Press>,
}

/// What a folder of presses does not say itself.
#[derive(Clone, Debug)]
pub struct Source {
    /// A picture of the sensor at rest; not counted among the presses where it is in the folder.
    pub no_contact: PathBuf,
    /// A CSV with a header: file, centre x, centre y and radius in pixels; without one circles are found.
    pub labels: Option<PathBuf>,
    /// The ball's diameter, mm.
    pub ball_mm: f64,
    /// Size of a pixel in x and y, mm.
    pub mm_per_px: [f64; 2],
}

impl Presses {
    /// Reads the pictures of a folder. Refuses a label without a frame and a frame without a label, and what
    /// [`Presses::new`] refuses.
    pub fn read(folder: &Path, source: &Source) -> Result<Self> {
        let no_contact = picture::read(&source.no_contact)?;
        let frames = picture::read_folder(folder, &source.no_contact)?;
        let Some(csv) = &source.labels else {
            let frames = frames.into_iter().map(|(name, frame)| (name, frame, None)).collect();
            return Self::new(no_contact, frames, source.ball_mm, source.mm_per_px);
        };
        let mut labels = labels(csv)?;
        if let Some(name) = labels.keys().find(|name| !frames.contains_key(*name)) {
            let expected = format!("a frame for each label, in {}", folder.display());
            return Err(Error::invalid(csv.display().to_string(), expected, format!("none called {name}")));
        }
        let labelled = frames.into_iter().map(|(name, frame)| match labels.remove(&name) {
            Some(circle) => Ok((name, frame, Some(circle))),
            None => Err(Error::invalid(csv.display().to_string(), "a label for each frame", format!("none of {name}"))),
        });
        Self::new(no_contact, labelled.collect::<Result<_>>()?, source.ball_mm, source.mm_per_px)
    }

    /// Takes named frames, each with its circle or without, in which case it is found.
    ///
    /// Refuses fewer than five, a frame of another size than the no-contact frame, a ball whose middle is not in
    /// the frame, a circle wider than the ball, a contact that is saturated and one that shows no difference.
    pub fn new(
        no_contact: Frame,
        frames: Vec<(String, Frame, Option<Circle>)>,
        ball_mm: f64,
        mm_per_px: [f64; 2],
    ) -> Result<Self> {
        for (what, mm) in [("ball diameter", ball_mm), ("mm per pixel", mm_per_px[0]), ("mm per pixel", mm_per_px[1])] {
            if !(mm.is_finite() && mm > 0.0) {
                return Err(Error::invalid(what, "a positive length", format!("{mm} mm")));
            }
        }
        if frames.len() < MIN_PRESSES {
            let expected = format!("{MIN_PRESSES} presses or more, spread over the frame");
            return Err(Error::invalid("calibration", expected, frames.len().to_string()));
        }
        let frame_px = [no_contact.width_px(), no_contact.height_px()];
        let geometry = PressGeometry { frame_px, mm_per_px, ball_radius_mm: 0.5 * ball_mm };
        let mut set = Self { no_contact, geometry, presses: Vec::new() };
        let press = |(name, frame, circle): (String, Frame, Option<Circle>)| set.press(name, &frame, circle);
        set.presses = frames.into_par_iter().map(press).collect::<Result<_>>()?;
        Ok(set)
    }

    fn press(&self, name: String, frame: &Frame, circle: Option<Circle>) -> Result<Press> {
        let [width, height] = self.geometry.frame_px;
        let refuse = |expected: String, got: String| Err(Error::invalid(&name, expected, got));
        if [frame.width_px(), frame.height_px()] != [width, height] {
            let got = format!("{}x{}", frame.width_px(), frame.height_px());
            return refuse(format!("{width}x{height} pixels as the no-contact frame"), got);
        }
        let circle = match circle {
            Some(circle) => circle,
            None => circle_search::find(&self.geometry, &self.compare(frame, |_| true).1)
                .ok_or_else(|| Error::invalid(&name, "the imprint of a ball", "no circle of slopes"))?,
        };
        let Circle { centre_px: [x, y], radius_px } = circle;
        let radius_mm = self.geometry.radius_mm(&circle);
        // A ball that the frame's edge cuts shows its slopes as well; where it is, is known as long as its middle is in view.
        let is_inside = (-0.5..=width as f64 - 0.5).contains(&x) && (-0.5..=height as f64 - 0.5).contains(&y);
        if !(radius_px >= 2.0 && is_inside) {
            let got = format!("radius {radius_px:.1} round {x:.1}, {y:.1}");
            return refuse(format!("the middle of the ball's contact within {width}x{height} pixels"), got);
        }
        if radius_mm > 1.05 * self.geometry.ball_radius_mm {
            let expected = format!("a contact narrower than the ball, radius {:.2} mm", self.geometry.ball_radius_mm);
            return refuse(expected, format!("{radius_mm:.2} mm (is mm per pixel right?)"));
        }
        let distance_mm = |pixel: usize| {
            let [x, y] = self.geometry.from_centre_mm(&circle, pixel);
            x.hypot(y) - radius_mm
        };
        let contact: Vec<usize> = (0..width * height).filter(|pixel| distance_mm(*pixel) <= 0.0).collect();
        let ends = contact.iter().flat_map(|pixel| &frame.rgb()[3 * pixel..3 * pixel + 3]);
        let saturated = ends.filter(|v| [0, 255].contains(*v)).count() as f64 / (3 * contact.len()) as f64;
        if saturated > MAX_SATURATED {
            let expected = format!("at most {:.0} % of the contact at 0 or 255", 100.0 * MAX_SATURATED);
            return refuse(expected, format!("{:.0} % (lower the exposure)", 100.0 * saturated));
        }
        let (gain, difference) = self.compare(frame, |pixel| distance_mm(pixel) > FAR_MM);
        let mean = |pixels: &mut dyn Iterator<Item = usize>| {
            let (sum, n) = pixels.fold((0.0, 0), |(sum, n), pixel| {
                let counts: f32 = difference[3 * pixel..3 * pixel + 3].iter().map(|v| v.abs()).sum();
                (sum + f64::from(counts), n + 3)
            });
            sum / f64::from(n.max(1))
        };
        let inside = mean(&mut contact.iter().copied());
        let outside = mean(&mut (0..width * height).filter(|pixel| distance_mm(*pixel) > FAR_MM));
        if inside < MIN_CONTRAST * outside.max(1.0) {
            let got = format!("{inside:.1} within the circle, {outside:.1} far from it");
            return refuse("a contact that changes the picture, counts".to_owned(), got);
        }
        Ok(Press { name, circle, gain, difference })
    }

    /// The exposure of each channel by `far` pixels, and the difference from rest once compensated.
    fn compare(&self, frame: &Frame, far: impl Fn(usize) -> bool) -> ([f32; 3], Vec<f32>) {
        let [width, height] = self.geometry.frame_px;
        compare::Press { frame, at_rest: &self.no_contact }.difference(&far_pixels(width * height, far))
    }
}

fn file_name(path: &str) -> String {
    path.rsplit(['/', '\\']).next().unwrap_or(path).to_owned()
}

/// Reads a CSV of circles; folders in the file's name are dropped. Columns by name: `image`, `img_names` or
/// `file`; `center_x`, `center_y` and `radius`, each with or without `_px`.
fn labels(path: &Path) -> Result<BTreeMap<String, Circle>> {
    let text = bounded_file::read_to_string(path, Kind::INDEX)?;
    let refuse = |place: String, expected: &str, got: String| {
        Error::invalid(format!("{}{place}", path.display()), expected, got)
    };
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).flexible(true).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|e| refuse(String::new(), "a CSV header", e.to_string()))?.clone();
    let column = |names: &[&str]| {
        let found = header.iter().position(|cell| names.contains(&cell.trim_end_matches("_px")));
        let got = || header.iter().collect::<Vec<_>>().join(",");
        found.ok_or_else(|| refuse(String::new(), &format!("a column {}", names.join(" or ")), got()))
    };
    let file = column(&["image", "img_names", "file"])?;
    let numbers = [column(&["center_x", "centre_x"])?, column(&["center_y", "centre_y"])?, column(&["radius"])?];
    let mut circles = BTreeMap::new();
    for record in reader.records() {
        let record = record.map_err(|e| refuse(String::new(), "a CSV file", e.to_string()))?;
        let place = format!(" line {}", record.position().map_or(0, csv::Position::line));
        let number =
            |column: usize| record.get(column).and_then(|cell| cell.parse().ok()).filter(|v: &f64| v.is_finite());
        let (Some(name), [Some(x), Some(y), Some(radius_px)]) = (record.get(file), numbers.map(number)) else {
            return Err(refuse(place, "a file and three numbers", record.iter().collect::<Vec<_>>().join(",")));
        };
        if circles.insert(file_name(name), Circle { centre_px: [x, y], radius_px }).is_some() {
            return Err(refuse(place, "one label for each file", name.to_owned()));
        }
    }
    Ok(circles)
}

#[cfg(test)]
mod tests {
    use super::super::synthetic::{self, BALL_MM, Set};
    use std::fs;

    use super::*;

    fn refusal(spoil: impl Fn(&mut Set)) -> String {
        let mut set = synthetic::presses(1);
        spoil(&mut set);
        let error = Presses::new(set.0, set.1, BALL_MM, synthetic::spec().mm_per_px()).unwrap_err().to_string();
        assert!(!error.contains('\n'), "{error}");
        error
    }

    #[test]
    fn a_bad_set_is_refused_with_the_reason() {
        let error = refusal(|set| set.1.truncate(4));
        assert!(error.contains("expected 5 presses or more") && error.ends_with("got 4"), "{error}");
        let error = refusal(|set| set.1[3].1 = Frame::from_parts(80, 120, vec![90; 3 * 80 * 120]));
        assert!(error.contains("press03.png: expected 160x120 pixels") && error.contains("80x120"), "{error}");
        let circle = |centre_px, radius_px| Some(Circle { centre_px, radius_px });
        let error = refusal(|set| set.1[2].2 = circle([-5.0, 60.0], 14.0));
        assert!(error.contains("press02.png: expected the middle of the ball's contact within 160x120"), "{error}");
        let error = refusal(|set| set.1[2].2 = circle([80.0, 60.0], 40.0));
        assert!(error.contains("narrower than the ball"), "{error}");
        let error = refusal(|set| {
            let bright = set.1[6].1.rgb().iter().map(|v| v.saturating_mul(4)).collect();
            set.1[6].1 = Frame::from_parts(160, 120, bright);
        });
        assert!(error.contains("press06.png: expected at most 25 % of the contact at 0 or 255"), "{error}");
        for circle in [circle([80.0, 60.0], 14.0), None] {
            let error = refusal(|set| (set.1[5].1, set.1[5].2) = (set.0.clone(), circle));
            let reason = if circle.is_some() { "a contact that changes the picture" } else { "the imprint of a ball" };
            assert!(error.contains("press05.png") && error.contains(reason), "{error}");
        }
        let (rest, frames) = synthetic::presses(1);
        assert!(Presses::new(rest, frames, f64::NAN, [0.1; 2]).is_err());
    }

    #[test]
    fn labels_and_frames_must_match() {
        let folder = tempfile::tempdir().unwrap();
        let (rest, frames) = synthetic::presses(1);
        let at = |name: &str| folder.path().join(name);
        picture::write_png(&at("rest.png"), &rest).unwrap();
        let mut csv = "img_names,center_x,center_y,radius\n".to_owned();
        for (name, frame, circle) in &frames {
            picture::write_png(&at(name), frame).unwrap();
            let Circle { centre_px: [x, y], radius_px } = circle.unwrap();
            csv += &format!("/elsewhere/{name},{x},{y},{radius_px}\n");
        }
        let source = Source {
            no_contact: at("rest.png"),
            labels: Some(at("labels.csv")),
            ball_mm: BALL_MM,
            mm_per_px: synthetic::spec().mm_per_px(),
        };
        let read = |csv: &str| {
            fs::write(at("labels.csv"), csv).unwrap();
            Presses::read(folder.path(), &source)
        };
        let presses = read(&csv).unwrap().presses;
        assert_eq!(presses.len(), 12);
        assert!(presses.iter().zip(&frames).all(|(press, frame)| Some(press.circle) == frame.2));
        let last = csv.trim_end().rfind('\n').unwrap() + 1;
        for (csv, reason) in [
            (csv[..last].to_owned(), "a label for each frame, got none of press11.png"),
            (format!("{csv}press77.png,1,2,3\n"), "got none called press77.png"),
            (format!("{csv}press00.png,1,2,3\n"), "line 14: expected one label for each file"),
            (csv.replacen(",radius", ",r", 1), "a column radius"),
            (format!("{csv}press12.png,1,far,3\n"), "line 14: expected a file and three numbers"),
        ] {
            let error = read(&csv).unwrap_err().to_string();
            assert!(error.contains("labels.csv") && error.contains(reason), "{error}");
        }
    }
}
