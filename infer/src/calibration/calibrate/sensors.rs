//! The cosine with the view that was touched: how far it differs within one sensor, and from one sensor to the next.

use super::sample::pooled;
use crate::calibration::{Prior, Spread};

/// The cosine with the view touched under a sensor that may be any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Matched {
    /// Over all touches of all sensors: the standard deviation holds both, that within a sensor and that between them.
    pub all: Spread,
    /// Standard deviation of a sensor's mean; `None` where it was not measured.
    pub between: Option<f64>,
}

impl Matched {
    /// The match of the cosines of touches, `[n_sensors][n_touches]`, with what was known before; `None` where nothing
    /// is.
    ///
    /// Where there are several sensors, they alone count. The touches of one are taken together with a few of what is
    /// known of others: what is still unknown of its mean is the standard error of theirs, where that is less than what
    /// sensors differ by.
    pub(super) fn from_touches(sensors: &[Vec<f64>], prior: Option<&Prior>) -> Option<Self> {
        let seen: Vec<&Vec<f64>> = sensors.iter().filter(|values| !values.is_empty()).collect();
        if seen.len() > 1 {
            return Some(Self::over(&seen));
        }
        let own = seen.first().map_or(&[][..], |values| values.as_slice());
        let all = pooled(own, prior)?;
        let between = prior.and_then(|prior| prior.between_sensors.map(|between| (between, prior.n_touches)));
        let left = |(between, n_known): (f64, f64)| match own.len() {
            0 => between,
            n => between.min(all.sd / (n as f64 + n_known).sqrt()),
        };
        Some(Self { all, between: between.map(left) })
    }

    /// One-way analysis of variance: what the means of sensors differ by, less what so many touches make of it by
    /// chance.
    fn over(sensors: &[&Vec<f64>]) -> Self {
        let spreads: Vec<Spread> = sensors.iter().map(|values| Spread::from_values(values)).collect();
        let n_sensors = spreads.len() as f64;
        let mean_of = |value: &dyn Fn(usize) -> f64| (0..spreads.len()).map(value).sum::<f64>() / n_sensors;
        let within = mean_of(&|sensor| spreads[sensor].sd.powi(2));
        let by_chance = mean_of(&|sensor| spreads[sensor].sd.powi(2) / sensors[sensor].len() as f64);
        let means = Spread::from_values(&spreads.iter().map(|spread| spread.mean).collect::<Vec<_>>());
        let apart = means.sd.powi(2) * n_sensors / (n_sensors - 1.0);
        let between = (apart - by_chance).max(0.0);
        Self { all: Spread { mean: means.mean, sd: (within + between).sqrt() }, between: Some(between.sqrt()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::views::Views;

    fn prior(between_sensors: Option<f64>) -> Prior {
        Prior {
            n_touches: 2.0,
            low_similarity: 0.7,
            matched: Some(Spread { mean: 0.92, sd: 0.05 }),
            between_sensors,
            views: Views::Pegs,
        }
    }

    #[test]
    fn what_sensors_differ_by_is_told_from_what_touches_do() {
        // Fifty touches at the mean and 0.03 above it, fifty as far below: 0.03 within, 0.003 in a mean by chance.
        let sensor = |mean: f64| [mean - 0.03, mean + 0.03].repeat(50);
        let of = |means: [f64; 3]| Matched::from_touches(&means.map(sensor), Some(&prior(Some(0.5)))).unwrap();
        let Matched { all, between } = of([0.88, 0.90, 0.92]);
        // Means 0.02 apart have a variance of 0.0004, of which 0.000009 is chance.
        assert!((between.unwrap() - 0.000_391_f64.sqrt()).abs() < 1e-9, "{between:?}");
        assert!((all.mean - 0.9).abs() < 1e-12 && (all.sd - 0.001_291_f64.sqrt()).abs() < 1e-9, "{all:?}");
        // Nearer together than chance would have them.
        assert_eq!(of([0.9, 0.901, 0.899]).between, Some(0.0));
    }

    #[test]
    fn a_sensors_own_touches_take_the_place_of_what_is_known_of_others() {
        let prior = prior(Some(0.03));
        let none = Matched::from_touches(&[Vec::new()], Some(&prior)).unwrap();
        assert_eq!(none, Matched { all: prior.matched.unwrap(), between: Some(0.03) });
        // Two values 0.84 and 0.88 and two touches of 0.92 and 0.05: a mean of 0.89 and a variance of
        // (2 x 0.0004 + 2 x 0.0025) / 4 + 0.03^2 = 0.00235, and as the standard error of four half its root, 0.02424.
        let two = Matched::from_touches(&[vec![0.84, 0.88]], Some(&prior)).unwrap();
        assert!((two.all.mean - 0.89).abs() < 1e-12 && (two.all.sd.powi(2) - 0.002_35).abs() < 1e-12, "{two:?}");
        assert!((two.between.unwrap() - 0.5 * 0.002_35_f64.sqrt()).abs() < 1e-12, "{two:?}");
        // One says less of its sensor than what sensors differ by.
        assert_eq!(Matched::from_touches(&[vec![0.7]], Some(&prior)).unwrap().between, Some(0.03));
        let many = Matched::from_touches(&[[0.84, 0.88].repeat(5_000)], Some(&prior)).unwrap();
        assert!((many.all.mean - 0.86).abs() < 1e-4 && many.between.unwrap() < 3e-4, "{many:?}");
    }

    #[test]
    fn where_sensors_were_not_compared_touches_are_pooled_as_one() {
        let values = vec![0.84, 0.88];
        let pooled = pooled(&values, Some(&prior(None))).unwrap();
        assert_eq!(Matched::from_touches(&[values], Some(&prior(None))), Some(Matched { all: pooled, between: None }));
        assert_eq!(Matched::from_touches(&[], None), None);
    }
}
