//! What a trade-off measures: which settings, and each one's accuracy, time and memory.

use std::sync::Arc;
use std::time::Instant;

use serde::{Deserialize, Serialize};
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_infer::Bank;
use tactile_infer::Model;
use tactile_infer::bank::simulated::learner::Learner;
use tactile_infer::embedding::precision::Precision;

use crate::banks::Banks;
use crate::error::{Error, Result};
use crate::evaluate::{Protocol, Run, StageTimes, run_all, run_one};
use crate::holes::Holes;
use crate::result::{Choice, Inference, Method, Poses, Row};
use crate::statistics::quantile;
use crate::summary::{Label, halves, rows};
use tactile_filter::EpisodeConfig;
use tactile_filter::belief::EngineConfig;
use tactile_filter::belief::particle::ParticleConfig;
use tactile_filter::budget::{Half, Halves, Pace, Point, Setup, Strangers};
use tactile_filter::choice::ActionRule;

/// Touches after which a point is taken.
pub const TOUCHES: [usize; 6] = [1, 2, 3, 4, 6, 10];

/// Episodes that are timed, one after the other on one core.
const TIMED: usize = 200;

/// Seconds of made-up decisions.
const PACE_S: f64 = 0.5;

/// The bank's steps that are tried: mm and degrees.
pub(crate) const STEPS: [[f64; 2]; 5] = [[4.0, 30.0], [4.0, 15.0], [2.0, 30.0], [2.0, 15.0], [2.0, 10.0]];

/// Draws, suppositions and finalists that are tried.
const EFFORTS: [(usize, usize, Option<usize>); 7] = [
    (8, 2, Some(2)),
    (16, 4, Some(4)),
    (40, 8, Some(8)),
    (80, 12, Some(12)),
    (160, 24, Some(24)),
    (320, 48, Some(48)),
    (160, 24, None),
];

/// Rates of strangers that are tried besides the default.
const RATES: [f64; 4] = [0.1, 0.03, 0.003, 0.001];

/// One setting to measure, with the model that it takes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Planned {
    /// Index of the model.
    pub model: usize,
    /// The setting.
    pub settings: Setup,
    /// Whether strangers are touched, too.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub strangers: bool,
}

/// The settings of a sweep over some models, the first of which is turned at every knob: from a lean and the default
/// setting each knob alone, a rich one, and the leanest there are; with maps where `has_maps` from the default each knob alone, too. From
/// the default other rates of strangers, with maps, too, and with strangers. None twice.
///
/// # Errors
/// No model.
pub fn plan(models: &[Arc<Model>], has_maps: bool) -> Result<Vec<Planned>> {
    let Some(first) = models.first() else {
        return Err(Error::invalid("--model", "at least one model", "none"));
    };
    let of = |model: &Model, [xy_step_mm, theta_step_deg]: [f64; 2]| {
        let default = Setup::of(model, &PoseGrid::SMALL);
        Setup { xy_step_mm, theta_step_deg, ..default }
    };
    let default = of(first, [2.0, 15.0]);
    let lean = Setup { subdivisions: 1, ..with_effort(&of(first, [4.0, 15.0]), EFFORTS[1]) };
    let mapped = Setup { verify: EpisodeConfig::default().settings.verify.into(), ..default.clone() };
    let by_maps = has_maps.then(|| [&verified(&default)[..], &verified(&lean), &turned(&mapped)].concat());
    let risked = [Some(&default), has_maps.then_some(&mapped)];
    let by_rate = risked.into_iter().flatten().flat_map(at_rates);
    let of_first = [turned(&default), turned(&lean), rich(&default), engines(&default), least(&default)].concat();
    let of_first = of_first.into_iter().chain(by_maps.into_iter().flatten()).chain(by_rate);
    let of_others = models.iter().enumerate().skip(1).flat_map(|(index, model)| {
        let Setup { model, model_sha256, .. } = of(model, [2.0, 15.0]);
        [&default, &lean]
            .map(|base| (index, Setup { model: model.clone(), model_sha256: model_sha256.clone(), ..base.clone() }))
    });
    let mut planned = Vec::new();
    for (model, settings) in of_first.map(|settings| (0, settings)).chain(of_others) {
        let at_a_rate = |base: &&Setup| Setup { false_accept: base.false_accept, ..settings.clone() } == **base;
        let strangers = model == 0 && risked.iter().flatten().any(at_a_rate);
        let new = Planned { model, settings, strangers };
        if !planned.contains(&new) {
            planned.push(new);
        }
    }
    Ok(planned)
}

fn with_effort(base: &Setup, (n_draws, n_suppositions, n_finalists): (usize, usize, Option<usize>)) -> Setup {
    Setup { n_draws, n_suppositions, n_finalists, ..base.clone() }
}

/// A setting and each knob of it turned alone.
fn turned(base: &Setup) -> Vec<Setup> {
    let new = || base.clone();
    let mut all = vec![new()];
    all.extend(STEPS.map(|[xy_step_mm, theta_step_deg]| Setup { xy_step_mm, theta_step_deg, ..new() }));
    all.extend([Precision::F16, Precision::I8].map(|rows| Setup { rows, ..new() }));
    all.extend([1, 2, 3].map(|subdivisions| Setup { subdivisions, ..new() }));
    all.extend([ActionRule::Random, ActionRule::Paper].map(|rule| Setup { rule, ..new() }));
    all.extend(EFFORTS.map(|effort| with_effort(base, effort)));
    all
}

/// The same with maps, and so many parts verified by them.
fn verified(base: &Setup) -> [Setup; 4] {
    [0, 1, 8, 24].map(|n| Setup { verify: Some(n), ..base.clone() })
}

/// The same at other rates of strangers.
fn at_rates(base: &Setup) -> [Setup; 4] {
    RATES.map(|rate| Setup { false_accept: Some(rate), ..base.clone() })
}

/// A rich setting takes ten times as long to measure: it is turned down only.
fn rich(default: &Setup) -> Vec<Setup> {
    let rich = Setup { theta_step_deg: 10.0, ..with_effort(default, EFFORTS[5]) };
    vec![
        rich.clone(),
        Setup { theta_step_deg: 15.0, ..rich.clone() },
        Setup { subdivisions: 1, ..rich.clone() },
        Setup { subdivisions: 3, ..rich.clone() },
        with_effort(&rich, EFFORTS[4]),
    ]
}

fn particles(n_particles: usize) -> EngineConfig {
    EngineConfig::Particle(ParticleConfig { n_particles, ..ParticleConfig::default() })
}

/// The default with particles, and lean where it costs little of what a fine bank knows.
fn engines(default: &Setup) -> Vec<Setup> {
    let all = [100, 1_000, 10_000].map(|n| Setup { engine: particles(n), ..default.clone() });
    let lean = |effort| Setup { rows: Precision::I8, subdivisions: 1, ..with_effort(default, effort) };
    all.into_iter().chain([EFFORTS[1], EFFORTS[2], EFFORTS[4]].map(lean)).collect()
}

/// The least of everything: what can be had at once.
fn least(default: &Setup) -> Vec<Setup> {
    let least = with_effort(default, EFFORTS[0]);
    let least = Setup { xy_step_mm: 4.0, theta_step_deg: 30.0, rows: Precision::I8, subdivisions: 1, ..least };
    vec![
        Setup { rule: ActionRule::Random, ..least.clone() },
        Setup { engine: particles(100), rule: ActionRule::Random, ..least.clone() },
        least.clone(),
        Setup { rows: Precision::F32, ..least },
    ]
}

/// What a setting is measured on.
pub struct Bench<'a> {
    /// What is touched.
    pub holes: Holes<'a>,
    /// The model.
    pub model: &'a Arc<Model>,
    /// A bank of the setting's steps, its rows in f32.
    pub bank: &'a Bank,
    /// The sensor at rest.
    pub no_contact: &'a Frame,
    /// The episodes.
    pub protocol: &'a Protocol,
    /// Where strangers are touched, too: makes the bank again without a part, if it learnt from its parts.
    pub learner: Option<Arc<Learner>>,
}

/// Measures one setting: accuracy and decisions, with strangers where they are planned, on all cores, then time on one. A point for each of
/// [`TOUCHES`] that the protocol reaches.
pub fn measure(bench: &Bench<'_>, planned: &Planned) -> Result<Vec<Point>> {
    let settings = &planned.settings;
    let Bench { holes, model, no_contact, protocol, .. } = bench;
    let bank = Arc::new(bench.bank.clone().with_precision(settings.rows)?);
    let sensor = holes.sensor(model, no_contact)?;
    let config = settings.applied_to(&EpisodeConfig::of_side(model, holes.side()));
    let banks = Banks::new(bank.clone(), protocol, None)?;
    let run = Run { holes: *holes, sensor: &sensor, banks: &banks, config: &config, protocol };
    let outcomes = run_all(&run, &|_, _| ())?;
    let label =
        Label { method: Method::Filter, inference: Inference::None, action: Choice::None, poses: protocol.poses };
    let reach = match protocol.poses {
        Poses::OnGrid => *bank.start(),
        Poses::OffGrid => holes.reach(&bank),
    };
    let (decisions, pace_ms) = on_one_core(|| {
        let mut decisions = Vec::new();
        for index in 0..TIMED.min(protocol.n_episodes) {
            let of_hole = banks.of(&protocol.hole(*holes, bank.start(), index))?;
            let outcome = run_one(&run, &of_hole, index, &mut |_, _, _, _| ())?;
            // After the last touch nothing is chosen.
            let whole = outcome.times.iter().filter(|times| times.select > 0.0);
            decisions.extend(whole.map(StageTimes::whole));
        }
        let begun = Instant::now();
        let pace = Pace { sensor: &sensor, frame: no_contact, bank: &bank, reach: &reach };
        let config = config.changed(|_, _, method| method.between_poses = protocol.poses == Poses::OffGrid);
        let pace_ms = pace.decision_ms(&config, PACE_S, &mut || begun.elapsed().as_secs_f64())?;
        Ok((decisions, pace_ms))
    })?;
    let strangers = if planned.strangers { strangers(bench, &run)? } else { Vec::new() };
    let after = rows(label, &outcomes).into_iter().zip(halves(&outcomes, &config));
    let reached = after.filter(|(row, _)| TOUCHES.contains(&row.n_touches));
    let point = |(row, halves): (Row, Halves)| {
        Ok(Point {
            settings: settings.clone(),
            n_touches: row.n_touches,
            accuracy: row.accuracy,
            accuracy_ci95: row.accuracy_ci95,
            halves,
            strangers: strangers.get(row.n_touches - 1).copied(),
            xy_mm_mean: row.xy_mm_mean,
            theta_deg_mean: row.theta_deg_mean,
            decision_ms_p50: quantile(decisions.clone(), 0.5),
            decision_ms_p99: quantile(decisions.clone(), 0.99),
            pace_ms,
            memory_mb: settings.memory_mb(model, &bank, row.n_touches)?,
            dominated: false,
        })
    };
    reached.map(point).collect()
}

/// After each number of touches the same episodes where the bank lacks the hole's own part; none of a bank of one part.
fn strangers(bench: &Bench<'_>, run: &Run<'_>) -> Result<Vec<Strangers>> {
    let bank = run.banks.whole();
    if bank.parts().len() < 2 {
        return Ok(Vec::new());
    }
    let protocol = &Protocol { absent: true, ..bench.protocol.clone() };
    let banks = Banks::new(bank.clone(), protocol, bench.learner.clone())?;
    let run = Run { banks: &banks, protocol, ..*run };
    let after = halves(&run_all(&run, &|_, _| ())?, run.config);
    let named = |halves: Halves| {
        let Half { n_episodes, n_decided, .. } = halves.together();
        Strangers { n_episodes, n_named: n_decided }
    };
    Ok(after.into_iter().map(named).collect())
}

/// Runs some work with one thread for all that it divides.
fn on_one_core<T: Send>(work: impl FnOnce() -> Result<T> + Send) -> Result<T> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.map_err(|e| Error::invalid("threads", "one", e.to_string()))?.install(work)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::knobs::KNOBS;
    use tactile_data::frame::Preprocessing;
    use tactile_infer::DeviceKind;
    use tactile_infer::embedding::architecture::NetworkConfig;
    use tactile_infer::embedding::checkpoint::{Checkpoint, Provenance};

    #[test]
    fn a_sweep_has_forty_settings_none_twice_and_turns_every_knob() {
        let config = NetworkConfig { input_px: [16, 12], width: 4, hidden: 8, dim: 6 };
        let model = |sha256: &str| {
            let network = config.init(3, &DeviceKind::Flex.tensor_device());
            let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
            Arc::new(Model::new(checkpoint, sha256.into(), DeviceKind::Flex).unwrap())
        };
        let planned = plan(&[model("a"), model("b")], true).unwrap();
        assert!(planned.len() >= 40, "{}", planned.len());
        assert!((0..planned.len()).all(|i| !planned[..i].contains(&planned[i])));
        let turned = |knob| planned.iter().any(|p| planned[0].settings.turned(&p.settings) == [knob]);
        assert!(KNOBS.into_iter().all(turned));
        // The default and four other rates, without maps and with.
        assert_eq!(planned.iter().filter(|planned| planned.strangers).count(), 10);
        assert!(planned.iter().all(|planned| planned.strangers || planned.settings.false_accept == Some(0.01)));
        assert!(plan(&[], false).is_err());
    }
}
