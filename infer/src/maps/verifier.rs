//! Judges whether a touch was made at a pose of a part: what the touch's map shows is laid over the part's mosaic, and a small
//! network looks at both.
//!
//! An embedding says that a touch and a view are alike; where two parts differ by a tooth, it hardly changes. Here each place
//! of the touch is compared with the place of the part that it would lie on.

use serde::{Deserialize, Serialize};
use tactile_data::dataset::touch::{OUTLINE_REACH_MM, Side};
use tactile_data::pose::se2::Se2;

use super::mosaic::Mosaic;
use super::{DrawnMap, MapFile, side_value};
use crate::calibration::presence::{PresenceOdds, entry_of};
use crate::embedding::architecture::ConvLayer;
use crate::embedding::encoder::{Dense, Layer, Tensors};
use crate::error::{Error, Result};

/// Values of a place that is compared: distance, error, inside and contact of the touch; the same of the mosaic, and whether it
/// was seen; how far the distances differ, in errors; the side, and whether the mosaic is of that side, too.
pub const N_COMPARED: usize = 12;

/// The values of these that are of the mosaic: zeros where it shows nothing.
pub const OF_PART: std::ops::Range<usize> = 4..10;

/// Distances that differ by more errors than these count alike.
const MOST_ERRORS: f32 = 6.0;

/// The name that a verifier's tensors begin with.
pub(super) const PREFIX: &str = "verifier";

/// The sizes of a verifier.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VerifierConfig {
    /// Channels at the full size; twice, three and four times as many below.
    pub width: usize,
    /// No log-odds are more, either way, nats: one touch never settles it.
    pub bound: f64,
}

impl VerifierConfig {
    /// Refuses sizes that make no network.
    ///
    /// # Errors
    /// The sizes.
    pub fn validate(&self) -> Result<()> {
        let is_bound = self.bound > 0.0 && self.bound <= 100.0;
        if !(1..=256).contains(&self.width) || !is_bound {
            let expected = "1..=256 channels and a bound above 0 and up to 100 nats";
            return Err(Error::invalid("verifier", expected, format!("{self:?}")));
        }
        Ok(())
    }

    /// The convolutions, from the full size to an eighth.
    pub(super) fn layers(&self) -> Vec<ConvLayer> {
        let n = |times: usize| times * self.width;
        let layer =
            |n_in, n_out, stride, adds_input| ConvLayer { name: "", n_in, n_out, kernel: 3, stride, adds_input };
        vec![
            layer(N_COMPARED, n(1), 1, false),
            layer(n(1), n(2), 2, false),
            layer(n(2), n(2), 1, true),
            layer(n(2), n(3), 2, false),
            layer(n(3), n(3), 1, true),
            layer(n(3), n(4), 2, false),
        ]
    }

    /// Channels of the last.
    pub(super) fn n_last(&self) -> usize {
        4 * self.width
    }

    /// What the network says, within the bound.
    pub(super) fn bounded(&self, value: f64) -> f64 {
        self.bound * (value / self.bound).tanh()
    }
}

/// A touch laid over a mosaic at a pose: `[height, width, N_COMPARED]`, zeros where the mosaic shows nothing.
pub fn compared((touch, side): (&DrawnMap, Side), mosaic: &Mosaic<'_>, part_from_sensor: &Se2) -> Vec<f32> {
    let [width, height] = touch.size_px;
    let share = |share: f32| 2.0 * share - 1.0;
    let far = OUTLINE_REACH_MM as f32;
    let mut out = vec![0.0; width * height * N_COMPARED];
    for (out, (at, place_mm)) in out.as_chunks_mut::<N_COMPARED>().0.iter_mut().zip(touch.places_mm(1)) {
        let (mm, error) = (touch.distance_mm[at], touch.error_mm[at]);
        out[..OF_PART.start].copy_from_slice(&[
            mm / far,
            error.ln() + 1.0,
            share(touch.inside[at]),
            share(touch.contact[at]),
        ]);
        if let Some(there) = mosaic.at(part_from_sensor.apply(place_mm)) {
            let off = (there.distance_mm - mm) / (error * error + there.error_mm * there.error_mm).sqrt();
            let off = off.clamp(-MOST_ERRORS, MOST_ERRORS) / MOST_ERRORS;
            let own = [there.distance_mm / far, there.error_mm.ln() + 1.0, share(there.inside), share(there.contact)];
            out[OF_PART].copy_from_slice(&[own[0], own[1], own[2], own[3], 1.0, off]);
        }
        out[OF_PART.end] = side_value(side);
        out[OF_PART.end + 1] = if mosaic.side() == side { 1.0 } else { -1.0 };
    }
    out
}

/// Judges touches, on the CPU without tensors.
#[derive(Clone, Debug)]
pub struct Verifier {
    config: VerifierConfig,
    layers: Vec<Layer>,
    judge: Dense,
    presence: [Option<PresenceOdds>; 3],
    sha256: String,
}

/// By the weights and what was fitted with them.
impl PartialEq for Verifier {
    fn eq(&self, other: &Self) -> bool {
        (self.presence, &self.sha256) == (other.presence, &other.sha256)
    }
}

impl Verifier {
    /// The verifier of a file; `None` where it has only the network that draws.
    ///
    /// # Errors
    /// A tensor that is missing or of another size, values that are not finite, and variances below zero.
    pub fn new(file: &MapFile) -> Result<Option<Self>> {
        let Some(config) = file.verifier else { return Ok(None) };
        let tensors = Tensors::of(&file.tensors);
        let [width, height] = file.config.input_px;
        let (mut size, mut layers) = ([height, width], Vec::new());
        for (at, layer) in config.layers().iter().enumerate() {
            let layer = Layer::new(&tensors, &format!("{PREFIX}.layers.{at}"), layer, size)?;
            size = layer.out_size().0;
            layers.push(layer);
        }
        let judge = Dense::new(&tensors, &format!("{PREFIX}.judge"), None, [config.n_last(), 1], |at| at)?;
        let judge = judge.with_bias(tensors.get(&format!("{PREFIX}.judge.bias"), 1)?);
        Ok(Some(Self { config, layers, judge, presence: file.presence, sha256: file.weights_sha256() }))
    }

    /// The log-odds that a named part is there by what this says, where a side is touched and laid over mosaics of a side; `None`
    /// where they were not fitted.
    pub fn presence(&self, touched: Side, on: Side) -> Option<&PresenceOdds> {
        self.presence[entry_of(touched, on)].as_ref()
    }

    /// The checksum of its weights and of those that draw the maps, 64 hex digits.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// Its sizes.
    pub fn config(&self) -> &VerifierConfig {
        &self.config
    }

    /// Log-odds that a touch was made where it is laid, against elsewhere, nats, within the bound. `compared`:
    /// `[height, width, N_COMPARED]`.
    pub fn log_odds(&self, compared: &[f32]) -> f64 {
        let forward = |x: Option<Vec<f32>>, layer: &Layer| Some(layer.forward(x.as_deref().unwrap_or(compared)));
        let x = self.layers.iter().fold(None, forward).unwrap_or_default();
        let n = self.config.n_last();
        let n_places = (x.len() / n).max(1);
        let means: Vec<f32> = (0..n).map(|at| x.iter().skip(at).step_by(n).sum::<f32>() / n_places as f32).collect();
        self.config.bounded(self.judge.forward(&means).first().map_or(0.0, |value| f64::from(*value)))
    }
}

#[cfg(feature = "burn")]
pub mod network {
    //! The verifier as a burn module: for training.

    use burn::module::Module;
    use burn::nn::{Initializer, Linear, LinearConfig};
    use burn::tensor::{Device, Tensor};
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    use super::VerifierConfig;
    use crate::embedding::network::{ConvBn, DrawWeights};

    impl VerifierConfig {
        /// A verifier with weights drawn from `seed`.
        pub fn init(&self, seed: u64, device: &Device) -> VerifierNetwork {
            let layers = self.layers().iter().map(|layer| ConvBn::new(layer, device)).collect();
            let judge = LinearConfig::new(self.n_last(), 1).with_initializer(Initializer::Zeros).init(device);
            VerifierNetwork { layers, judge }.map(&mut DrawWeights { rng: ChaCha8Rng::seed_from_u64(seed) })
        }
    }

    /// The network.
    #[derive(Module, Debug)]
    pub struct VerifierNetwork {
        layers: Vec<ConvBn>,
        judge: Linear,
    }

    impl VerifierNetwork {
        /// `[n, height, width, N_COMPARED]` -> log-odds `[n]` within a bound.
        pub fn forward(&self, compared: Tensor<4>, bound: f64) -> Tensor<1> {
            let x = self.layers.iter().fold(compared, |x, layer| layer.forward_nhwc(x));
            let means = x.mean_dim(1).mean_dim(2).squeeze_dims::<2>(&[1, 2]);
            (self.judge.forward(means).flatten::<1>(0, 1) / bound).tanh() * bound
        }
    }
}

#[cfg(all(test, feature = "burn"))]
mod tests {
    use burn::tensor::{Tensor, TensorData};

    use super::super::mosaic::tests::{map, mosaics};
    use super::*;
    use crate::embedding::device::DeviceKind;
    use crate::embedding::network::{tensors_of, with_tensors};
    use crate::maps::{MapConfig, MapProvenance};
    use crate::safefile::NamedTensor;
    use tactile_data::frame::Preprocessing;

    #[test]
    fn a_judgement_is_the_burn_networks_but_for_rounding() {
        let (config, device) = (VerifierConfig { width: 5, bound: 4.0 }, DeviceKind::Flex.tensor_device());
        let mut tensors: Vec<NamedTensor> = tensors_of(&config.init(3, &device));
        for tensor in tensors.iter_mut().filter(|t| t.shape.len() == 1) {
            let is_variance = tensor.name.ends_with("var");
            for (i, value) in tensor.values.iter_mut().enumerate() {
                *value = if is_variance { 0.5 + 0.1 * i as f32 } else { (i as f32 + tensor.name.len() as f32).sin() };
            }
        }
        let network = with_tensors(config.init(4, &device), tensors.clone()).unwrap();
        tensors.iter_mut().for_each(|tensor| tensor.name = format!("{PREFIX}.{}", tensor.name));
        let mut file = MapFile {
            config: MapConfig { input_px: [21, 18], width: 4 },
            preprocessing: Preprocessing::counts([21, 18]),
            provenance: MapProvenance::default(),
            verifier: Some(config),
            presence: [None; 3],
            tensors,
        };
        let pictures: Vec<f32> = (0..3 * 18 * 21 * N_COMPARED).map(|i| (i as f32 * 0.37).sin()).collect();
        let verifier = Verifier::new(&file).unwrap().unwrap();
        let found: Vec<f64> = pictures.chunks_exact(18 * 21 * N_COMPARED).map(|one| verifier.log_odds(one)).collect();
        let tensor = Tensor::from_data(TensorData::new(pictures, [3, 18, 21, N_COMPARED]), &device);
        let expected = network.forward(tensor, config.bound).into_data().try_into_vec::<f32>().unwrap();
        assert_eq!(found.len(), 3);
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - f64::from(*expected)).abs() < 1e-4 && found.abs() < 4.0, "{found} {expected}");
        }
        file.verifier = None;
        assert!(Verifier::new(&file).unwrap().is_none());
        file.verifier = Some(VerifierConfig { width: 6, bound: 4.0 });
        assert!(Verifier::new(&file).unwrap_err().to_string().contains("verifier.layers.0"));
        assert!(VerifierConfig { width: 0, bound: 4.0 }.validate().is_err());
        assert!(VerifierConfig { width: 4, bound: f64::NAN }.validate().is_err());
    }

    #[test]
    fn what_is_compared_is_the_touch_and_what_it_lies_on() {
        let mosaics = mosaics();
        let truth = Se2::from_degrees(8.0, -1.2, 71.0);
        let touch = map(&truth, 0.1);
        let found = compared((&touch, Side::Hole), &mosaics.of(0, Side::Peg), &truth);
        assert_eq!(found.len(), 40 * 30 * N_COMPARED);
        let (mut n_seen, mut n_off) = (0, 0);
        for (at, place) in found.chunks_exact(N_COMPARED).enumerate() {
            assert_eq!((place[0], place[10]), (touch.distance_mm[at] / OUTLINE_REACH_MM as f32, -1.0));
            if place[8] == 0.0 {
                assert_eq!(place[4..10], [0.0; 6]);
                continue;
            }
            n_seen += 1;
            // Between pixels and cells a distance bends by a hundredth or two: a fifth of an error.
            n_off += usize::from((place[0] - place[4]).abs() > 0.02 || place[9].abs() > 0.1);
        }
        // The part was touched 6 mm about its middle.
        assert!(n_seen > 700 && n_seen < 1_200 && n_off < 40, "{n_seen} {n_off}");
        let moved = Se2::from_degrees(7.0, -1.2, 71.0);
        let off = compared((&touch, Side::Peg), &mosaics.of(0, Side::Peg), &moved);
        // A millimetre is seven errors where the outline lies across it.
        let n_moved = off.chunks_exact(N_COMPARED).filter(|place| place[9].abs() > 0.3).count();
        assert!(n_moved > 100, "{n_moved}");
    }
}
