//! A dataset on disk: touches of one sensor, with its frame at rest.
//!
//! A folder of four files. `frames.npy` holds the frames, u8 `[n, height, width, 3]`, memory-mapped
//! when read; `index.jsonl` one [`Touch`] a line in the same order; `no_contact.png` the sensor at
//! rest; `meta.json` a [`Meta`] with the schema, the number of frames and the checksums of the other
//! two. `numpy.load` reads the frames as they are.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::{BufRead, BufReader, BufWriter, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use memmap2::Mmap;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};
use crate::frame::{Background, Frame, Preprocessing};
use crate::grid::PoseGrid;
use crate::lamps::Lamps;
use crate::picture;
pub use crate::recording::provenance::{Channels, Mirror, Recording};
use crate::se2::Se2;
use crate::shard::Fragment;
use crate::touch::{Side, Touch};

/// Name and version of the layout on disk.
pub const SCHEMA: &str = "tactile-filter/dataset/1";

const FRAMES: &str = "frames.npy";
const INDEX: &str = "index.jsonl";
const NO_CONTACT: &str = "no_contact.png";
const META: &str = "meta.json";

/// The files of a dataset.
pub const FILES: [&str; 4] = [FRAMES, INDEX, NO_CONTACT, META];

/// Length of the header of `frames.npy`, bytes: fixed, so that the count can be filled in last, and a
/// multiple of 64 as the npy format asks.
const HEADER_LEN: usize = 128;

/// What holds for a whole dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Name of the dataset, for people.
    pub name: String,
    /// Width and height of its frames, pixels.
    pub frame_px: [usize; 2],
    /// Size of a pixel along x and along y on the gel, mm.
    pub mm_per_px: [f64; 2],
    /// The grid on which each part was touched, where there is one.
    pub reach: Option<PoseGrid>,
    /// Names of the parts that training must not see.
    pub held_out: Vec<String>,
    /// The scene that was simulated.
    pub scene: Option<serde_json::Value>,
    /// The seed it was simulated with.
    pub seed: Option<u64>,
    /// Where the frames come from, for people.
    pub source: String,
    /// How a recording became this dataset; `None` for simulated touches.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recording: Option<Recording>,
    /// The sensor's lamps where they are known and are not those that the network knows ([`Lamps::default`]); the frames
    /// show them as they are.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lamps: Option<Lamps>,
    /// The pose of the hole board in the peg board's frame, as it was estimated or given. [`Dataset::open`] gives the poses
    /// of pegs in the hole board's frame, so that a hole and its peg touched at one place have one pose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peg_from_hole: Option<Se2>,
}

/// `meta.json` as it is on disk.
#[derive(Serialize, Deserialize)]
pub(crate) struct MetaFile {
    schema: String,
    pub(crate) n_frames: usize,
    frames_sha256: String,
    index_sha256: String,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) fragment: Option<Fragment>,
    #[serde(flatten)]
    pub(crate) meta: Meta,
}

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
        let mut frames = lock(&partial.join(FRAMES))?;
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

/// A dataset opened for reading; its frames stay on disk until they are looked at.
#[derive(Debug)]
pub struct Dataset {
    meta: Meta,
    fragment: Option<Fragment>,
    frames_sha256: String,
    index_sha256: String,
    frames: Mmap,
    touches: Vec<Touch>,
    no_contact: Frame,
}

impl Dataset {
    /// Opens a dataset, checking its schema, sizes and checksums: it is read through once.
    pub fn open(path: &Path) -> Result<Self> {
        let content = read_meta(path)?;
        let frames = map_frames(&path.join(FRAMES), &content)?;
        check_sha256(&path.join(INDEX), &content.index_sha256)?;
        let mut touches = read_index(&path.join(INDEX))?;
        if let Some(peg_from_hole) = content.meta.peg_from_hole {
            let hole_from_peg = peg_from_hole.inverse();
            let pegs = touches.iter_mut().filter(|touch| touch.side == Some(Side::Peg));
            pegs.filter_map(|touch| touch.part_from_sensor.as_mut()).for_each(|pose| *pose = hole_from_peg * *pose);
        }
        if touches.len() != content.n_frames {
            let got = format!("{} lines", touches.len());
            return Err(Error::invalid(name(&path.join(INDEX)), format!("{} lines", content.n_frames), got));
        }
        let no_contact = read_no_contact(path, &content.meta)?;
        let MetaFile { meta, fragment, frames_sha256, index_sha256, .. } = content;
        Ok(Self { meta, fragment, frames_sha256, index_sha256, frames, touches, no_contact })
    }

    /// What holds for the whole dataset.
    pub fn meta(&self) -> &Meta {
        &self.meta
    }

    /// Which shard it is of which dataset; `None` for a whole one.
    pub fn fragment(&self) -> Option<&Fragment> {
        self.fragment.as_ref()
    }

    /// SHA-256 of the frames, 64 hex digits: the identity of the dataset.
    pub fn frames_sha256(&self) -> &str {
        &self.frames_sha256
    }

    /// SHA-256 of all that it holds, 64 hex digits: frames, index, meta data and the sensor at rest. What is made of two
    /// datasets with the same one is the same.
    ///
    /// # Errors
    /// Meta data that JSON cannot hold: none that was read from a file.
    pub fn sha256(&self) -> Result<String> {
        let meta = serde_json::to_vec(&self.meta).map_err(json_error(Path::new(META), "meta data"))?;
        let mut hash = Sha256::new_with_prefix(&self.frames_sha256);
        hash.update(&self.index_sha256);
        hash.update(meta);
        hash.update(self.no_contact.rgb());
        Ok(format!("{:x}", hash.finalize()))
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.touches.len()
    }

    /// Whether there is no frame.
    pub fn is_empty(&self) -> bool {
        self.touches.is_empty()
    }

    /// The RGB bytes of frame `i`, rows from the top, straight from the mapped file. `i` is below [`len`](Self::len).
    pub fn frame_bytes(&self, i: usize) -> &[u8] {
        let frame_len = frame_len(&self.meta);
        &self.frames[HEADER_LEN + i * frame_len..HEADER_LEN + (i + 1) * frame_len]
    }

    /// A copy of frame `i`. `i` is below [`len`](Self::len).
    pub fn frame(&self, i: usize) -> Frame {
        let [width, height] = self.meta.frame_px;
        Frame::from_parts(width, height, self.frame_bytes(i).to_vec())
    }

    /// What is known of frame `i`. `i` is below [`len`](Self::len).
    pub fn touch(&self, i: usize) -> &Touch {
        &self.touches[i]
    }

    /// What is known of every frame, in order.
    pub fn touches(&self) -> &[Touch] {
        &self.touches
    }

    /// The sensor at rest.
    pub fn no_contact(&self) -> &Frame {
        &self.no_contact
    }

    /// The sensor at rest, prepared: its lamps, where they are known, are made up for.
    ///
    /// # Errors
    /// A frame that shows nothing, or lamps that do not show slopes in all directions.
    pub fn background(&self, preprocessing: &Preprocessing) -> Result<Background> {
        Background::new(&self.no_contact, preprocessing)?.lit_by(&self.meta.lamps)
    }
}

/// Notes the pose of the hole board in the peg board's frame with a dataset, whole or not at all; frames and index stay as
/// they are.
///
/// # Errors
/// No dataset, or a folder that cannot be written to.
pub fn set_peg_from_hole(dataset: &Path, peg_from_hole: Se2) -> Result<()> {
    let mut content = read_meta(dataset)?;
    content.meta.peg_from_hole = Some(peg_from_hole);
    let (path, new) = (dataset.join(META), dataset.join("meta.json.new"));
    let json = serde_json::to_vec_pretty(&content).map_err(json_error(&path, "meta data"))?;
    let mut file = create_file(&new)?;
    file.write_all(&json).map_err(Error::io(&new))?;
    sync(&mut file, &new)?;
    fs::rename(&new, &path).map_err(Error::io(&path))
}

/// What a dataset says of itself, without a look at its frames.
pub(crate) fn read_meta(dataset: &Path) -> Result<MetaFile> {
    let path = &dataset.join(META);
    let text = fs::read_to_string(path).map_err(Error::io(path))?;
    let json: serde_json::Value = serde_json::from_str(&text).map_err(json_error(path, "JSON"))?;
    // The schema comes first: another version may well have other fields.
    let schema = json.get("schema").and_then(|s| s.as_str()).unwrap_or("none");
    if schema != SCHEMA {
        return Err(Error::invalid(format!("{}: schema", path.display()), SCHEMA, schema));
    }
    let content: MetaFile = serde_json::from_value(json).map_err(json_error(path, "a dataset's meta data"))?;
    check_meta(&content.meta, path)?;
    Ok(content)
}

/// The sensor at rest of a dataset.
pub(crate) fn read_no_contact(dataset: &Path, meta: &Meta) -> Result<Frame> {
    let path = dataset.join(NO_CONTACT);
    let frame = picture::read(&path)?;
    check_size(&frame, meta, &name(&path)).map(|()| frame)
}

fn map_frames(path: &Path, content: &MetaFile) -> Result<Mmap> {
    let file = File::open(path).map_err(Error::io(path))?;
    let got = file.metadata().map_err(Error::io(path))?.len();
    let mut header = vec![0; HEADER_LEN.min(usize::try_from(got).unwrap_or(HEADER_LEN))];
    std::io::Read::read_exact(&mut &file, &mut header).map_err(Error::io(path))?;
    let expected_header = npy_header(content.n_frames, &content.meta);
    if header != expected_header {
        let shape = |bytes: &[u8]| String::from_utf8_lossy(bytes.get(10..).unwrap_or_default()).trim().to_owned();
        return Err(Error::invalid(name(path), shape(&expected_header), shape(&header)));
    }
    let expected = content
        .n_frames
        .checked_mul(frame_len(&content.meta))
        .and_then(|body| body.checked_add(HEADER_LEN))
        .map(|len| len as u64);
    if Some(got) != expected {
        let expected = expected.map_or("a size that fits in memory".to_owned(), |len| format!("{len} bytes"));
        return Err(Error::invalid(name(path), expected, format!("{got} bytes")));
    }
    check_sha256(path, &content.frames_sha256)?;
    // SAFETY: the map is read-only, and u8 has no invalid value. What the type system cannot promise is
    // that no other program shortens or rewrites the file meanwhile; datasets take their name only when
    // they are complete and are not written again.
    #[expect(unsafe_code, reason = "a file can only be mapped so")]
    let mapped = unsafe { Mmap::map(&file) };
    mapped.map_err(Error::io(path))
}

fn read_index(path: &Path) -> Result<Vec<Touch>> {
    let lines = BufReader::new(File::open(path).map_err(Error::io(path))?).lines();
    lines
        .enumerate()
        .map(|(row, line)| {
            let line = line.map_err(Error::io(path))?;
            serde_json::from_str(&line)
                .map_err(|e| Error::invalid(format!("{} line {}", path.display(), row + 1), "a touch", e.to_string()))
        })
        .collect()
}

/// Refuses meta data that make no sense; `path` names the dataset in errors.
pub(crate) fn check_meta(meta: &Meta, path: &Path) -> Result<()> {
    if !meta.mm_per_px.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
        let got = format!("{:?}", meta.mm_per_px);
        return Err(Error::invalid(format!("{}: mm_per_px", path.display()), "positive sizes", got));
    }
    // Bounds the arithmetic on sizes; no camera comes near.
    if !meta.frame_px.iter().all(|px| (1..=1 << 14).contains(px)) {
        let got = format!("{:?}", meta.frame_px);
        return Err(Error::invalid(format!("{}: frame_px", path.display()), "1 to 16384 pixels each way", got));
    }
    meta.reach.as_ref().map_or(Ok(()), PoseGrid::validate)
}

fn check_size(frame: &Frame, meta: &Meta, what: &str) -> Result<()> {
    let got = [frame.width_px(), frame.height_px()];
    if got == meta.frame_px {
        return Ok(());
    }
    let show = |[width, height]: [usize; 2]| format!("{width}x{height} pixels");
    Err(Error::invalid(what, show(meta.frame_px), show(got)))
}

fn check_sha256(path: &Path, expected: &str) -> Result<()> {
    let got = sha256(path)?;
    if got == expected {
        return Ok(());
    }
    Err(Error::invalid(name(path), format!("SHA-256 {expected}"), got))
}

/// SHA-256 of a file in hexadecimal, read in pieces: hashing the map would count the whole file as
/// this program's memory.
fn sha256(path: &Path) -> Result<String> {
    let mut file = BufReader::with_capacity(1 << 20, File::open(path).map_err(Error::io(path))?);
    let mut hash = Sha256::new();
    std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
    Ok(format!("{:x}", hash.finalize()))
}

/// Bytes of one frame.
fn frame_len(meta: &Meta) -> usize {
    3 * meta.frame_px[0] * meta.frame_px[1]
}

/// The npy header, version 1.0: magic, version, u16 length of the rest, the shape as Python writes it,
/// spaces, a newline.
fn npy_header(n_frames: usize, meta: &Meta) -> Vec<u8> {
    let [width, height] = meta.frame_px;
    let shape = format!("{{'descr': '|u1', 'fortran_order': False, 'shape': ({n_frames}, {height}, {width}, 3), }}");
    let mut header = b"\x93NUMPY\x01\x00".to_vec();
    header.extend((HEADER_LEN as u16 - 10).to_le_bytes());
    header.extend(shape.as_bytes());
    header.resize(HEADER_LEN - 1, b' ');
    header.push(b'\n');
    header
}

fn partial_path(out: &Path) -> Result<PathBuf> {
    let Some(file_name) = out.file_name() else {
        return Err(Error::invalid(out.display().to_string(), "the name of a new folder", "none"));
    };
    let mut file_name = file_name.to_owned();
    file_name.push(".partial");
    Ok(out.with_file_name(file_name))
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

/// Opens a file for writing, its content kept, and holds its lock until it is closed: two runs never write one
/// dataset. On a file system without locks this is not checked.
fn lock(path: &Path) -> Result<BufWriter<File>> {
    let file = OpenOptions::new().create(true).truncate(false).write(true).open(path).map_err(Error::io(path))?;
    match file.try_lock() {
        Err(TryLockError::WouldBlock) => {
            Err(Error::invalid(name(path), "a dataset that no other run is writing", "another run at work"))
        }
        Err(TryLockError::Error(error)) if error.kind() != ErrorKind::Unsupported => {
            Err(Error::Io { path: path.to_path_buf(), source: error })
        }
        _ => Ok(BufWriter::with_capacity(1 << 20, file)),
    }
}

fn create_file(path: &Path) -> Result<BufWriter<File>> {
    Ok(BufWriter::with_capacity(1 << 20, File::create(path).map_err(Error::io(path))?))
}

fn sync(file: &mut BufWriter<File>, path: &Path) -> Result<()> {
    file.flush().and_then(|()| file.get_ref().sync_all()).map_err(Error::io(path))
}

fn name(path: &Path) -> String {
    path.display().to_string()
}

fn json_error(path: &Path, expected: &str) -> impl FnOnce(serde_json::Error) -> Error {
    move |error| Error::invalid(name(path), expected, error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn meta() -> Meta {
        Meta {
            name: "three".into(),
            frame_px: [4, 2],
            mm_per_px: [4.65, 7.15],
            reach: Some(PoseGrid::SMALL),
            held_out: vec!["B".into()],
            scene: Some(serde_json::json!({"parts": 3})),
            seed: Some(u64::MAX),
            source: "a test".into(),
            recording: None,
            lamps: None,
            peg_from_hole: None,
        }
    }

    fn frame(value: u8) -> Frame {
        Frame::new(4, 2, (0..24).map(|i| i * value).collect()).unwrap()
    }

    fn touch(i: u8) -> Touch {
        Touch {
            part: Some("B".into()),
            side: (i > 0).then_some(Side::Hole),
            part_from_sensor: Some(Se2::from_degrees(f64::from(i) / 3.0, -4.0, 30.0)),
            ..Touch::default()
        }
    }

    fn write(out: &Path) {
        let mut writer = DatasetWriter::create(out, meta(), &frame(9)).unwrap();
        for i in 0..3 {
            writer.push(&frame(i + 1), &touch(i)).unwrap();
        }
        writer.finish().unwrap();
    }

    /// The error of opening a dataset after `spoil`, checked to be one line.
    fn refusal(spoil: impl FnOnce(&Path)) -> String {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("data");
        write(&out);
        spoil(&out);
        let message = Dataset::open(&out).unwrap_err().to_string();
        assert!(!message.contains('\n'), "{message}");
        message
    }

    fn edit(path: PathBuf, change: impl FnOnce(&mut Vec<u8>)) {
        let mut bytes = fs::read(&path).unwrap();
        change(&mut bytes);
        fs::write(&path, bytes).unwrap();
    }

    fn replace(path: PathBuf, from: &str, to: &str) {
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from));
        fs::write(&path, text.replace(from, to)).unwrap();
    }

    #[test]
    fn a_dataset_comes_back_as_it_was_written() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("data");
        write(&out);
        let dataset = Dataset::open(&out).unwrap();
        assert_eq!((dataset.meta(), dataset.len(), dataset.no_contact()), (&meta(), 3, &frame(9)));
        for i in 0..3 {
            assert_eq!(dataset.frame(i.into()), frame(i + 1));
            assert_eq!(dataset.touch(i.into()), &touch(i));
        }
        assert!(!partial_path(&out).unwrap().exists());
    }

    #[test]
    fn a_dataset_is_told_from_one_that_differs_in_anything() {
        let folder = tempfile::tempdir().unwrap();
        let identity = |name: &str, spoil: &dyn Fn(&Path)| {
            let out = folder.path().join(name);
            write(&out);
            spoil(&out);
            Dataset::open(&out).unwrap().sha256().unwrap()
        };
        let first = identity("first", &|_| ());
        assert_eq!(identity("again", &|_| ()), first);
        assert_ne!(identity("meta", &|out| replace(out.join(META), "a test", "a lab")), first);
        let at_rest = |out: &Path| picture::write_png(&out.join(NO_CONTACT), &frame(8)).unwrap();
        assert_ne!(identity("at rest", &at_rest), first);
        assert_ne!(identity("mounted", &|out| set_peg_from_hole(out, Se2::new(0.1, 0.0, 0.0)).unwrap()), first);
    }

    /// Opening checks the checksum, whether it was computed along the way or not.
    #[test]
    fn the_number_of_frames_may_be_told_and_may_be_wrong() {
        for told in [3, 5] {
            let folder = tempfile::tempdir().unwrap();
            let out = folder.path().join("data");
            let mut writer = DatasetWriter::create(&out, meta(), &frame(9)).unwrap().expecting(told);
            (0..3).for_each(|i| writer.push(&frame(i + 1), &touch(i)).unwrap());
            writer.finish().unwrap();
            assert_eq!(Dataset::open(&out).unwrap().len(), 3);
        }
    }

    #[test]
    fn frames_begin_as_the_npy_format_says() {
        let header = npy_header(46_000, &Meta { frame_px: [320, 240], ..meta() });
        // Numpy's format 1.0: the u16 after magic and version counts the rest, aligned to 64 bytes.
        assert_eq!(&header[..8], b"\x93NUMPY\x01\x00");
        assert_eq!(10 + usize::from(u16::from_le_bytes([header[8], header[9]])), header.len());
        assert_eq!((header.len() % 64, header.last()), (0, Some(&b'\n')));
        assert!(std::str::from_utf8(&header[10..]).unwrap().contains("(46000, 240, 320, 3)"));
        assert_eq!(npy_header(usize::MAX, &Meta { frame_px: [16384; 2], ..meta() }).len(), HEADER_LEN);
    }

    #[test]
    fn a_crash_leaves_nothing_under_the_final_name_and_is_cleared_by_the_next_run() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("data");
        let mut writer = DatasetWriter::create(&out, meta(), &frame(9)).unwrap();
        writer.push(&frame(1), &touch(0)).unwrap();
        drop(writer);
        assert!(!out.exists());
        write(&out);
        assert_eq!(Dataset::open(&out).unwrap().len(), 3);
    }

    #[test]
    fn of_two_runs_on_one_name_the_second_is_refused_and_the_first_goes_on() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("data");
        let mut first = DatasetWriter::create(&out, meta(), &frame(9)).unwrap();
        first.push(&frame(1), &touch(0)).unwrap();
        let message = DatasetWriter::create(&out, meta(), &frame(9)).unwrap_err().to_string();
        assert!(message.contains("another run at work"), "{message}");
        first.push(&frame(2), &touch(1)).unwrap();
        first.finish().unwrap();
        assert_eq!(Dataset::open(&out).unwrap().len(), 2);
    }

    #[test]
    fn an_existing_dataset_is_never_written_over() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("data");
        write(&out);
        let message = DatasetWriter::create(&out, meta(), &frame(9)).unwrap_err().to_string();
        assert!(message.contains("existing"), "{message}");
        assert_eq!(Dataset::open(&out).unwrap().len(), 3);
    }

    #[test]
    fn strangers_files_in_the_partial_folder_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let partial = folder.path().join("data.partial");
        fs::create_dir(&partial).unwrap();
        fs::write(partial.join("thesis.txt"), "mine").unwrap();
        assert!(DatasetWriter::create(&folder.path().join("data"), meta(), &frame(9)).is_err());
        assert!(partial.join("thesis.txt").exists());
    }

    #[test]
    fn no_frames_are_no_dataset() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("data");
        let writer = DatasetWriter::create(&out, meta(), &frame(9)).unwrap();
        assert!(writer.finish().unwrap_err().to_string().contains("at least one frame"));
        assert!(!out.exists());
    }

    #[test]
    fn a_frame_of_another_size_is_refused_when_written() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = DatasetWriter::create(&folder.path().join("data"), meta(), &frame(9)).unwrap();
        let other = Frame::new(2, 4, vec![7; 24]).unwrap();
        assert_eq!(
            writer.push(&other, &touch(0)).unwrap_err().to_string(),
            "frame 0: expected 4x2 pixels, got 2x4 pixels"
        );
    }

    #[test]
    fn frames_cut_short_are_refused() {
        let message = refusal(|out| edit(out.join(FRAMES), |bytes| bytes.truncate(180)));
        assert!(message.contains("frames.npy: expected 200 bytes, got 180 bytes"), "{message}");
        let message = refusal(|out| edit(out.join(FRAMES), |bytes| bytes.truncate(5)));
        assert!(message.contains("frames.npy"), "{message}");
    }

    #[test]
    fn a_changed_byte_is_noticed() {
        let message = refusal(|out| edit(out.join(FRAMES), |bytes| bytes[150] ^= 1));
        assert!(message.contains("frames.npy: expected SHA-256"), "{message}");
        let message = refusal(|out| replace(out.join(INDEX), "hole", "peg"));
        assert!(message.contains("index.jsonl: expected SHA-256"), "{message}");
    }

    #[test]
    fn frames_of_another_size_than_declared_are_refused() {
        let message = refusal(|out| {
            edit(out.join(FRAMES), |bytes| {
                bytes[..HEADER_LEN].copy_from_slice(&npy_header(6, &Meta { frame_px: [2, 2], ..meta() }))
            })
        });
        assert!(message.contains("(3, 2, 4, 3)") && message.contains("(6, 2, 2, 3)"), "{message}");
    }

    #[test]
    fn another_schema_is_refused() {
        let message = refusal(|out| replace(out.join(META), "dataset/1", "dataset/2"));
        assert!(message.contains("expected tactile-filter/dataset/1, got tactile-filter/dataset/2"), "{message}");
    }

    #[test]
    fn a_missing_or_odd_no_contact_frame_is_refused() {
        let message = refusal(|out| fs::remove_file(out.join(NO_CONTACT)).unwrap());
        assert!(message.contains("no_contact.png"), "{message}");
        let other = Frame::new(2, 4, vec![7; 24]).unwrap();
        let message = refusal(|out| picture::write_png(&out.join(NO_CONTACT), &other).unwrap());
        assert!(message.contains("expected 4x2 pixels, got 2x4 pixels"), "{message}");
    }
}
