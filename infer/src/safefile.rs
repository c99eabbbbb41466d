//! Files of named tensors: safetensors with text beside them, checksummed, written whole or not at all.

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};

use crate::encoder::NamedTensor;
use crate::error::{Error, Result};

const CHECKSUM: &str = "sha256";
const SCHEMA: &str = "schema";

/// What one file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SafeFile {
    /// f32 tensors.
    pub tensors: Vec<NamedTensor>,
    /// Blocks of bytes that another library wrote (an optimiser's record).
    pub blobs: Vec<(String, Vec<u8>)>,
    /// Text entries, JSON mostly.
    pub text: Vec<(String, String)>,
}

impl SafeFile {
    /// The text entry of this name.
    pub fn text(&self, path: &Path, name: &str) -> Result<&str> {
        let found = self.text.iter().find(|(key, _)| key == name);
        found
            .map(|(_, text)| text.as_str())
            .ok_or_else(|| Error::invalid(path.display().to_string(), format!("an entry '{name}'"), "none"))
    }

    /// SHA-256 over names, shapes and values, as 64 hex digits: the identity of a model or bank.
    pub fn sha256(&self) -> String {
        let mut tensors: Vec<&NamedTensor> = self.tensors.iter().collect();
        tensors.sort_by(|a, b| a.name.cmp(&b.name));
        let mut text: Vec<_> = self.text.iter().collect();
        text.sort();
        let mut hash = Sha256::new();
        for (key, value) in text {
            hash.update(format!("{key}\0{value}\0"));
        }
        for tensor in tensors {
            hash.update(format!("{}\0{:?}\0", tensor.name, tensor.shape));
            tensor.values.iter().for_each(|value| hash.update(value.to_le_bytes()));
        }
        for (name, bytes) in &self.blobs {
            hash.update(format!("{name}\0{}\0", bytes.len()));
            hash.update(bytes);
        }
        hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Writes the file beside its place and renames it there, so that a crash or a full disk leaves
    /// the old file as it was.
    pub fn save(&self, path: &Path, schema: &str) -> Result<()> {
        let mut names: Vec<&str> = self.tensors.iter().map(|tensor| tensor.name.as_str()).collect();
        names.extend(self.blobs.iter().map(|(name, _)| name.as_str()));
        names.sort_unstable();
        // The library panics on it.
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let got = format!("'{}' twice", twice[0]);
            return Err(Error::invalid(path.display().to_string(), "tensors of different names", got));
        }
        let bytes: Vec<Vec<u8>> =
            self.tensors.iter().map(|t| t.values.iter().flat_map(|v| v.to_le_bytes()).collect()).collect();
        let tensors = self.tensors.iter().zip(&bytes).map(|(tensor, bytes)| {
            let view = TensorView::new(Dtype::F32, tensor.shape.clone(), bytes);
            view.map(|view| (tensor.name.clone(), view))
        });
        let blobs = self
            .blobs
            .iter()
            .map(|(name, bytes)| TensorView::new(Dtype::U8, vec![bytes.len()], bytes).map(|view| (name.clone(), view)));
        let views = tensors.chain(blobs);
        let malformed = |e| Error::invalid(path.display().to_string(), "tensors that fit their shapes", format!("{e}"));
        let views = views.collect::<std::result::Result<Vec<_>, _>>().map_err(malformed)?;
        let mut metadata: HashMap<String, String> = self.text.iter().cloned().collect();
        metadata.insert(SCHEMA.into(), schema.into());
        metadata.insert(CHECKSUM.into(), self.sha256());
        let content = safetensors::serialize(views, Some(metadata)).map_err(malformed)?;
        write_whole(path, &content)
    }

    /// Reads a file and checks its schema and checksum.
    pub fn load(path: &Path, schema: &str) -> Result<Self> {
        let name = path.display().to_string();
        let content = std::fs::read(path).map_err(Error::io(path))?;
        let broken = |e| Error::invalid(&name, "a whole safetensors file", format!("{e}"));
        let (_, header) = SafeTensors::read_metadata(&content).map_err(broken)?;
        let mut metadata = header.metadata().clone().unwrap_or_default();
        let found = metadata.remove(SCHEMA).unwrap_or_else(|| "no schema".into());
        if found != schema {
            return Err(Error::invalid(name, schema, found));
        }
        let expected = metadata.remove(CHECKSUM).unwrap_or_default();
        let parsed = SafeTensors::deserialize(&content).map_err(broken)?;
        let (mut tensors, mut blobs) = (Vec::new(), Vec::new());
        for (tensor_name, view) in parsed.tensors() {
            match view.dtype() {
                Dtype::F32 => {
                    let values = view.data().as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
                    tensors.push(NamedTensor { name: tensor_name, shape: view.shape().to_vec(), values });
                }
                Dtype::U8 => blobs.push((tensor_name, view.data().to_vec())),
                other => {
                    return Err(Error::invalid(format!("{name}: {tensor_name}"), "f32 or u8", format!("{other:?}")));
                }
            }
        }
        // The library hands them out in the order of a hash map.
        tensors.sort_by(|a, b| a.name.cmp(&b.name));
        blobs.sort();
        let mut text: Vec<(String, String)> = metadata.into_iter().collect();
        text.sort();
        let file = Self { tensors, blobs, text };
        let got = file.sha256();
        if got != expected {
            return Err(Error::invalid(name, format!("checksum {expected}"), got));
        }
        Ok(file)
    }
}

/// Writes beside and renames: the file appears whole or not at all.
pub fn write_whole(path: &Path, content: &[u8]) -> Result<()> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = Path::new(&partial);
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(Error::io(folder))?;
    }
    let written = std::fs::File::create(partial).and_then(|mut file| {
        file.write_all(content)?;
        file.sync_all()
    });
    if let Err(error) = written {
        // The half-written file is of no use; the error that matters is the first one.
        drop(std::fs::remove_file(partial));
        return Err(Error::io(path)(error));
    }
    std::fs::rename(partial, path).map_err(Error::io(path))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file() -> SafeFile {
        let tensor = |name: &str, values: &[f32]| NamedTensor {
            name: name.into(),
            shape: vec![values.len()],
            values: values.to_vec(),
        };
        SafeFile {
            tensors: vec![tensor("b", &[1.5, -2.0]), tensor("a", &[0.25])],
            blobs: vec![("record".into(), vec![1, 2, 3])],
            text: vec![("config".into(), "{}".into())],
        }
    }

    #[test]
    fn a_saved_file_comes_back_with_its_checksum() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep/x.safetensors");
        file().save(&path, "test/1").unwrap();
        let back = SafeFile::load(&path, "test/1").unwrap();
        assert_eq!(back.sha256(), file().sha256());
        assert_eq!(back.blobs, file().blobs);
        assert_eq!(back.text(&path, "config").unwrap(), "{}");
        assert!(SafeFile::load(&path, "test/2").unwrap_err().to_string().contains("test/2"));
    }

    #[test]
    fn a_changed_or_cut_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        file().save(&path, "test/1").unwrap();
        let good = std::fs::read(&path).unwrap();
        let mut changed = good.clone();
        *changed.last_mut().unwrap() ^= 1;
        std::fs::write(&path, changed).unwrap();
        assert!(SafeFile::load(&path, "test/1").unwrap_err().to_string().contains("checksum"));
        std::fs::write(&path, &good[..good.len() - 3]).unwrap();
        assert!(SafeFile::load(&path, "test/1").unwrap_err().to_string().contains("whole safetensors"));
    }

    #[test]
    fn a_failed_write_leaves_the_old_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        file().save(&path, "test/1").unwrap();
        // The partial file cannot be created where a folder of its name stands.
        std::fs::create_dir(folder.path().join("x.safetensors.partial")).unwrap();
        assert!(file().save(&path, "test/1").is_err());
        assert!(SafeFile::load(&path, "test/1").is_ok());
    }
}
