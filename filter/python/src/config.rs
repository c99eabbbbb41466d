//! The settings of an episode as keyword arguments.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use tactile_data::text::number::short_numbers;
use tactile_filter::{EpisodeConfig, KnownStart, SensorMatch, Settings};

use crate::error::{ConfigError, InternalError};
use crate::model::PyModel;
use crate::pose::{CovarianceLike, PoseLike};
use crate::sensor::side_of;

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
        changed(EpisodeConfig::default(), settings)
    }

    /// The defaults with what was measured of a model where `side` is touched: `"hole"` or `"peg"`.
    #[staticmethod]
    #[pyo3(signature = (model, side="hole", **settings))]
    fn of(model: &PyModel, side: &str, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(EpisodeConfig::of_side(&model.0, side_of(side)?), settings)
    }

    /// Alg. 1 of the paper as printed.
    #[staticmethod]
    #[pyo3(signature = (**settings))]
    fn paper(settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(EpisodeConfig::paper(), settings)
    }

    /// The same with some settings changed.
    #[pyo3(signature = (**settings))]
    fn replace(&self, settings: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        changed(self.0, settings)
    }

    /// Holes that have told of the sensor so far (`Episode.learn`).
    #[getter]
    fn n_sensor_holes(&self) -> u32 {
        self.0.sensor.n_holes
    }

    /// The same without what holes have told of the sensor: for a new gel or another camera.
    fn without_sensor(&self) -> Self {
        Self(self.0.with_sensor(SensorMatch::default()))
    }

    /// The same for a hole that is known to be somewhere before it is touched, from a camera or a drawing. `part_from_first`: pose of the
    /// sensor at the first touch, in the part's frame; `covariance`: of that pose over (x mm, y mm, theta rad).
    fn with_start(&self, part_from_first: PoseLike, covariance: CovarianceLike) -> Self {
        Self(self.0.with_start(KnownStart { part_from_first: part_from_first.0, covariance: covariance.0 }))
    }

    /// `with_start` from where the part is seen, both poses in any one frame, as the robot's base. `covariance`: of `base_from_part`.
    fn with_part(&self, base_from_part: PoseLike, covariance: CovarianceLike, base_from_first: PoseLike) -> Self {
        Self(self.0.with_start(KnownStart::of_part(base_from_part.0, covariance.0, base_from_first.0)))
    }

    /// The same for a hole that may be anywhere.
    fn without_start(&self) -> Self {
        Self(self.0.without_start())
    }

    /// All settings by name.
    #[getter]
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for number in Settings::numbers() {
            let text = self.0.settings.get(number.name).map_err(|error| InternalError::new_err(error.to_string()))?;
            match (text.parse::<u64>(), text.parse::<f64>()) {
                (Ok(whole), _) if number.is_whole => dict.set_item(number.name, whole)?,
                (_, Ok(value)) => dict.set_item(number.name, value)?,
                _ => dict.set_item(number.name, py.None())?,
            }
        }
        Ok(dict)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let settings = self.settings(py)?.iter().map(|(name, value)| Ok(format!("{name}={}", value.repr()?)));
        Ok(format!("EpisodeConfig({})", settings.collect::<PyResult<Vec<_>>>()?.join(", ")))
    }
}

fn changed(mut config: EpisodeConfig, settings: Option<&Bound<'_, PyDict>>) -> PyResult<PyEpisodeConfig> {
    for (name, value) in settings.into_iter().flat_map(|settings| settings.iter()) {
        let name: String = name.extract()?;
        config.settings.set(&name, &text(&name, &value)?).map_err(refused)?;
    }
    config.validate().map_err(refused)?;
    Ok(PyEpisodeConfig(config))
}

/// `episode.max_touches` is `max_touches` here.
fn refused(error: tactile_filter::Error) -> PyErr {
    match error {
        tactile_filter::Error::Config { setting, expected, got } => {
            let name = setting.strip_prefix("episode.").unwrap_or(&setting);
            ConfigError::new_err(format!("{name}: expected {expected}, got {}", short_numbers(&got)))
        }
        other => ConfigError::new_err(other.to_string()),
    }
}

/// A value of Python as a setting is written.
fn text(setting: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    if value.is_none() {
        return Ok("none".into());
    }
    // True is a whole number in Python.
    let is_number = value.extract::<bool>().is_err();
    if let (true, Ok(value)) = (is_number, value.extract::<u64>()) {
        return Ok(value.to_string());
    }
    if let (true, Ok(value)) = (is_number, value.extract::<f64>()) {
        return Ok(value.to_string());
    }
    let got = value.get_type().name()?;
    Err(ConfigError::new_err(format!("{setting}: expected a number or None, got {got}")))
}
