//! The files of a data set in Parquet, in order.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::error::{Error, Result};

/// Whether a file's name ends as one in Parquet, and does not begin with a dot.
pub fn is_shard(path: &Path) -> bool {
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    !is_hidden && path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("parquet"))
}

/// The files of a data set: `source` itself, or the `.parquet` files in it by their names.
///
/// # Errors
/// Shards called `NAME-00000-of-00003.parquet` where one is missing, or with several names, as the shards of a training
/// and a test set have.
#[cfg_attr(not(feature = "parquet"), expect(dead_code, reason = "only a build that reads Parquet needs them"))]
pub fn find(source: &Path) -> Result<Vec<PathBuf>> {
    if !source.is_dir() {
        return Ok(vec![source.to_path_buf()]);
    }
    let entries = fs::read_dir(source).map_err(Error::io(source))?;
    let paths = entries.map(|entry| entry.map(|e| e.path())).collect::<std::io::Result<Vec<_>>>();
    let mut paths = paths.map_err(Error::io(source))?;
    paths.retain(|path| is_shard(path));
    paths.sort();
    let mut sets: BTreeMap<(String, usize), Vec<usize>> = BTreeMap::new();
    for (set, number) in paths.iter().filter_map(|path| numbered(path)) {
        sets.entry(set).or_default().push(number);
    }
    let place = || source.display().to_string();
    if sets.len() > 1 {
        let names: Vec<String> = sets.keys().map(|(name, n)| format!("{name} of {n}")).collect();
        return Err(Error::invalid(place(), "the shards of one set", names.join(", ")));
    }
    if let Some(((name, n), numbers)) = sets.first_key_value()
        && let Some(missing) = (0..*n).find(|number| !numbers.contains(number))
    {
        return Err(Error::invalid(
            place(),
            format!("{n} shards of {name}"),
            format!("none with the number {missing}"),
        ));
    }
    Ok(paths)
}

/// The name, the count and the number of a shard: `train`, 3 and 0 of `train-00000-of-00003.parquet`.
fn numbered(path: &Path) -> Option<((String, usize), usize)> {
    let (rest, n) = path.file_stem()?.to_str()?.rsplit_once("-of-")?;
    let (name, number) = rest.rsplit_once('-')?;
    Some(((name.to_owned(), n.parse().ok()?), number.parse().ok()?))
}
