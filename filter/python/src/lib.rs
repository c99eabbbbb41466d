//! The filter as a Python module, `tactile_filter`: numpy frames in, decisions and beliefs as numpy out.
//!
//! Each class wraps one value of `tactile-filter` and adds nothing to it, so that Python gets the same numbers as Rust,
//! to the bit. Computing happens without Python's global lock; an error of a library is an exception of
//! the module `error`, and so is a panic. The types as Python sees them are in `package/tactile_filter/__init__.pyi`; the README says how
//! to build and install the module. Without the feature `python` this crate is empty.

#[cfg(feature = "python")]
mod array;
#[cfg(feature = "python")]
mod belief;
#[cfg(feature = "python")]
mod config;
#[cfg(feature = "python")]
mod episode;
#[cfg(feature = "python")]
pub mod error;
#[cfg(feature = "python")]
mod estimate;
#[cfg(feature = "python")]
mod felt_map;
#[cfg(any(test, feature = "python"))]
mod guard;
#[cfg(feature = "python")]
mod model;
#[cfg(feature = "python")]
mod pose;
#[cfg(feature = "python")]
mod search;
#[cfg(feature = "python")]
mod sensor;
#[cfg(any(test, feature = "python"))]
#[cfg(feature = "sim")]
mod simulator;

/// Which peg fits a hole, and where the hole is, found by touch.
#[cfg(feature = "python")]
#[pyo3::pymodule(name = "_native")]
fn tactile_filter_module(module: &pyo3::Bound<'_, pyo3::types::PyModule>) -> pyo3::PyResult<()> {
    use pyo3::types::PyModuleMethods;

    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<model::PyModel>()?;
    module.add_class::<model::PyBank>()?;
    module.add_class::<pose::PyPose>()?;
    module.add_class::<sensor::PySensor>()?;
    module.add_class::<sensor::PySensorLight>()?;
    module.add_class::<sensor::PyObservation>()?;
    module.add_class::<config::PyEpisodeConfig>()?;
    module.add_class::<episode::PyEpisode>()?;
    module.add_class::<episode::PyTouch>()?;
    module.add_class::<episode::PyDone>()?;
    module.add_class::<search::PySearch>()?;
    module.add_class::<estimate::PyEstimate>()?;
    module.add_class::<estimate::PyRunnerUp>()?;
    module.add_class::<estimate::PyMode>()?;
    module.add_class::<belief::PyBelief>()?;
    module.add_class::<felt_map::PyFeltMap>()?;
    #[cfg(feature = "sim")]
    module.add_class::<simulator::PySimulator>()?;
    error::add_to(module)
}
