//! From a LeRobot dataset to one of our own.

use std::fs;
use std::path::{Component, Path, PathBuf};

use super::LeRobot;
use super::state;
use crate::dataset::touch::Touch;
use crate::error::{Error, Result};
use crate::light::lamps::CalibratedLamps;
use crate::recording::folder::{Import, Imported, NoContact};
use crate::recording::geometry::Geometry;
use crate::recording::lerobot::format::{INFO, Info, STATE, Sensor};
use crate::recording::parquet::{Layout, Tables};

/// What LeRobot itself adds to each frame.
const ADDED: [&str; 5] = ["timestamp", "frame_index", "episode_index", "index", "task_index"];

/// What a feature of touch is called in the wild.
const TOUCH: [&str; 5] = ["tactile", "touch", "gelsight", "digit", "gel"];

/// Imports the dataset in a folder to a dataset at `out`. Of a set that this project exported all comes back: scale, lamps and
/// frame at rest are those of its `info`. Of any other the episode and the time are LeRobot's. Columns that say nothing of touches
/// are left out, with a warning. `progress` gets the rows done and all rows.
///
/// # Errors
/// Another version, with the command that converts it; pictures in a video; no feature of touch, or several; fewer frames than
/// stated; a row, picture or size that is wrong, with its file and row.
pub fn import(source: &Path, how: &LeRobot, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<Imported> {
    if let Some(index) = &how.frames.index {
        let got = index.display().to_string();
        return Err(Error::invalid("--index", "none for a LeRobot dataset, whose rows are the index", got));
    }
    let info = Info::read(source)?;
    let pictures = pictures(source, &info, how.pictures.as_deref())?;
    let sensor = info.sensor(&pictures);
    let layout = layout(&info, pictures, sensor.is_some(), how)?;
    let files = files(source)?;
    let tables = Tables { source, files: &files, layout: &layout };
    let (mut rows, mut warnings) = tables.rows()?;
    if rows.len() != info.total_frames {
        let expected = format!("{} frames as {} states", info.total_frames, source.join(INFO).display());
        return Err(Error::invalid(source.display().to_string(), expected, rows.len().to_string()));
    }
    rows.iter_mut().for_each(|row| complete(&mut row.touch, how));
    let frames = as_recorded(source, &how.frames, sensor, &mut warnings)?;
    tables.import(&frames, (rows, warnings), out, progress)
}

/// The feature of touch.
fn pictures(source: &Path, info: &Info, asked: Option<&str>) -> Result<String> {
    let is_picture = |name: &&String| ["image", "video"].contains(&info.features[*name].dtype.as_str());
    let all: Vec<&String> = info.features.keys().filter(is_picture).collect();
    let sounds = |name: &&&String| TOUCH.iter().any(|word| name.to_lowercase().contains(word));
    let of_touch: Vec<&String> = all.iter().filter(sounds).copied().collect();
    let found = match (asked, of_touch.as_slice(), all.as_slice()) {
        (Some(asked), ..) => all.iter().find(|name| **name == asked).copied(),
        (None, [only], _) | (None, [], [only]) => Some(*only),
        _ => None,
    };
    let place = || format!("{}: pictures of touch", source.display());
    let Some(found) = found else {
        let listed =
            if all.is_empty() { "none".into() } else { all.iter().map(|s| s.as_str()).collect::<Vec<_>>().join(", ") };
        let expected =
            asked.map_or("one feature, or --image-topic NAME".to_owned(), |asked| format!("a feature {asked}"));
        return Err(Error::invalid(place(), expected, listed));
    };
    if info.features[found].dtype == "video" {
        let expected = "dtype image: a video in 4:2:0 halves the resolution of colour, by which a gel shows its slope, and none is \
                        decoded here; record with video off";
        return Err(Error::invalid(place(), expected, format!("{found} of dtype video")));
    }
    Ok(found.clone())
}

fn layout(info: &Info, image: String, is_own: bool, how: &LeRobot) -> Result<Layout> {
    let has = |name: &str| info.features.contains_key(name);
    let instead = |of: &'static str, own: &str| (!is_own && !has(of)).then(|| (own.to_owned(), of));
    let state = if has("x_mm") && how.state.is_none() {
        None
    } else {
        state::find(info.features.get(STATE), how.state.as_deref())?
    };
    let renamed: Vec<_> =
        [instead("time_s", "timestamp"), instead("episode", "episode_index")].into_iter().flatten().collect();
    let of_pose = state.is_none().then_some(STATE).filter(|_| is_own);
    let ignored = ADDED.into_iter().chain(of_pose).map(str::to_owned).collect();
    Ok(Layout { image, renamed, ignored, has_blanks: true, state })
}

/// The files of frames, in order.
fn files(source: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let data = source.join("data");
    for chunk in entries(&data)?.into_iter().filter(|path| path.is_dir()) {
        files.extend(
            entries(&chunk)?.into_iter().filter(|path| path.extension().is_some_and(|ending| ending == "parquet")),
        );
    }
    if files.is_empty() {
        return Err(Error::invalid(data.display().to_string(), "files of frames, chunk-000/file-000.parquet", "none"));
    }
    Ok(files)
}

/// What is in a folder, by name.
fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).map_err(Error::io(folder))?;
    let mut paths =
        entries.map(|entry| Ok(entry?.path())).collect::<std::io::Result<Vec<_>>>().map_err(Error::io(folder))?;
    paths.sort();
    Ok(paths)
}

/// What was said of all touches.
fn complete(touch: &mut Touch, how: &LeRobot) {
    touch.part = touch.part.take().or_else(|| how.part.clone());
    touch.side = touch.side.or(how.side);
    if let Some(pose) = touch.part_from_sensor {
        let on_board = how.board.map_or(pose, |board| board.inverse() * pose);
        touch.part_from_sensor = Some(how.tool_from_sensor.map_or(on_board, |tool| on_board * tool));
    }
}

/// How the pictures of a sensor become frames: where nothing else is asked, with the scale, the lamps and the frame at rest that
/// came with them.
fn as_recorded(source: &Path, asked: &Import, sensor: Option<Sensor>, warnings: &mut Vec<String>) -> Result<Import> {
    let Some(Sensor { field_of_view_mm, no_contact, lamps }) = sensor else { return Ok(asked.clone()) };
    let mut how = asked.clone();
    if matches!(how.no_contact, NoContact::Guess) {
        how.no_contact = NoContact::File(inside(source, &no_contact)?);
    }
    let Geometry { quarter_turns, mirror, crop, letterbox, .. } = how.geometry;
    if quarter_turns > 0 || mirror.is_some() || crop.is_some() || letterbox {
        warnings.push("pictures are turned or cut: the scale and the lamps that came with them are left out".into());
        return Ok(how);
    }
    how.geometry.field_of_view_mm = how.geometry.field_of_view_mm.or(Some(field_of_view_mm));
    how.geometry.lamps = how.geometry.lamps.or_else(|| lamps.map(|lamps| CalibratedLamps { lamps, field_of_view_mm }));
    Ok(how)
}

/// A file of a dataset, which a name from its own meta data may not leave.
fn inside(source: &Path, name: &str) -> Result<PathBuf> {
    if Path::new(name).components().all(|part| matches!(part, Component::Normal(_))) {
        return Ok(source.join(name));
    }
    Err(Error::invalid(source.join(INFO).display().to_string(), "no_contact within the dataset", name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn info(features: serde_json::Value) -> Info {
        serde_json::from_value(json!({
            "codebase_version": "v3.0", "total_episodes": 1, "total_frames": 1, "total_tasks": 1, "chunks_size": 1000, "fps": 30,
            "data_path": "data", "features": features,
        }))
        .unwrap()
    }

    fn feature(dtype: &str) -> serde_json::Value {
        json!({"dtype": dtype, "shape": [240, 320, 3], "names": ["height", "width", "channels"]})
    }

    #[test]
    fn the_feature_of_touch_is_the_one_that_sounds_so_or_the_only_one() {
        let found = |features, asked| pictures(Path::new("set"), &info(features), asked).map_err(|e| e.to_string());
        let wrist = "observation.images.wrist";
        let left = "observation.images.tactile_left";
        let both = json!({wrist: feature("image"), left: feature("image"), "action": {"dtype": "float32"}});
        assert_eq!(found(both.clone(), None).unwrap(), left);
        assert_eq!(found(both.clone(), Some(wrist)).unwrap(), wrist);
        assert_eq!(found(json!({wrist: feature("image")}), None).unwrap(), wrist);
        let two = json!({left: feature("image"), "observation.images.tactile_right": feature("image")});
        let refused = found(two, None).unwrap_err();
        assert!(refused.contains("--image-topic NAME, got observation.images.tactile_left, observation"), "{refused}");
        assert!(found(both, Some("other")).unwrap_err().contains("expected a feature other"));
        let refused = found(json!({left: feature("video")}), None).unwrap_err();
        assert!(refused.contains("4:2:0") && refused.ends_with("got observation.images.tactile_left of dtype video"));
        assert!(found(json!({"action": {"dtype": "float32"}}), None).unwrap_err().ends_with("got none"));
    }

    #[test]
    fn a_frame_at_rest_is_within_its_dataset() {
        assert_eq!(inside(Path::new("set"), "meta/rest.png").unwrap(), Path::new("set/meta/rest.png"));
        for name in ["/etc/passwd", "../rest.png", "meta/../../rest.png"] {
            assert!(inside(Path::new("set"), name).is_err(), "{name}");
        }
    }
}
