//! The pictures of a folder, in order, with what is known of them.

use std::fs;
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::dataset::touch::Touch;
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::frame::picture;
use crate::recording::{contradiction, index};

/// No picture is looked for deeper in subfolders.
const DEEPEST: usize = 8;

/// The picture files of a recording, in order.
#[derive(Debug)]
pub struct Listing {
    /// Each file with what is known of it.
    pub files: Vec<(PathBuf, Touch)>,
    /// The checksum of the source so far: of the index.
    pub hash: Sha256,
}

/// Lists a folder of pictures, or one picture: by its index where there is one; else its pictures by name, numbers by
/// value; else, where it holds none itself but `at_rest`, the pictures of its subfolders, which must then be in
/// `PART/hole` or `PART/peg`.
///
/// Files and folders whose names begin with a dot are passed over, and so are datasets and `at_rest`. What is odd is
/// added to `warnings`.
///
/// # Errors
/// An index that is wrong or contradicts itself, pictures in other subfolders, or no picture.
pub fn list(
    source: &Path,
    asked_index: Option<&Path>,
    at_rest: Option<&Path>,
    warnings: &mut Vec<String>,
) -> Result<Listing> {
    // What is neither is refused when it is read.
    let is_file = !fs::metadata(source).map_err(Error::io(source))?.is_dir();
    let found = ["index.csv", "index.jsonl"].map(|file| source.join(file)).into_iter().find(|path| path.exists());
    let mut hash = Sha256::new();
    let files = match asked_index.map(Path::to_path_buf).or(found) {
        Some(index) => {
            let bytes = bounded_file::read(&index, Kind::INDEX)?;
            hash.update(&bytes);
            let rows = index::read(&index, &bytes, if is_file { Path::new("") } else { source })?;
            contradiction::check(&index, &rows, warnings)?;
            rows.into_iter().filter_map(|row| Some((row.file?, row.touch))).collect()
        }
        None if is_file => vec![(source.to_path_buf(), Touch::default())],
        None => by_name(source, at_rest, warnings)?,
    };
    if files.is_empty() {
        return Err(Error::invalid(source.display().to_string(), "at least one PNG, JPEG or GIF frame", "none"));
    }
    Ok(Listing { files, hash })
}

fn by_name(source: &Path, at_rest: Option<&Path>, warnings: &mut Vec<String>) -> Result<Vec<(PathBuf, Touch)>> {
    let mut paths = Vec::new();
    walk(source, 0, &mut paths)?;
    // A path that cannot be resolved is reported when it is read.
    if let Some(at_rest) = at_rest.and_then(|path| path.canonicalize().ok()) {
        paths.retain(|path| path.canonicalize().ok().as_ref() != Some(&at_rest));
    }
    let n_all = paths.len();
    let is_in_source = |path: &PathBuf| path.parent() == Some(source);
    if paths.iter().any(is_in_source) {
        paths.retain(is_in_source);
    }
    if paths.len() < n_all {
        let n = n_all - paths.len();
        warnings.push(format!("{}: {n} picture(s) in its subfolders are left out", source.display()));
    }
    paths.sort_by_cached_key(|path| natural_key(&path.to_string_lossy()));
    let touch = |path: &PathBuf| if is_in_source(path) { Ok(Touch::default()) } else { by_folder(source, path) };
    paths.into_iter().map(|path| Ok((path.clone(), touch(&path)?))).collect()
}

/// Collects the pictures of a folder and its subfolders.
fn walk(folder: &Path, depth: usize, pictures: &mut Vec<PathBuf>) -> Result<()> {
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        let path = entry.path();
        if entry.file_name().to_string_lossy().starts_with('.') {
            continue;
        }
        // A link to a folder is not followed: it may lead in a circle.
        if entry.file_type().map_err(Error::io(&path))?.is_dir() {
            let is_dataset = path.join("frames.npy").exists();
            if depth < DEEPEST && !is_dataset {
                walk(&path, depth + 1, pictures)?;
            }
        } else if picture::is_picture(&path) && path.is_file() {
            pictures.push(path);
        }
    }
    Ok(())
}

/// What the folders of a picture say: `PART/hole` or `PART/peg`.
fn by_folder(source: &Path, path: &Path) -> Result<Touch> {
    let within = path.strip_prefix(source).unwrap_or(path);
    let folders: Vec<String> = within.iter().map(|name| name.to_string_lossy().into_owned()).collect();
    if let [part, side, _] = folders.as_slice() {
        let side = side.to_lowercase().parse().ok();
        if side.is_some() {
            return Ok(Touch { part: Some(part.clone()), side, ..Touch::default() });
        }
    }
    let expected = "an index, pictures in the folder itself, or all of them in PART/hole and PART/peg";
    Err(Error::invalid(source.display().to_string(), expected, within.display().to_string()))
}

/// Splits a name into text and numbers, so that `touch9` sorts before `touch10`; the name itself
/// breaks ties.
fn natural_key(name: &str) -> (Vec<(String, u64)>, String) {
    let mut parts = vec![(String::new(), 0_u64)];
    let mut in_number = false;
    for letter in name.chars() {
        match (letter.to_digit(10), parts.last_mut()) {
            (Some(digit), Some((_, number))) => *number = number.saturating_mul(10).saturating_add(digit.into()),
            (None, Some((text, _))) if !in_number => text.push(letter),
            _ => parts.push((letter.to_string(), 0)),
        }
        in_number = letter.is_ascii_digit();
    }
    (parts, name.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::touch::Side;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        folder
    }

    fn listed(folder: &Path) -> Result<Vec<(String, Touch)>> {
        let listing = list(folder, None, Some(&folder.join("rest.png")), &mut Vec::new())?;
        let name = |path: PathBuf| path.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
        Ok(listing.files.into_iter().map(|(path, touch)| (name(path), touch)).collect())
    }

    #[test]
    fn folders_of_part_and_side_say_both() {
        let files = ["B/peg/1.png", "A/hole/10.png", "A/hole/9.jpg", "A/Peg/1.gif", "A/notes.txt", "rest.png"];
        // What programs leave behind.
        let others = ["A/hole/._9.jpg", ".thumbnails/1.png", "out.partial/no_contact.png", "out.partial/frames.npy"];
        let folder = folder(&[&files[..], &others].concat());
        let touch = |part: &str, side| Touch { part: Some(part.into()), side: Some(side), ..Touch::default() };
        let expected = [
            ("A/Peg/1.gif", touch("A", Side::Peg)),
            ("A/hole/9.jpg", touch("A", Side::Hole)),
            ("A/hole/10.png", touch("A", Side::Hole)),
            ("B/peg/1.png", touch("B", Side::Peg)),
        ];
        assert_eq!(listed(folder.path()).unwrap(), expected.map(|(file, touch)| (file.to_owned(), touch)));
    }

    #[test]
    fn pictures_of_the_folder_itself_are_taken_without_its_subfolders() {
        let folder = folder(&["9.png", "10.png", "A/hole/1.png", "._9.png"]);
        let names: Vec<String> = listed(folder.path()).unwrap().into_iter().map(|(name, _)| name).collect();
        assert_eq!(names, ["9.png", "10.png"]);
        let mut warnings = Vec::new();
        list(folder.path(), None, None, &mut warnings).unwrap();
        assert!(warnings[0].ends_with("1 picture(s) in its subfolders are left out"), "{warnings:?}");
    }

    #[test]
    fn pictures_in_other_subfolders_are_refused_with_the_first() {
        for other in ["A/left/1.png", "A/1.png", "A/hole/deep/1.png"] {
            let folder = folder(&["B/hole/1.png", other]);
            let message = listed(folder.path()).unwrap_err().to_string();
            assert!(message.ends_with(&format!("PART/hole and PART/peg, got {other}")), "{message}");
        }
        let message = listed(folder(&["A/hole/notes.txt"]).path()).unwrap_err().to_string();
        assert!(message.contains("at least one PNG, JPEG or GIF frame"), "{message}");
    }
}
