//! Known rigs, by name.

use super::{LightRig, Quadratic, Shadow, Walls};
use crate::light::lamps::{MINI_ALONG_X, MINI_ALONG_Y};

/// What the same table leaves for walls ([`MINI_ALONG_X`](crate::light::lamps::MINI_ALONG_X)).
const TABLE_STEEP: [Quadratic; 3] = [
    [-17.5, -8.4, 22.7, 21.0, -28.7, -17.6],
    [-14.6, 3.3, -1.0, 11.5, 12.8, -11.9],
    [-32.7, 3.8, -7.7, 13.0, 19.0, 26.8],
];
const TABLE_ACROSS: [Quadratic; 3] =
    [[-7.3, 5.8, -2.5, 1.9, 18.3, 13.1], [2.1, 0.7, -0.0, 0.6, 4.6, -3.0], [0.6, -0.7, -0.2, 0.1, -11.0, -5.3]];
const TABLE_DIAGONAL: [Quadratic; 3] =
    [[9.1, -9.3, 0.9, -14.7, 7.4, -5.6], [-3.1, 1.5, 4.1, 1.7, 9.9, 4.0], [-3.4, 6.5, 1.3, 3.4, 16.6, -3.3]];

/// A GelSight Mini as its calibration table has it, walls included.
pub(super) fn mini_by_table() -> LightRig {
    LightRig {
        at_rest: super::MINI_AT_REST,
        along_x: MINI_ALONG_X,
        along_y: MINI_ALONG_Y,
        walls: Some(Walls { steep: TABLE_STEEP, across: TABLE_ACROSS, diagonal: TABLE_DIAGONAL }),
        pressed: None,
        shadow: Shadow::default(),
    }
}
