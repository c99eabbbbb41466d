//! From an image message to a picture.

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::recording::pipeline::Picture;
use crate::recording::ros::messages::{CompressedImage, Image};

/// The largest picture, pixels along each side: a dataset's.
const MAX_SIDE_PX: usize = 1 << 14;

/// How the bytes of a pixel become red, green and blue.
#[derive(Clone, Copy)]
struct Layout {
    bytes: usize,
    rgb: [usize; 3],
}

/// What a message showed.
#[derive(Clone, Debug)]
pub struct Shown {
    /// The picture; a JPEG or PNG is not decoded yet.
    pub picture: Picture,
    /// What had to be guessed, a line for a person.
    pub guess: Option<String>,
}

/// The picture of an [`Image`]: rgb8, bgr8, mono8, rgba8 or bgra8, with any padding behind its rows. A JPEG or PNG in
/// place of pixels is recognised by its first bytes, whatever the encoding is called. Three bytes a pixel without an
/// order (`passthrough`, `8UC3`, or no name) are taken as red, green, blue, which is said in the guess.
///
/// # Errors
/// Another encoding, or fewer bytes than the size states; `place` names the message.
pub fn of_image(image: Image, place: &str) -> Result<Shown> {
    let layout = layout(&image.encoding);
    let rows = layout.and_then(|layout| rows(&image, layout));
    let (Some(layout), Some([width, height, step])) = (layout, rows) else {
        return match is_encoded(&image.data) {
            true => Ok(Shown { picture: Picture::Encoded(image.data), guess: None }),
            false => Err(not_pixels(&image, layout, place)),
        };
    };
    let row_bytes = width * layout.bytes;
    let mut rgb = Vec::with_capacity(3 * width * height);
    for row in image.data.chunks(step).take(height) {
        for pixel in row[..row_bytes].chunks_exact(layout.bytes) {
            rgb.extend(layout.rgb.map(|channel| pixel[channel]));
        }
    }
    let is_guess = matches!(image.encoding.as_str(), "" | "passthrough" | "8UC3");
    let guess = is_guess.then(|| {
        let name = if image.encoding.is_empty() { "none" } else { image.encoding.as_str() };
        format!("{place}: the encoding ({name}) does not say the order of the channels: taken as red, green, blue")
    });
    Ok(Shown { picture: Picture::Raw(Frame::new(width, height, rgb)?), guess })
}

/// The picture of a [`CompressedImage`], recognised by its first bytes: the format's name says little, and cv_bridge's
/// "bgr8" is of the picture before it was compressed.
///
/// # Errors
/// Neither a JPEG nor a PNG; `place` names the message.
pub fn of_compressed(image: CompressedImage, place: &str) -> Result<Shown> {
    if is_encoded(&image.data) {
        return Ok(Shown { picture: Picture::Encoded(image.data), guess: None });
    }
    let got = format!("format \"{}\" and {}", image.format, first_bytes(&image.data));
    Err(Error::invalid(place, "a JPEG (FF D8) or a PNG (89 50 4E 47)", got))
}

/// Whether the bytes begin as a JPEG or a PNG does.
fn is_encoded(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xff, 0xd8]) || bytes.starts_with(b"\x89PNG")
}

fn layout(encoding: &str) -> Option<Layout> {
    let (bytes, rgb) = match encoding {
        "rgb8" | "passthrough" | "8UC3" | "" => (3, [0, 1, 2]),
        "bgr8" => (3, [2, 1, 0]),
        "mono8" | "8UC1" => (1, [0, 0, 0]),
        "rgba8" => (4, [0, 1, 2]),
        "bgra8" => (4, [2, 1, 0]),
        _ => return None,
    };
    Some(Layout { bytes, rgb })
}

/// Width and height in pixels and the bytes from row to row, where the data is as long as they say.
fn rows(image: &Image, layout: Layout) -> Option<[usize; 3]> {
    let [width, height] = [image.width, image.height].map(|px| px as usize);
    if ![width, height].iter().all(|px| (1..=MAX_SIDE_PX).contains(px)) {
        return None;
    }
    let row_bytes = width * layout.bytes;
    // Some drivers leave the step zero.
    let step = if image.step == 0 { row_bytes } else { image.step as usize };
    let is_whole = step >= row_bytes && step.checked_mul(height) == Some(image.data.len());
    is_whole.then_some([width, height, step])
}

fn not_pixels(image: &Image, layout: Option<Layout>, place: &str) -> Error {
    let Image { width, height, step, encoding, data, .. } = image;
    let expected = match layout {
        None => "rgb8, bgr8, mono8, rgba8 or bgra8, or the bytes of a JPEG or PNG".to_owned(),
        Some(layout) => format!("{width} x {height} pixels of {} bytes in rows of {step} bytes", layout.bytes),
    };
    Error::invalid(place, expected, format!("encoding \"{encoding}\", {} bytes, {}", data.len(), first_bytes(data)))
}

fn first_bytes(bytes: &[u8]) -> String {
    let first: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
    if first.is_empty() { "no data".to_owned() } else { format!("data that begins with {}", first.join(" ")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(encoding: &str, step: u32, data: &[u8]) -> Image {
        let encoding = encoding.to_owned();
        Image { height: 2, width: 2, encoding, step, data: data.to_vec(), ..Image::default() }
    }

    fn rgb(image: Image) -> Vec<u8> {
        match of_image(image, "here").unwrap().picture {
            Picture::Raw(frame) => frame.rgb().to_vec(),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_encoding_gives_red_green_and_blue_with_and_without_padding() {
        // Pixels of 10, 20, 30 and so on, each channel one more than the one before.
        let expected = [10, 11, 12, 20, 21, 22, 30, 31, 32, 40, 41, 42];
        for (encoding, bytes, order) in [
            ("rgb8", 3, &[0, 1, 2][..]),
            ("bgr8", 3, &[2, 1, 0]),
            ("rgba8", 4, &[0, 1, 2, 99]),
            ("bgra8", 4, &[2, 1, 0, 99]),
            ("mono8", 1, &[0]),
        ] {
            for padding in [0, 3] {
                let row = |pixels: [u8; 2]| {
                    let values = pixels.iter().flat_map(|pixel| order.iter().map(move |channel| pixel + channel));
                    values.chain(std::iter::repeat_n(7, padding)).collect::<Vec<u8>>()
                };
                let data = [row([10, 20]), row([30, 40])].concat();
                let got = rgb(image(encoding, (2 * bytes + padding) as u32, &data));
                match encoding {
                    "mono8" => assert_eq!(got, [10, 10, 10, 20, 20, 20, 30, 30, 30, 40, 40, 40]),
                    _ => assert_eq!(got, expected, "{encoding}"),
                }
            }
        }
    }

    #[test]
    fn three_bytes_without_an_order_are_a_guess_that_is_said() {
        for encoding in ["", "passthrough", "8UC3"] {
            let shown = of_image(image(encoding, 6, &[9; 12]), "here").unwrap();
            assert!(shown.guess.unwrap().contains("red, green, blue"));
        }
        assert!(of_image(image("bgr8", 0, &[9; 12]), "here").unwrap().guess.is_none());
    }

    #[test]
    fn compressed_bytes_are_known_under_any_name_and_pixels_are_not_taken_for_them() {
        for start in [&[0xff, 0xd8, 0xff][..], b"\x89PNG\r\n"] {
            for encoding in ["bgr8", "jpeg", "", "16UC1"] {
                let shown = of_image(image(encoding, 6, start), "here").unwrap();
                assert!(matches!(shown.picture, Picture::Encoded(bytes) if bytes == start));
            }
            let message = CompressedImage { format: "rvl".into(), data: start.to_vec(), ..CompressedImage::default() };
            assert!(matches!(of_compressed(message, "here").unwrap().picture, Picture::Encoded(_)));
        }
        let pixels = [0xff, 0xd8, 0xff, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        assert_eq!(rgb(image("rgb8", 6, &pixels)), pixels);
    }

    #[test]
    fn what_is_no_picture_is_refused_with_its_name_and_size() {
        for (bad, reason) in [
            (image("bayer_rggb8", 2, &[1; 4]), "encoding \"bayer_rggb8\", 4 bytes, data that begins with 01 01 01 01"),
            (image("rgb8", 6, &[1; 11]), "2 x 2 pixels of 3 bytes in rows of 6 bytes"),
            (image("rgb8", 5, &[1; 10]), "rows of 5 bytes"),
            (image("rgb8", u32::MAX, &[1; 12]), "rows of 4294967295 bytes"),
            (image("rgb8", 6, &[]), "no data"),
            (Image { width: u32::MAX, height: u32::MAX, ..image("rgb8", 6, &[1; 12]) }, "4294967295 x 4294967295"),
        ] {
            let message = of_image(bad, "here").unwrap_err().to_string();
            assert!(message.starts_with("here: ") && message.contains(reason), "{message}");
        }
        let message = of_compressed(CompressedImage::default(), "here").unwrap_err().to_string();
        assert!(message.contains("a JPEG (FF D8)"), "{message}");
    }
}
