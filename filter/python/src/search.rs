//! Where a peg is slid until it goes in.

use numpy::PyArray2;
use pyo3::prelude::*;
use tactile_filter::insertion::Search;

use crate::array::matrix;

/// Where to slide the peg of the named part along the plate until it goes in, the likeliest first.
#[pyclass(name = "Search", module = "tactile_filter", frozen)]
pub struct PySearch(pub Search);

#[pymethods]
impl PySearch {
    /// By what the peg is moved from where its hole is believed to be, in the part's frame: float64 `[n, 3]` (x mm, y mm, theta rad); the
    /// first is no motion.
    #[getter]
    fn offsets<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.0.offsets.iter().flat_map(|offset| [offset.x_mm, offset.y_mm, offset.theta_rad]);
        matrix(py, 3, rows.collect())
    }

    /// How probable it is that the peg goes in at one of them, if its hole is near, 0 to 1.
    #[getter]
    fn covered(&self) -> f64 {
        self.0.in_vain.covered
    }

    fn __repr__(&self) -> String {
        format!("<Search for {} at {} poses>", self.0.in_vain.part, self.0.offsets.len())
    }
}
