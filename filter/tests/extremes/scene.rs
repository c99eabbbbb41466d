//! What users have: a bank whose views change smoothly from pose to pose, with parts that are alike, and the touches of
//! a hole at any pose.

use std::sync::Arc;

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use tactile_data::dataset::touch::Side;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_filter::TouchModel;
use tactile_filter::{Episode, EpisodeConfig, Observation};
use tactile_infer::Bank;
use tactile_infer::bank::matches::{Matches, PartMatch};
use tactile_infer::bank::metric::{Measured, Metric};
use tactile_infer::bank::rows::Rows;
use tactile_infer::bank::similarity::normalize_rows;
use tactile_infer::calibration::Spread;
use tactile_infer::embedding::precision::Precision;

use super::between::Recorded;
use super::reference::Touch;
use super::sample::normals;
use crate::Result;

/// A bank's grid as the presets have it, 9 x 9 x 13 poses.
pub const GRID: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };

/// A small one, 5 x 5 x 5 poses, for many touches.
pub const SMALL_GRID: PoseGrid =
    PoseGrid { xy_half_mm: 4.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };

/// Length of an embedding.
pub const DIM: usize = 128;

/// How fast views change, radians a mm and a radian: those of neighbouring poses have a cosine of about 0.9.
const CHANGE: [f64; 3] = [0.2, 0.2, 1.5];

/// How far the phases of two parts are apart, radians.
const APART: f64 = 0.4;

/// Length of the noise on a touch, whose view has length 1.
const NOISE: f64 = 0.4;

/// How rare touches are, nats, a standard deviation.
const RARITY: f32 = 2.0;

/// What a calibration measured of the shipped model where holes are touched and where pegs are.
pub fn shipped(side: Side) -> TouchModel {
    let [matched_mean, matched_sd, matched_shared] = match side {
        Side::Hole => [0.907_186_679, 0.038_587_579_98, 0.190_727_7],
        Side::Peg => [0.973_573_490_77, 0.015_544_131_685, 0.169_418_03],
    };
    let [match_offset, steepness, steepness_by_edge, own_distance, distance_by_own] = match side {
        Side::Hole => [11.285_923_444, 20.848_392_758, 0.206_481_008, 0.397_873_369, 0.416_347_788],
        Side::Peg => [15.025_173_472, 26.432_977_374, 0.232_241_278, 0.199_976_686, 0.185_233_615],
    };
    let [presence_offset, presence_by_fit, presence_by_touch, stranger_at, stranger_scale, present_at, present_scale] =
        match side {
            Side::Hole => [
                0.141_472_500,
                0.682_932_533,
                0.736_364_258,
                0.259_220_601,
                0.993_642_623,
                0.685_593_804,
                1.832_533_574,
            ],
            Side::Peg => [
                0.139_917_458,
                0.832_746_034,
                1.870_276_481,
                -1.699_420_884,
                1.734_698_628,
                0.750_652_789,
                1.643_408_583,
            ],
        };
    let presence = TouchModel { presence_offset, presence_by_fit, presence_by_touch, ..TouchModel::default() };
    let presence = TouchModel { stranger_at, stranger_scale, present_at, present_scale, ..presence };
    let matched = TouchModel { matched_mean, matched_sd, matched_shared, ..presence };
    TouchModel { match_offset, steepness, steepness_by_edge, own_distance, distance_by_own, ..matched }
}

/// A bank and the touches of a hole or of a peg of part [`Scene::TRUTH`].
#[derive(Clone, Debug)]
pub struct Scene {
    /// The poses of each part's views.
    pub grid: PoseGrid,
    /// `[n_parts * grid.len(), DIM]`, each of length 1.
    pub rows: Vec<f32>,
    /// The edge share of each row.
    pub edge_shares: Vec<f32>,
    /// Rows that were not recorded.
    pub missing: Vec<usize>,
    /// Whether the bank compares in a metric of its own.
    pub has_metric: bool,
    /// How the rows are kept.
    pub precision: Precision,
    /// How well the touches of each part match, as the bank knows it; empty where it does not.
    pub matched: Vec<Spread>,
    /// The temperature of Alg. 1, where it is judged by that.
    pub temperature: Option<f64>,
    /// Share of the touches that are of something else.
    pub outlier_share: f64,
    /// Which side is touched.
    pub side: Side,
    /// Each with the motion since the one before.
    pub touches: Vec<(Se2, Observation)>,
    /// Where on the true part the last of them was.
    pub part_from_sensor: Se2,
}

/// How the views of the parts depend on the pose.
struct Waves {
    common: Vec<f32>,
    /// The numbers of each value of an embedding.
    numbers: Vec<[f64; 3]>,
    /// `[n_parts][DIM]`.
    phases: Vec<Vec<f64>>,
}

impl Waves {
    fn draw(n_parts: usize, rng: &mut ChaCha8Rng) -> Self {
        let common = normals(DIM, rng);
        let mut normal = |n: usize| normals(n, rng).into_iter().map(f64::from).collect::<Vec<f64>>();
        let numbers =
            (0..DIM).map(|_| normal(3)).map(|n| [0, 1, 2].map(|axis: usize| n[axis] * CHANGE[axis])).collect();
        let first: Vec<f64> = normal(DIM).into_iter().map(|phase| 3.0 * phase).collect();
        let of_part = |own: Vec<f64>| first.iter().zip(own).map(|(phase, own)| phase + APART * own).collect();
        let phases = (0..n_parts).map(|_| of_part(normal(DIM))).collect();
        Self { common, numbers, phases }
    }

    /// The view of a part, of length 1.
    fn view(&self, part: usize, pose: &Se2) -> Vec<f32> {
        let wave = |at: usize| {
            let [x, y, theta] = self.numbers[at];
            let angle = x * pose.x_mm + y * pose.y_mm + theta * pose.theta_rad + self.phases[part][at];
            self.common[at] + (std::f64::consts::SQRT_2 * angle.cos()) as f32
        };
        let mut row: Vec<f32> = (0..DIM).map(wave).collect();
        normalize_rows(&mut row, DIM);
        row
    }
}

/// The share of a view that shows an edge: none beyond an arc that each part has a little elsewhere.
fn edge_share(part: usize, pose: &Se2) -> f32 {
    let reach = 8.5 + 0.25 * (part % 4) as f64;
    if (pose.x_mm - 2.0).hypot(pose.y_mm + 1.0) > reach { 0.0 } else { 0.2 }
}

impl Scene {
    /// The true part.
    pub const TRUTH: usize = 0;

    /// Random parts; the touches are anywhere in the middle of the recorded area.
    pub fn draw(n_parts: usize, grid: PoseGrid, n_touches: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed ^ 0x7573_6572);
        let mut within = |half: f64| 0.8 * half * (2.0 * rng.random::<f64>() - 1.0);
        let (mm, deg) = (grid.xy_half_mm, grid.theta_half_deg);
        let pose = |within: &mut dyn FnMut(f64) -> f64| Se2::from_degrees(within(mm), within(mm), within(deg));
        let poses: Vec<Se2> = (0..n_touches).map(|_| pose(&mut within)).collect();
        Self::touched(n_parts, grid, &poses, seed)
    }

    /// The same, touched at these poses of the true part.
    pub fn touched(n_parts: usize, grid: PoseGrid, poses: &[Se2], seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let waves = Waves::draw(n_parts, &mut rng);
        let views = (0..n_parts).flat_map(|part| (0..grid.len()).map(move |cell| (part, grid.pose(cell))));
        let (mut rows, mut edge_shares) = (Vec::new(), Vec::new());
        for (part, pose) in views {
            rows.extend(waves.view(part, &pose));
            edge_shares.push(edge_share(part, &pose));
        }
        let (mut touches, mut last) = (Vec::new(), None::<Se2>);
        for pose in poses {
            let spread = (NOISE / (DIM as f64).sqrt()) as f32;
            let felt = waves.view(Self::TRUTH, pose).into_iter().zip(normals(DIM, &mut rng));
            let query = felt.map(|(value, noise)| value + spread * noise).collect();
            let moved = last.replace(*pose).map_or(Se2::IDENTITY, |last| last.inverse() * *pose);
            let rarity = RARITY * normals(1, &mut rng)[0];
            let observation = Observation { rarity, ..Observation::new(query, edge_share(Self::TRUTH, pose)) };
            touches.push((moved, observation));
        }
        let (missing, matched) = (Vec::new(), Vec::new());
        let TouchModel { temperature, outlier_share, .. } = TouchModel::default();
        let (has_metric, precision, side) = (false, Precision::I8, Side::Hole);
        let part_from_sensor = last.unwrap_or(Se2::IDENTITY);
        Self {
            grid,
            rows,
            edge_shares,
            missing,
            has_metric,
            precision,
            matched,
            temperature,
            outlier_share,
            side,
            touches,
            part_from_sensor,
        }
    }

    /// The same with its touches changed.
    pub fn with_touches(mut self, change: impl Fn(&mut Observation)) -> Self {
        self.touches.iter_mut().for_each(|(_, observation)| change(observation));
        self
    }

    /// Number of parts.
    pub fn n_parts(&self) -> usize {
        self.edge_shares.len() / self.grid.len()
    }

    /// A metric that counts the values of an embedding between once and twice, and mixes neighbours.
    fn metric() -> Result<Metric> {
        let mut matrix = vec![0.0; DIM * DIM];
        for at in 0..DIM {
            matrix[at * DIM + at] = 1.0 + (at % 9) as f32 / 8.0;
            if at > 0 {
                matrix[at * DIM + at - 1] = 0.25;
            }
        }
        Ok(Metric::new(DIM, matrix, Measured { error_scale: 0.64 })?)
    }

    /// The bank of its rows.
    pub fn bank(&self) -> Result<Bank> {
        let names = (0..self.n_parts()).map(|part| part.to_string()).collect();
        let rows = Rows::new(DIM, self.rows.clone())?;
        let bank = Bank::from_rows(names, self.grid, rows, self.edge_shares.clone(), "")?;
        let bank = if self.has_metric { bank.with_metric(Self::metric()?)? } else { bank };
        let known: Vec<_> = self.matched.iter().map(|matched| Some(PartMatch { matched: *matched })).collect();
        let known = if known.is_empty() { vec![None; self.n_parts()] } else { known };
        let matches = Matches { holes: known.clone(), pegs: known };
        Ok(bank.with_missing(self.missing.clone())?.with_precision(self.precision)?.with_matches(matches)?)
    }

    fn model(&self) -> TouchModel {
        let Self { temperature, outlier_share, .. } = *self;
        TouchModel { temperature, outlier_share, ..shipped(self.side) }
    }

    /// The settings of an episode: all defaults but what the shipped model's calibration says.
    pub fn config(&self) -> EpisodeConfig {
        EpisodeConfig::default().changed(|_, model, _| *model = self.model())
    }

    /// An episode with all its touches, as a robot's program would run it.
    pub fn episode(&self, bank: &Arc<Bank>, config: EpisodeConfig) -> Result<Episode> {
        let touch = |observation: &Observation| observation.clone().of_side(self.side);
        let mut episode = Episode::begin(config, bank.clone(), &touch(&self.touches[0].1))?;
        for (moved, observation) in &self.touches[1..] {
            episode.observe(*moved, &touch(observation))?;
        }
        Ok(episode)
    }

    /// The settings in the bank's metric: numbers calibrated by the cosine are scaled by the root of how much less
    /// touches are off.
    fn likelihood(&self) -> TouchModel {
        let plain = self.model();
        if !self.has_metric {
            return plain;
        }
        let scale = 0.64_f64.sqrt();
        let (matched_mean, matched_sd) = (1.0 - scale * (1.0 - plain.matched_mean), scale * plain.matched_sd);
        TouchModel { matched_mean, matched_sd, ..plain }
    }

    /// The recorded views as f64 has them: `rows` are the bank's as kept, or before they were rounded.
    pub fn recorded(&self, rows: &[f32]) -> Recorded {
        let mut is_recorded = vec![true; self.edge_shares.len()];
        self.missing.iter().for_each(|row| is_recorded[*row] = false);
        let mut recorded = Recorded::new(self.grid, rows, DIM, is_recorded, self.likelihood());
        recorded.matched.clone_from(&self.matched);
        recorded
    }

    /// The rows before they were rounded, in the bank's metric.
    pub fn exact_rows(&self) -> Result<Vec<f32>> {
        Ok(Self { precision: Precision::F32, ..self.clone() }.bank()?.rows().to_f32())
    }

    /// The queries of all touches in the bank's metric, in f64.
    pub fn queries(&self) -> Result<Vec<Vec<f64>>> {
        let metric = if self.has_metric { Some(Self::metric()?) } else { None };
        let turned = |query: &[f32]| -> Vec<f64> {
            let query: Vec<f64> = query.iter().map(|value| f64::from(*value)).collect();
            match &metric {
                None => query,
                Some(metric) => {
                    let lines = metric.matrix().chunks_exact(DIM);
                    lines.map(|line| line.iter().zip(&query).map(|(a, b)| f64::from(*a) * b).sum()).collect()
                }
            }
        };
        Ok(self.touches.iter().map(|(_, observation)| turned(&observation.query)).collect())
    }

    /// The touches as the reference sees them, by queries and rows.
    pub fn felt(&self, rows: &[f32], queries: &[Vec<f64>]) -> Vec<Touch> {
        let touch = |((moved, observation), query): (&(Se2, Observation), &Vec<f64>)| {
            let length = query.iter().map(|value| value * value).sum::<f64>().sqrt();
            let inner = |row: &[f32]| row.iter().zip(query).map(|(a, b)| f64::from(*a) * b).sum::<f64>();
            let cosines: Vec<f64> = rows.chunks_exact(DIM).map(|row| (inner(row) / length).clamp(-1.0, 1.0)).collect();
            let &Observation { edge_share, rarity, .. } = observation;
            Touch { moved: *moved, edge_share, rarity, cosines }
        };
        self.touches.iter().zip(queries).map(touch).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;
    use tactile_infer::Model;

    #[test]
    fn the_settings_are_those_of_the_shipped_model() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../infer/models/maze-small.safetensors");
        let model = Model::load(&path).unwrap();
        for side in [Side::Hole, Side::Peg] {
            let (here, of_model) = (shipped(side), TouchModel::of_side(&model, side));
            let numbers = |c: &TouchModel| {
                let of_odds = [c.match_offset, c.steepness, c.steepness_by_edge, c.own_distance, c.distance_by_own];
                let of_presence = [c.presence_offset, c.presence_by_fit, c.presence_by_touch];
                let of_tails = [c.stranger_at, c.stranger_scale, c.present_at, c.present_scale];
                let of_match = [c.matched_mean, c.matched_sd, c.matched_shared];
                of_odds.into_iter().chain(of_presence).chain(of_tails).chain(of_match)
            };
            for (here, of_model) in numbers(&here).zip(numbers(&of_model)) {
                assert!((here / of_model - 1.0).abs() < 1e-4, "{side:?}: {here}, not {of_model}");
            }
            let rest = |c: &TouchModel| TouchModel {
                match_offset: 0.0,
                steepness: 1.0,
                steepness_by_edge: 0.0,
                own_distance: 1.0,
                distance_by_own: 1.0,
                matched_mean: 0.0,
                matched_sd: 1.0,
                matched_shared: 0.0,
                presence_offset: 0.0,
                presence_by_fit: 0.0,
                presence_by_touch: 0.0,
                stranger_at: 0.0,
                stranger_scale: 1.0,
                present_at: 0.0,
                present_scale: 1.0,
                // A warning, which no case is about.
                low_similarity: 0.0,
                ..*c
            };
            assert_eq!(rest(&here), rest(&of_model));
        }
    }

    #[test]
    fn neighbouring_views_are_alike_and_parts_are_hard_to_tell() {
        let scene = Scene::draw(3, GRID, 2, 1);
        let rows = scene.rows.chunks_exact(DIM).collect::<Vec<_>>();
        let cosine = |a: usize, b: usize| rows[a].iter().zip(rows[b]).map(|(a, b)| a * b).sum::<f32>();
        let middle = GRID.nearest(&Se2::IDENTITY).unwrap();
        let [x, y, theta] = GRID.strides().map(|stride| cosine(middle, middle + stride));
        assert!([x, y, theta].iter().all(|cosine| (0.85..0.99).contains(cosine)), "{x} {y} {theta}");
        let other = cosine(middle, middle + GRID.len());
        assert!((0.8..0.99).contains(&other), "{other}");
    }
}
