//! The simulated robot's flags, shared by `live --simulate` and `robot`.

use std::str::FromStr;

use clap::Args;
use tactile_data::dataset::touch::Side;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_live::robot::{Faults, Outcome, Robot, RobotSettings};
use tactile_live::{Error, Result};

use super::numbers::assignment;

/// Sources of `live` that are no simulated robot: a `requires` would be waived, since they exclude each other.
const OTHERS: [&str; 3] = ["stdin_mjpeg", "watch", "ros"];

/// How the simulated robot behaves.
#[derive(Args)]
pub struct SimulatedArgs {
    /// Holes to identify, one after the other
    #[arg(long, value_name = "N", default_value_t = 3, help_heading = "Simulated robot", conflicts_with_all = OTHERS)]
    episodes: usize,
    /// Seed of holes, poses and pictures: those of `evaluate --poses off-grid` with this seed
    #[arg(long, value_name = "N", default_value_t = 1, help_heading = "Simulated robot", conflicts_with_all = OTHERS)]
    seed: u64,
    /// Pictures a second
    #[arg(long, value_name = "HZ", default_value_t = 25.0, help_heading = "Simulated robot", conflicts_with_all = OTHERS)]
    rate_hz: f64,
    /// Send pictures as JPEG of this quality, 1 to 100, instead of pixels
    #[arg(long, value_name = "QUALITY", help_heading = "Simulated robot", conflicts_with_all = OTHERS)]
    jpeg: Option<u8>,
    /// What goes wrong, each a share of the pictures: dropped=0.02,frozen=0.01,torn=0.1,dark=0.1,malformed=0.1; gone=5 is
    /// a camera that is gone for five seconds
    #[arg(long, value_name = "FAULTS", default_value = "", value_parser = Faulty::from_str, help_heading = "Simulated robot", conflicts_with_all = OTHERS)]
    faults: Faulty,
}

/// [`Faults`] as they are written.
#[derive(Clone, Copy)]
struct Faulty(Faults);

impl FromStr for Faulty {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let mut faults = Faults::default();
        for word in text.split(',').filter(|word| !word.is_empty()) {
            let wrong =
                || Error::invalid("--faults", "dropped, frozen, torn, dark or malformed=0..=1, or gone=SECONDS", word);
            let (name, value) = assignment(word).map_err(|_| wrong())?;
            let value: f64 = value.parse().map_err(|_| wrong())?;
            let (place, most) = match name.as_str() {
                "dropped" => (&mut faults.dropped, 1.0),
                "frozen" => (&mut faults.frozen, 1.0),
                "torn" => (&mut faults.torn, 1.0),
                "dark" => (&mut faults.dark, 1.0),
                "malformed" => (&mut faults.malformed, 1.0),
                "gone" => (&mut faults.gone_s, 1e6),
                _ => return Err(wrong()),
            };
            if !(0.0..=most).contains(&value) {
                return Err(wrong());
            }
            *place = value;
        }
        Ok(Self(faults))
    }
}

impl SimulatedArgs {
    /// The robot over one side of a scene's parts.
    pub fn robot(&self, scene: Scene, side: Side) -> Result<Robot> {
        if !(0.1..=1000.0).contains(&self.rate_hz) {
            return Err(Error::invalid("--rate-hz", "0.1 to 1000", self.rate_hz.to_string()));
        }
        if self.jpeg.is_some_and(|quality| !(1..=100).contains(&quality)) {
            return Err(Error::invalid("--jpeg", "a quality of 1 to 100", self.jpeg.unwrap_or_default().to_string()));
        }
        let settings = RobotSettings {
            seed: self.seed,
            n_episodes: self.episodes,
            side,
            rate_hz: self.rate_hz,
            jpeg: self.jpeg,
            faults: self.faults.0,
            ..RobotSettings::default()
        };
        Robot::new(settings, Simulator::new(scene, 1)?)
    }
}

/// How many holes were named right, in a line.
pub fn summary(outcomes: &[Outcome]) -> String {
    let is_right = |outcome: &&Outcome| outcome.named.last() == Some(&outcome.part);
    let n_right = outcomes.iter().filter(is_right).count();
    let n_touches: usize = outcomes.iter().map(|outcome| outcome.named.len()).sum();
    let n_refused: usize = outcomes.iter().map(|outcome| outcome.n_refused).sum();
    let n = outcomes.len();
    format!("{n_right} of {n} holes named right with {n_touches} touches; {n_refused} calls were refused")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_are_read_and_wrong_ones_named() {
        let faults = "dropped=0.02,gone=5".parse::<Faulty>().unwrap().0;
        assert_eq!((faults.dropped, faults.gone_s, faults.dark), (0.02, 5.0, 0.0));
        for wrong in ["lost=1", "dropped=2", "dropped", "dark=x"] {
            let error = wrong.parse::<Faulty>().map(|_| ()).unwrap_err().to_string();
            assert!(error.contains("--faults") && error.contains(wrong), "{error}");
        }
    }
}
