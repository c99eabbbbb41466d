//! What JPEG does to a picture, without the file: its entropy coder loses nothing, so only colour
//! transform, chroma halving and quantisation are computed.

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

/// Passes interleaved RGB counts through JPEG of a quality in 1..=100, chroma halved in x and y.
pub fn compress(rgb: &mut [f32], [width, height]: [usize; 2], quality: u8) {
    let mut planes = [vec![0.0; width * height], vec![0.0; width * height], vec![0.0; width * height]];
    for (i, pixel) in rgb.as_chunks::<3>().0.iter().enumerate() {
        let [r, g, b] = pixel.map(|v| v.clamp(0.0, 255.0));
        planes[0][i] = 0.299 * r + 0.587 * g + 0.114 * b - 128.0;
        planes[1][i] = -0.168_736 * r - 0.331_264 * g + 0.5 * b;
        planes[2][i] = 0.5 * r - 0.418_688 * g - 0.081_312 * b;
    }
    let cosines = cosines();
    let [luma, blue, red] = &mut planes;
    quantize(luma, [width, height], &scaled(&LUMA, quality), &cosines);
    let half = [width.div_ceil(2), height.div_ceil(2)];
    for plane in [&mut *blue, &mut *red] {
        let mut small = halve(plane, [width, height]);
        quantize(&mut small, half, &scaled(&CHROMA, quality), &cosines);
        for (i, value) in plane.iter_mut().enumerate() {
            *value = small[i / width / 2 * half[0] + i % width / 2];
        }
    }
    for (i, pixel) in rgb.as_chunks_mut::<3>().0.iter_mut().enumerate() {
        let (y, cb, cr) = (luma[i] + 128.0, blue[i], red[i]);
        *pixel = [y + 1.402 * cr, y - 0.344_136 * cb - 0.714_136 * cr, y + 1.772 * cb];
    }
}

/// The table of a quality, as the Independent JPEG Group scales it.
fn scaled(table: &[u8; 64], quality: u8) -> [f32; 64] {
    let quality = u32::from(quality.clamp(1, 100));
    let scale = if quality < 50 { 5_000 / quality } else { 200 - 2 * quality };
    table.map(|q| ((u32::from(q) * scale + 50) / 100).clamp(1, 255) as f32)
}

/// `cosines[u][x]` of the orthonormal 8-point DCT-II.
fn cosines() -> [[f32; 8]; 8] {
    std::array::from_fn(|u| {
        std::array::from_fn(|x| {
            let angle = (2 * x + 1) as f64 * u as f64 * std::f64::consts::PI / 16.0;
            let norm = if u == 0 { 0.125_f64.sqrt() } else { 0.5 };
            (norm * angle.cos()) as f32
        })
    })
}

fn halve(plane: &[f32], [width, height]: [usize; 2]) -> Vec<f32> {
    let half = [width.div_ceil(2), height.div_ceil(2)];
    let at = |x: usize, y: usize| plane[y.min(height - 1) * width + x.min(width - 1)];
    (0..half[0] * half[1])
        .map(|i| {
            let (x, y) = (2 * (i % half[0]), 2 * (i / half[0]));
            0.25 * (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1))
        })
        .collect()
}

/// Rounds each 8 x 8 block's DCT to the table and transforms back; edges repeat the last pixel.
fn quantize(plane: &mut [f32], [width, height]: [usize; 2], table: &[f32; 64], cosines: &[[f32; 8]; 8]) {
    let mut block = [[0.0_f32; 8]; 8];
    for top in (0..height).step_by(8) {
        for left in (0..width).step_by(8) {
            for (y, row) in block.iter_mut().enumerate() {
                let line = &plane[(top + y).min(height - 1) * width..];
                for (x, value) in row.iter_mut().enumerate() {
                    *value = line[(left + x).min(width - 1)];
                }
            }
            let mut spectrum = both_ways(&block, cosines);
            for (value, q) in spectrum.iter_mut().flatten().zip(table) {
                *value = round(*value / q) * q;
            }
            let back = both_ways(&spectrum, &transposed(cosines));
            for (y, row) in back.iter().enumerate().take(height - top) {
                let n = 8.min(width - left);
                plane[(top + y) * width + left..][..n].copy_from_slice(&row[..n]);
            }
        }
    }
}

/// The nearest whole number, ties to even, for magnitudes below 2^22: adding and taking away 1.5 * 2^23
/// leaves no room for a fraction. Without it each value costs a call of the maths library.
pub fn round(value: f32) -> f32 {
    const NO_FRACTION: f32 = 12_582_912.0;
    (value + NO_FRACTION) - NO_FRACTION
}

/// `m * block * m^T`.
fn both_ways(block: &[[f32; 8]; 8], m: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    multiply(m, &transposed(&multiply(m, &transposed(block))))
}

fn multiply(a: &[[f32; 8]; 8], b: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    let mut product = [[0.0_f32; 8]; 8];
    for (row, a) in product.iter_mut().zip(a) {
        for (k, b) in b.iter().enumerate() {
            for x in 0..8 {
                row[x] += a[k] * b[x];
            }
        }
    }
    product
}

fn transposed(m: &[[f32; 8]; 8]) -> [[f32; 8]; 8] {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::{JpegDecoder, JpegEncoder};
    use image::{DynamicImage, ExtendedColorType};

    #[test]
    fn rounding_is_that_of_the_maths_library() {
        for i in -40_000..40_000 {
            let value = i as f32 * 0.03125;
            assert_eq!(round(value), value.round_ties_even());
        }
    }

    #[test]
    fn the_transform_inverts_itself() {
        let c = cosines();
        let block = std::array::from_fn(|y| std::array::from_fn(|x| ((7 * x + 3 * y) % 11) as f32));
        let back = both_ways(&both_ways(&block, &c), &transposed(&c));
        assert!(block.iter().flatten().zip(back.iter().flatten()).all(|(a, b): (&f32, &f32)| (a - b).abs() < 1e-4));
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
        let mut ours = picture.clone();
        compress(&mut ours, size, 80);
        let difference: Vec<f32> = ours.iter().zip(decoded.as_raw()).map(|(a, b)| (a - f32::from(*b)).abs()).collect();
        let mean = difference.iter().sum::<f32>() / difference.len() as f32;
        assert!(mean < 1.5, "mean difference {mean} counts");
        assert!(difference.iter().all(|d| *d < 12.0));
    }

    #[test]
    fn a_flat_picture_stays_flat_at_any_size() {
        for size in [[8, 8], [13, 5], [160, 120]] {
            let mut rgb = vec![100.0; 3 * size[0] * size[1]];
            compress(&mut rgb, size, 75);
            assert!(rgb.iter().all(|v| (v - 100.0).abs() < 2.5), "{size:?}");
        }
    }
}
