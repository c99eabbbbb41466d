//! From a frame to what the filter takes in.

use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use tactile_data::dataset::touch::Side;
use tactile_data::light::lamps::Lamps;
use tactile_data::light::touch_light::SensorLight;
use tactile_filter::{Observation, Sensor};

use crate::array::{frame, vector};
use crate::error::{ConfigError, compute, type_error};
use crate::model::PyModel;

/// The camera, the gel and its frame at rest, bound to a model.
#[pyclass(name = "Sensor", module = "tactile_filter", frozen)]
pub struct PySensor {
    sensor: Sensor,
    size_px: [usize; 2],
}

#[pymethods]
impl PySensor {
    /// A sensor whose frame without contact is `rest_frame`: uint8 `[height, width, 3]`, RGB. It touches `side`: `"hole"`,
    /// or `"peg"` for raised parts that are recognised among the bank's own.
    #[new]
    #[pyo3(signature = (model, rest_frame, side="hole"))]
    fn new(py: Python<'_>, model: &PyModel, rest_frame: &Bound<'_, PyAny>, side: &str) -> PyResult<Self> {
        let rest = frame(rest_frame, None)?;
        let size_px = [rest.width_px(), rest.height_px()];
        let side = side_of(side)?;
        compute(py, || Ok(Self { sensor: Sensor::new(model.0.clone(), &rest)?.of_side(side), size_px }))
    }

    /// The same sensor, whose lamps are known: its pictures are brought under the lamps that the network knows. Without it
    /// they are taken to be a GelSight Mini's. `along_x` and `along_y` are those of `[light]` in the file that
    /// `tactile-data calibrate` writes: for red, green and blue the factors of 1, x, y, x^2, x y, y^2 over the frame.
    fn lit_by(&self, py: Python<'_>, along_x: [[f32; 6]; 3], along_y: [[f32; 6]; 3]) -> PyResult<Self> {
        let lamps = Lamps { along_x, along_y };
        compute(py, || Ok(Self { sensor: self.sensor.clone().lit_by(&lamps)?, size_px: self.size_px }))
    }

    /// What a frame of a touch shows: uint8 `[height, width, 3]`, RGB, of the size of the frame at rest.
    fn observe(&self, py: Python<'_>, frame: &Bound<'_, PyAny>) -> PyResult<PyObservation> {
        let frame = crate::array::frame(frame, Some(self.size_px))?;
        compute(py, || Ok(PyObservation(self.sensor.observe(&frame)?)))
    }

    /// The model that embeds its frames.
    #[getter]
    fn model(&self) -> PyModel {
        PyModel(self.sensor.model().clone())
    }

    /// Which side it touches: `"hole"` or `"peg"`.
    #[getter]
    fn side(&self) -> String {
        self.sensor.side().to_string()
    }

    /// Width and height of its frames, pixels.
    #[getter]
    fn size_px(&self) -> (usize, usize) {
        (self.size_px[0], self.size_px[1])
    }

    fn __repr__(&self) -> String {
        let ([width, height], sha256) = (self.size_px, self.sensor.model().sha256());
        format!("<Sensor of {width}x{height} pixels for model {sha256:.12}>")
    }
}

/// The lamps of a sensor that nobody calibrated, learnt from its touches of anything.
#[pyclass(name = "SensorLight", module = "tactile_filter")]
pub struct PySensorLight {
    light: SensorLight,
    size_px: [usize; 2],
}

/// How red, green and blue answer slopes along x and along y.
type PyLamps = ([[f32; 6]; 3], [[f32; 6]; 3]);

#[pymethods]
impl PySensorLight {
    /// Nothing is known yet of a sensor whose frame without contact is `rest_frame`, and whose frames show `field_of_view_mm`.
    #[new]
    #[pyo3(signature = (rest_frame, field_of_view_mm))]
    fn new(py: Python<'_>, rest_frame: &Bound<'_, PyAny>, field_of_view_mm: [f64; 2]) -> PyResult<Self> {
        let rest = frame(rest_frame, None)?;
        let size_px = [rest.width_px(), rest.height_px()];
        compute(py, || Ok(Self { light: SensorLight::new(&rest, field_of_view_mm)?, size_px }))
    }

    /// Adds the frame of a touch, of any part, at any pose. One without an edge tells nothing.
    fn add(&mut self, py: Python<'_>, frame: &Bound<'_, PyAny>) -> PyResult<()> {
        let frame = crate::array::frame(frame, Some(self.size_px))?;
        compute(py, || Ok(self.light.add(&frame)?))
    }

    /// New lamps for `Sensor.lit_by`, where there are touches enough to learn them now: 20 that show edges, 40 and 80; else `None`.
    fn learn(&mut self, py: Python<'_>) -> PyResult<Option<PyLamps>> {
        let learnt = compute(py, || Ok(self.light.learn()))?;
        Ok(learnt.map(|found| found.lamps()).map(|lamps| (lamps.along_x, lamps.along_y)))
    }
}

/// The side of a name.
pub fn side_of(name: &str) -> PyResult<Side> {
    name.parse().map_err(|_| ConfigError::new_err(format!("side: expected {}, got {name}", Side::NAMES.join(" or "))))
}

/// What the filter takes in of one touch.
#[pyclass(name = "Observation", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyObservation(pub Observation);

#[pymethods]
impl PyObservation {
    /// An observation of which only the embedding is known: neither its frame nor its model is checked. `query`: a
    /// one-dimensional numpy array of float32.
    #[new]
    #[pyo3(signature = (query, edge_share, side="hole"))]
    fn new(query: &Bound<'_, PyAny>, edge_share: f32, side: &str) -> PyResult<Self> {
        let wrong = |_| type_error("query", "a numpy array of float32 [dim]", "something else");
        let query: PyReadonlyArray1<'_, f32> = query.extract().map_err(wrong)?;
        Ok(Self(Observation::new(query.as_array().to_vec(), edge_share).of_side(side_of(side)?)))
    }

    /// The embedding of what was touched: float32 `[dim]`, of unit length.
    #[getter]
    fn query<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        vector(py, self.0.query.clone())
    }

    /// Share of the view that shows an edge, 0 to 1.
    #[getter]
    fn edge_share(&self) -> f32 {
        self.0.edge_share
    }

    /// Which side was touched: `"hole"` or `"peg"`.
    #[getter]
    fn side(&self) -> String {
        self.0.side.to_string()
    }

    /// The same, of a simulated frame: two of them may be equal though the sensor moved.
    fn of_simulation(&self) -> Self {
        Self(self.0.clone().of_simulation())
    }

    fn __repr__(&self) -> String {
        format!("<Observation of {} numbers, {:.1} % edge>", self.0.query.len(), 100.0 * self.0.edge_share)
    }
}
