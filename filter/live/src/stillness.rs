//! Whether a contact has settled: two pictures of one touch agree, but for the camera's noise.

use tactile_data::frame::{Background, Frame};
use tactile_data::recording::contact::{FrameContact, background};

use crate::error::{Error, Result};

/// A contact of a film counts once this many pictures in a row show it and agree: in the first ones the gel still gives
/// way and the camera's exposure still follows.
const N_SETTLED: u32 = 3;

/// A contact is over once this many pictures in a row show none.
const N_RELEASED: u32 = 3;

/// From one picture of a settled contact to the next no more than this share of the contact changes: the gel creeps
/// on for seconds after a press, by a few percent a second.
const MOST_CHANGE: f32 = 0.1;

/// Differences up to this many times those of two pictures at rest are noise.
const NOISE_FACTOR: f32 = 2.0;

/// The least noise between two pictures, counts: the rounding of a byte, averaged.
const LEAST_NOISE: f32 = 0.1;

/// Compares pictures with the sensor at rest and with each other, reduced to 40 x 30 pixels.
#[derive(Clone, Debug)]
pub struct Stillness {
    rest: Background,
    noise_rms: f32,
}

impl Stillness {
    /// The noise between the pictures at rest, at least two, whose median the frame at rest is.
    ///
    /// # Errors
    /// Pictures that are dark, saturated, uniform or of two sizes.
    pub fn new(rest: &Frame, pictures: &[Frame]) -> Result<Self> {
        let mut noises = pictures.windows(2).map(|pair| difference(&pair[0], &pair[1]));
        let noise_rms =
            noises.try_fold(LEAST_NOISE, |most, noise| noise.map(|noise| most.max(noise.difference_rms)))?;
        Ok(Self { rest: background(rest)?, noise_rms })
    }

    /// How a picture differs from rest.
    ///
    /// # Errors
    /// A picture that is dark, saturated, uniform or of another size.
    pub fn contact(&self, frame: &Frame) -> Result<FrameContact> {
        Ok(FrameContact::of(&self.rest.tactile_image(frame)?))
    }

    /// Refuses two pictures that differ by more than noise and a tenth of the contact: the gel still gives way, the
    /// sensor still moves, or one of them is torn or damaged.
    ///
    /// # Errors
    /// Such pictures, and those that are dark, saturated, uniform or of another size.
    pub fn check(&self, before: &Frame, newest: &Frame) -> Result<()> {
        let most = (MOST_CHANGE * self.contact(newest)?.difference_rms).max(NOISE_FACTOR * self.noise_rms);
        let change = difference(before, newest)?;
        if change.difference_rms <= most && !change.is_contact() {
            return Ok(());
        }
        let got = format!("a change of {:.1} counts (RMS)", change.difference_rms);
        let expected = format!("the same touch as in the one before, to {most:.1} counts");
        Err(Error::invalid("picture", expected, got))
    }
}

/// How two pictures differ.
fn difference(before: &Frame, newest: &Frame) -> Result<FrameContact> {
    Ok(FrameContact::of(&background(before)?.tactile_image(newest)?))
}

/// Refuses two pictures of the sensor at rest that differ by an edge: it touches something.
///
/// # Errors
/// Such pictures, and those that are dark, saturated, uniform or of two sizes.
pub fn check_at_rest(before: &Frame, newest: &Frame) -> Result<()> {
    let change = difference(before, newest)?;
    if change.is_contact() {
        let got = format!("{:.1} % of the pixels different", 100.0 * change.edge_share);
        return Err(Error::invalid("picture", "the same as the one before but for noise", got));
    }
    Ok(())
}

/// Finds the settled contacts of a film, each once.
#[derive(Clone, Debug, Default)]
pub struct ContactWatch {
    n_contact: u32,
    n_free: u32,
    is_reported: bool,
}

impl ContactWatch {
    /// Takes in whether the next picture shows contact, and whether it agrees with the one before; whether a contact
    /// has settled now.
    pub fn settles(&mut self, is_contact: bool, agrees: bool) -> bool {
        self.n_free = if is_contact { 0 } else { self.n_free.saturating_add(1) };
        self.n_contact = if is_contact && agrees { self.n_contact.saturating_add(1) } else { 0 };
        if self.n_free >= N_RELEASED {
            self.is_reported = false;
        }
        self.n_contact >= N_SETTLED && !self.is_reported
    }

    /// The contact of now was observed: it settles no second time.
    pub fn observed(&mut self) {
        self.is_reported = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A gradient, with a bump of `counts` in the middle, and noise of +-1 count by `seed`.
    fn frame(counts: u8, seed: usize) -> Frame {
        let value = |x: usize, y: usize, c: usize| {
            let bump = if (30..50).contains(&x) && (20..40).contains(&y) { counts } else { 0 };
            80 + (x / 2) as u8 + bump + ((7 * x + 13 * y + 5 * c + 31 * seed) % 3) as u8
        };
        let rgb = (0..60).flat_map(|y| (0..80).flat_map(move |x| (0..3).map(move |c| value(x, y, c))));
        Frame::new(80, 60, rgb.collect()).unwrap()
    }

    fn stillness() -> Stillness {
        let pictures = [1, 2, 3].map(|seed| frame(0, seed));
        Stillness::new(&pictures[0], &pictures).unwrap()
    }

    #[test]
    fn pictures_of_one_touch_agree_and_others_do_not() {
        let (still, rest, touch) = (stillness(), frame(0, 4), frame(60, 5));
        assert!(still.check(&touch, &frame(60, 6)).is_ok() && still.check(&rest, &frame(0, 7)).is_ok());
        // Still being pressed: a quarter of the contact comes at once, which is no edge.
        let pressing = still.check(&frame(54, 5), &frame(60, 6));
        assert!(pressing.is_ok(), "a tenth is creep: {pressing:?}");
        let error = still.check(&frame(45, 5), &frame(60, 6)).unwrap_err().to_string();
        assert!(error.contains("the same touch as in the one before"), "{error}");
        // The lower half is still the picture before.
        let half = touch.rgb().len() / 2;
        let torn = Frame::new(80, 60, [&touch.rgb()[..half], &rest.rgb()[half..]].concat()).unwrap();
        assert!(still.check(&torn, &touch).is_err() && still.check(&touch, &torn).is_err());
        let dark = Frame::new(80, 60, vec![3; 14_400]).unwrap();
        assert!(still.check(&touch, &dark).is_err());
        assert!(check_at_rest(&rest, &frame(0, 1)).is_ok() && check_at_rest(&rest, &touch).is_err());
    }

    #[test]
    fn each_contact_settles_once() {
        let (still, mut watch) = (stillness(), ContactWatch::default());
        let mut settled_at = Vec::new();
        let film = [0, 0, 60, 60, 60, 60, 60, 0, 60, 0, 0, 0, 60, 60, 60, 60];
        for (i, counts) in film.into_iter().enumerate() {
            let newest = frame(counts, i);
            let agrees = i > 0 && still.check(&frame(film[i - 1], i - 1), &newest).is_ok();
            if watch.settles(still.contact(&newest).unwrap().is_contact(), agrees) {
                settled_at.push(i);
                watch.observed();
            }
        }
        // The first of each contact does not agree with the one before; one free picture does not end a contact.
        assert_eq!(settled_at, [5, 15]);
    }
}
