//! Model and bank, loaded from their files.

use std::path::PathBuf;
use std::sync::Arc;

use numpy::PyArray2;
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use tactile_data::dataset::touch::Side;
use tactile_infer::maps::Maps;
use tactile_infer::{Bank, Model};

use crate::array::matrix;
use crate::error::compute;
use crate::pose::PyPose;

/// A trained model on the CPU: makes embeddings of frames.
#[pyclass(name = "Model", module = "tactile_filter", frozen)]
pub struct PyModel(pub Arc<Model>);

#[pymethods]
impl PyModel {
    /// Loads a checkpoint, as `tactile-train` writes it, and with `maps` networks that draw a map of each touch: with banks
    /// that have maps of their parts (`tactile-infer bank --maps`), places are found and parts are verified by them.
    #[staticmethod]
    #[pyo3(signature = (path, *, maps=None))]
    fn load(py: Python<'_>, path: PathBuf, maps: Option<PathBuf>) -> PyResult<Self> {
        compute(py, || {
            let model = Model::load(&path)?;
            let model = match maps {
                Some(maps) => model.with_maps(Maps::load(&maps)?)?,
                None => model,
            };
            Ok(Self(Arc::new(model)))
        })
    }

    /// SHA-256 of the checkpoint but for its calibration, 64 hex digits: banks are bound to it.
    #[getter]
    fn sha256(&self) -> &str {
        self.0.sha256()
    }

    /// Length of an embedding.
    #[getter]
    fn dim(&self) -> usize {
        self.0.dim()
    }

    /// Width and height of the network's input, pixels; a frame has at least as many.
    #[getter]
    fn input_px(&self) -> (usize, usize) {
        let [width, height] = self.0.preprocessing().input_px;
        (width, height)
    }

    /// Whether it was measured how far its similarities can be believed where holes are touched (`tactile-infer
    /// calibrate`).
    #[getter]
    fn is_calibrated(&self) -> bool {
        self.0.calibration(Side::Hole).is_some()
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.0.preprocessing().input_px;
        let (sha256, n, dim) = (self.0.sha256(), self.0.n_parameters(), self.0.dim());
        format!("<Model {sha256:.12}: {n} weights, input {width}x{height}, embeddings of {dim}>")
    }
}

/// The recorded views of the parts, as embeddings.
#[pyclass(name = "Bank", module = "tactile_filter", frozen)]
pub struct PyBank(pub Arc<Bank>);

#[pymethods]
impl PyBank {
    /// Loads a bank, as `tactile-infer bank` writes it, that this model made.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, model: &PyModel) -> PyResult<Self> {
        compute(py, || Ok(Self(Arc::new(Bank::load(&path, &model.0)?))))
    }

    /// Writes the bank to a file, whole or not at all.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        compute(py, || Ok(self.0.save(&path)?))
    }

    /// Names of the parts, in the order of every belief.
    #[getter]
    fn parts(&self) -> Vec<String> {
        self.0.parts().to_vec()
    }

    /// The recorded poses `part_from_sensor` of each part: float64 `[n_poses, 3]` (x mm, y mm, theta rad).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let grid = self.0.grid();
        let poses = (0..grid.len()).map(|cell| grid.pose(cell));
        matrix(py, 3, poses.flat_map(|pose| [pose.x_mm, pose.y_mm, pose.theta_rad]).collect())
    }

    /// SHA-256 of the bank, 64 hex digits: saved episodes are bound to it.
    #[getter]
    fn sha256(&self, py: Python<'_>) -> PyResult<String> {
        compute(py, || Ok(self.0.sha256()?))
    }

    /// SHA-256 of the model that made it, 64 hex digits.
    #[getter]
    fn model_sha256(&self) -> &str {
        self.0.model_sha256()
    }

    /// The poses at which a part feels the same as at this one, itself first.
    fn twins(&self, part: &str, part_from_sensor: &PyPose) -> PyResult<Vec<PyPose>> {
        let parts = self.0.parts();
        let Some(index) = parts.iter().position(|name| name == part) else {
            let known = parts.join(", ");
            return Err(PyKeyError::new_err(format!("part: expected one of {known}, got {part}")));
        };
        Ok(self.0.symmetry(index).twins(&part_from_sensor.0).into_iter().map(PyPose).collect())
    }

    fn __len__(&self) -> usize {
        self.0.parts().len()
    }

    fn __repr__(&self) -> String {
        let (parts, n_poses) = (self.0.parts(), self.0.grid().len());
        format!("<Bank of {} parts at {n_poses} poses each: {}>", parts.len(), parts.join(", "))
    }
}
