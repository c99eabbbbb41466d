//! Pointers of C made into references, slices and boxes: the checks that can be made, in one place.

use std::ffi::{CStr, c_char};
use std::path::PathBuf;

use crate::status::{Failure, tf_status};

fn null(what: &str) -> Failure {
    Failure::new(tf_status::NullPointer, format!("{what}: expected a pointer, got null or one that is not aligned"))
}

/// Borrows what a pointer points to.
///
/// # Safety
/// Null or not aligned, or valid for reads as `T` for `'a`, with nobody writing.
pub unsafe fn get<'a, T>(pointer: *const T, what: &str) -> Result<&'a T, Failure> {
    if !pointer.is_aligned() {
        return Err(null(what));
    }
    // SAFETY: aligned; the rest is the caller's promise.
    unsafe { pointer.as_ref() }.ok_or_else(|| null(what))
}

/// Checks a pointer to write through; what it points to need not be initialised.
pub fn out<T>(pointer: *mut T, what: &str) -> Result<Out<T>, Failure> {
    if pointer.is_null() || !pointer.is_aligned() { Err(null(what)) } else { Ok(Out(pointer)) }
}

/// A place to write one value to.
pub struct Out<T>(*mut T);

impl<T> Out<T> {
    /// Writes the value.
    ///
    /// # Safety
    /// The place is valid for writes of a `T`, with nobody reading.
    pub unsafe fn put(&self, value: T) {
        // SAFETY: not null, aligned; the rest is the caller's promise.
        unsafe { self.0.write(value) }
    }
}

/// Borrows `n` values. Null is allowed where `n` is 0.
///
/// # Safety
/// Null, not aligned, or valid for reads of `n` values for `'a`, with nobody writing.
pub unsafe fn slice<'a, T>(pointer: *const T, n: usize, what: &str) -> Result<&'a [T], Failure> {
    if n == 0 {
        return Ok(&[]);
    }
    if pointer.is_null() || !pointer.is_aligned() {
        return Err(null(what));
    }
    if n > isize::MAX as usize / size_of::<T>().max(1) {
        return Err(Failure::argument(what, "a length that memory could hold", n));
    }
    // SAFETY: not null, aligned, of a possible length; the rest is the caller's promise.
    Ok(unsafe { std::slice::from_raw_parts(pointer, n) })
}

/// Copies values into a caller's buffer and says how many there are. With a capacity of 0 it only says so.
///
/// # Safety
/// `buffer` is null with a capacity of 0, or valid for writes of `capacity` values; `required` is null or valid.
pub unsafe fn fill<T: Copy>(
    values: &[T],
    buffer: *mut T,
    capacity: usize,
    required: *mut usize,
) -> Result<(), Failure> {
    // SAFETY: the caller's promise.
    unsafe { out(required, "required")?.put(values.len()) };
    if capacity == 0 {
        return Ok(());
    }
    let buffer = out(buffer, "buffer")?;
    if capacity < values.len() {
        let message = format!("buffer: expected room for {}, got room for {capacity}", values.len());
        return Err(Failure::new(tf_status::BufferTooSmall, message));
    }
    // SAFETY: not null, aligned, long enough; our own values do not overlap with the caller's buffer.
    unsafe { values.as_ptr().copy_to_nonoverlapping(buffer.0, values.len()) };
    Ok(())
}

/// # Safety
/// Null, or a string that ends with a zero, valid for `'a`, with nobody writing.
unsafe fn c_str<'a>(text: *const c_char, what: &str) -> Result<&'a CStr, Failure> {
    if text.is_null() {
        return Err(null(what));
    }
    // SAFETY: not null; the rest is the caller's promise.
    Ok(unsafe { CStr::from_ptr(text) })
}

/// Borrows a text that C gave.
///
/// # Safety
/// Null, or a string that ends with a zero, valid for `'a`, with nobody writing.
pub unsafe fn text<'a>(text: *const c_char, what: &str) -> Result<&'a str, Failure> {
    // SAFETY: the caller's promise.
    let text = unsafe { c_str(text, what)? };
    text.to_str().map_err(|error| Failure::argument(what, "UTF-8", error))
}

/// A path that C gave, in the system's encoding on Unix, in UTF-8 elsewhere.
///
/// # Safety
/// Null, or a string that ends with a zero.
pub unsafe fn path(text: *const c_char) -> Result<PathBuf, Failure> {
    // SAFETY: the caller's promise.
    let text = unsafe { c_str(text, "path")? };
    if text.is_empty() {
        return Err(Failure::argument("path", "a path", "an empty text"));
    }
    of_bytes(text)
}

#[cfg(unix)]
fn of_bytes(text: &CStr) -> Result<PathBuf, Failure> {
    use std::os::unix::ffi::OsStrExt;
    Ok(std::ffi::OsStr::from_bytes(text.to_bytes()).into())
}

#[cfg(not(unix))]
fn of_bytes(text: &CStr) -> Result<PathBuf, Failure> {
    text.to_str().map(PathBuf::from).map_err(|error| Failure::argument("path", "UTF-8", error))
}

/// Frees a handle; null is nothing to free. A panic on the way leaks what is left of it.
///
/// # Safety
/// Null, or a handle that [`give`] made and nobody uses any more.
pub unsafe fn free<T>(handle: *mut T) {
    if handle.is_null() || !handle.is_aligned() {
        return;
    }
    // SAFETY: the caller's promise.
    let value = unsafe { Box::from_raw(handle) };
    crate::status::call(move || {
        drop(value);
        Ok(())
    });
}

/// Hands a value over to C. The place holds null until the value is there.
///
/// # Safety
/// `place` is null or valid for writes.
pub unsafe fn give<T>(place: *mut *mut T, make: impl FnOnce() -> Result<T, Failure>) -> Result<(), Failure> {
    let place = out(place, "out")?;
    // SAFETY: the caller's promise, twice.
    unsafe { place.put(std::ptr::null_mut()) };
    let value = Box::into_raw(Box::new(make()?));
    unsafe { place.put(value) };
    Ok(())
}
