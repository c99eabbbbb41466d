//! Outputs, checked and locked before the work that fills them.

use std::fmt::Display;
use std::fs::{self, OpenOptions};
use std::io::ErrorKind;
use std::path::Path;

use crate::error::{Error, Result};
use crate::file::bounded_file::check_is_file;
use crate::file::output_lock::OutputLock;

/// Checks that a file can be written at `out` and that it is none of `inputs`, and locks it against another run until
/// what is returned is dropped. A file that is there stays as it is.
///
/// # Errors
/// An input, a folder, a place where nothing can be written, or an output that another run is writing.
pub fn check_file<P: AsRef<Path>>(out: &Path, inputs: impl IntoIterator<Item = P>) -> Result<OutputLock> {
    let path = out.canonicalize().ok();
    let is_out = |input: &Path| input == out || (path.is_some() && input.canonicalize().ok() == path);
    if inputs.into_iter().any(|input| is_out(input.as_ref())) {
        let got = "one that this command reads or writes already";
        return Err(Error::invalid(out.display().to_string(), "a file of its own", got));
    }
    check_writable(out)?;
    OutputLock::take(out)
}

fn check_writable(out: &Path) -> Result<()> {
    if let Ok(there) = fs::metadata(out) {
        // Opening a pipe would wait for its reader, and a rename would replace a device.
        check_is_file(out, &there)?;
    }
    match OpenOptions::new().write(true).create_new(true).open(out) {
        Ok(_) => fs::remove_file(out),
        Err(error) if error.kind() == ErrorKind::AlreadyExists => OpenOptions::new().append(true).open(out).map(drop),
        Err(error) => Err(error),
    }
    .map_err(Error::io(out))
}

/// Makes the folder in which the file `out` will lie, and checks and locks the file as [`check_file`] does.
///
/// # Errors
/// As [`check_file`].
pub fn prepare_file<P: AsRef<Path>>(out: &Path, inputs: impl IntoIterator<Item = P>) -> Result<OutputLock> {
    if let Some(folder) = out.parent() {
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    check_file(out, inputs)
}

/// Makes the folder `out`, and checks and locks, as [`check_file`] does, the page and then the figures that will be written
/// there.
///
/// # Errors
/// As [`check_file`]; a page without figures: another program made it, for ours is never without.
pub fn prepare_folder<P: AsRef<Path>>(out: &Path, page: &str, figures: &str, inputs: &[P]) -> Result<[OutputLock; 2]> {
    let (page, figures) = (out.join(page), out.join(figures));
    if page.exists() && !figures.exists() {
        let expected = format!("no file, or one of an earlier run with its {}", figures.display());
        return Err(Error::invalid(page.display().to_string(), expected, "a page of something else"));
    }
    Ok([prepare_file(&page, inputs)?, prepare_file(&figures, inputs)?])
}

/// Refuses work that this machine's memory cannot hold.
///
/// # Errors
/// `what`, the flag or setting that is to blame, with its value and the memory that it would take.
pub fn check_memory(what: &str, value: impl Display, n_bytes: f64) -> Result<()> {
    /// More than any machine that this is meant for has: some systems promise any amount.
    const MOST_BYTES: f64 = 1e12;
    if n_bytes <= MOST_BYTES && Vec::<u8>::new().try_reserve_exact(n_bytes as usize).is_ok() {
        return Ok(());
    }
    let got = format!("{value}, which takes {} of memory or more", size(n_bytes));
    Err(Error::invalid(what, "work that fits into this machine's memory", got))
}

/// Checks that the disk has room at `out`, which need not exist yet, for `n_frames` frames of `frame_px`.
///
/// # Errors
/// Too little room: what is needed in frames and bytes, and what is free.
pub fn check_room(out: &Path, n_frames: usize, frame_px: [usize; 2]) -> Result<()> {
    let frame_bytes = 3.0 * frame_px[0] as f64 * frame_px[1] as f64;
    let needed = n_frames as f64 * (frame_bytes + INDEX_LINE_BYTES);
    // The nearest folder above that exists.
    let above = std::path::absolute(out).map_err(Error::io(out))?;
    let Some(folder) = above.ancestors().skip(1).find(|folder| folder.is_dir()) else { return Ok(()) };
    let free = fs4::available_space(folder).map_err(Error::io(folder))? as f64;
    if needed <= free {
        return Ok(());
    }
    let expected = format!("room for {n_frames} frames of {}, {} in all", size(frame_bytes), size(needed));
    Err(Error::invalid(out.display().to_string(), expected, format!("{} free", size(free))))
}

/// About what a touch with a part, a side and a pose takes in the index, bytes.
const INDEX_LINE_BYTES: f64 = 130.0;

/// A number of bytes for people.
pub(crate) fn size(bytes: f64) -> String {
    let units = [(1e18, "EB"), (1e15, "PB"), (1e12, "TB"), (1e9, "GB"), (1e6, "MB"), (1e3, "kB")];
    let unit = units.into_iter().find(|(unit, _)| bytes >= *unit);
    unit.map_or_else(|| format!("{bytes} B"), |(unit, name)| format!("{:.1} {name}", bytes / unit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_output_is_a_writable_file_that_is_no_input() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("rest.png"), "a picture").unwrap();
        fs::write(at("old.png"), "old").unwrap();
        let check = |out: &str| check_file(&at(out), [at("missing.png"), at("rest.png")]);
        drop(check("new.png").unwrap());
        drop(check("old.png").unwrap());
        assert!(!at("new.png").exists() && fs::read(at("old.png")).unwrap() == b"old");
        fs::create_dir(at("sub")).unwrap();
        for (out, reason) in [("sub/../rest.png", "a file of its own"), ("nowhere/new.png", "nowhere"), ("sub", "sub")]
        {
            assert!(check(out).unwrap_err().to_string().contains(reason), "{out}");
        }
        assert_eq!(fs::read(at("rest.png")).unwrap(), b"a picture");
        #[cfg(unix)]
        {
            let pipe = folder.path().join("pipe");
            assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
            assert!(check("pipe").unwrap_err().to_string().contains("pipe: expected a file, got a device, a pipe"));
            fs::remove_file(&pipe).unwrap();
        }
        let lock = check("new.png").unwrap();
        assert!(check("new.png").unwrap_err().to_string().contains("new.png: expected an output that no other run"));
        drop(lock);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3, "no lock file stays");
    }

    #[test]
    fn a_folder_is_made_and_a_page_of_something_else_is_kept() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("new/evaluation");
        let prepare = |inputs: &[&Path]| prepare_folder(&out, "report.html", "evaluation.json", inputs);
        let locks = prepare(&[]).unwrap();
        assert!(out.is_dir());
        assert!(prepare(&[]).unwrap_err().to_string().contains("report.html: expected an output that no other run"));
        drop(locks);
        assert_eq!(fs::read_dir(&out).unwrap().count(), 0);
        fs::write(out.join("report.html"), "mine").unwrap();
        assert!(prepare(&[]).unwrap_err().to_string().contains("a page of something else"));
        fs::write(out.join("evaluation.json"), "{}").unwrap();
        drop(prepare(&[]).unwrap());
        assert!(prepare(&[&out.join("evaluation.json")]).unwrap_err().to_string().contains("a file of its own"));
    }

    #[test]
    fn work_beyond_the_memory_is_refused_with_what_it_takes() {
        check_memory("--touches", 10, 1e6).unwrap();
        for (n_bytes, takes) in [(6.4e13, "takes 64.0 TB"), (1e40, "EB"), (f64::INFINITY, "inf")] {
            let error = check_memory("--touches", 1_000_000_000, n_bytes).unwrap_err().to_string();
            assert!(error.starts_with("--touches") && error.contains(takes), "{error}");
        }
    }

    #[test]
    fn a_dataset_beyond_the_disk_is_refused_with_what_it_needs() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("not/there/yet");
        check_room(&out, 10, [80, 60]).unwrap();
        for (n_frames, needs) in [(10_usize.pow(15), "14.5 EB"), (usize::MAX, "frames of 14.4 kB")] {
            let error = check_room(&out, n_frames, [80, 60]).unwrap_err().to_string();
            assert!(error.contains(needs) && error.contains("free"), "{error}");
        }
    }
}
