//! Rounding to IEEE 754 binary16, as a bank kept in half the memory would be.

/// Bits of an f32's fraction that an f16 has no room for.
const DROPPED: u32 = 23 - 10;

/// The smallest normal f16.
const SMALLEST_NORMAL: f32 = 6.103_515_6e-5;

/// The distance between subnormal f16s, 2^-24.
const SUBNORMAL_STEP: f32 = 5.960_464_5e-8;

/// The least magnitude that rounds to infinity: half a step above the largest f16, 65504.
const OVERFLOW: f32 = 65_520.0;

/// The nearest f16, of two the even one, as an f32.
pub fn to_f16(value: f32) -> f32 {
    if value.is_nan() || value.abs() >= OVERFLOW {
        return if value.is_nan() { value } else { f32::INFINITY.copysign(value) };
    }
    if value.abs() < SMALLEST_NORMAL {
        return (value / SUBNORMAL_STEP).round_ties_even() * SUBNORMAL_STEP;
    }
    // Half a step, or just below it where the last kept bit is even: a tie then rounds down. A carry goes
    // into the exponent, as it should.
    let bits = value.to_bits();
    let to_nearest = (1 << (DROPPED - 1)) - 1 + (bits >> DROPPED & 1);
    f32::from_bits((bits + to_nearest) >> DROPPED << DROPPED)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values_are_met() {
        // Tables of IEEE 754 binary16: 1/3 is 0x3555, the step at 1 is 2^-10, at 2048 it is 2.
        for (value, expected) in [
            (0.0, 0.0),
            (1.0, 1.0),
            (1.0 / 3.0, 0.333_251_95),
            (0.1, 0.099_975_586),
            (1.0 + 2.0_f32.powi(-11), 1.0),
            (1.0 + 3.0 * 2.0_f32.powi(-11), 1.0 + 2.0_f32.powi(-9)),
            (2049.0, 2048.0),
            (2051.0, 2052.0),
            (65_504.0, 65_504.0),
            (65_519.9, 65_504.0),
            (65_520.0, f32::INFINITY),
            (6.103_515_6e-5, 6.103_515_6e-5),
            (5.960_464_5e-8, 5.960_464_5e-8),
            (2.0_f32.powi(-25), 0.0),
            (3.0 * 2.0_f32.powi(-25), 2.0_f32.powi(-23)),
        ] {
            assert_eq!(to_f16(value), expected, "{value}");
            assert_eq!(to_f16(-value), -expected, "-{value}");
        }
        assert!(to_f16(f32::NAN).is_nan());
    }

    #[test]
    fn every_f16_stays_and_all_between_go_to_the_nearer() {
        // All positive finite f16s, decoded from their definition.
        let decode = |bits: u32| -> f64 {
            let (exponent, fraction) = (bits >> 10, f64::from(bits & 0x3ff));
            if exponent == 0 {
                fraction * 2.0_f64.powi(-24)
            } else {
                (1.0 + fraction / 1024.0) * 2.0_f64.powi(exponent as i32 - 15)
            }
        };
        for bits in 0..0x7bff {
            let (low, high) = (decode(bits), decode(bits + 1));
            assert_eq!(to_f16(low as f32), low as f32);
            for share in [0.01, 0.4, 0.6, 0.99] {
                let nearer = if share < 0.5 { low } else { high };
                assert_eq!(to_f16((low + share * (high - low)) as f32), nearer as f32);
            }
        }
    }
}
