//! Rounding that becomes vector instructions: Rust's own calls the maths library or saturates value by value.

/// What is added to round: 1.5 * 2^23 leaves a float no room for a fraction.
const NO_FRACTION: f32 = 12_582_912.0;

/// The nearest whole number, ties to even, for magnitudes below 2^22.
#[inline(always)]
pub fn round(value: f32) -> f32 {
    (value + NO_FRACTION) - NO_FRACTION
}

/// The nearest whole number, ties to even, for magnitudes below 2^22.
#[inline(always)]
pub fn to_whole(value: f32) -> i32 {
    (value + NO_FRACTION).to_bits() as i32 - NO_FRACTION.to_bits() as i32
}

/// The nearest count, ties to even, within 0..=255.
#[inline(always)]
pub fn to_byte(counts: f32) -> u8 {
    to_whole(counts.clamp(0.0, 255.0)) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_that_of_the_maths_library() {
        for i in -40_000..40_000 {
            let value = i as f32 * 0.03125;
            assert_eq!(round(value), value.round_ties_even());
            assert_eq!(to_whole(value), value.round_ties_even() as i32);
            assert_eq!(to_byte(value), value.clamp(0.0, 255.0).round_ties_even() as u8);
        }
    }
}
