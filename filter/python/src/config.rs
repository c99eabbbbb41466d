//! The settings of an episode as keyword arguments.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde_json::Value;
use tactile_data::number::short_numbers;
use tactile_filter::EpisodeConfig;

use crate::error::{ConfigError, InternalError};
use crate::model::PyModel;
use crate::sensor::side_of;
use crate::settings::{Refused, flat, with};

/// How an episode infers, chooses and stops. The README lists the settings.
#[pyclass(name = "EpisodeConfig", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyEpisodeConfig(pub EpisodeConfig);

#[pymethods]
impl PyEpisodeConfig {
    /// The defaults for a model of which nothing was measured.
    #[new]
    #[pyo3(signature = (**settings))]
    fn new(settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(&EpisodeConfig::default(), settings)
    }

    /// The defaults with what was measured of a model where `side` is touched: `"hole"` or `"peg"`.
    #[staticmethod]
    #[pyo3(signature = (model, side="hole", **settings))]
    fn of(model: &PyModel, side: &str, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(&EpisodeConfig::of_side(&model.0, side_of(side)?), settings)
    }

    /// Alg. 1 of the paper as printed.
    #[staticmethod]
    #[pyo3(signature = (**settings))]
    fn paper(settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(&EpisodeConfig::paper(), settings)
    }

    /// The same with some settings changed.
    #[pyo3(signature = (**settings))]
    fn replace(&self, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(&self.0, settings)
    }

    /// All settings by name.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        let settings = flat(&self.0).map_err(|error| InternalError::new_err(error.to_string()))?;
        for (name, value) in settings {
            match value {
                Value::Bool(value) => dict.set_item(name, value)?,
                Value::String(text) => dict.set_item(name, text)?,
                Value::Number(number) => match number.as_u64() {
                    Some(whole) => dict.set_item(name, whole)?,
                    None => dict.set_item(name, number.as_f64())?,
                },
                _ => dict.set_item(name, py.None())?,
            }
        }
        Ok(dict)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let settings = self.settings(py)?.iter().map(|(name, value)| Ok(format!("{name}={}", value.repr()?)));
        Ok(format!("EpisodeConfig({})", settings.collect::<PyResult<Vec<_>>>()?.join(", ")))
    }
}

fn changed(config: &EpisodeConfig, settings: Option<&Bound<'_, PyDict>>) -> PyResult<PyEpisodeConfig> {
    let settings = settings.into_iter().flat_map(|settings| settings.iter());
    let settings = settings.map(|(name, value)| {
        let name: String = name.extract()?;
        let value = json(&name, &value)?;
        Ok((name, value))
    });
    let settings = settings.collect::<PyResult<Vec<_>>>()?;
    with(config, settings).map(PyEpisodeConfig).map_err(|refused| refused_error(&refused))
}

fn refused_error(Refused { setting, expected, got }: &Refused) -> PyErr {
    ConfigError::new_err(format!("{setting}: expected {expected}, got {}", short_numbers(got)))
}

/// A value of Python as JSON has it.
fn json(setting: &str, value: &Bound<'_, PyAny>) -> PyResult<Value> {
    if value.is_none() {
        return Ok(Value::Null);
    }
    if let Ok(value) = value.extract::<bool>() {
        return Ok(value.into());
    }
    if let Ok(value) = value.extract::<u64>() {
        return Ok(value.into());
    }
    if let Ok(value) = value.extract::<i64>() {
        return Ok(value.into());
    }
    if let Ok(value) = value.extract::<f64>() {
        // JSON has neither infinity nor NaN, and would make them None.
        let number = serde_json::Number::from_f64(value).map(Value::Number);
        let refused =
            || Refused { setting: setting.into(), expected: "a finite number".into(), got: value.to_string() };
        return number.ok_or_else(|| refused_error(&refused()));
    }
    if let Ok(text) = value.extract::<String>() {
        return Ok(text.into());
    }
    let (expected, got) = ("a number, a text, True, False or None".into(), value.get_type().name()?.to_string());
    Err(refused_error(&Refused { setting: setting.into(), expected, got }))
}
