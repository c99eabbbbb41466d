//! Taxim's calibration table.
//!
//! `polycalib.npz` holds `grad_r`, `grad_g`, `grad_b`, each `[bins, bins, 6]`: for a bin of steepness (0 to 90
//! degrees) and one of direction (-180 to 180) the factors of `x^2, y^2, x y, x, y, 1` over the frame in pixels,
//! counts (Si and Yuan, 2022). Its channels are BGR: `grad_b` is red. Its row at no steepness is not zero, an
//! artefact of some 10 to 30 counts, and is subtracted. Beyond 58 degrees the table is extrapolated, and is not
//! looked at. The fit averages thousands of bins, so the table needs no smoothing first.

use std::path::Path;

use super::least_squares::Sums;
use super::light_factors::{factors, light, slope_bases};
use super::{Calibration, SCHEMA};
use crate::error::{Error, Result};
use crate::frame::npy::{self, Array};
use crate::sensor::SensorSpec;
use crate::sensor::light::Quadratic;

/// Steeper bins are extrapolation, degrees.
const STEEPEST_DEG: f64 = 58.0;

/// Places along each side of the frame at which the table is looked up.
const N_PLACES: usize = 7;

/// What reading a table gives.
#[derive(Clone, Debug)]
pub struct FromTable {
    /// The light fitted to the table.
    pub calibration: Calibration,
    /// Root mean square of the table's values for each channel, counts.
    pub table_rms: [f64; 3],
    /// Root mean square of what the fit leaves of them, counts.
    pub error_rms: [f64; 3],
}

/// Reads a table of a sensor with frames of `frame_px`, each pixel `mm_per_px`. The table has no frame at rest:
/// `at_rest` is taken.
pub fn read(path: &Path, frame_px: [usize; 2], mm_per_px: [f64; 2], at_rest: [Quadratic; 3]) -> Result<FromTable> {
    let arrays = npy::read_npz(path)?;
    let table = |name: &str| {
        let what = format!("{}, {name}", path.display());
        let array = arrays.get(name).ok_or_else(|| Error::invalid(&what, "an array", "none of this name"))?;
        let [n_steep, n_directions, 6] = array.shape[..] else {
            return Err(Error::invalid(&what, "shape [bins, bins, 6]", format!("{:?}", array.shape)));
        };
        if n_steep < 16 || n_steep != n_directions || !array.values.iter().all(|value| value.is_finite()) {
            let got = format!("{n_steep}x{n_directions} bins, or a value that is no number");
            return Err(Error::invalid(&what, "16x16 bins or more of finite values", got));
        }
        Ok((array, n_steep))
    };
    let tables = [table("grad_b")?, table("grad_g")?, table("grad_r")?];
    let n_bins = tables[0].1;
    if tables.iter().any(|(_, n)| *n != n_bins) {
        return Err(Error::invalid(path.display().to_string(), "three tables of one size", "different sizes"));
    }
    let tables = tables.map(|(array, _)| above_flat(array, n_bins));
    let n_steep = (STEEPEST_DEG / 90.0 * (n_bins - 1) as f64) as usize;
    let mut sums = Sums::new(30);
    for (u, v) in (0..N_PLACES).flat_map(|v| (0..N_PLACES).map(move |u| (u, v))) {
        let share = [u, v].map(|at| (at as f64 + 0.5) / N_PLACES as f64);
        let [x, y] = [0, 1].map(|axis| share[axis] * frame_px[axis] as f64 - 0.5);
        let terms = [x * x, y * y, x * y, x, y, 1.0];
        for (steep, direction) in (0..n_steep).flat_map(|i| (0..n_bins - 1).map(move |j| (i, j))) {
            // Taxim takes the floor, so that a bin's value belongs to its middle.
            let theta = (steep as f64 + 0.5) / (n_bins - 1) as f64 * std::f64::consts::FRAC_PI_2;
            let phi = ((direction as f64 + 0.5) / (n_bins - 1) as f64 - 0.5) * std::f64::consts::TAU;
            let bases = slope_bases(theta.tan() * phi.cos(), theta.tan() * phi.sin());
            let cell = 6 * (steep * n_bins + direction);
            let values =
                tables.each_ref().map(|table| table[cell..cell + 6].iter().zip(terms).map(|(a, b)| a * b).sum());
            sums.add(factors(bases, share.map(|share| 2.0 * share - 1.0)).as_flattened(), values);
        }
    }
    let weights = sums.solve(1e-9)?;
    let nothing = [0; 3].map(|_| vec![0.0; 30]);
    let rms =
        |weights: &[Vec<f64>; 3]| sums.squared_errors(weights).map(|error| (error / sums.n_observations()).sqrt());
    let calibration = Calibration {
        schema: SCHEMA.to_owned(),
        frame_px,
        field_of_view_mm: [0, 1].map(|axis| mm_per_px[axis] * frame_px[axis] as f64),
        source: format!("Taxim's table of {n_bins} x {n_bins} bins"),
        gel_length_mm: None,
        contact_share: None,
        leave_one_out: None,
        light: light(&weights, at_rest),
    };
    calibration.spec(SensorSpec::default())?;
    Ok(FromTable { calibration, table_rms: rms(&nothing), error_rms: rms(&weights) })
}

/// The table less the mean of its row at no steepness.
fn above_flat(array: &Array, n_bins: usize) -> Vec<f64> {
    let mut flat = [0.0; 6];
    for (i, value) in array.values[..6 * n_bins].iter().enumerate() {
        flat[i % 6] += f64::from(*value) / n_bins as f64;
    }
    array.values.iter().enumerate().map(|(i, value)| f64::from(*value) - flat[i % 6]).collect()
}

#[cfg(test)]
mod tests {
    use std::fs::File;
    use std::io::Write;

    use super::*;
    use crate::sensor::light::{LightRig, value};
    use zip::ZipWriter;
    use zip::write::SimpleFileOptions;

    fn write(path: &Path, arrays: &[(&str, [usize; 3], Vec<f64>)]) {
        let mut archive = ZipWriter::new(File::create(path).unwrap());
        for (name, [a, b, c], values) in arrays {
            archive.start_file(format!("{name}.npy"), SimpleFileOptions::default()).unwrap();
            let header = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': ({a}, {b}, {c})}}\n");
            archive.write_all(b"\x93NUMPY\x01\x00").unwrap();
            archive.write_all(&(header.len() as u16).to_le_bytes()).unwrap();
            archive.write_all(header.as_bytes()).unwrap();
            values.iter().for_each(|value| archive.write_all(&value.to_le_bytes()).unwrap());
        }
        archive.finish().unwrap();
    }

    /// The table of a rig by the trigonometric law, 30 counts too bright everywhere.
    fn table(rig: &LightRig, channel: usize) -> Vec<f64> {
        let n = 25;
        let mut values = Vec::new();
        for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
            let theta = if i == 0 { 0.0 } else { (f64::from(i) + 0.5) / 24.0 * std::f64::consts::FRAC_PI_2 };
            let phi = (f64::from(j) + 0.5) / 24.0 * std::f64::consts::TAU - std::f64::consts::PI;
            let factor = |at: usize| {
                let [x, y] = [rig.along_x, rig.along_y].map(|part| f64::from(part[channel][at]));
                (2.0 * theta).sin() * (x * phi.cos() + y * phi.sin())
            };
            // The frame's -1..=1 in pixels of 64 x 48, the middle of the first at zero: X = a x + b.
            let (a, b) = (2.0 / 64.0, 1.0 / 64.0 - 1.0);
            let (c, d) = (2.0 / 48.0, 1.0 / 48.0 - 1.0);
            let [k, kx, ky, kxx, kxy, kyy] = [0, 1, 2, 3, 4, 5].map(factor);
            values.extend([
                kxx * a * a,
                kyy * c * c,
                kxy * a * c,
                kx * a + 2.0 * kxx * a * b + kxy * a * d,
                ky * c + 2.0 * kyy * c * d + kxy * b * c,
                30.0 + k + kx * b + ky * d + kxx * b * b + kxy * b * d + kyy * d * d,
            ]);
        }
        values
    }

    #[test]
    fn the_table_of_a_known_rig_gives_it_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("polycalib.npz");
        let rig = LightRig::named("mini").unwrap();
        let arrays = [("grad_b", 0), ("grad_g", 1), ("grad_r", 2)];
        write(&path, &arrays.map(|(name, channel)| (name, [25, 25, 6], table(&rig, channel))));
        let read = read(&path, [64, 48], [0.29, 0.3], rig.at_rest).unwrap();
        // The flattest bin is taken for flat, where the law has 2 % of a lamp.
        assert!(read.error_rms.iter().all(|rms| *rms < 1.0), "{:?} of {:?}", read.error_rms, read.table_rms);
        let found = &read.calibration.light;
        for (x, y) in [(0.0, 0.0), (0.7, -0.5), (-0.6, 0.8)] {
            for channel in 0..3 {
                let off = value(&found.along_x[channel], x, y) - value(&rig.along_x[channel], x, y);
                assert!(off.abs() < 0.5, "{off}");
            }
        }
    }

    #[test]
    fn what_is_no_table_is_refused_by_array() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("polycalib.npz");
        let good = table(&LightRig::default(), 0);
        let refusal = |arrays: &[(&str, [usize; 3], Vec<f64>)]| {
            write(&path, arrays);
            read(&path, [64, 48], [0.1; 2], LightRig::default().at_rest).unwrap_err().to_string()
        };
        let error = refusal(&[("grad_b", [25, 25, 6], good.clone())]);
        assert!(error.contains("polycalib.npz, grad_g: expected an array"), "{error}");
        let error = refusal(&[("grad_b", [25, 150, 1], good)]);
        assert!(error.contains("grad_b: expected shape [bins, bins, 6], got [25, 150, 1]"), "{error}");
    }
}
