//! The circle in which a ball touches, in pixels and in mm.

/// The narrowest contact that is looked for, as a share of the ball's radius.
pub(super) const LEAST_OF_BALL: f64 = 0.1;

/// Where a ball touches, in pixels: the middle of the frame's first pixel is `[0, 0]`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its middle.
    pub centre_px: [f64; 2],
    /// Its radius, the same along x and y.
    pub radius_px: f64,
}

/// The frame and the ball of a set of presses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressGeometry {
    /// Width and height of the frames, pixels.
    pub frame_px: [usize; 2],
    /// Size of a pixel in x and y, mm.
    pub mm_per_px: [f64; 2],
    /// The ball's radius, mm.
    pub ball_radius_mm: f64,
}

impl PressGeometry {
    /// Distance of a pixel's middle from a circle's in x and y, mm.
    pub fn from_centre_mm(&self, circle: &Circle, pixel: usize) -> [f64; 2] {
        let width = self.frame_px[0];
        let place = [(pixel % width) as f64, (pixel / width) as f64];
        [0, 1].map(|axis| (place[axis] - circle.centre_px[axis]) * self.mm_per_px[axis])
    }

    /// A circle's radius, mm.
    pub fn radius_mm(&self, circle: &Circle) -> f64 {
        circle.radius_px * self.mean_mm_per_px()
    }

    /// The ball's radius, pixels.
    pub fn ball_radius_px(&self) -> f64 {
        self.ball_radius_mm / self.mean_mm_per_px()
    }

    fn mean_mm_per_px(&self) -> f64 {
        (self.mm_per_px[0] * self.mm_per_px[1]).sqrt()
    }
}
