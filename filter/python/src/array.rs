//! Values from numpy and to it. Everything is copied: an array that Python changes later changes nothing here.

use numpy::ndarray;
use numpy::{Element, PyArray, PyArray1, PyArray2, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use tactile_data::FrameFault;
use tactile_data::frame::Frame;
use tactile_data::pose::se2::Se2;

use crate::error::{exception, type_error};
use crate::pose::PoseLike;

/// The most pixels of a frame: more than any camera has, and less than would fill the memory.
const MAX_PIXELS: usize = 100_000_000;

/// The most motions of a reach: judging them would take minutes.
const MAX_MOTIONS: usize = 1_000_000;

/// A frame from a numpy array of uint8 `[height, width, 3]`, RGB, of any memory layout.
///
/// `size_px`: the width and height it must have, checked before anything is copied.
pub fn frame(object: &Bound<'_, PyAny>, size_px: Option<[usize; 2]>) -> PyResult<Frame> {
    const EXPECTED: &str = "a numpy array of uint8 [height, width, 3]";
    let py = object.py();
    let wrong = || type_error("frame", EXPECTED, &describe(object));
    let array = object.cast::<PyArray<u8, ndarray::Ix3>>().map_err(|_| wrong())?;
    let &[height, width, 3] = array.shape() else { return Err(wrong()) };
    if let Some(expected) = size_px.filter(|size| *size != [width, height]) {
        let fault = FrameFault::WrongSize { expected, got: [width, height] };
        return Err(exception(py, tactile_filter::Error::Frame { what: "frame".into(), fault }));
    }
    if height.saturating_mul(width) > MAX_PIXELS {
        return Err(PyValueError::new_err(format!(
            "frame: expected at most {MAX_PIXELS} pixels, got {}",
            describe(object)
        )));
    }
    Frame::new(width, height, values(array)?).map_err(|error| exception(py, error.into()))
}

/// Motions from a numpy array of float64 `[n, 3]` (x mm, y mm, theta rad), or from a sequence of poses.
pub fn motions(object: &Bound<'_, PyAny>) -> PyResult<Vec<Se2>> {
    const EXPECTED: &str = "a numpy array of float64 [n, 3] or a sequence of poses";
    let too_many = |n: usize| PyValueError::new_err(format!("reach: expected at most {MAX_MOTIONS} motions, got {n}"));
    if object.cast::<PyUntypedArray>().is_err() {
        let n = object.len().map_err(|_| type_error("reach", EXPECTED, &describe(object)))?;
        if n > MAX_MOTIONS {
            return Err(too_many(n));
        }
        let poses = object.try_iter().map_err(|_| type_error("reach", EXPECTED, &describe(object)))?;
        return poses.map(|pose| Ok(pose?.extract::<PoseLike>()?.0)).collect();
    }
    let wrong = || type_error("reach", EXPECTED, &describe(object));
    let array = object.cast::<PyArray2<f64>>().map_err(|_| wrong())?;
    let &[n, 3] = array.shape() else { return Err(wrong()) };
    if n > MAX_MOTIONS {
        return Err(too_many(n));
    }
    let values = values(array)?;
    let (rows, _) = values.as_chunks::<3>();
    Ok(rows.iter().map(|[x_mm, y_mm, theta_rad]| Se2::new(*x_mm, *y_mm, *theta_rad)).collect())
}

/// The elements of an array in C order.
fn values<T: Element + Copy, D: ndarray::Dimension>(array: &Bound<'_, PyArray<T, D>>) -> PyResult<Vec<T>> {
    // `as_slice` would take an array in Fortran's order in the order of memory; one that is not aligned it refuses.
    if array.is_c_contiguous()
        && let Ok(slice) = array.try_readonly()?.as_slice()
    {
        return Ok(slice.to_vec());
    }
    // With gaps, in another order or not aligned: numpy makes a plain one of it.
    let copy = array.call_method1("copy", ("C",))?;
    let copy = copy.cast::<PyArray<T, D>>()?;
    if !copy.is_c_contiguous() {
        return Err(type_error("array", "a copy in C order", "one in another order"));
    }
    Ok(copy.try_readonly()?.as_slice()?.to_vec())
}

/// What an object is, for an error: the type and shape of an array, or the name of its class.
fn describe(object: &Bound<'_, PyAny>) -> String {
    let array = object.cast::<PyUntypedArray>();
    array.map_or_else(
        |_| object.get_type().name().map_or_else(|_| "an object".into(), |name| name.to_string()),
        |array| format!("an array of {} {:?}", array.dtype(), array.shape()),
    )
}

/// A one-dimensional array.
pub fn vector<'py, T: Element>(py: Python<'py>, values: Vec<T>) -> Bound<'py, PyArray1<T>> {
    PyArray1::from_vec(py, values)
}

/// An array of `n_columns` columns from its rows, one behind the other.
pub fn matrix<'py, T: Element>(py: Python<'py>, n_columns: usize, values: Vec<T>) -> PyResult<Bound<'py, PyArray2<T>>> {
    let n_rows = values.len() / n_columns.max(1);
    PyArray1::from_vec(py, values).reshape([n_rows, n_columns])
}
