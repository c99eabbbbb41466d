//! A sensor's own light, from presses of a ball or from Taxim's table, and the file that keeps it.

pub mod ball;
pub mod circle;
pub mod circle_search;
pub mod fit;
mod least_squares;
mod light_factors;
pub mod presses;
#[cfg(test)]
mod synthetic;
pub mod taxim;

use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::compare::Figures;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::sensor::SensorSpec;
use crate::sensor::light::{LightRig, Quadratic};
use least_squares::Sums;
use light_factors::{factors, place};

/// What a calibration file says it is.
pub const SCHEMA: &str = "tactile-filter/calibration/1";

/// Two sensors show the same when their fields of view differ by less than this share.
const SAME_VIEW: f64 = 0.05;

/// The light of one sensor, as a TOML file keeps it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Calibration {
    /// [`SCHEMA`].
    pub schema: String,
    /// Width and height of the frames it was made from, pixels.
    pub frame_px: [usize; 2],
    /// Width and height of what they show, mm.
    pub field_of_view_mm: [f64; 2],
    /// What it was made from.
    pub source: String,
    /// The gel's decay length under which presses left out were predicted best, mm.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gel_length_mm: Option<f64>,
    /// The contact's radius as a share of the circles' given.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub contact_share: Option<f64>,
    /// Means over presses, each left out in turn.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub leave_one_out: Option<Figures>,
    /// The light.
    pub light: LightRig,
}

impl Calibration {
    /// Reads a calibration file; refuses another version and numbers that no sensor has.
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        let path = path.as_ref();
        let text = fs::read_to_string(path).map_err(Error::io(path))?;
        let invalid = |expected: &str, got: String| Error::invalid(path.display().to_string(), expected, got);
        let table: toml::Table =
            text.parse().map_err(|e: toml::de::Error| invalid("a TOML file", e.message().to_owned()))?;
        if table.get("schema").and_then(toml::Value::as_str) != Some(SCHEMA) {
            let got = table.get("schema").map_or("none".to_owned(), ToString::to_string);
            return Err(invalid(&format!("schema \"{SCHEMA}\""), got));
        }
        let calibration: Self =
            table.try_into().map_err(|e: toml::de::Error| invalid("a calibration", e.message().to_owned()))?;
        calibration.spec(SensorSpec::default()).map_err(|e| invalid("a calibration", e.to_string()))?;
        Ok(calibration)
    }

    /// Writes the file, whole or not at all.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        let path = path.as_ref();
        let text = toml::to_string(self)
            .map_err(|e| Error::invalid(path.display().to_string(), "numbers that TOML can hold", e.to_string()))?;
        let beside = path.with_extension("partial");
        fs::write(&beside, text).map_err(Error::io(&beside))?;
        fs::rename(&beside, path).map_err(Error::io(path))
    }

    /// `spec` with the calibrated sensor's frame, field of view, gel and light.
    pub fn spec(&self, spec: SensorSpec) -> Result<SensorSpec> {
        let spec = SensorSpec {
            frame_px: self.frame_px,
            field_of_view_mm: self.field_of_view_mm,
            gel_length_mm: self.gel_length_mm.unwrap_or(spec.gel_length_mm),
            light: self.light.clone(),
            ..spec
        };
        spec.validate()?;
        Ok(spec)
    }

    /// `spec` with the calibrated gel and light, its frame and field of view kept; refuses a sensor that shows
    /// another area.
    pub fn light_for(&self, spec: SensorSpec) -> Result<SensorSpec> {
        let [x, y] = [0, 1].map(|axis| spec.field_of_view_mm[axis] / self.field_of_view_mm[axis] - 1.0);
        if x.abs().max(y.abs()) > SAME_VIEW {
            let show = |[x, y]: [f64; 2]| format!("{x:.1} x {y:.1} mm");
            let expected = format!("{}, as the calibrated sensor", show(self.field_of_view_mm));
            return Err(Error::invalid("sensor.field_of_view_mm", expected, show(spec.field_of_view_mm)));
        }
        let (frame_px, field_of_view_mm) = (spec.frame_px, spec.field_of_view_mm);
        Ok(SensorSpec { frame_px, field_of_view_mm, ..self.spec(spec)? })
    }
}

/// A no-contact frame as a quadratic for each channel, by least squares.
pub fn at_rest(no_contact: &Frame) -> Result<[Quadratic; 3]> {
    let size_px = [no_contact.width_px(), no_contact.height_px()];
    let mut sums = Sums::new(6);
    for (pixel, rgb) in no_contact.rgb().as_chunks::<3>().0.iter().enumerate() {
        let constant = [1.0, 0.0, 0.0, 0.0, 0.0];
        sums.add(&factors(constant, place(pixel, size_px))[..6], rgb.map(f64::from));
    }
    Ok(sums.solve(1e-9)?.map(|weights| std::array::from_fn(|i| weights[i] as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn calibration() -> Calibration {
        Calibration {
            schema: SCHEMA.to_owned(),
            frame_px: [240, 320],
            field_of_view_mm: [12.3, 16.4],
            source: "nothing".to_owned(),
            gel_length_mm: Some(1.6),
            contact_share: None,
            leave_one_out: None,
            light: LightRig::named("cmu").unwrap(),
        }
    }

    #[test]
    fn a_calibration_comes_back_from_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        calibration().save(&path).unwrap();
        assert_eq!(Calibration::load(&path).unwrap(), calibration());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        let spec = calibration().spec(SensorSpec::default()).unwrap();
        assert_eq!((spec.frame_px, spec.gel_length_mm), ([240, 320], 1.6));
    }

    #[test]
    fn what_is_no_calibration_is_refused_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("mine.toml");
        calibration().save(&path).unwrap();
        let good = fs::read_to_string(&path).unwrap();
        for (from, to, reason) in [
            ("calibration/1", "calibration/2", "expected schema"),
            ("12.3", "-12.3", "field_of_view_mm"),
            ("gel_length_mm = 1.6", "gel_length_mm = nan", "gel_length_mm"),
            ("elevation_deg = 50.0", "elevation_deg = 100.0", "light.shadow.elevation_deg"),
            ("along_x", "along", "light"),
            ("schema = ", "schema ", "TOML"),
        ] {
            assert!(good.contains(from), "{from}");
            fs::write(&path, good.replacen(from, to, 1)).unwrap();
            let error = Calibration::load(&path).unwrap_err().to_string();
            assert!(error.contains("mine.toml") && error.contains(reason) && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn the_light_of_another_sensor_is_refused() {
        let error = calibration().light_for(SensorSpec::default()).unwrap_err().to_string();
        assert!(error.contains("expected 12.3 x 16.4 mm") && error.contains("got 18.6 x 14.3 mm"), "{error}");
        let same = SensorSpec { frame_px: [60, 80], field_of_view_mm: [12.2, 16.3], ..SensorSpec::default() };
        let lit = calibration().light_for(same.clone()).unwrap();
        assert_eq!(lit, SensorSpec { light: calibration().light, gel_length_mm: 1.6, ..same });
    }
}
