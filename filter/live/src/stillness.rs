//! Whether a contact has settled: two pictures of one touch agree, but for the camera's noise.

use tactile_data::contact::{FrameContact, background};
use tactile_data::frame::{Background, Frame};

use crate::error::{Error, Result};

/// A contact of a film counts once this many pictures in a row show it and agree: in the first ones the gel still gives
/// way and the camera's exposure still follows.
const N_SETTLED: u32 = 3;

/// A contact is over once this many pictures in a row show none.
const N_RELEASED: u32 = 3;

/// Refuses two pictures that differ by more than noise, reduced to 40 x 30 pixels: the gel still moves, or one of them
/// is torn or damaged. Both must be lit.
///
/// # Errors
/// Pictures that differ, are dark, saturated, uniform or of two sizes.
pub fn check_agreement(before: &Frame, newest: &Frame) -> Result<()> {
    let contact = FrameContact::of(&background(before)?.tactile_image(newest)?);
    if contact.is_contact() {
        let got = format!("{:.1} % of the pixels different", 100.0 * contact.edge_share);
        return Err(Error::invalid("picture", "the same as the one before but for noise", got));
    }
    Ok(())
}

/// Finds the settled contacts of a film, each once.
#[derive(Clone, Debug)]
pub struct ContactWatch {
    rest: Background,
    n_contact: u32,
    n_free: u32,
    is_reported: bool,
}

impl ContactWatch {
    /// Watches pictures of a sensor whose frame at rest is `no_contact`.
    ///
    /// # Errors
    /// A frame that is dark, saturated or uniform.
    pub fn new(no_contact: &Frame) -> Result<Self> {
        Ok(Self { rest: background(no_contact)?, n_contact: 0, n_free: N_RELEASED, is_reported: false })
    }

    /// Takes in the next picture, and whether it agrees with the one before; whether a contact has settled now.
    ///
    /// # Errors
    /// A picture that is dark, saturated, uniform or of another size; it counts for nothing.
    pub fn settles(&mut self, frame: &Frame, agrees: bool) -> Result<bool> {
        let is_contact = FrameContact::of(&self.rest.tactile_image(frame)?).is_contact();
        self.n_free = if is_contact { 0 } else { self.n_free.saturating_add(1) };
        self.n_contact = if is_contact && agrees { self.n_contact.saturating_add(1) } else { 0 };
        if self.n_free >= N_RELEASED {
            self.is_reported = false;
        }
        Ok(self.n_contact >= N_SETTLED && !self.is_reported)
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

    #[test]
    fn pictures_of_one_touch_agree_and_a_torn_one_does_not() {
        let (rest, touch) = (frame(0, 1), frame(60, 2));
        assert!(check_agreement(&touch, &frame(60, 3)).is_ok());
        assert!(check_agreement(&rest, &touch).unwrap_err().to_string().contains("% of the pixels different"));
        // The lower half is still the picture before.
        let half = touch.rgb().len() / 2;
        let torn = Frame::new(80, 60, [&touch.rgb()[..half], &rest.rgb()[half..]].concat()).unwrap();
        assert!(check_agreement(&torn, &touch).is_err() && check_agreement(&touch, &torn).is_err());
        let dark = Frame::new(80, 60, vec![3; 14_400]).unwrap();
        assert!(check_agreement(&touch, &dark).is_err());
    }

    #[test]
    fn each_contact_settles_once() {
        let mut watch = ContactWatch::new(&frame(0, 0)).unwrap();
        let mut settled_at = Vec::new();
        let film = [0, 0, 60, 60, 60, 60, 60, 0, 60, 0, 0, 0, 60, 60, 60, 60];
        for (i, counts) in film.into_iter().enumerate() {
            let agrees = i > 0 && film[i - 1] == counts;
            if watch.settles(&frame(counts, i), agrees).unwrap() {
                settled_at.push(i);
                watch.observed();
            }
        }
        // The first of each contact does not agree with the one before; one free picture does not end a contact.
        assert_eq!(settled_at, [5, 15]);
    }
}
