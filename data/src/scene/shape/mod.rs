//! The outlines of parts, in mm, and how they become rasters.

mod clip;
pub mod connector;
pub mod crossing;
mod curve;
pub mod file;
mod fit;
pub mod glyph;
pub mod height_map;
pub mod heights;
mod island;
pub mod level_line;
pub mod maze;
pub mod maze_part;
pub mod outline;
pub mod raster;
pub mod relief;
pub mod solid;
pub mod stl;
pub mod svg;
mod symmetry;

pub use height_map::HeightMap;
pub use raster::Raster;
pub use relief::{Face, Layer, Relief, Rounding};
pub use solid::Solid;

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
    /// Smallest box `[x_min, y_min, x_max, y_max]` round all regions, mm; zeros for an empty shape.
    pub fn bounds(&self) -> [f64; 4] {
        let points = || self.regions.iter().flatten().flatten();
        if points().next().is_none() {
            return [0.0; 4];
        }
        let low = |axis: usize| points().map(|p| p[axis]).fold(f64::INFINITY, f64::min);
        let high = |axis: usize| points().map(|p| p[axis]).fold(f64::NEG_INFINITY, f64::max);
        [low(0), low(1), high(0), high(1)]
    }

    /// The same shape centred on its own box, whose longer side is `long_mm`.
    pub(crate) fn scaled_to(self, long_mm: f64) -> Self {
        let [x_min, y_min, x_max, y_max] = self.bounds();
        let scale = long_mm / (x_max - x_min).max(y_max - y_min);
        let middle = [0.5 * (x_min + x_max), 0.5 * (y_min + y_max)];
        self.map(|[x, y]| [scale * (x - middle[0]), scale * (y - middle[1])])
    }

    /// The same shape centred on its own box.
    pub(crate) fn centred(self) -> Self {
        let [x_min, y_min, x_max, y_max] = self.bounds();
        let middle = [0.5 * (x_min + x_max), 0.5 * (y_min + y_max)];
        self.map(|[x, y]| [x - middle[0], y - middle[1]])
    }

    /// Moves every point.
    pub fn map(self, move_point: impl Fn([f64; 2]) -> [f64; 2]) -> Self {
        let moved = |contour: Contour| contour.into_iter().map(&move_point).collect();
        let regions = self.regions.into_iter().map(|region| region.into_iter().map(moved).collect());
        Self { regions: regions.collect() }
    }
}
