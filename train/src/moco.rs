//! MoCo-v3 on pairs, on one page: hole and peg of one place are each other's positive.
//!
//! Two encoders: the trained one, followed by a predictor, makes queries; a copy that follows it slowly
//! makes keys. Holes and pegs of a batch go through the encoder together, so that training normalises both
//! with the same statistics, as the trained network does.

use std::any::Any;
use std::collections::HashMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::optim::{GradientsAccumulator, GradientsParams};
use burn::tensor::{Device, Tensor};
use tactile_infer::embedding::architecture::NetworkConfig;
use tactile_infer::embedding::network::{Encoder, Network, tensors_of, with_tensors};
use tactile_infer::safefile::NamedTensor;

use crate::error::Result;
use crate::info_nce::info_nce;

/// The trained network and its slowly following copy.
#[derive(Debug)]
pub struct Moco {
    /// Encoder and predictor, trained by gradients.
    pub online: Network,
    /// The key encoder: the online encoder's moving average, which receives no gradients.
    pub momentum: Encoder,
}

impl Moco {
    /// A fresh pair; the copy starts equal to the encoder it follows. `device` carries autodiff.
    pub fn new(config: &NetworkConfig, seed: u64, device: &Device) -> Result<Self> {
        let online = config.init(seed, device);
        // Not a clone: running statistics of a clone would be shared with the original.
        let momentum = config.init(seed, device).encoder;
        let momentum = with_tensors(momentum, tensors_of(&online.encoder))?.no_grad();
        Ok(Self { online, momentum })
    }

    /// A pair that starts from a trained network's tensors, by name.
    pub fn with_weights(self, tensors: &[NamedTensor]) -> Result<Self> {
        let online = with_tensors(self.online, tensors.to_vec())?;
        let momentum = with_tensors(self.momentum, tensors_of(&online.encoder))?.no_grad();
        Ok(Self { online, momentum })
    }

    /// Loss `[1]` and gradients of a batch: symmetrised InfoNCE, `l(q_hole, k_peg) + l(q_peg, k_hole)`.
    ///
    /// Each micro-batch is holes, then pegs, `[2 n_m, 3, height, width]`, row `i` of one half mating with row `i` of the
    /// other. It goes through the encoders by itself, with its own batch statistics; the loss joins all of them at
    /// their embeddings, so that every pair of the batch is a negative of every other; the gradient at the
    /// embeddings then goes back through each micro-batch (gradient caching, Gao et al. 2021).
    pub fn gradients(&self, micro_batches: Vec<Tensor<4>>, temperature: f64) -> (Tensor<1>, GradientsParams) {
        let embedded: Vec<Embedded> = micro_batches.into_iter().map(|images| self.embed(images)).collect();
        let join = |side: usize, rows: fn(&Embedded) -> &Tensor<2>| {
            let halves = embedded.iter().map(|part| {
                let n = rows(part).dims()[0] / 2;
                rows(part).clone().narrow(0, side * n, n) // holes, then pegs
            });
            Tensor::cat(halves.collect(), 0) // [n, dim]
        };
        let queries = [0, 1].map(|side| join(side, |part| &part.queries).detach().require_grad());
        let keys = [0, 1].map(|side| join(side, |part| &part.keys));
        let loss = symmetric_loss(&queries, &keys, temperature);
        let value = loss.clone().inner();
        let mut at_embeddings = loss.backward();

        let [holes, pegs] = queries.map(|rows| rows.grad_remove(&mut at_embeddings));
        // Summed here, in order: the optimizer would add several gradients in an order that differs between runs.
        let mut sum = GradientsAccumulator::new();
        let mut start = 0;
        for part in embedded {
            let n = part.queries.dims()[0] / 2;
            let slice = |rows: &Option<Tensor<2>>| rows.clone().map(|rows| rows.narrow(0, start, n));
            let gradient = Tensor::cat([slice(&holes), slice(&pegs)].into_iter().flatten().collect(), 0); // [2n, dim]
            start += n;
            let back = (part.queries * Tensor::from_inner(gradient)).sum().backward();
            sum.accumulate(&self.online, GradientsParams::from_grads(back, &self.online));
        }
        (value, sum.grads())
    }

    /// Holes and pegs through both encoders in one pass each. `[2n, 3, h, w]` -> `[2n, dim]` twice.
    fn embed(&self, images: Tensor<4>) -> Embedded {
        let keys = self.momentum.forward(images.clone()).detach();
        Embedded { queries: self.online.query(images), keys }
    }

    /// Moves the copy: `momentum = m * momentum + (1 - m) * online`, parameters only; running
    /// statistics follow their own batches.
    pub fn follow(self, m: f64) -> Self {
        let mut online = ByPath::default();
        self.online.encoder.visit(&mut online);
        let mut average = Average { m, online: online.tensors, path: Vec::new() };
        Self { momentum: self.momentum.map(&mut average), online: self.online }
    }
}

/// `l(q_hole, k_peg) + l(q_peg, k_hole)` of `[hole, peg]` rows.
fn symmetric_loss(queries: &[Tensor<2>; 2], keys: &[Tensor<2>; 2], temperature: f64) -> Tensor<1> {
    info_nce(queries[0].clone(), keys[1].clone(), temperature)
        + info_nce(queries[1].clone(), keys[0].clone(), temperature)
}

/// The rows of one micro-batch, holes then pegs.
struct Embedded {
    queries: Tensor<2>, // [2n, dim]
    keys: Tensor<2>,    // [2n, dim], detached
}

/// The float tensors of a module by their paths, of any rank.
#[derive(Default)]
struct ByPath {
    path: Vec<String>,
    tensors: HashMap<String, Box<dyn Any>>,
}

impl ModuleVisitor for ByPath {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn visit_float<const D: usize>(&mut self, param: &Param<Tensor<D>>) {
        self.tensors.insert(self.path.join("."), Box::new(param.val().inner()));
    }
}

/// `m slow + (1 - m) fast`.
fn moving_average<const D: usize>(slow: Tensor<D>, fast: Tensor<D>, m: f64) -> Tensor<D> {
    #[cfg(feature = "wgpu")]
    if tactile_infer::embedding::network::is_card(&slow.device()) {
        return crate::lamb::follow(slow, fast, 1.0 - m);
    }
    slow * m + fast * (1.0 - m)
}

struct Average {
    m: f64,
    online: HashMap<String, Box<dyn Any>>,
    path: Vec<String>,
}

impl ModuleMapper for Average {
    fn enter_module(&mut self, name: &str, _container_type: &str) {
        self.path.push(name.to_owned());
    }

    fn exit_module(&mut self, _name: &str, _container_type: &str) {
        self.path.pop();
    }

    fn map_float<const D: usize>(&mut self, param: Param<Tensor<D>>) -> Param<Tensor<D>> {
        let is_statistic = self.path.last().is_some_and(|name| name.starts_with("running_"));
        let online = self.online.get(&self.path.join(".")).and_then(|tensor| tensor.downcast_ref::<Tensor<D>>());
        match online {
            Some(online) if !is_statistic => param.map(|old| {
                let moved = moving_average(old.inner(), online.clone(), self.m);
                Tensor::from_inner(moved).set_require_grad(false)
            }),
            _ => param,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use burn::tensor::TensorData;
    use tactile_infer::DeviceKind;
    use tactile_infer::safefile::NamedTensor;

    const CONFIG: NetworkConfig = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };

    fn device() -> Device {
        DeviceKind::Flex.tensor_device().autodiff()
    }

    fn images(seed: f32, device: &Device) -> Tensor<4> {
        let values: Vec<f32> = (0..4 * 3 * 12 * 16).map(|i| (seed * i as f32).sin()).collect();
        Tensor::from_data(TensorData::new(values, [4, 3, 12, 16]), device)
    }

    fn number(tensor: Tensor<1>) -> f64 {
        f64::from(tensor.into_scalar::<f32>())
    }

    fn parameters(encoder: &Encoder) -> Vec<NamedTensor> {
        tensors_of(encoder).into_iter().filter(|t| !t.name.contains("running_")).collect()
    }

    #[test]
    fn momentum_zero_copies_and_momentum_one_stays() {
        let device = device();
        let mut moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let start = parameters(&moco.momentum);
        assert_eq!(start, parameters(&moco.online.encoder));
        moco.online = CONFIG.init(2, &device);
        let stayed = moco.follow(1.0);
        assert_eq!(parameters(&stayed.momentum), start);
        let copied = stayed.follow(0.0);
        assert_eq!(parameters(&copied.momentum), parameters(&copied.online.encoder));
    }

    #[test]
    fn half_way_is_the_mean() {
        let device = device();
        let mut moco = Moco::new(&CONFIG, 1, &device).unwrap();
        moco.online = CONFIG.init(2, &device);
        let (old, new) = (parameters(&moco.momentum), parameters(&moco.online.encoder));
        let moved = parameters(&moco.follow(0.5).momentum);
        for ((old, new), moved) in old.iter().zip(&new).zip(&moved) {
            for ((a, b), c) in old.values.iter().zip(&new.values).zip(&moved.values) {
                assert!((0.5 * (a + b) - c).abs() < 1e-6, "{}", old.name);
            }
        }
    }

    /// The gradient of one parameter, by its name.
    fn gradient(moco: &Moco, gradients: &GradientsParams) -> Vec<f32> {
        let weight = &moco.online.predictor;
        let id = burn::module::list_param_ids(weight)[0];
        gradients.get::<2>(id).unwrap().into_data().try_into_vec().unwrap()
    }

    #[test]
    fn gradients_through_a_micro_batch_are_those_of_the_loss() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let both = Tensor::cat(vec![images(0.13, &device), images(0.29, &device)], 0);
        let (value, gradients) = moco.gradients(vec![both.clone()], 0.2);
        // The same loss in one graph.
        let part = moco.embed(both);
        let half = |rows: &Tensor<2>, side: usize| rows.clone().narrow(0, side * 4, 4);
        let loss = symmetric_loss(&[0, 1].map(|s| half(&part.queries, s)), &[0, 1].map(|s| half(&part.keys, s)), 0.2);
        assert!((f64::from(loss.clone().into_scalar::<f32>()) - number(value)).abs() < 1e-6);
        let whole = GradientsParams::from_grads(loss.backward(), &moco.online);
        let (cached, whole) = (gradient(&moco, &gradients), gradient(&moco, &whole));
        assert!(cached.iter().zip(&whole).all(|(a, b)| (a - b).abs() < 1e-5 * (1.0 + b.abs())));
        assert!(whole.iter().any(|g| g.abs() > 1e-4));
    }

    #[test]
    fn pairs_of_one_micro_batch_are_negatives_of_the_others() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let part = |seed| Tensor::cat(vec![images(seed, &device), images(seed + 0.1, &device)], 0);
        let (value, _) = moco.gradients(vec![part(0.13), part(0.29)], 0.2);
        let rows: Vec<Embedded> = [0.13, 0.29].map(part).map(|both| moco.embed(both)).into();
        let side = |s: usize, of: fn(&Embedded) -> &Tensor<2>| {
            Tensor::cat(rows.iter().map(|r| of(r).clone().narrow(0, s * 4, 4)).collect(), 0)
        };
        let queries = [0, 1].map(|s| side(s, |r| &r.queries));
        let keys = [0, 1].map(|s| side(s, |r| &r.keys));
        let joined = f64::from(symmetric_loss(&queries, &keys, 0.2).into_scalar::<f32>());
        let value = number(value);
        assert!((joined - value).abs() < 1e-5, "{joined} {value}");
    }

    #[test]
    fn no_gradient_reaches_the_copy() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let (_, gradients) =
            moco.gradients(vec![Tensor::cat(vec![images(0.13, &device), images(0.29, &device)], 0)], 0.2);
        assert!(crate::gradient::norm(&moco.momentum, &gradients).is_none());
        assert!(crate::gradient::norm(&moco.online, &gradients).is_some_and(|norm| number(norm) > 0.0));
    }

    #[test]
    fn the_copy_keeps_its_own_statistics() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let statistics = |encoder: &Encoder| tensors_of(&encoder.valid());
        let before = statistics(&moco.online.encoder);
        assert_eq!(before, statistics(&moco.momentum));
        moco.momentum.forward(images(0.7, &device));
        moco.momentum.forward(images(0.7, &device));
        assert_eq!(before, statistics(&moco.online.encoder));
        assert_ne!(before, statistics(&moco.momentum));
    }
}
