//! A recording as a folder of pictures, with an optional index and frame at rest.

use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::picture;
use crate::recording::pipeline::{Item, Picture, check_px, push};
use crate::se2::Se2;
use crate::store::{self, DatasetWriter, Meta};
use crate::suggest::with_closest;
use crate::touch::{Side, Touch};

/// Field of view of a GelSight Mini along x and y, mm (data sheet; FEATS' homography of 14 px/mm at
/// 320x240 gives about the same height).
pub const FIELD_OF_VIEW_MM: [f64; 2] = [18.6, 14.3];

/// Where no frame at rest is named, at most this many first frames are taken for it.
const MAX_REST_FRAMES: usize = 15;

/// Two frames of a sensor at rest differ by less than this mean absolute difference, counts. White
/// noise of 2.5 counts gives 2.5 * 2 / sqrt(pi) = 2.8; the lightest touch that changes a tenth of a
/// view by 20 counts adds 2.
const REST_COUNTS: f64 = 3.0;

/// How a folder is read.
#[derive(Clone, Debug)]
pub struct Import {
    /// CSV with a header, or JSON lines; columns `file, part, side, x_mm, y_mm, theta_deg, moved_x_mm,
    /// moved_y_mm, moved_theta_deg`, all optional but `file` (relative to the folder). `None`: the
    /// folder's `index.csv` or `index.jsonl` where there is one, else every picture by name.
    pub index: Option<PathBuf>,
    /// Where the frame at rest comes from.
    pub no_contact: NoContact,
    /// Width and height to bring the frames to, pixels; `None` keeps theirs.
    pub frame_px: Option<[usize; 2]>,
    /// What a frame shows along x and y, mm.
    pub field_of_view_mm: [f64; 2],
}

/// Where the frame of the sensor at rest comes from.
#[derive(Clone, Debug)]
pub enum NoContact {
    /// A picture; not counted among the frames where it is in the same folder.
    File(PathBuf),
    /// The median of this many first frames.
    First(usize),
    /// The median of the first frames that look like the very first.
    Guess,
}

/// What an import did.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Number of frames written.
    pub n_frames: usize,
    /// What a person should know, one line each.
    pub warnings: Vec<String>,
}

/// Imports `source`, a folder of PNG, JPEG and GIF pictures or one such file, to a dataset at `out`.
///
/// Without an index the pictures are taken in order of their names, numbers by value (`9.png` before
/// `10.png`). Every frame of an animation counts. Frames must all have one size. `progress` gets
/// the files done and all files.
pub fn import(source: &Path, how: &Import, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<Imported> {
    if !how.field_of_view_mm.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
        return Err(Error::invalid("field of view", "positive sizes in mm", format!("{:?}", how.field_of_view_mm)));
    }
    let files = list_files(source, how)?;
    let mut warnings = Vec::new();
    let no_contact = no_contact(&files, how, &mut warnings)?;
    let native_px = [no_contact.width_px(), no_contact.height_px()];
    let frame_px = how.frame_px.unwrap_or(native_px);
    let meta = Meta {
        name: source.file_name().unwrap_or(source.as_os_str()).to_string_lossy().into_owned(),
        frame_px,
        mm_per_px: [0, 1].map(|axis| how.field_of_view_mm[axis] / frame_px[axis] as f64),
        reach: None,
        held_out: Vec::new(),
        scene: None,
        seed: None,
        source: format!("imported from {}", source.display()),
        recording: None,
        peg_from_hole: None,
    };
    store::check_meta(&meta, out)?;
    let mut writer = DatasetWriter::create(out, meta, &picture::resize(&no_contact, frame_px)?)?;
    let n_files = files.len();
    let mut items = files.into_iter().map(|(file, touch)| {
        let place = file.display().to_string();
        Ok(Item { picture: Picture::File(file), touch, place })
    });
    let n_frames = push(&mut items, n_files, native_px, frame_px, &mut writer, progress)?;
    writer.finish()?;
    Ok(Imported { n_frames, warnings })
}

/// The picture files in order, with what the index says of each.
fn list_files(source: &Path, how: &Import) -> Result<Vec<(PathBuf, Touch)>> {
    let unknown = Touch::default();
    let is_file = fs::metadata(source).map_err(Error::io(source))?.is_file();
    let found = ["index.csv", "index.jsonl"].map(|file| source.join(file)).into_iter().find(|path| path.exists());
    let files = match how.index.clone().or(found) {
        Some(index) => read_index(&index, if is_file { Path::new("") } else { source })?,
        None if is_file => vec![(source.to_path_buf(), unknown)],
        None => {
            let entries = fs::read_dir(source).map_err(Error::io(source))?;
            let paths = entries.map(|entry| entry.map(|e| e.path())).collect::<std::io::Result<Vec<_>>>();
            let mut paths = paths.map_err(Error::io(source))?;
            paths.retain(|path| path.is_file() && picture::is_picture(path) && !is_no_contact(path, how));
            paths.sort_by_cached_key(|path| natural_key(&path.to_string_lossy()));
            paths.into_iter().map(|path| (path, unknown.clone())).collect()
        }
    };
    if files.is_empty() {
        return Err(Error::invalid(source.display().to_string(), "at least one PNG, JPEG or GIF frame", "none"));
    }
    Ok(files)
}

fn is_no_contact(path: &Path, how: &Import) -> bool {
    let NoContact::File(rest) = &how.no_contact else { return false };
    // A path that cannot be resolved is reported when it is read.
    matches!((path.canonicalize(), rest.canonicalize()), (Ok(a), Ok(b)) if a == b)
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

/// One row of an index.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Row {
    file: String,
    part: Option<String>,
    side: Option<Side>,
    x_mm: Option<f64>,
    y_mm: Option<f64>,
    theta_deg: Option<f64>,
    moved_x_mm: Option<f64>,
    moved_y_mm: Option<f64>,
    moved_theta_deg: Option<f64>,
}

/// Columns of an index: the fields of a [`Row`].
const COLUMNS: [&str; 9] =
    ["file", "part", "side", "x_mm", "y_mm", "theta_deg", "moved_x_mm", "moved_y_mm", "moved_theta_deg"];

/// No robot reaches further, mm.
const FARTHEST_MM: f64 = 10_000.0;

/// Ten turns, degrees.
const MOST_TURNED_DEG: f64 = 3_600.0;

fn read_index(index: &Path, folder: &Path) -> Result<Vec<(PathBuf, Touch)>> {
    let text = fs::read_to_string(index).map_err(Error::io(index))?;
    let text = text.trim_start_matches('\u{feff}');
    let rows = if text.trim_start().starts_with('{') { json_rows(text, index) } else { csv_rows(text, index) };
    let mut files: Vec<(PathBuf, Touch)> = Vec::new();
    let mut lines = HashMap::new();
    for (line, row) in rows? {
        let place = format!("{} line {line}", index.display());
        let path = folder.join(&row.file);
        if !path.is_file() {
            return Err(Error::invalid(&place, format!("the file {}", path.display()), "no such file"));
        }
        if let Some(before) = lines.insert(path.clone(), line) {
            let got = format!("{} a second time, after line {before}", row.file);
            return Err(Error::invalid(&place, "each file once", got));
        }
        let touch = Touch {
            part_from_sensor: pose(&place, "x_mm, y_mm, theta_deg", [row.x_mm, row.y_mm, row.theta_deg])?,
            moved: pose(&place, "moved_*", [row.moved_x_mm, row.moved_y_mm, row.moved_theta_deg])?,
            part: row.part,
            side: row.side,
            ..Touch::default()
        };
        files.push((path, touch));
    }
    if files.is_empty() {
        return Err(Error::invalid(index.display().to_string(), "at least one row that names a file", "none"));
    }
    Ok(files)
}

/// Rows of JSON lines, each with its line's number.
fn json_rows(text: &str, index: &Path) -> Result<Vec<(u64, Row)>> {
    let lines = (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty());
    let row = |(number, line): (u64, &str)| match serde_json::from_str(line) {
        Ok(row) => Ok((number, row)),
        Err(error) => Err(bad_row(index, number, &error)),
    };
    lines.map(row).collect()
}

/// Rows of a CSV file with a header, each with its line's number; an empty cell says nothing.
fn csv_rows(text: &str, index: &Path) -> Result<Vec<(u64, Row)>> {
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    let header = reader.headers().map_err(|error| bad_row(index, 1, &error))?.clone();
    if let Some(unknown) = header.iter().find(|column| !COLUMNS.contains(column)) {
        let got = with_closest(unknown, COLUMNS);
        return Err(Error::invalid(format!("{} line 1", index.display()), COLUMNS.join(", "), got));
    }
    let mut rows = Vec::new();
    for record in reader.records() {
        let line = |position: Option<&csv::Position>| position.map_or(0, csv::Position::line);
        let record = record.map_err(|error| match error.kind() {
            csv::ErrorKind::UnequalLengths { expected_len, len, .. } => {
                bad_row(index, line(error.position()), &format!("{len} cells under {expected_len} columns"))
            }
            _ => bad_row(index, line(error.position()), &error),
        })?;
        let number = line(record.position());
        let row = record.deserialize(Some(&header)).map_err(|error| match error.kind() {
            csv::ErrorKind::Deserialize { err, .. } => {
                let at = err.field().unwrap_or_default() as usize;
                let (column, cell) = (header.get(at).unwrap_or_default(), record.get(at).unwrap_or_default());
                bad_row(index, number, &format!("{column} {cell}: {}", err.kind()))
            }
            _ => bad_row(index, number, &error),
        })?;
        rows.push((number, row));
    }
    Ok(rows)
}

fn bad_row(index: &Path, line: u64, error: &dyn std::fmt::Display) -> Error {
    Error::invalid(format!("{} line {line}", index.display()), "a row of an index", error.to_string())
}

fn pose(place: &str, columns: &str, values: [Option<f64>; 3]) -> Result<Option<Se2>> {
    match values {
        [None, None, None] => Ok(None),
        [Some(x_mm), Some(y_mm), Some(theta_deg)] => {
            let is_near = x_mm.abs().max(y_mm.abs()) <= FARTHEST_MM && theta_deg.abs() <= MOST_TURNED_DEG;
            if !(is_near && [x_mm, y_mm].iter().all(|mm| mm.is_finite())) {
                let expected = format!("at most {FARTHEST_MM} mm and {MOST_TURNED_DEG} degrees from zero");
                let got = format!("{x_mm}, {y_mm}, {theta_deg}");
                return Err(Error::invalid(format!("{place}: {columns}"), expected, got));
            }
            Ok(Some(Se2::from_degrees(x_mm, y_mm, theta_deg)))
        }
        _ => Err(Error::invalid(format!("{place}: {columns}"), "all three numbers or none", "some of them")),
    }
}

fn no_contact(files: &[(PathBuf, Touch)], how: &Import, warnings: &mut Vec<String>) -> Result<Frame> {
    let n_first = match &how.no_contact {
        NoContact::File(path) => return picture::read(path),
        NoContact::First(0) => return Err(Error::invalid("no-contact frames", "at least 1", "0")),
        NoContact::First(n) => *n,
        NoContact::Guess => MAX_REST_FRAMES,
    };
    let mut frames: Vec<Frame> = Vec::new();
    'files: for (file, _) in files {
        for frame in picture::read_all(file)? {
            if let Some(first) = frames.first() {
                check_px(&frame, [first.width_px(), first.height_px()], &file.display().to_string())?;
                if matches!(how.no_contact, NoContact::Guess) && mean_difference(first, &frame) > REST_COUNTS {
                    break 'files;
                }
            }
            frames.push(frame);
            if frames.len() == n_first {
                break 'files;
            }
        }
    }
    match &how.no_contact {
        NoContact::First(n) if frames.len() < *n => {
            return Err(Error::invalid("no-contact frames", format!("{n} first frames"), format!("{}", frames.len())));
        }
        NoContact::Guess => warnings.push(format!(
            "no no-contact frame given: taking the first {} frame(s), which look alike, for the sensor at rest",
            frames.len()
        )),
        _ => {}
    }
    median(&frames)
}

/// Mean absolute difference of two frames of one size, counts.
fn mean_difference(a: &Frame, b: &Frame) -> f64 {
    let sum: u64 = a.rgb().iter().zip(b.rgb()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    sum as f64 / a.rgb().len() as f64
}

/// The median of each byte over frames of one size, at least one.
fn median(frames: &[Frame]) -> Result<Frame> {
    let mut values = vec![0; frames.len()];
    let middle = frames.len() / 2;
    let rgb = (0..frames[0].rgb().len()).map(|at| {
        values.iter_mut().zip(frames).for_each(|(value, frame)| *value = frame.rgb()[at]);
        *values.select_nth_unstable(middle).1
    });
    Frame::new(frames[0].width_px(), frames[0].height_px(), rgb.collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Dataset;
    use image::codecs::gif::GifEncoder;
    use image::{Delay, Rgb, RgbImage};

    const HOW: Import =
        Import { index: None, no_contact: NoContact::Guess, frame_px: None, field_of_view_mm: FIELD_OF_VIEW_MM };

    fn picture_of(value: u8) -> RgbImage {
        RgbImage::from_fn(16, 12, |x, _| Rgb([value, value, value + 4 * x as u8]))
    }

    /// A folder with two PNGs, an animation of three frames and a JPEG, in this order.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        picture_of(10).save(folder.path().join("t9.png")).unwrap();
        picture_of(11).save(folder.path().join("t10.png")).unwrap();
        let mut gif = GifEncoder::new(fs::File::create(folder.path().join("t11.gif")).unwrap());
        for value in [60, 70, 80] {
            let frame = image::DynamicImage::from(picture_of(value)).into_rgba8();
            gif.encode_frame(image::Frame::from_parts(frame, 0, 0, Delay::from_numer_denom_ms(40, 1))).unwrap();
        }
        picture_of(90).save(folder.path().join("t12.jpeg")).unwrap();
        fs::write(folder.path().join("notes.txt"), "not a frame").unwrap();
        folder
    }

    fn imported(folder: &Path, how: &Import) -> Result<(Dataset, Imported)> {
        let out = folder.join("out");
        let summary = import(folder, how, &out, &|_, _| {})?;
        Ok((Dataset::open(&out)?, summary))
    }

    fn refusal(folder: &Path, how: &Import) -> String {
        let message = imported(folder, how).unwrap_err().to_string();
        assert!(!message.contains('\n') && !folder.join("out").exists(), "{message}");
        message
    }

    #[test]
    fn pictures_of_every_kind_come_in_by_name() {
        let folder = folder();
        let (dataset, summary) = imported(folder.path(), &HOW).unwrap();
        let reds: Vec<i16> = (0..dataset.len()).map(|i| dataset.frame_bytes(i)[0].into()).collect();
        assert_eq!((reds.len(), summary.n_frames), (6, 6));
        // A palette and a JPEG move colours by a few counts.
        for (red, expected) in reds.iter().zip([10, 11, 60, 70, 80, 90]) {
            assert!((red - expected).abs() <= 4, "{reds:?}");
        }
        assert_eq!(dataset.no_contact().rgb()[0], 11);
        assert!(summary.warnings[0].contains("first 2 frame(s)"), "{:?}", summary.warnings);
        assert!((dataset.meta().mm_per_px[0] - 18.6 / 16.0).abs() < 1e-12);
    }

    #[test]
    fn frames_and_scale_follow_the_size_asked_for() {
        let folder = folder();
        let (dataset, _) = imported(folder.path(), &Import { frame_px: Some([8, 6]), ..HOW }).unwrap();
        assert_eq!((dataset.meta().frame_px, dataset.frame_bytes(0).len()), ([8, 6], 144));
        assert!((dataset.meta().mm_per_px[1] - 14.3 / 6.0).abs() < 1e-12);
    }

    #[test]
    fn csv_and_json_lines_say_the_same() {
        let csv = "file, part, side, x_mm, y_mm, theta_deg, moved_x_mm, moved_y_mm, moved_theta_deg\n\
                   t12.jpeg, A, hole, 4, -8, 30, , ,\nt11.gif, A, hole, 8, -8, 30, 4, 0, 0\nt9.png,,,,,,,,\n";
        let json = r#"{"file": "t12.jpeg", "part": "A", "side": "hole", "x_mm": 4, "y_mm": -8, "theta_deg": 30}
            {"file": "t11.gif", "part": "A", "side": "hole", "x_mm": 8, "y_mm": -8, "theta_deg": 30, "moved_x_mm": 4, "moved_y_mm": 0, "moved_theta_deg": 0}
            {"file": "t9.png"}"#;
        let touches = [("index.csv", csv), ("index.jsonl", json)].map(|(name, text)| {
            let folder = folder();
            fs::write(folder.path().join(name), text).unwrap();
            let how = Import { no_contact: NoContact::File(folder.path().join("t10.png")), ..HOW };
            imported(folder.path(), &how).unwrap().0.touches().to_vec()
        });
        assert_eq!(touches[0], touches[1]);
        let [first, second, third, ..] = touches[0].as_slice() else { panic!("{touches:?}") };
        assert_eq!((first.side, first.part_from_sensor), (Some(Side::Hole), Some(Se2::from_degrees(4.0, -8.0, 30.0))));
        assert_eq!((first.moved, second.moved), (None, Some(Se2::from_degrees(4.0, 0.0, 0.0))));
        // The second frame of the animation: the same place, no motion in between.
        assert_eq!(third, &Touch { moved: Some(Se2::IDENTITY), ..second.clone() });
        assert_eq!(touches[0].len(), 5);
        assert_eq!(touches[0][4].part_from_sensor, None);
    }

    #[test]
    fn a_spreadsheets_byte_order_mark_and_quotes_are_read() {
        let folder = folder();
        fs::rename(folder.path().join("t9.png"), folder.path().join("a, b.png")).unwrap();
        let text = "\u{feff}\"file\",\"part\"\r\n\"a, b.png\",\"say \"\"A\"\"\"\r\n\r\nt10.png,\r\n";
        fs::write(folder.path().join("index.csv"), text).unwrap();
        let (dataset, _) = imported(folder.path(), &HOW).unwrap();
        assert_eq!((dataset.len(), dataset.touch(0).part.as_deref()), (2, Some("say \"A\"")));
        assert_eq!(dataset.touch(1).part, None);
    }

    #[test]
    fn the_no_contact_frame_is_not_a_touch() {
        let folder = folder();
        let how = Import { no_contact: NoContact::File(folder.path().join("t9.png")), ..HOW };
        let (dataset, summary) = imported(folder.path(), &how).unwrap();
        assert_eq!((dataset.len(), dataset.no_contact().rgb()[0]), (5, 10));
        assert!(summary.warnings.is_empty());
    }

    #[test]
    fn an_empty_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let message = refusal(folder.path(), &HOW);
        assert!(message.contains("at least one PNG, JPEG or GIF frame"), "{message}");
    }

    #[test]
    fn bad_rows_are_named() {
        for (row, expected) in [
            ("t99.png,1,2,3", "t99.png, got no such file"),
            ("t10.png,1,,3", "all three numbers or none"),
            ("t10.png,1,2", "3 cells under 4 columns"),
            ("t10.png,1,2,east", "theta_deg east: invalid float"),
            ("t10.png,nan,nan,nan", "NaN"),
            ("t10.png,1e300,0,0", "at most 10000 mm"),
            ("t10.png,1,2,1e9", "3600 degrees"),
            ("t9.png,1,2,3", "t9.png a second time, after line 2"),
        ] {
            let folder = folder();
            let text = format!("file,x_mm,y_mm,theta_deg\nt9.png,0,0,0\n{row}\n");
            fs::write(folder.path().join("index.csv"), text).unwrap();
            let message = refusal(folder.path(), &HOW);
            assert!(message.contains(expected) && message.contains("index.csv line 3"), "{message}");
        }
        let folder = folder();
        for (header, expected) in [("file,angle", "got angle"), ("file,theta_dg", "did you mean theta_deg?")] {
            fs::write(folder.path().join("index.csv"), format!("{header}\nt9.png,3\n")).unwrap();
            assert!(refusal(folder.path(), &HOW).contains(expected));
        }
        fs::write(folder.path().join("index.csv"), "file\n").unwrap();
        assert!(refusal(folder.path(), &HOW).contains("index.csv: expected at least one row that names a file"));
    }

    #[test]
    fn broken_and_odd_sized_pictures_are_named() {
        let broken = folder();
        fs::write(broken.path().join("t9.png"), b"\x89PNG\r\n\x1a\ncut").unwrap();
        assert!(refusal(broken.path(), &HOW).contains("t9.png"));
        let odd = folder();
        RgbImage::new(8, 8).save(odd.path().join("t12.jpeg")).unwrap();
        let message = refusal(odd.path(), &HOW);
        assert!(message.contains("t12.jpeg: expected 16x12 pixels") && message.contains("8x8"), "{message}");
    }

    #[test]
    fn more_frames_at_rest_than_frames_are_refused() {
        let folder = folder();
        let message = refusal(folder.path(), &Import { no_contact: NoContact::First(7), ..HOW });
        assert!(message.contains("7 first frames") && message.ends_with("got 6"), "{message}");
    }
}
