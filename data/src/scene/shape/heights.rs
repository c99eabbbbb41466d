//! Height maps from files: NumPy arrays and grey pictures.

use std::path::Path;

use image::DynamicImage;

use super::HeightMap;
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::frame::npy;
use crate::frame::picture;

/// What a grey level of a picture is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GreyScale {
    /// Height from one grey level to the next, mm: a 16-bit picture has 65 536 of them.
    MmPerLevel(f64),
    /// Height from black to white, mm.
    FullScaleMm(f64),
}

/// Reads a `[rows, columns]` array of heights in mm, higher towards the sensor, rows from the top; each pixel
/// is `mm_per_px` in x and y.
pub fn from_npy(path: &Path, mm_per_px: [f64; 2]) -> Result<HeightMap> {
    let array = npy::read(path)?;
    let [n_rows, n_columns] = array.shape[..] else {
        let got = format!("shape {:?}", array.shape);
        return Err(Error::invalid(path.display().to_string(), "heights as [rows, columns]", got));
    };
    HeightMap::new([n_columns, n_rows], mm_per_px, &array.values).map_err(|e| e.within(path.display()))
}

/// Reads a grey picture of 8 or 16 bits, brighter where higher; each pixel is `mm_per_px` in x and y.
pub fn from_png(path: &Path, mm_per_px: [f64; 2], scale: GreyScale) -> Result<HeightMap> {
    let (field, mm) = match scale {
        GreyScale::MmPerLevel(mm) => ("mm_per_level", mm),
        GreyScale::FullScaleMm(mm) => ("full_scale_mm", mm),
    };
    if !(mm.is_finite() && mm > 0.0) {
        return Err(Error::invalid(format!("{}: {field}", path.display()), "a positive height", mm.to_string()));
    }
    let picture = picture::decode_any(&bounded_file::read(path, Kind::PICTURE)?, path)?;
    let (levels, white, size): (Vec<f64>, f64, _) = match picture {
        DynamicImage::ImageLuma8(image) => {
            (image.as_raw().iter().map(|v| f64::from(*v)).collect(), f64::from(u8::MAX), image.dimensions())
        }
        DynamicImage::ImageLuma16(image) => {
            (image.as_raw().iter().map(|v| f64::from(*v)).collect(), f64::from(u16::MAX), image.dimensions())
        }
        other => {
            let got = format!("{:?}", other.color());
            return Err(Error::invalid(path.display().to_string(), "a grey picture of 8 or 16 bits", got));
        }
    };
    let mm_per_level = if let GreyScale::FullScaleMm(mm) = scale { mm / white } else { mm };
    let heights: Vec<f32> = levels.iter().map(|level| (level * mm_per_level) as f32).collect();
    HeightMap::new([size.0 as usize, size.1 as usize], mm_per_px, &heights).map_err(|e| e.within(path.display()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{ImageBuffer, Luma};

    /// A `.npy` file of f4 values written by hand.
    fn write_npy(path: &Path, shape: &str, values: &[f32]) {
        let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({shape}), }}");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        values.iter().for_each(|v| bytes.extend(v.to_le_bytes()));
        std::fs::write(path, bytes).unwrap();
    }

    #[test]
    fn arrays_are_rows_by_columns() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.npy");
        write_npy(&path, "2, 3", &[0.0, 1.0, 2.0, 3.0, 4.0, 5.0]);
        let map = from_npy(&path, [0.1, 0.2]).unwrap();
        assert_eq!(map.size_px(), [3, 2]);
        assert_eq!(map.drops_mm(), [5.0, 4.0, 3.0, 2.0, 1.0, 0.0]);
    }

    #[test]
    fn eight_and_sixteen_bits_give_the_same_heights() {
        let folder = tempfile::tempdir().unwrap();
        let [shallow, deep] = ["8.png", "16.png"].map(|name| folder.path().join(name));
        ImageBuffer::<Luma<u8>, _>::from_fn(4, 2, |x, _| Luma([x as u8 * 85])).save(&shallow).unwrap();
        ImageBuffer::<Luma<u16>, _>::from_fn(4, 2, |x, _| Luma([x as u16 * 85 * 257])).save(&deep).unwrap();
        for (path, scale) in [
            (&shallow, GreyScale::FullScaleMm(3.0)),
            (&deep, GreyScale::FullScaleMm(3.0)),
            (&shallow, GreyScale::MmPerLevel(3.0 / 255.0)),
        ] {
            let map = from_png(path, [0.1, 0.1], scale).unwrap();
            for (got, expected) in map.drops_mm()[..4].iter().zip([3.0, 2.0, 1.0, 0.0]) {
                assert!((got - expected).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn what_is_no_map_is_refused_in_one_line_with_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        write_npy(&at("nan.npy"), "2, 2", &[0.0, f32::NAN, 0.0, 0.0]);
        write_npy(&at("flat.npy"), "4", &[0.0; 4]);
        image::RgbImage::new(2, 2).save(at("colour.png")).unwrap();
        image::GrayImage::new(2, 2).save(at("grey.png")).unwrap();
        let mm = [0.1; 2];
        for (result, named) in [
            (from_npy(&at("nan.npy"), mm), "nan.npy: height map, row 0, column 1"),
            (from_npy(&at("flat.npy"), mm), "flat.npy"),
            (from_npy(&at("flat.npy"), [0.1, 0.0]), "flat.npy"),
            (from_npy(&at("none.npy"), mm), "none.npy"),
            (from_png(&at("colour.png"), mm, GreyScale::FullScaleMm(1.0)), "colour.png"),
            (from_png(&at("grey.png"), mm, GreyScale::MmPerLevel(0.0)), "grey.png: mm_per_level"),
            (from_png(&at("grey.png"), [-0.1, 0.1], GreyScale::FullScaleMm(1.0)), "grey.png"),
        ] {
            let error = result.unwrap_err().to_string();
            assert!(error.contains(named) && !error.contains('\n'), "{error}");
        }
    }
}
