//! One hole, touch by touch.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tactile_data::pose::se2::Se2;
use tactile_filter::insertion::HeldPeg;
use tactile_filter::{Decision, Episode, EpisodeRecord, StopReason};
use tactile_infer::Bank;

use crate::array::{motions, vector};
use crate::belief::PyBelief;
use crate::config::PyEpisodeConfig;
use crate::error::{Failure, InvalidError, compute};
use crate::estimate::PyEstimate;
use crate::felt_map::PyFeltMap;
use crate::model::PyBank;
use crate::pose::{CovarianceLike, PoseLike, PyPose};
use crate::search::PySearch;
use crate::sensor::PyObservation;

/// One hole being identified. Threads may share one: a call waits for the one before.
#[pyclass(name = "Episode", module = "tactile_filter", frozen)]
pub struct PyEpisode {
    /// Taken only without Python's lock, so that nobody waits for both.
    episode: Mutex<Episode>,
    bank: Arc<Bank>,
}

impl PyEpisode {
    fn new(episode: Episode, bank: &Arc<Bank>) -> Self {
        Self { episode: Mutex::new(episode), bank: bank.clone() }
    }

    /// Does something with the episode, without Python's lock.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        work: impl FnOnce(&mut Episode) -> Result<T, Failure> + Send,
    ) -> PyResult<T> {
        compute(py, || {
            let broken = |_| Failure::Internal("this episode was broken by an earlier one; restore its record".into());
            work(&mut *self.episode.lock().map_err(broken)?)
        })
    }

    fn named(&self, estimate: tactile_filter::Estimate) -> PyEstimate {
        PyEstimate { estimate, parts: self.bank.parts().to_vec() }
    }
}

#[pymethods]
impl PyEpisode {
    /// Begins with the first touch.
    #[staticmethod]
    fn begin(py: Python<'_>, config: &PyEpisodeConfig, bank: &PyBank, observation: &PyObservation) -> PyResult<Self> {
        compute(py, || Ok(Self::new(Episode::begin(config.0, bank.0.clone(), &observation.0)?, &bank.0)))
    }

    /// An episode as it was when recorded, to the bit.
    #[staticmethod]
    fn restore(py: Python<'_>, record: &str, bank: &PyBank) -> PyResult<Self> {
        let record: EpisodeRecord = serde_json::from_str(record).map_err(|error| {
            InvalidError::new_err(format!("saved episode: expected what record() gives, got {error}"))
        })?;
        compute(py, || Ok(Self::new(Episode::restore(&record, bank.0.clone())?, &bank.0)))
    }

    /// What is needed to go on later, or elsewhere, as JSON.
    fn record(&self, py: Python<'_>) -> PyResult<String> {
        self.with(py, |episode| {
            serde_json::to_string(&episode.record()?).map_err(|error| Failure::Internal(error.to_string()))
        })
    }

    /// Takes in a touch after the motion that was really made since the one before, in the sensor's frame.
    fn observe(&self, py: Python<'_>, moved: PoseLike, observation: &PyObservation) -> PyResult<()> {
        self.with(py, |episode| Ok(episode.observe(moved.0, &observation.0)?))
    }

    /// Where to slide the peg of the named part until it goes in. `play_mm`: by how much its hole is wider on every side;
    /// `radius_mm`: from the origin of the part's frame to its farthest point; `covariance`: of the peg's pose in the hand over (x mm, y mm,
    /// theta rad) in the part's frame, such as `Estimate.offset_covariance` of touches of it; none: exactly.
    #[pyo3(signature = (play_mm, radius_mm, covariance = None, most = 200))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn search(
        &self,
        py: Python<'_>,
        play_mm: f64,
        radius_mm: f64,
        covariance: Option<CovarianceLike>,
        most: usize,
    ) -> PyResult<PySearch> {
        let peg = HeldPeg { play_mm, radius_mm, covariance: covariance.map_or([[0.0; 3]; 3], |rows| rows.0) };
        self.with(py, |episode| Ok(PySearch(episode.estimate().search(&peg, most)?)))
    }

    /// Takes in that the peg went in nowhere there: the hole is another part's, or elsewhere, or was missed. Touch again before
    /// the next try.
    fn did_not_fit(&self, py: Python<'_>, search: &PySearch) -> PyResult<()> {
        self.with(py, |episode| Ok(episode.did_not_fit(&search.0.in_vain)?))
    }

    /// Whether to stop, and if not, which motion of `reach` to make: float64 `[n, 3]` (x mm, y mm, theta rad) in the
    /// sensor's frame, or a sequence of poses. After `time_limit_s` the best found so far is taken.
    #[pyo3(signature = (reach, time_limit_s = None))]
    fn decide<'py>(
        &self,
        py: Python<'py>,
        reach: &Bound<'py, PyAny>,
        time_limit_s: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let reach = motions(reach)?;
        let limit = time_limit_s.map(Duration::try_from_secs_f64).transpose().map_err(|_| {
            let got = time_limit_s.unwrap_or_default();
            PyValueError::new_err(format!("time_limit_s: expected seconds, not negative, got {got}"))
        })?;
        let start = Instant::now();
        let mut keep_going = || limit.is_none_or(|limit| start.elapsed() < limit);
        match self.with(py, |episode| Ok(episode.decide_while(&reach, &mut keep_going)?))? {
            Decision::Touch(action) => Ok(Bound::new(py, PyTouch(action.sensor_from_next))?.into_any()),
            Decision::Done(estimate, reason) => {
                let estimate = Py::new(py, self.named(*estimate))?;
                Ok(Bound::new(py, PyDone { estimate, reason: name(reason) })?.into_any())
            }
        }
    }

    /// Why to stop now, whatever could still be touched; `None` to go on.
    fn stop_reason(&self, py: Python<'_>) -> PyResult<Option<&'static str>> {
        self.with(py, |episode| Ok(episode.stop_reason().map(name)))
    }

    /// `config` with what this hole tells of the sensor, where its part is named with confidence now: how well touches of this
    /// sensor match. Begin the next hole of the run with it, as long as gel and camera stay.
    fn learn(&self, py: Python<'_>, config: &PyEpisodeConfig) -> PyResult<PyEpisodeConfig> {
        Ok(PyEpisodeConfig(config.0.with_sensor(self.with(py, |episode| Ok(episode.learn()))?)))
    }

    /// What is known now.
    fn estimate(&self, py: Python<'_>) -> PyResult<PyEstimate> {
        Ok(self.named(self.with(py, |episode| Ok(episode.estimate()))?))
    }

    /// What the touches so far show of what they were made on; `None` where the model draws no maps (`Model.load(..., maps=...)`).
    fn felt_map(&self, py: Python<'_>) -> PyResult<Option<PyFeltMap>> {
        Ok(self.with(py, |episode| Ok(episode.felt_map()))?.map(PyFeltMap))
    }

    /// The belief over all states now.
    fn belief(&self, py: Python<'_>) -> PyResult<PyBelief> {
        self.with(py, |episode| Ok(PyBelief::of(episode, self.bank.parts())))
    }

    /// Probability of each part now: float64 `[n_parts]`.
    fn class_posterior<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<f64>>> {
        Ok(vector(py, self.with(py, |episode| Ok(episode.class_posterior().to_vec()))?))
    }

    /// Touches taken in.
    #[getter]
    fn n_touches(&self, py: Python<'_>) -> PyResult<usize> {
        self.with(py, |episode| Ok(episode.belief().touches().len()))
    }

    /// The bank.
    #[getter]
    fn bank(&self) -> PyBank {
        PyBank(self.bank.clone())
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (n, posterior) = self.with(py, |episode| {
            let belief = episode.belief();
            Ok((belief.touches().len(), episode.class_posterior().to_vec()))
        })?;
        let likeliest = posterior.iter().zip(self.bank.parts()).max_by(|a, b| a.0.total_cmp(b.0));
        let (probability, part) = likeliest.map_or((0.0, ""), |(probability, part)| (*probability, part.as_str()));
        Ok(format!("<Episode after {n} touches: part {part} with {:.1} %>", 100.0 * probability))
    }
}

/// A decision: make this motion, then touch.
#[pyclass(name = "Touch", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyTouch(Se2);

#[pymethods]
impl PyTouch {
    /// Where the sensor goes, in its own frame.
    #[getter]
    fn motion(&self) -> PyPose {
        PyPose(self.0)
    }

    fn __repr__(&self) -> String {
        let Se2 { x_mm, y_mm, .. } = self.0;
        format!("<Touch after a motion of {x_mm:.2} mm, {y_mm:.2} mm, {:.1} degrees>", self.0.theta_deg())
    }
}

/// A decision: stop.
#[pyclass(name = "Done", module = "tactile_filter", frozen)]
pub struct PyDone {
    estimate: Py<PyEstimate>,
    reason: &'static str,
}

#[pymethods]
impl PyDone {
    /// What is known.
    #[getter]
    fn estimate(&self, py: Python<'_>) -> Py<PyEstimate> {
        self.estimate.clone_ref(py)
    }

    /// Why: "confident", "none-of-these", "touch-limit" or "nothing-to-learn".
    #[getter]
    fn reason(&self) -> &'static str {
        self.reason
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("<Done, {}: {}>", self.reason, self.estimate.bind(py).repr()?))
    }
}

/// A reason as files have it.
fn name(reason: StopReason) -> &'static str {
    match reason {
        StopReason::Confident => "confident",
        StopReason::NoneOfThese => "none-of-these",
        StopReason::TouchLimit => "touch-limit",
        StopReason::NothingToLearn => "nothing-to-learn",
    }
}
