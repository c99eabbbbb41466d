//! A part measured or drawn as heights on a raster.

use crate::error::{Error, Result};

/// Heights of one side of a part, stored as drops below its highest point.
#[derive(Clone, Debug, PartialEq)]
pub struct HeightMap {
    size_px: [usize; 2],
    mm_per_px: [f64; 2],
    /// Where the raster's middle is in the part's frame, mm.
    centre_mm: [f64; 2],
    drops_mm: Vec<f32>,
}

impl HeightMap {
    /// Takes heights in mm, rows from the top, `size_px` columns by rows, each pixel `mm_per_px` in x and
    /// y. Refuses a size that does not fit, a pixel without size, and a height that is no number, naming
    /// its row and column.
    pub fn new(size_px: [usize; 2], mm_per_px: [f64; 2], heights_mm: &[f32]) -> Result<Self> {
        let [n_columns, n_rows] = size_px;
        let fits = n_columns >= 2 && n_rows >= 2 && n_columns.checked_mul(n_rows) == Some(heights_mm.len());
        if !fits {
            let got = format!("{n_columns}x{n_rows} and {} heights", heights_mm.len());
            return Err(Error::invalid("height map", "a height for each of 2x2 or more pixels", got));
        }
        if !mm_per_px.iter().all(|mm| mm.is_finite() && *mm > 0.0) {
            return Err(Error::invalid("height map", "a positive size of a pixel", format!("{mm_per_px:?} mm")));
        }
        if let Some(i) = heights_mm.iter().position(|height| !height.is_finite()) {
            let at = format!("height map, row {}, column {}", i / n_columns, i % n_columns);
            return Err(Error::invalid(at, "a finite height", heights_mm[i].to_string()));
        }
        let highest = heights_mm.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let drops_mm = heights_mm.iter().map(|height| highest - height).collect();
        Ok(Self { size_px, mm_per_px, centre_mm: [0.0; 2], drops_mm })
    }

    /// Columns and rows.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// Size of a pixel in x and y, mm.
    pub fn mm_per_px(&self) -> [f64; 2] {
        self.mm_per_px
    }

    /// How far each pixel is below the highest one, mm.
    pub fn drops_mm(&self) -> &[f32] {
        &self.drops_mm
    }

    /// Smallest box `[x_min, y_min, x_max, y_max]` round the pixels, mm.
    pub fn bounds(&self) -> [f64; 4] {
        let half = [0, 1].map(|axis| 0.5 * self.size_px[axis] as f64 * self.mm_per_px[axis]);
        let [x, y] = self.centre_mm;
        [x - half[0], y - half[1], x + half[0], y + half[1]]
    }

    /// The same map moved by `offset_mm`.
    pub fn shifted(mut self, offset_mm: [f64; 2]) -> Self {
        self.centre_mm = [0, 1].map(|axis| self.centre_mm[axis] + offset_mm[axis]);
        self
    }

    /// How far a point is below the highest one in mm, bilinear between the pixels' centres; none off
    /// the map.
    pub fn drop_at(&self, point_mm: [f64; 2]) -> Option<f32> {
        let [n_columns, n_rows] = self.size_px;
        let place = [0, 1].map(|axis| {
            (point_mm[axis] - self.centre_mm[axis]) / self.mm_per_px[axis] + 0.5 * self.size_px[axis] as f64 - 0.5
        });
        let on_map = |axis: usize| place[axis] >= -0.5 && place[axis] <= self.size_px[axis] as f64 - 0.5;
        if !(on_map(0) && on_map(1)) {
            return None;
        }
        let [x, y] = [place[0].clamp(0.0, (n_columns - 1) as f64), place[1].clamp(0.0, (n_rows - 1) as f64)];
        let (column, row) = ((x as usize).min(n_columns - 2), (y as usize).min(n_rows - 2));
        let (fx, fy) = ((x - column as f64) as f32, (y - row as f64) as f32);
        let at = |row: usize, column: usize| self.drops_mm[row * n_columns + column];
        let between = |row: usize| at(row, column) + fx * (at(row, column + 1) - at(row, column));
        Some(between(row) + fy * (between(row + 1) - between(row)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_is_read_back_between_its_pixels() {
        let heights: Vec<f32> = (0..12).map(|i| 0.3 * (i % 4) as f32 - 0.2 * (i / 4) as f32).collect();
        let map = HeightMap::new([4, 3], [0.5, 0.25], &heights).unwrap().shifted([1.0, -2.0]);
        for [x, y] in [[1.0, -2.0], [0.6, -2.1], [1.4, -1.8]] {
            // 0.6 mm a mm rightwards, -0.8 downwards, 0.9 at the highest pixel.
            let (column, row) = ((x - 1.0) / 0.5 + 1.5, (y + 2.0) / 0.25 + 1.0);
            let expected = 0.9 - (0.3 * column - 0.2 * row);
            assert!((f64::from(map.drop_at([x, y]).unwrap()) - expected).abs() < 1e-5);
        }
        assert_eq!(map.drop_at([2.2, -2.0]), None);
    }

    #[test]
    fn what_is_no_height_map_is_refused_by_place() {
        let error = HeightMap::new([2, 2], [0.1, 0.1], &[0.0, 1.0, f32::NAN, 0.0]).unwrap_err().to_string();
        assert!(error.contains("row 1, column 0"), "{error}");
        assert!(HeightMap::new([2, 2], [0.1, 0.0], &[0.0; 4]).is_err());
        assert!(HeightMap::new([2, 3], [0.1, 0.1], &[0.0; 4]).is_err());
    }
}
