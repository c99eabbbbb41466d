//! How many bits a value is stored in.

use std::fmt;
use std::str::FromStr;

use half::{bf16, f16};
use safetensors::tensor::Dtype;

use crate::error::{Error, Result};

/// The number format of weights or of a bank's rows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Precision {
    /// 32 bits, as computed.
    #[default]
    F32,
    /// 16 bits, eleven of them significant, up to 65,504.
    F16,
    /// 16 bits, eight of them significant, with f32's range.
    Bf16,
    /// 8 bits, whole numbers in -127..=127 with a scale for each row: rows of a bank only.
    I8,
}

impl Precision {
    /// Every name that `--rows` takes.
    pub const ROWS: [&str; 4] = ["f32", "f16", "bf16", "i8"];

    /// Every name that `--weights` takes.
    pub const WEIGHTS: [&str; 3] = ["f32", "f16", "bf16"];

    /// The format's name in a safetensors file.
    pub fn dtype(self) -> Dtype {
        match self {
            Self::F32 => Dtype::F32,
            Self::F16 => Dtype::F16,
            Self::Bf16 => Dtype::BF16,
            Self::I8 => Dtype::I8,
        }
    }

    /// Memory of a bank's row of `dim` values, bytes, its scale included where it has one.
    pub fn n_bytes_of_row(self, dim: usize) -> usize {
        dim * self.dtype().bitsize() / 8 + if self == Self::I8 { 4 } else { 0 }
    }

    /// The format of this name in a safetensors file; `None` for one that these files do not hold.
    pub fn from_dtype(dtype: Dtype) -> Option<Self> {
        [Self::F32, Self::F16, Self::Bf16, Self::I8].into_iter().find(|precision| precision.dtype() == dtype)
    }

    /// The nearest value that the format holds; infinite where `value` is beyond its range.
    pub fn round(self, value: f32) -> f32 {
        match self {
            Self::F32 => value,
            Self::F16 => f16::from_f32(value).to_f32(),
            Self::Bf16 => bf16::from_f32(value).to_f32(),
            Self::I8 if value.abs() < 127.5 => value.round(),
            Self::I8 => value.signum() * f32::INFINITY,
        }
    }

    /// Rounds values to what the format holds.
    ///
    /// # Errors
    /// A finite value beyond the format's range; the error names `what`.
    pub fn round_all(self, what: &str, values: &mut [f32]) -> Result<()> {
        for value in values {
            let rounded = self.round(*value);
            if value.is_finite() && !rounded.is_finite() {
                return Err(Error::invalid(what, format!("values in the range of {self}"), format!("{value:e}")));
            }
            *value = rounded;
        }
        Ok(())
    }

    /// The values as they stand in a file, little endian.
    ///
    /// # Errors
    /// A value that the format does not hold exactly: [`Self::round_all`] comes first. The error names `what`.
    pub fn to_bytes(self, what: &str, values: &[f32]) -> Result<Vec<u8>> {
        if let Some(value) = values.iter().find(|value| self.round(**value) != **value && !value.is_nan()) {
            return Err(Error::invalid(what, format!("values that {self} holds"), format!("{value:e}")));
        }
        Ok(match self {
            Self::F32 => values.iter().flat_map(|value| value.to_le_bytes()).collect(),
            Self::F16 => values.iter().flat_map(|value| f16::from_f32(*value).to_le_bytes()).collect(),
            Self::Bf16 => values.iter().flat_map(|value| bf16::from_f32(*value).to_le_bytes()).collect(),
            Self::I8 => values.iter().flat_map(|value| (*value as i8).to_le_bytes()).collect(),
        })
    }

    /// The values of a file's bytes, each exact; bytes that are left over are not read.
    pub fn from_bytes(self, bytes: &[u8]) -> Vec<f32> {
        match self {
            Self::F32 => bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect(),
            Self::F16 => bytes.as_chunks::<2>().0.iter().map(|b| f16::from_le_bytes(*b).to_f32()).collect(),
            Self::Bf16 => bytes.as_chunks::<2>().0.iter().map(|b| bf16::from_le_bytes(*b).to_f32()).collect(),
            Self::I8 => bytes.iter().map(|b| f32::from(i8::from_le_bytes([*b]))).collect(),
        }
    }
}

impl fmt::Display for Precision {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Self::ROWS[*self as usize])
    }
}

impl FromStr for Precision {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        let known = [Self::F32, Self::F16, Self::Bf16, Self::I8].into_iter().find(|known| known.to_string() == name);
        known.ok_or_else(|| Error::invalid("precision", Self::ROWS.join(" or "), name))
    }
}

#[cfg(test)]
mod weights_tests;

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Precision; 4] = [Precision::F32, Precision::F16, Precision::Bf16, Precision::I8];

    #[test]
    fn a_rounded_value_is_within_half_a_step_and_comes_back_from_its_bytes() {
        let values: Vec<f32> = (0..2_000).map(|i| (i as f32 * 0.77).sin() * 100.0).collect();
        for (precision, relative, absolute) in [
            (Precision::F16, 2.0_f32.powi(-11), 1e-7),
            (Precision::Bf16, 2.0_f32.powi(-8), 0.0),
            (Precision::I8, 0.0, 0.5),
        ] {
            let mut rounded = values.clone();
            precision.round_all("x", &mut rounded).unwrap();
            let near = |(a, b): (&f32, &f32)| (a - b).abs() <= relative * a.abs() + absolute;
            assert!(values.iter().zip(&rounded).all(near), "{precision}");
            let bytes = precision.to_bytes("x", &rounded).unwrap();
            assert_eq!(precision.from_bytes(&bytes), rounded);
            assert!(precision.to_bytes("x", &values).is_err(), "{precision}");
        }
    }

    #[test]
    fn values_beyond_the_range_are_refused_by_name() {
        // The largest f16 is 65,504; from 65,520 on values round to infinity.
        assert!(Precision::F16.round_all("stem", &mut [65_519.0]).is_ok());
        let error = Precision::F16.round_all("stem", &mut [65_520.0]).unwrap_err().to_string();
        assert_eq!(error, "stem: expected values in the range of f16, got 6.552e4");
        assert!(Precision::Bf16.round_all("stem", &mut [1e38]).is_ok());
        assert!(Precision::Bf16.round_all("stem", &mut [f32::MAX]).is_err());
        assert!(Precision::I8.round_all("rows", &mut [128.0]).is_err());
    }

    #[test]
    fn every_name_is_its_own_format() {
        for precision in ALL {
            assert_eq!(precision.to_string().parse::<Precision>().unwrap(), precision);
            assert_eq!(Precision::from_dtype(precision.dtype()), Some(precision));
        }
        assert!("f8".parse::<Precision>().is_err());
    }
}
