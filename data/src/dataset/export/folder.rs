//! A dataset as a folder of pictures with an index, which [`crate::recording::folder`] reads back.

use std::fs;
use std::path::Path;

use crate::dataset::export::jpeg;
use crate::dataset::export::partial::Partial;
use crate::dataset::store::Dataset;
use crate::error::{Error, Result};
use crate::frame::picture;
use crate::pose::se2::Se2;
use crate::recording::index::COLUMNS;
use crate::recording::spreadsheet::cell_of;

/// Name of the frame at rest in the folder.
pub const NO_CONTACT: &str = "no_contact.png";

/// Writes the frames as `000000.png` and so on (`.jpg` with a `jpeg` quality of 1 to 100), `index.csv` and the frame
/// at rest to a new folder. Positions come back to the last bit; angles do where some number of degrees gives their
/// radians, else to one part in 10^16. Names that a spreadsheet would run as formulas begin with an apostrophe, which
/// [`crate::recording::index`] takes away again. `progress` gets the frames done and all frames.
///
/// # Errors
/// A name in use; a disk that cannot be written.
pub fn export(dataset: &Dataset, out: &Path, jpeg_quality: Option<u8>, progress: &dyn Fn(usize, usize)) -> Result<()> {
    let partial = Partial::folder(out, is_ours)?;
    let index = partial.path().join("index.csv");
    let mut rows = csv::Writer::from_path(&index).map_err(|e| csv_error(&index, e))?;
    rows.write_record(COLUMNS).map_err(|e| csv_error(&index, e))?;
    for (i, touch) in dataset.touches().iter().enumerate() {
        let file = format!("{i:06}.{}", if jpeg_quality.is_some() { "jpg" } else { "png" });
        let path = partial.path().join(&file);
        match jpeg_quality {
            Some(quality) => fs::write(&path, jpeg(&dataset.frame(i), quality)?).map_err(Error::io(&path))?,
            None => picture::write_png(&path, &dataset.frame(i))?,
        }
        let side = touch.side.map(|side| side.to_string()).unwrap_or_default();
        let name = |name: &Option<String>| cell_of(name.clone().unwrap_or_default());
        let mut row = vec![file, name(&touch.part), side];
        row.extend(cells(touch.part_from_sensor));
        row.extend(cells(touch.moved));
        row.extend([&touch.pair, &touch.episode].map(name));
        row.push(touch.time_s.map_or(String::new(), |time| time.to_string()));
        rows.write_record(&row).map_err(|e| csv_error(&index, e))?;
        progress(i + 1, dataset.len());
    }
    rows.flush().map_err(Error::io(&index))?;
    picture::write_png(&partial.path().join(NO_CONTACT), dataset.no_contact())?;
    partial.finish()
}

/// Whether an export writes a file of this name.
fn is_ours(name: &str) -> bool {
    let picture = name.strip_suffix(".png").or_else(|| name.strip_suffix(".jpg"));
    ["index.csv", NO_CONTACT].contains(&name)
        || picture.is_some_and(|number| number.len() >= 6 && number.bytes().all(|digit| digit.is_ascii_digit()))
}

fn csv_error(index: &Path, error: csv::Error) -> Error {
    Error::invalid(index.display().to_string(), "a row that can be written", error.to_string())
}

/// x, y and the angle, each the shortest text that is read back as the same number; empty where nothing is known.
fn cells(pose: Option<Se2>) -> [String; 3] {
    match pose {
        Some(Se2 { x_mm, y_mm, theta_rad }) => [x_mm, y_mm, degrees(theta_rad)].map(|value| value.to_string()),
        None => Default::default(),
    }
}

/// The number of degrees that gives `theta_rad` when it is taken back to radians; the nearest where none does.
pub(super) fn degrees(theta_rad: f64) -> f64 {
    let near = theta_rad.to_degrees();
    let candidates = [near, near.next_up(), near.next_down(), near.next_up().next_up(), near.next_down().next_down()];
    candidates.into_iter().find(|degrees| degrees.to_radians() == theta_rad).unwrap_or(near)
}
