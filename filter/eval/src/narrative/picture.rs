//! Small pictures inside the page, as data URIs.

use std::io::Cursor;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbImage, imageops};
use tactile_data::frame::{Frame, TactileImage};

use crate::error::{Error, Result};

/// Widest picture in the page, pixels: twice what the page shows, for fine screens.
const WIDEST_PX: u32 = 240;
/// JPEG quality of camera frames; their noise makes a PNG six times as large.
const QUALITY: u8 = 85;

/// A camera frame, shrunk where it is large.
pub fn frame(frame: &Frame) -> Result<String> {
    picture(frame.width_px(), frame.height_px(), frame.rgb().to_vec())
}

/// A signed difference as a picture: grey where nothing changed, each channel brighter or darker by
/// 127 counts at a difference of `full_scale`.
pub fn difference(image: &TactileImage, full_scale: f32) -> Result<String> {
    let [width, height] = image.size_px;
    let n_pixels = width * height;
    let count = |value: f32| (128.0 + 127.0 * value / full_scale).clamp(0.0, 255.0) as u8;
    let rgb = (0..3 * n_pixels).map(|i| count(image.planes[i % 3 * n_pixels + i / 3])).collect();
    picture(width, height, rgb)
}

/// A size of difference that one in a hundred of all values exceeds.
pub fn full_scale<'a>(images: impl Iterator<Item = &'a TactileImage>) -> f32 {
    let mut sizes: Vec<f32> = images.flat_map(|image| &image.planes).map(|value| value.abs()).collect();
    let rank = sizes.len() * 99 / 100;
    if sizes.is_empty() {
        return 1.0;
    }
    let (_, size, _) = sizes.select_nth_unstable_by(rank, f32::total_cmp);
    size.max(f32::MIN_POSITIVE)
}

/// Probabilities of places, `[x, y]`, y fastest, as `n_xy * n_xy` pixels of one colour: the more
/// opaque, the more probable, wholly opaque at `most`.
///
/// The square root makes places visible that are a hundredth as probable as the likeliest.
pub fn belief(places: &[f64], n_xy: usize, most: f64) -> Result<String> {
    const BLUE: [u8; 3] = [0x1f, 0x7f, 0xd6];
    let opacity = |place: f64| (255.0 * (place / most).clamp(0.0, 1.0).sqrt()).round() as u8;
    let pixel = |i: usize| [BLUE[0], BLUE[1], BLUE[2], opacity(places[i % n_xy * n_xy + i / n_xy])];
    let rgba: Vec<u8> = (0..n_xy * n_xy).flat_map(pixel).collect();
    let mut png = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut png, CompressionType::Best, FilterType::NoFilter);
    let side = n_xy as u32;
    encoder.write_image(&rgba, side, side, ExtendedColorType::Rgba8).map_err(undrawn)?;
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(png)))
}

fn picture(width: usize, height: usize, rgb: Vec<u8>) -> Result<String> {
    let too_large = || Error::invalid("picture", "one that can be drawn", format!("{width}x{height} pixels"));
    let (Ok(width_px), Ok(height_px)) = (u32::try_from(width), u32::try_from(height)) else {
        return Err(too_large());
    };
    let mut image = RgbImage::from_raw(width_px, height_px, rgb).ok_or_else(too_large)?;
    if width_px > WIDEST_PX {
        let shrunk_px = (u64::from(height_px) * u64::from(WIDEST_PX)).div_ceil(u64::from(width_px)) as u32;
        image = imageops::thumbnail(&image, WIDEST_PX, shrunk_px);
    }
    let mut jpeg = Cursor::new(Vec::new());
    JpegEncoder::new_with_quality(&mut jpeg, QUALITY).encode_image(&image).map_err(undrawn)?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg.into_inner())))
}

/// What an encoder refused.
fn undrawn(error: image::ImageError) -> Error {
    Error::invalid("picture", "one that can be drawn", error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(uri: &str) -> image::DynamicImage {
        let (_, base64) = uri.split_once(',').unwrap();
        image::load_from_memory(&STANDARD.decode(base64).unwrap()).unwrap()
    }

    #[test]
    fn x_runs_right_and_y_down_in_a_belief() {
        let mut places = vec![0.0; 9];
        (places[2 * 3], places[1]) = (0.8, 0.2); // x = 2, y = 0; then x = 0, y = 1
        let map = decode(&belief(&places, 3, 0.8).unwrap()).into_rgba8();
        assert_eq!([map[(2, 0)][3], map[(0, 1)][3], map[(1, 1)][3]], [255, 128, 0]);
    }

    #[test]
    fn no_change_is_grey_and_signs_differ() {
        let mut planes = vec![0.0; 3 * 16 * 8];
        planes[..64].fill(2.0); // upper half, red
        planes[2 * 128..2 * 128 + 64].fill(-2.0); // upper half, blue
        let image = TactileImage { size_px: [16, 8], planes, edge_share: 0.0 };
        let seen = decode(&difference(&image, 4.0).unwrap()).into_rgb8();
        let near = |got: [u8; 3], want: [u8; 3]| got.iter().zip(want).all(|(g, w)| g.abs_diff(w) < 24);
        // JPEG moves colours by some counts.
        assert!(near(seen[(3, 1)].0, [191, 128, 64]), "{:?}", seen[(3, 1)]);
        assert!(near(seen[(3, 7)].0, [128; 3]), "{:?}", seen[(3, 7)]);
    }

    #[test]
    fn a_large_frame_is_shrunk_in_proportion() {
        let large = Frame::new(640, 480, vec![9; 3 * 640 * 480]).unwrap();
        let shown = decode(&frame(&large).unwrap());
        assert_eq!([shown.width(), shown.height()], [240, 180]);
    }
}
