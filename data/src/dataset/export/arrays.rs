//! A dataset as NumPy arrays: what `numpy.load` reads without another library.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::json;

use crate::dataset::export::partial::Partial;
use crate::dataset::store::Dataset;
use crate::error::{Error, Result};

/// The files of the folder.
const FILES: [&str; 4] = ["frames.npy", "no_contact.npy", "poses.npy", "touches.json"];

/// Writes a new folder: `frames.npy` (u8, `[n, height, width, 3]`), `no_contact.npy` (u8, `[height, width, 3]`),
/// `poses.npy` (f64, `[n, 3]`: x and y in mm, the angle in radians; NaN where a pose is not known) and `touches.json`
/// (parts, sides and times, one each frame, and the size of a pixel in mm). `progress` gets the frames done and all.
///
/// # Errors
/// A name in use; a disk that cannot be written.
pub fn export(dataset: &Dataset, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<()> {
    let partial = Partial::folder(out, |name| FILES.contains(&name))?;
    let [width, height] = dataset.meta().frame_px;
    let n = dataset.len();
    let mut frames = Npy::create(partial.path().join("frames.npy"), "|u1", &[n, height, width, 3])?;
    for i in 0..n {
        frames.write(dataset.frame_bytes(i))?;
        progress(i + 1, n);
    }
    frames.finish()?;
    let mut rest = Npy::create(partial.path().join("no_contact.npy"), "|u1", &[height, width, 3])?;
    rest.write(dataset.no_contact().rgb())?;
    rest.finish()?;
    let mut poses = Npy::create(partial.path().join("poses.npy"), "<f8", &[n, 3])?;
    for touch in dataset.touches() {
        let pose = touch.part_from_sensor.map_or([f64::NAN; 3], |pose| [pose.x_mm, pose.y_mm, pose.theta_rad]);
        poses.write(&pose.map(f64::to_le_bytes).concat())?;
    }
    poses.finish()?;
    let touches = dataset.touches();
    let text = json!({
        "schema": "tactile-filter/arrays/1",
        "mm_per_px": dataset.meta().mm_per_px,
        "poses": ["x_mm", "y_mm", "theta_rad"],
        "parts": touches.iter().map(|touch| &touch.part).collect::<Vec<_>>(),
        "sides": touches.iter().map(|touch| touch.side).collect::<Vec<_>>(),
        "times_s": touches.iter().map(|touch| touch.time_s).collect::<Vec<_>>(),
    });
    let path = partial.path().join("touches.json");
    fs::write(&path, format!("{text:#}\n")).map_err(Error::io(&path))?;
    partial.finish()
}

/// An `.npy` file of version 1.0 in C order, its values written one behind the other.
struct Npy {
    path: PathBuf,
    file: BufWriter<File>,
}

impl Npy {
    fn create(path: PathBuf, kind: &str, shape: &[usize]) -> Result<Self> {
        let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
        // Magic, version, length and header fill whole blocks of 64 bytes, the last byte a line's end.
        let header = format!("{header:<width$}\n", width = (header.len() + 11).next_multiple_of(64) - 11);
        let file = BufWriter::new(File::create(&path).map_err(Error::io(&path))?);
        let mut npy = Self { path, file };
        npy.write(b"\x93NUMPY\x01\x00")?;
        npy.write(&(header.len() as u16).to_le_bytes())?;
        npy.write(header.as_bytes())?;
        Ok(npy)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.file.write_all(bytes).map_err(Error::io(&self.path))
    }

    fn finish(mut self) -> Result<()> {
        self.file.flush().map_err(Error::io(&self.path))
    }
}
