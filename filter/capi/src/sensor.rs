//! The camera with its frame at rest; frames and observations.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::light::lamps::Lamps;
use tactile_filter::{Observation, Sensor};

use crate::model::tf_model;
use crate::pointer::{free, get, give, out, slice};
use crate::status::{Failure, call, tf_status};

/// The largest width and height of a frame, pixels.
const MAX_SIDE_PX: usize = 1 << 15;

/// The order of the bytes of a pixel.
#[repr(C)]
pub enum tf_format {
    /// Red, green, blue, 8 bits each.
    Rgb8 = 0,
    /// Blue, green, red, 8 bits each: what OpenCV gives.
    Bgr8 = 1,
}

/// Which half of a mating pair is touched.
#[repr(C)]
pub enum tf_side {
    /// A hole, whose peg is looked for.
    Hole = 0,
    /// A raised part, recognised among the bank's own.
    Peg = 1,
}

/// Reads a value of tf_side.
pub(crate) fn side(value: u32) -> Result<Side, Failure> {
    match value {
        value if value == tf_side::Hole as u32 => Ok(Side::Hole),
        value if value == tf_side::Peg as u32 => Ok(Side::Peg),
        other => Err(Failure::argument("side", "a value of tf_side", other)),
    }
}

/// How a sensor's lamps light a slope of the gel, as `tactile-data calibrate` writes it (`[light]`): for red, green and
/// blue the factors of 1, x, y, x^2, x y, y^2 over the frame, x and y in -1..1, x right and y down, counts.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct tf_lamps {
    /// Response to a slope along x.
    pub along_x: [[f32; 6]; 3],
    /// Response to a slope along y.
    pub along_y: [[f32; 6]; 3],
}

/// A picture of the sensor. The library copies what it needs: the pixels are the caller's again after the call.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct tf_frame {
    /// The first byte of the top row; 3 bytes a pixel, rows from the top.
    pub pixels: *const u8,
    /// Width in pixels, 1 to 32768.
    pub width_px: usize,
    /// Height in pixels, 1 to 32768.
    pub height_px: usize,
    /// From the start of a row to the start of the next, bytes; at least 3 * width_px.
    pub stride_bytes: usize,
    /// A value of tf_format.
    pub format: u32,
}

/// The camera, the gel and its frame at rest, bound to a model. Never changes: any number of threads may use it at once.
pub struct tf_sensor {
    pub(crate) sensor: Arc<Sensor>,
}

/// What the filter takes in of one touch. Never changes: any number of threads may use it at once.
pub struct tf_observation {
    pub(crate) observation: Observation,
}

/// Copies a frame of C's into one of ours.
///
/// # Safety
/// `frame` is null or points to a frame whose pixels are null or valid for reads of all its rows.
pub(crate) unsafe fn read(frame: *const tf_frame) -> Result<Frame, Failure> {
    let tf_frame { pixels, width_px, height_px, stride_bytes, format } = *unsafe { get(frame, "frame")? };
    let sides = 1..=MAX_SIDE_PX;
    if !sides.contains(&width_px) || !sides.contains(&height_px) {
        let got = format!("{width_px}x{height_px}");
        return Err(Failure::argument("frame", format!("1 to {MAX_SIDE_PX} pixels a side"), got));
    }
    let n_row = 3 * width_px;
    if stride_bytes < n_row {
        return Err(Failure::argument("frame.stride_bytes", format!("{n_row} or more"), stride_bytes));
    }
    let is_bgr = match format {
        format if format == tf_format::Rgb8 as u32 => false,
        format if format == tf_format::Bgr8 as u32 => true,
        other => return Err(Failure::argument("frame.format", "a value of tf_format", other)),
    };
    // The last row need not be followed by the rest of a stride.
    let n_bytes = stride_bytes.checked_mul(height_px - 1).and_then(|bytes| bytes.checked_add(n_row));
    let n_bytes = n_bytes.ok_or_else(|| Failure::argument("frame.stride_bytes", "a stride in memory", stride_bytes))?;
    let bytes = unsafe { slice(pixels, n_bytes, "frame.pixels")? };
    let mut rgb = Vec::with_capacity(n_row * height_px);
    bytes.chunks(stride_bytes).for_each(|row| rgb.extend_from_slice(&row[..n_row]));
    if is_bgr {
        let (pixels, _) = rgb.as_chunks_mut::<3>();
        pixels.iter_mut().for_each(|pixel| pixel.swap(0, 2));
    }
    Ok(Frame::new(width_px, height_px, rgb)?)
}

/// A sensor that touches holes, and whose frame at rest, without contact, is `at_rest`.
/// TF_STATUS_FRAME_DARK, _SATURATED, _UNIFORM: that frame shows nothing. TF_STATUS_UNUSABLE: it is smaller than the model's
/// input.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_sensor_new(
    model: *const tf_model,
    at_rest: *const tf_frame,
    out: *mut *mut tf_sensor,
) -> tf_status {
    unsafe { tf_sensor_new_of_side(model, at_rest, tf_side::Hole as u32, out) }
}

/// tf_sensor_new() of a sensor that touches this side. An episode is of one side: give tf_config_new() the same side. A touch
/// of the other side is refused with TF_STATUS_WRONG_SIDE.
/// \param touched  a value of tf_side
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_sensor_new_of_side(
    model: *const tf_model,
    at_rest: *const tf_frame,
    touched: u32,
    out: *mut *mut tf_sensor,
) -> tf_status {
    let make = || {
        let (model, at_rest) = unsafe { (get(model, "model")?, read(at_rest)?) };
        let sensor = Sensor::new(model.model.clone(), &at_rest)?.of_side(side(touched)?);
        Ok(tf_sensor { sensor: Arc::new(sensor) })
    };
    call(|| unsafe { give(out, make) })
}

/// The same sensor, whose lamps are known: its pictures are brought under the lamps that the network knows. Without it they
/// are taken to be a GelSight Mini's. The first sensor stays as it is.
/// TF_STATUS_UNUSABLE: lamps that do not show slopes in all directions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_sensor_lit_by(
    sensor: *const tf_sensor,
    lamps: *const tf_lamps,
    out: *mut *mut tf_sensor,
) -> tf_status {
    let make = || {
        let (sensor, lamps) = unsafe { (get(sensor, "sensor")?, get(lamps, "lamps")?) };
        let lamps = Lamps { along_x: lamps.along_x, along_y: lamps.along_y };
        Ok(tf_sensor { sensor: Arc::new(sensor.sensor.as_ref().clone().lit_by(&lamps)?) })
    };
    call(|| unsafe { give(out, make) })
}

/// Frees a sensor; null is allowed. What was made with it goes on working.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_sensor_free(sensor: *mut tf_sensor) {
    unsafe { free(sensor) }
}

/// What a frame of a touch shows: some milliseconds of work, on the caller's thread.
/// \param out  where the handle goes, to be freed by tf_observation_free(); null after an error
/// TF_STATUS_FRAME_...: the frame cannot be used.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_sensor_observe(
    sensor: *const tf_sensor,
    frame: *const tf_frame,
    out: *mut *mut tf_observation,
) -> tf_status {
    let make = || {
        let (sensor, frame) = unsafe { (get(sensor, "sensor")?, read(frame)?) };
        Ok(tf_observation { observation: sensor.sensor.observe(&frame)? })
    };
    call(|| unsafe { give(out, make) })
}

/// Frees an observation; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_observation_free(observation: *mut tf_observation) {
    unsafe { free(observation) }
}

/// The share of the view that shows an edge, 0 to 1: 0 without contact, and on a flat face.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_observation_edge_share(
    observation: *const tf_observation,
    edge_share: *mut f32,
) -> tf_status {
    call(|| unsafe {
        out(edge_share, "edge_share")?.put(get(observation, "observation")?.observation.edge_share);
        Ok(())
    })
}
