//! How a part seems to differ in size from its own map, measured when its bank is made.

use serde::{Deserialize, Serialize};
use tactile_data::pose::se2::Se2;

use super::align::Drawing;
use super::mosaic::Mosaic;
use super::strain::Strain;

/// How a part seems to differ in size from its own map: what holes read unlike pegs is no other size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UsualStrain {
    /// The strain of all its touches together.
    pub mean: [f64; 3],
    /// How many times as far as they say, in variance, a few touches are from that.
    pub times: f64,
}

/// Touches of which it is asked how far they are from all of them.
const A_FEW: usize = 4;

impl UsualStrain {
    /// The usual strain of touches, laid where they were made on a part; at least four.
    pub fn of(touches: &[Drawing<'_>], mosaic: &Mosaic<'_>) -> Self {
        let mean = Strain::of(touches, mosaic, &Se2::IDENTITY).mean;
        let n_groups = (touches.len() / A_FEW).max(1);
        let group = |at: usize| -> Vec<Drawing<'_>> { touches.iter().skip(at).step_by(n_groups).copied().collect() };
        let groups: Vec<Vec<Drawing<'_>>> = (0..n_groups).map(group).collect();
        let all = Self { mean, times: 1.0 };
        let far = |few: &Vec<Drawing<'_>>| Strain::of(few, mosaic, &Se2::IDENTITY).against(&all).squared();
        let times = groups.iter().map(far).sum::<f64>() / (3 * n_groups) as f64;
        Self { mean, times }
    }

    /// Whether touches can come to it.
    pub(super) fn is_possible(&self) -> bool {
        self.mean.iter().all(|strain| strain.is_finite()) && self.times.is_finite() && self.times >= 0.0
    }
}

#[cfg(test)]
mod tests {
    use tactile_data::dataset::touch::Side;

    use super::super::mosaic::tests::mosaics;
    use super::super::strain::tests::stretched;
    use super::*;

    #[test]
    fn touches_of_a_part_that_reads_larger_are_usual_of_it() {
        let touches = stretched([0.05, 0.05, 0.0], 0.0);
        let first = Se2::from_degrees(4.5, 0.3, 20.0);
        let drawings: Vec<Drawing<'_>> =
            touches.iter().map(|(pose, map)| Drawing { map, first_from_sensor: first * *pose }).collect();
        let mosaics = mosaics();
        let mosaic = mosaics.of(0, Side::Peg);
        let usual = UsualStrain::of(&drawings, &mosaic);
        assert!((0..2).all(|axis| (usual.mean[axis] - 0.05).abs() < 0.01), "{usual:?}");
        let found = Strain::of(&drawings, &mosaic, &Se2::IDENTITY);
        // Against what is usual it is of the right size, and by itself it is not.
        assert!(found.against(&usual).off_nats() < 0.1 && found.off_nats() > 1.0, "{found:?}");
        assert!(usual.is_possible() && !UsualStrain { times: f64::NAN, ..usual }.is_possible());
    }
}
