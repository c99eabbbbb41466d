//! A trained model on disk, and the model ready to embed.

use std::path::Path;

use burn::tensor::{Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};
use tactile_data::frame::{Background, Frame, Preprocessing, TactileImage};

use crate::calibration::Calibration;
use crate::device::DeviceKind;
use crate::encoder::{NamedTensor, Network, NetworkConfig, tensors_of, with_tensors};
use crate::error::{Error, Result};
use crate::folded::Folded;
use crate::precision::Precision;
use crate::safefile::SafeFile;
use crate::similarity::normalize_rows;

/// The version of the checkpoint's layout.
pub const SCHEMA: &str = "tactile-filter/checkpoint/1";

/// The entry of the calibration in a checkpoint.
const CALIBRATION: &str = "calibration";

/// Images embedded in one pass of the network; larger batches gain nothing on a CPU.
const BATCH: usize = 64;

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
    /// How far its cosines can be believed, where that was measured. Not part of the model's identity:
    /// embeddings do not depend on it.
    pub calibration: Option<Calibration>,
    /// Weights and running statistics by name.
    pub tensors: Vec<NamedTensor>,
    /// The format of the weights in the file. In memory, and in computing, they are f32 in any case.
    pub weights: Precision,
}

impl Checkpoint {
    /// Takes the weights out of a network.
    pub fn of(network: &Network, config: NetworkConfig, preprocessing: Preprocessing, provenance: Provenance) -> Self {
        Self {
            config,
            preprocessing,
            provenance,
            calibration: None,
            tensors: tensors_of(network),
            weights: Precision::F32,
        }
    }

    /// Writes one safetensors file, whole or not at all. Returns the model's identity: the checksum of all
    /// but the calibration.
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
        if let Some(calibration) = &self.calibration {
            file.text.push((CALIBRATION.into(), to_json(calibration)?));
        }
        file.save_as(path, SCHEMA, self.weights)?;
        Ok(identity)
    }

    /// The checkpoint with its weights rounded to another format: another model, whose banks are its own. Scales,
    /// offsets and running statistics (tensors of one axis) stay f32: they are few, and a small variance would
    /// vanish. The calibration stays: rounding moves a cosine by less than a tenth of its temperature.
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

    /// Reads and checks a checkpoint: schema, checksum, sizes. Returns it with the model's identity.
    pub fn load(path: &Path) -> Result<(Self, String)> {
        let (mut file, weights) = SafeFile::load_as(path, SCHEMA)?;
        let entry = file.text.iter().position(|(key, _)| key == CALIBRATION).map(|at| file.text.swap_remove(at).1);
        let calibration = entry.map(|text| from_json(path, &text)).transpose()?;
        let config: NetworkConfig = from_json(path, file.text(path, "config")?)?;
        config.validate()?;
        let preprocessing = from_json(path, file.text(path, "preprocessing")?)?;
        let provenance = from_json(path, file.text(path, "provenance")?)?;
        let sha256 = file.sha256();
        Ok((Self { config, preprocessing, provenance, calibration, tensors: file.tensors, weights }, sha256))
    }
}

/// A model ready to embed frames: f_HP's two towers.
#[derive(Debug)]
pub struct Model {
    network: Network,
    /// The same network without tensors, on the CPU.
    folded: Option<Folded>,
    device: Device,
    config: NetworkConfig,
    preprocessing: Preprocessing,
    provenance: Provenance,
    calibration: Option<Calibration>,
    sha256: String,
}

impl Model {
    /// Loads a checkpoint onto a device. The embedding of the same frame is the same on each load.
    pub fn load(path: &Path, device: DeviceKind) -> Result<Self> {
        let (checkpoint, sha256) = Checkpoint::load(path)?;
        Self::new(checkpoint, sha256, device)
    }

    /// A model from a checkpoint in memory; `sha256` is what [`Checkpoint::save`] returned.
    pub fn new(checkpoint: Checkpoint, sha256: String, device: DeviceKind) -> Result<Self> {
        // Before any is allocated: a config may ask for terabytes that the file does not hold.
        let n_held: usize = checkpoint.tensors.iter().map(|tensor| tensor.values.len()).sum();
        let n_asked = checkpoint.config.n_weights_at_least();
        if n_asked > n_held {
            return Err(Error::invalid("network", format!("{n_asked} weights or more"), n_held.to_string()));
        }
        let folded = match device {
            DeviceKind::Flex => Some(Folded::new(&checkpoint.config, &checkpoint.tensors)?),
            _ => None,
        };
        let device = device.open()?;
        Ok(Self {
            folded,
            network: with_tensors(checkpoint.config.init(0, &device), checkpoint.tensors)?,
            device,
            config: checkpoint.config,
            preprocessing: checkpoint.preprocessing,
            provenance: checkpoint.provenance,
            calibration: checkpoint.calibration,
            sha256,
        })
    }

    /// SHA-256 of the checkpoint but for its calibration: banks are bound to it.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// How frames become inputs of this model.
    pub fn preprocessing(&self) -> &Preprocessing {
        &self.preprocessing
    }

    /// How this model came to be.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// How far its cosines can be believed, where that was measured (`tactile-infer calibrate`).
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// Sizes of the network.
    pub fn config(&self) -> &NetworkConfig {
        &self.config
    }

    /// Number of weights and running statistics.
    pub fn n_parameters(&self) -> usize {
        use burn::module::Module;
        self.network.num_params()
    }

    /// Length of an embedding.
    pub fn dim(&self) -> usize {
        self.config.dim
    }

    /// Prepares a sensor's no-contact frame for this model.
    pub fn background(&self, no_contact: &Frame) -> Result<Background> {
        Ok(Background::new(no_contact, &self.preprocessing)?)
    }

    /// Queries of hole images: `[n, dim]`, rows of unit length.
    pub fn embed_holes(&self, images: &[TactileImage]) -> Result<Vec<f32>> {
        self.embed(images, Folded::query, Network::query)
    }

    /// Keys of peg images: `[n, dim]`, rows of unit length.
    pub fn embed_pegs(&self, images: &[TactileImage]) -> Result<Vec<f32>> {
        self.embed(images, Folded::key, Network::key)
    }

    fn embed(
        &self,
        images: &[TactileImage],
        on_cpu: impl Fn(&Folded, &[f32]) -> Vec<f32>,
        tower: impl Fn(&Network, Tensor<4>) -> Tensor<2>,
    ) -> Result<Vec<f32>> {
        let [width, height] = self.config.input_px;
        let mut rows = Vec::with_capacity(images.len() * self.dim());
        for batch in images.chunks(BATCH) {
            let planes = planes(batch, self.config.input_px)?;
            if let Some(folded) = &self.folded {
                rows.extend(on_cpu(folded, &planes));
                continue;
            }
            let batch = Tensor::from_data(TensorData::new(planes, [batch.len(), 3, height, width]), &self.device);
            let embedded = tower(&self.network, batch).into_data().try_into_vec::<f32>();
            rows.extend(embedded.map_err(|e| Error::invalid("embedding", "f32", format!("{e:?}")))?);
        }
        if let Some(at) = rows.iter().position(|value| !value.is_finite()) {
            return Err(Error::invalid(format!("embedding of image {}", at / self.dim()), "finite values", "NaN"));
        }
        normalize_rows(&mut rows, self.dim());
        Ok(rows)
    }
}

/// Images of one size, one behind the other: `[n, 3, height, width]`.
fn planes(images: &[TactileImage], [width, height]: [usize; 2]) -> Result<Vec<f32>> {
    let mut values = Vec::with_capacity(images.len() * 3 * width * height);
    for image in images {
        if image.size_px != [width, height] {
            return Err(Error::invalid("image", format!("{width}x{height} px"), format!("{:?}", image.size_px)));
        }
        values.extend_from_slice(&image.planes);
    }
    Ok(values)
}

pub(crate) fn to_json<T: Serialize>(value: &T) -> Result<String> {
    serde_json::to_string(value).map_err(|e| Error::invalid("metadata", "values JSON can hold", e.to_string()))
}

pub(crate) fn from_json<T: for<'a> Deserialize<'a>>(path: &Path, text: &str) -> Result<T> {
    serde_json::from_str(text)
        .map_err(|e| Error::invalid(path.display().to_string(), "metadata of this version", e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_model_embeds_as_before() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let sha256 = checkpoint.save(&path).unwrap();
        let saved = Model::load(&path, DeviceKind::Flex).unwrap();
        let kept = Model::new(checkpoint, sha256.clone(), DeviceKind::Flex).unwrap();
        assert_eq!(saved.sha256(), sha256);
        let image = TactileImage {
            size_px: [16, 12],
            planes: (0..3 * 16 * 12).map(|i| (i as f32 * 0.7).sin()).collect(),
            edge_share: 0.5,
        };
        let images = vec![image; 70];
        let rows = saved.embed_holes(&images).unwrap();
        assert_eq!(rows, kept.embed_holes(&images).unwrap());
        let first = crate::similarity::dot(&rows[..6], &rows[..6]);
        assert!((first - 1.0).abs() < 1e-5);
    }

    #[test]
    fn weights_of_half_precision_make_a_model_of_its_own_near_the_first() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let planes = (0..3 * 16 * 12).map(|i| (i as f32 * 0.7).sin()).collect();
        let image = [TactileImage { size_px: [16, 12], planes, edge_share: 0.5 }];
        let full = checkpoint.save(&path).unwrap();
        let expected = Model::load(&path, DeviceKind::Flex).unwrap().embed_holes(&image).unwrap();
        // Ten layers, each with errors of half a unit in the last of 11 or 8 digits, some of which cancel.
        for (precision, bound) in
            [(Precision::F16, 10.0 * 2.0_f32.powi(-11)), (Precision::Bf16, 10.0 * 2.0_f32.powi(-8))]
        {
            let identity = checkpoint.clone().with_weights(precision).unwrap().save(&path).unwrap();
            let (loaded, loaded_identity) = Checkpoint::load(&path).unwrap();
            assert!(loaded.weights == precision && loaded_identity == identity && identity != full);
            // Saved again, as `calibrate` does, it stays the model it was.
            assert_eq!(loaded.save(&path).unwrap(), identity);
            let rows = Model::load(&path, DeviceKind::Flex).unwrap().embed_holes(&image).unwrap();
            let largest = rows.iter().zip(&expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(largest > 0.0 && largest < bound, "{precision}: {largest}");
        }
    }

    #[test]
    fn weights_that_f16_cannot_hold_are_refused_by_name() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let mut checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let half = checkpoint.tensors.iter_mut().find(|tensor| tensor.name == "encoder.half.conv.weight").unwrap();
        half.values[7] = -70_000.0;
        let error = checkpoint.clone().with_weights(Precision::F16).unwrap_err().to_string();
        assert_eq!(error, "encoder.half.conv.weight: expected values in the range of f16, got -7e4");
        assert!(checkpoint.clone().with_weights(Precision::Bf16).is_ok());
        assert!(checkpoint.with_weights(Precision::I8).is_err());
    }
}
