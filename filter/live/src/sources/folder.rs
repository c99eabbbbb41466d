//! A folder that another program puts pictures into: one for each touch, with a file that says where it was.
//!
//! `rest*.png` (or `.jpg`) is the sensor at rest. Any other picture is a touch once a file of its name ending in `.json`
//! holds its place, `{"x_mm": 0, "y_mm": 0, "theta_deg": 0}`, in a plane that stands still. A picture with
//! `"reset": true` is the first of another hole. The answer is written to `NAME.decision.json`. Files are looked at in
//! the order of their names; write them under another name and rename them.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use tactile_data::bounded_file::{self, Kind};
use tactile_data::picture::is_picture;
use tactile_data::se2::Se2;
use tactile_data::whole_file;

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
    /// Its events, in order; the last one is answered under `id`.
    pub events: Vec<Input>,
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

    /// The next picture that is ready, in the order of names; `id` is the number of its answer.
    ///
    /// # Errors
    /// A place that cannot be read, by its file; the picture is not looked at again.
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
            let shown = picture(bounded_file::read(&path, Kind::PICTURE)?);
            let called = |request| Input::Called { request, id };
            let events = if is_rest {
                vec![called(Request::Calibrate), shown]
            } else {
                let TouchPlace { x_mm, y_mm, theta_deg, reset } = read_place(&place)?;
                let first = reset.then_some(Input::Called { request: Request::Reset, id: 0 });
                let at = placed(&Se2::from_degrees(x_mm, y_mm, theta_deg));
                first.into_iter().chain([at, shown, called(Request::Observe)]).collect()
            };
            return Ok(Some(Ready { path, events }));
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
        assert!(rest.path.ends_with("rest.png") && rest.events.len() == 2);
        assert_eq!(folder.next(2).unwrap(), None);
        put("touch-2.json", r#"{"x_mm": 1, "y_mm": 2, "theta_deg": 30, "reset": true}"#);
        put("touch-1.json", r#"{"x_mm": 0, "y_mm": 0}"#);
        let error = folder.next(2).unwrap_err().to_string();
        assert!(error.contains("touch-1.json") && error.contains("theta_deg"), "{error}");
        let touch = folder.next(3).unwrap().unwrap();
        assert_eq!(touch.events.len(), 4);
        assert_eq!(touch.events[1], placed(&Se2::from_degrees(1.0, 2.0, 30.0)));
        assert_eq!(folder.next(4).unwrap(), None);
        folder.answer(&touch.path, "{}").unwrap();
        assert!(scratch.path().join("touch-2.decision.json").exists());
        assert_eq!(folder.next(4).unwrap(), None);
    }
}
