//! What JPEG does to a picture, without the file: its entropy coder loses nothing, so only colour
//! transform, chroma halving and quantisation are computed, a band of 16 rows at a time.

use std::ops::{Add, Mul, Sub};

use multiversion::multiversion;

use super::rounding::{round, to_byte};

/// Luminance and chrominance tables of ITU-T T.81, Annex K, at quality 50.
const LUMA: [u8; 64] = [
    16, 11, 10, 16, 24, 40, 51, 61, 12, 12, 14, 19, 26, 58, 60, 55, 14, 13, 16, 24, 40, 57, 69, 56, 14, 17, 22, 29, 51,
    87, 80, 62, 18, 22, 37, 56, 68, 109, 103, 77, 24, 35, 55, 64, 81, 104, 113, 92, 49, 64, 78, 87, 103, 121, 120, 101,
    72, 92, 95, 98, 112, 100, 103, 99,
];
const CHROMA: [u8; 64] = [
    17, 18, 24, 47, 99, 99, 99, 99, 18, 21, 26, 66, 99, 99, 99, 99, 24, 26, 56, 99, 99, 99, 99, 99, 47, 66, 99, 99, 99,
    99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99, 99,
    99, 99, 99, 99, 99, 99,
];

/// Rows and columns of what is coded together: four blocks of luminance, one of each chrominance.
const UNIT: usize = 16;

/// Passes interleaved RGB counts through JPEG of a quality in 1..=100, chroma halved in x and y, to bytes.
pub fn compress(rgb: &[f32], [width, height]: [usize; 2], quality: u8) -> Vec<u8> {
    let mut bytes = vec![0; 3 * width * height];
    let tables = [&LUMA, &CHROMA].map(|steps| Table::new(steps, quality));
    let mut band = Band::new(width);
    for top in (0..height).step_by(UNIT) {
        let rows = top * 3 * width..(top + UNIT).min(height) * 3 * width;
        pass(&rgb[rows.clone()], &mut bytes[rows], width, &mut band, &tables);
    }
    bytes
}

/// One band of a picture as planes; the last column and row are repeated up to whole units.
struct Band {
    stride: usize,
    /// Luminance less 128, 16 rows.
    luma: Vec<f32>,
    /// Blue and red chrominance, halved: 8 rows each.
    chroma: [Vec<f32>; 2],
    /// Two rows of chrominance before they are halved; then what it adds to red, green and blue.
    wide: [Vec<f32>; 4],
}

impl Band {
    fn new(width: usize) -> Self {
        let stride = width.next_multiple_of(UNIT);
        let plane = |n: usize| vec![0.0; n];
        Self {
            stride,
            luma: plane(UNIT * stride),
            chroma: [0; 2].map(|_| plane(UNIT * stride / 4)),
            wide: [0; 4].map(|_| plane(stride)),
        }
    }
}

/// Takes some rows of a picture, 16 at most, to bytes.
#[multiversion(targets("x86_64+avx2"))]
fn pass(rgb: &[f32], bytes: &mut [u8], width: usize, band: &mut Band, [luma, chroma]: &[Table; 2]) {
    let (stride, half) = (band.stride, band.stride / 2);
    let n_rows = rgb.len() / (3 * width);
    for pair in 0..UNIT / 2 {
        let [above_cb, above_cr, below_cb, below_cr] = &mut band.wide;
        for (row, cb, cr) in
            [(2 * pair, &mut *above_cb, &mut *above_cr), (2 * pair + 1, &mut *below_cb, &mut *below_cr)]
        {
            let pixels = &rgb[3 * row.min(n_rows - 1) * width..][..3 * width];
            split(pixels, &mut band.luma[row * stride..][..stride], cb, cr);
        }
        let [cb, cr] = &mut band.chroma;
        halve(above_cb, below_cb, &mut cb[pair * half..][..half]);
        halve(above_cr, below_cr, &mut cr[pair * half..][..half]);
    }
    quantize(&mut band.luma, stride, luma);
    for plane in &mut band.chroma {
        quantize(plane, half, chroma);
    }
    let [red, green, blue, _] = &mut band.wide;
    for row in 0..n_rows {
        if row % 2 == 0 {
            let [cb, cr] = &band.chroma;
            let places = row / 2 * half..(row / 2 + 1) * half;
            widen(&cb[places.clone()], &cr[places], red, green, blue);
        }
        let light = &band.luma[row * stride..][..width];
        join(light, [red, green, blue], &mut bytes[3 * row * width..][..3 * width]);
    }
}

/// A row of RGB to luminance and chrominance, the last pixel repeated.
#[inline(always)]
fn split(rgb: &[f32], luma: &mut [f32], blue: &mut [f32], red: &mut [f32]) {
    let pixels = rgb.as_chunks::<3>().0;
    let n = pixels.len();
    for (((pixel, y), cb), cr) in pixels.iter().zip(&mut *luma).zip(&mut *blue).zip(&mut *red) {
        let (r, g, b) = (pixel[0].clamp(0.0, 255.0), pixel[1].clamp(0.0, 255.0), pixel[2].clamp(0.0, 255.0));
        *y = 0.299 * r + 0.587 * g + 0.114 * b - 128.0;
        *cb = -0.168_736 * r - 0.331_264 * g + 0.5 * b;
        *cr = 0.5 * r - 0.418_688 * g - 0.081_312 * b;
    }
    for line in [luma, blue, red] {
        let last = line[n - 1];
        line[n..].fill(last);
    }
}

/// The mean of two by two pixels.
#[inline(always)]
fn halve(above: &[f32], below: &[f32], half: &mut [f32]) {
    let pairs = above.as_chunks::<2>().0.iter().zip(below.as_chunks::<2>().0);
    for (mean, (above, below)) in half.iter_mut().zip(pairs) {
        *mean = 0.25 * ((above[0] + above[1]) + (below[0] + below[1]));
    }
}

/// What chrominance adds to red, green and blue, each value for two pixels.
#[inline(always)]
fn widen(cb: &[f32], cr: &[f32], red: &mut [f32], green: &mut [f32], blue: &mut [f32]) {
    let (red, green, blue) = (red.as_chunks_mut::<2>().0, green.as_chunks_mut::<2>().0, blue.as_chunks_mut::<2>().0);
    for (i, (cb, cr)) in cb.iter().zip(cr).enumerate() {
        red[i] = [1.402 * cr; 2];
        green[i] = [-0.344_136 * cb - 0.714_136 * cr; 2];
        blue[i] = [1.772 * cb; 2];
    }
}

/// Luminance and what chrominance adds to bytes.
#[inline(always)]
fn join(luma: &[f32], [red, green, blue]: [&[f32]; 3], bytes: &mut [u8]) {
    let n = luma.len();
    let (red, green, blue) = (&red[..n], &green[..n], &blue[..n]);
    for (i, pixel) in bytes.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let light = luma[i] + 128.0;
        *pixel = [to_byte(light + red[i]), to_byte(light + green[i]), to_byte(light + blue[i])];
    }
}

/// Rounds the DCT of each 8 x 8 block of a plane to the table and transforms back.
#[inline(always)]
fn quantize(plane: &mut [f32], stride: usize, table: &Table) {
    for rows in plane.chunks_exact_mut(8 * stride) {
        for left in (0..stride).step_by(8) {
            let mut block = [Lanes([0.0; 8]); 8];
            for (lanes, line) in block.iter_mut().zip(rows.chunks_exact(stride)) {
                lanes.0.copy_from_slice(&line[left..left + 8]);
            }
            // Down the columns, then along the rows; the spectrum stays transposed.
            let mut spectrum = forward(transposed(forward(block)));
            for (lanes, (divide, multiply)) in spectrum.iter_mut().zip(table.divide.iter().zip(&table.multiply)) {
                for x in 0..8 {
                    lanes.0[x] = round(lanes.0[x] * divide.0[x]) * multiply.0[x];
                }
            }
            let block = inverse(transposed(inverse(spectrum)));
            for (lanes, line) in block.iter().zip(rows.chunks_exact_mut(stride)) {
                line[left..left + 8].copy_from_slice(&lanes.0);
            }
        }
    }
}

/// What a quality divides a block's spectrum by and multiplies it with, transposed; the scales that the
/// fast transforms leave out are folded in.
struct Table {
    divide: [Lanes; 8],
    multiply: [Lanes; 8],
}

impl Table {
    fn new(steps: &[u8; 64], quality: u8) -> Self {
        let steps = scaled(steps, quality);
        // The forward transform leaves out this factor in each direction, the inverse its reciprocal.
        let scale = |u: usize| {
            let angle = u as f64 * std::f64::consts::PI / 16.0;
            8.0_f64.sqrt() * if u == 0 { 1.0 } else { std::f64::consts::SQRT_2 * angle.cos() }
        };
        let lanes = |value: &dyn Fn(f64, f64) -> f64| {
            std::array::from_fn(|u| {
                Lanes(std::array::from_fn(|v| value(f64::from(steps[8 * v + u]), scale(u) * scale(v)) as f32))
            })
        };
        Self { divide: lanes(&|step, scale| 1.0 / (step * scale)), multiply: lanes(&|step, scale| step * scale / 64.0) }
    }
}

/// The table of a quality, as the Independent JPEG Group scales it.
fn scaled(table: &[u8; 64], quality: u8) -> [f32; 64] {
    let quality = u32::from(quality.clamp(1, 100));
    let scale = if quality < 50 { 5_000 / quality } else { 200 - 2 * quality };
    table.map(|q| ((u32::from(q) * scale + 50) / 100).clamp(1, 255) as f32)
}

/// Eight values worked on together.
#[derive(Clone, Copy, Debug)]
struct Lanes([f32; 8]);

impl Add for Lanes {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|x| self.0[x] + other.0[x]))
    }
}

impl Sub for Lanes {
    type Output = Self;

    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|x| self.0[x] - other.0[x]))
    }
}

impl Mul<f32> for Lanes {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f32) -> Self {
        Self(std::array::from_fn(|x| self.0[x] * factor))
    }
}

#[inline(always)]
fn transposed(block: [Lanes; 8]) -> [Lanes; 8] {
    std::array::from_fn(|i| Lanes(std::array::from_fn(|j| block[j].0[i])))
}

/// The 8-point DCT-II down each column with five multiplications (Arai, Agui and Nakajima 1988), each
/// result `sqrt 8` times the orthonormal transform's, all but the first another `sqrt 2 cos(u pi / 16)`
/// times.
#[inline(always)]
fn forward(d: [Lanes; 8]) -> [Lanes; 8] {
    let (s0, s1, s2, s3) = (d[0] + d[7], d[1] + d[6], d[2] + d[5], d[3] + d[4]);
    let (d0, d1, d2, d3) = (d[0] - d[7], d[1] - d[6], d[2] - d[5], d[3] - d[4]);
    let (even0, even3, even1, even2) = (s0 + s3, s0 - s3, s1 + s2, s1 - s2);
    let turned = (even2 + even3) * 0.707_106_77;
    let (odd0, odd1, odd2) = (d3 + d2, d2 + d1, d1 + d0);
    let z5 = (odd0 - odd2) * 0.382_683_43;
    let (z2, z4, z3) = (odd0 * 0.541_196_1 + z5, odd2 * 1.306_563 + z5, odd1 * 0.707_106_77);
    let (z11, z13) = (d0 + z3, d0 - z3);
    [even0 + even1, z11 + z4, even3 + turned, z13 - z2, even0 - even1, z13 + z2, even3 - turned, z11 - z4]
}

/// Undoes [`forward`] down each column, where each input was first multiplied by the factors named there.
#[inline(always)]
fn inverse(d: [Lanes; 8]) -> [Lanes; 8] {
    let (sum, difference, both) = (d[0] + d[4], d[0] - d[4], d[2] + d[6]);
    let rest = (d[2] - d[6]) * std::f32::consts::SQRT_2 - both;
    let (e0, e3, e1, e2) = (sum + both, sum - both, difference + rest, difference - rest);
    let (z13, z10, z11, z12) = (d[5] + d[3], d[5] - d[3], d[1] + d[7], d[1] - d[7]);
    let o7 = z11 + z13;
    let z5 = (z10 + z12) * 1.847_759;
    let o6 = z5 - z10 * 2.613_126 - o7;
    let o5 = (z11 - z13) * std::f32::consts::SQRT_2 - o6;
    let o4 = z5 - z12 * 1.082_392_2 - o5;
    [e0 + o7, e1 + o6, e2 + o5, e3 + o4, e3 - o4, e2 - o5, e1 - o6, e0 - o7]
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
    use image::{DynamicImage, ExtendedColorType};

    /// The orthonormal DCT-II in both directions, as matrix products.
    fn plain(block: &[[f64; 8]; 8]) -> [[f64; 8]; 8] {
        let c = |u: usize, x: usize| {
            let norm = if u == 0 { 0.125_f64.sqrt() } else { 0.5 };
            norm * ((2 * x + 1) as f64 * u as f64 * std::f64::consts::PI / 16.0).cos()
        };
        let entry = |u: usize, v: usize| {
            let terms = (0..64).map(|i| c(u, i / 8) * c(v, i % 8) * block[i / 8][i % 8]);
            terms.sum::<f64>()
        };
        std::array::from_fn(|u| std::array::from_fn(|v| entry(u, v)))
    }

    #[test]
    fn the_fast_transform_is_the_plain_one_and_comes_back() {
        let block: [[f64; 8]; 8] =
            std::array::from_fn(|y| std::array::from_fn(|x| ((37 * x + 61 * y + x * y * y) % 256) as f64 - 128.0));
        let fast = forward(transposed(forward(block.map(|row| Lanes(row.map(|value| value as f32))))));
        // Steps of 1: the table holds nothing but the scales.
        let table = Table::new(&[1; 64], 100);
        let plain = plain(&block);
        let mut spectrum = fast;
        for (u, v) in (0..64).map(|i| (i / 8, i % 8)) {
            // The spectrum is transposed.
            let got = f64::from(fast[u].0[v] * table.divide[u].0[v]);
            assert!((got - plain[v][u]).abs() < 1e-3, "{u}, {v}: {got}, not {}", plain[v][u]);
            spectrum[u].0[v] = plain[v][u] as f32 * table.multiply[u].0[v];
        }
        let back = inverse(transposed(inverse(spectrum)));
        for (row, expected) in back.iter().zip(&block) {
            assert!(row.0.iter().zip(expected).all(|(a, b)| (f64::from(*a) - b).abs() < 1e-3));
        }
    }

    /// An independent encoder and decoder. It keeps chroma whole, so a picture whose colours change
    /// slowly is compared.
    #[test]
    fn it_does_what_a_jpeg_file_does() {
        let size = [64, 48];
        let picture: Vec<f32> = (0..size[0] * size[1])
            .flat_map(|i| {
                let (x, y) = ((i % size[0]) as f32, (i / size[0]) as f32);
                [90.0 + 30.0 * (x / 9.0).sin(), 100.0 + 30.0 * (x / 9.0).sin(), 110.0 + 20.0 * (y / 12.0).cos()]
            })
            .map(f32::round)
            .collect();
        let bytes: Vec<u8> = picture.iter().map(|v| *v as u8).collect();
        let mut file = Vec::new();
        JpegEncoder::new_with_quality(&mut file, 80)
            .encode(&bytes, size[0] as u32, size[1] as u32, ExtendedColorType::Rgb8)
            .unwrap();
        let decoder = JpegDecoder::new(std::io::Cursor::new(file)).unwrap();
        let decoded = DynamicImage::from_decoder(decoder).unwrap().to_rgb8();
        let ours = compress(&picture, size, 80);
        let difference: Vec<u8> = ours.iter().zip(decoded.as_raw()).map(|(a, b)| a.abs_diff(*b)).collect();
        let mean = difference.iter().map(|d| f64::from(*d)).sum::<f64>() / difference.len() as f64;
        assert!(mean < 1.5, "mean difference {mean} counts");
        assert!(difference.iter().all(|d| *d < 12));
    }

    #[test]
    fn a_flat_picture_stays_flat_at_any_size() {
        for size in [[8, 8], [13, 5], [160, 120]] {
            let bytes = compress(&vec![100.0; 3 * size[0] * size[1]], size, 75);
            assert!(bytes.iter().all(|v| v.abs_diff(100) < 3), "{size:?}");
        }
    }
}
