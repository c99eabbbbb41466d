//! Writes a dataset.

use std::fs::{self, File};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use super::files::{FILES, FRAMES, INDEX, META, NO_CONTACT, SCHEMA, create_file, json_error, name, sha256, sync};
use super::frames::{check_size, npy_header};
use super::meta::{Meta, MetaFile, check_meta};
use super::provenance::Recording;
use crate::dataset::shard::Fragment;
use crate::dataset::touch::Touch;
use crate::error::{Error, Result};
use crate::file::output_lock::{lock_file, with_ending};
use crate::frame::Frame;
use crate::frame::picture;

/// Writes a dataset frame by frame.
///
/// Everything goes to `OUT.partial` and takes its name in [`finish`](Self::finish), so a crash leaves
/// no half dataset under the final name.
#[derive(Debug)]
pub struct DatasetWriter {
    out: PathBuf,
    partial: PathBuf,
    meta: Meta,
    fragment: Option<Fragment>,
    frames: BufWriter<File>,
    index: BufWriter<File>,
    n_frames: usize,
    /// The checksum of the frames so far, for a number of frames: the header states it.
    hash: Option<(usize, Sha256)>,
}

impl DatasetWriter {
    /// Starts a dataset at `out`, which must not exist. What a crashed run left in `OUT.partial` is written over.
    ///
    /// # Errors
    /// A name in use, meta data that make no sense, or another run that writes the same dataset.
    pub fn create(out: &Path, meta: Meta, no_contact: &Frame) -> Result<Self> {
        check_is_new(out)?;
        check_meta(&meta, out)?;
        check_size(no_contact, &meta, NO_CONTACT)?;
        let partial = partial_path(out)?;
        fs::create_dir_all(&partial).map_err(Error::io(&partial))?;
        check_is_ours(&partial)?;
        let mut frames = BufWriter::with_capacity(1 << 20, lock_file(&partial.join(FRAMES), out)?);
        // The run that held the lock until now may have finished: its frames must stay.
        check_is_new(out)?;
        frames.get_ref().set_len(0).map_err(Error::io(partial.join(FRAMES)))?;
        picture::write_png(&partial.join(NO_CONTACT), no_contact)?;
        frames.write_all(&npy_header(0, &meta)).map_err(Error::io(partial.join(FRAMES)))?;
        let index = create_file(&partial.join(INDEX))?;
        Ok(Self { out: out.to_path_buf(), partial, meta, fragment: None, frames, index, n_frames: 0, hash: None })
    }

    /// The same writer of one shard of a dataset; `None` for a whole one.
    pub fn fragment(mut self, fragment: Option<Fragment>) -> Self {
        self.fragment = fragment;
        self
    }

    /// The same writer, given the number of frames before the first one: it then computes the checksum as it
    /// writes and need not read the frames again. Another number may come all the same.
    pub fn expecting(mut self, n_frames: usize) -> Self {
        self.hash = Some((n_frames, Sha256::new_with_prefix(npy_header(n_frames, &self.meta))));
        self
    }

    /// States how a recording became this dataset; before [`finish`](Self::finish), once all of it was read.
    pub fn set_recording(&mut self, recording: Recording) {
        self.meta.recording = Some(recording);
    }

    /// Appends a frame, of the size that the meta data states, and what is known of it.
    pub fn push(&mut self, frame: &Frame, touch: &Touch) -> Result<()> {
        check_size(frame, &self.meta, &format!("frame {}", self.n_frames))?;
        touch.check_names().map_err(|error| error.within(format!("frame {}", self.n_frames)))?;
        self.frames.write_all(frame.rgb()).map_err(Error::io(self.partial.join(FRAMES)))?;
        if let Some((_, hash)) = &mut self.hash {
            hash.update(frame.rgb());
        }
        let path = self.partial.join(INDEX);
        let line = serde_json::to_string(touch).map_err(json_error(&path, "a touch"))?;
        writeln!(self.index, "{line}").map_err(Error::io(&path))?;
        self.n_frames += 1;
        Ok(())
    }

    /// Writes the count and the checksums, and gives the dataset its name. Fails where it holds no frame.
    pub fn finish(mut self) -> Result<()> {
        if self.n_frames == 0 {
            return Err(Error::invalid(self.out.display().to_string(), "at least one frame", "none"));
        }
        let (frames, index, meta) = (self.partial.join(FRAMES), self.partial.join(INDEX), self.partial.join(META));
        let header = npy_header(self.n_frames, &self.meta);
        self.frames.seek(SeekFrom::Start(0)).map_err(Error::io(&frames))?;
        self.frames.write_all(&header).map_err(Error::io(&frames))?;
        sync(&mut self.frames, &frames)?;
        sync(&mut self.index, &index)?;
        let frames_sha256 = match self.hash {
            Some((n_frames, hash)) if n_frames == self.n_frames => format!("{:x}", hash.finalize()),
            _ => sha256(&frames)?,
        };
        let content = MetaFile {
            schema: SCHEMA.to_owned(),
            n_frames: self.n_frames,
            frames_sha256,
            index_sha256: sha256(&index)?,
            fragment: self.fragment,
            meta: self.meta,
        };
        let json = serde_json::to_vec_pretty(&content).map_err(json_error(&meta, "meta data"))?;
        let mut file = create_file(&meta)?;
        file.write_all(&json).map_err(Error::io(&meta))?;
        sync(&mut file, &meta)?;
        // The lock on the frames is held until the dataset has its name.
        fs::rename(&self.partial, &self.out).map_err(Error::io(&self.out))
    }
}

pub(super) fn partial_path(out: &Path) -> Result<PathBuf> {
    let Some(file_name) = out.file_name() else {
        return Err(Error::invalid(out.display().to_string(), "the name of a new folder", "none"));
    };
    Ok(out.with_file_name(with_ending(Path::new(file_name), ".partial")))
}

/// The folder must not be there: nothing is ever written over.
fn check_is_new(out: &Path) -> Result<()> {
    match fs::symlink_metadata(out) {
        Ok(_) => Err(Error::invalid(name(out), "a name not in use", "an existing file or folder")),
        Err(_) => Ok(()),
    }
}

/// What a crashed run left is written over; a folder with anything else in it is not ours.
fn check_is_ours(partial: &Path) -> Result<()> {
    for entry in fs::read_dir(partial).map_err(Error::io(partial))? {
        let file = entry.map_err(Error::io(partial))?.file_name();
        if !FILES.iter().any(|ours| file == *ours) {
            let got = file.to_string_lossy();
            return Err(Error::invalid(name(partial), "nothing but the files of an unfinished dataset", got));
        }
    }
    Ok(())
}
