//! `tactile-data speed`.

use std::time::{Duration, Instant};

use clap::Args;
use rayon::prelude::*;
use serde::Serialize;
use tactile_data::dataset::generate::{Places, plan, prepare};
use tactile_data::dataset::touch::Side;
use tactile_data::scene::Scene;
use tactile_data::sensor::Fidelity;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_data::{Error, Result};

/// Touches spread over a scene that are rendered again and again: enough to have all kinds of them, few
/// enough parts to begin at once.
const N_TOUCHES: usize = 256;
/// Parts of a scene that are touched.
const N_PARTS: usize = 4;

/// Measure how many touches a second are rendered in memory, on all cores.
#[derive(Args)]
#[command(after_help = "Examples:\n  tactile-data speed --scene alphabet-large --frame-px 320x240\n  \
                        tactile-data speed --scene maze --fidelity camera --json")]
pub struct Speed {
    /// maze, connectors or connectors-dev, alphabet-small or alphabet-large (either with -dev, -hard or -hard-dev), or a TOML file
    #[arg(long, value_name = "PRESET|FILE.toml")]
    scene: String,
    /// geometry, gel, optics, camera or shadow [default: one after another]
    #[arg(long, value_name = "TIER")]
    fidelity: Option<Fidelity>,
    /// Size of the frames, pixels [default: the scene's]
    #[arg(long, value_name = "WxH", value_parser = super::parse_size)]
    frame_px: Option<[usize; 2]>,
    /// How long each tier is measured, seconds
    #[arg(long, value_name = "N", default_value_t = 3.0)]
    seconds: f64,
    /// Draws boards, poses, jitter and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print a JSON array instead of a table
    #[arg(long)]
    json: bool,
}

/// What one tier costs.
#[derive(Serialize)]
struct Measured {
    fidelity: Fidelity,
    frame_px: [usize; 2],
    n_cores: usize,
    /// Work before the first touch of one side of a part.
    ms_per_side: f64,
    images_per_s: f64,
    /// Time of one core for one image.
    ms_per_image: f64,
}

impl Speed {
    /// Measures one tier or each of them.
    pub fn run(self) -> Result<()> {
        if !(0.01..=3_600.0).contains(&self.seconds) {
            return Err(Error::invalid("--seconds", "0.01 to 3600", self.seconds.to_string()));
        }
        let tiers = self.fidelity.map_or(Fidelity::ALL.to_vec(), |tier| vec![tier]);
        if !self.json {
            println!("{:<10}{:>14}{:>26}{:>22}", "tier", "images a second", "ms an image and core", "ms a part's side");
        }
        let mut table = Vec::new();
        for fidelity in tiers {
            let measured = self.measure(fidelity)?;
            if !self.json {
                let Measured { images_per_s, ms_per_image, ms_per_side, .. } = measured;
                println!("{:<10}{images_per_s:>14.0}{ms_per_image:>26.3}{ms_per_side:>22.1}", fidelity.name());
            }
            table.push(measured);
        }
        if self.json {
            println!("{}", super::pretty(&table)?);
        }
        Ok(())
    }

    fn measure(&self, fidelity: Fidelity) -> Result<Measured> {
        let mut scene = Scene::load(&self.scene)?;
        scene.fidelity = fidelity;
        scene.sensor.frame_px = self.frame_px.unwrap_or(scene.sensor.frame_px);
        let planned = plan(&scene, &[Side::Hole, Side::Peg], Places::EachPose, self.seed)?;
        let of_parts: Vec<_> = planned.into_iter().filter(|touch| touch.part < N_PARTS).collect();
        let n_touches = N_TOUCHES.min(of_parts.len());
        let touches: Vec<_> = (0..n_touches).map(|i| of_parts[i * of_parts.len() / n_touches]).collect();
        let frame_px = scene.sensor.frame_px;
        let n_sides = 2 * scene.part_names().len().min(N_PARTS);
        let simulator = Simulator::new(scene, self.seed)?;
        let n_cores = rayon::current_num_threads();
        let render = |round: u64| {
            touches.par_iter().enumerate().try_for_each(|(i, touch)| {
                let mut rng = frame_rng(self.seed, round * N_TOUCHES as u64 + i as u64);
                simulator.touch(touch.part, touch.side, &touch.part_from_sensor, &mut rng).map(|_| ())
            })
        };
        let start = Instant::now();
        prepare(&simulator, &touches)?;
        let ms_per_side = 1e3 * start.elapsed().as_secs_f64() * n_cores as f64 / n_sides as f64;
        // Tables that are made once, and a MAZE board's light.
        render(0)?;
        let (start, mut round) = (Instant::now(), 0);
        while start.elapsed() < Duration::from_secs_f64(self.seconds) {
            round += 1;
            render(round)?;
        }
        let images_per_s = (round * n_touches as u64) as f64 / start.elapsed().as_secs_f64();
        let ms_per_image = 1e3 * n_cores as f64 / images_per_s;
        Ok(Measured { fidelity, frame_px, n_cores, ms_per_side, images_per_s, ms_per_image })
    }
}
