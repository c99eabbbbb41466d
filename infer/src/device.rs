//! Where tensors are computed: the only file that names a backend.

use std::fmt;
use std::str::FromStr;

use burn::tensor::Device;

use crate::error::{Error, Result};

/// The backends a user can choose at run time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// burn's pure-Rust CPU backend: the default.
    #[default]
    Flex,
    /// The older CPU backend, some thirty times slower in training and deprecated by burn.
    Ndarray,
}

impl DeviceKind {
    /// Every name that `--device` takes.
    pub const NAMES: [&str; 2] = ["flex", "ndarray"];

    /// The tensor device of this kind, without autodiff.
    pub fn tensor_device(self) -> Device {
        match self {
            Self::Flex => Device::flex(),
            #[allow(deprecated)] // selectable for as long as burn ships it
            Self::Ndarray => Device::ndarray(),
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(Self::NAMES[*self as usize])
    }
}

impl FromStr for DeviceKind {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self> {
        match name {
            "flex" => Ok(Self::Flex),
            "ndarray" => Ok(Self::Ndarray),
            _ => Err(Error::invalid("--device", Self::NAMES.join(" or "), name)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_name_is_its_own_device() {
        for name in DeviceKind::NAMES {
            assert_eq!(name.parse::<DeviceKind>().unwrap().to_string(), name);
        }
        assert!("cuda".parse::<DeviceKind>().unwrap_err().to_string().contains("flex or ndarray"));
    }
}
