//! A panic stays inside: Python gets an exception that it can catch as any other.

use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// What `work` returns; `Err` with the panic's message where it panics.
///
/// What `work` changes may be half changed after a panic: keep it behind a `Mutex`, which is then poisoned.
pub fn catch<T>(work: impl FnOnce() -> T) -> Result<T, String> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| message(payload.as_ref()))
}

fn message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(ToString::to_string);
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic without a message".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_an_error_with_its_message() {
        assert_eq!(catch(|| 3), Ok(3));
        assert_eq!(catch(|| -> u8 { panic!("a text") }), Err("a text".into()));
        let n = 7;
        assert_eq!(catch(|| -> u8 { panic!("number {n}") }), Err("number 7".into()));
        assert_eq!(catch(|| -> u8 { std::panic::panic_any(5) }), Err("a panic without a message".into()));
    }
}
