//! Trains the network that draws a touch's map: from the touch's picture, as the encoder sees it, to what the simulator knows is
//! in view ([`tactile_data::sensor::touch_map`]).

use std::sync::mpsc::{SyncSender, sync_channel};

use burn::module::Module;
use burn::tensor::{Device, Tensor, TensorData};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::prelude::*;
use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::OUTLINE_REACH_MM;
use tactile_data::frame::{Background, Preprocessing};
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::Simulator;
use tactile_data::sensor::touch_map::TouchMaps;
use tactile_infer::embedding::network::tensors_of;
use tactile_infer::maps::network::MapNetwork;
use tactile_infer::maps::{Drawn, LOG_ERRORS, MapConfig, MapFile, MapProvenance, N_DRAWN, N_SEEN, side_value};
use tactile_infer::{Checkpoint, DeviceKind};

use crate::error::{Error, Result};
use crate::other_light::OtherLight;
use crate::output_folder::{MAPS, OutputFolder};
use crate::training::{Trained, Training, Watch, surprise};

/// Frames of held-out boards that progress is measured on.
const N_JUDGED: usize = 512;

/// The network that draws, and how much it is trained.
pub type MapTraining = Training<MapConfig>;

/// How well maps are drawn of boards that were not trained on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct MapJudgement {
    /// Mean error of the distance where it is less than the farthest, mm.
    pub distance_mm: f64,
    /// Share of places whose side of the outline is right.
    pub inside: f64,
    /// Share of places where contact is right.
    pub contact: f64,
    /// Mean of the loss, nats a place.
    pub nats: f64,
}

/// The touches of a dataset with their maps.
struct Touches<'a> {
    dataset: &'a Dataset,
    background: Background,
    maps: TouchMaps<'a>,
    /// The part of each frame, in the simulator.
    parts: Vec<usize>,
    preprocessing: Preprocessing,
}

/// Pictures and what is to be drawn of them.
struct MapBatch {
    n: usize,
    /// `[n, N_SEEN, height, width]`.
    images: Vec<f32>,
    /// `[n, height, width, 3]`: distance, inside, contact.
    targets: Vec<f32>,
}

impl<'a> Touches<'a> {
    fn new(dataset: &'a Dataset, simulator: &'a Simulator, preprocessing: Preprocessing) -> Result<Self> {
        let part = |frame: usize| {
            let touch = dataset.touch(frame);
            let part = touch.part.as_ref().and_then(|part| simulator.parts().iter().position(|name| name == part));
            part.filter(|_| touch.side.is_some() && touch.part_from_sensor.is_some()).ok_or_else(|| {
                let expected = "a part of the scene, a side and a pose";
                Error::invalid(format!("{}: frame {frame}", dataset.meta().name), expected, format!("{touch:?}"))
            })
        };
        let parts = (0..dataset.len()).map(part).collect::<Result<_>>()?;
        let background = dataset.background(&preprocessing)?;
        Ok(Self { dataset, background, maps: TouchMaps::new(simulator), parts, preprocessing })
    }

    /// The frames of boards that are trained on, and some of those that are held out.
    fn split(&self) -> Result<[Vec<usize>; 2]> {
        let meta = self.dataset.meta();
        let is_held_out =
            |frame: &usize| self.dataset.touch(*frame).part.as_ref().is_some_and(|part| meta.held_out.contains(part));
        let (held_out, trained): (Vec<usize>, Vec<usize>) = (0..self.dataset.len()).partition(is_held_out);
        if trained.is_empty() || held_out.is_empty() {
            let got = format!("{:?}", meta.held_out);
            return Err(Error::invalid(&meta.name, "boards to train on and boards held out", got));
        }
        Ok([trained, held_out.iter().step_by(held_out.len().div_ceil(N_JUDGED)).copied().collect()])
    }

    /// Makes the batches of a run, each drawn from its step alone, until nobody wants them.
    fn draw(&self, training: &MapTraining, frames: &[usize], batches: &SyncSender<Result<MapBatch>>) {
        for step in 0..training.n_steps {
            let mut rng = ChaCha8Rng::seed_from_u64(training.seed);
            rng.set_stream(step as u64 + 1);
            let mut one = || {
                let frame = frames[rng.random_range(0..frames.len())];
                (frame, Some(OtherLight::draw(&mut rng, &self.preprocessing)))
            };
            let drawn: Vec<_> = (0..training.batch).map(|_| one()).collect();
            if batches.send(self.batch(&drawn)).is_err() {
                return;
            }
        }
    }

    /// Some frames, each under another light where there is one.
    fn batch(&self, frames: &[(usize, Option<OtherLight>)]) -> Result<MapBatch> {
        let [width, height] = self.preprocessing.input_px;
        let one = |(frame, light): &(usize, Option<OtherLight>)| -> Result<(Vec<f32>, Vec<f32>)> {
            let touch = self.dataset.touch(*frame);
            // Looked at when the touches were read.
            let (side, pose) = (touch.side.unwrap_or_default(), touch.part_from_sensor.unwrap_or(Se2::IDENTITY));
            let mut seen = self.background.tactile_image(&self.dataset.frame(*frame))?.planes;
            let map = self.maps.of(self.parts[*frame], side, &pose, self.preprocessing.input_px)?;
            let places = map.distance_mm.iter().zip(&map.contact);
            let mut targets: Vec<[f32; 3]> =
                places.map(|(mm, contact)| [*mm, if *mm < 0.0 { 1.0 } else { 0.0 }, *contact]).collect();
            if let Some(light) = light {
                light.apply(&mut seen, &self.preprocessing);
                light.mirror(&mut targets, width);
            }
            seen.resize(N_SEEN * width * height, side_value(side));
            Ok((seen, targets.concat()))
        };
        let made = frames.par_iter().map(one).collect::<Result<Vec<_>>>()?;
        let (images, targets): (Vec<_>, Vec<_>) = made.into_iter().unzip();
        Ok(MapBatch { n: frames.len(), images: images.concat(), targets: targets.concat() })
    }
}

impl MapBatch {
    fn tensors(&self, [width, height]: [usize; 2], device: &Device) -> (Tensor<4>, Tensor<4>) {
        let images = TensorData::new(self.images.clone(), [self.n, N_SEEN, height, width]);
        let targets = TensorData::new(self.targets.clone(), [self.n, height, width, 3]);
        (Tensor::from_data(images, device), Tensor::from_data(targets, device))
    }
}

/// One of the values of each place, `[n, height, width, 1]`.
fn value(maps: &Tensor<4>, at: usize) -> Tensor<4> {
    let [n, height, width, _] = maps.dims();
    maps.clone().slice([0..n, 0..height, 0..width, at..at + 1])
}

/// The mean cost of maps, nats a place, `[1]`: of the distance as a Laplace variable's, of inside and contact as coins'.
fn loss(maps: Tensor<4>, targets: Tensor<4>) -> Tensor<1> {
    let log_error = value(&maps, Drawn::LogError as usize).clamp(LOG_ERRORS[0], LOG_ERRORS[1]);
    let off = (value(&maps, Drawn::Distance as usize) - value(&targets, 0)).abs();
    let distance = off * log_error.clone().neg().exp() + log_error;
    let inside = surprise(value(&maps, Drawn::Inside as usize), value(&targets, 1));
    let contact = surprise(value(&maps, Drawn::Contact as usize), value(&targets, 2));
    (distance + inside + contact).mean()
}

/// The inputs of a run and its output folder.
#[derive(Clone, Copy, Debug)]
pub struct MapRun<'a> {
    /// Simulated touches, with their scene and seed.
    pub dataset: &'a Dataset,
    /// Maps are drawn from pictures as this model sees them.
    pub model: &'a Checkpoint,
    /// How.
    pub training: &'a MapTraining,
    /// Where to compute.
    pub device: DeviceKind,
    /// Folder for `maps.safetensors`.
    pub out: &'a OutputFolder,
}

/// How a run ended.
pub type MapOutcome = Trained<MapJudgement>;

/// Trains on the boards of a simulated dataset that are not held out. `should_stop` is asked before each step; where it returns
/// true the run saves and returns. `on_step` is given each step's number and loss, and after a save what it is worth.
///
/// # Errors
/// A folder with maps in it, a dataset that does not say what was simulated, a loss that is not finite, a file that cannot be
/// written.
pub fn train_maps(
    run: &MapRun<'_>,
    should_stop: &dyn Fn() -> bool,
    on_step: &mut dyn FnMut(usize, f64, Option<MapJudgement>),
) -> Result<MapOutcome> {
    let MapRun { dataset, model, training, device, out } = *run;
    training.network.validate()?;
    let file = out.new_maps()?;
    let meta = dataset.meta();
    let simulated = || Error::invalid(&meta.name, "a simulated dataset, which says its scene and seed", "another");
    let (scene, seed) = (meta.scene.clone().ok_or_else(simulated)?, meta.seed.ok_or_else(simulated)?);
    let scene: Scene = serde_json::from_value(scene).map_err(|_| simulated())?;
    let simulator = Simulator::new(scene, seed)?;
    let size_px = training.network.input_px;
    let mut preprocessing = model.preprocessing.clone();
    preprocessing.input_px = size_px;
    let touches = Touches::new(dataset, &simulator, preprocessing)?;
    let [trained, judged] = touches.split()?;
    let device = device.open()?.autodiff();
    let network = training.network.init(training.seed, &device);
    std::thread::scope(|scope| {
        let (sender, batches) = sync_channel::<Result<MapBatch>>(2);
        let (touches, trained) = (&touches, &trained);
        let results = Results { run, touches, judged, device: device.clone().inner() };
        scope.spawn(move || touches.draw(training, trained, &sender));
        let cost = |network: &MapNetwork, _: usize| -> Result<Option<Tensor<1>>> {
            let Ok(batch) = batches.recv() else { return Ok(None) };
            let (images, targets) = batch?.tensors(size_px, &device);
            Ok(Some(loss(network.forward(images), targets)))
        };
        let save = |network: &MapNetwork, step: usize| results.save(network, step);
        let (step, judgement) = training.run(network, cost, save, Watch { should_stop, on_step })?;
        // The other thread waits until nobody wants its batches.
        drop(batches);
        Ok(MapOutcome { file: file.clone(), step, judgement })
    })
}

/// What a run writes.
struct Results<'a> {
    run: &'a MapRun<'a>,
    touches: &'a Touches<'a>,
    /// Frames of held-out boards.
    judged: Vec<usize>,
    device: Device,
}

impl Results<'_> {
    /// Looks at the held-out boards and writes the network.
    fn save(&self, network: &MapNetwork, steps: usize) -> Result<MapJudgement> {
        let network = network.valid();
        let judgement = judge(&network, self.touches, &self.judged, &self.device)?;
        let MapTraining { network: config, batch, seed, .. } = *self.run.training;
        let (dataset, distance_mm) = (self.run.dataset.meta().name.clone(), judgement.distance_mm);
        let provenance = MapProvenance { steps, batch, seed, dataset, distance_mm };
        let preprocessing = self.touches.preprocessing.clone();
        let file = MapFile {
            config,
            preprocessing,
            provenance,
            verifier: None,
            presence: [None; 3],
            tensors: tensors_of(&network),
        };
        file.save(&self.run.out.file(MAPS))?;
        Ok(judgement)
    }
}

fn judge(network: &MapNetwork, touches: &Touches<'_>, frames: &[usize], device: &Device) -> Result<MapJudgement> {
    let mut sums = MapJudgement::default();
    let (mut n_near, mut n_places) = (0.0, 0.0);
    for frames in frames.chunks(64) {
        let as_made: Vec<_> = frames.iter().map(|frame| (*frame, None)).collect();
        let batch = touches.batch(&as_made)?;
        let (images, targets) = batch.tensors(touches.preprocessing.input_px, device);
        let maps = network.forward(images);
        let nats = f64::from(loss(maps.clone(), targets).into_scalar::<f32>());
        // f32 by construction.
        let maps = maps.into_data().try_into_vec::<f32>().unwrap_or_default();
        for (drawn, target) in maps.chunks_exact(N_DRAWN).zip(batch.targets.chunks_exact(3)) {
            if f64::from(target[0].abs()) < OUTLINE_REACH_MM {
                sums.distance_mm += f64::from((drawn[Drawn::Distance as usize] - target[0]).abs());
                n_near += 1.0;
            }
            sums.inside += f64::from(u8::from((drawn[Drawn::Inside as usize] > 0.0) == (target[1] > 0.5)));
            sums.contact += f64::from(u8::from((drawn[Drawn::Contact as usize] > 0.0) == (target[2] > 0.5)));
            n_places += 1.0;
        }
        sums.nats += nats * batch.targets.len() as f64 / 3.0;
    }
    Ok(MapJudgement {
        distance_mm: sums.distance_mm / f64::max(n_near, 1.0),
        inside: sums.inside / n_places,
        contact: sums.contact / n_places,
        nats: sums.nats / n_places,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tensor(values: Vec<f32>, n: usize) -> Tensor<4> {
        let places = values.len() / n;
        Tensor::from_data(TensorData::new(values, [1, 1, places, n]), &DeviceKind::Flex.tensor_device())
    }

    #[test]
    fn the_loss_agrees_with_hand_arithmetic() {
        // 0.5 mm off with an expected error of e^-1 mm; inside at odds of e^2 to 1, a third touches at even odds.
        let found =
            loss(tensor(vec![1.5, -1.0, 2.0, 0.0], 4), tensor(vec![1.0, 1.0, 1.0 / 3.0], 3)).into_scalar::<f32>();
        let expected = 0.5 * 1.0_f64.exp() - 1.0 + (1.0 + (-2.0_f64).exp()).ln() + 2.0_f64.ln();
        assert!((f64::from(found) - expected).abs() < 1e-5, "{found} {expected}");
        // Far beyond what is kept, either way.
        let found =
            loss(tensor(vec![0.0, 50.0, -200.0, 200.0], 4), tensor(vec![0.0, 0.0, 1.0], 3)).into_scalar::<f32>();
        assert!((found - LOG_ERRORS[1]).abs() < 1e-5, "{found}");
    }
}
