//! A sensor's own light, from presses of a ball or from Taxim's table, and the file that keeps it.

pub mod ball;
pub mod circle;
pub mod circle_search;
mod contact;
pub mod fit;
mod least_squares;
mod light_factors;
pub mod practice;
pub mod presses;
#[cfg(test)]
mod synthetic;
pub mod taxim;
pub mod touches;
pub mod twins;

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::dataset::compare::Figures;
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::file::whole_file;
use crate::frame::Frame;
use crate::light::lamps::{CalibratedLamps, check_reach};
use crate::sensor::SensorSpec;
use crate::sensor::light::{LightRig, Quadratic};
use least_squares::Sums;
use light_factors::{factors, place};

/// What a calibration file says it is.
pub const SCHEMA: &str = "tactile-filter/calibration/1";

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
    /// The contacts' radii as shares of the given circles' radii, on average.
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
        let text = bounded_file::read_to_string(path, Kind::SETTINGS)?;
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
        whole_file::write(path, text.as_bytes())
    }

    /// The lamps as they answer gentle slopes: what is needed to bring pictures under the lamps that the network
    /// knows.
    pub fn lamps(&self) -> CalibratedLamps {
        CalibratedLamps { lamps: self.light.response(), field_of_view_mm: self.field_of_view_mm }
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

    /// `spec` with the calibrated gel and light, its frame and field of view kept: the light is the light of the area
    /// that the view shows, about [`SensorSpec::calibration_centre_mm`], or the calibrated frame's middle without it.
    /// The gel's length is in mm and stays. Refuses a view that reaches more than 1.1 times as far as the calibrated
    /// one from its middle: nothing was measured there.
    pub fn light_for(&self, spec: SensorSpec) -> Result<SensorSpec> {
        spec.validate()?;
        let [centre_mm, view_mm] = [spec.calibration_centre_mm.unwrap_or_default(), spec.field_of_view_mm];
        let centre = [0, 1].map(|axis| 2.0 * centre_mm[axis] / self.field_of_view_mm[axis]);
        let half = [0, 1].map(|axis| view_mm[axis] / self.field_of_view_mm[axis]);
        let reach = [0, 1].map(|axis| centre[axis].abs() + half[axis]);
        check_reach("sensor.field_of_view_mm", reach, self.field_of_view_mm, || {
            let [[width, height], [x, y]] = [view_mm, centre_mm];
            format!("{width:.1} x {height:.1} mm about {x:.1}, {y:.1} mm")
        })?;
        let light = self.light.on_view(centre, half);
        let (frame_px, field_of_view_mm) = (spec.frame_px, spec.field_of_view_mm);
        let spec = SensorSpec { frame_px, field_of_view_mm, light, calibration_centre_mm: None, ..self.spec(spec)? };
        spec.validate()?;
        Ok(spec)
    }
}

/// A no-contact frame as a quadratic for each channel, by least squares.
pub fn at_rest(no_contact: &Frame) -> Result<[Quadratic; 3]> {
    let size_px = [no_contact.width_px(), no_contact.height_px()];
    let mut sums = Sums::new(6);
    for (pixel, rgb) in no_contact.rgb().as_chunks::<3>().0.iter().enumerate() {
        sums.add(factors([1.0], place(pixel, size_px)).as_flattened(), rgb.map(f64::from));
    }
    Ok(sums.solve(1e-9)?.map(|weights| std::array::from_fn(|i| weights[i] as f32)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::light::value;
    use std::fs;

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
    fn another_view_of_the_gel_has_the_light_of_its_own_area() {
        // 6.15 x 8.2 mm of the calibrated 12.3 x 16.4, 2 mm right of its middle and 3 above.
        let view = [6.15, 8.2];
        let crop =
            SensorSpec { field_of_view_mm: view, calibration_centre_mm: Some([2.0, -3.0]), ..SensorSpec::default() };
        let lit = calibration().light_for(crop.clone()).unwrap();
        let light = lit.light.clone();
        let kept = SensorSpec { light: light.clone(), gel_length_mm: 1.6, calibration_centre_mm: None, ..crop };
        assert_eq!(lit, kept);
        for place_mm in [[0.0, 0.0], [-3.0, 4.0], [2.5, -1.0]] {
            let share = |mm: [f64; 2], of: [f64; 2]| [0, 1].map(|axis| (2.0 * mm[axis] / of[axis]) as f32);
            let [x, y] = share(place_mm, view);
            let [there_x, there_y] = share([place_mm[0] + 2.0, place_mm[1] - 3.0], [12.3, 16.4]);
            for channel in 0..3 {
                let there = value(&calibration().light.along_y[channel], there_x, there_y);
                assert!((value(&light.along_y[channel], x, y) - there).abs() < 1e-4);
            }
        }
    }

    #[test]
    fn a_view_of_what_was_not_calibrated_is_refused() {
        let light_for = |field_of_view_mm, calibration_centre_mm| {
            calibration().light_for(SensorSpec { field_of_view_mm, calibration_centre_mm, ..SensorSpec::default() })
        };
        let error = light_for([18.6, 14.3], None).unwrap_err().to_string();
        assert!(error.contains("within 1.1 times the 12.3 x 16.4 mm") && error.contains("18.6 x 14.3 mm"), "{error}");
        assert!(light_for([13.5, 18.0], None).is_ok());
        assert!(light_for([12.3, 16.4], Some([0.6, 0.0])).is_ok());
        let error = light_for([12.3, 16.4], Some([0.7, 0.0])).unwrap_err().to_string();
        assert!(error.contains("about 0.7, 0.0 mm"), "{error}");
        assert!(light_for([12.3, 16.4], Some([f64::NAN, 0.0])).is_err());
    }
}
