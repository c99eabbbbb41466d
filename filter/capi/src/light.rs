//! The lamps of a sensor, learnt from its touches.

use std::sync::RwLock;

use tactile_data::light::lamps::Lamps;
use tactile_data::light::touch_light::SensorLight;

use crate::pointer::{free, get, give, out};
use crate::sensor::{read, tf_frame, tf_lamps};
use crate::status::{call, tf_status};

/// The lamps of a sensor that nobody calibrated, learnt from its touches of anything. One thread at a time: TF_STATUS_BUSY
/// where another one uses it.
pub struct tf_light {
    light: RwLock<SensorLight>,
}

/// Begins with nothing known.
/// \param at_rest  a frame of the sensor without contact
/// \param width_mm, height_mm  what a frame shows
/// \param out  where the handle goes, to be freed by tf_light_free(); null after an error
/// TF_STATUS_FRAME_...: that frame shows nothing. TF_STATUS_UNUSABLE: it is small, or shows no area.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_light_new(
    at_rest: *const tf_frame,
    width_mm: f64,
    height_mm: f64,
    out: *mut *mut tf_light,
) -> tf_status {
    let make = || {
        let light = SensorLight::new(&unsafe { read(at_rest)? }, [width_mm, height_mm])?;
        Ok(tf_light { light: RwLock::new(light) })
    };
    call(|| unsafe { give(out, make) })
}

/// Adds the frame of a touch, of any part, at any pose. One without an edge tells nothing.
/// TF_STATUS_FRAME_WRONG_SIZE: of another size than the one at rest.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_light_add(light: *mut tf_light, frame: *const tf_frame) -> tf_status {
    call(|| {
        let (light, frame) = unsafe { (get(light.cast_const(), "light")?, read(frame)?) };
        Ok(light.light.try_write()?.add(&frame)?)
    })
}

/// Learns the lamps where there are touches enough: 20 that show edges, and again after 40 and 80. Ask after each hole, and
/// give new lamps to tf_sensor_lit_by(); then forget what holes before have said (tf_config_forget_sensor()).
/// \param is_new  where 1 goes where lamps were learnt now, else 0
/// \param lamps  where they go; not written to where none were
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_light_learn(light: *mut tf_light, is_new: *mut u32, lamps: *mut tf_lamps) -> tf_status {
    call(|| unsafe {
        let (light, is_new, place) = (get(light.cast_const(), "light")?, out(is_new, "is_new")?, out(lamps, "lamps")?);
        let mut light = light.light.try_write()?;
        let learnt = light.learn().map(|found| found.lamps());
        is_new.put(u32::from(learnt.is_some()));
        if let Some(Lamps { along_x, along_y }) = learnt {
            place.put(tf_lamps { along_x, along_y });
        }
        Ok(())
    })
}

/// Frees it; null is allowed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_light_free(light: *mut tf_light) {
    unsafe { free(light) }
}
