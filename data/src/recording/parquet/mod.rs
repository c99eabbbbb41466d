//! A recording in Parquet, in the layout of Hugging Face's images: a row a picture, `image` with its bytes, and the
//! columns of an index ([`COLUMNS`](crate::recording::index::COLUMNS)) but `file`
//! (<https://huggingface.co/docs/hub/datasets-image>). It is read with the feature `parquet`.

#[cfg(feature = "parquet")]
mod rows;
mod shards;
#[cfg(feature = "parquet")]
mod table;
#[cfg(feature = "parquet")]
#[cfg(test)]
mod test_table;
#[cfg(feature = "parquet")]
#[cfg(test)]
mod tests;

use std::fs;
use std::path::{Path, PathBuf};

#[cfg(feature = "lerobot")]
pub(super) use rows::Tables;
#[cfg(feature = "parquet")]
pub use rows::import;
#[cfg(feature = "lerobot")]
pub(super) use table::{Layout, State};

use crate::frame::picture::is_picture;

#[cfg(not(feature = "parquet"))]
use crate::error::{Error, Result};
#[cfg(not(feature = "parquet"))]
use crate::recording::folder::{Import, Imported};

/// Whether a source is in Parquet, readable here or not: a `.parquet` file, or a folder of them without pictures and
/// without an index.
pub fn is_parquet(source: &Path) -> bool {
    if !source.is_dir() {
        return shards::is_shard(source);
    }
    let Ok(entries) = fs::read_dir(source) else { return false };
    let paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    let is_other = |path: &PathBuf| is_picture(path) || path.ends_with("index.csv") || path.ends_with("index.jsonl");
    paths.iter().any(|path| shards::is_shard(path)) && !paths.iter().any(is_other)
}

/// Imports `source`, a Parquet file or a folder of shards, to a dataset at `out`; `progress` gets the rows done and all
/// rows.
///
/// # Errors
/// A build that does not read Parquet.
#[cfg(not(feature = "parquet"))]
pub fn import(source: &Path, _: &Import, _: &Path, _: &dyn Fn(usize, usize)) -> Result<Imported> {
    let got = "Parquet, which a build with --features parquet reads";
    Err(Error::invalid(source.display().to_string(), "pictures or a bag", got))
}

#[cfg(not(feature = "parquet"))]
#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parquet_is_known_and_refused_with_the_build_that_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("train-00000-of-00001.parquet");
        fs::write(&file, "PAR1").unwrap();
        for source in [folder.path(), &file] {
            assert!(is_parquet(source));
            let out = folder.path().join("out");
            let message = import(source, &Import::default(), &out, &|_, _| {}).unwrap_err().to_string();
            assert!(message.contains("--features parquet"), "{message}");
        }
        for other in ["index.csv", "1.png"] {
            fs::write(folder.path().join(other), "file").unwrap();
            assert!(!is_parquet(folder.path()) && !is_parquet(&folder.path().join(other)), "{other}");
            fs::remove_file(folder.path().join(other)).unwrap();
        }
    }
}
