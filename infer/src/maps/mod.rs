//! What a touch shows of its part, drawn by a network from its picture: how far each place is from the outline of the peg, and what
//! touches the gel, each with how sure that is. What is to be drawn is [`tactile_data::sensor::touch_map`]; an embedding says that two
//! touches are alike, maps say where they differ.

pub mod align;
pub mod coverage;
mod drawer;
pub mod expected;
pub mod mosaic;
#[cfg(feature = "burn")]
pub mod network;
pub mod picture;
pub mod sensor_offset;
pub mod strain;
pub mod usual_strain;
pub mod verifier;

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Preprocessing;

use crate::calibration::presence::{ENTRIES, PresenceOdds, entry_of};
use crate::embedding::architecture::ConvLayer;
use crate::embedding::checkpoint::{from_json, push_sides, to_json};
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};
use crate::safefile::{ContentHash, NamedTensor, SafeFile};
pub use drawer::{DrawnMap, MapDrawer};
use verifier::{PREFIX, Verifier, VerifierConfig};

/// The version of the file's layout.
pub const SCHEMA: &str = "tactile-filter/maps/1";

/// The sizes of a network that draws maps.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapConfig {
    /// Width and height of the picture and of the map, pixels.
    pub input_px: [usize; 2],
    /// Channels at the full size; twice as many at half of it, four times below.
    pub width: usize,
}

/// What a map says of a place, in the order of the network's outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawn {
    /// The distance to the outline of the peg, mm, negative inside.
    Distance,
    /// The logarithm of the mean error of that, mm.
    LogError,
    /// The log-odds that the place is inside the outline.
    Inside,
    /// The log-odds that it touches the gel.
    Contact,
}

/// Values that a network draws of a place.
pub const N_DRAWN: usize = 4;

/// Values that it sees of a pixel: three colours, and which side is touched.
pub const N_SEEN: usize = 4;

/// The logarithm of a distance's error is kept between these, mm: a fifteenth of a pixel, and more than there is.
pub const LOG_ERRORS: [f32; 2] = [-3.5, 1.5];

/// How often a picture is halved.
const HALVINGS: usize = 3;

/// What a network is given for the side, all over the picture: what is raised and what is sunk look alike.
pub fn side_value(side: Side) -> f32 {
    if side == Side::Peg { 1.0 } else { -1.0 }
}

/// Two convolutions at one size: the first changes the channels, the second adds to its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct StageLayers {
    change: ConvLayer,
    refine: ConvLayer,
}

impl MapConfig {
    /// Refuses sizes that make no network.
    ///
    /// # Errors
    /// The sizes.
    pub fn validate(&self) -> Result<()> {
        let Self { input_px, width } = self;
        if input_px.iter().any(|n| !(16..=1_024).contains(n)) || !(1..=256).contains(width) {
            let expected = "pictures of 16..=1024 px and 1..=256 channels";
            return Err(Error::invalid("map network", expected, format!("{self:?}")));
        }
        Ok(())
    }

    /// Channels where the picture was halved so often.
    fn n_channels(&self, halvings: usize) -> usize {
        self.width << halvings.min(2)
    }

    /// The stages from the full size down to the smallest, and those up again, each after what was seen at its size is added to
    /// what comes from below.
    fn stages(&self) -> [Vec<StageLayers>; 2] {
        let layer =
            |n_in, n_out, stride, adds_input| ConvLayer { name: "", n_in, n_out, kernel: 3, stride, adds_input };
        let stage = |n_in, n_out, stride| StageLayers {
            change: layer(n_in, n_out, stride, false),
            refine: layer(n_out, n_out, 1, true),
        };
        let n = |halvings| self.n_channels(halvings);
        let first = stage(N_SEEN, n(0), 1);
        let down = std::iter::once(first).chain((1..=HALVINGS).map(|at| stage(n(at - 1), n(at), 2)));
        let up = (0..HALVINGS).rev().map(|at| stage(n(at + 1) + n(at), n(at), 1));
        [down.collect(), up.collect()]
    }
}

/// How a network that draws maps came to be. Saved with it, for people.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct MapProvenance {
    /// Steps trained.
    pub steps: usize,
    /// Touches of a step.
    pub batch: usize,
    /// Seed of the run.
    pub seed: u64,
    /// Name of the dataset.
    pub dataset: String,
    /// Mean error of the distance on held-out boards, mm.
    pub distance_mm: f64,
}

/// A network that draws maps, on disk: one file.
#[derive(Clone, Debug, PartialEq)]
pub struct MapFile {
    /// Its sizes.
    pub config: MapConfig,
    /// How frames become its pictures.
    pub preprocessing: Preprocessing,
    /// Where it comes from.
    pub provenance: MapProvenance,
    /// The network that judges where touches were made, where there is one; its tensors begin with `verifier`.
    pub verifier: Option<VerifierConfig>,
    /// The log-odds that a named part is there by what that network says: where holes are touched and laid over maps of pegs, where
    /// pegs are touched, and where holes are laid over maps of holes.
    pub presence: [Option<PresenceOdds>; 3],
    /// Weights and running statistics by name.
    pub tensors: Vec<NamedTensor>,
}

/// The networks of a file, ready to draw maps and to judge by them.
#[derive(Clone, Debug)]
pub struct Maps {
    drawer: Arc<MapDrawer>,
    verifier: Option<Arc<Verifier>>,
    sha256: Arc<str>,
    n_parameters: usize,
}

impl Maps {
    /// The networks of the file at a path.
    ///
    /// # Errors
    /// As [`MapFile::load`], [`MapDrawer::new`] and [`Verifier::new`].
    pub fn load(path: &Path) -> Result<Self> {
        Self::new(&MapFile::load(path)?).map_err(|error| error.within(path.display()))
    }

    /// The networks of a file in memory.
    ///
    /// # Errors
    /// As [`MapDrawer::new`] and [`Verifier::new`].
    pub fn new(file: &MapFile) -> Result<Self> {
        let (drawer, verifier) = (MapDrawer::new(file)?, Verifier::new(file)?);
        let n_parameters = file.tensors.iter().map(|tensor| tensor.values.len()).sum();
        let (drawer, verifier) = (Arc::new(drawer), verifier.map(Arc::new));
        let sha256 = verifier.as_ref().map_or_else(|| file.weights_sha256(), |verifier| verifier.sha256().to_owned());
        Ok(Self { drawer, verifier, sha256: sha256.into(), n_parameters })
    }

    /// Number of weights of both networks.
    pub fn n_parameters(&self) -> usize {
        self.n_parameters
    }

    /// What draws maps of touches.
    pub fn drawer(&self) -> &MapDrawer {
        &self.drawer
    }

    /// What judges by maps where a touch was made, where the file has it.
    pub fn verifier(&self) -> Option<&Arc<Verifier>> {
        self.verifier.as_ref()
    }

    /// The checksum of all weights, 64 hex digits.
    pub fn sha256(&self) -> &Arc<str> {
        &self.sha256
    }
}

impl MapFile {
    /// The checksum of all weights, 64 hex digits: what is fitted with them is not among it.
    pub fn weights_sha256(&self) -> String {
        let mut hash = ContentHash::of_text(&[]);
        for tensor in &self.tensors {
            hash.begin(&tensor.name, &tensor.shape);
            hash.values(&tensor.values);
        }
        hash.finish()
    }

    /// The same file with another verifier, of these tensors.
    #[must_use]
    pub fn with_verifier(&self, config: VerifierConfig, tensors: Vec<NamedTensor>) -> Self {
        let prefix = format!("{PREFIX}.");
        let drawing = self.tensors.iter().filter(|tensor| !tensor.name.starts_with(&prefix)).cloned();
        let judging =
            tensors.into_iter().map(|tensor| NamedTensor { name: format!("{prefix}{}", tensor.name), ..tensor });
        let (verifier, tensors) = (Some(config), drawing.chain(judging).collect());
        Self { verifier, presence: [None; 3], tensors, ..self.clone() }
    }

    /// The same file with the log-odds that a named part is there, where a side is touched and laid over maps of a side.
    #[must_use]
    pub fn with_presence(mut self, (touched, on): (Side, Side), odds: PresenceOdds) -> Self {
        self.presence[entry_of(touched, on)] = Some(odds);
        self
    }

    /// Writes one safetensors file, whole or not at all; weights in f16.
    ///
    /// # Errors
    /// A weight beyond the range of f16, a file that cannot be written.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut tensors = self.tensors.clone();
        for tensor in tensors.iter_mut().filter(|tensor| tensor.shape.len() > 1) {
            Precision::F16.round_all(&tensor.name, &mut tensor.values)?;
        }
        let mut text = vec![
            ("config".into(), to_json(&self.config)?),
            ("preprocessing".into(), to_json(&self.preprocessing)?),
            ("provenance".into(), to_json(&self.provenance)?),
        ];
        if let Some(verifier) = &self.verifier {
            text.push(("verifier".into(), to_json(verifier)?));
        }
        push_sides(&mut text, ENTRIES, self.presence.each_ref())?;
        SafeFile { tensors, blobs: Vec::new(), text }.save_as(path, SCHEMA, Precision::F16)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// A file that cannot be read, is damaged, or holds something else.
    pub fn load(path: &Path) -> Result<Self> {
        let within = |error: Error| error.within(path.display());
        let file = SafeFile::load(path, SCHEMA)?;
        let text = |name: &str| file.text(name);
        let config: MapConfig = text("config").and_then(from_json).map_err(within)?;
        let preprocessing: Preprocessing = text("preprocessing").and_then(from_json).map_err(within)?;
        let provenance = text("provenance").and_then(from_json).map_err(within)?;
        let verifier: Option<VerifierConfig> = text("verifier").ok().map(from_json).transpose().map_err(within)?;
        config.validate().map_err(within)?;
        verifier.map_or(Ok(()), |verifier| verifier.validate()).map_err(within)?;
        preprocessing.validate().map_err(|error| within(error.into()))?;
        if preprocessing.input_px != config.input_px {
            let got = format!("{:?}", preprocessing.input_px);
            return Err(within(Error::invalid("preprocessing.input_px", format!("{:?}", config.input_px), got)));
        }
        let mut presence = [None; 3];
        for (name, odds) in ENTRIES.iter().zip(&mut presence) {
            *odds = text(name).ok().map(from_json::<PresenceOdds>).transpose().map_err(within)?;
            odds.iter().try_for_each(PresenceOdds::validate).map_err(|error| within(error.within(name)))?;
        }
        Ok(Self { config, preprocessing, provenance, verifier, presence, tensors: file.tensors })
    }
}
