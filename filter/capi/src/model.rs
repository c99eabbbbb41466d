//! The network and the bank of recorded views, from their files.

use std::ffi::{CString, c_char};
use std::sync::Arc;

use tactile_infer::maps::Maps;
use tactile_infer::{Bank, Model};

use crate::pointer::{fill, free, get, give, out, path};
use crate::status::{Failure, call, tf_status};

/// A trained network. Never changes: any number of threads may use it at once.
pub struct tf_model {
    pub(crate) model: Arc<Model>,
}

/// The recorded views of the parts. Never changes: any number of threads may use it at once.
pub struct tf_bank {
    pub(crate) parts: Arc<Parts>,
}

/// A bank, and the names of its parts as C reads them.
pub(crate) struct Parts {
    pub bank: Arc<Bank>,
    pub names: Vec<CString>,
}

/// Loads a model from its file (`maze-small.safetensors`).
/// \param path  the file's path, ending with a zero
/// \param out   where the handle goes, to be freed by tf_model_free(); null after an error
/// TF_STATUS_FILE: it cannot be read. TF_STATUS_UNUSABLE: it is damaged, or no model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_model_load(path: *const c_char, out: *mut *mut tf_model) -> tf_status {
    call(|| unsafe { give(out, || Ok(tf_model { model: Arc::new(Model::load(&self::path(path)?)?) })) })
}

/// Loads a model, and networks that draw a map of each touch and judge by them (`maze-small.maps.safetensors`): with banks that have
/// maps of their parts (`tactile-infer bank --maps`), places are found and parts are verified by them.
/// \param maps  the path of the networks' file, ending with a zero
/// TF_STATUS_FILE, TF_STATUS_UNUSABLE: as tf_model_load(), of either file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_model_load_with_maps(
    path: *const c_char,
    maps: *const c_char,
    out: *mut *mut tf_model,
) -> tf_status {
    let load = || {
        let [path, maps] = unsafe { [self::path(path)?, self::path(maps)?] };
        let model = Model::load(&path)?.with_maps(Maps::load(&maps)?)?;
        Ok(tf_model { model: Arc::new(model) })
    };
    call(|| unsafe { give(out, load) })
}

/// Frees a model; null is allowed. What was made with it goes on working.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_model_free(model: *mut tf_model) {
    unsafe { free(model) }
}

/// Loads a bank from its file, made with `tactile-infer bank`.
/// \param model the model that made the bank
/// TF_STATUS_WRONG_MODEL: another model made it. TF_STATUS_FILE, TF_STATUS_UNUSABLE: as for a model.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_bank_load(
    model: *const tf_model,
    path: *const c_char,
    out: *mut *mut tf_bank,
) -> tf_status {
    let load = || {
        let (model, path) = unsafe { (get(model, "model")?, self::path(path)?) };
        let bank = Bank::load(&path, &model.model)?;
        let name = |name: &String| {
            CString::new(name.as_str()).map_err(|_| Failure::argument("bank", "part names without a zero", name))
        };
        let names = bank.parts().iter().map(name).collect::<Result<_, _>>()?;
        Ok(tf_bank { parts: Arc::new(Parts { bank: Arc::new(bank), names }) })
    };
    call(|| unsafe { give(out, load) })
}

/// Frees a bank; null is allowed. What was made with it goes on working.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_bank_free(bank: *mut tf_bank) {
    unsafe { free(bank) }
}

/// The number of parts in a bank. Parts are numbered from 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_bank_n_parts(bank: *const tf_bank, n_parts: *mut usize) -> tf_status {
    call(|| unsafe {
        out(n_parts, "n_parts")?.put(get(bank, "bank")?.parts.names.len());
        Ok(())
    })
}

/// The name of a part, UTF-8. It belongs to the bank, and is valid until the bank is freed.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_bank_part_name(bank: *const tf_bank, part: usize, name: *mut *const c_char) -> tf_status {
    call(|| unsafe {
        let (bank, name) = (get(bank, "bank")?, out(name, "name")?);
        name.put(bank.parts.name(part)?.as_ptr());
        Ok(())
    })
}

/// The checksum of a bank as 64 hex digits without a zero at the end: what a saved episode is bound to.
/// \param required  where the number of bytes goes; with a capacity of 0 nothing else is written
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_bank_sha256(
    bank: *const tf_bank,
    buffer: *mut u8,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe { fill(get(bank, "bank")?.parts.bank.sha256()?.as_bytes(), buffer, capacity, required) })
}

impl Parts {
    /// The number of the part of a name.
    pub fn index(&self, name: &str) -> Result<usize, Failure> {
        let index = self.bank.parts().iter().position(|part| part == name);
        index.ok_or_else(|| Failure::argument("estimate", "a part of the bank", name))
    }

    /// A part's name.
    pub fn name(&self, part: usize) -> Result<&CString, Failure> {
        let n_parts = self.names.len();
        self.names.get(part).ok_or_else(|| Failure::argument("part", format!("a number below {n_parts}"), part))
    }
}
