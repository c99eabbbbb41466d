//! Random crop and flips, the same for both images of a pair (paper, Sec. V-A). [`crate::relighting`] corrects the
//! light of a flipped image.

use rand::{Rng, RngExt};
use tactile_data::frame::TactileImage;

/// One drawn augmentation: the same for a hole image and its peg image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Augmentation {
    /// Mirror left and right.
    pub flip_x: bool,
    /// Mirror top and bottom.
    pub flip_y: bool,
    /// Share of each side that the crop keeps, 0..=1.
    pub scale: f32,
    /// Position of the crop: the share of what is cut off that is cut off at the left and at the top, 0..=1.
    pub offset: [f32; 2],
}

impl Augmentation {
    /// Changes nothing.
    pub const NONE: Self = Self { flip_x: false, flip_y: false, scale: 1.0, offset: [0.0; 2] };

    /// Draws flips with probability one half each and a crop that keeps at least `min_scale` of each side.
    /// Without `flips` the crops are the same as with them.
    pub fn draw(rng: &mut impl Rng, min_scale: f32, flips: bool) -> Self {
        let [flip_x, flip_y]: [bool; 2] = [rng.random(), rng.random()];
        Self {
            flip_x: flips && flip_x,
            flip_y: flips && flip_y,
            scale: min_scale + (1.0 - min_scale) * rng.random::<f32>(),
            offset: [rng.random(), rng.random()],
        }
    }

    /// Crops, resizes to `size_px` and mirrors. `image` may be of any size; areas are averaged over
    /// 2 x 2 bilinear samples per output pixel, which is enough for a reduction by two.
    ///
    /// Appends `[3, height, width]` values to `out`.
    pub fn apply(&self, image: &TactileImage, size_px: [usize; 2], out: &mut Vec<f32>) {
        let taps = [0, 1].map(|axis| {
            let flip = [self.flip_x, self.flip_y][axis];
            self.taps(axis, image.size_px[axis], size_px[axis], flip)
        });
        let [width, height] = image.size_px;
        for plane in image.planes.chunks_exact(width * height) {
            for rows in taps[1].chunks_exact(2) {
                for columns in taps[0].chunks_exact(2) {
                    let mut sum = 0.0;
                    for row in rows {
                        let (upper, lower) = (&plane[row.low * width..], &plane[row.high * width..]);
                        for column in columns {
                            let mix =
                                |line: &[f32]| line[column.low] + column.share * (line[column.high] - line[column.low]);
                            let (top, bottom) = (mix(upper), mix(lower));
                            sum += top + row.share * (bottom - top);
                        }
                    }
                    out.push(0.25 * sum);
                }
            }
        }
    }

    /// Where the crop begins along an axis of `n_in` pixels, and how much of it there is, pixels.
    pub fn crop(&self, axis: usize, n_in: usize) -> [f32; 2] {
        let span = self.scale * n_in as f32;
        [self.offset[axis] * (n_in as f32 - span), span]
    }

    /// Two sample positions along one axis for each output pixel.
    fn taps(&self, axis: usize, n_in: usize, n_out: usize, flip: bool) -> Vec<Tap> {
        let [start, span] = self.crop(axis, n_in);
        let mut taps: Vec<Tap> = (0..2 * n_out)
            .map(|i| {
                let place = start + span * (i as f32 + 0.5) / (2 * n_out) as f32 - 0.5;
                let place = place.clamp(0.0, (n_in - 1) as f32);
                let low = place as usize;
                Tap { low, high: (low + 1).min(n_in - 1), share: place - low as f32 }
            })
            .collect();
        if flip {
            taps.reverse();
        }
        taps
    }
}

#[derive(Clone, Copy)]
struct Tap {
    low: usize,
    high: usize,
    share: f32,
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: usize, height: usize) -> TactileImage {
        let plane = |c: usize| (0..width * height).map(move |i| (i % width + 10 * (i / width) + 100 * c) as f32);
        TactileImage { size_px: [width, height], planes: (0..3).flat_map(plane).collect(), edge_share: 0.0 }
    }

    #[test]
    fn no_augmentation_halves_by_area() {
        let mut out = Vec::new();
        Augmentation::NONE.apply(&ramp(8, 4), [4, 2], &mut out);
        // The first output pixel is the mean of inputs (0, 0), (1, 0), (0, 1), (1, 1): 0, 1, 10, 11.
        assert_eq!(out.len(), 3 * 8);
        assert!((out[0] - 5.5).abs() < 1e-5 && (out[8] - 105.5).abs() < 1e-4);
    }

    #[test]
    fn flipping_mirrors_each_row() {
        let (mut plain, mut flipped) = (Vec::new(), Vec::new());
        Augmentation::NONE.apply(&ramp(8, 4), [4, 2], &mut plain);
        Augmentation { flip_x: true, ..Augmentation::NONE }.apply(&ramp(8, 4), [4, 2], &mut flipped);
        for (row, mirrored) in plain.chunks(4).zip(flipped.chunks(4)) {
            assert!(row.iter().rev().zip(mirrored).all(|(a, b)| (a - b).abs() < 1e-5));
        }
    }

    #[test]
    fn a_crop_of_half_magnifies_twice() {
        let mut out = Vec::new();
        Augmentation { scale: 0.5, ..Augmentation::NONE }.apply(&ramp(8, 8), [4, 4], &mut out);
        // Four outputs span four inputs: one input pixel apart.
        assert!((out[1] - out[0] - 1.0).abs() < 0.3, "{out:?}");
    }
}
