//! Trains the network that judges whether a touch was made at a pose of a part ([`tactile_infer::maps::verifier`]): touches of
//! known parts, laid where they were made, where the likeliest views of other parts are, and on look-alikes of their own part.

use std::sync::Arc;

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::TactileImage;
use tactile_data::pose::se2::{Se2, wrap_angle};
use tactile_infer::calibration::fit::N_PARTS;
use tactile_infer::embedding::network::tensors_of;
use tactile_infer::maps::align::{Drawing, Start, align};
use tactile_infer::maps::mosaic::Mosaics;
use tactile_infer::maps::verifier::network::VerifierNetwork;
use tactile_infer::maps::verifier::{N_COMPARED, VerifierConfig};
use tactile_infer::maps::{DrawnMap, MapDrawer, MapFile};
use tactile_infer::{Bank, DeviceKind, Model};

use crate::error::{Error, Result};
use crate::laid::{End, Laid};
use crate::look_alikes::{N_LOOK_ALIKES, with_look_alikes};
use crate::output_folder::OutputFolder;
use crate::training::{Trained, Training, Watch, surprise};

/// One in so many groups of parts is held out.
const HELD_OUT: usize = 5;

/// The likeliest views of a part that a touch is laid on, and of all parts but its own.
const N_OF_PART: usize = 3;
const N_OTHERS: usize = 8;

/// Views of a part that are both tried are so far apart, mm and degrees.
const APART: (f64, f64) = (3.0, 30.0);

/// A touch is where it was made to this, mm and degrees.
const THERE: (f64, f64) = (1.0, 8.0);

/// How far a belief's pose is from the truth before it is aligned, standard deviations, mm and degrees.
const START: [f64; 2] = [1.0, 6.0];

/// Sets the draws of look-alikes apart.
const LOOK_ALIKES: u64 = 0x6c6f_6f6b_616c_696b;

/// Starts at the own pose.
const N_OWN: usize = 2;

/// The network that judges, and how much it is trained: a touch of a step is laid on some ten views.
pub type VerifierTraining = Training<VerifierConfig>;

/// How well touches are judged of parts that were not trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct VerifierJudgement {
    /// Mean cost of the log-odds, nats: half of a match, half of the views of other parts.
    pub nats: f64,
    /// How often the own pose is judged likelier than the likeliest of other parts, and how often its cosine is larger.
    pub right: f64,
    /// The same by the cosine of the embeddings alone.
    pub right_by_cosine: f64,
    /// The chance that the likeliest of all views of a part that is there is judged likelier than of one that is not.
    pub told_apart: f64,
}

/// A touch, and the views that it is laid on.
#[derive(Clone, Debug)]
struct Sample {
    bank: usize,
    side: Side,
    /// Whose mosaics.
    on: Side,
    map: Arc<DrawnMap>,
    laid: Vec<Laid>,
    is_held_out: bool,
}

/// Touches of known parts, laid on the mosaics of banks.
#[derive(Debug)]
pub struct LaidTouches<'a> {
    model: &'a Model,
    drawer: &'a MapDrawer,
    seed: u64,
    /// Each bank's: those of its parts, and of their look-alikes.
    mosaics: Vec<Mosaics>,
    samples: Vec<Sample>,
}

/// A touch before it is laid on views.
struct Touch<'a> {
    bank: &'a Bank,
    mosaics: &'a Mosaics,
    map: Arc<DrawnMap>,
    query: Vec<f32>,
    part: usize,
    part_from_sensor: Se2,
}

impl<'a> LaidTouches<'a> {
    /// None yet. `seed` draws how far the belief's poses are from the truth.
    pub fn new(model: &'a Model, drawer: &'a MapDrawer, seed: u64) -> Self {
        Self { model, drawer, seed, mosaics: Vec::new(), samples: Vec::new() }
    }

    /// Draws the touches of datasets and lays them on a bank's parts: on its own, and on the likeliest of the others among its
    /// twelve, the bank's first twelve, the next twelve, and so on. `progress`: touches done, and all.
    ///
    /// # Errors
    /// A bank without mosaics, touches of parts that it lacks or without their poses.
    pub fn add(&mut self, bank: &Bank, datasets: &[Dataset], progress: &(dyn Fn(usize, usize) + Sync)) -> Result<()> {
        let Some(mosaics) = bank.mosaics() else {
            return Err(Error::invalid("bank", "one with a map of each part (tactile-infer bank --maps)", "another"));
        };
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ LOOK_ALIKES);
        rng.set_stream(self.mosaics.len() as u64);
        self.mosaics.push(with_look_alikes(mosaics, &mut rng)?);
        let n_all = datasets.iter().map(Dataset::len).sum();
        let mut done = 0;
        for dataset in datasets {
            let background = self.model.background_of(dataset)?;
            let frames: Vec<usize> = (0..dataset.len()).collect();
            for frames in frames.chunks(256) {
                let see = |frame: &usize| background.tactile_image(&dataset.frame(*frame));
                let images = frames.par_iter().map(see).collect::<tactile_data::Result<Vec<_>>>()?;
                let of_frame =
                    |(frame, image): (&usize, &TactileImage)| self.samples_of(bank, (dataset, *frame), image);
                let samples: Vec<Vec<Sample>> = frames.par_iter().zip(&images).map(of_frame).collect::<Result<_>>()?;
                self.samples.extend(samples.into_iter().flatten());
                done += frames.len();
                progress(done, n_all);
            }
        }
        Ok(())
    }

    /// One frame of a dataset, on the mosaics of its own side and on those of pegs.
    fn samples_of(
        &self,
        bank: &Bank,
        (dataset, frame): (&Dataset, usize),
        image: &TactileImage,
    ) -> Result<Vec<Sample>> {
        let (touch, name) = (dataset.touch(frame), &dataset.meta().name);
        let known = touch.part.as_ref().and_then(|part| bank.parts().iter().position(|name| name == part));
        let (Some(part), Some(part_from_sensor), Some(side)) = (known, touch.part_from_sensor, touch.side) else {
            let expected = "a part of the bank, a side and a pose";
            return Err(Error::invalid(format!("{name}: index row {frame}"), expected, format!("{touch:?}")));
        };
        let image = std::slice::from_ref(image);
        let query = self.model.embed_side(image, side)?;
        let map = self.drawer.draw(image, side, dataset.meta().field_of_view_mm())?.pop();
        let map = map.ok_or_else(|| Error::invalid(format!("{name}: frame {frame}"), "a map", "none"))?;
        let (bank_index, is_held_out) = (self.mosaics.len() - 1, part / N_PARTS % HELD_OUT == HELD_OUT - 1);
        let mut rng = ChaCha8Rng::seed_from_u64(self.seed ^ dataset.meta().seed.unwrap_or_default());
        rng.set_stream(((bank_index as u64) << 40) + frame as u64);
        let mosaics = &self.mosaics[bank_index];
        let touch = Touch { bank, mosaics, map: Arc::new(map), query, part, part_from_sensor };
        let mut on: Vec<Side> = [Side::Peg, side].into_iter().filter(|on| mosaics.sides().contains(on)).collect();
        on.dedup();
        let sample = |on: Side| {
            let laid = self.lay(&touch, on, &mut rng);
            Sample { bank: bank_index, side, on, map: touch.map.clone(), laid, is_held_out }
        };
        Ok(on.into_iter().map(sample).collect())
    }

    /// Where a touch is laid: on the likeliest views of the other parts, twice near its own pose, and there on look-alikes of its
    /// part, each moved to where its distances fit best.
    fn lay(&self, touch: &Touch<'_>, on: Side, rng: &mut ChaCha8Rng) -> Vec<Laid> {
        let Touch { bank, mosaics, map, query, part: own, part_from_sensor: pose } = touch;
        let mut cosines = Vec::new();
        bank.similarities(query, &mut cosines);
        let first = own / N_PARTS * N_PARTS;
        let group = first..(first + N_PARTS).min(bank.parts().len());
        let of_part = |part| likeliest(bank, &cosines, part).into_iter().map(move |at| (part, at));
        let mut views: Vec<(usize, View)> = group.filter(|part| part != own).flat_map(of_part).collect();
        views.sort_unstable_by(|a, b| b.1.cosine.total_cmp(&a.1.cosine));
        views.truncate(N_OTHERS);
        let cosine = bank.cosine_at(query, *own, pose).unwrap_or(-1.0);
        // About normal: the sum of three.
        let mut off = |sd: f64| sd * (0..3).map(|_| rng.random_range(-1.0..1.0)).sum::<f64>();
        let first = bank.parts().len() + own * N_LOOK_ALIKES;
        let near = std::iter::repeat_n(*own, N_OWN).chain(first..first + N_LOOK_ALIKES);
        views.extend(near.map(|part| {
            let [x, y, deg] = [off(START[0]), off(START[0]), off(START[1])];
            let start = Se2::new(pose.x_mm + x, pose.y_mm + y, pose.theta_rad + deg.to_radians());
            // What embeddings say of a look-alike nobody asked.
            let cosine = if part == *own { cosine } else { -1.0 };
            (part, View { cosine, pose: start })
        }));
        let lay = |(part, View { cosine, pose: start }): (usize, View)| {
            let touch = Drawing { map, first_from_sensor: Se2::IDENTITY };
            let start = Start::known_to(start, START);
            let part_from_sensor = align(&[touch], &mosaics.of(part, on), &start).part_from_first;
            Laid { part, part_from_sensor, is_own: part == *own, cosine, end: End::drawn(rng) }
        };
        // What went astray from its own pose says nothing, nor does a look-alike where it is like the part.
        let own_map = mosaics.of(*own, on);
        let says = |laid: &Laid| match laid.part {
            part if part == *own => is_near(&laid.part_from_sensor, pose, THERE),
            part if part >= first => laid.differs(map, (&mosaics.of(part, on), &own_map), pose),
            _ => true,
        };
        views.into_iter().map(lay).filter(says).collect()
    }

    /// The touches of parts that are trained on, and of those that are held out, each with a view of its own and of another.
    fn split(&self) -> Result<[Vec<usize>; 2]> {
        let has = |sample: &Sample, is_own: bool| sample.laid.iter().any(|laid| laid.is_own == is_own);
        let usable =
            (0..self.samples.len()).filter(|at| has(&self.samples[*at], true) && has(&self.samples[*at], false));
        let (held_out, trained): (Vec<usize>, Vec<usize>) = usable.partition(|at| self.samples[*at].is_held_out);
        if trained.is_empty() || held_out.is_empty() {
            let expected = format!("of {} groups of {N_PARTS} parts or more, with their holes", HELD_OUT);
            return Err(Error::invalid("touches", expected, format!("{} touches", self.samples.len())));
        }
        Ok([trained, held_out])
    }

    /// Some touches, each on all of its views: what is compared `[n, height, width, N_COMPARED]`, and of each whether it is the
    /// own pose and how much it counts: half of a touch is its own pose, half the others.
    fn batch(&self, samples: &[usize]) -> Compared {
        let of_sample = |at: &usize| {
            let Sample { bank, side, on, map, laid, .. } = &self.samples[*at];
            let n_own = laid.iter().filter(|laid| laid.is_own).count();
            let pictures: Vec<f32> = laid
                .iter()
                .flat_map(|laid| laid.compared((map, *side), &self.mosaics[*bank].of(laid.part, *on)))
                .collect();
            let n_others = laid.len() - n_own;
            let says: Vec<[f32; 2]> = laid
                .iter()
                .map(|laid| if laid.is_own { [1.0, 0.5 / n_own as f32] } else { [0.0, 0.5 / n_others as f32] })
                .collect();
            (pictures, says)
        };
        let (pictures, says): (Vec<_>, Vec<_>) = samples.par_iter().map(of_sample).unzip();
        Compared { n_touches: samples.len(), pictures: pictures.concat(), says: says.concat() }
    }
}

/// A view of a part, and how like it a touch is.
#[derive(Clone, Copy)]
struct View {
    cosine: f32,
    pose: Se2,
}

/// The likeliest views of a part, apart from each other.
fn likeliest(bank: &Bank, cosines: &[f32], part: usize) -> Vec<View> {
    let (grid, n) = (bank.grid(), bank.grid().len());
    let of_part = &cosines[part * n..(part + 1) * n];
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_unstable_by(|a, b| of_part[*b].total_cmp(&of_part[*a]).then(a.cmp(b)));
    let mut found: Vec<View> = Vec::with_capacity(N_OF_PART);
    for cell in order {
        let pose = grid.pose(cell);
        if found.len() == N_OF_PART {
            break;
        }
        if !found.iter().any(|view| is_near(&view.pose, &pose, APART)) {
            found.push(View { cosine: of_part[cell], pose });
        }
    }
    found
}

/// Whether two poses are so near, mm and degrees.
fn is_near(a: &Se2, b: &Se2, (mm, deg): (f64, f64)) -> bool {
    a.distance_mm(b) < mm && wrap_angle(a.theta_rad - b.theta_rad).to_degrees().abs() < deg
}

/// Touches on their views.
struct Compared {
    n_touches: usize,
    /// `[n, height, width, N_COMPARED]`.
    pictures: Vec<f32>,
    /// `[n]`: whether it is the own pose, and how much it counts.
    says: Vec<[f32; 2]>,
}

impl Compared {
    fn says(&self, device: &Device) -> [Tensor<1>; 2] {
        [0, 1].map(|which| {
            let values: Vec<f32> = self.says.iter().map(|says| says[which]).collect();
            Tensor::from_data(TensorData::new(values, [self.says.len()]), device)
        })
    }

    fn pictures(&self, [width, height]: [usize; 2], device: &Device) -> Tensor<4> {
        let shape = [self.says.len(), height, width, N_COMPARED];
        Tensor::from_data(TensorData::new(self.pictures.clone(), shape), device)
    }
}

/// The mean cost of log-odds, nats.
fn loss(odds: Tensor<1>, [is_own, weights]: [Tensor<1>; 2], n_touches: usize) -> Tensor<1> {
    (surprise(odds, is_own) * weights).sum() / n_touches as f64
}

/// The inputs of a run and its output folder.
#[derive(Clone, Copy, Debug)]
pub struct VerifierRun<'a> {
    /// What is trained on.
    pub touches: &'a LaidTouches<'a>,
    /// The network that draws maps; the verifier is saved with it.
    pub maps: &'a MapFile,
    /// How.
    pub training: &'a VerifierTraining,
    /// Where to compute.
    pub device: DeviceKind,
    /// Folder for `maps.safetensors`.
    pub out: &'a OutputFolder,
}

/// How a run ended.
pub type VerifierOutcome = Trained<VerifierJudgement>;

/// Trains on the touches of parts that are not held out. `should_stop` and `on_step` as of
/// [`train_maps`](crate::maps::train_maps).
///
/// # Errors
/// A folder with maps in it, too few parts, a loss that is not finite, a file that cannot be written.
pub fn train_verifier(
    run: &VerifierRun<'_>,
    should_stop: &dyn Fn() -> bool,
    on_step: &mut dyn FnMut(usize, f64, Option<VerifierJudgement>),
) -> Result<VerifierOutcome> {
    let VerifierRun { touches, maps, training, device, out } = *run;
    training.network.validate()?;
    let file = out.new_maps()?;
    let [trained, held_out] = touches.split()?;
    let device = device.open()?.autodiff();
    let network = training.network.init(training.seed, &device);
    let (size_px, bound) = (touches.drawer.config().input_px, training.network.bound);
    let cost = |network: &VerifierNetwork, step: usize| {
        let mut rng = ChaCha8Rng::seed_from_u64(training.seed);
        rng.set_stream(step as u64);
        let drawn: Vec<usize> = (0..training.batch).map(|_| trained[rng.random_range(0..trained.len())]).collect();
        let batch = touches.batch(&drawn);
        let odds = network.forward(batch.pictures(size_px, &device), bound);
        Ok(Some(loss(odds, batch.says(&device), batch.n_touches)))
    };
    let save = |network: &VerifierNetwork, _: usize| -> Result<VerifierJudgement> {
        let network = network.valid();
        let judgement = judge(&network, touches, &held_out, bound, &device.clone().inner());
        maps.with_verifier(training.network, tensors_of(&network)).save(&file)?;
        Ok(judgement)
    };
    let (step, judgement) = training.run(network, cost, save, Watch { should_stop, on_step })?;
    Ok(VerifierOutcome { file: file.clone(), step, judgement })
}

/// Looks at touches of held-out parts.
fn judge(
    network: &VerifierNetwork,
    touches: &LaidTouches<'_>,
    samples: &[usize],
    bound: f64,
    device: &Device,
) -> VerifierJudgement {
    let mut sums = VerifierJudgement::default();
    let (mut present, mut absent) = (Vec::new(), Vec::new());
    for some in samples.chunks(16) {
        let batch = touches.batch(some);
        let odds = network.forward(batch.pictures(touches.drawer.config().input_px, device), bound);
        let cost = loss(odds.clone(), batch.says(device), batch.n_touches);
        sums.nats += f64::from(cost.into_scalar::<f32>()) * some.len() as f64;
        // f32 by construction.
        let odds = odds.into_data().try_into_vec::<f32>().unwrap_or_default();
        let mut at = 0;
        for sample in some {
            let laid = &touches.samples[*sample].laid;
            let most = |is_own: bool, value: &dyn Fn(usize) -> f32| {
                let of = laid.iter().enumerate().filter(|(_, laid)| laid.is_own == is_own);
                of.map(|(i, _)| value(i)).fold(f32::NEG_INFINITY, f32::max)
            };
            let says = |i: usize| odds[at + i];
            let cosine = |i: usize| laid[i].cosine;
            let [own, other] = [true, false].map(|is_own| most(is_own, &says));
            sums.right += f64::from(u8::from(own > other));
            sums.right_by_cosine += f64::from(u8::from(most(true, &cosine) > most(false, &cosine)));
            present.push(own.max(other));
            absent.push(other);
            at += laid.len();
        }
    }
    let n = samples.len().max(1) as f64;
    VerifierJudgement {
        nats: sums.nats / n,
        right: sums.right / n,
        right_by_cosine: sums.right_by_cosine / n,
        told_apart: told_apart(&present, &mut absent),
    }
}

/// How often one of the first is above one of the second; equal ones count half.
fn told_apart(present: &[f32], absent: &mut [f32]) -> f64 {
    absent.sort_unstable_by(f32::total_cmp);
    let below = |value: f32| absent.partition_point(|other| *other < value);
    let up_to = |value: f32| absent.partition_point(|other| *other <= value);
    let sum: usize = present.iter().map(|value| below(*value) + up_to(*value)).sum();
    sum as f64 / (2 * present.len() * absent.len()).max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loss_agrees_with_hand_arithmetic() {
        let device = DeviceKind::Flex.tensor_device();
        let tensor = |values: &[f32]| Tensor::<1>::from_data(TensorData::new(values.to_vec(), [values.len()]), &device);
        let found = loss(tensor(&[2.0, 0.0, -1.0]), [tensor(&[1.0, 0.0, 0.0]), tensor(&[0.5, 0.25, 0.25])], 1);
        let expected = 0.5 * (1.0 + (-2.0_f64).exp()).ln() + 0.25 * 2.0_f64.ln() + 0.25 * (1.0 + (-1.0_f64).exp()).ln();
        assert!((f64::from(found.into_scalar::<f32>()) - expected).abs() < 1e-6);
    }

    #[test]
    fn what_is_there_is_told_from_what_is_not_by_how_often_it_is_larger() {
        assert_eq!(told_apart(&[3.0, 4.0], &mut [1.0, 2.0]), 1.0);
        // 2 is above 1 and below 3, 3 is above 1 and as large as 3.
        assert_eq!(told_apart(&[2.0, 3.0], &mut [3.0, 1.0]), (1.0 + 0.0 + 1.0 + 0.5) / 4.0);
    }
}
