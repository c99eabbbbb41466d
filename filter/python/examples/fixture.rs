//! Writes episodes with every number that comes out of them, for `tests/bits.py` to compare with: frames as `.npy`, the
//! motions, and the bits of each query, posterior, belief and decision.
//!
//!     cargo run --release -p tactile-py --example fixture -- OUT

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use serde_json::{Value, json};
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_filter::{Decision, Episode, EpisodeConfig, Estimate, Sensor};
use tactile_infer::bank::simulated::bank_of_scene;
use tactile_infer::bank::views::Views;
use tactile_infer::{Bank, Model};

/// A program's error.
type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// A grid fine enough for views to be interpolated.
const FINE: PoseGrid = PoseGrid { xy_half_mm: 6.0, xy_step_mm: 2.0, theta_half_deg: 45.0, theta_step_deg: 15.0 };

/// Episodes timed.
const N_TIMED: usize = 101;

fn main() -> Result<()> {
    let out = PathBuf::from(std::env::args_os().nth(1).ok_or("expected a folder to write to")?);
    fs::create_dir_all(&out)?;
    let model_path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../infer/models/maze-small.safetensors");
    let model = Arc::new(Model::load(&model_path)?);
    let mut scene = Scene::load("alphabet-small")?;
    let coarse = bank_of_scene(&model, &scene, Views::Pegs, 1, &|_, _| ())?;
    coarse.save(&out.join("coarse.bank"))?;
    scene.reach = Some(FINE);
    let fine = bank_of_scene(&model, &scene, Views::Pegs, 1, &|_, _| ())?;
    fine.save(&out.join("fine.bank"))?;

    let simulator = Simulator::new(scene, 1)?;
    let rest = simulator.no_contact(7);
    write_frame(&out.join("rest.npy"), &rest)?;
    let sensor = Sensor::new(model.clone(), &rest)?;
    let desk = Desk { out: &out, simulator: &simulator, sensor: &sensor };
    let third = |mut config: EpisodeConfig| {
        config.settings.seed = 3;
        config
    };
    let of_model = third(EpisodeConfig::of(&model));
    let (fine, coarse) = (Arc::new(fine), Arc::new(coarse));
    let episodes = [
        desk.play("exact", "fine.bank", &fine, of_model)?,
        desk.play("coarse", "coarse.bank", &coarse, of_model)?,
        desk.play("paper", "coarse.bank", &coarse, third(EpisodeConfig::paper()))?,
    ];
    let rust_us = desk.microseconds(&fine, of_model)?;
    let written = json!({ "model": model_path.canonicalize()?, "rust_us": rust_us, "episodes": episodes });
    fs::write(out.join("expected.json"), serde_json::to_string_pretty(&written)?)?;
    Ok(())
}

/// Where episodes are played.
struct Desk<'a> {
    out: &'a Path,
    simulator: &'a Simulator,
    sensor: &'a Sensor,
}

impl Desk<'_> {
    /// Plays an episode and writes its frames; returns its numbers.
    fn play(&self, name: &str, bank_file: &str, bank: &Arc<Bank>, config: EpisodeConfig) -> Result<Value> {
        let reach = reach();
        let mut pose = Se2::from_degrees(3.0, -2.0, 20.0);
        let mut moved = Se2::IDENTITY;
        let mut episode: Option<Episode> = None;
        let mut touches = Vec::new();
        for n in 0.. {
            let frame = self.simulator.touch(6, Side::Hole, &pose, &mut frame_rng(7, n))?;
            let file = format!("{name}-{n}.npy");
            write_frame(&self.out.join(&file), &frame)?;
            let observation = self.sensor.observe(&frame)?;
            let played = match episode.take() {
                None => Episode::begin(config, bank.clone(), &observation)?,
                Some(mut begun) => {
                    begun.observe(moved, &observation)?;
                    begun
                }
            };
            let belief = format!("{name}-{n}-belief.npy");
            self.write_belief(&belief, &played)?;
            let decision = played.decide(&reach)?;
            touches.push(json!({
                "frame": file,
                "moved": pose_bits(&moved),
                "query": observation.query.iter().map(|value| value.to_bits()).collect::<Vec<_>>(),
                "edge_share": observation.edge_share.to_bits(),
                "belief": belief,
                "class_posterior": bits(played.belief().posterior().by_part()),
                "estimate": estimate_bits(&played.estimate()),
                "decision": match &decision {
                    Decision::Touch(action) => json!({ "motion": pose_bits(&action.sensor_from_next) }),
                    Decision::Done(estimate, reason) => {
                        json!({ "reason": reason, "estimate": estimate_bits(estimate) })
                    }
                },
            }));
            let Decision::Touch(action) = decision else {
                let reach: Vec<_> = reach.iter().map(pose_bits).collect();
                let record = serde_json::to_string(&played.record()?)?;
                return Ok(json!({
                    "name": name, "bank": bank_file, "settings": config.settings, "reach": reach,
                    "touches": touches, "record": record,
                }));
            };
            // A robot is never where it was sent.
            let off = Se2::new(0.013, -0.021, 0.002);
            moved = action.sensor_from_next * off;
            pose = pose * moved;
            episode = Some(played);
        }
        Err("an episode without end".into())
    }

    /// What one touch takes, for `tests/load.py`: a frame observed and taken in, and a decision; the least of many.
    fn microseconds(&self, bank: &Arc<Bank>, config: EpisodeConfig) -> Result<f64> {
        let pose = |n: u64| Se2::new(3.0 - n as f64, 1.0, 0.2);
        let frame = |n| self.simulator.touch(6, Side::Hole, &pose(n), &mut frame_rng(8, n));
        let frames = [frame(0)?, frame(1)?];
        for (n, frame) in frames.iter().enumerate() {
            write_frame(&self.out.join(format!("time-{n}.npy")), frame)?;
        }
        let mut least = f64::INFINITY;
        for _ in 0..N_TIMED {
            let mut episode = Episode::begin(config, bank.clone(), &self.sensor.observe(&frames[0])?)?;
            let start = Instant::now();
            episode.observe(pose(0).inverse() * pose(1), &self.sensor.observe(&frames[1])?)?;
            episode.decide(&reach())?;
            least = least.min(1e6 * start.elapsed().as_secs_f64());
        }
        Ok(least)
    }

    /// The probability of each state, `[n_parts, n_cells]`.
    fn write_belief(&self, file: &str, episode: &Episode) -> Result<()> {
        let belief = episode.belief();
        let n_cells = belief.posterior().grid().len();
        let mut masses = vec![0.0_f64; belief.posterior().n_states()];
        belief.posterior().states().iter().for_each(|(state, mass)| masses[state.part * n_cells + state.cell] = *mass);
        let bytes: Vec<u8> = masses.iter().flat_map(|mass| mass.to_le_bytes()).collect();
        write_npy(&self.out.join(file), "<f8", &[belief.posterior().n_states() / n_cells, n_cells], &bytes)
    }
}

/// Motions of up to 6.8 mm along x and y with a slight turn.
fn reach() -> Vec<Se2> {
    (0..81).map(|i| Se2::new(f64::from(i % 9 - 4) * 1.7, f64::from(i / 9 - 4) * 1.7, 0.01)).collect()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

fn pose_bits(pose: &Se2) -> Vec<u64> {
    bits(&[pose.x_mm, pose.y_mm, pose.theta_rad])
}

fn estimate_bits(estimate: &Estimate) -> Value {
    let modes = estimate.modes.iter().map(|mode| {
        json!({
            "probability": mode.mass.to_bits(),
            "part_from_sensor": pose_bits(&mode.part_from_sensor),
            "covariance": bits(&mode.covariance.concat()),
        })
    });
    json!({
        "part": estimate.part,
        "probability": estimate.probability.to_bits(),
        "runner_up": estimate.runner_up.as_ref().map(|other| json!({
            "part": other.part,
            "probability": other.probability.to_bits(),
        })),
        "part_from_sensor": pose_bits(&estimate.part_from_sensor),
        "part_from_first": pose_bits(&estimate.part_from_first),
        "twins": estimate.symmetry.twins(&estimate.part_from_sensor).iter().map(pose_bits).collect::<Vec<_>>(),
        "covariance": bits(&estimate.covariance.concat()),
        "fit": estimate.fit.map(f64::to_bits),
        "entropy_nats": estimate.entropy_nats.to_bits(),
        "log_evidence": estimate.log_evidence.to_bits(),
        "n_touches": estimate.n_touches,
        "modes": modes.collect::<Vec<_>>(),
    })
}

fn write_frame(path: &Path, frame: &Frame) -> Result<()> {
    write_npy(path, "|u1", &[frame.height_px(), frame.width_px(), 3], frame.rgb())
}

/// An array in NumPy's format, version 1: magic, version, length of the header, header, values.
fn write_npy(path: &Path, descr: &str, shape: &[usize], bytes: &[u8]) -> Result<()> {
    let shape: String = shape.iter().map(|n| format!("{n}, ")).collect();
    let mut header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': ({shape}), }}");
    // The values begin at a multiple of 64 bytes.
    let length = (10 + header.len() + 1).next_multiple_of(64) - 11;
    header = format!("{header:length$}\n");
    let mut file = b"\x93NUMPY\x01\x00".to_vec();
    file.extend(u16::try_from(header.len())?.to_le_bytes());
    file.extend(header.as_bytes());
    file.extend(bytes);
    Ok(fs::write(path, file)?)
}
