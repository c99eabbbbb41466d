//! A sensor's lamps, learnt from its touches: neither what was touched nor where need be known.
//!
//! [`Response`] says how strong each lamp is next to the others and where it shines from, about: light that fades over the frame and
//! steep walls are not in it. So it is compared with what touches of MAZE parts give under a Mini's lamps, and the lamps
//! differ from a Mini's as the two do. What this leaves open is one factor, how steep the slopes were: the lamps are taken to be as
//! strong as a Mini's on average (their geometric mean). How each lamp fades over the frame is a Mini's.

pub mod curl;

use serde::Serialize;

use crate::error::{Error, FrameFault, Result};
use crate::frame::{Background, EDGE_COUNTS, Frame, Preprocessing, TactileImage};
use crate::light::lamps::Lamps;
use crate::pose::se2::wrap_angle;
use curl::{Moments, Response};

/// Fewer touches do not show slopes in all directions.
pub const MIN_TOUCHES: usize = 20;

/// A run that has learnt from so many does not ask more of them.
pub const MOST_TOUCHES: usize = 80;

/// A touch of less than this share of edges shows no slopes.
const MIN_EDGE_SHARE: f32 = 0.02;

/// The size at which touches are looked at, pixels, as the model looks at them.
const SIZE_PX: [usize; 2] = [40, 30];

/// The response of touches under a Mini's lamps, x and y of red, green and blue, of geometric mean 1: of 2,359 simulated touches of
/// MAZE parts, holes and pegs in turn. A test of `calibrate::touches` makes it again.
const OF_A_MINI: [[f64; 2]; 3] = [[0.0676, 1.3819], [-0.8187, -0.1016], [-0.2526, -0.8389]];

/// How far lamps of other sensors are turned from a Mini's, and how much stronger they are, as a logarithm, before any touch: standard
/// deviations.
const PRIOR: Change = Change { strength: 0.3, turn_deg: 20.0 };

/// What the comparison leaves out, standard deviations: the errors on seven simulated sensors, beyond what other touches would have
/// said.
const LEFT_OUT: Change = Change { strength: 0.015, turn_deg: 3.0 };

/// The standard deviation of how strong three lamps are together, as a logarithm: that of a mean of three.
pub const TOGETHER: f64 = 0.17;

/// How one lamp differs from a Mini's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Change {
    /// How much stronger it is, the natural logarithm.
    pub strength: f64,
    /// How far it is turned, degrees from x towards y.
    pub turn_deg: f64,
}

impl Change {
    /// Strength with strength, turn with turn.
    fn with(self, other: Self, of: impl Fn(f64, f64) -> f64) -> Self {
        Self { strength: of(self.strength, other.strength), turn_deg: of(self.turn_deg, other.turn_deg) }
    }

    fn each(self, of: impl Fn(f64) -> f64) -> Self {
        self.with(self, |value, _| of(value))
    }
}

/// What touches tell of the lamps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchFit {
    /// How each lamp differs from a Mini's.
    pub changes: [Change; 3],
    /// Standard deviations of these; of how strong a lamp is next to the others, since how strong they are together ([`TOGETHER`]) no
    /// touch tells.
    pub errors: [Change; 3],
    /// Touches that show slopes.
    pub n_touches: usize,
    /// [`Response::curl_share`].
    pub curl_share: f64,
}

impl TouchFit {
    /// The lamps.
    pub fn lamps(&self) -> Lamps {
        let [strength, turn_deg] = self.factors();
        Lamps::default().varied(strength, turn_deg)
    }

    /// How many times as strong as a Mini's each lamp is, and how far it is turned, degrees.
    pub fn factors(&self) -> [[f64; 3]; 2] {
        [self.changes.map(|change| change.strength.exp()), self.changes.map(|change| change.turn_deg)]
    }

    /// A line for a person.
    pub fn line(&self) -> String {
        let lamps = ["red", "green", "blue"].into_iter().zip(self.changes);
        let lamps = lamps.map(|(name, Change { strength, turn_deg })| {
            format!("{name} {:.2} times a Mini's, turned by {turn_deg:.0} degrees", strength.exp())
        });
        format!("{} (by {} touches)", lamps.collect::<Vec<_>>().join("; "), self.n_touches)
    }
}

/// The light of a sensor, learnt from touches of anything while they come.
///
/// A run begins with a Mini's lamps; its touches ([`Self::add`]) tell the sensor's own ([`Self::learn`]): the first
/// [`MIN_TOUCHES`] that show slopes, and again whenever twice as many do, up to [`MOST_TOUCHES`].
#[derive(Clone, Debug)]
pub struct SensorLight {
    background: Background,
    field_of_view_mm: [f64; 2],
    seen: Vec<Moments>,
    n_frames: usize,
    /// Touches of the latest fit.
    n_fitted: usize,
    lamps: Option<Lamps>,
}

impl SensorLight {
    /// Nothing is known yet of a sensor at rest whose frames show `field_of_view_mm`.
    ///
    /// # Errors
    /// A frame at rest that is dark, saturated, uniform or small.
    pub fn new(no_contact: &Frame, field_of_view_mm: [f64; 2]) -> Result<Self> {
        let counts = Preprocessing { field_of_view_mm, ..Preprocessing::counts(SIZE_PX) };
        let background = Background::new(no_contact, &counts)?;
        Ok(Self { background, field_of_view_mm, seen: Vec::new(), n_frames: 0, n_fitted: 0, lamps: None })
    }

    /// The same with another frame at rest: what was learnt stays where the light does.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn with_rest(self, no_contact: &Frame) -> Result<Self> {
        let is_other = |image: TactileImage| image.edge_share >= MIN_EDGE_SHARE;
        match self.background.tactile_image(no_contact).map(is_other) {
            Ok(false) => Ok(Self { background: self.background.with_rest(no_contact)?, ..self }),
            _ => Self::new(no_contact, self.field_of_view_mm),
        }
    }

    /// Adds the frame of a touch. One that shows no edge tells nothing, and neither do a dark one and one that came before.
    ///
    /// # Errors
    /// A frame of another size than the one at rest.
    pub fn add(&mut self, frame: &Frame) -> Result<()> {
        self.n_frames += 1;
        let image = match self.background.tactile_image(frame) {
            Ok(image) => image,
            Err(error @ Error::Frame { fault: FrameFault::WrongSize { .. }, .. }) => return Err(error),
            Err(_) => return Ok(()),
        };
        if image.edge_share >= MIN_EDGE_SHARE {
            let mm_per_px = [0, 1].map(|axis| self.field_of_view_mm[axis] / SIZE_PX[axis] as f64);
            let moments = Moments::of(&image, mm_per_px);
            if !self.seen.contains(&moments) {
                self.seen.push(moments);
            }
        }
        Ok(())
    }

    /// Whether it may still learn: not after [`MOST_TOUCHES`].
    pub fn learns(&self) -> bool {
        self.n_fitted < MOST_TOUCHES
    }

    /// Fits the lamps where touches are twice as many as at the latest fit; what was found, if so. Touches that do not show the lamps
    /// change nothing.
    pub fn learn(&mut self) -> Option<TouchFit> {
        if !self.learns() || self.seen.len() < MIN_TOUCHES.max(2 * self.n_fitted) {
            return None;
        }
        self.n_fitted = self.seen.len();
        let fit = self.fit().ok()?;
        self.lamps = Some(fit.lamps());
        Some(fit)
    }

    /// The lamps that were learnt, where they were.
    pub fn lamps(&self) -> Option<&Lamps> {
        self.lamps.as_ref()
    }

    /// Fits lamps to all that was seen.
    ///
    /// # Errors
    /// Fewer than [`MIN_TOUCHES`] touches that show an edge, and touches that do not say which lamps they were lit by.
    pub fn fit(&self) -> Result<TouchFit> {
        let n_touches = self.seen.len();
        if n_touches < MIN_TOUCHES {
            let expected = format!("{MIN_TOUCHES} touches of edges or more, all over the frame");
            let got = format!("{n_touches} of {} frames that change by more than {EDGE_COUNTS} counts", self.n_frames);
            return Err(Error::invalid("calibration", expected, got));
        }
        let all = Moments::sum(&self.seen);
        let response = Response::of(&all);
        if !response.is_known() {
            let expected = "touches that show how each lamp lights slopes in all directions";
            let got = format!("slopes whose curl is {:.2} of that of other lamps", response.curl_share);
            return Err(Error::invalid("calibration", expected, got));
        }
        let told = apart(&response.lamps, &OF_A_MINI);
        let spread = self.spread(&all, &response);
        let errors = [0, 1, 2].map(|c| spread[c].with(LEFT_OUT, f64::hypot));
        let share =
            errors.map(|error| PRIOR.with(error, |prior, error| prior.powi(2) / (prior.powi(2) + error.powi(2))));
        Ok(TouchFit {
            changes: [0, 1, 2].map(|c| share[c].with(told[c], |share, told| share * told)),
            errors: [0, 1, 2].map(|c| share[c].with(errors[c], |share, error| share.sqrt() * error)),
            n_touches,
            curl_share: response.curl_share,
        })
    }

    /// Standard deviations of what the touches say, had others been made, by leaving one out at a time (the jackknife; Efron and
    /// Tibshirani, An Introduction to the Bootstrap, 11).
    fn spread(&self, all: &Moments, response: &Response) -> [Change; 3] {
        let n = self.seen.len() as f64;
        let left_out = self.seen.iter().map(|one| apart(&Response::of(&all.without(one)).lamps, &response.lamps));
        let squares = left_out.fold([Change::default(); 3], |sum, changes| {
            [0, 1, 2].map(|c| sum[c].with(changes[c], |sum, change| sum + change * change))
        });
        squares.map(|sum| sum.each(|sum| (sum * (n - 1.0) / n).sqrt()))
    }
}

/// How lamps differ from others by what both answered: as strong on average.
fn apart(lamps: &[[f64; 2]; 3], others: &[[f64; 2]; 3]) -> [Change; 3] {
    let changes = [0, 1, 2].map(|c| {
        let ([x, y], [other_x, other_y]) = (lamps[c], others[c]);
        Change {
            strength: (x.hypot(y) / other_x.hypot(other_y)).ln(),
            turn_deg: wrap_angle(y.atan2(x) - other_y.atan2(other_x)).to_degrees(),
        }
    });
    let mean = changes.iter().map(|change| change.strength).sum::<f64>() / 3.0;
    changes.map(|change| Change { strength: change.strength - mean, ..change })
}
