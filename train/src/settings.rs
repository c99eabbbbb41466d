//! Settings as a person gives them: flags over a file over a preset, each under one name.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tactile_data::file::bounded_file::{self, Kind};
use toml::Table;

use crate::config::{Flips, Optimizer, Preset, TrainConfig, steps_of};
use crate::error::{Error, Result};

/// Least Jaro similarity of a wrong word to the one that was probably meant, as in clap.
const SIMILAR: f64 = 0.7;

/// Settings that may each be given or left to the preset: the entries of a TOML file, and of `--set NAME=VALUE`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Settings {
    /// How much to train.
    pub preset: Option<Preset>,
    /// Steps of the whole run.
    pub steps: Option<usize>,
    /// Length of the run in epochs, instead of steps.
    pub epochs: Option<f64>,
    /// Pairs in a batch.
    pub batch: Option<usize>,
    /// Steps between checkpoints and validations.
    pub save_every: Option<usize>,
    /// Seed of weights, batches and augmentation.
    pub seed: Option<u64>,
    /// Width and height of the network's input, pixels.
    pub input_px: Option<[usize; 2]>,
    /// Channels of the network's first layer; the others follow.
    pub width: Option<usize>,
    /// Units of the hidden layers of projector and predictor.
    pub hidden: Option<usize>,
    /// Length of an embedding.
    pub dim: Option<usize>,
    /// The optimizer.
    pub optimizer: Option<Optimizer>,
    /// Peak learning rate.
    pub learning_rate: Option<f64>,
    /// Steps of linear warm-up.
    pub warmup: Option<usize>,
    /// Decoupled weight decay.
    pub weight_decay: Option<f32>,
    /// Temperature of InfoNCE.
    pub temperature: Option<f64>,
    /// Momentum of the key encoder at the start; it ends at 1.
    pub momentum: Option<f64>,
    /// Parts that a batch is embedded in, one after the other; batch normalisation uses the statistics of each.
    pub micro_batches: Option<usize>,
    /// Whether pairs are mirrored: with their light corrected, without, or not at all.
    pub flips: Option<Flips>,
    /// Smallest share of each side that a random crop keeps.
    pub min_crop: Option<f32>,
    /// Share of a batch that are near neighbours.
    pub near_share: Option<f64>,
    /// Largest share of a batch that may be blank pairs; 1 is no limit.
    pub max_blank: Option<f64>,
    /// Strongest smooth change of a whole picture that a press brings, counts.
    pub field_counts: Option<f64>,
    /// How far apart a hole and its peg may have been touched, mm; the peg's view is moved to where the hole was touched.
    pub mate_mm: Option<f64>,
    /// The same, degrees.
    pub mate_deg: Option<f64>,
}

/// The settings that have no flag of their own, as `tactile-train --help` lists them: a name and what it is, each on a
/// line.
pub const HELP: &str = "\
Settings of --set and --config, each instead of the preset's:
  epochs         Length of the run in epochs, instead of steps
  save_every     Steps between checkpoints and validations
  input_px       Width and height of the network's input, pixels: [40, 30]
  width          Channels of the network's first layer; the others follow
  hidden         Units of the hidden layers of projector and predictor
  dim            Length of an embedding
  optimizer      lamb or adamw
  learning_rate  Peak learning rate
  warmup         Steps of linear warm-up, at most a tenth of all unless it is set
  weight_decay   Decoupled weight decay
  temperature    Temperature of InfoNCE
  momentum       Momentum of the key encoder at the start; it ends at 1
  micro_batches  Parts that a batch is embedded in, each with statistics of its own
  flips          Mirror pairs: auto, relit, plain or none
  min_crop       Smallest share of each side that a random crop keeps
  near_share     Share of a batch that are near neighbours
  max_blank      Largest share of a batch that may be blank pairs
  field_counts   Strongest smooth change of a whole picture that a press brings, counts
  mate_mm        How far apart a hole and its peg may have been touched, mm
  mate_deg       The same, degrees";

impl Settings {
    /// Reads a TOML file.
    ///
    /// # Errors
    /// An unknown or mistyped entry, with its line, and with the name that was probably meant.
    pub fn load(path: &Path) -> Result<Self> {
        let text = bounded_file::read_to_string(path, Kind::SETTINGS)?;
        let settings: Self = toml::from_str(&text).map_err(|e| {
            let line = e.span().map_or(0, |span| 1 + text[..span.start.min(text.len())].matches('\n').count());
            let name = format!("{} line {line}", path.display());
            Error::invalid(name, "settings of tactile-train", explanation(e.message()))
        })?;
        if settings.steps.is_some() && settings.epochs.is_some() {
            return Err(Error::invalid(path.display().to_string(), "steps or epochs", "both"));
        }
        Ok(settings)
    }

    /// These settings with one more, `NAME=VALUE`: the value is written as in TOML, or is a bare word.
    ///
    /// # Errors
    /// An unknown name, with the one that was probably meant, and a value that is none of the setting's.
    pub fn set(&self, pair: &str) -> Result<Self> {
        let what = format!("--set {pair}");
        let (name, value) = pair.split_once('=').ok_or_else(|| Error::invalid(&what, "NAME=VALUE", "no ="))?;
        let read = format!("value = {value}").parse::<Table>().ok().filter(|table| table.len() == 1);
        let value = read.and_then(|mut table| table.remove("value")).unwrap_or_else(|| value.into());
        let one: Self = Table::from_iter([(name.trim().into(), value)]).try_into().map_err(|e: toml::de::Error| {
            Error::invalid(what, "settings of tactile-train", explanation(e.message()))
        })?;
        one.over(self)
    }

    /// These settings, and the settings of `under` for all that is not given here.
    ///
    /// # Errors
    /// A number that TOML cannot hold: a seed of 2^63 or more.
    pub fn over(&self, under: &Self) -> Result<Self> {
        let (given, mut merged) = (table(self)?, table(under)?);
        if self.steps.is_some() || self.epochs.is_some() {
            // One length replaces the other.
            merged.remove("steps");
            merged.remove("epochs");
        }
        merged.extend(given);
        merged.try_into().map_err(not_toml)
    }

    /// The settings of a run on `n_training` pairs, checked.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn resolve(&self, n_training: usize) -> Result<TrainConfig> {
        let mut preset = TrainConfig::of(self.preset.unwrap_or_default(), n_training);
        if let Some(epochs) = self.epochs.filter(|epochs| !(epochs.is_finite() && *epochs > 0.0)) {
            return Err(Error::invalid("epochs", "a positive number", epochs.to_string()));
        }
        // The paper's length is in epochs, for every batch size.
        let epochs = self.epochs.or((preset.preset == Preset::Paper).then_some(500.0));
        let by_epochs = epochs.map(|epochs| steps_of(epochs, n_training, self.batch.unwrap_or(preset.n_pairs)));
        preset.n_steps = self.steps.or(by_epochs).unwrap_or(preset.n_steps);
        preset.n_warmup = preset.n_warmup.min(preset.n_steps / 10);
        // A preset's rate is that of its own optimizer.
        if let Some(other) = self.optimizer.filter(|optimizer| *optimizer != preset.optimizer) {
            preset.learning_rate = other.learning_rate();
        }
        let mut merged = table(&preset)?;
        merged.extend(table(self)?);
        merged.remove("epochs");
        let config: TrainConfig = merged.try_into().map_err(not_toml)?;
        config.validate()?;
        Ok(config)
    }
}

fn table(settings: &impl Serialize) -> Result<Table> {
    Table::try_from(settings).map_err(not_toml)
}

fn not_toml(error: impl std::fmt::Display) -> Error {
    Error::invalid("settings", "numbers that TOML can hold, at most 2^63 - 1", error.to_string())
}

/// What serde says of a wrong entry, in one line, with the most similar name instead of all that exist.
fn explanation(message: &str) -> String {
    let message = message.replace('\n', " ");
    let mut words = message.split('`').skip(1).step_by(2);
    match words.next() {
        Some("false_negatives") => "'false_negatives', a setting that no longer exists".into(),
        Some("shards") => "'shards', which is now called 'micro_batches'".into(),
        Some(wrong) if message.starts_with("unknown ") => {
            let similarity = |word: &&str| strsim::jaro(wrong, word);
            match words.max_by(|a, b| similarity(a).total_cmp(&similarity(b))).filter(|word| similarity(word) > SIMILAR)
            {
                Some(meant) => format!("'{wrong}'; did you mean '{meant}'?"),
                None => message,
            }
        }
        _ => message,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Settings> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.toml");
        std::fs::write(&path, text).unwrap();
        Settings::load(&path)
    }

    #[test]
    fn flags_go_over_the_file_and_the_file_over_the_preset() {
        let file = read("preset = \"small\"\ntemperature = 0.2\nbatch = 64\nflips = \"relit\"").unwrap();
        let flags = Settings { batch: Some(32), ..Settings::default() };
        let config = flags.over(&file).unwrap().resolve(1_000).unwrap();
        let expected = TrainConfig { temperature: 0.2, n_pairs: 32, flips: Flips::Relit, ..TrainConfig::small() };
        assert_eq!(config, expected);
        assert_eq!(Settings::default().resolve(1_000).unwrap(), TrainConfig::tiny());
    }

    #[test]
    fn a_pair_sets_what_a_file_sets() {
        let pairs = ["flips=relit", "input_px=[16, 12]", "temperature=1", "optimizer=\"lamb\"", "temperature = 0.2"];
        let set = pairs.iter().try_fold(Settings::default(), |settings, pair| settings.set(pair)).unwrap();
        let file = read("flips = \"relit\"\ninput_px = [16, 12]\noptimizer = \"lamb\"\ntemperature = 0.2").unwrap();
        assert_eq!(set, file);
        // One length replaces the other.
        let length = Settings::default().set("steps=7").unwrap().set("epochs=3").unwrap();
        assert_eq!(length, Settings { epochs: Some(3.0), ..Settings::default() });
        for (pair, words) in [
            ("batchsize=9", ["--set batchsize=9", "'batchsize'; did you mean 'batch'?"]),
            ("batch=many", ["--set batch=many", "expected usize"]),
            ("batch", ["--set batch", "expected NAME=VALUE"]),
            ("steps=1\nepochs=2", ["--set steps=1", "expected usize"]),
        ] {
            let error = Settings::default().set(pair).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{error}");
        }
    }

    #[test]
    fn the_help_lists_each_setting_that_has_no_flag() {
        let listed = HELP.lines().skip(1).map(|line| line.split_whitespace().next().unwrap().to_owned());
        let flags = ["preset", "steps", "batch", "seed"].map(String::from);
        let all: std::collections::BTreeSet<String> = listed.chain(flags).collect();
        let config = table(&TrainConfig::tiny()).unwrap();
        assert_eq!(all, config.keys().cloned().chain(["epochs".to_owned()]).collect());
    }

    #[test]
    fn every_setting_that_is_given_is_used() {
        let all = "preset = \"small\"\nsteps = 11\nbatch = 12\nmicro_batches = 3\ninput_px = [16, 12]\nwidth = 13\n\
                   hidden = 14\ndim = 15\ntemperature = 0.16\noptimizer = \"adamw\"\nlearning_rate = 0.17\nwarmup = 18\n\
                   weight_decay = 0.19\nmomentum = 0.2\nflips = \"none\"\nmin_crop = 0.21\nnear_share = 0.22\n\
                   max_blank = 0.23\nfield_counts = 2.9\nmate_mm = 0.26\nmate_deg = 0.27\nsave_every = 24\nseed = 25";
        let saved = read(all).unwrap().resolve(1_000).unwrap().to_toml().unwrap();
        let lines = |text: &str| text.lines().map(String::from).collect::<std::collections::BTreeSet<_>>();
        assert_eq!(lines(&saved), lines(all));
    }

    #[test]
    fn what_a_run_saves_gives_the_same_run() {
        for config in [TrainConfig::tiny(), TrainConfig::small(), TrainConfig::paper(999), TrainConfig::fine()] {
            let text = config.to_toml().unwrap();
            assert_eq!(read(&text).unwrap().resolve(12).unwrap(), config);
            assert!(text.contains("min_crop = 0.9\n"), "{text}");
        }
    }

    #[test]
    fn a_preset_s_learning_rate_is_that_of_its_own_optimizer() {
        let rate = |text: &str| read(text).unwrap().resolve(1_000).unwrap().learning_rate;
        assert_eq!(rate("optimizer = \"adamw\""), Optimizer::Adamw.learning_rate());
        assert_eq!(rate("optimizer = \"adamw\"\nlearning_rate = 0.5"), 0.5);
        assert_eq!(rate("preset = \"paper\"\noptimizer = \"adamw\""), TrainConfig::paper(1_000).learning_rate);
    }

    #[test]
    fn a_length_in_epochs_is_counted_in_steps() {
        let steps = |settings: Settings| settings.resolve(1_000).unwrap().n_steps;
        // 3 x 1,000 / 100
        assert_eq!(steps(Settings { epochs: Some(3.0), batch: Some(100), ..Settings::default() }), 30);
        let file = Settings { epochs: Some(3.0), ..Settings::default() };
        assert_eq!(steps(Settings { steps: Some(7), ..Settings::default() }.over(&file).unwrap()), 7);
        let paper = Settings { preset: Some(Preset::Paper), batch: Some(100), ..Settings::default() };
        assert_eq!(steps(paper), 5_000);
        for (epochs, name) in [(f64::NAN, "epochs: "), (-1.0, "epochs: "), (1e300, "steps: ")] {
            let error = Settings { epochs: Some(epochs), ..Settings::default() }.resolve(1_000).unwrap_err();
            assert!(error.to_string().starts_with(name), "{error}");
        }
    }

    #[test]
    fn a_wrong_entry_is_named_with_its_line_and_what_was_meant() {
        for (text, words) in [
            ("batch = 8\nbatchsize = 9", ["x.toml line 2", "'batchsize'; did you mean 'batch'?"]),
            ("preset = \"tinny\"", ["line 1", "'tinny'; did you mean 'tiny'?"]),
            ("flips = \"twice\"", ["line 1", "unknown variant `twice`, expected one of `auto`"]),
            ("false_negatives = \"mask\"", ["line 1", "'false_negatives', a setting that no longer exists"]),
            ("shards = 2", ["line 1", "'shards', which is now called 'micro_batches'"]),
            ("batch = \"many\"", ["line 1", "expected usize"]),
            ("steps = 1\nepochs = 1.0", ["x.toml", "expected steps or epochs, got both"]),
        ] {
            let error = read(text).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)) && !error.contains('\n'), "{error}");
        }
        let seed = Settings { seed: Some(u64::MAX), ..Settings::default() };
        let error = seed.resolve(12).unwrap_err().to_string();
        assert!(error.contains("2^63") && !error.contains('\n'), "{error}");
    }
}
