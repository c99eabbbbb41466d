//! The cheapest tier: where a part touches the gel, and nothing else.

use multiversion::multiversion;

use super::obstacle::{Cells, obstacle};
use super::rounding::to_whole;
use crate::dataset::touch::Side;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::pose::se2::Se2;
use crate::scene::shape::Relief;

/// Side of a cell, mm: below a pixel of the Mini's full frame.
const CELL_MM: f64 = 0.05;

/// Cells along a side at most; a larger board takes larger cells.
const MOST_CELLS: f64 = 4_096.0;

/// Grey where the part is not touched and where it is, counts.
const LEVELS: [u8; 2] = [60, 200];

/// Which cells of one side of a part touch the gel.
#[derive(Clone, Debug, PartialEq)]
pub struct ContactMask {
    n: usize,
    cell_mm: f64,
    /// Grey levels, rows from the top.
    greys: Vec<u8>,
}

impl ContactMask {
    /// Computes what is touched within `half_mm` of the part's centre by a press of `depth_mm`.
    pub fn new(reliefs: &[Relief], side: Side, half_mm: f64, depth_mm: f64) -> Result<Self> {
        if !(0.5..=500.0).contains(&half_mm) {
            return Err(Error::invalid("contact mask", "0.5 to 500 mm", format!("{half_mm} mm")));
        }
        let cell_mm = CELL_MM.max(2.0 * half_mm / MOST_CELLS);
        let board = obstacle(reliefs, side, Cells { half_mm, cell_mm }, None, depth_mm);
        let greys = board.values.iter().map(|depth| LEVELS[usize::from(*depth > 0.0)]).collect();
        Ok(Self { n: board.n, cell_mm, greys })
    }

    /// The frame that a sensor at `part_from_sensor` takes: the cell under the middle of each pixel. Beyond
    /// the mask its border is repeated.
    pub fn view(&self, part_from_sensor: &Se2, [width, height]: [usize; 2], mm_per_px: [f64; 2]) -> Frame {
        let (sin, cos) = part_from_sensor.theta_rad.sin_cos();
        let step = [cos * mm_per_px[0] / self.cell_mm, sin * mm_per_px[0] / self.cell_mm].map(|v| v as f32);
        let mut rgb = vec![0; 3 * width * height];
        for (row, line) in rgb.chunks_exact_mut(3 * width).enumerate() {
            let y_mm = (row as f64 - 0.5 * (height - 1) as f64) * mm_per_px[1];
            let x_mm = -0.5 * (width - 1) as f64 * mm_per_px[0];
            let first =
                part_from_sensor.apply([x_mm, y_mm]).map(|mm| (mm / self.cell_mm + 0.5 * self.n as f64 - 0.5) as f32);
            look_up(line, &self.greys, self.n, first, step);
        }
        marked(rgb, [width, height])
    }
}

/// The frame of a sensor that nothing touches.
pub fn at_rest([width, height]: [usize; 2]) -> Frame {
    marked(vec![LEVELS[0]; 3 * width * height], [width, height])
}

/// A grey picture as a frame. Its first pixel is another grey than all others at rest: a constant frame is
/// a broken camera.
pub fn marked(mut rgb: Vec<u8>, [width, height]: [usize; 2]) -> Frame {
    rgb[..3].fill(90);
    Frame::from_parts(width, height, rgb)
}

/// Fills a row of pixels from the cells along a line that starts at `first` and continues by `step`, in cells.
#[multiversion(targets("x86_64+avx2"))]
fn look_up(line: &mut [u8], greys: &[u8], n: usize, first: [f32; 2], step: [f32; 2]) {
    const LANES: usize = 16;
    let (last, n) = (n as f32 - 1.0, n as i32);
    for (group, pixels) in line.chunks_mut(3 * LANES).enumerate() {
        let mut cells = [0; LANES];
        for (lane, cell) in cells.iter_mut().enumerate() {
            let t = (LANES * group + lane) as i32 as f32;
            let (x, y) = ((first[0] + t * step[0]).clamp(0.0, last), (first[1] + t * step[1]).clamp(0.0, last));
            *cell = to_whole(y) * n + to_whole(x);
        }
        for (pixel, cell) in pixels.as_chunks_mut::<3>().0.iter_mut().zip(cells) {
            *pixel = [greys[cell as usize]; 3];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::Shape;

    #[test]
    fn a_turned_bar_is_where_it_must_be() {
        let bar = Shape { regions: vec![vec![vec![[0.0, -1.0], [5.0, -1.0], [5.0, 1.0], [0.0, 1.0]]]] };
        let mask = ContactMask::new(&[Relief::peg(bar)], Side::Peg, 15.0, 0.5).unwrap();
        let pose = Se2::from_degrees(0.7, -0.4, 63.0);
        let frame = mask.view(&pose, [60, 40], [0.2, 0.25]);
        for (i, pixel) in frame.rgb().as_chunks::<3>().0.iter().enumerate().skip(1) {
            let [x, y] = pose.apply([((i % 60) as f64 - 29.5) * 0.2, ((i / 60) as f64 - 19.5) * 0.25]);
            let outside = (-x).max(x - 5.0).max(y.abs() - 1.0);
            // Within a cell's diagonal of the outline either grey is right.
            if outside.abs() > 0.08 {
                assert_eq!(*pixel, [LEVELS[usize::from(outside < 0.0)]; 3], "{x} {y}");
            }
        }
    }
}
