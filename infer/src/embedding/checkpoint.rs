//! A trained model on disk.

use std::path::Path;

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Preprocessing;

use crate::calibration::Calibration;
use crate::calibration::match_odds::MatchOdds;
use crate::calibration::presence::{ENTRIES as PRESENCE, PresenceOdds};
use crate::embedding::architecture::NetworkConfig;
#[cfg(feature = "burn")]
use crate::embedding::network::{Network, tensors_of};
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};
use crate::safefile::{NamedTensor, SafeFile};

/// The version of the checkpoint's layout. Models of the first one know other lamps.
pub const SCHEMA: &str = "tactile-filter/checkpoint/2";

/// The entries of the calibrations in a checkpoint: of touched holes and of touched pegs.
const CALIBRATIONS: [&str; 2] = ["calibration", "peg_calibration"];

/// The entries of the log-odds of a match in a checkpoint: of touched holes and of touched pegs.
const MATCH_ODDS: [&str; 2] = ["match_odds", "peg_match_odds"];

/// How a model came to be. Saved in its checkpoint, for people.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Provenance {
    /// A short name: the preset that trained it.
    pub name: String,
    /// Steps trained.
    pub steps: usize,
    /// Pairs in a batch.
    pub batch: usize,
    /// Seed of the run.
    pub seed: u64,
    /// Name of the dataset.
    pub dataset: String,
    /// Retrieval@1 among near neighbours on held-out boards, 0..=1.
    pub retrieval: f64,
}

/// Weights, sizes and statistics of a trained model: one file.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Sizes of the network.
    pub config: NetworkConfig,
    /// How frames become its inputs.
    pub preprocessing: Preprocessing,
    /// Where it comes from.
    pub provenance: Provenance,
    /// How far its cosines can be believed where holes are touched, where that was measured. Not part of the model's
    /// identity: embeddings do not depend on it.
    pub calibration: Option<Calibration>,
    /// The same where pegs are touched.
    pub peg_calibration: Option<Calibration>,
    /// The log-odds of a match where holes and where pegs are touched, where they were fitted.
    pub match_odds: [Option<MatchOdds>; 2],
    /// The log-odds that a named part is there, where holes and where pegs are touched, where they were fitted.
    pub presence: [Option<PresenceOdds>; 2],
    /// Weights and running statistics by name.
    pub tensors: Vec<NamedTensor>,
    /// The format of the weights in the file. In memory, and in computing, they are f32 in any case.
    pub weights: Precision,
}

impl Checkpoint {
    /// Takes the weights out of a network.
    #[cfg(feature = "burn")]
    pub fn of(network: &Network, config: NetworkConfig, preprocessing: Preprocessing, provenance: Provenance) -> Self {
        Self { provenance, tensors: tensors_of(network), ..Self::bare(config, preprocessing) }
    }

    /// A checkpoint with these sizes, without weights and with nothing measured.
    fn bare(config: NetworkConfig, preprocessing: Preprocessing) -> Self {
        Self {
            config,
            preprocessing,
            provenance: Provenance::default(),
            calibration: None,
            peg_calibration: None,
            match_odds: [None, None],
            presence: [None, None],
            tensors: Vec::new(),
            weights: Precision::F32,
        }
    }

    /// Writes one safetensors file, whole or not at all. Returns the model's identity: the checksum of all
    /// but the calibrations.
    pub fn save(&self, path: &Path) -> Result<String> {
        let mut file = SafeFile {
            tensors: self.tensors.clone(),
            blobs: Vec::new(),
            text: vec![
                ("config".into(), to_json(&self.config)?),
                ("preprocessing".into(), to_json(&self.preprocessing)?),
                ("provenance".into(), to_json(&self.provenance)?),
            ],
        };
        let identity = file.sha256();
        push_sides(&mut file.text, CALIBRATIONS, [&self.calibration, &self.peg_calibration])?;
        push_sides(&mut file.text, MATCH_ODDS, self.match_odds.each_ref())?;
        push_sides(&mut file.text, [PRESENCE[0], PRESENCE[1]], self.presence.each_ref())?;
        file.save_as(path, SCHEMA, self.weights)?;
        Ok(identity)
    }

    /// The checkpoint with its weights rounded to another format: another model, whose banks are its own. Scales,
    /// offsets and running statistics (tensors of one axis) stay f32: they are few, and a small variance would
    /// vanish. What was measured stays: rounding changes a log-odds by less than a tenth.
    ///
    /// # Errors
    /// A weight beyond the format's range, by the name of its tensor; i8, which weights are not kept in.
    pub fn with_weights(mut self, precision: Precision) -> Result<Self> {
        if precision == Precision::I8 {
            return Err(Error::invalid("weights", Precision::WEIGHTS.join(" or "), precision.to_string()));
        }
        for tensor in self.tensors.iter_mut().filter(|tensor| tensor.shape.len() > 1) {
            precision.round_all(&tensor.name, &mut tensor.values)?;
        }
        Ok(Self { weights: precision, ..self })
    }

    /// The checkpoint with the calibration of a side that is touched.
    #[must_use]
    pub fn with_calibration(self, side: Side, calibration: Calibration) -> Self {
        match side {
            Side::Hole => Self { calibration: Some(calibration), ..self },
            Side::Peg => Self { peg_calibration: Some(calibration), ..self },
        }
    }

    /// The checkpoint with the log-odds of a match where a side is touched.
    #[must_use]
    pub fn with_match_odds(mut self, side: Side, odds: MatchOdds) -> Self {
        self.match_odds[usize::from(side == Side::Peg)] = Some(odds);
        self
    }

    /// The checkpoint with the log-odds that a named part is there, where a side is touched.
    #[must_use]
    pub fn with_presence(mut self, side: Side, odds: PresenceOdds) -> Self {
        self.presence[usize::from(side == Side::Peg)] = Some(odds);
        self
    }

    /// Reads and checks a checkpoint: schema, checksum, sizes, and that its numbers are some that training gives.
    /// Returns it with the model's identity.
    pub fn load(path: &Path) -> Result<(Self, String)> {
        let (file, weights) = SafeFile::load_as(path, SCHEMA)?;
        Self::of_file(file, weights).map_err(|error| error.within(path.display()))
    }

    fn of_file(mut file: SafeFile, weights: Precision) -> Result<(Self, String)> {
        let [calibration, peg_calibration]: [Option<Calibration>; 2] =
            [take(&mut file, CALIBRATIONS[0])?, take(&mut file, CALIBRATIONS[1])?];
        for (name, calibration) in CALIBRATIONS.iter().zip([&calibration, &peg_calibration]) {
            calibration.iter().try_for_each(Calibration::validate).map_err(|error| error.within(name))?;
        }
        let match_odds: [Option<MatchOdds>; 2] = [take(&mut file, MATCH_ODDS[0])?, take(&mut file, MATCH_ODDS[1])?];
        let presence: [Option<PresenceOdds>; 2] = [take(&mut file, PRESENCE[0])?, take(&mut file, PRESENCE[1])?];
        for (name, odds) in PRESENCE.iter().zip(&presence) {
            odds.iter().try_for_each(PresenceOdds::validate).map_err(|error| error.within(name))?;
        }
        let config: NetworkConfig = from_json(file.text("config")?)?;
        config.validate()?;
        for (name, odds) in MATCH_ODDS.iter().zip(&match_odds) {
            let valid = odds.iter().try_for_each(|odds| odds.validate(config.dim));
            valid.map_err(|error| error.within(name))?;
        }
        let preprocessing: Preprocessing = from_json(file.text("preprocessing")?)?;
        preprocessing.validate()?;
        if preprocessing.input_px != config.input_px {
            let expected = format!("the network's {:?}", config.input_px);
            return Err(Error::invalid("preprocessing.input_px", expected, format!("{:?}", preprocessing.input_px)));
        }
        let provenance = from_json(file.text("provenance")?)?;
        let sha256 = file.sha256();
        let tensors = file.tensors;
        if let Some(odd) = tensors.iter().find(|tensor| !tensor.values.iter().all(|value| value.is_finite())) {
            return Err(Error::invalid(&odd.name, "finite weights", "NaN or infinity"));
        }
        let calibrations =
            Self { calibration, peg_calibration, match_odds, presence, ..Self::bare(config, preprocessing) };
        Ok((Self { provenance, tensors, weights, ..calibrations }, sha256))
    }
}

/// Adds what is known of touches of one kind and another to the text entries of a file.
pub(crate) fn push_sides<T: Serialize, const N: usize>(
    text: &mut Vec<(String, String)>,
    names: [&str; N],
    of_sides: [&Option<T>; N],
) -> Result<()> {
    for (name, of_side) in names.into_iter().zip(of_sides) {
        if let Some(of_side) = of_side {
            text.push((name.into(), to_json(of_side)?));
        }
    }
    Ok(())
}

/// Takes a text entry out of a file, where it has it.
fn take<T: for<'a> Deserialize<'a>>(file: &mut SafeFile, name: &str) -> Result<Option<T>> {
    let entry = file.text.iter().position(|(key, _)| key == name).map(|at| file.text.swap_remove(at).1);
    entry.map(|text| from_json(&text)).transpose()
}

pub(crate) fn to_json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(|e| Error::invalid("metadata", "values JSON can hold", e.to_string()))
}

pub(crate) fn from_json<T: for<'a> Deserialize<'a>>(text: &str) -> Result<T> {
    serde_json::from_str(text).map_err(|e| {
        Error::invalid("metadata", "entries of this version (make a file of another again)", e.to_string())
    })
}
