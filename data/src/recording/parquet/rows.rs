//! From the rows of Parquet files to a dataset.

use std::path::{Path, PathBuf};

use crate::dataset::store::provenance::sha256;
use crate::error::{Error, Result};
use crate::recording::contradiction;
use crate::recording::folder::{Import, Imported, begin, frames_of};
use crate::recording::index::{COLUMNS, Place, Row};
use crate::recording::parquet::shards;
use crate::recording::parquet::table::{Layout, Table};
use crate::recording::pipeline::{Item, Picture, push};
use crate::text::suggest::with_closest;

/// Imports `source`, a Parquet file or a folder of shards, to a dataset at `out`, as
/// [`folder::import`](crate::recording::folder::import) does a folder with an index. Columns that an index does not
/// have are left out, with a warning. `progress` gets the rows done and all rows. Pictures are read some at a time.
///
/// # Errors
/// A row, picture or size that is wrong, with its file and row; a codec that is not in Rust; an index in addition to
/// the rows.
pub fn import(source: &Path, how: &Import, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<Imported> {
    if let Some(index) = &how.index {
        let got = index.display().to_string();
        return Err(Error::invalid("--index", "none for Parquet, whose rows are the index", got));
    }
    let files = shards::find(source)?;
    let tables = Tables { source, files: &files, layout: &Layout::of_index() };
    tables.import(how, tables.rows()?, out, progress)
}

/// The files of a recording in Parquet.
pub struct Tables<'a> {
    /// What was asked for, for messages.
    pub source: &'a Path,
    /// Its files, in order.
    pub files: &'a [PathBuf],
    /// What is in which column.
    pub layout: &'a Layout,
}

impl Tables<'_> {
    /// Imports the pictures of all files with what is known of each.
    pub fn import(
        &self,
        how: &Import,
        (rows, mut warnings): (Vec<Row>, Vec<String>),
        out: &Path,
        progress: &dyn Fn(usize, usize),
    ) -> Result<Imported> {
        let Self { source, files, .. } = *self;
        if rows.is_empty() {
            return Err(Error::invalid(source.display().to_string(), "at least one row", "none"));
        }
        contradiction::check(source, &rows, &mut warnings)?;
        let n_rows = rows.len();
        let mut frames = self.pictures().flat_map(|picture| {
            let (bytes, place) = match picture {
                Ok((place, bytes)) => (Ok(bytes), place.to_string()),
                Err(error) => (Err(error), String::new()),
            };
            frames_of(bytes, place)
        });
        let (view, mut writer) = begin(source, how, (&mut frames, n_rows), out, &mut warnings)?;
        let mut items = self.pictures().zip(rows).map(|(picture, row)| {
            let (place, bytes) = picture?;
            Ok(Item { picture: Picture::Encoded(bytes), touch: row.touch, place: place.to_string() })
        });
        let n_frames = push(&mut items, n_rows, &view, &mut writer, progress)?;
        writer.set_recording(view.recording(sha256(files)?));
        writer.finish()?;
        Ok(Imported { n_frames, warnings })
    }

    /// What the rows of all files say, without their pictures, and what a person should know.
    pub fn rows(&self) -> Result<(Vec<Row>, Vec<String>)> {
        let mut rows = Vec::new();
        let mut unknown = Vec::new();
        for file in self.files {
            let table = Table::open(file, self.layout)?;
            unknown.extend(table.unknown.iter().filter(|name| !unknown.contains(*name)).cloned().collect::<Vec<_>>());
            rows.extend(table.rows()?);
        }
        let warnings = unknown.iter().map(|name| format!("column {} is left out", with_closest(name, COLUMNS)));
        Ok((rows, warnings.collect()))
    }

    /// The pictures of all files, in order; one file is open at a time.
    fn pictures(&self) -> impl Iterator<Item = Result<(Place, Vec<u8>)>> {
        self.files.iter().flat_map(|file| {
            let (pictures, error) = match Table::open(file, self.layout) {
                Ok(table) => (Some(table.pictures()), None),
                Err(error) => (None, Some(Err(error))),
            };
            error.into_iter().chain(pictures.into_iter().flatten())
        })
    }
}
