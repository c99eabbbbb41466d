//! A folder that another program puts pictures into: one for each touch, with a file that says where it was.
//!
//! `rest*.png` (or `.jpg`) is the sensor at rest. Any other picture is a touch once a file of its name ending in `.json`
//! holds its place, `{"x_mm": 0, "y_mm": 0, "theta_deg": 0}`, in a plane that does not move. A picture with
//! `"reset": true` is the first of another hole. The answer is written to `NAME.decision.json`: what was decided, or
//! `{"error": "..."}` where the touch was refused. Files are looked at in the order of their names; write them under
//! another name and rename them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tactile_data::file::bounded_file::{self, Kind};
use tactile_data::file::whole_file;
use tactile_data::frame::picture::is_picture;
use tactile_data::pose::se2::Se2;

use crate::error::{Error, Result};
use crate::event::{Input, Request};
use crate::sources::{picture, placed};

/// Where a touch was.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TouchPlace {
    /// Along x, mm.
    pub x_mm: f64,
    /// Along y, mm.
    pub y_mm: f64,
    /// Angle, degrees.
    pub theta_deg: f64,
    /// Whether it is the first touch of another hole.
    #[serde(default)]
    pub reset: bool,
}

/// A folder and what was seen of it.
#[derive(Debug)]
pub struct Folder {
    path: PathBuf,
    seen: BTreeSet<PathBuf>,
}

/// A picture that is ready.
#[derive(Clone, Debug, PartialEq)]
pub struct Ready {
    /// The picture's file.
    pub path: PathBuf,
    /// Whether it is a touch, whose answer is written.
    pub is_touch: bool,
    /// Its events, in order, of which one is answered under `id`; or why it has none.
    pub events: std::result::Result<Vec<Input>, String>,
}

impl Folder {
    /// Watches a folder.
    ///
    /// # Errors
    /// No folder.
    pub fn open(path: &Path) -> Result<Self> {
        if !path.is_dir() {
            return Err(Error::invalid(path.display().to_string(), "a folder", "none"));
        }
        Ok(Self { path: path.to_path_buf(), seen: BTreeSet::new() })
    }

    /// The next picture that is ready, in the order of names; `id` is the number of its answer. One that cannot be read,
    /// or whose place cannot, has no events but the reason, and is not looked at again.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn next(&mut self, id: u64) -> Result<Option<Ready>> {
        let entries = fs::read_dir(&self.path).map_err(Error::io(&self.path))?;
        let paths = entries.map(|entry| entry.map(|entry| entry.path())).collect::<std::io::Result<BTreeSet<_>>>();
        for path in paths.map_err(Error::io(&self.path))? {
            if !is_picture(&path) || self.seen.contains(&path) {
                continue;
            }
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let place = path.with_extension("json");
            let is_rest = name.starts_with("rest");
            if !is_rest && !place.exists() {
                continue;
            }
            self.seen.insert(path.clone());
            let events = if is_rest { rest(&path, id) } else { touch(&path, &place, id) };
            let events = events.map_err(|error| error.to_string());
            return Ok(Some(Ready { path, is_touch: !is_rest, events }));
        }
        Ok(None)
    }

    /// Writes the answer to a picture's touch, whole or not at all.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn answer(&self, picture: &Path, json: &str) -> Result<()> {
        let out = picture.with_extension("decision.json");
        Ok(whole_file::write(&out, json.as_bytes())?)
    }
}

/// The events of a picture at rest.
fn rest(path: &Path, id: u64) -> Result<Vec<Input>> {
    let shown = picture(bounded_file::read(path, Kind::PICTURE)?);
    Ok(vec![Input::Called { request: Request::Calibrate, id }, shown])
}

/// The events of a touch and its place.
fn touch(path: &Path, place: &Path, id: u64) -> Result<Vec<Input>> {
    let TouchPlace { x_mm, y_mm, theta_deg, reset } = read_place(place)?;
    let shown = picture(bounded_file::read(path, Kind::PICTURE)?);
    let first = reset.then_some(Input::Called { request: Request::Reset, id: 0 });
    let at = placed(&Se2::from_degrees(x_mm, y_mm, theta_deg));
    Ok(first.into_iter().chain([at, shown, Input::Called { request: Request::Observe, id }]).collect())
}

fn read_place(path: &Path) -> Result<TouchPlace> {
    let text = bounded_file::read_to_string(path, Kind::SETTINGS)?;
    serde_json::from_str(&text).map_err(|error| {
        let expected = r#"{"x_mm": 0, "y_mm": 0, "theta_deg": 0}"#;
        Error::invalid(path.display().to_string(), expected, error.to_string())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_wait_for_their_places_and_come_once_in_order() {
        let scratch = tempfile::tempdir().unwrap();
        let put = |name: &str, text: &str| fs::write(scratch.path().join(name), text).unwrap();
        let mut folder = Folder::open(scratch.path()).unwrap();
        assert_eq!(folder.next(1).unwrap(), None);
        put("touch-2.png", "2");
        put("touch-1.jpg", "1");
        put("notes.txt", "");
        put("rest.png", "0");
        let rest = folder.next(1).unwrap().unwrap();
        assert!(rest.path.ends_with("rest.png") && !rest.is_touch && rest.events.unwrap().len() == 2);
        assert_eq!(folder.next(2).unwrap(), None);
        put("touch-2.json", r#"{"x_mm": 1, "y_mm": 2, "theta_deg": 30, "reset": true}"#);
        put("touch-1.json", r#"{"x_mm": 0, "y_mm": 0}"#);
        let refused = folder.next(2).unwrap().unwrap();
        assert!(refused.path.ends_with("touch-1.jpg") && refused.is_touch);
        let error = refused.events.unwrap_err();
        assert!(error.contains("touch-1.json") && error.contains("theta_deg"), "{error}");
        let touch = folder.next(3).unwrap().unwrap();
        let events = touch.events.unwrap();
        assert_eq!(events.len(), 4);
        assert_eq!(events[1], placed(&Se2::from_degrees(1.0, 2.0, 30.0)));
        assert_eq!(folder.next(4).unwrap(), None);
        folder.answer(&touch.path, "{}").unwrap();
        assert!(scratch.path().join("touch-2.decision.json").exists());
        assert_eq!(folder.next(4).unwrap(), None);
    }
}
