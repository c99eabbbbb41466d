//! The simulated sensor, to try things out without a robot.

use std::sync::Arc;

use numpy::{PyArray3, PyArrayMethods};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_infer::bank::simulated::SceneBank;

use crate::array::vector;
use crate::error::compute;
use crate::model::{PyBank, PyModel};
use crate::pose::PoseLike;

/// A simulated sensor over the holes of a scene.
#[pyclass(name = "Simulator", module = "tactile_filter", frozen)]
pub struct PySimulator {
    simulator: Simulator,
    seed: u64,
}

#[pymethods]
impl PySimulator {
    /// `scene`: the name of a preset or the path of a scene file.
    #[new]
    #[pyo3(signature = (scene, seed = 1))]
    fn new(py: Python<'_>, scene: &str, seed: u64) -> PyResult<Self> {
        compute(py, || Ok(Self { simulator: Simulator::new(Scene::load(scene)?, seed)?, seed }))
    }

    /// Names of the parts.
    #[getter]
    fn parts(&self) -> Vec<String> {
        self.simulator.parts().to_vec()
    }

    /// The frame without contact: uint8 `[height, width, 3]`.
    fn rest_frame<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        array(py, &compute(py, || Ok(self.simulator.no_contact(self.seed)))?)
    }

    /// A touch of a part's hole: uint8 `[height, width, 3]`. `n`: the number of the touch, which draws its noise.
    #[pyo3(signature = (part, part_from_sensor, n = 0))]
    fn touch<'py>(
        &self,
        py: Python<'py>,
        part: &str,
        part_from_sensor: PoseLike,
        n: u64,
    ) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let parts = self.simulator.parts();
        let Some(part) = parts.iter().position(|name| name == part) else {
            return Err(PyKeyError::new_err(format!("part: expected one of {}, got {part}", parts.join(", "))));
        };
        let touch = || Ok(self.simulator.touch(part, Side::Hole, &part_from_sensor.0, &mut frame_rng(self.seed, n))?);
        array(py, &compute(py, touch)?)
    }

    /// The bank of the scene's parts, touched one by one at the poses of the scene's reach in these steps, mm and degrees.
    /// Its views are of `"pegs"` alone or of `"both"` sides; how embeddings are compared is learnt from simulated touches of
    /// the `"hole"`, the `"peg"`, `"both"` or `"nothing"`.
    /// Takes a minute or less. With steps above 2.5 mm or 20 degrees views are not interpolated.
    #[pyo3(signature = (model, xy_step_mm = 2.0, theta_step_deg = 15.0, views = "both", learn_from = "hole"))]
    #[expect(clippy::too_many_arguments, reason = "keyword arguments in Python")]
    fn bank(
        &self,
        py: Python<'_>,
        model: &PyModel,
        xy_step_mm: f64,
        theta_step_deg: f64,
        views: &str,
        learn_from: &str,
    ) -> PyResult<PyBank> {
        let mut scene = self.simulator.scene().clone();
        scene.reach = scene.reach.map(|reach| PoseGrid { xy_step_mm, theta_step_deg, ..reach });
        let bank = compute(py, || {
            scene.reach.as_ref().map_or(Ok(()), PoseGrid::validate)?;
            let (model, views, learn_from) = (&model.0, views.parse()?, learn_from.parse()?);
            Ok(SceneBank { model, scene: &scene, views, learn_from, seed: self.seed }.make(None, &|_, _| ())?)
        })?;
        Ok(PyBank(Arc::new(bank)))
    }

    fn __repr__(&self) -> String {
        let [width, height] = self.simulator.scene().sensor.frame_px;
        format!("<Simulator of {width}x{height} pixels over {}>", self.simulator.parts().join(", "))
    }
}

fn array<'py>(py: Python<'py>, frame: &Frame) -> PyResult<Bound<'py, PyArray3<u8>>> {
    vector(py, frame.rgb().to_vec()).reshape([frame.height_px(), frame.width_px(), 3])
}
