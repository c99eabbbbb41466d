//! The pictures as they arrive: which are new, how old they are, and whether the camera is there at all.
//!
//! A header's stamp proves nothing: drivers stamp their last picture anew when the camera stalls. A picture counts as new
//! only where its bytes differ from those of the one before; the noise of a camera makes sure that they do.

use tactile_data::frame::Frame;
use tactile_data::frame::picture;
use tactile_data::recording::pipeline::Picture;
use tactile_data::recording::ros::messages::{CompressedImage, Image, Time, from_cdr};
use tactile_data::recording::ros::picture::{Shown, of_compressed, of_image};

use crate::error::{Error, Result};
use crate::parameters::{CameraParameters, Clock};

/// Names the pictures in errors.
const PLACE: &str = "picture";

/// Pictures arrive at their usual interval, averaged with this share of the latest.
const INTERVAL_SHARE: f64 = 0.05;

/// The camera as its pictures say.
#[derive(Clone, Debug)]
pub struct Camera {
    parameters: CameraParameters,
    /// The newest two new pictures, the newest last.
    latest: [Option<Arrival>; 2],
    stamps: Stamps,
    last_message_ns: Option<i64>,
    interval_ns: Option<f64>,
    /// Repeats of the newest picture so far.
    n_repeats: u64,
    counts: Counts,
}

/// Pictures so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// New ones.
    pub new: u64,
    /// Messages with the bytes of the picture before.
    pub repeated: u64,
    /// Messages that hold no picture.
    pub malformed: u64,
}

/// A new picture.
#[derive(Clone, Debug)]
pub struct Arrival {
    picture: Picture,
    /// What had to be guessed of its encoding.
    pub guess: Option<String>,
    /// When it was taken at the latest, as far as arrival and stamps say, nanoseconds on the node's clock.
    pub taken_ns: i64,
    /// When its bytes first arrived.
    pub arrived_ns: i64,
}

/// What a message was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A new picture.
    New,
    /// The bytes of the picture before, and how many times in a row.
    Repeated(u64),
}

/// What is wrong with the clock that stamps the pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ClockFault {
    /// It went back by so many seconds.
    WentBack(f64),
    /// It says another time than this machine's, by so many seconds (positive: it is behind).
    Differs(f64),
}

impl Arrival {
    /// The frame, whole as the camera took it.
    ///
    /// # Errors
    /// A picture that cannot be decoded, or is cut off.
    pub fn decode(&self) -> Result<Frame> {
        match &self.picture {
            Picture::Raw(frame) => Ok(frame.clone()),
            Picture::Encoded(bytes) => {
                check_whole(bytes)?;
                Ok(picture::decode(bytes, PLACE)?)
            }
        }
    }

    fn bytes(&self) -> &[u8] {
        match &self.picture {
            Picture::Raw(frame) => frame.rgb(),
            Picture::Encoded(bytes) => bytes,
        }
    }
}

/// Refuses a JPEG without its end: decoders fill what is missing with grey.
fn check_whole(bytes: &[u8]) -> Result<()> {
    let is_jpeg = bytes.starts_with(&[0xff, 0xd8]);
    // Some drivers pad a JPEG with zeros.
    let end = bytes.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
    if is_jpeg && !bytes[..end].ends_with(&[0xff, 0xd9]) {
        return Err(Error::invalid(PLACE, "a whole JPEG", "one that is cut off"));
    }
    Ok(())
}

impl Camera {
    /// No picture came yet.
    pub fn new(parameters: &CameraParameters) -> Self {
        Self {
            parameters: parameters.clone(),
            latest: [None, None],
            stamps: Stamps::new(parameters.clock),
            last_message_ns: None,
            interval_ns: None,
            n_repeats: 0,
            counts: Counts::default(),
        }
    }

    /// Takes in a `sensor_msgs/msg/Image`.
    ///
    /// # Errors
    /// Bytes that are no message, or no picture; what was known stays.
    pub fn image(&mut self, time_ns: i64, cdr: &[u8]) -> Result<(Kind, Option<ClockFault>)> {
        let read = |cdr| {
            let image: Image = from_cdr(cdr, PLACE)?;
            let stamp = image.header.stamp;
            Ok((stamp, of_image(image, PLACE)?))
        };
        self.take(time_ns, read(cdr))
    }

    /// Takes in a `sensor_msgs/msg/CompressedImage`.
    ///
    /// # Errors
    /// Bytes that are no message, or no picture; what was known stays.
    pub fn compressed(&mut self, time_ns: i64, cdr: &[u8]) -> Result<(Kind, Option<ClockFault>)> {
        let read = |cdr| {
            let image: CompressedImage = from_cdr(cdr, PLACE)?;
            let stamp = image.header.stamp;
            Ok((stamp, of_compressed(image, PLACE)?))
        };
        self.take(time_ns, read(cdr))
    }

    fn take(&mut self, time_ns: i64, read: Result<(Time, Shown)>) -> Result<(Kind, Option<ClockFault>)> {
        let (stamp, Shown { picture, guess }) = read.inspect_err(|_| self.counts.malformed += 1)?;
        let mut arrival = Arrival { picture, guess, taken_ns: time_ns, arrived_ns: time_ns };
        if let Some(before) = self.last_message_ns {
            let interval = (time_ns - before) as f64;
            self.interval_ns =
                Some(self.interval_ns.map_or(interval, |usual| usual + INTERVAL_SHARE * (interval - usual)));
        }
        self.last_message_ns = Some(time_ns);
        let newest = self.latest[1].as_ref();
        if newest.is_some_and(|newest| newest.bytes() == arrival.bytes()) {
            self.counts.repeated += 1;
            self.n_repeats += 1;
            return Ok((Kind::Repeated(self.n_repeats), None));
        }
        let mut fault = None;
        // Some drivers leave the stamp empty.
        if stamp != Time::default() {
            let (late_ns, found) = self.stamps.late(time_ns, stamp.nanoseconds());
            arrival.taken_ns = time_ns.saturating_sub(late_ns);
            fault = found;
        }
        self.counts.new += 1;
        self.n_repeats = 0;
        self.latest.swap(0, 1);
        self.latest[1] = Some(arrival);
        Ok((Kind::New, fault))
    }

    /// The newest two new pictures; where pictures are stills, the newest one twice.
    ///
    /// # Errors
    /// Fewer than two, or the newest too old; both must have been taken after `since_ns`.
    pub fn pair_since(&self, since_ns: i64, now_ns: i64) -> Result<[&Arrival; 2]> {
        let [before, newest] = [0, 1].map(|i| self.latest[i].as_ref());
        let Some(newest) = newest else { return Err(Error::invalid(PLACE, "pictures", "none")) };
        let age_s = (now_ns - newest.taken_ns) as f64 * 1e-9;
        let expected = format!("one at most {} s old", self.parameters.max_age_s);
        if age_s > self.parameters.max_age_s {
            // The same picture comes, still: not a camera that sends nothing.
            let is_sending =
                self.last_message_ns.is_some_and(|last| (now_ns - last) as f64 * 1e-9 <= self.parameters.max_age_s);
            let is_frozen = self.n_repeats > 0 && is_sending;
            let got = if is_frozen {
                format!("the same one for {age_s:.1} s, {} times: the camera has stopped", self.n_repeats + 1)
            } else {
                format!("one {age_s:.1} s old")
            };
            return Err(Error::invalid(PLACE, expected, got));
        }
        let is_after = |arrival: &&Arrival| arrival.taken_ns >= since_ns;
        if self.parameters.stills && is_after(&newest) {
            return Ok([newest, newest]);
        }
        match before.filter(is_after).filter(|_| is_after(&newest)) {
            Some(before) => Ok([before, newest]),
            None => Err(Error::invalid(PLACE, "two new ones since the sensor stands still", "fewer")),
        }
    }

    /// The newest new picture.
    pub fn newest(&self) -> Option<&Arrival> {
        self.latest[1].as_ref()
    }

    /// Seconds since a new picture arrived.
    pub fn age_s(&self, now_ns: i64) -> Option<f64> {
        self.newest().map(|newest| (now_ns - newest.arrived_ns) as f64 * 1e-9)
    }

    /// Messages a second, where two came.
    pub fn rate_hz(&self) -> Option<f64> {
        self.interval_ns.filter(|interval| *interval > 0.0).map(|interval| 1e9 / interval)
    }

    /// Pictures so far.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// Forgets the pictures, the interval and the stamps: another camera may come now.
    pub fn forget(&mut self) {
        *self = Self { counts: self.counts, ..Self::new(&self.parameters) };
    }
}

/// How late pictures are by their stamps.
#[derive(Clone, Debug)]
struct Stamps {
    clock: Clock,
    last_ns: Option<i64>,
    /// The smallest difference between arrival and stamp.
    base_ns: Option<i64>,
}

/// A clock that differs by less is taken for the same, nanoseconds.
const SAME_CLOCK_NS: i64 = 1_000_000_000;

impl Stamps {
    fn new(clock: Clock) -> Self {
        Self { clock, last_ns: None, base_ns: None }
    }

    /// By how many nanoseconds a picture is late, at least 0.
    fn late(&mut self, arrived_ns: i64, stamp_ns: i64) -> (i64, Option<ClockFault>) {
        let offset_ns = arrived_ns.saturating_sub(stamp_ns);
        let last_ns = self.last_ns.replace(stamp_ns);
        let back_ns = last_ns.map_or(0, |last| last.saturating_sub(stamp_ns));
        if self.clock == Clock::Shared {
            let went_back = (back_ns > 0).then_some(ClockFault::WentBack(back_ns as f64 * 1e-9));
            return (offset_ns.max(0), went_back);
        }
        if back_ns > 0 {
            self.base_ns = Some(offset_ns);
            return (0, Some(ClockFault::WentBack(back_ns as f64 * 1e-9)));
        }
        let is_first = self.base_ns.is_none();
        let base_ns = self.base_ns.map_or(offset_ns, |base| base.min(offset_ns));
        self.base_ns = Some(base_ns);
        let differs = is_first && offset_ns.abs() > SAME_CLOCK_NS;
        let fault = differs.then_some(ClockFault::Differs(offset_ns as f64 * 1e-9));
        (offset_ns - base_ns, fault)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::recording::ros::messages::{Header, to_cdr};

    const MS: i64 = 1_000_000;

    fn picture(value: u8, stamp_ns: i64) -> Vec<u8> {
        let header = Header { stamp: Time::of_nanoseconds(stamp_ns), frame_id: String::new() };
        to_cdr(&Image::of_frame(header, &Frame::new(4, 2, vec![value; 24]).unwrap()))
    }

    fn camera() -> Camera {
        Camera::new(&CameraParameters::default())
    }

    #[test]
    fn a_picture_stamped_anew_is_no_new_picture() {
        let mut camera = camera();
        for (i, value) in [1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2].into_iter().enumerate() {
            let time = 40 * MS * i as i64;
            let (kind, fault) = camera.image(time, &picture(value, time + 1)).unwrap();
            assert_eq!((kind == Kind::New, fault), (i < 2, None));
        }
        assert_eq!(camera.counts(), Counts { new: 2, repeated: 9, malformed: 0 });
        let frozen = camera.pair_since(0, 400 * MS).unwrap_err().to_string();
        let said =
            "picture: expected one at most 0.3 s old, got the same one for 0.4 s, 10 times: the camera has stopped";
        assert_eq!(frozen, said);
        assert!((camera.rate_hz().unwrap() - 25.0).abs() < 1e-9);
    }

    #[test]
    fn two_pictures_since_the_motion_are_asked_for() {
        let mut camera = camera();
        assert!(camera.pair_since(0, 0).unwrap_err().to_string().ends_with("got none"));
        for (i, time) in [0, 40, 80, 120].into_iter().enumerate() {
            camera.image(time * MS, &picture(i as u8, 0)).unwrap();
        }
        assert!(camera.pair_since(80 * MS, 130 * MS).is_ok());
        assert!(camera.pair_since(81 * MS, 130 * MS).unwrap_err().to_string().contains("two new ones"));
        assert!(camera.pair_since(0, 500 * MS).unwrap_err().to_string().contains("got one 0.4 s old"));
    }

    #[test]
    fn a_picture_that_waited_in_a_queue_is_old_on_any_clock() {
        for (clock, offset_s) in [(Clock::Own, 0), (Clock::Own, -7200), (Clock::Own, 86_400), (Clock::Shared, 0)] {
            let mut camera = Camera::new(&CameraParameters { clock, ..CameraParameters::default() });
            let stamp = |time_ms: i64| (time_ms + 1000 * offset_s + 1_000_000_000) * MS;
            let start = 1_000_000_000;
            let mut faults = Vec::new();
            // From the fifth on they are half a second late.
            for i in 0..8_i64 {
                let late_ms = if i < 4 { 3 } else { 500 };
                let (_, fault) =
                    camera.image((start + 40 * i + late_ms) * MS, &picture(i as u8, stamp(40 * i))).unwrap();
                faults.extend(fault);
            }
            assert_eq!(faults.len(), usize::from(offset_s != 0), "{faults:?}");
            let now = (start + 7 * 40 + 500) * MS;
            assert!(camera.pair_since(0, now).unwrap_err().to_string().contains("0.5 s old"));
        }
        // One clock, set right: what is 2 s old from the start on is seen too.
        let mut shared = Camera::new(&CameraParameters { clock: Clock::Shared, ..CameraParameters::default() });
        for i in 1..4 {
            shared.image((2000 + 40 * i) * MS, &picture(i as u8, 40 * i * MS)).unwrap();
        }
        assert!(shared.pair_since(0, 2120 * MS).unwrap_err().to_string().contains("2.0 s old"));
    }

    #[test]
    fn a_clock_that_goes_back_is_said_and_pictures_go_on() {
        let mut camera = camera();
        let hour = 3_600_000;
        for (i, stamp_ms) in [hour, hour + 40, 100, 140, 180].into_iter().enumerate() {
            let time = (hour + 40 * i as i64) * MS;
            let (_, fault) = camera.image(time, &picture(i as u8, stamp_ms * MS)).unwrap();
            assert_eq!(fault.is_some(), i == 2, "{fault:?}");
        }
        assert!(camera.pair_since(0, (hour + 161) * MS).is_ok());
    }

    #[test]
    fn what_is_no_picture_is_counted_and_what_was_known_stays() {
        let mut camera = camera();
        camera.image(0, &picture(1, 0)).unwrap();
        let whole = picture(2, 0);
        for bytes in [&whole[..9], &whole[..whole.len() - 5], &[0; 40], &[]] {
            assert!(camera.image(1, bytes).is_err());
        }
        let strange =
            Image { encoding: "yuv422".into(), height: 2, width: 2, step: 4, data: vec![0; 8], ..Image::default() };
        assert!(camera.image(2, &to_cdr(&strange)).unwrap_err().to_string().contains("yuv422"));
        assert!(camera.compressed(3, &to_cdr(&CompressedImage::default())).is_err());
        assert_eq!(camera.counts(), Counts { new: 1, repeated: 0, malformed: 6 });
        assert_eq!(camera.newest().unwrap().decode().unwrap().rgb(), [1; 24]);
    }

    #[test]
    fn a_cut_jpeg_is_no_frame_under_any_name() {
        let frame = Frame::new(16, 16, (0..768).map(|i| (i % 251) as u8).collect()).unwrap();
        let jpeg = tactile_data::dataset::export::jpeg(&frame, 90).unwrap();
        let send = |data: &[u8]| {
            let mut camera = camera();
            let raw = Image { encoding: "bgr8".into(), height: 16, width: 16, data: data.to_vec(), ..Image::default() };
            camera.image(0, &to_cdr(&raw)).unwrap();
            camera.newest().unwrap().decode()
        };
        assert_eq!(send(&jpeg).unwrap().width_px(), 16);
        assert!(send(&[&jpeg[..], &[0; 7]].concat()).is_ok());
        let cut = send(&jpeg[..jpeg.len() * 2 / 3]).unwrap_err().to_string();
        assert_eq!(cut, "picture: expected a whole JPEG, got one that is cut off");
    }
}
