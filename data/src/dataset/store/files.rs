//! The files of a dataset: their names, and what is done with each.

use std::fs::File;
use std::io::{BufReader, BufWriter, Write};
use std::path::Path;

use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::file::bounded_file;

/// Name and version of the layout on disk.
pub const SCHEMA: &str = "tactile-filter/dataset/1";

pub(super) const FRAMES: &str = "frames.npy";
pub(super) const INDEX: &str = "index.jsonl";
pub(super) const NO_CONTACT: &str = "no_contact.png";
pub(super) const META: &str = "meta.json";

/// The files of a dataset.
pub const FILES: [&str; 4] = [FRAMES, INDEX, NO_CONTACT, META];

pub(super) fn check_sha256(path: &Path, expected: &str) -> Result<()> {
    let got = sha256(path)?;
    if got == expected {
        return Ok(());
    }
    Err(Error::invalid(name(path), format!("SHA-256 {expected}"), got))
}

/// SHA-256 of a file in hexadecimal, read in pieces: hashing the map would count the whole file as
/// this program's memory.
pub(super) fn sha256(path: &Path) -> Result<String> {
    let mut file = BufReader::with_capacity(1 << 20, bounded_file::open(path)?.0);
    let mut hash = Sha256::new();
    std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
    Ok(format!("{:x}", hash.finalize()))
}

pub(super) fn name(path: &Path) -> String {
    path.display().to_string()
}

pub(super) fn json_error(path: &Path, expected: &str) -> impl FnOnce(serde_json::Error) -> Error {
    move |error| Error::invalid(name(path), expected, error.to_string())
}

pub(super) fn create_file(path: &Path) -> Result<BufWriter<File>> {
    Ok(BufWriter::with_capacity(1 << 20, File::create(path).map_err(Error::io(path))?))
}

pub(super) fn sync(file: &mut BufWriter<File>, path: &Path) -> Result<()> {
    file.flush().and_then(|()| file.get_ref().sync_all()).map_err(Error::io(path))
}
