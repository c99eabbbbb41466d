//! What an episode's touches show of what they were made on.

use numpy::PyArray3;
use numpy::ndarray::Array3;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tactile_filter::FeltMap;
use tactile_infer::maps::mosaic::{CELL_MM, Difference};

use crate::error::compute;
use crate::model::PyBank;

/// What the touches of an episode show, stitched about the origin of the part that is named.
#[pyclass(name = "FeltMap", module = "tactile_filter", frozen)]
pub struct PyFeltMap(pub FeltMap);

#[pymethods]
impl PyFeltMap {
    /// Name of the part that is named.
    #[getter]
    fn part(&self) -> &str {
        &self.0.part
    }

    /// Side of a cell, mm.
    #[getter]
    fn cell_mm(&self) -> f64 {
        CELL_MM
    }

    /// float32 `[n, n, 5]`, rows from the top, the part's origin in the middle: distance to the outline of the peg (mm, negative
    /// inside), the probability that the place is inside, that it touches the gel, the error of the distance (mm), and how many
    /// touches showed it.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let [_, _, n, across, n_values] = self.0.mosaics.shape();
        let values = Array3::from_shape_vec([n, across, n_values], self.0.mosaics.values().to_vec());
        Ok(PyArray3::from_owned_array(py, values.map_err(|error| PyValueError::new_err(error.to_string()))?))
    }

    /// How it differs from the bank's map of the part, mm2: what both show, what is inside here alone, and what there alone;
    /// `None` where the bank has no maps.
    #[getter]
    fn difference(&self) -> Option<(f64, f64, f64)> {
        let of = |Difference { seen_mm2, only_first_mm2, only_second_mm2 }| (seen_mm2, only_first_mm2, only_second_mm2);
        self.0.difference.map(of)
    }

    /// A picture, uint8 `[n * cell_px, n * cell_px, 3]`: blue inside, red outside; the outline of the bank's part is green, and
    /// what differs from it yellow.
    #[pyo3(signature = (bank, cell_px=3))]
    fn picture<'py>(&self, py: Python<'py>, bank: &PyBank, cell_px: usize) -> PyResult<Bound<'py, PyArray3<u8>>> {
        /// More than any screen shows.
        const MOST: usize = 16;
        if !(1..=MOST).contains(&cell_px) {
            return Err(PyValueError::new_err(format!("cell_px: expected 1 to {MOST}, got {cell_px}")));
        }
        let frame = compute(py, || Ok(self.0.picture(&bank.0, cell_px)?))?;
        let pixels = Array3::from_shape_vec([frame.height_px(), frame.width_px(), 3], frame.rgb().to_vec());
        Ok(PyArray3::from_owned_array(py, pixels.map_err(|error| PyValueError::new_err(error.to_string()))?))
    }

    fn __repr__(&self) -> String {
        let [_, _, n, ..] = self.0.mosaics.shape();
        let mm = n as f64 * CELL_MM;
        format!("<FeltMap of {}: {mm:.1} x {mm:.1} mm>", self.0.part)
    }
}
