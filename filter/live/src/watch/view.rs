//! What the terminal shows, as plain data.

use serde::Serialize;
use tactile_data::pose::se2::Se2;

/// One moment of an episode.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct View {
    /// Time since the node started, s.
    pub time_s: f64,
    /// What the node is doing, one line.
    pub status: String,
    /// All parts, the most probable first ([`View::sort`]).
    pub parts: Vec<Part>,
    /// Where the sensor is on the likeliest part; `None` before the first touch.
    pub place: Option<Place>,
    /// The next touch, from where the sensor is; `None` where none is planned.
    pub sensor_from_next: Option<Se2>,
    /// The touches so far, refused ones among them, in order.
    pub touches: Vec<Pressed>,
    /// Entropy over all states, nats; `None` before the first touch.
    pub entropy_nats: Option<f64>,
    /// The camera.
    pub camera: Camera,
    /// What the node reports, the oldest first.
    pub messages: Vec<Message>,
    /// Why the episode is over; `None` while it runs.
    pub stop: Option<String>,
}

/// A part of the bank.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Part {
    /// Its name.
    pub name: String,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// Where the sensor may be on it; `None` where that is not known.
    pub map: Option<PlaceMap>,
}

/// How probable it is that the sensor is at an x and a y of a part now, whatever its angle.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaceMap {
    /// Cells along x, and along y; x to the right, y downwards.
    pub n_xy: usize,
    /// The centres of the outermost cells are at `-half_mm` and `half_mm`, on both axes, mm.
    pub half_mm: f64,
    /// The probability of each cell, `[n_xy, n_xy]`, y fastest; their sum is the part's probability at most.
    pub values: Vec<f64>,
}

/// Where the sensor is on the likeliest part.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Place {
    /// Name of that part.
    pub part: String,
    /// Its probability, 0..=1.
    pub probability: f64,
    /// Name of another part that it may be as well; `None` where none is worth naming.
    pub other: Option<String>,
    /// Pose of the sensor now.
    pub part_from_sensor: Se2,
    /// Standard deviation along x and along y, mm.
    pub sd_mm: [f64; 2],
    /// Standard deviation of the angle, degrees.
    pub sd_deg: f64,
}

/// A touch.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Pressed {
    /// The motion that was made since the touch before in the list; no motion for the first.
    pub moved: Se2,
    /// Share of the view that shows an edge, 0..=1; `None` where no frame could be used.
    pub edge_share: Option<f32>,
    /// Why it was not taken in; `None` where it was.
    pub refused: Option<String>,
}

/// The camera as its frames tell.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Camera {
    /// Frames in a second; `None` where none came.
    pub frames_per_s: Option<f64>,
    /// Age of the newest frame, s; `None` where none came.
    pub age_s: Option<f64>,
    /// Whether the node trusts them now.
    pub is_good: bool,
}

/// How bad something is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Level {
    /// For information.
    Info,
    /// The episode goes on, but look at it.
    Warning,
    /// Something must be done.
    Error,
}

/// What the node reports.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Message {
    /// When, as [`View::time_s`], s.
    pub time_s: f64,
    /// How bad it is.
    pub level: Level,
    /// One line.
    pub text: String,
}

impl View {
    /// Puts the most probable part first; equals stay in their order, and what is no number comes last.
    pub fn sort(&mut self) {
        let rank = |part: &Part| if part.probability.is_nan() { f64::NEG_INFINITY } else { part.probability };
        self.parts.sort_by(|a, b| rank(b).total_cmp(&rank(a)));
    }

    /// Where each touch was on the likeliest part, as far as is known now; empty before the first.
    pub fn touched(&self) -> Vec<Se2> {
        let Some(place) = &self.place else { return Vec::new() };
        let mut pose = place.part_from_sensor;
        let mut poses = Vec::with_capacity(self.touches.len());
        for touch in self.touches.iter().rev() {
            poses.push(pose);
            pose = pose * touch.moved.inverse();
        }
        poses.reverse();
        poses
    }
}

impl PlaceMap {
    /// The value at a place, interpolated between cells; 0 outside, and where a value is no probability.
    pub fn at(&self, x_mm: f64, y_mm: f64) -> f64 {
        let last = self.n_xy.saturating_sub(1) as f64;
        let index = |mm: f64| if last > 0.0 { (mm + self.half_mm) / (2.0 * self.half_mm) * last } else { 0.0 };
        let (x, y) = (index(x_mm), index(y_mm));
        let is_inside = |index: f64| (-0.5..=last + 0.5).contains(&index);
        if !is_inside(x) || !is_inside(y) {
            return 0.0;
        }
        let (x, y) = (x.clamp(0.0, last), y.clamp(0.0, last));
        let (left, top) = (x.floor(), y.floor());
        let cell = |column: f64, row: f64| {
            let index = column.min(last) as usize * self.n_xy + row.min(last) as usize;
            self.values.get(index).copied().filter(|value| value.is_finite() && *value > 0.0).unwrap_or(0.0)
        };
        let (right, below) = (x - left, y - top);
        let along = |row: f64| (1.0 - right) * cell(left, row) + right * cell(left + 1.0, row);
        (1.0 - below) * along(top) + below * along(top + 1.0)
    }

    /// The largest value; 0 for a map without one.
    pub fn largest(&self) -> f64 {
        self.values.iter().copied().filter(|value| value.is_finite()).fold(0.0, f64::max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_sorted_and_what_is_no_number_comes_last() {
        let part = |name: &str, probability| Part { name: name.into(), probability, map: None };
        let parts = vec![part("A", f64::NAN), part("B", 0.2), part("C", 0.7), part("D", 0.2)];
        let mut view = View { parts, ..View::default() };
        view.sort();
        assert_eq!(view.parts.iter().map(|part| part.name.as_str()).collect::<String>(), "CBDA");
    }

    #[test]
    fn touches_are_found_back_along_the_motions() {
        let pressed = |moved| Pressed { moved, edge_share: Some(0.2), refused: None };
        let motions = [Se2::IDENTITY, Se2::from_degrees(2.0, 0.0, 90.0), Se2::from_degrees(3.0, 0.0, 0.0)];
        let place = Place {
            part: "A".into(),
            probability: 1.0,
            other: None,
            // From (1, 1): 2 mm along x, a quarter turn from x towards y, 3 mm along what was y.
            part_from_sensor: Se2::from_degrees(3.0, 4.0, 90.0),
            sd_mm: [0.0; 2],
            sd_deg: 0.0,
        };
        let view = View { place: Some(place), touches: motions.map(pressed).to_vec(), ..View::default() };
        let expected = [Se2::new(1.0, 1.0, 0.0), Se2::from_degrees(3.0, 1.0, 90.0), Se2::from_degrees(3.0, 4.0, 90.0)];
        for (found, expected) in view.touched().iter().zip(&expected) {
            assert!(found.distance_mm(expected) < 1e-12 && (found.theta_rad - expected.theta_rad).abs() < 1e-12);
        }
        assert_eq!(view.touched().len(), 3);
    }

    #[test]
    fn a_map_is_interpolated_inside_and_zero_outside() {
        // Cells at x, y in -2, 0, 2; y runs fastest: the value 1 is at x = 0, y = 2.
        let values = vec![0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, f64::NAN, -1.0];
        let map = PlaceMap { n_xy: 3, half_mm: 2.0, values };
        assert_eq!([map.at(0.0, 2.0), map.at(0.0, 1.0), map.at(-1.0, 1.5), map.at(0.0, 2.9)], [1.0, 0.5, 0.375, 1.0]);
        assert_eq!([map.at(2.0, 0.0), map.at(0.0, 3.1), map.at(f64::NAN, 0.0), map.largest()], [0.0, 0.0, 0.0, 1.0]);
        let none = PlaceMap { n_xy: 0, half_mm: 0.0, values: Vec::new() };
        assert_eq!([none.at(0.0, 0.0), none.largest()], [0.0, 0.0]);
        assert_eq!(PlaceMap { n_xy: 1, half_mm: 0.0, values: vec![0.5] }.at(0.0, 0.0), 0.5);
    }
}
