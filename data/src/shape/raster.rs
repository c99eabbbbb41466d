//! Outlines as coverage on a square raster.

use super::Shape;

/// Values on a square raster of cells, centred on a part: `values[row * n + column]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Raster {
    /// Cells along a side.
    pub n: usize,
    /// Side of a cell, mm.
    pub cell_mm: f64,
    /// One value a cell, rows from the top.
    pub values: Vec<f32>,
}

/// Lines a row of cells is cut into; along a line coverage is exact.
const LINES: usize = 4;

impl Raster {
    /// Share of each cell that a shape covers, 0..=1, over `-half_mm..half_mm` in x and y.
    pub fn coverage(shape: &Shape, half_mm: f64, cell_mm: f64) -> Self {
        let n = (2.0 * half_mm / cell_mm).ceil() as usize;
        let origin = -0.5 * n as f64 * cell_mm;
        let mut values = vec![0.0_f32; n * n];
        let mut line = vec![0.0_f32; n];
        for region in &shape.regions {
            let ys = || region.iter().flatten().map(|p| (p[1] - origin) / cell_mm);
            let first = ys().fold(f64::INFINITY, f64::min).max(0.0) as usize;
            let last = (ys().fold(f64::NEG_INFINITY, f64::max).ceil().max(0.0) as usize).min(n);
            for row in first..last {
                line.fill(0.0);
                for sub in 0..LINES {
                    let y = row as f64 + (sub as f64 + 0.5) / LINES as f64;
                    let mut crossings = crossings(region, y * cell_mm + origin);
                    crossings.iter_mut().for_each(|x| *x = ((*x - origin) / cell_mm).clamp(0.0, n as f64));
                    for span in crossings.chunks_exact(2) {
                        fill(&mut line, span[0], span[1]);
                    }
                }
                // Regions overlap: what one covers another cannot cover again.
                for (value, covered) in values[row * n..(row + 1) * n].iter_mut().zip(&line) {
                    *value = value.max(covered / LINES as f32);
                }
            }
        }
        Self { n, cell_mm, values }
    }

    /// Grows what is covered by `distance_mm` on every side: the largest value within that distance.
    pub fn dilated(&self, distance_mm: f64) -> Self {
        let reach = distance_mm / self.cell_mm;
        let whole = reach.floor() as isize;
        let n = self.n as isize;
        let offsets: Vec<(isize, isize)> = (-whole..=whole)
            .flat_map(|dy| (-whole..=whole).map(move |dx| (dx, dy)))
            .filter(|(dx, dy)| (dx * dx + dy * dy) as f64 <= reach * reach)
            .collect();
        let mut values = self.values.clone();
        for y in 0..n {
            for x in 0..n {
                let near = offsets.iter().map(|(dx, dy)| ((x + dx).clamp(0, n - 1), (y + dy).clamp(0, n - 1)));
                let largest = near.map(|(x, y)| self.values[(y * n + x) as usize]).fold(0.0, f32::max);
                values[(y * n + x) as usize] = largest;
            }
        }
        Self { values, ..*self }
    }
}

/// Where a horizontal line crosses the outlines of a region, sorted.
fn crossings(region: &[super::Contour], y: f64) -> Vec<f64> {
    let mut xs = Vec::new();
    for contour in region {
        for (i, a) in contour.iter().enumerate() {
            let b = &contour[(i + 1) % contour.len()];
            if (a[1] <= y) != (b[1] <= y) {
                xs.push(a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0]));
            }
        }
    }
    xs.sort_by(f64::total_cmp);
    xs
}

/// Adds the coverage of `start..end`, in cells, to a line.
fn fill(line: &mut [f32], start: f64, end: f64) {
    let (first, last) = (start as usize, end as usize);
    if first == last {
        if let Some(cell) = line.get_mut(first) {
            *cell += (end - start) as f32;
        }
        return;
    }
    line[first] += (first as f64 + 1.0 - start) as f32;
    line[first + 1..last].iter_mut().for_each(|cell| *cell += 1.0);
    if let Some(cell) = line.get_mut(last) {
        *cell += (end - last as f64) as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(half: f64) -> Shape {
        Shape { regions: vec![vec![vec![[-half, -half], [half, -half], [half, half], [-half, half]]]] }
    }

    fn area(raster: &Raster) -> f64 {
        raster.values.iter().map(|v| f64::from(*v)).sum::<f64>() * raster.cell_mm.powi(2)
    }

    #[test]
    fn covered_area_is_the_polygons_area() {
        // 2.35 mm lies between cell borders in x; in y a quarter of a cell is the raster's own step.
        let raster = Raster::coverage(&square(2.35), 5.0, 0.1);
        assert!((area(&raster) - 4.7 * 4.7).abs() < 0.12, "{}", area(&raster));
    }

    #[test]
    fn overlapping_regions_cover_once() {
        let mut shape = square(1.0);
        shape.regions.push(square(1.0).regions[0].clone());
        assert_eq!(Raster::coverage(&shape, 2.0, 0.1), Raster::coverage(&square(1.0), 2.0, 0.1));
    }

    #[test]
    fn a_counter_is_empty() {
        let mut shape = square(2.0);
        shape.regions[0].push(square(1.0).regions[0][0].clone());
        assert!((area(&Raster::coverage(&shape, 3.0, 0.1)) - (16.0 - 4.0)).abs() < 0.05);
    }

    #[test]
    fn dilating_a_square_grows_each_side() {
        let grown = Raster::coverage(&square(1.0), 3.0, 0.1).dilated(0.2);
        // 2.4 x 2.4 less what rounded corners lack.
        assert!((area(&grown) - (2.4 * 2.4 - 0.2 * 0.2)).abs() < 0.1, "{}", area(&grown));
    }
}
