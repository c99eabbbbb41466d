//! Touches whose parts and poses are known, each compared with the states of the parts that it might be of.

use rayon::prelude::*;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::{Se2, wrap_angle};

use super::states::{TIMES, states};
use crate::bank::Bank;
use crate::bank::between::Around;
use crate::bank::recorded::tactile_images;
use crate::bank::similarity::dot;
use crate::calibration::match_odds::{MatchOdds, distance};
use crate::embedding::model::Model;
use crate::error::{Error, Result};

/// A touch might be of so many parts: as many as a usual bank has.
pub const N_PARTS: usize = 12;

/// The states of a part that are most like a touch count one by one, and so many of the others for all of them.
const N_LIKE: usize = 64;
const N_OTHERS: usize = 24;

/// The pose of a touch is left out with all states of its part so near, mm and degrees.
const LEFT_OUT: [f64; 2] = [6.0, 45.0];

/// What a state is to a touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// One of the eight around its pose.
    Touched,
    /// A state of its part near its pose.
    Near,
    /// Another of its part.
    Own,
    /// A state of another part.
    Other,
}

/// A state as a touch sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Distance of the embeddings.
    pub distance: f64,
    /// How many states it counts as.
    pub count: f64,
    pub kind: Kind,
}

/// One touch.
#[derive(Clone, Debug)]
pub(super) struct Sample {
    /// Its embedding as the network gives it, of unit length.
    pub query: Vec<f32>,
    /// [`MatchOdds::log_edge`].
    pub log_edge: f64,
    /// How far touches are from their own views in the bank.
    pub own_distance: f64,
    /// States of all parts that it might be of, and of the others but its own.
    pub n_states: [f64; 2],
    pub seen: Vec<Seen>,
}

/// Touches of one side, compared with one bank or with several.
#[derive(Clone, Debug)]
pub struct Samples {
    pub(super) side: Side,
    pub(super) dim: usize,
    pub(super) samples: Vec<Sample>,
    /// Own distances of the banks of pegs that are compared by the cosine alone, and of all.
    pub(super) own_distances: [Vec<f64>; 2],
}

impl Samples {
    /// None yet, of a side.
    pub fn new(model: &Model, side: Side) -> Self {
        Self { side, dim: model.dim(), samples: Vec::new(), own_distances: [Vec::new(), Vec::new()] }
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// Compares the touches of datasets with a bank, each with the parts of its twelve: the bank's first twelve parts, the next
    /// twelve, and so on. Touches beyond the bank's poses are left out. `progress`: the bank's parts done, and all.
    ///
    /// # Errors
    /// A bank of another model, that does not know how well its parts match, or that is too coarse to be interpolated; touches
    /// of other parts, without their poses, or none of this side.
    pub fn add(
        &mut self,
        model: &Model,
        bank: &Bank,
        datasets: &[Dataset],
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<()> {
        let refused = |expected: &str| Err(Error::invalid("bank", expected, "another"));
        let Some(own_distance) = bank.matches().own_distance(self.side) else {
            return refused("one that was simulated, so that it knows how well its parts match");
        };
        if bank.neighbours().is_empty() || !crate::bank::between::is_fine(bank.grid()) {
            return refused("one with poses that can be interpolated: at most 2.5 mm and 20 degrees a step");
        }
        let mut touches = Vec::new();
        for dataset in datasets {
            touches.extend(self.touches(model, bank, dataset)?);
        }
        let n_parts = bank.parts().len();
        let group = |part: usize| part / N_PARTS;
        let n_of = |of: usize| (n_parts - of * N_PARTS).min(N_PARTS);
        let n_states = bank.grid().subdivided(TIMES, TIMES).len() as f64;
        let mut seen: Vec<Vec<Seen>> = vec![Vec::new(); touches.len()];
        for part in 0..n_parts {
            let states = states_of(bank, part);
            let of_group: Vec<usize> =
                (0..touches.len()).filter(|at| group(touches[*at].part) == group(part)).collect();
            let found: Vec<Vec<Seen>> =
                of_group.par_iter().map(|at| see(bank.grid(), part, &states, &touches[*at])).collect();
            of_group.into_iter().zip(found).for_each(|(at, found)| seen[at].extend(found));
            progress(part + 1, n_parts);
        }
        let is_plain = bank.views().is_pegs() && bank.metric().is_none();
        self.own_distances[1].push(own_distance);
        self.own_distances[0].extend(is_plain.then_some(own_distance));
        self.samples.extend(touches.into_iter().zip(seen).map(|(touch, seen)| {
            let n = n_of(group(touch.part)) as f64;
            let Touch { query, log_edge, .. } = touch;
            Sample { query, log_edge, own_distance, n_states: [n * n_states, (n - 1.0) * n_states], seen }
        }));
        Ok(())
    }

    /// The touches of a dataset within the bank's poses.
    fn touches(&self, model: &Model, bank: &Bank, dataset: &Dataset) -> Result<Vec<Touch>> {
        let name = &dataset.meta().name;
        let frames: Vec<usize> = (0..dataset.len()).filter(|at| dataset.touch(*at).side == Some(self.side)).collect();
        if frames.is_empty() {
            return Err(Error::invalid(name, format!("touches of {}s", self.side), "none"));
        }
        let images = tactile_images(&model.background_of(dataset)?, dataset, &frames)?;
        let queries = model.embed_side(&images, self.side)?;
        let mut touches = Vec::new();
        for ((frame, image), query) in frames.iter().zip(&images).zip(queries.chunks_exact(model.dim())) {
            let touch = dataset.touch(*frame);
            let known = touch.part.as_ref().and_then(|part| bank.parts().iter().position(|name| name == part));
            let (Some(part), Some(pose)) = (known, touch.part_from_sensor) else {
                let expected = format!("{}s of the bank's parts, with their poses", self.side);
                return Err(Error::invalid(
                    format!("{name}: index row {frame}"),
                    expected,
                    format!("{:?}", touch.part),
                ));
            };
            if Around::pose(bank.grid(), &pose).iter().any(|axis| axis.outside != 0.0) {
                continue;
            }
            let in_metric = unit(&bank.in_rows_metric(query));
            let log_edge = MatchOdds::log_edge(image.edge_share);
            touches.push(Touch { part, pose, query: query.to_vec(), in_metric, log_edge });
        }
        Ok(touches)
    }
}

/// A touch before it is compared.
struct Touch {
    part: usize,
    pose: Se2,
    query: Vec<f32>,
    /// As the bank's rows are.
    in_metric: Vec<f32>,
    log_edge: f64,
}

fn unit(embedding: &[f32]) -> Vec<f32> {
    let length = dot(embedding, embedding).sqrt().max(f32::MIN_POSITIVE);
    embedding.iter().map(|value| value / length).collect()
}

fn states_of(bank: &Bank, part: usize) -> Vec<f32> {
    let n = bank.grid().len();
    let rows: Vec<f32> = (part * n..(part + 1) * n).flat_map(|row| unit(&bank.row(row))).collect();
    states(bank.grid(), &rows, bank.dim())
}

/// How a touch sees the states of one part.
fn see(grid: &PoseGrid, part: usize, states: &[f32], touch: &Touch) -> Vec<Seen> {
    let dim = touch.in_metric.len();
    let cosines: Vec<f32> = states.chunks_exact(dim).map(|state| dot(state, &touch.in_metric)).collect();
    let dense = grid.subdivided(TIMES, TIMES);
    let touched = if part == touch.part { around(&dense, &touch.pose) } else { Vec::new() };
    let mut order: Vec<usize> = (0..cosines.len()).filter(|state| !touched.contains(state)).collect();
    let n_like = N_LIKE.min(order.len());
    if n_like < order.len() {
        order.select_nth_unstable_by(n_like, |a, b| cosines[*b].total_cmp(&cosines[*a]).then(a.cmp(b)));
    }
    let (like, others) = order.split_at(n_like);
    let every = others.len().div_ceil(N_OTHERS).max(1);
    let mut others: Vec<usize> = others.to_vec();
    others.sort_unstable();
    let sampled: Vec<usize> = others.iter().skip(every / 2).step_by(every).copied().collect();
    let n_each = others.len() as f64 / sampled.len().max(1) as f64;
    let kind = |state: usize| {
        if part != touch.part {
            return Kind::Other;
        }
        let pose = dense.pose(state);
        let turn = wrap_angle(pose.theta_rad - touch.pose.theta_rad).to_degrees().abs();
        if pose.distance_mm(&touch.pose) < LEFT_OUT[0] && turn < LEFT_OUT[1] { Kind::Near } else { Kind::Own }
    };
    let seen = |state: &usize, count, kind| Seen { distance: distance(f64::from(cosines[*state])), count, kind };
    let touched = touched.iter().map(|state| seen(state, 1.0, Kind::Touched));
    let like = like.iter().map(|state| seen(state, 1.0, kind(*state)));
    let sampled = sampled.iter().map(|state| seen(state, n_each, kind(*state)));
    touched.chain(like).chain(sampled).collect()
}

/// The states around a pose: eight, where it is on no edge.
fn around(grid: &PoseGrid, pose: &Se2) -> Vec<usize> {
    let strides = grid.strides();
    let axes = Around::pose(grid, pose).map(|axis| [axis.indices[1], axis.indices[2]]);
    let mut states: Vec<usize> =
        (0..8).map(|corner: usize| (0..3).map(|axis| axes[axis][corner >> axis & 1] * strides[axis]).sum()).collect();
    states.sort_unstable();
    states.dedup();
    states
}
