//! A value between the four of a raster that are round a place.

/// Four values round a place in a raster, and how much each counts.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corners {
    pub(super) at: [usize; 4],
    pub(super) across: f32,
    pub(super) down: f32,
}

impl Corners {
    /// `place`: column and row, within the raster of `width` and `height`.
    #[inline(always)]
    pub(super) fn of(place: [f64; 2], [width, height]: [usize; 2]) -> Self {
        let first = |place: f64, n: usize| (place as usize).min(n.saturating_sub(2));
        let (left, top) = (first(place[0], width), first(place[1], height));
        let first = top * width + left;
        let at = [first, first + 1, first + width, first + width + 1];
        Self { at, across: (place[0] - left as f64) as f32, down: (place[1] - top as f64) as f32 }
    }

    #[inline(always)]
    pub(super) fn between(&self, value: impl Fn(usize) -> f32) -> f32 {
        let [a, b, c, d] = self.at;
        (1.0 - self.down) * ((1.0 - self.across) * value(a) + self.across * value(b))
            + self.down * ((1.0 - self.across) * value(c) + self.across * value(d))
    }
}
