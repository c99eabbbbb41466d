//! JSON that programs wrote: read, and its values found by pointer or named in the error.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::error::{Error, Result};

/// Reads a JSON file.
pub fn read(path: &Path) -> Result<Value> {
    parse(&path.display().to_string(), &fs::read_to_string(path).map_err(Error::io(path))?)
}

/// Parses the text of `what`.
pub fn parse(what: &str, text: &str) -> Result<Value> {
    serde_json::from_str(text).map_err(|error| Error::invalid(what, "JSON", error.to_string()))
}

/// A number at a JSON pointer.
pub fn number(value: &Value, pointer: &str) -> Result<f64> {
    found(value, pointer, "a number", Value::as_f64)
}

/// A text at a JSON pointer.
pub fn text(value: &Value, pointer: &str) -> Result<String> {
    found(value, pointer, "a text", |value| value.as_str().map(String::from))
}

/// Entries of an array at a JSON pointer.
pub fn entries<'a>(value: &'a Value, pointer: &str) -> Result<&'a [Value]> {
    found(value, pointer, "an array", |value| value.as_array().map(Vec::as_slice))
}

/// Numbers of an array at a JSON pointer.
pub fn numbers(value: &Value, pointer: &str) -> Result<Vec<f64>> {
    found(value, pointer, "an array of numbers", |value| value.as_array()?.iter().map(Value::as_f64).collect())
}

fn found<'a, T>(value: &'a Value, at: &str, expected: &str, read: impl Fn(&'a Value) -> Option<T>) -> Result<T> {
    let found = value.pointer(at);
    let got = || found.map_or("nothing".into(), Value::to_string);
    found.and_then(read).ok_or_else(|| Error::invalid(at, expected, got()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn values_are_found_by_pointer_or_named_in_the_error() {
        let value = json!({ "a": { "b": 1.5, "c": [1, 2] } });
        assert_eq!(number(&value, "/a/b").unwrap(), 1.5);
        assert_eq!(numbers(&value, "/a/c").unwrap(), [1.0, 2.0]);
        assert_eq!(entries(&value, "/a/c").unwrap().len(), 2);
        assert_eq!(number(&value, "/a/d").unwrap_err().to_string(), "/a/d: expected a number, got nothing");
        assert_eq!(numbers(&value, "/a/b").unwrap_err().to_string(), "/a/b: expected an array of numbers, got 1.5");
    }
}
