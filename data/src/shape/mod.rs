//! The outlines of parts, in mm, and how they become rasters.

pub mod glyph;
pub mod height_map;
pub mod maze;
pub mod raster;
pub mod relief;

pub use height_map::HeightMap;
pub use raster::Raster;
pub use relief::{Face, Layer, Relief};

/// A closed outline: points in mm, the last joined to the first.
pub type Contour = Vec<[f64; 2]>;

/// A flat-topped part: the union of regions, seen from the sensor, x right and y down, in mm round the
/// part's centre. The same outline is a peg's face and its hole's opening.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Shape {
    /// Each region is filled by the even-odd rule, so that a contour inside another is a counter.
    pub regions: Vec<Vec<Contour>>,
}

impl Shape {
    /// Smallest box `[x_min, y_min, x_max, y_max]` round all regions, mm; noughts for an empty shape.
    pub fn bounds(&self) -> [f64; 4] {
        let points = || self.regions.iter().flatten().flatten();
        if points().next().is_none() {
            return [0.0; 4];
        }
        let low = |axis: usize| points().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        [low(0), low(1), high(0), high(1)]
    }

    /// Whether the outline looks the same after half a turn (I, N and O do), to 1 % of its area.
    pub fn is_half_turn_symmetric(&self) -> bool {
        let [x_min, y_min, x_max, y_max] = self.bounds();
        let half = [x_min, y_min, x_max, y_max].into_iter().map(f64::abs).fold(0.0, f64::max);
        if half == 0.0 {
            return true;
        }
        let values = Raster::coverage(self, 1.05 * half, half / 100.0).values;
        let differs: f32 = values.iter().zip(values.iter().rev()).map(|(a, b)| (a - b).abs()).sum();
        differs < 0.01 * values.iter().sum::<f32>()
    }

    /// Moves every point.
    pub fn map(self, move_point: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let moved = |contour: Contour| contour.into_iter().map(&move_point).collect();
        let regions = self.regions.into_iter().map(|region| region.into_iter().map(moved).collect());
        Self { regions: regions.collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn letters_that_look_alike_upside_down_are_known() {
        let symmetric: String =
            ('A'..='Z').filter(|c| glyph::glyph(*c, 32.0, 40.0).unwrap().is_half_turn_symmetric()).collect();
        // This font draws H, S, X and Z a little heavier at the foot: their halves can be told apart.
        assert_eq!(symmetric, "INO");
    }
}
