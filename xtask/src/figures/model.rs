//! Which model a checkpoint holds, computed as `tactile-infer` does.

use std::fs;
use std::path::Path;

use serde_json::{Map, Value};
use sha2::{Digest, Sha256};

use crate::error::{Error, Result};

/// SHA-256 over a checkpoint's texts but the calibrations, and over its tensors by name, as 64 hex digits. Weights are
/// f32: the project ships no others.
pub fn identity(path: &Path) -> Result<String> {
    identity_of(&fs::read(path).map_err(Error::io(path))?)
        .ok_or_else(|| Error::invalid(path.display().to_string(), "a checkpoint of f32 weights", "something else"))
}

fn identity_of(file: &[u8]) -> Option<String> {
    let (length, rest) = file.split_first_chunk::<8>()?;
    let (header, values) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    // Maps are in alphabetical order.
    let mut header: Map<String, Value> = serde_json::from_slice(header).ok()?;
    let mut hash = Sha256::new();
    let texts = header.remove("__metadata__")?;
    let is_of_model = |name: &str| ["config", "preprocessing", "provenance"].contains(&name);
    for (name, text) in texts.as_object()?.iter().filter(|(name, _)| is_of_model(name)) {
        hash.update(format!("{name}\0{}\0", text.as_str()?));
    }
    for (name, tensor) in &header {
        let of = |key: &str| tensor[key].as_array()?.iter().map(Value::as_u64).collect::<Option<Vec<u64>>>();
        let [begin, end] = of("data_offsets")?[..] else { return None };
        let is_f32 = tensor["dtype"] == "F32";
        hash.update(format!("{name}\0{:?}\0", of("shape")?));
        hash.update(values.get(usize::try_from(begin).ok()?..usize::try_from(end).ok()?).filter(|_| is_f32)?);
    }
    Some(hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A checkpoint of one tensor with this calibration and this first weight.
    fn checkpoint(calibration: &str, weight: f32) -> Vec<u8> {
        let header = format!(
            r#"{{"__metadata__":{{"config":"c","calibration":"{calibration}","sha256":"of all"}},"w":{{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}}}"#
        );
        let values = [weight, 2.0].into_iter().flat_map(f32::to_le_bytes);
        (header.len() as u64).to_le_bytes().into_iter().chain(header.bytes()).chain(values).collect()
    }

    #[test]
    fn a_model_is_its_weights_whatever_its_calibration() {
        let identity = |calibration, weight| identity_of(&checkpoint(calibration, weight)).unwrap();
        // By an independent program: sha256 of "config\0c\0" "w\0[2]\0" and the eight bytes of 1.0 and 2.0.
        assert_eq!(identity("a", 1.0), "88dbeb831b83d96f7a89500f328c0b477cf7da730bd7f001005150d7069e494b");
        assert_eq!(identity("a", 1.0), identity("b", 1.0));
        assert_ne!(identity("a", 1.0), identity("a", 1.5));
        assert_eq!(identity_of(&checkpoint("a", 1.0)[..100]), None);
    }
}
