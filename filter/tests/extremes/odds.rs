//! The likelihood of one touch at its extremes: how steep it is, how near and how far views are, how rare touches.

use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_filter::Observation;
use tactile_filter::TouchModel;
use tactile_filter::belief::EngineConfig;
use tactile_infer::embedding::precision::Precision;

use super::case::{Case, Group};
use super::cases::{N_PARTS, OF_COSINES, compared, names_truth, of_one_touch, spread};
use super::reference::OF_COSINE;
use super::sample::Sample;
use super::scene::DIM;
use crate::Result;

/// How far the rounding of a row to f16 moves a cosine of unit vectors at most: 2^-11 of each value, sums of whose
/// products are at most 1 (Cauchy and Schwarz), and 2^-25 for its smallest numbers times sqrt(128).
const HALF_ROUNDING: f64 = 1.0 / 2048.0 + 3.4e-7;

/// Where bounds come from that are not of [`OF_COSINES`]: the rounding of rows.
const OF_ROWS: &str = "rows rounded to 11 bits (Cauchy and Schwarz), by what the log-likelihood is at both ends of the \
    cosine, in each of the touches";

const N_TOUCHES: usize = 3;

/// Steepnesses from 1e-3 to 1e4 in half decades, with and without outliers, in f32 and in f16.
///
/// A bank in f16 is compared with the reference twice: of its rounded rows, which leaves the arithmetic of the cosines,
/// and of the rows before rounding, where the bound on the rounding's effect soon says nothing.
pub fn steepnesses(seed: u64) -> Result<Vec<Case>> {
    // A touch of the true row must stay likelier than an outlier, however steep.
    let model = TouchModel { own_distance: 0.8, ..Sample::model() };
    let steep = |half_decades: i32| {
        let steepness = 10.0_f64.powf(f64::from(half_decades) / 2.0);
        (steepness, TouchModel { steepness, ..model })
    };
    let mut cases = Vec::new();
    for (of_outliers, outlier_share) in [("", model.outlier_share), (", no outliers", 0.0)] {
        let configs = (-6..=8).map(steep).map(|(at, config)| (at, TouchModel { outlier_share, ..config }));
        cases.extend(driven(Group::Steepness, of_outliers, &configs.collect::<Vec<_>>(), seed)?);
    }
    Ok(cases)
}

/// Alg. 1 as printed, at temperatures from 1e-4 to 1e4 in half decades.
pub fn temperatures(seed: u64) -> Result<Vec<Case>> {
    let of = |half_decades: i32| {
        let temperature = 10.0_f64.powf(f64::from(half_decades) / 2.0);
        (temperature, TouchModel { temperature: Some(temperature), ..Sample::model() })
    };
    driven(Group::Temperature, "", &(-8..=8).map(of).collect::<Vec<_>>(), seed)
}

/// Settings, each by its place on the group's axis, with banks in f32 and in f16.
fn driven(group: Group, name: &str, configs: &[(f64, TouchModel)], seed: u64) -> Result<Vec<Case>> {
    let sample = Sample::draw(N_PARTS, PoseGrid::SMALL, DIM, N_TOUCHES, seed);
    let (bank, half_bank) = (sample.bank()?, sample.bank()?.with_precision(Precision::F16)?);
    let rounded = Sample { rows: half_bank.rows().to_f32(), ..sample.clone() };
    let kinds = [
        ("f32 bank", &bank, &sample, OF_COSINE, OF_COSINES),
        ("f16 bank, of its rows", &half_bank, &rounded, OF_COSINE, OF_COSINES),
        ("f16 bank, of the rows before rounding", &half_bank, &sample, OF_COSINE + HALF_ROUNDING, OF_ROWS),
    ];
    let mut cases = Vec::new();
    for (kind, bank, of_reference, cosine_error, source) in kinds {
        for (at, config) in configs {
            let belief = sample.belief_with(bank, EngineConfig::Exact, seed, config)?;
            let reference = of_reference.expected(config, cosine_error);
            let case = compared(group, format!("{kind}{name}"), &belief, &reference);
            let case = case.at(*at).by(source);
            // At higher temperatures touches tell less than a nat.
            let tells = config.temperature.is_none_or(|temperature| temperature <= 1.0);
            cases.push(if tells { case.right_part(names_truth(&belief)) } else { case });
        }
    }
    Ok(cases)
}

/// Distances near 0 and 2, and all other numbers of the likelihood, each far from what it usually is.
pub fn cases(seed: u64) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for (name, radians) in [
        ("0", 0.0),
        ("1e-4", 1e-4),
        ("1e-3", 1e-3),
        ("1e-2", 1e-2),
        ("half a turn but 1e-2", std::f64::consts::PI - 1e-2),
        ("half a turn but 1e-4", std::f64::consts::PI - 1e-4),
        ("half a turn", std::f64::consts::PI),
    ] {
        cases.push(turned(name, radians)?);
    }
    let sample = Sample::draw(N_PARTS, PoseGrid::SMALL, DIM, N_TOUCHES, seed);
    let usual = Sample::model();
    for outlier_share in [1e-300, 1e-9, 0.5, 1.0 - 1e-9] {
        let config = TouchModel { outlier_share, ..usual };
        cases.push(of_sample(format!("a share of outliers of {outlier_share:?}"), &sample, &config, seed)?);
    }
    for own_distance in [1e-6, 0.1, 2.0, 100.0] {
        let config = TouchModel { own_distance, ..usual };
        cases.push(of_sample(format!("touches {own_distance:?} from their own views"), &sample, &config, seed)?);
    }
    for match_offset in [-1e6, -100.0, 100.0, 1e6] {
        let config = TouchModel { match_offset, ..usual };
        cases.push(of_sample(format!("an offset of {match_offset:?} nats"), &sample, &config, seed)?);
    }
    for steepness_by_edge in [-2.0, 0.0, 3.0] {
        let config = TouchModel { steepness_by_edge, ..usual };
        cases.push(of_sample(format!("steeper by the power {steepness_by_edge} of the edge"), &sample, &config, seed)?);
    }
    for (outliers, outlier_share) in [("", usual.outlier_share), (", no outliers", 0.0)] {
        let config = TouchModel { outlier_share, ..usual };
        for rarity in [-1e6, -100.0, 100.0, 1e6] {
            let touched = |observation: &Observation| Observation { rarity, ..observation.clone() };
            cases.push(of_sample(
                format!("touches as rare as {rarity:?} nats{outliers}"),
                &with(&sample, touched),
                &config,
                seed,
            )?);
        }
    }
    for edge_share in [0.0, 1e-30, 0.003, 1.0] {
        let touched = |observation: &Observation| Observation { edge_share, ..observation.clone() };
        cases.push(of_sample(
            format!("touches of which {edge_share:?} is edge"),
            &with(&sample, touched),
            &usual,
            seed,
        )?);
    }
    Ok(cases)
}

/// A touch, and rows turned against it by an angle, by half a turn less, and by a quarter turn.
fn turned(name: &str, radians: f64) -> Result<Case> {
    let row = |radians: f64| spread(radians.cos() as f32, radians.sin() as f32, 1.0);
    let angles = [radians, std::f64::consts::PI - radians, std::f64::consts::FRAC_PI_2];
    let (rows, cosines) = (angles.map(row), angles.map(f64::cos));
    let query = Observation::new(row(0.0), 0.2);
    of_one_touch((Group::Odds, &format!("a view turned by {name}")), &rows, &query, &cosines, &TouchModel::default())
}

fn of_sample(variant: String, sample: &Sample, config: &TouchModel, seed: u64) -> Result<Case> {
    let belief = sample.belief(EngineConfig::Exact, seed, config)?;
    Ok(compared(Group::Odds, variant, &belief, &sample.expected(config, OF_COSINE)))
}

/// A sample whose touches are changed.
fn with(sample: &Sample, touched: impl Fn(&Observation) -> Observation) -> Sample {
    let touches: Vec<(Se2, Observation)> = sample.touches.iter().map(|(moved, seen)| (*moved, touched(seen))).collect();
    Sample { touches, ..sample.clone() }
}
