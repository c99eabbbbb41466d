//! How badly touches match, and the error that they have in common.

use crate::likelihood::touch_likelihood::TouchLikelihood;
use crate::touch_model::TouchModel;

/// The mean cosine of the edged touches' best matches at which touches match well, as under a sensor that the network
/// knows, and at which they match as badly as counts. Neither has to be exact (`NOTES.md`).
const WELL_AND_BADLY: [f64; 2] = [0.92, 0.7];

/// The touches of one hole share so many times more of their error where they match badly than where they match well, less
/// one: a rough sensor, or a part that the training lacks, does to the next touch what it does to one.
const MORE_SHARED: f64 = 5.0;

/// The share of their error that touches have in common, 0..=1.
pub(crate) fn shared_error<'a>(config: &TouchModel, touches: impl Iterator<Item = &'a TouchLikelihood>) -> f64 {
    (config.shared_error * (1.0 + MORE_SHARED * mismatch(touches))).min(1.0)
}

/// How badly the edged touches match at best, 0..=1; 0 where no touch showed an edge. It is measured by plain cosines: a
/// calibration under a rough sensor would expect low ones, and a bank's own metric would measure the bank.
pub(crate) fn mismatch<'a>(touches: impl Iterator<Item = &'a TouchLikelihood>) -> f64 {
    let (sum, n_edged) = touches
        .filter(|touch| !touch.blank)
        .fold((0.0, 0_usize), |(sum, n), touch| (sum + f64::from(touch.best_cosine), n + 1));
    let [well, badly] = WELL_AND_BADLY;
    if n_edged == 0 { 0.0 } else { ((well - sum / n_edged as f64) / (well - badly)).clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use tactile_data::grid::PoseGrid;
    use tactile_infer::Bank;
    use tactile_infer::metric::{Measured, Metric};
    use tactile_infer::rows::Rows;

    use super::*;
    use crate::touch::Observation;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    #[test]
    fn the_same_touches_match_as_badly_in_any_metric() {
        let metric = |matrix: [f32; 9]| {
            Metric::new(3, matrix.to_vec(), Measured { error_scale: 0.3, temperature: Some(0.02) }).unwrap()
        };
        let near = metric([1.0, 0.0, 0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 0.1]);
        let far = metric([0.3, 0.0, 0.0, 0.1, 3.0, 0.0, 0.0, -0.2, 1.0]);
        let query = Observation::new(vec![0.2, 0.9, 0.35], 0.2);
        let mismatches = [None, Some(near), Some(far)].map(|metric| {
            let rows = Rows::new(3, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].concat()).unwrap();
            let plain = Bank::from_rows(vec!["A".into()], GRID, rows, vec![0.2; 3], "").unwrap();
            let bank = metric.map_or(plain.clone(), |metric| plain.with_metric(metric).unwrap());
            let touch = TouchLikelihood::new(&query, &bank, &TouchModel::default()).unwrap();
            mismatch(std::iter::once(&touch))
        });
        // It resembles the view along y, by the cosine of 0.9 over the length: a little.
        let by_hand = (0.92 - 0.9 / (0.04_f64 + 0.81 + 0.1225).sqrt()) / 0.22;
        assert!(mismatches.iter().all(|found| (found - by_hand).abs() < 1e-5), "{mismatches:?}, by hand {by_hand}");
    }
}
