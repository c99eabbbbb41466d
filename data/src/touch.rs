//! One recorded touch: where, on what, by which side.

use serde::{Deserialize, Serialize};

use crate::se2::Se2;

/// Which half of a mating pair was touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// The female half: a recess in a plate.
    Hole,
    /// The male half: a raised face.
    Peg,
}

/// What is known of one frame of a dataset: a line of its index.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Touch {
    /// Name of the part (a letter, a board, a connector); `None` where nobody knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part: Option<String>,
    /// Which half was touched; `None` for a frame of the sensor at rest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub side: Option<Side>,
    /// Where the sensor was on the part; `None` where nobody knows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub part_from_sensor: Option<Se2>,
    /// The motion actually made since the touch before, in the sensor's frame at that touch; `None`
    /// for a first touch.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moved: Option<Se2>,
    /// The mating pair that this touch is one of: the hole and the peg of one name were touched at one place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pair: Option<String>,
    /// The episode that this touch is of: touches of one hole, in order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub episode: Option<String>,
    /// When the frame was taken, seconds on the recording's clock.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_s: Option<f64>,
}
