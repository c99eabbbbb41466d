//! `tactile-data generate`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use tactile_data::dataset::generate::{Made, Places, Sampling, generate, generate_shard, needs};
use tactile_data::dataset::shard::Shard;
use tactile_data::dataset::touch::Side;
use tactile_data::light::calibrate::Calibration;
use tactile_data::pose::se2::Se2;
use tactile_data::program;
use tactile_data::program::drawn::DrawnArgs;
use tactile_data::program::progress;
use tactile_data::scene::lab::Lab;
use tactile_data::scene::{Parts, Scene};
use tactile_data::sensor::Fidelity;
use tactile_data::{Error, Result};

/// Simulate the touches of a scene and write them as a dataset.
///
/// The scene is a TOML file (data/scenes has examples) or a preset: maze, connectors, connectors-dev,
/// alphabet-small or alphabet-large, the last two also with -dev, -hard or -hard-dev.
#[derive(Args)]
#[command(after_help = "Examples:\n  tactile-data generate --scene maze --pairs 2000 --out maze\n  \
                        tactile-data generate --scene alphabet-small --sides peg --out pegs\n  \
                        tactile-data generate --scene alphabet-small --sides peg --xy-step-mm 2 \
                        --theta-step-deg 15 --out fine-pegs\n  \
                        tactile-data generate --scene maze --shard 2/4 --out maze-2")]
pub struct Generate {
    /// What to touch: the name of a preset, or a TOML file; FILE.toml#24+12 touches parts 24 to 35 of its MAZE parts
    #[arg(long, value_name = "PRESET|FILE.toml")]
    scene: String,
    /// Simulate your sensor, as `calibrate` measured it, instead of the scene's
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// The dataset to write; must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Which halves of the parts to touch [default: both]; MAZE boards are always touched in pairs
    #[arg(long, value_enum)]
    sides: Option<Sides>,
    /// Draws boards, poses, jitter and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Pairs of touches, for MAZE boards [default: the scene's]
    #[arg(long, value_name = "N", help_heading = "Number of touches")]
    pairs: Option<usize>,
    /// MAZE boards; one in twelve is held out [default: the scene's]
    #[arg(long, value_name = "N", help_heading = "Number of touches")]
    boards: Option<usize>,
    /// Step of the recorded places in x and y, mm [default: the scene's]
    #[arg(long, value_name = "MM", help_heading = "Number of touches")]
    xy_step_mm: Option<f64>,
    /// Step of the recorded angles, degrees [default: the scene's]
    #[arg(long, value_name = "DEG", help_heading = "Number of touches")]
    theta_step_deg: Option<f64>,
    /// Touch each side of each part at N places drawn from its reach instead of at each recorded pose
    #[arg(long, value_name = "N", conflicts_with_all = ["xy_step_mm", "theta_step_deg"],
          help_heading = "Number of touches")]
    anywhere: Option<usize>,
    /// Size of the frames, pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = super::parse_size, help_heading = "Sensor")]
    frame_px: Option<[usize; 2]>,
    /// geometry, gel, optics, camera or shadow [default: the scene's]
    #[arg(long, value_name = "TIER", help_heading = "Sensor")]
    fidelity: Option<Fidelity>,
    #[command(flatten, next_help_heading = "Sensor")]
    drawn: DrawnArgs,
    /// Record as a lab does, which states no grid and no held-out boards. hole_offset=X,Y,DEG: the pose of the hole
    /// board in the peg board's frame, mm and degrees, which the stated poses leave out; pose_noise=MM,DEG: the
    /// standard deviation of each stated pose; missing=SHARE: the share of touches that are missing
    #[arg(long, value_name = "NAME=VALUE", num_args = 1.., help_heading = "A simulated lab")]
    lab: Vec<String>,
    /// Only part i of n, for `tactile-data merge`; one that is complete already is left as it is. `env` takes i and
    /// n from a Slurm job array, or from JOB_COMPLETION_INDEX (from 0) and JOB_COMPLETION_COUNT
    #[arg(long, value_name = "i/n|env", help_heading = "Cluster")]
    shard: Option<Shard>,
}

/// What a simulated lab gets wrong.
fn lab(given: &[String]) -> Result<Option<Lab>> {
    let mut lab = Lab { peg_from_hole: Se2::IDENTITY, noise_mm: 0.0, noise_deg: 0.0, missing: 0.0 };
    for given in given {
        let refuse = |expected: String| Error::invalid(format!("--lab {given}"), expected, given.clone());
        match given.split_once('=') {
            Some(("hole_offset", pose)) => {
                let [x_mm, y_mm, theta_deg] = super::parse_numbers(pose).map_err(refuse)?;
                lab.peg_from_hole = Se2::from_degrees(x_mm, y_mm, theta_deg);
            }
            Some(("pose_noise", noise)) => {
                [lab.noise_mm, lab.noise_deg] = super::parse_numbers(noise).map_err(refuse)?;
            }
            Some(("missing", share)) => [lab.missing] = super::parse_numbers(share).map_err(refuse)?,
            _ => return Err(refuse("hole_offset=X,Y,DEG, pose_noise=MM,DEG or missing=SHARE".into())),
        }
    }
    Ok((!given.is_empty()).then_some(lab))
}

#[derive(Clone, Copy, ValueEnum)]
enum Sides {
    Peg,
    Hole,
    Both,
}

impl Generate {
    /// Renders the scene, with what the options change of it.
    pub fn run(self) -> Result<()> {
        let scene = self.scene()?;
        let sides: &[Side] = match self.sides {
            Some(Sides::Peg) => &[Side::Peg],
            Some(Sides::Hole) => &[Side::Hole],
            Some(Sides::Both) | None => &[Side::Hole, Side::Peg],
        };
        let places = self.anywhere.map_or(Places::EachPose, Places::Anywhere);
        let sampling = Sampling { sides, places, seed: self.seed, lab: lab(&self.lab)? };
        let needs = needs(&scene, &sampling, self.shard, &self.out)?;
        if needs.is_much() {
            program::note(needs);
        }
        let (out, progress) = (self.out.display(), progress::reporter("frames"));
        let Some(shard) = self.shard else {
            let n_frames = generate(&scene, &sampling, &self.out, &progress)?;
            program::say(format_args!("{n_frames} frames in {out}"));
            return Ok(());
        };
        match generate_shard(&scene, &sampling, shard, &self.out, &progress)? {
            Made::Written(n_frames) => program::say(format_args!("shard {shard}: {n_frames} frames in {out}")),
            Made::Found(n_frames) => {
                program::say(format_args!("shard {shard}: {n_frames} frames are in {out} already"));
            }
        }
        Ok(())
    }

    /// A flag that is given and that MAZE boards do not look at.
    fn of_kits(&self) -> Option<&'static str> {
        let flags = [
            ("--sides", matches!(self.sides, Some(Sides::Peg | Sides::Hole))),
            ("--xy-step-mm", self.xy_step_mm.is_some()),
            ("--theta-step-deg", self.theta_step_deg.is_some()),
            ("--anywhere", self.anywhere.is_some()),
        ];
        flags.into_iter().find(|(_, is_given)| *is_given).map(|(flag, _)| flag)
    }

    fn scene(&self) -> Result<Scene> {
        let mut scene = Scene::load(&self.scene)?;
        if let Some(path) = &self.calibration {
            scene = scene.under(&Calibration::load(path)?)?;
        }
        scene.sensor = self.drawn.sensor(&scene.sensor);
        match &mut scene.parts {
            Parts::Maze(_) if self.drawn.flag().is_some() => {
                let expected = "a scene of letters, solids, files or connectors: MAZE boards have sensors of their own";
                return Err(Error::invalid(self.drawn.flag().unwrap_or_default(), expected, scene.name));
            }
            Parts::Maze(_) if self.of_kits().is_some() => {
                let expected =
                    "a scene of letters, solids, files or connectors: MAZE boards are touched in pairs, all over";
                return Err(Error::invalid(self.of_kits().unwrap_or_default(), expected, scene.name));
            }
            Parts::Maze(boards) => {
                boards.n_pairs = self.pairs.unwrap_or(boards.n_pairs);
                if let Some(n_boards) = self.boards {
                    boards.n_boards = n_boards;
                    boards.n_held_out = n_boards.div_ceil(12).min(n_boards.saturating_sub(1));
                }
            }
            Parts::Kit(_) if self.pairs.is_some() || self.boards.is_some() => {
                return Err(Error::invalid("--pairs, --boards", "a scene of MAZE boards", scene.name));
            }
            Parts::Kit(_) => {}
        }
        if let Some(reach) = &mut scene.reach {
            reach.xy_step_mm = self.xy_step_mm.unwrap_or(reach.xy_step_mm);
            reach.theta_step_deg = self.theta_step_deg.unwrap_or(reach.theta_step_deg);
        }
        if let Some(frame_px) = self.frame_px {
            scene.sensor.frame_px = frame_px;
        }
        scene.fidelity = self.fidelity.unwrap_or(scene.fidelity);
        scene.validate()?;
        Ok(scene)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lab_is_what_its_values_say() {
        let of = |words: &str| lab(&words.split(' ').map(String::from).collect::<Vec<_>>());
        let offset = Se2::from_degrees(0.4, -0.3, 1.0);
        let all = Lab { peg_from_hole: offset, noise_mm: 0.1, noise_deg: 0.3, missing: 0.03 };
        assert_eq!(of("hole_offset=0.4,-0.3,1 pose_noise=0.1,0.3 missing=0.03").unwrap(), Some(all));
        let missing = Lab { peg_from_hole: Se2::IDENTITY, noise_mm: 0.0, noise_deg: 0.0, missing: 0.5 };
        assert_eq!((of("missing=0.5").unwrap(), lab(&[]).unwrap()), (Some(missing), None));
        for (bad, expected) in
            [("missing", "hole_offset=X,Y,DEG"), ("noise=1", "pose_noise=MM,DEG"), ("pose_noise=1", "2 numbers")]
        {
            let error = of(bad).unwrap_err().to_string();
            assert!(error.starts_with(&format!("--lab {bad}: ")) && error.contains(expected), "{error}");
        }
    }
}
