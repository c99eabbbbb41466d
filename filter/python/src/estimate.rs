//! What is known of a hole.

use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use tactile_filter::belief::modes::Mode;
use tactile_filter::{Estimate, RunnerUp};

use crate::array::{matrix, vector};
use crate::pose::PyPose;

/// What is known after the touches so far.
#[pyclass(name = "Estimate", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyEstimate {
    /// The estimate.
    pub estimate: Estimate,
    /// Names of the parts, for the modes.
    pub parts: Vec<String>,
}

#[pymethods]
impl PyEstimate {
    /// Name of the most probable part; the first of equals.
    #[getter]
    fn part(&self) -> &str {
        &self.estimate.part
    }

    /// Its probability, 0 to 1.
    #[getter]
    fn probability(&self) -> f64 {
        self.estimate.probability
    }

    /// The next likeliest part; `None` where no other is left.
    #[getter]
    fn runner_up(&self) -> Option<PyRunnerUp> {
        self.estimate.runner_up.clone().map(PyRunnerUp)
    }

    /// Pose of the sensor now, on that part.
    #[getter]
    fn part_from_sensor(&self) -> PyPose {
        PyPose(self.estimate.part_from_sensor)
    }

    /// Pose of the sensor at the first touch, on that part.
    #[getter]
    fn part_from_first(&self) -> PyPose {
        PyPose(self.estimate.part_from_first)
    }

    /// The poses that touch cannot tell from `part_from_sensor`, itself first: insert at any of them.
    #[getter]
    fn twins(&self) -> Vec<PyPose> {
        self.estimate.symmetry.twins(&self.estimate.part_from_sensor).into_iter().map(PyPose).collect()
    }

    /// Covariance of the pose: float64 `[3, 3]` of x mm, y mm, theta rad.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, 3, self.estimate.covariance.concat())
    }

    /// How well it is known where the part is against where it is believed to be: covariance over (x mm, y mm, theta rad) in the
    /// part's frame, float64 `[3, 3]`. Of touches of a held peg it is that of the peg in the hand.
    #[getter]
    fn offset_covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, 3, self.estimate.offset_covariance().concat())
    }

    /// How many standard deviations the touches look more like that part's views than touches of a part that is there; `None`
    /// where no edge was felt.
    #[getter]
    fn fit(&self) -> Option<f64> {
        self.estimate.fit
    }

    /// Probability that it is none of the bank's parts, where that was as likely before the first touch; `None` where no edge was
    /// felt.
    #[getter]
    fn none_probability(&self) -> Option<f64> {
        self.estimate.presence.map(|presence| presence.none())
    }

    /// How often a part that is not in the bank comes to so good a match at any touch; `None` where no edge was felt.
    #[getter]
    fn stranger_rate(&self) -> Option<f64> {
        self.estimate.presence.map(|presence| presence.stranger_rate)
    }

    /// Probability of each part: float64 `[n_parts]`.
    #[getter]
    fn class_posterior<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        vector(py, self.estimate.class_posterior.clone())
    }

    /// Where it may be: the peaks of the belief, the heaviest first.
    #[getter]
    fn modes(&self) -> Vec<PyMode> {
        let mode =
            |mode: &Mode| PyMode { mode: mode.clone(), part: self.parts.get(mode.part).cloned().unwrap_or_default() };
        self.estimate.modes.iter().map(mode).collect()
    }

    /// Entropy over all states, nats.
    #[getter]
    fn entropy_nats(&self) -> f64 {
        self.estimate.entropy_nats
    }

    /// log p(all touches), up to a constant, nats: 0 says no more than chance.
    #[getter]
    fn log_evidence(&self) -> f64 {
        self.estimate.log_evidence
    }

    /// Touches taken in.
    #[getter]
    fn n_touches(&self) -> usize {
        self.estimate.n_touches
    }

    /// Reasons to doubt all this, one sentence each.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.estimate.warnings.iter().map(ToString::to_string).collect()
    }

    fn __repr__(&self) -> String {
        let Estimate { part, probability, part_from_sensor: at, n_touches, .. } = &self.estimate;
        let place = format!("{:.2} mm, {:.2} mm, {:.1} degrees", at.x_mm, at.y_mm, at.theta_deg());
        format!("<Estimate: part {part} with {:.1} % at {place} after {n_touches} touches>", 100.0 * probability)
    }
}

/// The second most probable part.
#[pyclass(name = "RunnerUp", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyRunnerUp(RunnerUp);

#[pymethods]
impl PyRunnerUp {
    /// Its name; the first of equals.
    #[getter]
    fn part(&self) -> &str {
        &self.0.part
    }

    /// Its probability, 0 to 1.
    #[getter]
    fn probability(&self) -> f64 {
        self.0.probability
    }

    fn __repr__(&self) -> String {
        let RunnerUp { part, probability } = &self.0;
        format!("<RunnerUp: part {part} with {:.1} %>", 100.0 * probability)
    }
}

/// A peak of the belief.
#[pyclass(name = "Mode", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyMode {
    mode: Mode,
    part: String,
}

#[pymethods]
impl PyMode {
    /// Name of the part.
    #[getter]
    fn part(&self) -> &str {
        &self.part
    }

    /// Probability of the peak, 0 to 1; of its twins' too, where the part is symmetric.
    #[getter]
    fn probability(&self) -> f64 {
        self.mode.mass
    }

    /// Mean pose of the sensor now.
    #[getter]
    fn part_from_sensor(&self) -> PyPose {
        PyPose(self.mode.part_from_sensor)
    }

    /// Covariance of the pose: float64 `[3, 3]` of x mm, y mm, theta rad.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        matrix(py, 3, self.mode.covariance.concat())
    }

    fn __repr__(&self) -> String {
        let at = &self.mode.part_from_sensor;
        let place = format!("{:.2} mm, {:.2} mm, {:.1} degrees", at.x_mm, at.y_mm, at.theta_deg());
        format!("<Mode: part {} with {:.1} % at {place}>", self.part, 100.0 * self.mode.mass)
    }
}
