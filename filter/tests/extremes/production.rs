//! What users run, against the f64 reference: all defaults, with the shipped calibration, through an episode.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_filter::Episode;
use tactile_infer::calibration::Spread;
use tactile_infer::embedding::precision::Precision;

use super::case::{Case, Group};
use super::evidence::{Evidence, Posterior};
use super::placed;
use super::reference::OF_COSINE;
use super::scene::{DIM, GRID, SMALL_GRID, Scene};
use crate::Result;

/// Where the bounds of this module come from.
const SOURCE: &str = "rounding of cosines, weights and lengths by what the log-likelihood is at both ends of a cosine, \
    2e-3 nats a touch where a match is taken for an outlier, and what the belief says it left out";

/// All default settings, with each of the things that users meet.
pub fn cases(seed: u64, quick: bool) -> Result<Vec<Case>> {
    let whole = |n_touches| Scene::draw(6, GRID, n_touches, seed);
    let mut scenes: Vec<(&str, Scene)> = [1, 3, 10].map(|n| ("holes", whole(n))).into();
    scenes.push(("pegs", Scene { side: Side::Peg, ..whole(10) }));
    scenes.push(("a learnt metric", Scene { has_metric: true, ..whole(10) }));
    let missing = (0..6 * GRID.len()).filter(|row| row * 7_919 % 20 == 3).collect();
    scenes.push(("one view in twenty missing", Scene { missing, ..whole(10) }));
    scenes.push(("no touch shows an edge", whole(10).with_touches(|touch| touch.edge_share = 0.0)));
    scenes.push(("touches 100 nats rarer", whole(10).with_touches(|touch| touch.rarity += 100.0)));
    scenes.push(("touches 100 nats commoner", whole(10).with_touches(|touch| touch.rarity -= 100.0)));
    let matched = (0..6).map(|part| Spread { mean: 0.96 - 0.01 * f64::from(part), sd: 0.02 }).collect();
    scenes.push(("a bank that knows its matches", Scene { matched, ..whole(10) }));
    scenes.push(("no outliers", Scene { outlier_share: 0.0, ..whole(10) }));
    scenes.push(("Alg. 1 as printed", Scene { temperature: Some(0.08), ..whole(10) }));
    scenes.push(("one part", Scene::draw(1, GRID, 10, seed)));
    let twins = twins(seed);
    scenes.push(("two equal parts", twins.clone()));
    scenes.push(("motions of 1e6 mm", far_away(seed)));
    let n_many = if quick { 300 } else { 10_000 };
    scenes.push(("many touches", Scene::draw(2, SMALL_GRID, n_many, seed)));
    let mut cases = Vec::new();
    for (variant, scene) in &scenes {
        cases.extend(compared(variant, scene)?);
    }
    cases.push(twins_apart(&twins)?);
    Ok(cases)
}

/// Three parts of which the second is the first once more.
fn twins(seed: u64) -> Scene {
    let mut scene = Scene::draw(3, GRID, 10, seed);
    let n = GRID.len();
    scene.rows.copy_within(..n * DIM, n * DIM);
    scene.edge_shares.copy_within(..n, n);
    scene
}

/// How far the probabilities of two equal parts are apart: what is left out may be of one of them.
fn twins_apart(scene: &Scene) -> Result<Case> {
    let episode = scene.episode(&Arc::new(scene.bank()?), scene.config())?;
    let (posterior, left_out) = (episode.belief().posterior().by_part(), episode.belief().posterior().left_out());
    let apart = (posterior[0] - posterior[1]).abs();
    let case = Case::measured(Group::Production, "two equal parts: apart", "as probable", apart, left_out + 1e-12);
    Ok(case.at(scene.touches.len() as f64).by("what is left out may be of one of them; sums of 1e-16 each"))
}

/// Touches between which the sensor goes a kilometre away and comes back, and touches there.
fn far_away(seed: u64) -> Scene {
    let near = |x, y, degrees| Se2::from_degrees(x, y, degrees);
    let poses = [
        near(1.3, -2.1, 21.0),
        near(1e6, 0.0, 10.0),
        near(-3.2, 0.7, -33.0),
        near(0.0, -9e5, 0.0),
        near(2.9, 2.2, 4.0),
    ];
    Scene::touched(6, GRID, &poses, seed)
}

/// One episode's belief and estimate, quantity by quantity.
fn compared(variant: &str, scene: &Scene) -> Result<Vec<Case>> {
    let bank = Arc::new(scene.bank()?);
    let episode = scene.episode(&bank, scene.config())?;
    let rows = bank.rows().to_f32();
    let recorded = scene.recorded(&rows);
    let queries = scene.queries()?;
    let touches = scene.felt(&rows, &kept_queries(scene, queries.clone()));
    let evidence = Evidence::new(&recorded, &touches, cosine_errors(scene, &queries));
    let posterior = evidence.posterior(episode.belief().posterior().grid());
    let mut cases = belief_cases(Group::Production, variant, &episode, &posterior);
    cases.extend(pose_cases(variant, &episode, &evidence));
    Ok(cases.into_iter().map(|case| case.at(scene.touches.len() as f64)).collect())
}

/// Class posterior, all states, best state and evidence.
///
/// Each state's odds are off by `e^(2 off)` at most, so that no sum of probabilities is off by more than `tanh(off /
/// 2)`.
fn belief_cases(group: Group, variant: &str, episode: &Episode, posterior: &Posterior) -> Vec<Case> {
    let belief = episode.belief();
    let (left_out, n_cells) = (belief.posterior().left_out(), belief.posterior().grid().len());
    let of_sum = 0.5 * posterior.off + left_out;
    let case = |quantity: &str, expected: &str, error: f64, bound: f64| {
        Case::measured(group, format!("{variant}: {quantity}"), expected, error, bound).by(SOURCE)
    };
    let parts = belief.posterior().by_part().iter().zip(posterior.of_parts());
    let of_parts = largest(parts.map(|(got, expected)| (got - expected).abs()));
    let mut apart: Vec<f64> = posterior.logs.iter().map(|log| log.exp()).collect();
    belief.posterior().states().iter().for_each(|(state, mass)| apart[state.part * n_cells + state.cell] -= mass);
    let of_states = apart.iter().map(|apart| apart.abs()).sum::<f64>() / 2.0;
    let best = posterior.logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let named =
        belief.posterior().best(None).map_or(f64::NAN, |state| posterior.logs[state.part * n_cells + state.cell]);
    let of_evidence = (belief.log_evidence() - posterior.log_evidence).abs();
    vec![
        case("parts", "each part's probability", of_parts, of_sum),
        case("states", "the total variation of all states", of_states, of_sum),
        case("best state", "as probable as the best, nats", best - named, 2.0 * posterior.off),
        case("evidence", "log p(touches), nats", of_evidence, posterior.off + left_out / (1.0 - left_out)),
    ]
}

/// The pose of the likeliest part, its covariance and its fit, given the belief, which [`belief_cases`] compares.
fn pose_cases(variant: &str, episode: &Episode, evidence: &Evidence) -> Vec<Case> {
    let (estimate, belief) = (episode.estimate(), episode.belief());
    let (of_parts, states) = (belief.posterior().by_part(), belief.posterior().grid());
    let part = (0..of_parts.len()).fold(0, |best, part| if of_parts[part] > of_parts[best] { part } else { best });
    let Some(best) = belief.posterior().best(Some(part)) else { return Vec::new() };
    let hill = placed::hill(evidence, part, &states.pose(best.cell));
    let mut of_states = vec![0.0; states.len()];
    let held = belief.posterior().states().into_iter().filter(|(state, _)| state.part == part);
    held.for_each(|(state, mass)| of_states[state.cell] = mass);
    let expected = placed::covariance(evidence, part, &estimate.part_from_first, states, &of_states);
    let case = |quantity: &str, expected: &str, error: f64, bound: f64| {
        Case::measured(Group::Production, format!("{variant}: {quantity}"), expected, error, bound)
    };
    let entries = (0..9).map(|at| (at / 3, at % 3));
    let relative = |(i, j): (usize, usize)| {
        (estimate.covariance[i][j] - expected[i][j]).abs() / (expected[i][i] * expected[j][j]).sqrt()
    };
    let covariance = largest(entries.map(relative));
    let [x, y, _] = placed::stated(evidence, part, &states.pose(best.cell));
    let (_, [[xx, ..], [_, yy, _], _]) = hill;
    let pose = &estimate.part_from_first;
    let shift = (pose.x_mm - x).hypot(pose.y_mm - y);
    let deviation = xx.max(yy).sqrt();
    let pose_off = placed::off(evidence);
    let in_turn = "five lattices in turn, each off by what its weights are and what the one before moved it";
    let of_pose = case("pose", "the mean of the hill, mm", shift, 20.0 * pose_off * deviation + 1e-9);
    let of_spread = "of x, y and the angle, by the standard deviations";
    let mut cases = vec![
        of_pose.by(in_turn),
        case("covariance", of_spread, covariance, 2.0 * placed::OF_COVARIANCE * pose_off + 1e-9)
            .by("twice what a weight is off, by the power that it is of"),
    ];
    if let (Some(got), Some([expected, off])) = (estimate.fit, evidence.fit(part, pose)) {
        let case = case("fit", "at the same pose, standard deviations", (got - expected).abs(), off + 1e-9);
        cases.push(case.by("a cosine between views over the standard deviation of a match"));
    }
    cases
}

/// Queries as they are compared with the rows: for rows of i8 in whole numbers of 12 bits and a sign.
pub fn kept_queries(scene: &Scene, queries: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
    if scene.precision != Precision::I8 {
        return queries;
    }
    let kept = |query: Vec<f64>| {
        let step = query.iter().fold(0.0, |most: f64, value| most.max(value.abs())) / 4_095.0;
        query.into_iter().map(|value| (value / step).round() * step).collect()
    };
    queries.into_iter().map(kept).collect()
}

/// The largest errors of a cosine with a row as it is kept, and of one between two rows, by queries before they are
/// rounded.
pub fn cosine_errors(scene: &Scene, queries: &[Vec<f64>]) -> [f64; 2] {
    let length = |query: &[f64]| query.iter().map(|value| value * value).sum::<f64>().sqrt();
    // A query is turned in f32: sums of up to 128 products, by a matrix whose lines have squares of 2.6 on average and
    // which leaves any query at least 0.7 of its length.
    let of_metric = if scene.has_metric { OF_COSINE * (DIM as f64 * 2.6).sqrt() / 0.7 } else { 0.0 };
    // A value of a query so near to half a whole number may be rounded the other way in f32: by one step.
    let near = if scene.has_metric { 1e-2 } else { 1e-3 };
    let most_of_row = scene.rows.iter().fold(0.0, |most: f64, value| most.max(f64::from(value.abs())));
    let of_tie = |query: &Vec<f64>| {
        let step = query.iter().fold(0.0, |most: f64, value| most.max(value.abs())) / 4_095.0;
        let n_ties = query.iter().filter(|value| ((*value / step).abs().fract() - 0.5).abs() < near).count();
        n_ties as f64 * step * most_of_row / length(query)
    };
    let of_ties = match scene.precision {
        Precision::I8 => largest(queries.iter().map(of_tie)),
        _ => 0.0,
    };
    [OF_COSINE + of_metric + of_ties, 2.0 * OF_COSINE]
}

/// Rows of each format, after three touches: against the reference of the rows as kept, which is the arithmetic alone,
/// and of the rows before rounding, which is what the format costs.
pub fn precisions(seed: u64) -> Result<Vec<Case>> {
    let mut cases = Vec::new();
    for precision in [Precision::F32, Precision::F16, Precision::Bf16, Precision::I8] {
        let scene = Scene { precision, ..Scene::draw(6, GRID, 3, seed) };
        let bank = Arc::new(scene.bank()?);
        let episode = scene.episode(&bank, scene.config())?;
        let (kept, exact, queries) = (bank.rows().to_f32(), scene.exact_rows()?, scene.queries()?);
        let rounded = kept_queries(&scene, queries.clone());
        let [of_cosine, of_neighbours] = cosine_errors(&scene, &queries);
        let of_rows = largest_distance(&kept, &exact, DIM);
        let of_queries = queries.iter().zip(&rounded).map(|(a, b)| {
            let (apart, length) =
                (a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>(), a.iter().map(|a| a * a).sum::<f64>());
            (apart / length).sqrt()
        });
        let of_queries = largest(of_queries);
        let kinds = [
            ("of its rows", &kept, &rounded, [of_cosine, of_neighbours]),
            (
                "of the rows before rounding",
                &exact,
                &queries,
                [of_cosine + of_rows + of_queries, of_neighbours + 2.0 * of_rows + of_rows * of_rows],
            ),
        ];
        for (kind, rows, queries, errors) in kinds.into_iter().take(if precision == Precision::F32 { 1 } else { 2 }) {
            let recorded = scene.recorded(rows);
            let touches = scene.felt(rows, queries);
            let evidence = Evidence::new(&recorded, &touches, errors);
            let posterior = evidence.posterior(episode.belief().posterior().grid());
            let variant = format!("{precision}, {kind}");
            cases.extend(belief_cases(Group::Precision, &variant, &episode, &posterior));
        }
    }
    Ok(cases)
}

/// The longest difference of two matrices' rows.
fn largest_distance(a: &[f32], b: &[f32], dim: usize) -> f64 {
    let rows = a.chunks_exact(dim).zip(b.chunks_exact(dim));
    let apart = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>().sqrt();
    largest(rows.map(apart))
}

/// The largest value; NaN where there is one, and zero where there is none.
pub fn largest(values: impl Iterator<Item = f64>) -> f64 {
    values.fold(0.0, |largest, value| if value > largest || value.is_nan() { value } else { largest })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_filter::TouchModel;
    use tactile_filter::likelihood::interpolation::Interpolation;

    /// The bounds are no wider than what they are to find: another likelihood, even by a twentieth of the steepness,
    /// is outside them.
    #[test]
    fn a_filter_that_does_otherwise_is_outside_the_bounds() {
        let scene = Scene { precision: Precision::F32, ..Scene::draw(6, GRID, 3, 1) };
        let bank = Arc::new(scene.bank().unwrap());
        let rows = bank.rows().to_f32();
        let recorded = scene.recorded(&rows);
        let queries = scene.queries().unwrap();
        let evidence = Evidence::new(&recorded, &scene.felt(&rows, &queries), cosine_errors(&scene, &queries));
        let held = |change: &dyn Fn(&mut TouchModel)| {
            let config = scene.config().changed(|_, model, _| change(model));
            let episode = scene.episode(&bank, config).unwrap();
            let posterior = evidence.posterior(episode.belief().posterior().grid());
            let cases = belief_cases(Group::Production, "", &episode, &posterior);
            cases.into_iter().find(|case| case.variant.ends_with("states")).unwrap().holds
        };
        assert!(held(&|_| ()));
        assert!(!held(&|model| model.steepness *= 1.05));
        assert!(!held(&|model| model.interpolation = Interpolation::Nearest));
        assert!(!held(&|model| model.shared_mm *= 1.5));
    }

    #[test]
    fn a_query_in_whole_numbers_is_off_by_half_a_step_at_most() {
        let scene = Scene::draw(1, SMALL_GRID, 2, 3);
        let queries = scene.queries().unwrap();
        for (query, kept) in queries.iter().zip(kept_queries(&scene, queries.clone())) {
            let most = largest(query.iter().map(|value| value.abs()));
            assert!(query.iter().zip(&kept).all(|(a, b)| (a - b).abs() <= 0.500_001 * most / 4_095.0));
            assert!(*query != kept);
        }
    }
}
