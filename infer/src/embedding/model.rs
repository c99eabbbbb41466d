//! A trained model ready to embed frames.

use std::path::Path;
use std::sync::Arc;

#[cfg(feature = "burn")]
use burn::tensor::{Device, Tensor, TensorData};
#[cfg(feature = "datasets")]
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::{Background, Frame, Preprocessing, TactileImage};

use crate::bank::similarity::{dot, normalize_rows};
use crate::calibration::Calibration;
use crate::calibration::match_odds::MatchOdds;
use crate::calibration::presence::PresenceOdds;
use crate::embedding::architecture::NetworkConfig;
use crate::embedding::checkpoint::{Checkpoint, Provenance};
use crate::embedding::device::DeviceKind;
use crate::embedding::encoder::Encoder;
#[cfg(feature = "burn")]
use crate::embedding::network::{Network, with_tensors};
use crate::error::{Error, Result};
use crate::maps::Maps;

/// Images embedded in one pass of the network; larger batches gain nothing on a CPU.
const BATCH: usize = 64;

/// A model ready to embed frames: f_HP's two towers.
#[derive(Debug)]
pub struct Model {
    towers: Towers,
    n_parameters: usize,
    config: NetworkConfig,
    preprocessing: Preprocessing,
    provenance: Provenance,
    /// The calibrations for touched holes and for touched pegs.
    calibrations: [Option<Calibration>; 2],
    /// The log-odds of a match, as these.
    match_odds: [Option<MatchOdds>; 2],
    presence: [Option<PresenceOdds>; 2],
    maps: Option<Maps>,
    sha256: Arc<str>,
}

/// How the network is computed.
#[derive(Debug)]
enum Towers {
    /// On the CPU, without tensors.
    Cpu(Box<Encoder>),
    /// By burn, on another device.
    #[cfg(feature = "burn")]
    Tensors { network: Box<Network>, device: Device },
}

impl Model {
    /// Loads a checkpoint onto the CPU. The embedding of the same frame is the same on each load.
    ///
    /// # Errors
    /// A file that cannot be read or is damaged, or weights that make no network.
    pub fn load(path: &Path) -> Result<Self> {
        Self::load_on(path, DeviceKind::default())
    }

    /// Loads a checkpoint onto a device.
    ///
    /// # Errors
    /// As [`Self::load`], and for a device that this build or machine does not have.
    pub fn load_on(path: &Path, device: DeviceKind) -> Result<Self> {
        let (checkpoint, sha256) = Checkpoint::load(path)?;
        Self::new(checkpoint, sha256, device).map_err(|error| error.within(path.display()))
    }

    /// A model from a checkpoint in memory; `sha256` is what [`Checkpoint::save`] returned.
    ///
    /// # Errors
    /// Weights that make no network or embed nothing, and a device that this build or machine does not have.
    pub fn new(checkpoint: Checkpoint, sha256: String, device: DeviceKind) -> Result<Self> {
        // Before any is allocated: a config may ask for terabytes that the file does not hold.
        let n_parameters: usize = checkpoint.tensors.iter().map(|tensor| tensor.values.len()).sum();
        let n_asked = checkpoint.config.n_weights_at_least();
        if n_asked > n_parameters {
            return Err(Error::invalid("network", format!("{n_asked} weights or more"), n_parameters.to_string()));
        }
        let towers = match device {
            DeviceKind::Flex => Towers::Cpu(Box::new(Encoder::new(&checkpoint.config, &checkpoint.tensors)?)),
            #[cfg(feature = "burn")]
            other => {
                let device = other.open()?;
                let network = with_tensors(checkpoint.config.init(0, &device), checkpoint.tensors)?;
                Towers::Tensors { network: Box::new(network), device }
            }
            #[cfg(not(feature = "burn"))]
            other => {
                return Err(Error::invalid("device", "flex in a build without the feature burn", other.to_string()));
            }
        };
        let model = Self {
            towers,
            n_parameters,
            config: checkpoint.config,
            preprocessing: checkpoint.preprocessing,
            provenance: checkpoint.provenance,
            calibrations: [checkpoint.calibration, checkpoint.peg_calibration],
            match_odds: checkpoint.match_odds,
            presence: checkpoint.presence,
            maps: None,
            sha256: sha256.into(),
        };
        model.check_embeds().map_err(|error| error.within("network"))?;
        Ok(model)
    }

    /// The same model with networks that draw a map of each touch: with banks that have maps of their parts
    /// ([`Bank::mosaics`](crate::Bank::mosaics)), which are loaded after this, places are found and parts are verified by them.
    ///
    /// # Errors
    /// Networks that see other pictures than the model.
    pub fn with_maps(self, maps: Maps) -> Result<Self> {
        let seen = maps.drawer().preprocessing();
        if *seen != self.preprocessing {
            let expected = format!("pictures as the model sees them, {:?}", self.preprocessing);
            return Err(Error::invalid("maps", expected, format!("{seen:?}")));
        }
        Ok(Self { maps: Some(maps), ..self })
    }

    /// What draws maps of touches and judges by them, where that was given.
    pub fn maps(&self) -> Option<&Maps> {
        self.maps.as_ref()
    }

    /// Refuses weights that embed nothing: of a few pairs of pictures as different as pictures are, stripes across and
    /// along, one pair must have two embeddings of unit length. None may be other than finite.
    fn check_embeds(&self) -> Result<()> {
        /// Widths of the stripes, pixels. The first pair is enough but for a network of a handful of units.
        const WIDTHS: [usize; 4] = [2, 1, 4, 8];
        for side in [Side::Hole, Side::Peg] {
            let mut tells = false;
            for width in WIDTHS {
                let rows = self.embed_side(&self.stripes(width), side)?;
                let (first, second) = rows.split_at(self.dim());
                // What cannot be brought to unit length is zero, or beyond what f32 can square.
                let is_unit = |row: &[f32]| (dot(row, row) - 1.0).abs() < 1e-3;
                tells = first != second && is_unit(first) && is_unit(second);
                if tells {
                    break;
                }
            }
            if !tells {
                let expected = "an embedding of each picture";
                return Err(Error::invalid(format!("weights of {side}s"), expected, "none, or one of all pictures"));
            }
        }
        Ok(())
    }

    /// Stripes of a width in pixels, across and along.
    fn stripes(&self, width_px: usize) -> [TactileImage; 2] {
        let size_px @ [columns, rows] = self.config.input_px;
        [1, columns].map(|step| {
            let value = |at: usize| if (at / step / width_px).is_multiple_of(2) { 1.0 } else { -1.0 };
            let in_plane = (0..3 * rows * columns).map(|at| if step == 1 { at % columns } else { at });
            TactileImage { size_px, planes: in_plane.map(value).collect(), edge_share: 1.0 }
        })
    }

    /// SHA-256 of the checkpoint but for its calibrations: banks are bound to it.
    pub fn sha256(&self) -> &Arc<str> {
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

    /// How far its cosines can be believed where this side is touched, where that was measured (`tactile-infer
    /// calibrate
    /// --side`).
    pub fn calibration(&self, side: Side) -> Option<&Calibration> {
        self.calibrations[usize::from(side == Side::Peg)].as_ref()
    }

    /// The log-odds of a match where this side is touched, where they were fitted. What is rare among holes says nothing of
    /// pegs: they are embedded by themselves.
    pub fn match_odds(&self, side: Side) -> Option<&MatchOdds> {
        self.match_odds[usize::from(side == Side::Peg)].as_ref()
    }

    /// The log-odds that a named part is there, where a side is touched and no verifier judges; `None` where they were not fitted.
    pub fn presence(&self, side: Side) -> Option<&PresenceOdds> {
        self.presence[usize::from(side == Side::Peg)].as_ref()
    }

    /// Sizes of the network.
    pub fn config(&self) -> &NetworkConfig {
        &self.config
    }

    /// Number of weights and running statistics.
    pub fn n_parameters(&self) -> usize {
        self.n_parameters
    }

    /// Length of an embedding.
    pub fn dim(&self) -> usize {
        self.config.dim
    }

    /// Prepares a sensor's no-contact frame for this model.
    pub fn background(&self, no_contact: &Frame) -> Result<Background> {
        Ok(Background::new(no_contact, &self.preprocessing)?)
    }

    /// Prepares the sensor at rest of a dataset for this model; its lamps, where they are known, are made up for.
    #[cfg(feature = "datasets")]
    pub fn background_of(&self, dataset: &Dataset) -> Result<Background> {
        Ok(dataset.background(&self.preprocessing)?)
    }

    /// Queries of hole images: `[n, dim]`, rows of unit length.
    ///
    /// # Errors
    /// Images of another size than the network's input, or values that are not finite.
    pub fn embed_holes(&self, images: &[TactileImage]) -> Result<Vec<f32>> {
        self.embed_side(images, Side::Hole)
    }

    /// Keys of peg images: `[n, dim]`, rows of unit length.
    ///
    /// # Errors
    /// As [`Self::embed_holes`].
    pub fn embed_pegs(&self, images: &[TactileImage]) -> Result<Vec<f32>> {
        self.embed_side(images, Side::Peg)
    }

    /// Images of touches of one side: queries of holes, keys of pegs. A bank's keys are compared with either.
    ///
    /// # Errors
    /// As [`Self::embed_holes`].
    pub fn embed_side(&self, images: &[TactileImage], side: Side) -> Result<Vec<f32>> {
        let mut rows = Vec::with_capacity(images.len() * self.dim());
        for batch in images.chunks(BATCH) {
            let planes = planes(batch, self.config.input_px)?;
            rows.extend(match (&self.towers, side) {
                (Towers::Cpu(encoder), Side::Hole) => encoder.query(&planes),
                (Towers::Cpu(encoder), Side::Peg) => encoder.key(&planes),
                #[cfg(feature = "burn")]
                (Towers::Tensors { network, device }, side) => {
                    let [width, height] = self.config.input_px;
                    let batch = Tensor::from_data(TensorData::new(planes, [batch.len(), 3, height, width]), device);
                    let embedded = match side {
                        Side::Hole => network.query(batch),
                        Side::Peg => network.key(batch),
                    };
                    let values = embedded.into_data().try_into_vec::<f32>();
                    values.map_err(|e| Error::invalid("embedding", "f32", format!("{e:?}")))?
                }
            });
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

#[cfg(all(test, feature = "burn"))]
mod tests {
    use super::*;
    use crate::bank::views::Views;
    use crate::embedding::precision::Precision;

    #[test]
    fn a_saved_model_embeds_as_before() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let sha256 = checkpoint.save(&path).unwrap();
        let saved = Model::load(&path).unwrap();
        let kept = Model::new(checkpoint, sha256.clone(), DeviceKind::Flex).unwrap();
        assert_eq!(**saved.sha256(), *sha256);
        let image = TactileImage {
            size_px: [16, 12],
            planes: (0..3 * 16 * 12).map(|i| (i as f32 * 0.7).sin()).collect(),
            edge_share: 0.5,
        };
        let images = vec![image; 70];
        let rows = saved.embed_holes(&images).unwrap();
        assert_eq!(rows, kept.embed_holes(&images).unwrap());
        let first = crate::bank::similarity::dot(&rows[..6], &rows[..6]);
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
        let expected = Model::load(&path).unwrap().embed_holes(&image).unwrap();
        // Ten layers, each with errors of half a unit in the last of 11 or 8 digits, some of which cancel.
        for (precision, bound) in
            [(Precision::F16, 10.0 * 2.0_f32.powi(-11)), (Precision::Bf16, 10.0 * 2.0_f32.powi(-8))]
        {
            let identity = checkpoint.clone().with_weights(precision).unwrap().save(&path).unwrap();
            let (loaded, loaded_identity) = Checkpoint::load(&path).unwrap();
            assert!(loaded.weights == precision && loaded_identity == identity && identity != full);
            // Saved again, as `calibrate` does, it stays the model it was.
            assert_eq!(loaded.save(&path).unwrap(), identity);
            let rows = Model::load(&path).unwrap().embed_holes(&image).unwrap();
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

    #[test]
    fn each_side_has_a_calibration_of_its_own_and_the_model_stays_itself() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let bare = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let of = |low_similarity: f32| Calibration {
            low_similarity,
            matched: None,
            between_sensors: None,
            steepness: None,
            own_by_edge: None,
            verifier: None,
            views: Views::Pegs,
            prior: None,
            n_holes: 60,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let identity = bare.save(&path).unwrap();
        let both = bare.clone().with_calibration(Side::Peg, of(0.02)).with_calibration(Side::Hole, of(0.03));
        for (checkpoint, [hole, peg]) in [
            (bare.clone(), [None, None]),
            (bare.clone().with_calibration(Side::Hole, of(0.03)), [Some(of(0.03)), None]),
            (bare.with_calibration(Side::Peg, of(0.02)), [None, Some(of(0.02))]),
            (both, [Some(of(0.03)), Some(of(0.02))]),
        ] {
            assert_eq!(checkpoint.save(&path).unwrap(), identity);
            let model = Model::load(&path).unwrap();
            assert_eq!(**model.sha256(), *identity);
            let is_of_pegs = peg.is_some();
            assert_eq!([Side::Hole, Side::Peg].map(|side| model.calibration(side).cloned()), [hole, peg]);
            // A file without a calibration for pegs has no entry of one: its bytes are those of before.
            let bytes = std::fs::read(&path).unwrap();
            let named = bytes.windows(15).any(|window| window == b"peg_calibration");
            assert_eq!(named, is_of_pegs);
        }
    }
    #[test]
    fn each_side_has_match_odds_of_its_own_and_the_model_stays_itself() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let bare = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let of = |offset: f64| MatchOdds {
            offset,
            steepness: 23.7,
            steepness_by_edge: 0.27,
            own_distance: 0.1 + 0.2,
            distance_by_own: 0.5,
            rarity_by_edge: -1e-3,
            usual_rarity: 0.0,
            rarity: (0..6).map(|i| (i as f32 * 0.7).sin()).collect(),
            n_touches: 1234,
            log_probability: 2.5,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("model.safetensors");
        let identity = bare.save(&path).unwrap();
        let of_hole = bare.clone().with_match_odds(Side::Hole, of(3.0));
        for (checkpoint, stored) in [
            (bare.clone(), [None, None]),
            (of_hole.clone(), [Some(3.0), None]),
            (bare.with_match_odds(Side::Peg, of(2.0)), [None, Some(2.0)]),
            (of_hole.with_match_odds(Side::Peg, of(2.0)), [Some(3.0), Some(2.0)]),
        ] {
            assert_eq!(checkpoint.save(&path).unwrap(), identity);
            let (read, sha256) = Checkpoint::load(&path).unwrap();
            assert_eq!((read.match_odds, sha256), (stored.map(|offset| offset.map(of)), identity.clone()));
            let model = Model::load(&path).unwrap();
            assert_eq!(**model.sha256(), *identity);
            let found = [Side::Hole, Side::Peg].map(|side| model.match_odds(side).cloned());
            assert_eq!(found, stored.map(|offset| offset.map(of)));
            // A file without match odds has no entry of them.
            let bytes = std::fs::read(&path).unwrap();
            let is_named = |name: &[u8]| bytes.windows(name.len()).any(|window| window == name);
            assert_eq!(is_named(b"\"match_odds"), stored[0].is_some());
            assert_eq!(is_named(b"peg_match_odds"), stored[1].is_some());
        }
    }
}
