//! Tests of [`super`]: whole files to datasets, compared with the import of a folder.

use std::fs;
use std::path::PathBuf;

use parquet::basic::{Compression, GzipLevel};

use super::test_table::{Cells, png, table};
use super::*;
use crate::dataset::store::Dataset;
use crate::error::Result;
use crate::recording::folder::{self, Import, Imported, NoContact};

const N: usize = 7;

/// What the columns hold of as many touches; the same as [`CSV`].
fn columns() -> Vec<Cells> {
    let (a, hole) = (Some("A"), Some("hole"));
    vec![
        Cells::Pictures((0..N).map(|i| Some(png(40 + 10 * i as u8))).collect()),
        Cells::Text("part", vec![a, a, a, None, Some("B"), Some(""), a]),
        Cells::Text("side", vec![hole, hole, hole, None, Some("peg"), None, Some("peg")]),
        Cells::Floats("x_mm", vec![Some(1.5), Some(2.5), Some(3.5), None, Some(-1.0), None, Some(0.0)]),
        Cells::Doubles("y_mm", vec![Some(0.1), Some(0.2), Some(-0.3), None, Some(4.0), None, Some(8.0)]),
        Cells::Ints("theta_deg", vec![Some(0), Some(-90), Some(30), None, Some(45), None, Some(1)]),
        Cells::Text("pair", vec![Some("p"), None, None, None, None, None, Some("p")]),
        Cells::Longs("episode", vec![None, Some(3), Some(3), None, None, None, None]),
        Cells::Doubles("time_s", vec![None, Some(1_700_000_000.125), Some(1_700_000_000.25), None, None, None, None]),
    ]
}

const CSV: &str = "file,part,side,x_mm,y_mm,theta_deg,pair,episode,time_s\n\
                   0.png,A,hole,1.5,0.1,0,p,,\n\
                   1.png,A,hole,2.5,0.2,-90,,3,1700000000.125\n\
                   2.png,A,hole,3.5,-0.3,30,,3,1700000000.25\n\
                   3.png,,,,,,,,\n\
                   4.png,B,peg,-1,4,45,,,\n\
                   5.png,,,,,,,,\n\
                   6.png,A,peg,0,8,1,p,,\n";

struct Folder(tempfile::TempDir);

impl Folder {
    fn of(files: &[(&str, Vec<u8>)]) -> Self {
        let folder = Self(tempfile::tempdir().unwrap());
        for (name, bytes) in files {
            fs::write(folder.at(name), bytes).unwrap();
        }
        folder
    }

    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn import(&self, source: &Path) -> Result<(Dataset, Imported)> {
        let how = Import { no_contact: NoContact::First(1), ..Import::default() };
        let out = self.at("out");
        let imported = match is_parquet(source) {
            true => import(source, &how, &out, &|_, _| {})?,
            false => folder::import(source, &how, &out, &|_, _| {})?,
        };
        let dataset = Dataset::open(&out)?;
        fs::remove_dir_all(&out).unwrap();
        Ok((dataset, imported))
    }

    fn refusal(&self) -> String {
        let message = self.import(self.0.path()).unwrap_err().to_string();
        assert!(!message.contains('\n') && !self.at("out").exists(), "{message}");
        message
    }
}

/// `columns` with one of them in place of the column of its name.
fn with(column: Cells) -> Vec<Cells> {
    let name = |cells: &Cells| match cells {
        Cells::Pictures(_) => "image",
        Cells::Text(name, _) | Cells::Floats(name, _) | Cells::Doubles(name, _) => name,
        Cells::Ints(name, _) | Cells::Longs(name, _) | Cells::Times(name, _) => name,
    };
    let mut columns = columns();
    columns.retain(|old| name(old) != name(&column));
    columns.push(column);
    columns
}

#[test]
fn every_codec_and_group_gives_what_a_folder_with_an_index_gives() {
    let mut files: Vec<(String, Vec<u8>)> = (0..N).map(|i| (format!("{i}.png"), png(40 + 10 * i as u8))).collect();
    files.push(("index.csv".into(), CSV.into()));
    let files: Vec<(&str, Vec<u8>)> = files.iter().map(|(name, bytes)| (name.as_str(), bytes.clone())).collect();
    let folder = Folder::of(&files);
    let (expected, _) = folder.import(folder.0.path()).unwrap();
    let gzip = Compression::GZIP(GzipLevel::default());
    for codec in [Compression::UNCOMPRESSED, Compression::SNAPPY, gzip, Compression::LZ4, Compression::LZ4_RAW] {
        for group_len in [1, 3, N] {
            let folder = Folder::of(&[("touches.parquet", table(&columns(), codec, group_len))]);
            for source in [folder.0.path(), &folder.at("touches.parquet")] {
                let (dataset, imported) = folder.import(source).unwrap();
                assert_eq!(dataset.frames_sha256(), expected.frames_sha256(), "{codec} {group_len}");
                assert_eq!(dataset.touches(), expected.touches(), "{codec} {group_len}");
                assert_eq!(dataset.no_contact(), expected.no_contact());
                assert_eq!((imported.n_frames, imported.warnings), (N, Vec::new()));
            }
        }
    }
}

#[test]
fn shards_are_read_in_order_and_must_all_be_there() {
    let all = table(&columns(), Compression::SNAPPY, 4);
    let shard = |i: usize| (format!("train-0000{i}-of-00003.parquet"), all.clone());
    let none = columns().into_iter().map(|column| match column {
        Cells::Text("pair", cells) => Cells::Text("pair", vec![None; cells.len()]),
        other => other,
    });
    let unpaired = table(&none.collect::<Vec<_>>(), Compression::SNAPPY, 4);
    let folder = Folder::of(&[
        (&shard(2).0, unpaired.clone()),
        (&shard(0).0, all.clone()),
        (&shard(1).0, unpaired.clone()),
        ("README.md", Vec::new()),
        ("._train-00000-of-00003.parquet", Vec::new()),
    ]);
    let files = shards::find(folder.0.path()).unwrap();
    assert_eq!(files, [0, 1, 2].map(|i| folder.at(&shard(i).0)));
    // Times of an episode may be equal from shard to shard, but do not go back.
    let message = folder.refusal();
    let row = "train-00001-of-00003.parquet row 2: episode 3: time_s: expected 1700000000.25 s or later, after ";
    assert!(message.contains(row) && message.contains("train-00000-of-00003.parquet row 3, got"), "{message}");
    fs::remove_file(folder.at(&shard(1).0)).unwrap();
    assert!(folder.refusal().contains("expected 3 shards of train, got none with the number 1"));
    fs::write(folder.at("test-00000-of-00001.parquet"), &all).unwrap();
    assert!(folder.refusal().contains("the shards of one set, got test of 1, train of 3"));
}

#[test]
fn shards_make_one_dataset_with_the_checksum_of_all_files() {
    let part = |value: u8| {
        let pictures = Cells::Pictures((0..40).map(|i| Some(png(value + i))).collect());
        table(&[pictures, Cells::Text("label", vec![None; 40])], Compression::SNAPPY, 33)
    };
    let (a, b) = (part(20), part(80));
    let folder = Folder::of(&[("b.parquet", b.clone()), ("a.parquet", a.clone())]);
    let (dataset, imported) = folder.import(folder.0.path()).unwrap();
    let first: Vec<u8> = (0..80).map(|i| dataset.frame_bytes(i)[0]).collect();
    assert_eq!(first, (20..60).chain(80..120).collect::<Vec<u8>>());
    assert_eq!(imported.warnings, ["column label is left out"]);
    let sha256 = format!("{:x}", <sha2::Sha256 as sha2::Digest>::digest([a, b].concat()));
    assert_eq!(dataset.meta().recording.as_ref().unwrap().source_sha256, sha256);
}

fn nothing<T: Clone>() -> Vec<Option<T>> {
    vec![None; N]
}

/// A cell in a row, from 0; the others say nothing.
fn at<T: Clone>(row: usize, cell: T) -> Vec<Option<T>> {
    let mut cells = nothing();
    cells[row] = Some(cell);
    cells
}

#[test]
fn what_is_wrong_is_named_with_its_file_and_row() {
    let mut pictures: Vec<Option<Vec<u8>>> = (0..N).map(|_| Some(png(40))).collect();
    pictures[4] = None;
    let no_bytes = Cells::Pictures(pictures.clone());
    pictures[4] = Some(b"\x89PNG and nothing".to_vec());
    let broken = Cells::Pictures(pictures);
    let [hole, peg] = ["hole", "peg"].map(Some);
    for (column, expected) in [
        (Cells::Text("side", at(2, "left")), "row 3: side: expected hole or peg, got left"),
        (Cells::Doubles("y_mm", at(1, f64::NAN)), "row 2: y_mm: expected a number, got NaN"),
        (Cells::Doubles("y_mm", nothing()), "row 1: x_mm, y_mm, theta_deg: expected all three numbers or none"),
        (Cells::Longs("time_s", at(6, i64::MAX)), "row 7: time_s: expected seconds"),
        (Cells::Text("part", at(0, "A\nB")), "row 1: part: expected a name on one line"),
        (Cells::Text("pair", at(0, "p")), ""),
        (Cells::Text("side", vec![hole, hole, hole, None, peg, None, hole]), "row 7: pair p: side: expected a peg"),
        (no_bytes, "row 5: image.bytes: expected the bytes of a PNG or JPEG, got none"),
        (broken, "touches.parquet row 5: "),
        (Cells::Times("time_s", nothing()), "column time_s: expected whole numbers, got Timestamp"),
        (Cells::Text("time_s", nothing()), "column time_s: expected numbers (FLOAT, DOUBLE, INT32 or INT64), got UTF8"),
        (Cells::Doubles("episode", nothing()), "column episode: expected text or whole numbers, got DOUBLE"),
    ] {
        let folder = Folder::of(&[("touches.parquet", table(&with(column), Compression::SNAPPY, 4))]);
        if expected.is_empty() {
            let warnings = folder.import(folder.0.path()).unwrap().1.warnings;
            assert!(warnings[0].contains("first p in ") && warnings[0].contains("touches.parquet row 1"));
            continue;
        }
        let message = folder.refusal();
        assert!(message.contains("touches.parquet") && message.contains(expected), "{message}");
    }
}

#[test]
fn files_without_pictures_and_an_index_are_refused() {
    let no_image = table(&columns()[1..], Compression::SNAPPY, 4);
    for (bytes, expected) in [
        (no_image, "expected a column image with the fields bytes and path, got none"),
        (table(&[Cells::Pictures(Vec::new())], Compression::SNAPPY, 4), "at least one row"),
        (b"something else".to_vec(), "expected a Parquet file, got"),
        (Vec::new(), "expected a Parquet file, got"),
    ] {
        let message = Folder::of(&[("touches.parquet", bytes)]).refusal();
        assert!(message.contains(expected), "{message}");
    }
    let folder = Folder::of(&[("touches.parquet", table(&columns(), Compression::SNAPPY, 4))]);
    let how = Import { index: Some("index.csv".into()), ..Import::default() };
    let message = import(folder.0.path(), &how, &folder.at("out"), &|_, _| {}).unwrap_err().to_string();
    assert!(message.contains("--index: expected none for Parquet"), "{message}");
}

/// A changed byte or a cut anywhere is an error of one line, or is not noticed; it never ends the program.
#[test]
fn damage_is_an_error_of_one_line() {
    let pictures = Cells::Pictures((0..4_u8).map(|i| Some(png(40 + i))).collect());
    let columns = [pictures, Cells::Text("part", vec![Some("A"); 4]), Cells::Doubles("time_s", vec![None; 4])];
    for codec in [Compression::UNCOMPRESSED, Compression::SNAPPY] {
        let bytes = table(&columns, codec, 2);
        let folder = Folder::of(&[("touches.parquet", bytes.clone())]);
        let check = |damaged: &[u8], what: usize| {
            fs::write(folder.at("touches.parquet"), damaged).unwrap();
            if let Err(error) = folder.import(folder.0.path()) {
                let message = error.to_string();
                assert!(!message.contains('\n') && message.contains("touches.parquet"), "{what}: {message}");
            }
            fs::remove_dir_all(folder.at("out.partial")).ok();
        };
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] = [0, 0x7f, 0xff, bytes[at] ^ 1][at % 4];
            check(&damaged, at);
        }
        (0..bytes.len()).step_by(7).for_each(|end| check(&bytes[..end], end));
    }
}
