//! A recording as a folder of pictures, with an optional index and frame at rest.

use std::path::{Path, PathBuf};

use sha2::Digest;

use crate::dataset::store::DatasetWriter;
use crate::dataset::touch::Touch;
use crate::error::Result;
use crate::file::bounded_file::{self, Kind};
use crate::file::output;
use crate::frame::Frame;
use crate::frame::picture;
use crate::recording::geometry::{Geometry, View};
use crate::recording::listing::{Listing, list};
use crate::recording::pipeline::{Item, Picture, push};
use crate::recording::rest;

pub use crate::recording::geometry::FIELD_OF_VIEW_MM;
pub use crate::recording::rest::NoContact;

/// How a folder is read.
#[derive(Clone, Debug, Default)]
pub struct Import {
    /// CSV with a header, or JSON lines, with the columns of [`COLUMNS`](crate::recording::index::COLUMNS); files are
    /// relative to the folder. `None`: the folder's `index.csv` or `index.jsonl` where there is one, else every
    /// picture by name.
    pub index: Option<PathBuf>,
    /// Where the frame at rest comes from.
    pub no_contact: NoContact,
    /// How pictures, and the frame at rest with them, become frames.
    pub geometry: Geometry,
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
/// `10.png`), or from subfolders `PART/hole` and `PART/peg`. Every frame of an animation counts. Pictures must all have
/// one size. `progress` gets the files done and all files.
///
/// # Errors
/// A row, picture or size that is wrong, named; a name in use; a disk without the room.
pub fn import(source: &Path, how: &Import, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<Imported> {
    let mut warnings = Vec::new();
    let at_rest = if let NoContact::File(path) = &how.no_contact { Some(path.as_path()) } else { None };
    let Listing { files, mut hash } = list(source, how.index.as_deref(), at_rest, &mut warnings)?;
    let n_files = files.len();
    let (view, mut writer) = begin(source, how, (&mut frames(&files), n_files), out, &mut warnings)?;
    let mut items = files.into_iter().map(|(file, touch)| {
        let bytes = bounded_file::read(&file, Kind::PICTURE)?;
        hash.update(&bytes);
        Ok(Item { picture: Picture::Encoded(bytes), touch, place: file.display().to_string() })
    });
    let n_frames = push(&mut items, n_files, &view, &mut writer, progress)?;
    drop(items);
    writer.set_recording(view.recording(format!("{:x}", hash.finalize())));
    writer.finish()?;
    Ok(Imported { n_frames, warnings })
}

/// Finds the frame at rest among the frames, settles the geometry, and begins a dataset of `n_pictures` at `out`.
pub(super) fn begin(
    source: &Path,
    how: &Import,
    (frames, n_pictures): (&mut dyn Iterator<Item = Result<(Frame, String)>>, usize),
    out: &Path,
    warnings: &mut Vec<String>,
) -> Result<(View, DatasetWriter)> {
    let no_contact = rest::find(&how.no_contact, frames, warnings)?;
    let view = how.geometry.settle(&no_contact, warnings)?;
    output::check_room(out, n_pictures, view.frame_px())?;
    let name = source.file_name().unwrap_or(source.as_os_str());
    let meta = view.meta(name, format!("imported from {}", source.display()));
    let writer = DatasetWriter::create(out, meta, &view.frame(&no_contact, "no-contact frame")?)?;
    Ok((view, writer.expecting(n_pictures)))
}

/// The frames of the files, one after the other, each with its file.
fn frames(files: &[(PathBuf, Touch)]) -> impl Iterator<Item = Result<(Frame, String)>> {
    files.iter().flat_map(|(file, _)| {
        let place = file.display().to_string();
        frames_of(bounded_file::read(file, Kind::PICTURE), place)
    })
}

/// The frames of a picture that was read or not, each with the picture's place.
pub(super) fn frames_of(bytes: Result<Vec<u8>>, place: String) -> impl Iterator<Item = Result<(Frame, String)>> {
    let (frames, error) = match bytes.and_then(|bytes| picture::frames(bytes, &place)) {
        Ok(frames) => (Some(frames), None),
        Err(error) => (None, Some(Err(error))),
    };
    let frames = frames.into_iter().flatten().map(move |frame| Ok((frame?, place.clone())));
    error.into_iter().chain(frames)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::store::Dataset;
    use crate::dataset::touch::Side;
    use crate::pose::se2::Se2;
    use crate::recording::geometry::Crop;
    use image::codecs::gif::GifEncoder;
    use image::{Delay, Rgb, RgbImage};
    use std::fs;

    /// Lit everywhere: a black side would pass for a bar.
    fn picture_of(value: u8) -> RgbImage {
        RgbImage::from_fn(16, 12, |x, _| Rgb([value, value, value + 4 * x as u8]))
    }

    fn how(no_contact: NoContact) -> Import {
        Import { no_contact, ..Import::default() }
    }

    /// A folder with two PNGs, an animation of three frames and a JPEG, in this order.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        picture_of(40).save(folder.path().join("t9.png")).unwrap();
        picture_of(41).save(folder.path().join("t10.png")).unwrap();
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
        let (dataset, summary) = imported(folder.path(), &Import::default()).unwrap();
        let reds: Vec<i16> = (0..dataset.len()).map(|i| dataset.frame_bytes(i)[0].into()).collect();
        assert_eq!((reds.len(), summary.n_frames), (6, 6));
        // A palette and a JPEG move colours by a few counts.
        for (red, expected) in reds.iter().zip([40, 41, 60, 70, 80, 90]) {
            assert!((red - expected).abs() <= 4, "{reds:?}");
        }
        assert_eq!(dataset.no_contact().rgb()[0], 41);
        assert!(summary.warnings[0].contains("first 2 frame(s)"), "{:?}", summary.warnings);
        assert!((dataset.meta().mm_per_px[0] - 18.6 / 16.0).abs() < 1e-12);
    }

    #[test]
    fn frames_and_scale_follow_the_size_asked_for() {
        let folder = folder();
        let geometry = Geometry { frame_px: Some([8, 6]), ..Geometry::default() };
        let (dataset, _) = imported(folder.path(), &Import { geometry, ..Import::default() }).unwrap();
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
            let how = how(NoContact::File(folder.path().join("t10.png")));
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
    fn the_no_contact_frame_is_not_a_touch() {
        let folder = folder();
        let how = how(NoContact::File(folder.path().join("t9.png")));
        let (dataset, summary) = imported(folder.path(), &how).unwrap();
        assert_eq!((dataset.len(), dataset.no_contact().rgb()[0]), (5, 40));
        assert!(summary.warnings.is_empty());
    }

    #[test]
    fn an_empty_folder_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let message = refusal(folder.path(), &Import::default());
        assert!(message.contains("at least one PNG, JPEG or GIF frame"), "{message}");
    }

    /// Each of these indexes is one line of refusal, and no dataset.
    #[test]
    fn hostile_indexes_are_refused_and_leave_nothing() {
        for (text, expected) in [
            ("file,x_mm,y_mm,theta_deg\nt9.png,1e300,0,0\n", "at most 10000 mm"),
            ("file,x_mm,y_mm,theta_deg\nt9.png,nan,0,0\n", "expected a number, got nan"),
            ("file,time_s\nt9.png,inf\n", "expected a number, got inf"),
            ("file\n../../../../../../etc/no-such-picture.png\n", "no such file"),
            ("file\nt9.png\nt9.png\n", "t9.png a second time, after line 2"),
            ("file\nnotes.txt\n", "notes.txt"),
            ("file,part\nt9.png,\"A\nt10.png,B\n", "a quote that is not closed?"),
            ("file,part,part\nt9.png,A,B\n", "part twice"),
            ("file,pair,side\nt9.png,p,hole\nt10.png,p,hole\n", "a second hole, after line 2"),
            ("file,episode,time_s\nt9.png,e,2\nt10.png,e,1\n", "2 s or later, after line 2"),
            ("{\"file\": \"t9.png\", \"side\": \"left\"}\n", "hole or peg"),
            ("{\"file\": [[[[[[\n", "line 1"),
            ("\u{0}\u{1}\u{2}", "line 1"),
            ("", "index.csv"),
        ] {
            let folder = folder();
            fs::write(folder.path().join("index.csv"), text).unwrap();
            let message = refusal(folder.path(), &Import::default());
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn the_source_and_its_geometry_go_into_the_meta_data() {
        let folder = folder();
        let index = "file\nt10.png\nt11.gif\n";
        fs::write(folder.path().join("index.csv"), index).unwrap();
        let geometry = Geometry { crop: Some(Crop::Rectangle([4, 3, 8, 6])), quarter_turns: 2, ..Geometry::default() };
        let (dataset, _) = imported(folder.path(), &Import { geometry, ..Import::default() }).unwrap();
        let read = |file: &str| fs::read(folder.path().join(file)).unwrap();
        let all = [index.as_bytes(), &read("t10.png"), &read("t11.gif")].concat();
        let recording = dataset.meta().recording.clone().unwrap();
        assert_eq!(recording.source_sha256, format!("{:x}", sha2::Sha256::digest(all)));
        assert_eq!((recording.source_px, recording.crop_px, recording.quarter_turns), ([16, 12], [4, 3, 8, 6], 2));
        // Half a turn: the first pixel kept is the twelfth of its line. The frame at rest goes the same way.
        let first = [41, 41, 41 + 4 * 11];
        assert_eq!((&dataset.frame_bytes(0)[..3], &dataset.no_contact().rgb()[..3]), (&first[..], &first[..]));
    }

    #[test]
    fn folders_of_part_and_side_come_in_without_an_index() {
        let folder = tempfile::tempdir().unwrap();
        for (side, value) in [("hole", 60), ("peg", 90)] {
            let place = folder.path().join("A").join(side);
            fs::create_dir_all(&place).unwrap();
            picture_of(value).save(place.join("1.png")).unwrap();
        }
        picture_of(50).save(folder.path().join("rest.png")).unwrap();
        let how = how(NoContact::File(folder.path().join("rest.png")));
        let (dataset, _) = imported(folder.path(), &how).unwrap();
        let sides: Vec<_> = dataset.touches().iter().map(|touch| (touch.part.as_deref(), touch.side)).collect();
        assert_eq!(sides, [(Some("A"), Some(Side::Hole)), (Some("A"), Some(Side::Peg))]);
    }

    #[test]
    fn a_run_that_was_killed_is_written_over_and_a_second_run_is_refused() {
        let folder = folder();
        // What a killed run leaves: files of a dataset, cut off.
        let partial = folder.path().join("out.partial");
        fs::create_dir(&partial).unwrap();
        for file in ["frames.npy", "index.jsonl", "no_contact.png"] {
            fs::write(partial.join(file), "cut").unwrap();
        }
        {
            let running = fs::File::open(partial.join("frames.npy")).unwrap();
            running.try_lock().unwrap();
            let message = refusal(folder.path(), &Import::default());
            assert!(message.contains("another run at work"), "{message}");
            assert_eq!(fs::read(partial.join("frames.npy")).unwrap(), b"cut");
        }
        assert_eq!(imported(folder.path(), &Import::default()).unwrap().0.len(), 6);
        assert!(!partial.exists());
    }

    #[test]
    fn broken_and_odd_sized_pictures_are_named() {
        let broken = folder();
        fs::write(broken.path().join("t9.png"), b"\x89PNG\r\n\x1a\ncut").unwrap();
        assert!(refusal(broken.path(), &Import::default()).contains("t9.png"));
        let odd = folder();
        RgbImage::new(8, 8).save(odd.path().join("t12.jpeg")).unwrap();
        let message = refusal(odd.path(), &Import::default());
        assert!(message.contains("t12.jpeg: expected 16x12 pixels") && message.contains("8x8"), "{message}");
    }

    #[test]
    fn more_frames_at_rest_than_frames_are_refused() {
        let folder = folder();
        let message = refusal(folder.path(), &how(NoContact::First(7)));
        assert!(message.contains("7 first frames") && message.ends_with("got 6"), "{message}");
    }
}
