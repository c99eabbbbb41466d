//! Which pixels of a frame a part touches.

use crate::error::{Error, Result};
use crate::frame::EDGE_COUNTS;

/// Changes are averaged over this many pixels either way before they count as contact, so that noise does not.
const AVERAGE_PX: usize = 2;

/// A share of a frame's pixels.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    size_px: [usize; 2],
    is_in: Vec<bool>,
}

impl Region {
    /// Takes a mark for each pixel, rows from the top; width and height as given.
    pub fn new(size_px: [usize; 2], is_in: Vec<bool>) -> Result<Self> {
        if size_px[0].checked_mul(size_px[1]) != Some(is_in.len()) || is_in.is_empty() {
            let expected = format!("{} x {} pixels", size_px[0], size_px[1]);
            return Err(Error::invalid("region", expected, is_in.len().to_string()));
        }
        Ok(Self { size_px, is_in })
    }

    /// Where what a press changed, interleaved RGB in counts, is an edge in some channel, averaged over 5 x 5 pixels.
    pub fn of_difference(size_px: [usize; 2], counts: &[f32]) -> Result<Self> {
        let [width, height] = size_px;
        if counts.len() != 3 * width * height {
            return Err(Error::invalid("region", format!("3 x {width} x {height} counts"), counts.len().to_string()));
        }
        let window = |at: usize, n: usize| at.saturating_sub(AVERAGE_PX)..(at + AVERAGE_PX + 1).min(n);
        let is_edge = |i: usize| {
            let (columns, rows) = (window(i % width, width), window(i / width, height));
            let n = (columns.len() * rows.len()) as f32;
            let mut sums = [0.0_f32; 3];
            for pixel in rows.flat_map(|y| columns.clone().map(move |x| y * width + x)) {
                sums.iter_mut().zip(&counts[3 * pixel..]).for_each(|(sum, counts)| *sum += counts);
            }
            sums.iter().any(|sum| sum.abs() > EDGE_COUNTS * n)
        };
        Self::new(size_px, (0..width * height).map(is_edge).collect())
    }

    /// Width and height of the frame, pixels.
    pub fn size_px(&self) -> [usize; 2] {
        self.size_px
    }

    /// How many pixels it has.
    pub fn n_pixels(&self) -> usize {
        self.is_in.iter().filter(|is_in| **is_in).count()
    }

    /// Distance of each pixel of the frame from the nearest pixel of the region, mm; infinite where it is empty.
    pub fn distance_mm(&self, mm_per_px: [f64; 2]) -> Vec<f64> {
        let [width, height] = self.size_px;
        // Down each column first, then the nearest along each row: exact, since the distance is Euclid's.
        let mut column_mm = vec![f64::INFINITY; width * height];
        for x in 0..width {
            let mut away = f64::INFINITY;
            for y in (0..height).chain((0..height).rev()) {
                let i = y * width + x;
                away = if self.is_in[i] { 0.0 } else { away + 1.0 };
                column_mm[i] = column_mm[i].min(away * mm_per_px[1]);
            }
        }
        let mut distance_mm = vec![f64::INFINITY; width * height];
        for (line, column_mm) in distance_mm.chunks_exact_mut(width).zip(column_mm.chunks_exact(width)) {
            for (other, down_mm) in column_mm.iter().enumerate().filter(|(_, mm)| mm.is_finite()) {
                for (x, nearest) in line.iter_mut().enumerate() {
                    *nearest = nearest.min((x.abs_diff(other) as f64 * mm_per_px[0]).hypot(*down_mm));
                }
            }
        }
        distance_mm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_to_the_nearest_pixel() {
        let marks: Vec<bool> = (0..300).map(|i| [43, 199, 211].contains(&i)).collect();
        let region = Region::new([20, 15], marks).unwrap();
        for (i, got) in region.distance_mm([0.3, 0.2]).into_iter().enumerate() {
            let to =
                |at: usize| ((i % 20).abs_diff(at % 20) as f64 * 0.3).hypot((i / 20).abs_diff(at / 20) as f64 * 0.2);
            let expected = to(43).min(to(199)).min(to(211));
            assert!((got - expected).abs() < 1e-12, "{i}: {got}, not {expected}");
        }
    }

    #[test]
    fn noise_is_no_contact_and_a_patch_is() {
        let counts = |i: usize| {
            let patch = (8..16).contains(&(i / 3 % 30)) && (6..14).contains(&(i / 90));
            // Noise of 6 counts either way, pixel by pixel, and in one channel of the patch 15 counts less.
            (if (i + i / 90).is_multiple_of(2) { 6.0 } else { -6.0 }) - if patch && i % 3 == 2 { 15.0 } else { 0.0 }
        };
        let counts: Vec<f32> = (0..30 * 20 * 3).map(counts).collect();
        let region = Region::of_difference([30, 20], &counts).unwrap();
        let patch = Region::new(
            [30, 20],
            (0..600).map(|i| (8..16).contains(&(i % 30)) && (6..14).contains(&(i / 30))).collect(),
        );
        let distance_px = patch.unwrap().distance_mm([1.0; 2]);
        // Of its 64 pixels those at the corners do not: less than half of what is round them has changed.
        assert_eq!(region.n_pixels(), 52);
        assert!(region.is_in.iter().zip(distance_px).all(|(is_in, px)| !is_in || px <= 2.0));
    }
}
