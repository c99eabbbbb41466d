//! The belief over all states, as arrays.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_filter::Episode;

use crate::array::{matrix, vector};
use crate::pose::PyPose;

/// How probable each part is at each pose: what an episode believed when it was asked.
#[pyclass(name = "Belief", module = "tactile_filter", frozen)]
pub struct PyBelief {
    parts: Vec<String>,
    grid: PoseGrid,
    /// `[n_parts * n_cells]`
    probabilities: Vec<f64>,
    class_posterior: Vec<f64>,
    first_from_sensor: Se2,
    entropy_nats: f64,
}

impl PyBelief {
    /// The belief of an episode with these parts.
    pub fn of(episode: &Episode, parts: &[String]) -> Self {
        let belief = episode.belief();
        let grid = *belief.posterior().grid();
        let mut probabilities = vec![0.0; belief.posterior().n_states()];
        for (state, probability) in belief.posterior().states() {
            probabilities[state.part * grid.len() + state.cell] = probability;
        }
        Self {
            parts: parts.to_vec(),
            grid,
            probabilities,
            class_posterior: belief.posterior().by_part().to_vec(),
            first_from_sensor: belief.first_from_sensor(),
            entropy_nats: belief.posterior().entropy_nats(),
        }
    }
}

#[pymethods]
impl PyBelief {
    /// Names of the parts, in the order of the probabilities' rows.
    #[getter]
    fn parts(&self) -> Vec<String> {
        self.parts.clone()
    }

    /// Probability of each part at each pose: float64 `[n_parts, n_cells]`, which sum to 1.
    #[getter]
    fn probabilities<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, self.grid.len(), self.probabilities.clone())
    }

    /// Poses `part_from_first` of the sensor at the first touch: float64 `[n_cells, 3]` (x mm, y mm, theta rad).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let poses = (0..self.grid.len()).map(|cell| self.grid.pose(cell));
        matrix(py, 3, poses.flat_map(|pose| [pose.x_mm, pose.y_mm, pose.theta_rad]).collect())
    }

    /// Numbers of x, of y and of angles, whose product is `n_cells`; the angle varies fastest.
    #[getter]
    fn shape(&self) -> (usize, usize, usize) {
        (self.grid.n_xy(), self.grid.n_xy(), self.grid.n_theta())
    }

    /// Probability of each part: float64 `[n_parts]`.
    #[getter]
    fn class_posterior<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.class_posterior.clone())
    }

    /// The sensor's motion since the first touch: a state's pose of the sensor now is its pose times this.
    #[getter]
    fn first_from_sensor(&self) -> PyPose {
        PyPose(self.first_from_sensor)
    }

    /// Entropy over all states, nats.
    #[getter]
    fn entropy_nats(&self) -> f64 {
        self.entropy_nats
    }

    fn __repr__(&self) -> String {
        let (n_parts, n_cells) = (self.parts.len(), self.grid.len());
        format!("<Belief over {n_parts} parts at {n_cells} poses each, {:.2} nats>", self.entropy_nats)
    }
}
