//! `tactile-data ball-presses`.

use std::fs;
use std::path::PathBuf;

use clap::Args;
use tactile_data::frame::picture;
use tactile_data::light::calibrate::Calibration;
use tactile_data::light::calibrate::practice::ball_presses;
use tactile_data::sensor::SensorSpec;
use tactile_data::{Error, Result, program};

/// Presses that are simulated: as many as `calibrate` asks of a person.
const N_PRESSES: usize = 20;

/// Simulate 20 presses of a ball and the sensor at rest, to try `calibrate` without a sensor.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-data ball-presses --out presses\n  \
    tactile-data calibrate presses --ball-mm 4.70 --mm-per-px 0.058125,0.0595833 --no-contact presses/rest.png")]
pub struct BallPresses {
    /// The folder to write: press-01.png and so on, and rest.png; must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// The sensor's light, gel and scale [default: a Mini's, in frames of 320x240]
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// Diameter of the ball, mm
    #[arg(long, value_name = "MM", default_value_t = 4.7)]
    ball_mm: f64,
    /// Draws places, depths and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl BallPresses {
    /// Renders the presses and writes them.
    pub fn run(self) -> Result<()> {
        let out = self.out.display();
        if self.out.exists() {
            return Err(Error::invalid(out.to_string(), "a folder that does not exist", "one that does"));
        }
        let mini = SensorSpec { frame_px: [320, 240], ..SensorSpec::default() };
        let spec = match &self.calibration {
            Some(path) => Calibration::load(path)?.spec(mini)?,
            None => mini,
        };
        let made = ball_presses(&spec, self.ball_mm, N_PRESSES, self.seed)?;
        fs::create_dir_all(&self.out).map_err(Error::io(&self.out))?;
        for (i, frame) in made.frames.iter().enumerate() {
            picture::write_png(&self.out.join(format!("press-{:02}.png", i + 1)), frame)?;
        }
        picture::write_png(&self.out.join("rest.png"), &made.at_rest)?;
        program::say(format_args!("{} presses in {out}", made.frames.len()));
        Ok(())
    }
}
