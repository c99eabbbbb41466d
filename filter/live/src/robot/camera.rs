//! The simulated camera: a stream of pictures of one touch or of the sensor at rest, with what goes wrong on demand.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;
use tactile_data::dataset::export::jpeg;
use tactile_data::frame::Frame;
use tactile_data::recording::ros::messages::{CompressedImage, Header, Image, Time, to_cdr};
use tactile_data::sensor::simulator::frame_rng;

use crate::error::Result;
use crate::event::Given;
use crate::robot::{RobotSettings, Sent};

/// One byte in so many changes by one count from a picture to the next: a stream of a sensor that does not move is never
/// the same bytes twice.
const FLICKER: usize = 97;

/// What goes wrong with pictures; each a share of them, 0..=1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Not sent.
    pub dropped: f64,
    /// The one before is sent, stamped anew.
    pub frozen: f64,
    /// The lower half is the one before.
    pub torn: f64,
    /// Black but for noise.
    pub dark: f64,
    /// The message is cut off.
    pub malformed: f64,
    /// Seconds for which the camera is gone, once, ten seconds after the start.
    pub gone_s: f64,
}

/// What is in front of the sensor.
pub enum Shows {
    /// Nothing.
    Rest,
    /// A touch.
    Touch(Frame),
}

/// The camera.
pub struct Camera {
    rest: Frame,
    touch: Option<Frame>,
    /// How far the gel gave way, 0..=1.
    share: f64,
    faults: Faults,
    jpeg: Option<u8>,
    interval_ns: i64,
    first_ns: Option<i64>,
    n_slots: i64,
    before: Option<Frame>,
    rng: ChaCha8Rng,
}

impl Camera {
    /// A camera of a sensor whose picture at rest is `rest`.
    pub fn new(rest: Frame, settings: &RobotSettings) -> Self {
        Self {
            rest,
            touch: None,
            share: 0.0,
            faults: settings.faults,
            jpeg: settings.jpeg,
            interval_ns: (1e9 / settings.rate_hz.max(0.1)) as i64,
            first_ns: None,
            n_slots: 0,
            before: None,
            rng: frame_rng(settings.seed ^ 0x6361_6d65, 0),
        }
    }

    /// Puts something in front of the sensor.
    pub fn show(&mut self, shows: Shows) {
        self.share = 0.0;
        self.touch = match shows {
            Shows::Rest => None,
            Shows::Touch(frame) => Some(frame),
        };
    }

    /// How far the gel gave way.
    pub fn settles(&mut self, share: f64) {
        self.share = share.clamp(0.0, 1.0);
    }

    /// The next picture, where it is time for one and nothing goes wrong.
    pub fn picture(&mut self, time_ns: i64) -> Result<Option<Sent>> {
        let first_ns = *self.first_ns.get_or_insert(time_ns);
        if time_ns < first_ns + self.n_slots * self.interval_ns {
            return Ok(None);
        }
        self.n_slots = (time_ns - first_ns) / self.interval_ns + 1;
        let Faults { dropped, frozen, torn, dark, malformed, gone_s } = self.faults;
        let since_s = (time_ns - first_ns) as f64 * 1e-9;
        let is_gone = (10.0..10.0 + gone_s).contains(&since_s);
        // Each is drawn every time, so that one fault does not change the others.
        let [dropped, frozen, torn, dark, malformed] =
            [dropped, frozen, torn, dark, malformed].map(|share| self.rng.random::<f64>() < share);
        let mut frame = self.seen()?;
        if is_gone || dropped {
            return Ok(None);
        }
        let before = self.before.take();
        if let Some(before) = before.filter(|_| frozen || torn) {
            frame = if frozen { before } else { torn_from(&before, &frame)? };
        }
        if dark {
            let rgb = frame.rgb().iter().enumerate().map(|(i, v)| 8 + (v % 5) + (i % 3) as u8).collect();
            frame = Frame::new(frame.width_px(), frame.height_px(), rgb)?;
        }
        let sent = self.message(time_ns, &frame, malformed)?;
        self.before = Some(frame);
        Ok(Some(sent))
    }

    /// What is in front of the sensor now, a little different each time.
    fn seen(&mut self) -> Result<Frame> {
        let touch = self.touch.as_ref().unwrap_or(&self.rest);
        let share = self.share as f32;
        let mix = |(rest, touch): (&u8, &u8)| {
            if share >= 1.0 { *touch } else { (f32::from(*rest) * (1.0 - share) + f32::from(*touch) * share) as u8 }
        };
        let mut rgb: Vec<u8> = self.rest.rgb().iter().zip(touch.rgb()).map(mix).collect();
        let start = self.rng.random_range(0..FLICKER);
        for value in rgb.iter_mut().skip(start).step_by(FLICKER) {
            *value = if self.rng.random::<bool>() { value.saturating_add(1) } else { value.saturating_sub(1) };
        }
        Ok(Frame::new(touch.width_px(), touch.height_px(), rgb)?)
    }

    fn message(&self, time_ns: i64, frame: &Frame, is_malformed: bool) -> Result<Sent> {
        let header = Header { stamp: Time::of_nanoseconds(time_ns), frame_id: "gelsight".into() };
        let cut = |cdr: Vec<u8>| {
            let len = if is_malformed { cdr.len() / 2 } else { cdr.len() };
            cdr[..len].to_vec()
        };
        Ok(match self.jpeg {
            Some(quality) => {
                let data = jpeg(frame, quality)?;
                Sent::Given(
                    Given::CompressedImage,
                    cut(to_cdr(&CompressedImage { header, format: "jpeg".into(), data })),
                )
            }
            None => Sent::Given(Given::Image, cut(to_cdr(&Image::of_frame(header, frame)))),
        })
    }
}

/// The upper half of a picture over the lower half of the one before.
fn torn_from(before: &Frame, frame: &Frame) -> Result<Frame> {
    let half = frame.rgb().len() / 2;
    let rgb = [&frame.rgb()[..half], &before.rgb()[half..]].concat();
    Ok(Frame::new(frame.width_px(), frame.height_px(), rgb)?)
}
