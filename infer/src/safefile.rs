//! Files of named tensors: safetensors with text entries, checksummed, written whole or not at all.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use sha2::{Digest, Sha256};
use tactile_data::file::bounded_file::{self, Kind};
use tactile_data::file::whole_file;

pub(crate) mod pieces;

use crate::embedding::precision::Precision;
use crate::error::{Error, Result};

const CHECKSUM: &str = "sha256";
const SCHEMA: &str = "schema";

/// A training state holds a network four times; 4 GB hold 250 million weights, a hundred times as many as the `large`
/// preset has.
const ALL_AT_ONCE: Kind = Kind { name: "a checkpoint or a training state", most_bytes: 4 << 30 };

/// One named tensor of a module: its path, its shape and its values.
#[derive(Clone, Debug, PartialEq)]
pub struct NamedTensor {
    /// Path of fields, joined by dots: `encoder.stem.conv.weight`.
    pub name: String,
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Values, last axis fastest.
    pub values: Vec<f32>,
}

/// What one file holds.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SafeFile {
    /// Tensors; in memory f32 in any case.
    pub tensors: Vec<NamedTensor>,
    /// Blocks of bytes that another library wrote (an optimiser's record).
    pub blobs: Vec<(String, Vec<u8>)>,
    /// Text entries, JSON mostly.
    pub text: Vec<(String, String)>,
}

impl SafeFile {
    /// The text entry of this name.
    ///
    /// # Errors
    /// A file without it.
    pub fn text(&self, name: &str) -> Result<&str> {
        text_of(&self.text, name)
    }

    /// SHA-256 over names, shapes and values, as 64 hex digits: the identity of a model or bank.
    pub fn sha256(&self) -> String {
        let mut tensors: Vec<&NamedTensor> = self.tensors.iter().collect();
        tensors.sort_by(|a, b| a.name.cmp(&b.name));
        let mut content = ContentHash::of_text(&self.text);
        for tensor in tensors {
            content.begin(&tensor.name, &tensor.shape);
            content.values(&tensor.values);
        }
        for (name, bytes) in &self.blobs {
            content.0.update(format!("{name}\0{}\0", bytes.len()));
            content.0.update(bytes);
        }
        content.finish()
    }

    /// Writes a temporary file and renames it, so that a crash or a full disk leaves
    /// the old file as it was.
    pub fn save(&self, path: &Path, schema: &str) -> Result<()> {
        self.save_as(path, schema, Precision::F32)
    }

    /// [`Self::save`] with the tensors of two axes or more in another format; tensors of one axis stay f32.
    ///
    /// # Errors
    /// A value that the format does not hold exactly ([`Precision::round_all`] comes first), besides what writing
    /// brings.
    pub fn save_as(&self, path: &Path, schema: &str, precision: Precision) -> Result<()> {
        let mut names: Vec<&str> = self.tensors.iter().map(|tensor| tensor.name.as_str()).collect();
        names.extend(self.blobs.iter().map(|(name, _)| name.as_str()));
        names.sort_unstable();
        // The library panics on it.
        if let Some(twice) = names.windows(2).find(|pair| pair[0] == pair[1]) {
            let got = format!("'{}' twice", twice[0]);
            return Err(Error::invalid(path.display().to_string(), "tensors of different names", got));
        }
        let format = |tensor: &NamedTensor| if tensor.shape.len() > 1 { precision } else { Precision::F32 };
        let bytes: Vec<Vec<u8>> =
            self.tensors.iter().map(|t| format(t).to_bytes(&t.name, &t.values)).collect::<Result<_>>()?;
        let tensors = self.tensors.iter().zip(&bytes).map(|(tensor, bytes)| {
            let view = TensorView::new(format(tensor).dtype(), tensor.shape.clone(), bytes);
            view.map(|view| (tensor.name.clone(), view))
        });
        let blobs = self
            .blobs
            .iter()
            .map(|(name, bytes)| TensorView::new(Dtype::U8, vec![bytes.len()], bytes).map(|view| (name.clone(), view)));
        let views = tensors.chain(blobs);
        let malformed = |e| Error::invalid(path.display().to_string(), "tensors that fit their shapes", format!("{e}"));
        let views = views.collect::<std::result::Result<Vec<_>, _>>().map_err(malformed)?;
        let mut metadata: BTreeMap<String, String> = self.text.iter().cloned().collect();
        metadata.insert(SCHEMA.into(), schema.into());
        metadata.insert(CHECKSUM.into(), self.sha256());
        let content = safetensors::serialize(views, Some(metadata.into_iter().collect())).map_err(malformed)?;
        write_whole(path, &with_ordered_header(&content).unwrap_or(content))
    }

    /// Reads a file and checks its schema and checksum.
    pub fn load(path: &Path, schema: &str) -> Result<Self> {
        Self::load_as(path, schema).map(|(file, _)| file)
    }

    /// [`Self::load`] with the format in which the tensors of two axes or more stand in the file.
    ///
    /// # Errors
    /// Such tensors of several formats, besides what reading brings.
    pub fn load_as(path: &Path, schema: &str) -> Result<(Self, Precision)> {
        let name = path.display().to_string();
        // What is no such file is refused by its header, before all of it is read.
        pieces::Opened::new(path, schema)?;
        let content = bounded_file::read(path, ALL_AT_ONCE)?;
        let broken = |e| Error::invalid(&name, "a whole safetensors file", format!("{e}"));
        let (_, header) = SafeTensors::read_metadata(&content).map_err(broken)?;
        let mut metadata: BTreeMap<String, String> =
            header.metadata().clone().unwrap_or_default().into_iter().collect();
        let found = metadata.remove(SCHEMA).unwrap_or_else(|| "no schema".into());
        if found != schema {
            return Err(Error::invalid(name, schema, found));
        }
        let expected = metadata.remove(CHECKSUM).unwrap_or_default();
        let parsed = SafeTensors::deserialize(&content).map_err(broken)?;
        let (mut tensors, mut blobs, mut format) = (Vec::new(), Vec::new(), None);
        for (tensor_name, view) in parsed.tensors() {
            let what = || format!("{name}: {tensor_name}");
            if view.dtype() == Dtype::U8 {
                blobs.push((tensor_name, view.data().to_vec()));
                continue;
            }
            let Some(precision) = Precision::from_dtype(view.dtype()) else {
                let expected = "f32, f16, bf16, i8 or u8";
                return Err(Error::invalid(what(), expected, format!("{:?}", view.dtype())));
            };
            if view.shape().len() > 1 && *format.get_or_insert(precision) != precision {
                return Err(Error::invalid(what(), "one format for all matrices", precision.to_string()));
            }
            let values = precision.from_bytes(view.data());
            tensors.push(NamedTensor { name: tensor_name, shape: view.shape().to_vec(), values });
        }
        // The library hands them out in the order of a hash map.
        tensors.sort_by(|a, b| a.name.cmp(&b.name));
        blobs.sort();
        let file = Self { tensors, blobs, text: metadata.into_iter().collect() };
        let got = file.sha256();
        if got != expected {
            return Err(Error::invalid(name, format!("checksum {expected}"), got));
        }
        Ok((file, format.unwrap_or_default()))
    }
}

/// The text entry of a name among the entries of a file.
///
/// # Errors
/// None of that name.
pub(crate) fn text_of<'t>(text: &'t [(String, String)], name: &str) -> Result<&'t str> {
    let found = text.iter().find(|(key, _)| key == name);
    found.map(|(_, text)| text.as_str()).ok_or_else(|| Error::invalid(name, "an entry of the file", "none"))
}

/// SHA-256 of what a file holds: its text, then its tensors in the order of their names, each begun and followed by its
/// values.
pub(crate) struct ContentHash(Sha256);

impl ContentHash {
    /// The checksum of text entries, in any order.
    pub(crate) fn of_text(text: &[(String, String)]) -> Self {
        let mut text: Vec<_> = text.iter().collect();
        text.sort();
        let mut hash = Sha256::new();
        for (key, value) in text {
            hash.update(format!("{key}\0{value}\0"));
        }
        Self(hash)
    }

    /// The next tensor.
    pub(crate) fn begin(&mut self, name: &str, shape: &[usize]) {
        self.0.update(format!("{name}\0{shape:?}\0"));
    }

    /// The next values of the tensor.
    pub(crate) fn values(&mut self, values: &[f32]) {
        let mut bytes = [0; 4_096];
        for values in values.chunks(bytes.len() / 4) {
            let places = bytes.as_chunks_mut::<4>().0.iter_mut();
            places.zip(values).for_each(|(place, value)| *place = value.to_le_bytes());
            self.0.update(&bytes[..4 * values.len()]);
        }
    }

    /// 64 hex digits.
    pub(crate) fn finish(self) -> String {
        hex(&self.0.finalize())
    }
}

/// Bytes as hex digits.
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The same file with its header's entries in alphabetical order: the library writes its metadata in the order of a
/// hash map, another at each run. `None` for what is no such file.
fn with_ordered_header(content: &[u8]) -> Option<Vec<u8>> {
    let (length, rest) = content.split_first_chunk::<8>()?;
    let (header, data) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(*length)).ok()?)?;
    let entries: BTreeMap<String, serde_json::Value> = serde_json::from_slice(header).ok()?;
    let mut header = serde_json::to_vec(&entries).ok()?;
    header.resize(header.len().next_multiple_of(8), b' ');
    Some([&(header.len() as u64).to_le_bytes()[..], &header, data].concat())
}

/// Writes a temporary file and renames it: the file appears whole or not at all.
///
/// # Errors
/// As [`whole_file::write`].
pub fn write_whole(path: &Path, content: &[u8]) -> Result<()> {
    Ok(whole_file::write(path, content)?)
}

/// [`write_whole`] of what `write` writes.
pub(crate) fn write_in_pieces(path: &Path, write: &dyn Fn(&mut BufWriter<File>) -> std::io::Result<()>) -> Result<()> {
    Ok(whole_file::write_in_pieces(path, write)?)
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
        assert_eq!(back.text("config").unwrap(), "{}");
        assert!(SafeFile::load(&path, "test/2").unwrap_err().to_string().contains("test/2"));
    }

    #[test]
    fn what_cannot_be_read_is_no_broken_file() {
        let folder = tempfile::tempdir().unwrap();
        let open = |path: &Path| pieces::Opened::new(path, "test/1").err().unwrap();
        let is_of_reading = |error: &Error| matches!(error, Error::Data(tactile_data::Error::Io { .. }));
        assert!(is_of_reading(&open(folder.path())) && is_of_reading(&open(&folder.path().join("nowhere"))));
        let short = folder.path().join("short");
        std::fs::write(&short, [1, 2, 3]).unwrap();
        let broken = open(&short);
        assert!(!is_of_reading(&broken) && broken.to_string().contains("less than 8 bytes"), "{broken}");
    }

    #[test]
    fn a_file_of_narrow_matrices_holds_the_same_values() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.safetensors");
        let values: Vec<f32> = (0..60).map(|i| f32::from(i as i8) - 30.0).collect();
        let matrix = NamedTensor { name: "m".into(), shape: vec![20, 3], values };
        let mut whole = file();
        whole.tensors.push(matrix);
        let mut sizes = Vec::new();
        for precision in [Precision::F32, Precision::F16, Precision::Bf16, Precision::I8] {
            whole.save_as(&path, "test/1", precision).unwrap();
            let (back, found) = SafeFile::load_as(&path, "test/1").unwrap();
            // Identity is that of the values, so that it does not depend on the format they stand in.
            assert_eq!((found, back.sha256()), (precision, whole.sha256()));
            let content = std::fs::read(&path).unwrap();
            let tensors = SafeTensors::deserialize(&content).unwrap();
            assert_eq!(tensors.tensor("m").unwrap().dtype(), precision.dtype());
            assert_eq!(tensors.tensor("b").unwrap().dtype(), Dtype::F32);
            sizes.push(tensors.tensor("m").unwrap().data().len());
        }
        assert_eq!(sizes, [240, 120, 120, 60]);
        whole.tensors[2].values[4] = 1.0 / 3.0;
        let error = whole.save_as(&path, "test/1", Precision::F16).unwrap_err().to_string();
        assert!(error.starts_with("m: expected values that f16 holds"), "{error}");
    }

    #[test]
    fn equal_content_gives_equal_bytes() {
        let folder = tempfile::tempdir().unwrap();
        let mut whole = file();
        whole.text.extend((0..20).map(|i| (format!("key {i}"), "same".into())));
        let bytes: Vec<_> = ["a", "b", "c"]
            .map(|name| {
                whole.save(&folder.path().join(name), "test/1").unwrap();
                std::fs::read(folder.path().join(name)).unwrap()
            })
            .into();
        assert!(bytes[0] == bytes[1] && bytes[1] == bytes[2]);
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
        // The partial file cannot be created where a folder has its name.
        std::fs::create_dir(folder.path().join("x.safetensors.partial")).unwrap();
        assert!(file().save(&path, "test/1").is_err());
        assert!(SafeFile::load(&path, "test/1").is_ok());
    }
}
