//! A dataset as a LeRobot dataset of version 3, which [`crate::recording::lerobot`] reads back.

use std::fs;
use std::path::Path;

use rayon::prelude::*;
use serde_json::{Value, json};

use crate::dataset::export::folder::degrees;
use crate::dataset::export::partial::Partial;
use crate::dataset::store::Dataset;
use crate::dataset::touch::Touch;
use crate::error::{Error, Result};
use crate::frame::picture;
use crate::pose::se2::Se2;
use crate::recording::lerobot::format::columns::{Column, Table, Values};
use crate::recording::lerobot::format::{self, CHUNK, Feature, Info, Sensor};
use statistics::{Pixels, Statistics};

mod statistics;

/// Frames a second that are stated; when a touch was made is in `time_s`.
const FPS: f64 = 10.0;

/// A file of frames is closed after the first episode that brings it to this, bytes; LeRobot's own take 10^8.
const FILE_BYTES: usize = 100_000_000;

/// Frames that are packed at once, and a group of a file.
const GROUP: usize = 128;

/// What the three numbers of a pose are called.
const STATE_NAMES: [&str; 3] = ["x_mm", "y_mm", "theta_deg"];

/// Frames that follow each other on one side of one part, in one run.
struct Episode<'a> {
    first: usize,
    n: usize,
    task: usize,
    touch: &'a Touch,
    file: usize,
}

/// Writes a new folder. Pictures are PNG in the feature [`PICTURES`](format::PICTURES) (dtype image); the columns of an index
/// are features of their own, so that all comes back ([`crate::dataset::export::folder`] says of angles how exactly); `observation.state` is the pose once
/// more, f32, as policies want it. An episode is a run of touches of one side of one part, and its task names these. Times are
/// even, as LeRobot asks: 10 a second. The frame at rest, the scale and the lamps are in the feature's `info` and
/// `meta/no_contact.png`. `progress` gets the frames done and all frames.
///
/// # Errors
/// A name in use; no frames; a disk that cannot be written.
pub fn export(dataset: &Dataset, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<()> {
    if dataset.is_empty() {
        return Err(Error::invalid(out.display().to_string(), "at least one frame", "none"));
    }
    let partial = Partial::folder(out, |name| ["meta", "data"].contains(&name))?;
    let at = |name: &str| partial.path().join(name);
    for path in [at(format::EPISODES), at(format::INFO)] {
        let folder = path.parent().unwrap_or(partial.path());
        fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    let (mut episodes, tasks) = episodes(dataset.touches());
    let statistics = frames(dataset, &mut episodes, partial.path(), progress)?;
    write_episodes(&at(format::EPISODES), &episodes, &tasks)?;
    write_tasks(&at(format::TASKS), &tasks)?;
    picture::write_png(&at(format::NO_CONTACT), dataset.no_contact())?;
    write_json(&at(format::STATS), &statistics)?;
    write_json(&at(format::INFO), &json!(info(dataset, episodes.len(), tasks.len())))?;
    partial.finish()
}

/// The episodes of some touches, and their tasks.
fn episodes(touches: &[Touch]) -> (Vec<Episode<'_>>, Vec<String>) {
    let (mut episodes, mut tasks): (Vec<Episode<'_>>, Vec<String>) = (Vec::new(), Vec::new());
    for (i, touch) in touches.iter().enumerate() {
        let is_same = |last: &&mut Episode<'_>| {
            let of = |touch: &Touch| (touch.episode.clone(), touch.part.clone(), touch.side);
            of(last.touch) == of(touch)
        };
        if let Some(last) = episodes.last_mut().filter(is_same) {
            last.n += 1;
            continue;
        }
        let side = touch.side.map_or("side".to_owned(), |side| side.to_string());
        let named = match &touch.part {
            Some(part) => format!("Touch the {side} of {part}"),
            None => "Touch what is there".to_owned(),
        };
        let task = tasks.iter().position(|task| *task == named).unwrap_or_else(|| {
            tasks.push(named);
            tasks.len() - 1
        });
        episodes.push(Episode { first: i, n: 1, task, touch, file: 0 });
    }
    (episodes, tasks)
}

/// Writes the files of frames, notes in which each episode is, and returns the statistics.
fn frames(
    dataset: &Dataset,
    episodes: &mut [Episode<'_>],
    out: &Path,
    progress: &dyn Fn(usize, usize),
) -> Result<Value> {
    let has = Has::of(dataset.touches());
    let mut statistics = Statistics::default();
    let mut files = Files { out, open: None, n: 0 };
    for (number, episode) in episodes.iter_mut().enumerate() {
        for first in (0..episode.n).step_by(GROUP) {
            let frames: Vec<usize> = (first..episode.n.min(first + GROUP)).map(|i| episode.first + i).collect();
            let packed = |i: &usize| Ok((picture::png(&dataset.frame(*i))?, Pixels::of(dataset.frame_bytes(*i))));
            let packed = frames.par_iter().map(packed).collect::<Result<Vec<_>>>()?;
            let (pictures, pixels): (Vec<Vec<u8>>, Vec<Pixels>) = packed.into_iter().unzip();
            pixels.iter().for_each(|of| statistics.pixels.add(of));
            let mut columns = numbered(&frames, number, episode);
            columns.extend(has.columns(&frames.iter().map(|i| &dataset.touches()[*i]).collect::<Vec<_>>()));
            columns.iter().for_each(|column| statistics.add(column));
            let names = frames.iter().map(|i| format!("{i:06}.png")).collect();
            columns.push(Column::new(format::PICTURES, Values::Pictures(pictures, names)));
            files.push(columns)?;
            progress(episode.first + first + frames.len(), dataset.len());
        }
        episode.file = files.n;
        files.end_episode()?;
    }
    files.close()?;
    Ok(statistics.json(dataset.len()))
}

/// The columns that LeRobot itself asks for.
fn numbered(frames: &[usize], number: usize, episode: &Episode<'_>) -> Vec<Column> {
    let in_episode = || frames.iter().map(|i| i - episode.first);
    let same = |n: usize| Values::Longs(vec![n as i64; frames.len()]);
    vec![
        Column::new("timestamp", Values::Floats(in_episode().map(|i| (i as f64 / FPS) as f32).collect())),
        Column::new("frame_index", Values::Longs(in_episode().map(|i| i as i64).collect())),
        Column::new("episode_index", same(number)),
        Column::new("index", Values::Longs(frames.iter().map(|i| *i as i64).collect())),
        Column::new("task_index", same(episode.task)),
    ]
}

/// What some touch of a dataset has: what none has gets no feature.
struct Has {
    poses: bool,
    motions: bool,
    times: bool,
    names: Vec<&'static str>,
}

impl Has {
    fn of(touches: &[Touch]) -> Self {
        let any = |of: fn(&Touch) -> bool| touches.iter().any(of);
        let is_named = |name: &&str| touches.iter().any(|touch| !name_of(touch, name).is_empty());
        Self {
            poses: any(|touch| touch.part_from_sensor.is_some()),
            motions: any(|touch| touch.moved.is_some()),
            times: any(|touch| touch.time_s.is_some()),
            names: ["part", "side", "pair", "episode"].into_iter().filter(is_named).collect(),
        }
    }

    /// What some touches are, by the columns of an index; NaN and empty where nobody knows.
    fn columns(&self, touches: &[&Touch]) -> Vec<Column> {
        let mut columns: Vec<Column> = Vec::new();
        for name in &self.names {
            columns.push(Column::new(*name, Values::Texts(touches.iter().map(|touch| name_of(touch, name)).collect())));
        }
        let cells = |pose: Option<Se2>| match pose {
            Some(Se2 { x_mm, y_mm, theta_rad }) => [x_mm, y_mm, degrees(theta_rad)],
            None => [f64::NAN; 3],
        };
        let mut add = |names: [&str; 3], cells: Vec<[f64; 3]>| {
            for (axis, name) in names.into_iter().enumerate() {
                columns.push(Column::new(name, Values::Doubles(cells.iter().map(|cell| cell[axis]).collect())));
            }
        };
        if self.motions {
            let moved = touches.iter().map(|touch| cells(touch.moved)).collect();
            add(["moved_x_mm", "moved_y_mm", "moved_theta_deg"], moved);
        }
        if self.poses {
            let poses: Vec<[f64; 3]> = touches.iter().map(|touch| cells(touch.part_from_sensor)).collect();
            add(STATE_NAMES, poses.clone());
            let state = poses.iter().flatten().map(|value| *value as f32).collect();
            columns.push(Column::new(format::STATE, Values::Lists(3, state)));
        }
        if self.times {
            let times = touches.iter().map(|touch| touch.time_s.unwrap_or(f64::NAN)).collect();
            columns.push(Column::new("time_s", Values::Doubles(times)));
        }
        columns
    }
}

/// The name of a touch in a column of the index; empty where it has none.
fn name_of(touch: &Touch, column: &str) -> String {
    match column {
        "part" => touch.part.clone(),
        "side" => touch.side.map(|side| side.to_string()),
        "pair" => touch.pair.clone(),
        _ => touch.episode.clone(),
    }
    .unwrap_or_default()
}

/// The files of frames, one of them open at most.
struct Files<'a> {
    out: &'a Path,
    open: Option<Table>,
    n: usize,
}

impl Files<'_> {
    fn push(&mut self, columns: Vec<Column>) -> Result<()> {
        let mut table = match self.open.take() {
            Some(table) => table,
            None => {
                let path = self.out.join(format::data_file(self.n));
                let folder = path.parent().unwrap_or(self.out);
                fs::create_dir_all(folder).map_err(Error::io(folder))?;
                Table::create(&path, &columns, &[])?
            }
        };
        table.push(columns)?;
        self.open = Some(table);
        Ok(())
    }

    /// An episode is in one file.
    fn end_episode(&mut self) -> Result<()> {
        if self.open.as_ref().is_some_and(|table| table.n_bytes() >= FILE_BYTES) {
            self.close()?;
            self.n += 1;
        }
        Ok(())
    }

    fn close(&mut self) -> Result<()> {
        self.open.take().map_or(Ok(()), Table::finish)
    }
}

fn write_episodes(path: &Path, episodes: &[Episode<'_>], tasks: &[String]) -> Result<()> {
    let longs =
        |of: fn(&Episode<'_>) -> usize| Values::Longs(episodes.iter().map(|episode| of(episode) as i64).collect());
    let zeros = || Values::Longs(vec![0; episodes.len()]);
    let columns = vec![
        Column::new("episode_index", Values::Longs((0..episodes.len() as i64).collect())),
        Column::new("tasks", Values::Named(episodes.iter().map(|episode| tasks[episode.task].clone()).collect())),
        Column::new("length", longs(|episode| episode.n)),
        Column::new("data/chunk_index", longs(|episode| episode.file / CHUNK)),
        Column::new("data/file_index", longs(|episode| episode.file % CHUNK)),
        Column::new("dataset_from_index", longs(|episode| episode.first)),
        Column::new("dataset_to_index", longs(|episode| episode.first + episode.n)),
        Column::new("meta/episodes/chunk_index", zeros()),
        Column::new("meta/episodes/file_index", zeros()),
    ];
    Table::write(path, columns, &[])
}

/// LeRobot reads the tasks with pandas, and each one's text is its row's name.
fn write_tasks(path: &Path, tasks: &[String]) -> Result<()> {
    let described = |name: &str, pandas: &str, numpy: &str| json!({"name": name, "field_name": name, "pandas_type": pandas, "numpy_type": numpy, "metadata": null});
    let pandas = json!({
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": [described("task_index", "int64", "int64"), described("task", "unicode", "object")],
        "pandas_version": "2.2.0",
    });
    let columns = vec![
        Column::new("task_index", Values::Longs((0..tasks.len() as i64).collect())),
        Column::new("task", Values::Texts(tasks.to_vec())),
    ];
    Table::write(path, columns, &[("pandas", pandas.to_string())])
}

fn write_json(path: &Path, value: &Value) -> Result<()> {
    fs::write(path, format!("{value:#}\n")).map_err(Error::io(path))
}

fn info(dataset: &Dataset, n_episodes: usize, n_tasks: usize) -> Info {
    let meta = dataset.meta();
    let [width, height] = meta.frame_px;
    let sensor = Sensor {
        field_of_view_mm: meta.field_of_view_mm(),
        no_contact: format::NO_CONTACT.into(),
        lamps: meta.lamps.clone(),
    };
    let feature =
        |dtype: &str, shape: Vec<usize>, names: Value| Feature { dtype: dtype.into(), shape, names, info: None };
    let picture = Feature {
        info: Some(json!(sensor)),
        ..feature("image", vec![height, width, 3], json!(["height", "width", "channels"]))
    };
    let first: Vec<&Touch> = dataset.touches().iter().take(1).collect();
    let episode = Episode { first: 0, n: 1, task: 0, touch: first[0], file: 0 };
    let columns = numbered(&[0], 0, &episode).into_iter().chain(Has::of(dataset.touches()).columns(&first));
    let features = columns.map(|column| {
        let dtype = match column.values() {
            Values::Longs(_) => "int64",
            Values::Floats(_) | Values::Lists(..) => "float32",
            Values::Doubles(_) => "float64",
            Values::Texts(_) | Values::Named(_) | Values::Pictures(..) => "string",
        };
        let (shape, names) = match column.values() {
            Values::Lists(n, _) => (vec![*n], json!(STATE_NAMES)),
            _ => (vec![1], Value::Null),
        };
        (column.name().to_owned(), feature(dtype, shape, names))
    });
    Info {
        codebase_version: format::VERSION.into(),
        robot_type: None,
        total_episodes: n_episodes,
        total_frames: dataset.len(),
        total_tasks: n_tasks,
        chunks_size: CHUNK,
        data_files_size_in_mb: Some((FILE_BYTES / 1_000_000) as f64),
        video_files_size_in_mb: None,
        fps: FPS,
        splits: [("train".to_owned(), format!("0:{n_episodes}"))].into(),
        data_path: "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet".into(),
        video_path: None,
        features: features.chain([(format::PICTURES.to_owned(), picture)]).collect(),
    }
}
