//! NumPy's arrays: `.npy` files and `.npz` archives, read as f32.
//!
//! An `.npy` file is `\x93NUMPY`, two bytes of version, the header's length (2 bytes little endian in version
//! 1, 4 later), the header (a Python dict with `descr`, `fortran_order` and `shape`), then the values.

use std::collections::BTreeMap;
use std::fs;
use std::io::Read;
use std::path::Path;

use zip::ZipArchive;

use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};

/// The most values of one array: a gigabyte as f32.
const MAX_VALUES: usize = 1 << 28;

/// A header and the largest array of f8.
const ARRAY: Kind = Kind { name: "a NumPy array", most_bytes: 8 * MAX_VALUES as u64 + 65_536 };

/// An array of any shape in C order, the last axis running fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array {
    /// Length of each axis; none for a single number.
    pub shape: Vec<usize>,
    /// The values; NaN stays NaN.
    pub values: Vec<f32>,
}

/// Reads an `.npy` file of u1, i2, i4, i8, f4 or f8 values, little endian, C order.
pub fn read(path: impl AsRef<Path>) -> Result<Array> {
    let bytes = bounded_file::read(path.as_ref(), ARRAY)?;
    parse(&bytes, &path.as_ref().display().to_string())
}

/// Reads all arrays of an `.npz` archive, by name.
pub fn read_npz(path: impl AsRef<Path>) -> Result<BTreeMap<String, Array>> {
    let path = path.as_ref();
    let invalid = |what: String, error: &dyn std::fmt::Display| {
        Error::invalid(what, "a readable .npz archive", error.to_string())
    };
    let file = bounded_file::open_kind(path, ARRAY)?;
    let mut archive = ZipArchive::new(file).map_err(|e| invalid(path.display().to_string(), &e))?;
    let (mut arrays, mut n_bytes_left) = (BTreeMap::new(), ARRAY.most_bytes);
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(|e| invalid(format!("{}, entry {index}", path.display()), &e))?;
        let name = entry.name().map_err(|e| invalid(format!("{}, entry {index}", path.display()), &e))?;
        let name = name.trim_end_matches(".npy").to_owned();
        let what = format!("{}, {name}", path.display());
        let mut bytes = Vec::new();
        // All of them together are no larger than one may be: a small file may hold any number of large ones, packed.
        entry.take(n_bytes_left).read_to_end(&mut bytes).map_err(|e| invalid(what.clone(), &e))?;
        n_bytes_left -= bytes.len() as u64;
        arrays.insert(name, parse(&bytes, &what)?);
    }
    Ok(arrays)
}

/// Writes values in C order as an `.npy` file of f4, version 1.0. Refuses a shape of another number of values.
pub fn write(path: impl AsRef<Path>, shape: &[usize], values: &[f32]) -> Result<()> {
    let path = path.as_ref();
    if shape.iter().product::<usize>() != values.len() {
        let got = format!("{} values", values.len());
        return Err(Error::invalid(path.display().to_string(), format!("values of shape {shape:?}"), got));
    }
    let sides: String = shape.iter().map(|side| format!("{side}, ")).collect();
    let mut header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({}), }}", sides.trim_end());
    // Magic, version, length and header fill whole blocks of 64 bytes, the last byte a line's end.
    header = format!("{header:<width$}\n", width = (header.len() + 11).next_multiple_of(64) - 11);
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header.len() as u16).to_le_bytes());
    bytes.extend(header.as_bytes());
    bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
    fs::write(path, bytes).map_err(Error::io(path))
}

/// Reads the bytes of an `.npy` file; `what` names it in errors.
pub fn parse(bytes: &[u8], what: &str) -> Result<Array> {
    let invalid = |expected: &str, got: String| Error::invalid(what, expected, got);
    let Some(rest) = bytes.strip_prefix(b"\x93NUMPY") else {
        return Err(invalid("a NumPy array (.npy)", format!("{} bytes of something else", bytes.len())));
    };
    let cut = || invalid("a whole .npy header", format!("{} bytes", bytes.len()));
    let (length, rest) = match rest {
        [1, _, a, b, rest @ ..] => (usize::from(u16::from_le_bytes([*a, *b])), rest),
        [2 | 3, _, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]) as usize, rest),
        [version, ..] => return Err(invalid(".npy of version 1 to 3", format!("version {version}"))),
        [] => return Err(cut()),
    };
    let (header, data) = rest.split_at_checked(length).ok_or_else(cut)?;
    let header = String::from_utf8_lossy(header);
    let kind = field(&header, "descr").map(|text| text.trim_matches(['\'', '"', ' '])).unwrap_or_default();
    if field(&header, "fortran_order") != Some("False") {
        return Err(invalid("C order (numpy.ascontiguousarray)", "Fortran order".into()));
    }
    let shape = shape(&header).ok_or_else(|| invalid("a shape in the header", header.trim().to_owned()))?;
    let n_values = shape.iter().try_fold(1_usize, |n, side| n.checked_mul(*side)).filter(|n| *n <= MAX_VALUES);
    let n_values = n_values.ok_or_else(|| invalid("at most 2^28 values", format!("shape {shape:?}")))?;
    let (n_bytes, values): (usize, Vec<f32>) = match kind {
        "|u1" | "<u1" => (1, data.iter().map(|byte| f32::from(*byte)).collect()),
        "<i2" => (2, each(data, |b| f32::from(i16::from_le_bytes(b)))),
        "<i4" => (4, each(data, |b| i32::from_le_bytes(b) as f32)),
        "<i8" => (8, each(data, |b| i64::from_le_bytes(b) as f32)),
        "<f4" => (4, each(data, f32::from_le_bytes)),
        "<f8" => (8, each(data, |b| f64::from_le_bytes(b) as f32)),
        _ => return Err(invalid("values of |u1, <i2, <i4, <i8, <f4 or <f8", kind.to_owned())),
    };
    if data.len() != n_bytes * n_values {
        let expected = format!("{n_values} values of {n_bytes} bytes for shape {shape:?}");
        return Err(invalid(&expected, format!("{} bytes", data.len())));
    }
    Ok(Array { shape, values })
}

fn each<const N: usize>(data: &[u8], value: impl Fn([u8; N]) -> f32) -> Vec<f32> {
    data.as_chunks::<N>().0.iter().map(|bytes| value(*bytes)).collect()
}

/// What follows `'name':` in the header, up to a comma or the end of the dict.
fn field<'a>(header: &'a str, name: &str) -> Option<&'a str> {
    let after = header.split_once(&format!("'{name}'"))?.1.trim_start().strip_prefix(':')?;
    after.split([',', '}']).next().map(str::trim)
}

/// The header's shape, such as `(3, 4)`, `(5,)` or `()`.
fn shape(header: &str) -> Option<Vec<usize>> {
    let after = header.split_once("'shape'")?.1;
    let sides = after.split_once('(')?.1.split_once(')')?.0;
    sides.split(',').map(str::trim).filter(|side| !side.is_empty()).map(|side| side.parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::File;
    use std::io::Write;
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    /// The bytes as NumPy's documentation lays them out.
    fn npy(kind: &str, order: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header = format!("{{'descr': '{kind}', 'fortran_order': {order}, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn each_kind_of_value_is_read() {
        let bytes = |values: &[[u8; 8]]| values.concat();
        let cases: [(&str, Vec<u8>); 6] = [
            ("|u1", vec![3, 200]),
            ("<i2", [3_i16, 200].map(i16::to_le_bytes).concat()),
            ("<i4", [3_i32, 200].map(i32::to_le_bytes).concat()),
            ("<i8", bytes(&[3_i64, 200].map(i64::to_le_bytes))),
            ("<f4", [3_f32, 200.0].map(f32::to_le_bytes).concat()),
            ("<f8", bytes(&[3_f64, 200.0].map(f64::to_le_bytes))),
        ];
        for (kind, data) in cases {
            let array = parse(&npy(kind, "False", "(2,)", &data), "a").unwrap();
            assert_eq!(array, Array { shape: vec![2], values: vec![3.0, 200.0] }, "{kind}");
        }
        let nan = parse(&npy("<f4", "False", "(1, 1)", &f32::NAN.to_le_bytes()), "a").unwrap();
        assert!(nan.values[0].is_nan() && nan.shape == [1, 1]);
        assert_eq!(parse(&npy("|u1", "False", "()", &[7]), "a").unwrap(), Array { shape: vec![], values: vec![7.0] });
    }

    #[test]
    fn an_archive_is_read_by_name_stored_or_deflated() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.npz");
        let mut archive = ZipWriter::new(File::create(&path).unwrap());
        for (name, method) in [("a", zip::CompressionMethod::Stored), ("b", zip::CompressionMethod::Deflated)] {
            let options = SimpleFileOptions::default().compression_method(method);
            archive.start_file(format!("{name}.npy"), options).unwrap();
            archive.write_all(&npy("|u1", "False", "(1, 3)", &[1, 2, name.len() as u8])).unwrap();
        }
        archive.finish().unwrap();
        let arrays = read_npz(&path).unwrap();
        assert_eq!(arrays.keys().collect::<Vec<_>>(), ["a", "b"]);
        assert_eq!(arrays["b"], Array { shape: vec![1, 3], values: vec![1.0, 2.0, 1.0] });
        fs::write(&path, b"PK").unwrap();
        assert!(read_npz(&path).unwrap_err().to_string().contains("table.npz: expected a readable .npz archive"));
    }

    #[test]
    fn what_is_written_is_read_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("heights.npy");
        for shape in [vec![2, 3], vec![6], vec![1, 6, 1]] {
            let array = Array { shape, values: vec![0.5, -1.0, 2.0, 3.0, 1e-9, 7.0] };
            write(&path, &array.shape, &array.values).unwrap();
            assert_eq!(read(&path).unwrap(), array);
            // NumPy's format: the data begin at a multiple of 64 bytes.
            assert_eq!(fs::read(&path).unwrap().len() % 64, 24);
        }
        assert!(write(&path, &[2, 2], &[0.0; 3]).unwrap_err().to_string().contains("3 values"));
    }

    #[test]
    fn what_is_no_array_is_refused_with_the_reason() {
        let cases = [
            (b"GIF89a".to_vec(), "a NumPy array"),
            (npy("<f4", "True", "(1,)", &[0; 4]), "C order"),
            (npy(">f4", "False", "(1,)", &[0; 4]), ">f4"),
            (npy("<f4", "False", "(3,)", &[0; 8]), "3 values of 4 bytes"),
            (npy("<f4", "False", "(99999999, 99999999)", &[]), "at most 2^28"),
            (npy("<f4", "False", "oops", &[]), "a shape"),
            (npy("<f4", "False", "(1,)", &[0; 4])[..20].to_vec(), "a whole .npy header"),
        ];
        for (bytes, reason) in cases {
            let error = parse(&bytes, "h.npy").unwrap_err().to_string();
            assert!(error.starts_with("h.npy: ") && error.contains(reason), "{error}");
        }
    }
}
