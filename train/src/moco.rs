//! MoCo-v3 on pairs, on one page: hole and peg of one place are each other's positive.
//!
//! Two encoders: the trained one, with a predictor behind it, makes queries; a slowly following copy
//! makes keys. Holes and pegs of a batch go through the encoder together, so that the batch statistics
//! a network trains with are those it keeps: two passes, a side each, would normalise the sides apart
//! in training and together ever after.

use std::any::Any;
use std::collections::HashMap;

use burn::module::{Module, ModuleMapper, ModuleVisitor, Param};
use burn::optim::{GradientsParams, MultiGradientsParams};
use burn::tensor::{Device, Tensor};
use tactile_infer::encoder::{Encoder, Network, NetworkConfig, tensors_of, with_tensors};

use crate::error::Result;
use crate::info_nce::info_nce;

/// The trained network and its slowly following copy.
#[derive(Debug)]
pub struct Moco {
    /// Encoder and predictor, trained by gradients.
    pub online: Network,
    /// The key encoder: the online encoder's moving average, never touched by gradients.
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

    /// Loss and gradients of a batch: symmetrised InfoNCE, `l(q_hole, k_peg) + l(q_peg, k_hole)`.
    ///
    /// `shards` hold the batch in parts, each `(holes, pegs)` of `[n_s, 3, height, width]`, row `i` of
    /// one mating with row `i` of the other. Each part goes through the encoders by itself; the
    /// loss joins the parts at their embeddings, so that every pair of the batch is a negative of every
    /// other; and the gradient at the embeddings goes back through each part (gradient caching, Gao et al.
    /// 2021). The threads share the work inside a layer: burn's backward passes wait for each other. Batch statistics are those of a part. `mask`, `[n, n]` over the
    /// whole batch and symmetric, is [`info_nce`]'s.
    pub fn gradients(
        &self,
        shards: Vec<(Tensor<4>, Tensor<4>)>,
        temperature: f64,
        mask: Option<Tensor<2>>,
    ) -> (f64, MultiGradientsParams) {
        let embedded: Vec<Embedded> = shards.into_iter().map(|(holes, pegs)| self.embed(holes, pegs)).collect();
        let join = |side: usize, rows: fn(&Embedded) -> &Tensor<2>| {
            let halves = embedded.iter().map(|shard| {
                let n = rows(shard).dims()[0] / 2;
                rows(shard).clone().narrow(0, side * n, n) // holes, then pegs
            });
            Tensor::cat(halves.collect(), 0) // [n, dim]
        };
        let queries = [0, 1].map(|side| join(side, |shard| &shard.queries).detach().require_grad());
        let keys = [0, 1].map(|side| join(side, |shard| &shard.keys));
        let loss = symmetric_loss(&queries, &keys, temperature, mask);
        let value = f64::from(loss.clone().into_scalar::<f32>());
        let mut at_embeddings = loss.backward();

        let [holes, pegs] = queries.map(|rows| rows.grad_remove(&mut at_embeddings));
        let mut start = 0;
        let parts = embedded.into_iter().map(|shard| {
            let n = shard.queries.dims()[0] / 2;
            let slice = |rows: &Option<Tensor<2>>| rows.clone().map(|rows| rows.narrow(0, start, n));
            let gradient = [slice(&holes), slice(&pegs)].into_iter().flatten().collect();
            start += n;
            (shard.queries, Tensor::cat(gradient, 0))
        });
        let device = self.online.devices().into_iter().next().unwrap_or_default();
        let grads = parts.map(|(queries, gradient)| {
            let back = (queries * Tensor::from_inner(gradient)).sum().backward();
            (GradientsParams::from_grads(back, &self.online), device.clone())
        });
        (value, MultiGradientsParams { grads: grads.collect() })
    }

    /// Holes and pegs through both encoders in one pass each. `[n, 3, h, w]` twice -> `[2n, dim]` twice.
    fn embed(&self, holes: Tensor<4>, pegs: Tensor<4>) -> Embedded {
        let images = Tensor::cat(vec![holes, pegs], 0); // [2n, 3, h, w]
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
fn symmetric_loss(
    queries: &[Tensor<2>; 2],
    keys: &[Tensor<2>; 2],
    temperature: f64,
    mask: Option<Tensor<2>>,
) -> Tensor<1> {
    info_nce(queries[0].clone(), keys[1].clone(), temperature, mask.clone())
        + info_nce(queries[1].clone(), keys[0].clone(), temperature, mask)
}

/// The rows of one shard, holes then pegs.
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
                let moved = old.inner() * self.m + online.clone() * (1.0 - self.m);
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
    use tactile_infer::encoder::NamedTensor;

    const CONFIG: NetworkConfig = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };

    fn device() -> Device {
        DeviceKind::Flex.tensor_device().autodiff()
    }

    fn images(seed: f32, device: &Device) -> Tensor<4> {
        let values: Vec<f32> = (0..4 * 3 * 12 * 16).map(|i| (seed * i as f32).sin()).collect();
        Tensor::from_data(TensorData::new(values, [4, 3, 12, 16]), device)
    }

    fn parameters(encoder: &Encoder) -> Vec<NamedTensor> {
        tensors_of(encoder).into_iter().filter(|t| !t.name.contains("running_")).collect()
    }

    #[test]
    fn momentum_nought_copies_and_momentum_one_stays() {
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
    fn gradient(moco: &Moco, mut gradients: MultiGradientsParams) -> Vec<f32> {
        let weight = &moco.online.predictor;
        let id = burn::module::list_param_ids(weight)[0];
        let (gradient, _) = gradients.remove::<2>(id).unwrap();
        gradient.into_data().try_into_vec().unwrap()
    }

    #[test]
    fn gradients_through_a_shard_are_those_of_the_loss() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let (holes, pegs) = (images(0.13, &device), images(0.29, &device));
        let (value, gradients) = moco.gradients(vec![(holes.clone(), pegs.clone())], 0.2, None);
        // The same loss in one graph.
        let shard = moco.embed(holes, pegs);
        let half = |rows: &Tensor<2>, side: usize| rows.clone().narrow(0, side * 4, 4);
        let loss =
            symmetric_loss(&[0, 1].map(|s| half(&shard.queries, s)), &[0, 1].map(|s| half(&shard.keys, s)), 0.2, None);
        assert!((f64::from(loss.clone().into_scalar::<f32>()) - value).abs() < 1e-6);
        let whole = MultiGradientsParams {
            grads: vec![(GradientsParams::from_grads(loss.backward(), &moco.online), device.clone())],
        };
        let (cached, whole) = (gradient(&moco, gradients), gradient(&moco, whole));
        assert!(cached.iter().zip(&whole).all(|(a, b)| (a - b).abs() < 1e-5 * (1.0 + b.abs())));
        assert!(whole.iter().any(|g| g.abs() > 1e-4));
    }

    #[test]
    fn pairs_of_one_shard_are_negatives_of_the_others() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let shard = |seed| (images(seed, &device), images(seed + 0.1, &device));
        let (value, _) = moco.gradients(vec![shard(0.13), shard(0.29)], 0.2, None);
        let rows: Vec<Embedded> = [0.13, 0.29].map(shard).map(|(h, p)| moco.embed(h, p)).into();
        let side = |s: usize, of: fn(&Embedded) -> &Tensor<2>| {
            Tensor::cat(rows.iter().map(|r| of(r).clone().narrow(0, s * 4, 4)).collect(), 0)
        };
        let queries = [0, 1].map(|s| side(s, |r| &r.queries));
        let keys = [0, 1].map(|s| side(s, |r| &r.keys));
        let joined = f64::from(symmetric_loss(&queries, &keys, 0.2, None).into_scalar::<f32>());
        assert!((joined - value).abs() < 1e-5, "{joined} {value}");
    }

    #[test]
    fn no_gradient_reaches_the_copy() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let (_, gradients) = moco.gradients(vec![(images(0.13, &device), images(0.29, &device))], 0.2, None);
        let (gradients, _) = &gradients.grads[0];
        let ids = burn::module::list_param_ids(&moco.momentum);
        assert!(ids.iter().all(|id| gradients.get::<4>(*id).is_none()));
        assert!(gradients.len() > 20);
    }

    #[test]
    fn the_copy_keeps_its_own_statistics() {
        let device = device();
        let moco = Moco::new(&CONFIG, 1, &device).unwrap();
        let before = tensors_of(&moco.online.encoder);
        moco.momentum.forward(images(0.7, &device));
        moco.momentum.forward(images(0.7, &device));
        assert_eq!(before, tensors_of(&moco.online.encoder));
    }
}
