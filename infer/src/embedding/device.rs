//! Where tensors are computed: the only file that names a backend.

use std::fmt;
use std::str::FromStr;

#[cfg(feature = "burn")]
use burn::tensor::Device;

use crate::error::{Error, Result};

/// The backends a user can choose at run time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DeviceKind {
    /// The CPU: our own encoder in inference, burn's pure-Rust backend in training. The default.
    #[default]
    Flex,
    /// The older CPU backend, some thirty times slower in training and deprecated by burn. Needs a build with the feature
    /// `ndarray`.
    Ndarray,
    /// The first graphics card that Vulkan, Metal, DirectX or OpenGL offers; `CUBECL_WGPU_DEFAULT_DEVICE` chooses
    /// another. Needs a build with the feature `wgpu`.
    Wgpu,
}

impl DeviceKind {
    /// Every name that `--device` takes.
    pub const NAMES: [&str; 3] = ["flex", "ndarray", "wgpu"];

    /// The tensor device of this kind, without autodiff. A graphics card is started at the first call and shared
    /// by the later ones of this process.
    ///
    /// # Errors
    /// For [`Self::Ndarray`] and [`Self::Wgpu`] in a build without them, or where no graphics card or driver answers.
    #[cfg(feature = "burn")]
    pub fn open(self) -> Result<Device> {
        match self {
            Self::Flex => Ok(Device::flex()),
            Self::Ndarray => ndarray(),
            Self::Wgpu => wgpu(),
        }
    }

    /// [`Self::open`] where it cannot fail, as for [`Self::Flex`]: tests and examples. Where it does fail, the default CPU
    /// device.
    #[cfg(feature = "burn")]
    pub fn tensor_device(self) -> Device {
        self.open().unwrap_or_else(|_| Device::flex())
    }
}

#[cfg(feature = "wgpu")]
fn wgpu() -> Result<Device> {
    // burn keeps one runtime a process and refuses to start it twice.
    static STARTED: std::sync::OnceLock<std::result::Result<Device, String>> = std::sync::OnceLock::new();
    let started = STARTED.get_or_init(|| Device::wgpu_options().init().map_err(|error| error.to_string()));
    // The driver's reason may run over several lines.
    let one_line = |reason: &str| reason.split_whitespace().collect::<Vec<_>>().join(" ");
    let none = |reason: &str| Error::invalid("--device wgpu", "a graphics card and its driver", one_line(reason));
    started.clone().map_err(|reason| none(&reason))
}

#[cfg(all(feature = "burn", not(feature = "wgpu")))]
fn wgpu() -> Result<Device> {
    Err(built_without("wgpu"))
}

#[cfg(feature = "ndarray")]
#[allow(deprecated)] // selectable for as long as burn ships it
#[allow(clippy::unnecessary_wraps, reason = "a build without it refuses")]
fn ndarray() -> Result<Device> {
    Ok(Device::ndarray())
}

#[cfg(all(feature = "burn", not(feature = "ndarray")))]
fn ndarray() -> Result<Device> {
    Err(built_without("ndarray"))
}

#[cfg(all(feature = "burn", not(all(feature = "ndarray", feature = "wgpu"))))]
fn built_without(feature: &str) -> Error {
    let expected = format!("a program built with `cargo build --release --features {feature}`");
    Error::invalid(format!("--device {feature}"), expected, "one built without that feature")
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
            "wgpu" => Ok(Self::Wgpu),
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
        assert!("cuda".parse::<DeviceKind>().unwrap_err().to_string().contains("flex or ndarray or wgpu"));
    }

    #[cfg(all(feature = "burn", not(feature = "ndarray")))]
    #[test]
    fn a_build_without_ndarray_says_how_to_get_it() {
        let error = DeviceKind::Ndarray.open().unwrap_err().to_string();
        assert!(error.contains("--features ndarray") && !error.contains('\n'), "{error}");
    }

    #[cfg(all(feature = "burn", not(feature = "wgpu")))]
    #[test]
    fn a_build_without_wgpu_says_how_to_get_it() {
        let error = DeviceKind::Wgpu.open().unwrap_err().to_string();
        assert!(error.contains("--features wgpu") && !error.contains('\n'), "{error}");
    }
}
