//! The cosine with the view that was touched: how far it differs from touch to touch, from hole to hole, from part to part and from
//! sensor to sensor.

use std::collections::BTreeMap;

use super::sample::pooled;
use crate::calibration::{Between, Prior, Spread};

/// The cosine with the view touched under a sensor that may be any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Matched {
    /// Over all touches of all sensors.
    pub all: Spread,
    /// What they have in common; `None` where it was not measured.
    pub between: Option<Between>,
}

/// The touches of one part under one sensor.
#[derive(Clone, Copy)]
struct Hole {
    n: f64,
    mean: f64,
    /// Sum of squares about the mean.
    squares: f64,
}

impl Matched {
    /// The match of touches, each its part and its cosine, `[n_sensors][n_touches]`, with what was known before; `None` where
    /// nothing is.
    ///
    /// Where there are several sensors, they alone count. The touches of one are taken together with a few of what is
    /// known of others: what is still unknown of its mean is the standard error of theirs, where that is less than what
    /// sensors differ by. Parts and holes then have the share of its variance that they have of what is known.
    pub(super) fn from_touches(sensors: &[Vec<(usize, f64)>], prior: Option<&Prior>) -> Option<Self> {
        let seen: Vec<&Vec<(usize, f64)>> = sensors.iter().filter(|touches| !touches.is_empty()).collect();
        if seen.len() > 1 {
            return Some(Self::over(&seen));
        }
        let own: Vec<f64> = seen.iter().flat_map(|touches| touches.iter().map(|(_, cosine)| *cosine)).collect();
        let all = pooled(&own, prior)?;
        let known = prior.and_then(|prior| prior.between.zip(prior.matched).map(|known| (known, prior.n_touches)));
        let left = |((between, matched), n_known): ((Between, Spread), f64)| {
            let by_chance = match own.len() {
                0 => f64::INFINITY,
                n => all.sd / (n as f64 + n_known).sqrt(),
            };
            let scale = if matched.sd > 0.0 { all.sd / matched.sd } else { 0.0 };
            let sensors = between.sensors.min(by_chance);
            Between { sensors, parts: scale * between.parts, holes: scale * between.holes }
        };
        Some(Self { all, between: known.map(left) })
    }

    /// Two-way analysis of variance: what the means of sensors, of parts and of holes differ by, each less what the others and so
    /// many touches make of it by chance. Parts count that every sensor touched; of two or more the rest is found.
    fn over(sensors: &[&Vec<(usize, f64)>]) -> Self {
        let table = table(sensors, |part| part);
        // Too few parts to compare: all touches of a sensor as those of one.
        if table[0].len() > 1 { of_table(&table) } else { of_table(&self::table(sensors, |_| 0)) }
    }
}

/// The holes of the parts that every sensor touched, `[n_sensors][n_parts]`.
fn table(sensors: &[&Vec<(usize, f64)>], part_as: impl Fn(usize) -> usize) -> Vec<Vec<Hole>> {
    let values = sensors.iter().map(|touches| {
        let mut values: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
        touches.iter().for_each(|(part, cosine)| values.entry(part_as(*part)).or_default().push(*cosine));
        values
    });
    let values: Vec<_> = values.collect();
    let is_complete = |part: &&usize| values.iter().all(|of_sensor| of_sensor.contains_key(part));
    let parts: Vec<usize> = values[0].keys().filter(is_complete).copied().collect();
    values.iter().map(|of_sensor| parts.iter().map(|part| Hole::of(&of_sensor[part])).collect()).collect()
}

impl Hole {
    fn of(cosines: &[f64]) -> Self {
        let (Spread { mean, sd }, n) = (Spread::from_values(cosines), cosines.len() as f64);
        Self { n, mean, squares: n * sd * sd }
    }
}

/// Components of variance of a table of holes, `[n_sensors][n_parts]`, by the expected squares of its means (Searle, Casella and
/// McCulloch, Variance Components, 1992, 4.3, of unweighted means).
fn of_table(table: &[Vec<Hole>]) -> Matched {
    let (n_sensors, n_parts) = (table.len() as f64, table[0].len() as f64);
    let cells = || table.iter().flatten();
    let mean = cells().map(|hole| hole.mean).sum::<f64>() / (n_sensors * n_parts);
    let freedom = cells().map(|hole| hole.n - 1.0).sum::<f64>();
    let within = cells().map(|hole| hole.squares).sum::<f64>() / freedom.max(1.0);
    let of_hole = within * cells().map(|hole| hole.n.recip()).sum::<f64>() / (n_sensors * n_parts);
    let of_sensors: Vec<f64> =
        table.iter().map(|holes| holes.iter().map(|hole| hole.mean).sum::<f64>() / n_parts - mean).collect();
    let of_parts: Vec<f64> = (0..table[0].len())
        .map(|part| table.iter().map(|holes| holes[part].mean).sum::<f64>() / n_sensors - mean)
        .collect();
    let squares = |of: &[f64], freedom: f64| of.iter().map(|off| off * off).sum::<f64>() / freedom.max(1.0);
    let left: Vec<f64> = (table.iter().zip(&of_sensors))
        .flat_map(|(holes, sensor)| {
            holes.iter().zip(&of_parts).map(move |(hole, part)| hole.mean - mean - sensor - part)
        })
        .collect();
    // Of one part what is left of holes is nothing: they cannot be told from sensors.
    let of_cell = if n_parts > 1.0 { squares(&left, (n_sensors - 1.0) * (n_parts - 1.0)) } else { of_hole };
    let sensors = (squares(&of_sensors, n_sensors - 1.0) - of_cell / n_parts).max(0.0);
    let parts = (squares(&of_parts, n_parts - 1.0) - of_cell / n_sensors).max(0.0);
    let holes = (of_cell - of_hole).max(0.0);
    let all = Spread { mean, sd: (within + sensors + parts + holes).sqrt() };
    let between = Between { sensors: sensors.sqrt(), parts: parts.sqrt(), holes: holes.sqrt() };
    Matched { all, between: Some(between) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::views::Views;

    fn prior(between: Option<Between>) -> Prior {
        let matched = Some(Spread { mean: 0.92, sd: 0.05 });
        Prior { n_touches: 2.0, low_similarity: 0.7, matched, between, views: Views::Pegs }
    }

    const KNOWN: Between = Between { sensors: 0.03, parts: 0.02, holes: 0.01 };

    fn of_one_part(cosines: Vec<f64>) -> Vec<(usize, f64)> {
        cosines.into_iter().map(|cosine| (0, cosine)).collect()
    }

    #[test]
    fn what_sensors_differ_by_is_told_from_what_touches_do() {
        // Fifty touches 0.03 above the mean and fifty as far below.
        let sensor = |mean: f64| of_one_part([mean - 0.03, mean + 0.03].repeat(50));
        let of = |means: [f64; 3]| Matched::from_touches(&means.map(sensor), Some(&prior(Some(KNOWN)))).unwrap();
        let Matched { all, between } = of([0.88, 0.90, 0.92]);
        // Means 0.02 apart have a variance of 0.0004, of which a hundredth of that of touches is chance.
        let of_touches = 0.0009_f64 * 100.0 / 99.0;
        let sensors = 0.0004 - of_touches / 100.0;
        let Between { sensors: found, parts, holes } = between.unwrap();
        assert!((found - sensors.sqrt()).abs() < 1e-9 && parts == 0.0 && holes == 0.0, "{between:?}");
        assert!((all.mean - 0.9).abs() < 1e-12 && (all.sd.powi(2) - of_touches - sensors).abs() < 1e-12, "{all:?}");
        // Nearer together than chance would have them.
        assert_eq!(of([0.9, 0.901, 0.899]).between.unwrap().sensors, 0.0);
    }

    #[test]
    fn sensors_parts_holes_and_touches_are_told_apart() {
        // Each as far above its mean as below: 80 sensors touch 80 parts three times.
        let [sensor_sd, part_sd, hole_sd, touch_sd] = [0.012_f64, 0.05, 0.02, 0.03];
        let mut state = 7_u64;
        let mut normal = || {
            let mut uniform = || {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        };
        let parts: Vec<f64> = (0..80).map(|_| part_sd * normal()).collect();
        let mut sensor = || {
            let mean = 0.9 + sensor_sd * normal();
            let mut touches = Vec::new();
            for (part, off) in parts.iter().enumerate() {
                let of_hole = mean + off + hole_sd * normal();
                touches.extend((0..3).map(|_| (part, of_hole + touch_sd * normal())));
            }
            touches
        };
        let mut sensors: Vec<Vec<(usize, f64)>> = (0..80).map(|_| sensor()).collect();
        // One that not every sensor touched.
        sensors[0].push((80, 0.1));
        let Matched { all, between } = Matched::from_touches(&sensors, None).unwrap();
        let Between { sensors, parts, holes } = between.unwrap();
        let total = [sensor_sd, part_sd, hole_sd, touch_sd].iter().map(|sd| sd * sd).sum::<f64>().sqrt();
        for (found, drawn) in [(sensors, sensor_sd), (parts, part_sd), (holes, hole_sd), (all.sd, total)] {
            // So few sensors and parts are off by a twelfth, one in twenty by twice that.
            assert!((found / drawn - 1.0).abs() < 0.17, "{between:?} {all:?}");
        }
    }

    #[test]
    fn a_sensors_own_touches_take_the_place_of_what_is_known_of_others() {
        let prior = prior(Some(KNOWN));
        let none = Matched::from_touches(&[Vec::new()], Some(&prior)).unwrap();
        assert_eq!(none, Matched { all: prior.matched.unwrap(), between: Some(KNOWN) });
        // Two values 0.84 and 0.88 and two touches of 0.92 and 0.05: a mean of 0.89 and a variance of
        // (2 x 0.0004 + 2 x 0.0025) / 4 + 0.03^2 = 0.00235, and as the standard error of four half its root, 0.02424.
        let two = Matched::from_touches(&[of_one_part(vec![0.84, 0.88])], Some(&prior)).unwrap();
        let sd = 0.002_35_f64.sqrt();
        assert!((two.all.mean - 0.89).abs() < 1e-12 && (two.all.sd - sd).abs() < 1e-12, "{two:?}");
        let Between { sensors, parts, holes } = two.between.unwrap();
        assert!((sensors - 0.5 * sd).abs() < 1e-12, "{two:?}");
        assert!((parts - 0.4 * sd).abs() < 1e-12 && (holes - 0.2 * sd).abs() < 1e-12, "{two:?}");
        // One says less of its sensor than what sensors differ by.
        let one = Matched::from_touches(&[of_one_part(vec![0.7])], Some(&prior)).unwrap();
        assert_eq!(one.between.unwrap().sensors, 0.03);
        let many = Matched::from_touches(&[of_one_part([0.84, 0.88].repeat(5_000))], Some(&prior)).unwrap();
        assert!((many.all.mean - 0.86).abs() < 1e-4 && many.between.unwrap().sensors < 3e-4, "{many:?}");
    }

    #[test]
    fn where_sensors_were_not_compared_touches_are_pooled_as_one() {
        let values = vec![0.84, 0.88];
        let all = pooled(&values, Some(&prior(None))).unwrap();
        let found = Matched::from_touches(&[of_one_part(values)], Some(&prior(None)));
        assert_eq!(found, Some(Matched { all, between: None }));
        assert_eq!(Matched::from_touches(&[], None), None);
    }
}
