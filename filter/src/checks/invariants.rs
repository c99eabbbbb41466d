//! What must hold for any numbers, and bugs of other filters that no other file tests.

use proptest::prelude::*;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::Bank;
use tactile_infer::bank::rows::Rows;

use crate::belief::Belief;
use crate::belief::Layout;
use crate::belief::exact::Exact;
use crate::belief::particle::{Particle, ParticleConfig};
use crate::belief::posterior::Posterior;
use crate::belief::resample::systematic;
use crate::likelihood::TouchLikelihood;
use crate::touch::Observation;
use crate::touch_model::TouchModel;

const POINT: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 0.0, theta_step_deg: 30.0 };

/// The probability of each of some parts of one row after touches at one place.
fn posterior(rows: &[[f32; 3]], shares: &[f32], touches: &[[f32; 3]], config: &TouchModel) -> Vec<f64> {
    let names = (0..rows.len()).map(|part| part.to_string()).collect();
    let bank = Bank::from_rows(names, POINT, Rows::new(3, rows.concat()).unwrap(), shares.to_vec(), "").unwrap();
    let seen = |query: &[f32; 3]| TouchLikelihood::new(&Observation::new(query.to_vec(), 0.2), &bank, config).unwrap();
    let mut belief = Belief::of_all_states(&bank, 1, seen(&touches[0]));
    for touch in &touches[1..] {
        belief.update(&Se2::IDENTITY, seen(touch));
    }
    belief.posterior().by_part().to_vec()
}

fn rows(n: usize) -> impl Strategy<Value = Vec<[f32; 3]>> {
    prop::collection::vec(prop::array::uniform3(-0.57..0.57_f32), n)
}

/// Touches at one place that all count.
fn independent() -> TouchModel {
    TouchModel { shared_mm: 0.0, ..TouchModel::default() }
}

proptest! {
    #[test]
    fn permuting_the_rows_permutes_the_posterior(
        (order, rows) in (Just((0..6).collect::<Vec<usize>>()).prop_shuffle(), rows(6)),
        touches in rows(3),
    ) {
        let shares = [0.2, 0.0, 0.2, 0.3, 0.0, 0.2];
        let permuted: Vec<[f32; 3]> = order.iter().map(|at| rows[*at]).collect();
        let permuted_shares: Vec<f32> = order.iter().map(|at| shares[*at]).collect();
        let before = posterior(&rows, &shares, &touches, &independent());
        let after = posterior(&permuted, &permuted_shares, &touches, &independent());
        for (at, probability) in order.iter().zip(after) {
            // The cosines are the same to the bit; only the order of f64 sums differs.
            prop_assert!((probability - before[*at]).abs() < 1e-12);
        }
    }

    #[test]
    fn adding_an_impossible_part_changes_nothing(rows in rows(4), touch in rows(1)) {
        let length = touch[0].iter().map(|value| value * value).sum::<f32>().sqrt();
        prop_assume!(length > 0.1);
        // Its cosine is -1, the others' above -0.99 * sqrt(3 / 3): without a floor e^(0.01 / 1e-4) behind.
        let opposite = touch[0].map(|value| -value / length);
        let config = TouchModel { temperature: Some(1e-4), ..TouchModel::paper() };
        let cosines = rows.iter().map(|row| row.iter().zip(&touch[0]).map(|(a, b)| a * b).sum::<f32>() / length);
        prop_assume!(cosines.fold(-1.0, f32::max) > -0.9);
        let without = posterior(&rows, &[0.2; 4], &touch, &config);
        let with = posterior(&[rows, vec![opposite]].concat(), &[0.2; 5], &touch, &config);
        for (a, b) in without.iter().zip(&with) {
            prop_assert!((a - b).abs() < 1e-12);
        }
        prop_assert_eq!(with[4], 0.0);
    }

    /// What a touch shows is drawn from the truth's likelihood: all sequences of three symbols, each weighed by
    /// its probability, so that the expectation is exact.
    #[test]
    fn more_touches_of_the_truth_never_lower_its_evidence_in_expectation(
        tables in prop::collection::vec(prop::collection::vec(prop::array::uniform3(0.01..1.0_f64), 4), 4),
        truth in 0..4_usize,
    ) {
        // p(symbol | state) of each touch.
        let tables: Vec<Vec<[f64; 3]>> = tables
            .iter()
            .map(|table| table.iter().map(|row| row.map(|value| value / row.iter().sum::<f64>())).collect())
            .collect();
        let mut sequences = vec![(Exact::uniform(Layout { n_angles: 1, n_places: 4 }, 1, 0.0), 1.0)];
        let mut before = 0.25_f64.ln();
        for table in &tables {
            sequences = sequences
                .iter()
                .flat_map(|(exact, probability)| {
                    (0..3).map(move |symbol| {
                        let mut exact = exact.clone();
                        exact.update(&[0.0], &mut |_, _, sums| {
                            sums.iter_mut().zip(table).for_each(|(sum, state)| *sum += state[symbol].ln());
                        });
                        (exact, probability * table[truth][symbol])
                    })
                })
                .collect();
            let log_of = |exact: &Exact| {
                let posterior = Posterior::new(POINT, Layout { n_angles: 1, n_places: 4 }, exact.weighed());
                posterior.states()[truth].1.ln()
            };
            let after: f64 = sequences.iter().map(|(exact, probability)| probability * log_of(exact)).sum();
            prop_assert!(after >= before - 1e-12, "{after} {before}");
            before = after;
        }
    }
}

#[test]
fn filterpy_290_whole_shares_are_kept_whole() {
    // Residual resampling drew by w - floor(N w), negative where N w is above 1, for N w - floor(N w).
    let drawn = systematic(&[0.5, 0.3, 0.2], 10, 0.5);
    let counts = [0, 1, 2].map(|index| drawn.iter().filter(|i| **i == index).count());
    assert_eq!(counts, [5, 3, 2]);
    // Of 10 draws by 0.25 and 0.75 the halves go to either, in the mean over the offset to both alike.
    let n_first =
        |k: i32| systematic(&[0.25, 0.75], 10, (f64::from(k) + 0.5) / 1000.0).iter().filter(|i| **i == 0).count();
    assert_eq!((0..1000).map(n_first).sum::<usize>(), 2_500);
}

#[test]
fn pfilter_8_weights_stay_with_their_particles_when_resampled() {
    let mut particle = Particle::draw(ParticleConfig::paper(), &[0.25_f64.ln(); 4], 1);
    let share = |particle: &Particle, of: usize| -> f64 {
        particle.weighted().filter(|(state, _)| *state == of).map(|(_, weight)| weight).sum()
    };
    let drawn = [0, 1, 2, 3].map(|state| share(&particle, state));
    particle.update(|state| [1.0, 2.0, 4.0, 8.0_f64][state].ln());
    let total: f64 = drawn.iter().zip([1.0, 2.0, 4.0, 8.0]).map(|(n, weight)| n * weight).sum();
    for state in 0..4 {
        // Some 25 particles of a state, each kept within one of its expectation: 0.5 * 5 / 100, four of those.
        assert!((share(&particle, state) - drawn[state] * [1.0, 2.0, 4.0, 8.0][state] / total).abs() <= 0.1);
    }
    // The weights are equal again: were they those from before, heavy states would count twice.
    assert!(particle.weighted().all(|(_, weight)| (weight - 0.01).abs() < 1e-12));
}

#[test]
fn mcl_3dl_232_the_first_particle_goes_as_often_as_any_other() {
    // Twenty equal weights, ten draws: each comes up in half of all offsets.
    for index in [0, 1, 19] {
        let stays = |k: i32| systematic(&[0.05; 20], 10, (f64::from(k) + 0.5) / 1000.0).contains(&index);
        assert_eq!((0..1000).filter(|k| stays(*k)).count(), 500, "particle {index}");
    }
}
