//! How a sensor's lamps differ from a Mini's, by touches of anything: for people and for programs.

use std::fmt;

use serde::Serialize;
use tactile_data::Result;
use tactile_data::dataset::store::Dataset;
use tactile_data::frame::Frame;
use tactile_data::light::calibrate::Calibration;
use tactile_data::light::calibrate::touches;
use tactile_data::light::calibrate::twins::TwinFit;
use tactile_data::light::touch_light::{Change, TOGETHER, TouchFit};

/// Touches that are looked at in a dataset: more tell hardly more.
const MOST_FRAMES: usize = 400;

/// Within so many standard deviations lie 95 % of a normal distribution.
const WITHIN: f64 = 1.96;

/// What [`touches::fit`] found.
#[derive(Serialize)]
pub struct LampTable {
    /// Red, green and blue.
    lamps: [Change; 3],
    /// Standard deviations of these.
    errors: [Change; 3],
    together_error: f64,
    n_touches: usize,
    n_frames: usize,
    curl_share: f64,
    /// What touches of known parts tell.
    #[serde(flatten)]
    of_known_parts: Option<TwinFit>,
}

impl LampTable {
    /// What frames that show `view_mm` say, and the calibration.
    pub fn of_frames(at_rest: &Frame, frames: &[Frame], view_mm: [f64; 2]) -> Result<(Calibration, Self)> {
        let (calibration, found) = touches::fit(at_rest, frames, view_mm)?;
        let TouchFit { changes, errors, n_touches, curl_share } = found;
        let (n_frames, together_error) = (frames.len(), TOGETHER);
        Ok((
            calibration,
            Self { lamps: changes, errors, together_error, n_touches, n_frames, curl_share, of_known_parts: None },
        ))
    }

    /// The same with what touches of known parts tell.
    pub fn with(self, found: TwinFit) -> Self {
        Self { lamps: found.lamps, errors: found.lamp_errors, of_known_parts: Some(found), ..self }
    }

    /// The lamps that a dataset was recorded under, where it says them; else what its frames say.
    pub fn known_or_fit(dataset: &Dataset) -> Result<(Calibration, Self)> {
        let meta = dataset.meta();
        let Some(known) = &meta.lamps else { return Self::fit(dataset) };
        let calibration = touches::of_lamps(dataset.no_contact(), known, meta.field_of_view_mm())?;
        let (lamps, errors, n) = ([Change::default(); 3], [Change::default(); 3], dataset.len());
        let (together_error, n_touches, n_frames, curl_share, of_known_parts) = (0.0, n, n, 0.0, None);
        Ok((calibration, Self { lamps, errors, together_error, n_touches, n_frames, curl_share, of_known_parts }))
    }

    /// What frames that are spread evenly over a dataset say, and the calibration.
    pub fn fit(dataset: &Dataset) -> Result<(Calibration, Self)> {
        let n = dataset.len().min(MOST_FRAMES);
        let frames: Vec<Frame> = (0..n).map(|i| dataset.frame(i * dataset.len() / n)).collect();
        Self::of_frames(dataset.no_contact(), &frames, dataset.meta().field_of_view_mm())
    }
}

impl fmt::Display for LampTable {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let strength = if self.of_known_parts.is_some() { "strength" } else { "strength next to the others'" };
        writeln!(f, "{:<8} {strength:>28} {:>22}", "lamp", "turned by, degrees")?;
        let between = [0.0, -WITHIN, WITHIN];
        for (name, (lamp, error)) in ["red", "green", "blue"].into_iter().zip(self.lamps.iter().zip(&self.errors)) {
            let [strength, weakest, strongest] = between.map(|times| (lamp.strength + times * error.strength).exp());
            let [turn, least, most] = between.map(|times| lamp.turn_deg + times * error.turn_deg);
            let strength = format!("{strength:.2} ({weakest:.2} to {strongest:.2})");
            writeln!(f, "{name:<8} {strength:>28} {:>22}", format!("{turn:.0} ({least:.0} to {most:.0})"))?;
        }
        write!(f, "next to a Mini's, by {} touches of {} frames; ", self.n_touches, self.n_frames)?;
        let Some(found) = &self.of_known_parts else {
            let factor = (WITHIN * self.together_error).exp();
            let together = "how strong the lamps are together no touch tells: as a Mini's, within a factor of";
            return writeln!(f, "{together} {factor:.1}");
        };
        let [gel, shortest, longest] = between.map(|times| found.gel_length_mm * (times * found.gel_error).exp());
        writeln!(
            f,
            "by {} of known parts gel length {gel:.2} mm ({shortest:.2} to {longest:.2}); correlation with their twins {:.3}",
            found.n_touches, found.correlation
        )
    }
}
