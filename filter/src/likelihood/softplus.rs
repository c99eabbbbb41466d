//! ln(1 + e^z) from a table: it is asked for at every state at every touch.

use std::sync::LazyLock;

/// The table spans -EDGE..=EDGE.
const EDGE: f64 = 20.0;

/// Table entries a unit.
const PER_UNIT: f64 = 32.0;

/// Value and slope at each entry.
static TABLE: LazyLock<Vec<[f64; 2]>> = LazyLock::new(|| {
    let n = (2.0 * EDGE * PER_UNIT) as usize + 1;
    (0..n).map(|i| i as f64 / PER_UNIT - EDGE).map(|z| [exactly(z), 1.0 / (1.0 + (-z).exp())]).collect()
});

/// ln(1 + e^z), to within 4e-10: a cubic through value and slope at the two entries around z, whose error is at most
/// `h^4 / 384` times the fourth derivative, which is at most 1 / 8, with `h` a 32nd.
pub fn softplus(z: f64) -> f64 {
    let place = (z + EDGE) * PER_UNIT;
    let table = &*TABLE;
    if !(place >= 0.0 && place < (table.len() - 1) as f64) {
        return exactly(z);
    }
    let index = place as usize;
    let ([low, low_slope], [high, high_slope]) = (table[index], table[index + 1]);
    let (t, rise) = (place - index as f64, high - low);
    let (before, after) = (low_slope / PER_UNIT - rise, rise - high_slope / PER_UNIT);
    low + t * (rise + (1.0 - t) * (before * (1.0 - t) + after * t))
}

fn exactly(z: f64) -> f64 {
    z.max(0.0) + (-z.abs()).exp().ln_1p()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_table_agrees_with_the_definition(z in -30.0..30.0_f64) {
            // Straight from the definition; e^30 and 1 + e^-30 are exact enough in f64.
            prop_assert!((softplus(z) - (1.0 + z.exp()).ln()).abs() < 4e-10);
        }
    }

    #[test]
    fn far_out_it_is_a_line_or_zero() {
        assert_eq!([softplus(1e9), softplus(-1e9), softplus(f64::NEG_INFINITY)], [1e9, 0.0, 0.0]);
        assert!(softplus(f64::NAN).is_nan());
    }
}
