use std::fs;
use std::path::{Path, PathBuf};

use sha2::Digest;

use super::files::{FRAMES, INDEX, META, NO_CONTACT, sha256};
use super::frames::{HEADER_LEN, npy_header};
use super::writer::partial_path;
use super::*;
use crate::dataset::touch::{Side, Touch};
use crate::frame::Frame;
use crate::frame::picture;
use crate::pose::grid::PoseGrid;
use crate::pose::se2::Se2;

fn meta() -> Meta {
    Meta {
        reach: Some(PoseGrid::SMALL),
        held_out: vec!["B".into()],
        scene: Some(serde_json::json!({"parts": 3})),
        seed: Some(u64::MAX),
        ..Meta::new("three", "a test", [4, 2], [4.65, 7.15])
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
    assert_eq!(writer.push(&other, &touch(0)).unwrap_err().to_string(), "frame 0: expected 4x2 pixels, got 2x4 pixels");
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

#[test]
fn names_that_a_terminal_would_obey_are_refused_where_they_are_written_and_read() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    let mut writer = DatasetWriter::create(&out, meta(), &frame(9)).unwrap();
    let odd = Touch { part: Some("a\u{1b}[2J".into()), ..touch(0) };
    let error = writer.push(&frame(1), &odd).unwrap_err().to_string();
    assert_eq!(error, r#"frame 0: part: expected a name without control characters, got "a\u{1b}[2J""#);
    drop(writer);
    let named = Meta { name: "a\nb".into(), ..meta() };
    assert!(DatasetWriter::create(&out, named, &frame(9)).unwrap_err().to_string().contains("name, held_out"));
    // A forged index, its checksum right.
    write(&out);
    let (index, about) = (out.join(INDEX), out.join(META));
    let text = fs::read_to_string(&index).unwrap();
    let forged = text.replacen("{", r#"{"episode":"e\u009b","#, 1);
    fs::write(&index, &forged).unwrap();
    let json = fs::read_to_string(&about).unwrap();
    fs::write(&about, json.replace(&format!("{:x}", sha2::Sha256::digest(&text)), &sha256(&index).unwrap())).unwrap();
    let error = Dataset::open(&out).unwrap_err().to_string();
    assert!(error.contains("index.jsonl line 1: episode: expected a name without control characters"), "{error}");
}

#[test]
fn an_index_longer_than_any_is_refused_before_it_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("data");
    write(&out);
    let index = fs::OpenOptions::new().write(true).open(out.join(INDEX)).unwrap();
    index.set_len(6 << 30).unwrap();
    let error = Dataset::open(&out).unwrap_err().to_string();
    assert!(error.contains("index.jsonl: expected an index of at most"), "{error}");
    assert!(error.ends_with("got 6442450944 bytes"), "{error}");
}
