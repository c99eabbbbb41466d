//! The kernel that crops, flips, relights and tints pictures which are on the card.

use burn_cubecl::cubecl;
use cubecl::prelude::*;

/// Values are kept as whole numbers of 16 bits, this many to one.
pub const STEPS_A_UNIT: f32 = 1024.0;

/// Numbers that say how a picture is changed: for columns and rows the first place and the step between places, in pixels
/// of the wide picture, and whether they go backwards; the relighting, 3 x 4; the field, 3 x 5.
pub const N_PARAMETERS: usize = 6 + 12 + 15;

/// Sizes of the pictures, known when the kernel is compiled, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Sizes {
    /// Width and height of the pictures on the card.
    pub wide: [usize; 2],
    /// Width and height of the network's input.
    pub input: [usize; 2],
    /// Words of one picture.
    pub words: usize,
}

/// Pictures `[n, height, width, 3]` of those `picks` that are among `frames`, the card's pictures from number `first` on; the
/// others stay as they are. One thread a pixel.
#[cube(launch)]
pub fn augment(
    frames: &[i32],
    picks: &[i32],
    parameters: &[f32],
    images: &mut [f32],
    first: i32,
    #[comptime] s: Sizes,
) {
    let at = ABSOLUTE_POS;
    let n_pixels = comptime![s.input[0] * s.input[1]];
    let row = at / n_pixels;
    let n_frames = (frames.len() / s.words) as i32;
    if at < images.len() / 3 && picks[row] >= first && picks[row] < first + n_frames {
        let frame = (picks[row] - first) as usize * s.words;
        let p = row * N_PARAMETERS;
        let x = at % comptime![s.input[0]];
        let y = at % n_pixels / comptime![s.input[0]];
        let mut red = 0.0f32;
        let mut green = 0.0f32;
        let mut blue = 0.0f32;
        #[unroll]
        for tap in 0..4usize {
            let (low_x, high_x, share_x) =
                place(2 * x + tap % 2, parameters, p, comptime![s.input[0]], comptime![s.wide[0]]);
            let (low_y, high_y, share_y) =
                place(2 * y + tap / 2, parameters, p + 3, comptime![s.input[1]], comptime![s.wide[1]]);
            #[unroll]
            for channel in 0..3usize {
                let upper = (channel * comptime![s.wide[1]] + low_y) * comptime![s.wide[0]];
                let lower = (channel * comptime![s.wide[1]] + high_y) * comptime![s.wide[0]];
                let a = value(frames, frame, upper + low_x);
                let b = value(frames, frame, upper + high_x);
                let c = value(frames, frame, lower + low_x);
                let d = value(frames, frame, lower + high_x);
                let top = a + share_x * (b - a);
                let bottom = c + share_x * (d - c);
                let mixed = 0.25f32 * (top + share_y * (bottom - top));
                if channel == 0 {
                    red += mixed;
                } else if channel == 1 {
                    green += mixed;
                } else {
                    blue += mixed;
                }
            }
        }
        // -1..=1 over the picture.
        let u = (f32::cast_from(x) + 0.5f32) / comptime![s.input[0] as f32] * 2.0f32 - 1.0f32;
        let v = (f32::cast_from(y) + 0.5f32) / comptime![s.input[1] as f32] * 2.0f32 - 1.0f32;
        let third = comptime![1.0f32 / 3.0];
        #[unroll]
        for channel in 0..3usize {
            let light = p + 6 + 4 * channel;
            let field = p + 18 + 5 * channel;
            let lit = parameters[light] * red
                + parameters[light + 1] * green
                + parameters[light + 2] * blue
                + parameters[light + 3];
            let tint = parameters[field] * u
                + parameters[field + 1] * v
                + parameters[field + 2] * (u * u - third)
                + parameters[field + 3] * u * v
                + parameters[field + 4] * (v * v - third);
            images[3 * at + channel] = lit + tint;
        }
    }
}

/// The two pixels between which output `index` of an axis is taken, and the share of the second.
#[cube]
fn place(
    index: usize,
    parameters: &[f32],
    p: usize,
    #[comptime] n_out: usize,
    #[comptime] n_wide: usize,
) -> (usize, usize, f32) {
    let mut index = index;
    if parameters[p + 2] > 0.0 {
        index = comptime![2 * n_out - 1] - index;
    }
    let place = parameters[p] + parameters[p + 1] * (f32::cast_from(index) + 0.5f32) - 0.5f32;
    let place = place.max(0.0f32).min(comptime![(n_wide - 1) as f32]);
    let low = usize::cast_from(place);
    let high = (low + 1).min(comptime![n_wide - 1]);
    (low, high, place - f32::cast_from(low))
}

/// Value `at` of a picture: two of them are in a word, the first in its lower half.
#[cube]
fn value(frames: &[i32], frame: usize, at: usize) -> f32 {
    let word = frames[frame + at / 2];
    let mut whole = (word << 16) >> 16;
    if at % 2 == 1 {
        whole = word >> 16;
    }
    f32::cast_from(whole) * comptime![1.0f32 / STEPS_A_UNIT]
}
