//! Settings by name: what C may set and reads back, what is refused with which words, and where they are listed.

#![allow(clippy::expect_used, clippy::panic, clippy::unwrap_used, reason = "a test fails by a panic")]
#![expect(unsafe_code, reason = "calls the library as C does")]

use std::ffi::{CStr, CString, c_char};
use std::ptr::null_mut;
use std::sync::OnceLock;

use proptest::prelude::*;
use tactile_capi::config::*;
use tactile_capi::model::{tf_model, tf_model_load};
use tactile_capi::sensor::tf_side;
use tactile_capi::status::{tf_last_error, tf_status};
use tactile_filter::{Number, Settings};

/// The settings that are whole numbers.
const WHOLE: [&str; 7] = ["max_touches", "verify", "n_draws", "n_suppositions", "n_finalists", "subdivisions", "seed"];

/// A config that frees itself.
struct Config(*mut tf_config);

// SAFETY: the library says Busy where two threads must not use it at once.
unsafe impl Sync for Config {}

impl Drop for Config {
    fn drop(&mut self) {
        unsafe { tf_config_free(self.0) }
    }
}

/// The model that comes with the project, loaded once.
struct Shipped(*mut tf_model);

// SAFETY: any number of threads may use a model at once.
unsafe impl Send for Shipped {}
// SAFETY: as above.
unsafe impl Sync for Shipped {}

fn model() -> *const tf_model {
    static MODEL: OnceLock<Shipped> = OnceLock::new();
    let load = || {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../infer/models/maze-small.safetensors");
        let (path, mut model) = (CString::new(path).unwrap(), null_mut());
        assert_eq!(unsafe { tf_model_load(path.as_ptr(), &mut model) }, tf_status::Ok, "{}", said());
        Shipped(model)
    };
    MODEL.get_or_init(load).0
}

impl Config {
    fn new() -> Self {
        let mut config = null_mut();
        assert_eq!(unsafe { tf_config_new(model(), tf_side::Hole as u32, &mut config) }, tf_status::Ok, "{}", said());
        Self(config)
    }
    fn set(&self, name: &CStr, value: &CStr) -> tf_status {
        unsafe { tf_config_set(self.0, name.as_ptr(), value.as_ptr()) }
    }
    fn set_number(&self, name: &str, value: f64) -> tf_status {
        unsafe { tf_config_set_number(self.0, CString::new(name).unwrap().as_ptr(), value) }
    }
    fn get(&self, name: &str) -> String {
        let (name, mut n) = (CString::new(name).unwrap(), 0);
        let get = |buffer: *mut c_char, capacity, n: &mut usize| unsafe {
            tf_config_get(self.0, name.as_ptr(), buffer, capacity, n)
        };
        assert_eq!(get(null_mut(), 0, &mut n), tf_status::Ok);
        // One too few are not written to.
        let mut text = vec![b'?'; n];
        assert_eq!(get(text.as_mut_ptr().cast(), n - 1, &mut n), tf_status::BufferTooSmall);
        assert!(text.len() == n && text.iter().all(|byte| *byte == b'?'));
        assert_eq!(get(text.as_mut_ptr().cast(), n, &mut n), tf_status::Ok);
        CString::from_vec_with_nul(text).unwrap().into_string().unwrap()
    }
    /// All settings.
    fn texts(&self) -> Vec<String> {
        Settings::numbers().iter().map(|number| self.get(number.name)).collect()
    }
}

fn said() -> String {
    unsafe { CStr::from_ptr(tf_last_error()) }.to_str().unwrap().to_owned()
}

#[test]
fn a_new_config_has_the_defaults_and_each_setting_reads_back_as_it_was_set() {
    let config = Config::new();
    assert_eq!(config.texts(), ["0.95", "none", "10", "0.01", "0.01", "8", "0", "160", "24", "24", "2", "1"]);
    for (name, value) in [
        (c"stop_probability", c"1"),
        (c"stop_place_mm", c"0.25"),
        (c"max_touches", c"1000"),
        (c"false_accept", c"none"),
        (c"false_refuse", c"0.125"),
        (c"verify", c"0"),
        (c"travel_nats_per_mm", c"0.1"),
        (c"n_draws", c"320"),
        (c"n_suppositions", c"48"),
        (c"n_finalists", c"none"),
        (c"subdivisions", c"3"),
        (c"seed", c"18446744073709551615"),
    ] {
        assert_eq!(config.set(name, value), tf_status::Ok, "{}", said());
        assert_eq!(config.get(name.to_str().unwrap()), value.to_str().unwrap());
    }
    assert_eq!(
        config.texts(),
        ["1", "0.25", "1000", "none", "0.125", "0", "0.1", "320", "48", "none", "3", "18446744073709551615"]
    );
    assert_eq!([config.set_number("max_touches", 4.0), config.set_number("false_accept", 0.125)], [tf_status::Ok; 2]);
    assert_eq!([config.get("max_touches"), config.get("false_accept")], ["4", "0.125"]);
}

#[test]
fn what_cannot_be_set_is_refused_in_the_words_of_rust_and_changes_nothing() {
    let config = Config::new();
    let before = config.texts();
    for (name, value, status, words) in [
        (c"max_touches", c"0", tf_status::Config, "episode.max_touches: expected 1 to 1000, got 0"),
        (c"max_touches", c"", tf_status::Config, "episode.max_touches: expected a whole number, not negative, got "),
        (c"seed", c"none", tf_status::Config, "episode.seed: expected a whole number, not negative, got none"),
        (c"false_accept", c"2", tf_status::Config, "episode.false_accept: expected 0..=1, or none, got 2"),
        (c"n_draws", c"many", tf_status::Config, "episode.n_draws: expected a whole number, not negative, got many"),
        (
            c"temperature",
            c"1",
            tf_status::Config,
            "episode.temperature: expected one of stop_probability, stop_place_mm",
        ),
        (c"", c"1", tf_status::Config, "episode.: expected one of stop_probability, "),
        (c"se\xff", c"1", tf_status::Argument, "name: expected UTF-8, got invalid utf-8 sequence of 1 bytes"),
        (c"seed", c"\xc3\x28", tf_status::Argument, "value: expected UTF-8, got invalid utf-8 sequence of 1 bytes"),
    ] {
        assert_eq!(config.set(name, value), status, "{words}");
        assert!(said().starts_with(words), "expected {words}\ngot {}", said());
    }
    for (name, value, words) in [
        ("max_touches", 4.5, "episode.max_touches: expected a whole number, not negative, got 4.5"),
        ("max_touches", f64::NAN, "episode.max_touches: expected a whole number, not negative, got NaN"),
        ("stop_probability", f64::NAN, "episode.stop_probability: expected 0..=1, got NaN"),
        ("stop_place_mm", f64::INFINITY, "episode.stop_place_mm: expected a positive number, or none, got inf"),
        ("travel_nats_per_mm", -1.0, "episode.travel_nats_per_mm: expected a number, not negative, got -1"),
        ("matched_mean", 1.0, "episode.matched_mean: expected one of stop_probability, "),
    ] {
        assert_eq!(config.set_number(name, value), tf_status::Config, "{words}");
        assert!(said().starts_with(words), "expected {words}\ngot {}", said());
    }
    let mut n = 7;
    let get = |name: &CStr, n| unsafe { tf_config_get(config.0, name.as_ptr(), null_mut(), 0, n) };
    assert_eq!([get(c"seeds", &mut n), get(c"\xff", &mut n)], [tf_status::Config, tf_status::Argument]);
    assert_eq!((config.texts(), n), (before, 7));
}

#[test]
fn a_side_that_is_none_makes_no_config() {
    let mut config = 0x10 as *mut tf_config;
    assert_eq!(unsafe { tf_config_new(model(), 2, &mut config) }, tf_status::Argument);
    assert!(config.is_null() && said() == "side: expected a value of tf_side, got 2", "{}", said());
}

#[test]
fn threads_that_share_a_config_get_an_answer_or_busy() {
    let config = Config::new();
    let one_of = |status| assert!([tf_status::Ok, tf_status::Busy].contains(&status), "{}", said());
    std::thread::scope(|scope| {
        let config = &config;
        for thread in 0..4 {
            scope.spawn(move || {
                for n in 0..1000 {
                    let mut required = 0;
                    one_of(match thread {
                        0 | 1 => config.set_number("seed", f64::from(n)),
                        _ => unsafe { tf_config_get(config.0, c"seed".as_ptr(), null_mut(), 0, &mut required) },
                    });
                }
            });
        }
    });
    assert_eq!(config.set_number("seed", 5.0), tf_status::Ok);
    assert_eq!(config.get("seed"), "5");
}

#[test]
fn the_header_lists_the_settings() {
    let row = |number: &Number<Settings>| {
        let unit = if number.unit.is_empty() { String::new() } else { format!(", in {}", number.unit) };
        format!(" * - {}{unit}: {}", number.name, number.allowed())
    };
    let header = include_str!("../include/tactile_filter.h").replace("\r\n", "\n");
    // Together and in order, so that a setting that is gone leaves no row.
    let rows = Settings::numbers().iter().map(row).collect::<Vec<_>>().join("\n");
    assert!(header.contains(&format!("\n{rows}\n")), "tactile_filter.h lacks the rows\n{rows}");
}

proptest! {
    #[test]
    fn a_number_is_taken_where_it_is_in_range_and_whole_where_it_must_be(
        at in 0..Settings::numbers().len(),
        value in prop_oneof![any::<f64>(), -2.0..3.0_f64, (-3..2000_i32).prop_map(f64::from)],
    ) {
        let (config, number) = (Config::new(), &Settings::numbers()[at]);
        let mut expected = config.texts();
        let is_whole = value.fract() == 0.0 && value.is_sign_positive() && value < 2.0_f64.powi(64);
        if number.range.contains(value) && (is_whole || !WHOLE.contains(&number.name)) {
            prop_assert_eq!(config.set_number(number.name, value), tf_status::Ok, "{}", said());
            let text = config.get(number.name);
            prop_assert_eq!(text.parse::<f64>().unwrap().to_bits(), value.to_bits());
            expected[at] = text;
        } else {
            prop_assert_eq!(config.set_number(number.name, value), tf_status::Config);
        }
        prop_assert_eq!(config.texts(), expected);
    }
}
