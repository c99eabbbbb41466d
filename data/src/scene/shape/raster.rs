//! Outlines on a square raster: as coverage, and as distance.

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

    /// Signed distance of each cell's centre to the outline in mm, negative inside, no further than
    /// `limit_mm`, over `-half_mm..half_mm` in x and y. Exact outside, also where regions overlap.
    pub fn distance(shape: &Shape, half_mm: f64, cell_mm: f64, limit_mm: f64) -> Self {
        let n = (2.0 * half_mm / cell_mm).ceil() as usize;
        let first_mm = 0.5 * (1.0 - n as f64) * cell_mm;
        let centre = |i: usize| first_mm + i as f64 * cell_mm;
        // The cells whose centres are within the limit of an interval.
        let near = |low: f64, high: f64| {
            let first = ((low - limit_mm - first_mm) / cell_mm).ceil().clamp(0.0, n as f64) as usize;
            let last = ((high + limit_mm - first_mm) / cell_mm + 1.0).floor().clamp(0.0, n as f64) as usize;
            first..last.max(first)
        };
        let mut values = vec![limit_mm as f32; n * n];
        let mut away = vec![0.0_f32; n * n];
        for region in &shape.regions {
            let range = |axis: usize| {
                let ends = region.iter().flatten().map(|p| p[axis]);
                ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
            };
            let (columns, rows) = (near(range(0).0, range(0).1), near(range(1).0, range(1).1));
            for row in rows.clone() {
                away[row * n..][columns.clone()].fill((limit_mm * limit_mm) as f32);
            }
            for [a, b] in sides(region) {
                let along = [b[0] - a[0], b[1] - a[1]];
                let length_squared = (along[0] * along[0] + along[1] * along[1]).max(1e-18);
                for row in near(a[1].min(b[1]), a[1].max(b[1])) {
                    for column in near(a[0].min(b[0]), a[0].max(b[0])) {
                        let (x, y) = (centre(column) - a[0], centre(row) - a[1]);
                        let t = ((x * along[0] + y * along[1]) / length_squared).clamp(0.0, 1.0);
                        let squared = (x - t * along[0]).powi(2) + (y - t * along[1]).powi(2);
                        let cell = &mut away[row * n + column];
                        *cell = cell.min(squared as f32);
                    }
                }
            }
            for row in rows {
                let crossings = crossings(region, centre(row));
                for column in columns.clone() {
                    let inside = crossings.partition_point(|x| *x <= centre(column)) % 2 == 1;
                    let distance = away[row * n + column].sqrt();
                    let value = &mut values[row * n + column];
                    *value = value.min(if inside { -distance } else { distance });
                }
            }
        }
        Self { n, cell_mm, values }
    }
}

/// The sides of a region's contours, each from point to point.
pub(super) fn sides(region: &[super::Contour]) -> impl Iterator<Item = [[f64; 2]; 2]> {
    region.iter().flat_map(|contour| (0..contour.len()).map(|i| [contour[i], contour[(i + 1) % contour.len()]]))
}

/// Where a horizontal line crosses the outlines of a region, sorted.
fn crossings(region: &[super::Contour], y: f64) -> Vec<f64> {
    let crossing = sides(region).filter(|[a, b]| (a[1] <= y) != (b[1] <= y));
    let mut xs: Vec<f64> = crossing.map(|[a, b]| a[0] + (y - a[1]) / (b[1] - a[1]) * (b[0] - a[0])).collect();
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
        // 2.35 mm is between cell borders in x; in y a quarter of a cell is the raster's own step.
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
    fn distance_to_overlapping_squares_is_that_to_their_union() {
        let mut shape = square(1.03);
        shape
            .regions
            .push(square(1.03).regions[0].iter().map(|c| c.iter().map(|p| [p[0] + 1.5, p[1]]).collect()).collect());
        let raster = Raster::distance(&shape, 4.0, 0.1, 0.8);
        for (i, got) in raster.values.iter().enumerate() {
            let [x, y] = [i % 80, i / 80].map(|k| (k as f64 - 39.5) * 0.1);
            let (dx, dy) = ((x - 0.75).abs() - 1.78, y.abs() - 1.03);
            let inside = dx < 0.0 && dy < 0.0;
            assert_eq!(*got < 0.0, inside, "{x} {y}");
            let expected = dx.max(0.0).hypot(dy.max(0.0)).min(0.8);
            assert!(inside || (f64::from(*got) - expected).abs() < 1e-5, "{x} {y}: {got}, not {expected}");
        }
    }
}
