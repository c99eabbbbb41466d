//! Flags that several commands share, each declared once.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use serde::Serialize;
use serde::de::DeserializeOwned;
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::file::output_lock::OutputLock;
use tactile_data::light::lamps::Lamps;
use tactile_data::program;
use tactile_data::scene::Scene;
use tactile_data::text::printable::printable_json;
use tactile_eval::fits;
use tactile_eval::holes::Holes;
use tactile_eval::page::shell::check_page;
use tactile_eval::result::Poses;
use tactile_eval::{Error, Result};
use tactile_filter::EpisodeConfig;
use tactile_filter::belief::EngineConfig;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::budget::Speeds;
use tactile_filter::choice::ActionRule;
use tactile_infer::maps::Maps;
use tactile_infer::safefile::write_whole;
use tactile_infer::{Bank, DeviceKind, Model};

/// The model and the bank, and where the network is computed.
#[derive(Args)]
pub struct Inputs {
    /// Checkpoint written by tactile-train
    #[arg(long, value_name = "FILE")]
    pub model: PathBuf,
    /// Bank of the pegs that may fit, made by tactile-infer bank with the same model
    #[arg(long, value_name = "FILE")]
    pub bank: PathBuf,
    /// Draw a map of each touch by these networks (`tactile-train --maps`), find each part's place by the bank's map of it
    /// (`tactile-infer bank --maps`) and verify by it that the part is there
    #[arg(long, value_name = "FILE")]
    pub maps: Option<PathBuf>,
    /// Where the network is computed: the CPU, an older CPU backend that is much slower, or a graphics card
    #[arg(long, value_name = "DEVICE", default_value_t, value_parser = program::named::<DeviceKind>(DeviceKind::NAMES), help_heading = "Machine")]
    pub device: DeviceKind,
}

/// Whether another sensor than the bank's may touch.
#[derive(Args)]
pub struct SensorArgs {
    /// Allow a scene whose sensor has other lamps or another scale than the one the bank was made with
    #[arg(long, help_heading = "Machine")]
    pub other_sensor: bool,
}

impl Inputs {
    /// Loads both.
    pub fn load(&self) -> Result<(Arc<Model>, Arc<Bank>)> {
        load(Model::load_on(&self.model, self.device)?, &self.bank, self.maps.as_deref())
    }

    /// The files that they are read from, and the scene's: none of them may be written.
    pub fn files<'a>(&'a self, scene: &'a str) -> Vec<&'a Path> {
        let maps = self.maps.as_deref();
        maps.into_iter().chain([&self.model, &self.bank, Path::new(Scene::file_of(scene))]).collect()
    }
}

/// How long what a robot does takes.
#[derive(Args)]
pub struct SpeedArgs {
    /// Seconds of a touch: down, press and up again
    #[arg(long, value_name = "S", allow_negative_numbers = true, default_value_t = Speeds::default().touch_s, help_heading = "Robot seconds")]
    touch_s: f64,
    /// Speed from touch to touch, mm a second
    #[arg(long, value_name = "MM", allow_negative_numbers = true, default_value_t = Speeds::default().mm_s, help_heading = "Robot seconds")]
    mm_s: f64,
}

impl SpeedArgs {
    /// What was given.
    pub fn speeds(&self) -> Speeds {
        Speeds { touch_s: self.touch_s, mm_s: self.mm_s }
    }
}

/// A model, with networks that draw maps where a file of them is given, and its bank, which then has a map of each part.
pub fn load(model: Model, bank: &Path, maps: Option<&Path>) -> Result<(Arc<Model>, Arc<Bank>)> {
    let model = match maps {
        Some(path) => model.with_maps(Maps::load(path)?)?,
        None => model,
    };
    let loaded = Bank::load(bank, &model)?;
    if maps.is_some() && loaded.mosaics().is_none() {
        let expected = "a bank with a map of each part (--maps)";
        return Err(tactile_infer::Error::invalid(bank.display().to_string(), expected, "one without").into());
    }
    Ok((Arc::new(model), Arc::new(loaded)))
}

/// Where the results go.
#[derive(Args)]
pub struct Output {
    /// Folder for the results; made where it does not exist
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Print the figures as JSON instead of a table
    #[arg(long)]
    pub json: bool,
}

impl Output {
    /// Makes the folder, checks that the page and the figures can be written and are none of the inputs, and locks them
    /// against another run until what is returned is dropped.
    pub fn prepare(&self, page: &str, figures: &str, inputs: &[&Path]) -> Result<[OutputLock; 2]> {
        let locks = output::prepare_folder(&self.out, page, figures, inputs)?;
        check_page(&self.out.join(page))?;
        Ok(locks)
    }

    /// Writes a file of the folder, whole or not at all; returns its path.
    pub fn write(&self, file: &str, content: &str) -> Result<PathBuf> {
        let path = self.out.join(file);
        write_whole(&path, content.as_bytes())?;
        Ok(path)
    }

    /// Prints the figures: as JSON where it was asked for, else by `table`, with the page's path behind it.
    pub fn print(&self, json: &str, page: &Path, table: impl FnOnce()) {
        if self.json {
            println!("{}", printable_json(json));
        } else {
            table();
            program::say(format_args!("  {}", page.display()));
        }
    }
}

/// JSON for programs; `what` is named in an error.
pub fn to_json(what: &str, value: &impl Serialize) -> Result<String> {
    serde_json::to_string_pretty(value).map_err(|e| Error::invalid(what, "numbers that JSON can hold", e.to_string()))
}

/// Repetitions, shared out over seeds.
#[derive(Args)]
pub struct Seeds {
    /// Seeds of holes, poses, frames and everything else that is drawn
    #[arg(long, value_name = "SEEDS", value_delimiter = ',', default_value = "1,2,3")]
    pub seeds: Vec<u64>,
}

/// Which side is touched.
#[derive(Args)]
pub struct SideArgs {
    /// Which side is touched: holes, or raised parts that are recognised among the bank's own
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = program::named::<Side>(Side::NAMES))]
    pub side: Side,
}

/// Says where the light of some touches and that of a bank's views do not go together.
pub fn warn_of_light(bank: &Bank, lamps: Option<&Lamps>) {
    if let Some(why) = bank.other_light(lamps) {
        program::warning(why);
    }
}

/// Says where a bank is made for the other side than the one that is touched.
pub fn warn_of_side(bank: &Bank, side: Side) {
    if let Some(why) = bank.other_side(side) {
        program::warning(why);
    }
}

/// Says where touches and the poses of a bank's views do not go together.
pub fn warn_of_poses(holes: Holes<'_>, bank: &Bank, poses: Poses) {
    if let Some(why) = fits::warn_of_poses(holes, bank, poses) {
        program::warning(why);
    }
}

/// Says where a bank's poses are too far from each other for touches anywhere.
pub fn warn_of_steps(bank: &Bank) {
    if let Some(why) = fits::too_coarse(bank) {
        program::warning(why);
    }
}

/// Says where pegs are touched and nothing was measured of how far the model can be believed there.
pub fn warn_of_calibration(model: &Model, side: Side) {
    if side == Side::Peg && model.calibration(side).is_none() {
        program::warning(
            "the model has no calibration for touched pegs and is believed as for holes; tactile-infer calibrate \
             --side peg makes one",
        );
    }
}

/// How states are inferred.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Engine {
    /// Every state of the bank is weighed.
    Exact,
    /// States are sampled.
    Particle,
    /// Alg. 1 as printed: 100 particles, plain cosine, its own rule of choice.
    Paper,
}

impl Engine {
    /// Its settings, with what was measured of the model where this side is touched.
    pub fn config(self, model: &Model, side: Side) -> EpisodeConfig {
        let of_model = EpisodeConfig::of_side(model, side);
        match self {
            Self::Exact => of_model,
            Self::Particle => {
                of_model.changed(|_, _, method| method.engine = EngineConfig::Particle(ParticleConfig::default()))
            }
            Self::Paper => EpisodeConfig::paper(),
        }
    }
}

/// The parser of a value that files note under the same names.
fn named<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    names: &'static [&'static str],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value::<T>(name.into()))
}

/// The parser of rules: how the next touch is chosen.
pub fn rule() -> impl TypedValueParser<Value = ActionRule> {
    named(&["information", "paper", "random", "random-edge"])
}

/// The parser of `--poses`.
pub fn poses() -> impl TypedValueParser<Value = Poses> {
    named(&["on-grid", "off-grid"])
}

/// Reads a number above zero.
pub fn positive(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite() && *number > 0.0);
    number.ok_or_else(|| "expected a number above 0".into())
}

/// Reads two standard deviations, mm and degrees.
pub fn known_to(text: &str) -> std::result::Result<[f64; 2], String> {
    let both = text.split_once(',').and_then(|(mm, deg)| Some([positive(mm.trim()).ok()?, positive(deg.trim()).ok()?]));
    both.ok_or_else(|| "expected MM,DEG, two numbers above 0, as 2,5".into())
}

/// Refuses more episodes than this machine can hold the figures of.
pub fn check_episodes(n_episodes: usize, n_touches: usize, n_ways: usize) -> Result<()> {
    /// What is noted of a touch: errors, probabilities, times.
    const TOUCH_BYTES: f64 = 128.0;
    let n_bytes = n_episodes as f64 * n_touches as f64 * n_ways as f64 * TOUCH_BYTES;
    let value = format!("{n_episodes} episodes of {n_touches} touches");
    Ok(output::check_memory("--episodes and --touches", value, n_bytes)?)
}

/// The command line as it was typed, without the folder of the program.
pub fn command_line() -> String {
    let words = std::env::args().skip(1);
    std::iter::once("tactile-filter".to_owned()).chain(words).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_budget_is_a_finite_number_above_zero() {
        assert_eq!(positive("4.5"), Ok(4.5));
        for bad in ["nan", "inf", "-inf", "0", "-1", "1e999", "four", ""] {
            assert!(positive(bad).is_err(), "{bad}");
        }
    }
}
