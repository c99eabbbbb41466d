//! What an episode runs with: what was measured of a model, and settings by name.

use std::ffi::c_char;
use std::sync::{RwLock, RwLockReadGuard, RwLockWriteGuard};

use tactile_filter::{EpisodeConfig, KnownStart, SensorMatch};

use crate::model::tf_model;
use crate::pointer::{fill, free, get, give, text};
use crate::sensor::side;
use crate::status::{Failure, call, tf_status};
use crate::value::{tf_pose, unflat};

/// What an episode runs with: what was measured of a model, and these settings, each with what it may be:
/// - stop_probability: 0..=1
/// - stop_place_mm, in mm: a positive number, or none
/// - max_touches: 1 to 1000
/// - false_accept: 0..=1, or none
/// - false_refuse: 0..=1
/// - verify: a number, not negative
/// - travel_nats_per_mm, in nats/mm: a number, not negative
/// - n_draws: 1 to 100000
/// - n_suppositions: 1 to 10000
/// - n_finalists: at least 1, or none
/// - subdivisions: 1 to 4
/// - seed: any
///
/// README.md says what each does. Several threads may read a config at once, but only one may use it while a setting is
/// changed: the others get TF_STATUS_BUSY. An episode and a runner copy the config that they begin with.
pub struct tf_config {
    config: RwLock<EpisodeConfig>,
}

impl tf_config {
    fn read(&self) -> Result<RwLockReadGuard<'_, EpisodeConfig>, Failure> {
        Ok(self.config.try_read()?)
    }

    fn write(&self) -> Result<RwLockWriteGuard<'_, EpisodeConfig>, Failure> {
        Ok(self.config.try_write()?)
    }

    /// Takes in where a hole is known to be.
    fn start(&self, start: Option<KnownStart>) -> Result<(), Failure> {
        self.write()?.start = start;
        Ok(())
    }

    /// Takes in what is known of the sensor.
    pub(crate) fn know(&self, sensor: SensorMatch) -> Result<(), Failure> {
        self.write()?.sensor = sensor;
        Ok(())
    }
}

/// A copy of a config, checked as a whole.
///
/// # Safety
/// `config` is null or valid.
pub(crate) unsafe fn checked(config: *const tf_config) -> Result<EpisodeConfig, Failure> {
    let config = *unsafe { get(config, "config")? }.read()?;
    config.validate()?;
    Ok(config)
}

/// A config with what was measured of a model where this side is touched, and with every setting at its default. A model
/// without a calibration for pegs is believed as for holes.
/// \param touched  a value of tf_side
/// \param out      where the handle goes, to be freed by tf_config_free(); null after an error
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_new(model: *const tf_model, touched: u32, out: *mut *mut tf_config) -> tf_status {
    let make = || {
        let config = EpisodeConfig::of_side(&unsafe { get(model, "model")? }.model, side(touched)?);
        Ok(tf_config { config: RwLock::new(config) })
    };
    call(|| unsafe { give(out, make) })
}

/// Frees a config; null is allowed. An episode or a runner that began with it goes on working.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_free(config: *mut tf_config) {
    unsafe { free(config) }
}

/// Forgets what holes have told of the sensor (tf_episode_learn()): for a new gel or another camera.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_forget_sensor(config: *mut tf_config) -> tf_status {
    call(|| unsafe { get(config.cast_const(), "config")?.know(SensorMatch::default()) })
}

/// Tells a config where the hole of the next episode is known to be before it is touched, from a camera or a drawing; the touches then decide
/// among places as likely as that. It is kept for all episodes that begin with this config, until it is changed or forgotten
/// (tf_config_forget_start()). Where an episode begins, TF_STATUS_CONFIG: no pose, no covariance, or one far from where the bank's parts may be
/// touched first.
/// \param part_from_first  pose of the sensor at the first touch, in the part's frame
/// \param covariance       of that pose over (x mm, y mm, theta rad), row by row, 9 numbers
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_know_start(
    config: *mut tf_config,
    part_from_first: tf_pose,
    covariance: *const f64,
) -> tf_status {
    call(|| {
        let start = KnownStart { part_from_first: part_from_first.into(), covariance: unsafe { matrix(covariance)? } };
        unsafe { get(config.cast_const(), "config")? }.start(Some(start))
    })
}

/// tf_config_know_start() from where the part is seen. Both poses are in any one frame, as the robot's base.
/// \param base_from_part   the part's pose
/// \param covariance       of that pose over (x mm, y mm, theta rad), row by row, 9 numbers
/// \param base_from_first  pose of the sensor at the first touch
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_know_part(
    config: *mut tf_config,
    base_from_part: tf_pose,
    covariance: *const f64,
    base_from_first: tf_pose,
) -> tf_status {
    call(|| {
        let covariance = unsafe { matrix(covariance)? };
        let start = KnownStart::of_part(base_from_part.into(), covariance, base_from_first.into());
        unsafe { get(config.cast_const(), "config")? }.start(Some(start))
    })
}

/// Forgets where a hole is known to be: it may be anywhere.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_forget_start(config: *mut tf_config) -> tf_status {
    call(|| unsafe { get(config.cast_const(), "config")?.start(None) })
}

/// # Safety
/// `values` is null or of 9 numbers.
unsafe fn matrix(values: *const f64) -> Result<[[f64; 3]; 3], Failure> {
    Ok(unflat(unsafe { get(values.cast::<[f64; 9]>(), "covariance")? }))
}

/// Changes a setting.
/// \param name   its name, UTF-8
/// \param value  its value as text, UTF-8: "4", "0.95", "none"
/// TF_STATUS_CONFIG: no setting has the name, or the setting cannot have the value; tf_last_error() says which names or
/// values there are. TF_STATUS_ARGUMENT: a text that is not UTF-8. Settings that ask for too much effort together are
/// refused where an episode begins.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_set(config: *mut tf_config, name: *const c_char, value: *const c_char) -> tf_status {
    call(|| unsafe { set(config, name, text(value, "value")?) })
}

/// Changes a setting as tf_config_set() does, from a number.
/// \param value  4.0 where the setting is a whole number, and 4.5 is refused; above 2^53 use tf_config_set(), as a double
///               does not hold each whole number there
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_set_number(config: *mut tf_config, name: *const c_char, value: f64) -> tf_status {
    call(|| unsafe { set(config, name, &value.to_string()) })
}

/// # Safety
/// `config` and `name` are null or valid.
unsafe fn set(config: *mut tf_config, name: *const c_char, value: &str) -> Result<(), Failure> {
    let (config, name) = unsafe { (get(config, "config")?, text(name, "name")?) };
    Ok(config.write()?.settings.set(name, value)?)
}

/// A setting as the text that tf_config_set() takes: "none", or the shortest text that is read as the same number to the
/// bit.
/// \param required  where the number of bytes goes, the zero at the end included; with a capacity of 0 nothing else is
///                  written
/// TF_STATUS_CONFIG, TF_STATUS_ARGUMENT: as for tf_config_set().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_config_get(
    config: *const tf_config,
    name: *const c_char,
    buffer: *mut c_char,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let (config, name) = (get(config, "config")?, text(name, "name")?);
        let mut value = config.read()?.settings.get(name)?.into_bytes();
        value.push(0);
        fill(&value, buffer.cast(), capacity, required)
    })
}
