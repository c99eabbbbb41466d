//! Poses and motions in the plane.

use pyo3::prelude::*;
use tactile_data::pose::se2::Se2;

use crate::error::type_error;

/// A pose or a motion in the plane: x and y in mm, theta in radians. `a_from_b * b_from_c` is `a_from_c`.
#[pyclass(name = "Pose", module = "tactile_filter", frozen, eq)]
#[derive(PartialEq)]
pub struct PyPose(pub Se2);

/// What may be passed for a pose: a `Pose`, or three numbers.
pub struct PoseLike(pub Se2);

impl<'py> FromPyObject<'_, 'py> for PoseLike {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if let Ok(pose) = object.cast::<PyPose>() {
            return Ok(Self(pose.get().0));
        }
        let [x_mm, y_mm, theta_rad] = object.extract::<[f64; 3]>().map_err(|_| {
            let got = object.repr().map_or_else(|_| "an object".into(), |text| text.to_string());
            type_error("pose", "a Pose or three numbers (x_mm, y_mm, theta_rad)", &got)
        })?;
        Ok(Self(Se2::new(x_mm, y_mm, theta_rad)))
    }
}

/// What may be passed for a covariance over (x mm, y mm, theta rad): three rows of three numbers.
pub struct CovarianceLike(pub [[f64; 3]; 3]);

impl<'py> FromPyObject<'_, 'py> for CovarianceLike {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        object.extract().map(Self).map_err(|_| {
            let got = object.repr().map_or_else(|_| "an object".into(), |text| text.to_string());
            type_error("covariance", "three rows of three numbers", &got)
        })
    }
}

#[pymethods]
impl PyPose {
    /// Any finite angle; it is wrapped to (-pi, pi].
    #[new]
    #[pyo3(signature = (x_mm = 0.0, y_mm = 0.0, theta_rad = 0.0))]
    fn new(x_mm: f64, y_mm: f64, theta_rad: f64) -> Self {
        Self(Se2::new(x_mm, y_mm, theta_rad))
    }

    /// With the angle in degrees.
    #[staticmethod]
    #[pyo3(signature = (x_mm = 0.0, y_mm = 0.0, theta_deg = 0.0))]
    fn from_degrees(x_mm: f64, y_mm: f64, theta_deg: f64) -> Self {
        Self(Se2::from_degrees(x_mm, y_mm, theta_deg))
    }

    /// Along x, mm.
    #[getter]
    fn x_mm(&self) -> f64 {
        self.0.x_mm
    }

    /// Along y, mm.
    #[getter]
    fn y_mm(&self) -> f64 {
        self.0.y_mm
    }

    /// Turn, rad, in (-pi, pi].
    #[getter]
    fn theta_rad(&self) -> f64 {
        self.0.theta_rad
    }

    /// Turn, degrees.
    #[getter]
    fn theta_deg(&self) -> f64 {
        self.0.theta_deg()
    }

    /// `b_from_a` of this `a_from_b`.
    fn inverse(&self) -> Self {
        Self(self.0.inverse())
    }

    /// Takes a point of frame `b` to frame `a`, mm.
    fn apply(&self, x_mm: f64, y_mm: f64) -> (f64, f64) {
        let [x, y] = self.0.apply([x_mm, y_mm]);
        (x, y)
    }

    /// The distance between the origins of two poses, mm.
    fn distance_mm(&self, other: PoseLike) -> f64 {
        self.0.distance_mm(&other.0)
    }

    /// x mm, y mm, theta rad.
    fn as_tuple(&self) -> (f64, f64, f64) {
        (self.0.x_mm, self.0.y_mm, self.0.theta_rad)
    }

    fn __mul__(&self, other: PoseLike) -> Self {
        Self(self.0 * other.0)
    }

    fn __repr__(&self) -> String {
        let Se2 { x_mm, y_mm, theta_rad } = self.0;
        format!("Pose(x_mm={x_mm:?}, y_mm={y_mm:?}, theta_rad={theta_rad:?})")
    }

    fn __str__(&self) -> String {
        format!("({:.2} mm, {:.2} mm, {:.1} degrees)", self.0.x_mm, self.0.y_mm, self.0.theta_deg())
    }
}
