//! The sensor at rest: pictures taken while it touches nothing, and what follows from them.

use std::sync::Arc;

use tactile_data::dataset::touch::Side;
use tactile_data::frame::Frame;
use tactile_data::light::touch_light::{SensorLight, TouchFit};
use tactile_data::recording::geometry::View;
use tactile_data::recording::rest::median;
use tactile_filter::{Observation, Sensor};
use tactile_infer::{Bank, Model};

use crate::error::{Error, Result};
use crate::parameters::CameraParameters;
use crate::stillness::{ContactWatch, Stillness, check_at_rest};

/// A sensor whose frame at rest is known.
#[derive(Clone, Debug)]
pub struct Calibrated {
    sensor: Sensor,
    view: View,
    stillness: Stillness,
    rest: Frame,
    /// What is known of its lamps by its touches, where it learns them.
    light: Option<SensorLight>,
    /// Finds contacts in its pictures.
    pub watch: ContactWatch,
}

impl Calibrated {
    /// The sensor of pictures taken at rest, all of one size; lines for a person are added to `warnings`.
    ///
    /// # Errors
    /// Pictures that are dark, saturated, uniform, or show another field of view than the bank's.
    pub fn new(
        pictures: &[Frame],
        camera: &CameraParameters,
        model: &Arc<Model>,
        bank: &Bank,
        warnings: &mut Vec<String>,
    ) -> Result<Self> {
        let picture = median(pictures)?;
        let view = camera.geometry()?.settle(&picture, warnings)?;
        check_scale(&view, bank)?;
        let rest = view.frame(&picture, "no-contact frame")?;
        let frames = pictures.iter().map(|picture| Ok(view.frame(picture, "no-contact frame")?));
        let frames = frames.collect::<Result<Vec<_>>>()?;
        let light = camera.learn_light.then(|| SensorLight::new(&rest, view.field_of_view_mm())).transpose()?;
        Ok(Self {
            sensor: Sensor::new(Arc::clone(model), &rest)?.lit_by(view.lamps())?,
            stillness: Stillness::new(&rest, &frames)?,
            watch: ContactWatch::default(),
            rest,
            light,
            view,
        })
    }

    /// The same, which knows of its lamps what was learnt before this frame at rest, where that shows the same light.
    ///
    /// # Errors
    /// Lamps that do not show slopes in all directions.
    pub fn after(self, before: Option<&Self>) -> Result<Self> {
        let Some(light) = before.and_then(|before| before.light.clone()) else { return Ok(self) };
        let light = light.with_rest(&self.rest)?;
        let sensor = self.sensor.lit_by(light.lamps())?;
        Ok(Self { sensor, light: Some(light), ..self })
    }

    /// Adds a touch that was taken in to what tells its lamps.
    ///
    /// # Errors
    /// A frame of another size.
    pub fn felt(&mut self, frame: &Frame) -> Result<()> {
        let light = self.light.as_mut().filter(|light| light.learns());
        Ok(light.map_or(Ok(()), |light| light.add(frame))?)
    }

    /// Learns the lamps where there are touches enough; what was found, if so.
    ///
    /// # Errors
    /// Lamps that do not show slopes in all directions.
    pub fn learn_light(&mut self) -> Result<Option<TouchFit>> {
        let Some(light) = &mut self.light else { return Ok(None) };
        let found = light.learn();
        if found.is_some() {
            self.sensor = self.sensor.clone().lit_by(light.lamps())?;
        }
        Ok(found)
    }

    /// The same, touching this side.
    #[must_use]
    pub fn of_side(self, side: Side) -> Self {
        Self { sensor: self.sensor.of_side(side), ..self }
    }

    /// A picture as the sensor sees it: turned, cropped.
    ///
    /// # Errors
    /// A picture of another size than those at rest.
    pub fn frame(&self, picture: &Frame) -> Result<Frame> {
        Ok(self.view.frame(picture, "picture")?)
    }

    /// What the newest of two frames of one touch shows.
    ///
    /// # Errors
    /// Frames that do not agree, or that the sensor refuses.
    pub fn observe(&self, [before, newest]: [&Frame; 2]) -> Result<Observation> {
        self.stillness.check(before, newest)?;
        Ok(self.sensor.observe(newest)?)
    }

    /// Takes in the newest of two frames; whether a contact has settled now.
    ///
    /// # Errors
    /// Frames that the sensor refuses; they count for nothing.
    pub fn settles(&mut self, [before, newest]: [&Frame; 2]) -> Result<bool> {
        let is_contact = self.stillness.contact(newest)?.is_contact();
        Ok(self.watch.settles(is_contact, self.stillness.check(before, newest).is_ok()))
    }

    /// Width and height of a frame, pixels.
    pub fn frame_px(&self) -> [usize; 2] {
        self.view.frame_px()
    }
}

/// Refuses a camera that shows another field of view than the bank's did.
fn check_scale(view: &View, bank: &Bank) -> Result<()> {
    let Some(origin) = bank.origin() else { return Ok(()) };
    let Some([what, in_bank, here]) = origin.other_scale(view.field_of_view_mm()) else { return Ok(()) };
    let place = format!("{what} of the pictures (camera.crop, camera.field_of_view_mm)");
    Err(Error::invalid(place, format!("{in_bank} as in bank {}", origin.name), here))
}

/// Pictures being taken at rest.
#[derive(Clone, Debug)]
pub struct Collecting {
    /// Who asked; 0: nobody.
    pub id: u64,
    /// Since when, nanoseconds.
    pub since_ns: i64,
    pictures: Vec<Frame>,
    /// Why the latest picture began a new series, where it did.
    pub setback: Option<String>,
}

impl Collecting {
    /// Begins.
    pub fn new(id: u64, since_ns: i64) -> Self {
        Self { id, since_ns, pictures: Vec::new(), setback: None }
    }

    /// Takes in a picture; all of them once there are `n`, each like the one before. One that is not begins a new
    /// series: the sensor still touches something, or the light changes.
    pub fn push(&mut self, picture: Frame, n: usize) -> Option<Vec<Frame>> {
        if let Some(Err(error)) = self.pictures.last().map(|before| check_at_rest(before, &picture)) {
            self.setback = Some(error.to_string());
            self.pictures.clear();
        }
        self.pictures.push(picture);
        (self.pictures.len() >= n).then(|| std::mem::take(&mut self.pictures))
    }
}
