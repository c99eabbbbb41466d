//! `tactile-data inspect`.

use std::collections::BTreeSet;
use std::path::PathBuf;

use super::lamp_table::LampTable;
use clap::Args;
use serde::Serialize;
use tactile_data::dataset::inspection::{self, Finding};
use tactile_data::dataset::shard::Fragment;
use tactile_data::dataset::store::{self, Channels, Dataset, Meta, Mirror, Recording};
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::frame::contact_sheet;
use tactile_data::frame::picture;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::recording::contact::{self, FrameContact};
use tactile_data::text::printable::printable;
use tactile_data::{Result, program};

/// Parts named in the text before it says only how many there are.
const MAX_NAMES: usize = 12;

/// Summarise a dataset: its size, scale, parts and poses, which frames show contact, and what is odd.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-data inspect letters --sheet letters.png\n  \
                        tactile-data inspect letters --json")]
pub struct Inspect {
    /// The dataset
    dir: PathBuf,
    /// Also draw up to 48 frames, each above its amplified difference from rest
    #[arg(long, value_name = "FILE.png")]
    sheet: Option<PathBuf>,
    /// Print JSON
    #[arg(long, help_heading = "For programs")]
    json: bool,
    /// List in the JSON how much each frame differs from rest
    #[arg(long, requires = "json", help_heading = "For programs")]
    frames: bool,
}

impl Inspect {
    /// Prints the summary and draws the sheet.
    pub fn run(self) -> Result<()> {
        let files = store::FILES.map(|file| self.dir.join(file));
        let _lock = self.sheet.as_ref().map(|sheet| output::check_file(sheet, files)).transpose()?;
        let dataset = Dataset::open(&self.dir)?;
        let summary = Summary::of(&dataset, self.frames)?;
        if let Some(sheet) = &self.sheet {
            picture::write_png(sheet, &contact_sheet::draw(&dataset)?)?;
        }
        let text = if self.json { super::pretty(&summary)? } else { summary.text() };
        program::say(text.trim_end());
        Ok(())
    }
}

#[derive(Serialize)]
struct Summary {
    schema: &'static str,
    name: String,
    source: String,
    seed: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    fragment: Option<Fragment>,
    n_frames: usize,
    frame_px: [usize; 2],
    mm_per_px: [f64; 2],
    parts: Vec<String>,
    held_out: Vec<String>,
    n_hole: usize,
    n_peg: usize,
    n_unknown_side: usize,
    n_posed: usize,
    reach: Option<PoseGrid>,
    n_contact: usize,
    /// First and last frame of each run.
    contact_frames: Vec<[usize; 2]>,
    /// Root mean square per frame, averaged over the frames, counts.
    difference_rms_mean: f64,
    unusable: Vec<Unusable>,
    /// What is missing or odd.
    findings: Vec<Finding>,
    /// How a recording became this dataset.
    #[serde(skip_serializing_if = "Option::is_none")]
    recording: Option<Recording>,
    /// How its lamps differ from a Mini's, where its touches tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    lamps: Option<LampTable>,
    /// Why its touches do not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    lamps_unknown: Option<String>,
    /// Root mean square of each frame's difference from rest, counts; none of an unusable one.
    #[serde(skip_serializing_if = "Option::is_none")]
    difference_rms: Option<Vec<Option<f32>>>,
}

#[derive(Serialize)]
struct Unusable {
    frame: usize,
    reason: String,
}

impl Summary {
    fn of(dataset: &Dataset, with_frames: bool) -> Result<Self> {
        let frames = contact::measure(dataset)?;
        let usable: Vec<&FrameContact> = frames.iter().flatten().collect();
        let rms: f64 = usable.iter().map(|frame| f64::from(frame.difference_rms)).sum();
        let Meta { name, frame_px, mm_per_px, reach, held_out, seed, source, recording, .. } = dataset.meta().clone();
        let touches = dataset.touches();
        // The lamps of what was simulated are in its scene.
        let lamps = recording.as_ref().map(|_| LampTable::fit(dataset)).transpose();
        let (lamps, lamps_unknown) = match lamps {
            Ok(lamps) => (lamps.map(|(_, lamps)| lamps), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let n_side = |side| touches.iter().filter(|touch| touch.side == side).count();
        Ok(Self {
            schema: "tactile-filter/inspection/1",
            name,
            source,
            seed,
            fragment: dataset.fragment().cloned(),
            n_frames: dataset.len(),
            frame_px,
            mm_per_px,
            parts: touches.iter().filter_map(|t| t.part.clone()).collect::<BTreeSet<_>>().into_iter().collect(),
            held_out,
            n_hole: n_side(Some(Side::Hole)),
            n_peg: n_side(Some(Side::Peg)),
            n_unknown_side: n_side(None),
            n_posed: touches.iter().filter(|touch| touch.part_from_sensor.is_some()).count(),
            reach,
            n_contact: usable.iter().filter(|frame| frame.is_contact()).count(),
            contact_frames: contact::contact_runs(&frames).iter().map(|run| [*run.start(), *run.end()]).collect(),
            difference_rms_mean: rms / usable.len().max(1) as f64,
            unusable: (frames.iter().enumerate())
                .filter_map(|(frame, result)| Some(Unusable { frame, reason: result.as_ref().err()?.to_string() }))
                .collect(),
            findings: inspection::findings(dataset, &frames)?,
            lamps,
            lamps_unknown,
            recording,
            difference_rms: with_frames
                .then(|| frames.iter().map(|frame| frame.as_ref().ok().map(|frame| frame.difference_rms)).collect()),
        })
    }
}

impl Summary {
    /// The summary for people.
    fn text(&self) -> String {
        let [width, height] = self.frame_px;
        let [mm_x, mm_y] = self.mm_per_px;
        let (view_x, view_y) = (mm_x * width as f64, mm_y * height as f64);
        let seed = self.seed.map_or(String::new(), |seed| format!(", seed {seed}"));
        let grid = self.reach.map_or("no grid".to_owned(), |grid| {
            let (n_xy, n_theta) = (grid.n_xy(), grid.n_theta());
            format!(
                "a grid of {n_xy} x {n_xy} x {n_theta}, {} mm by {}, {} degrees by {}",
                grid.xy_half_mm, grid.xy_step_mm, grid.theta_half_deg, grid.theta_step_deg
            )
        });
        let runs: Vec<String> =
            self.contact_frames.iter().map(|&[a, b]| if a == b { a.to_string() } else { format!("{a}-{b}") }).collect();
        let runs = if self.n_contact == self.n_frames { String::new() } else { format!(": {}", shorten(&runs)) };
        let mut text = format!(
            "{}: {} frames of {width}x{height} pixels\n\
             view         {view_x:.1} x {view_y:.1} mm, {mm_x:.4} x {mm_y:.4} mm a pixel\n\
             source       {}{seed}\n\
             parts        {}\n\
             held out     {}\n\
             sides        {} hole, {} peg, {} unknown\n\
             poses        {} known, {grid}\n\
             difference   {:.2} counts rms from rest, on average\n\
             contact      in {} of {} frames{}\n",
            printable(&self.name),
            self.n_frames,
            printable(&self.source),
            listed(&self.parts),
            listed(&self.held_out),
            self.n_hole,
            self.n_peg,
            self.n_unknown_side,
            self.n_posed,
            self.difference_rms_mean,
            self.n_contact,
            self.n_frames,
            if self.n_contact == 0 { String::new() } else { runs },
        );
        if let Some(Fragment { shard, n_planned, .. }) = &self.fragment {
            text += &format!("shard        {shard} of {n_planned} touches\n");
        }
        for Unusable { frame, reason } in &self.unusable {
            text += &format!("unusable     frame {frame}: {reason}\n");
        }
        if let Some(recording) = &self.recording {
            text += &format!("recording    {}\n", geometry_of(recording));
        }
        for Finding { message, .. } in &self.findings {
            text += &format!("finding      {message}\n");
        }
        self.lamps.iter().for_each(|lamps| text += &format!("\n{lamps}"));
        self.lamps_unknown.iter().for_each(|why| text += &format!("lamps        unknown: {why}\n"));
        text
    }
}

/// What was done to the pictures of a recording, and their checksum, for people.
fn geometry_of(recording: &Recording) -> String {
    let Recording { source_sha256, source_px: [width, height], crop_px, quarter_turns, mirror, channels } = recording;
    let [left, top, kept_width, kept_height] = crop_px;
    let mut steps = vec![format!("{width}x{height} pixels")];
    if *channels == Channels::Bgr {
        steps.push("blue and red swapped".to_owned());
    }
    if *quarter_turns > 0 {
        steps.push(format!("turned by {} degrees counter-clockwise", 90 * u32::from(*quarter_turns)));
    }
    match mirror {
        Some(Mirror::X) => steps.push("left and right swapped".to_owned()),
        Some(Mirror::Y) => steps.push("top and bottom swapped".to_owned()),
        None => {}
    }
    steps.push(format!("kept {kept_width}x{kept_height} from {left},{top}"));
    steps.push(format!("SHA-256 {}", source_sha256.get(..16).unwrap_or(source_sha256)));
    steps.join(", ")
}

fn listed(names: &[String]) -> String {
    if names.is_empty() { "none named".to_owned() } else { format!("{}: {}", names.len(), shorten(names)) }
}

/// The names in a row; only the first and last where there are many.
fn shorten(names: &[String]) -> String {
    match names {
        [first, second, .., last] if names.len() > MAX_NAMES => format!("{first}, {second}, ... {last}"),
        _ => names.join(", "),
    }
}
