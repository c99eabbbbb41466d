//! Frames in picture files: PNG, JPEG and GIF in, PNG out.

use std::collections::BTreeMap;
use std::fs;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits, RgbImage};

use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};
use crate::frame::{Frame, area_average};

/// No side of a frame is longer, pixels.
const MAX_SIDE_PX: usize = 1 << 14;

/// Whether a file's name ends as a picture's that [`read_all`] reads.
pub fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    matches!(extension.as_str(), "png" | "jpg" | "jpeg" | "gif")
}

/// The frames of a picture, decoded one at a time.
pub type Frames = Box<dyn Iterator<Item = Result<Frame>>>;

/// Whether the bytes of a picture are a GIF's, which may hold many frames.
pub fn is_animation(bytes: &[u8]) -> bool {
    bytes.starts_with(b"GIF8")
}

/// The frames that the bytes of a picture file hold, in order: one of a PNG or JPEG, all of an animated GIF; `place`
/// names them in an error.
///
/// The format is recognised by the first bytes, not by a name. Grey, 16-bit and transparent pictures become 8-bit RGB;
/// transparency is dropped, not blended.
///
/// # Errors
/// Bytes that cannot be decoded; of an animation, where its first frame cannot. Further ones are errors of their own.
pub fn frames(bytes: Vec<u8>, place: &str) -> Result<Frames> {
    if !is_animation(&bytes) {
        return Ok(Box::new(std::iter::once(Ok(decode(&bytes, place)?))));
    }
    let path = PathBuf::from(place);
    let mut animation = GifDecoder::new(Cursor::new(bytes)).map_err(Error::picture(&path))?;
    animation.set_limits(limits()).map_err(Error::picture(&path))?;
    let frame = move |frame: image::ImageResult<image::Frame>| {
        frame_from(DynamicImage::from(frame.map_err(Error::picture(&path))?.into_buffer()))
    };
    let mut frames = animation.into_frames().map(frame);
    match frames.next() {
        Some(first) => Ok(Box::new(std::iter::once(Ok(first?)).chain(frames))),
        None => Err(Error::invalid(place, "at least one frame", "none")),
    }
}

/// Every frame of a picture file, in order, as [`frames`].
pub fn read_all(path: &Path) -> Result<Vec<Frame>> {
    frames(bounded_file::read(path, Kind::PICTURE)?, &path.display().to_string())?.collect()
}

/// The only frame of a picture file, or the first of an animation.
pub fn read(path: &Path) -> Result<Frame> {
    decode(&bounded_file::read(path, Kind::PICTURE)?, &path.display().to_string())
}

/// The only frame that the bytes of a PNG or JPEG hold, or the first of an animation; `place` names them in an error.
pub fn decode(bytes: &[u8], place: &str) -> Result<Frame> {
    frame_from(decode_any(bytes, Path::new(place))?)
}

/// The picture that the bytes of a PNG, JPEG or GIF hold, of any colours; `path` names it in an error.
pub(crate) fn decode_any(bytes: &[u8], path: &Path) -> Result<DynamicImage> {
    let mut reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(Error::io(path))?;
    reader.limits(limits());
    reader.decode().map_err(Error::picture(path))
}

/// What a decoded picture may take: its header may ask for more than any memory has.
fn limits() -> Limits {
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE_PX as u32), Some(MAX_SIDE_PX as u32));
    limits.max_alloc = Some(Kind::PICTURE.most_bytes);
    limits
}

/// The pictures of a folder by their names, but for one that is the sensor at rest.
///
/// # Errors
/// A folder or a picture that cannot be read.
pub fn read_folder(folder: &Path, at_rest: &Path) -> Result<BTreeMap<String, Frame>> {
    let at_rest = at_rest.canonicalize().ok();
    let mut frames = BTreeMap::new();
    for entry in fs::read_dir(folder).map_err(Error::io(folder))? {
        let entry = entry.map_err(Error::io(folder))?;
        let path = entry.path();
        if is_picture(&path) && path.canonicalize().ok() != at_rest {
            frames.insert(entry.file_name().to_string_lossy().into_owned(), read(&path)?);
        }
    }
    Ok(frames)
}

/// Writes a frame as an 8-bit RGB PNG.
pub fn write_png(path: &Path, frame: &Frame) -> Result<()> {
    fs::write(path, png(frame)?).map_err(Error::io(path))
}

/// The bytes of a frame as a PNG.
pub fn png(frame: &Frame) -> Result<Vec<u8>> {
    let mut png = Cursor::new(Vec::new());
    image_from(frame)?.write_to(&mut png, ImageFormat::Png).map_err(Error::picture("PNG"))?;
    Ok(png.into_inner())
}

/// The frame at another size by area average, `[width, height]` pixels: a pixel is the mean of what it covers, with
/// parts of pixels counted as such.
pub fn resize(frame: &Frame, size_px: [usize; 2]) -> Result<Frame> {
    if size_px == [frame.width_px(), frame.height_px()] {
        return Ok(frame.clone());
    }
    if !size_px.iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) {
        let expected = format!("1 to {MAX_SIDE_PX} pixels each way");
        return Err(Error::invalid("frame size", expected, format!("{size_px:?}")));
    }
    let [width, height] = size_px;
    let planes = area_average(frame, size_px);
    let mut rgb = vec![0; 3 * width * height];
    for (channel, plane) in planes.chunks_exact(width * height).enumerate() {
        for (pixel, mean) in rgb.chunks_exact_mut(3).zip(plane) {
            pixel[channel] = mean.round() as u8;
        }
    }
    Frame::new(width, height, rgb)
}

fn frame_from(image: DynamicImage) -> Result<Frame> {
    let rgb = image.into_rgb8();
    Frame::new(rgb.width() as usize, rgb.height() as usize, rgb.into_raw())
}

fn image_from(frame: &Frame) -> Result<RgbImage> {
    let size = (u32::try_from(frame.width_px()), u32::try_from(frame.height_px()));
    let image = match size {
        (Ok(width), Ok(height)) => RgbImage::from_raw(width, height, frame.rgb().to_vec()),
        _ => None,
    };
    image.ok_or_else(|| Error::invalid("frame", "a size a picture can have", format!("{size:?}")))
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayAlphaImage, ImageBuffer, Luma, LumaA};

    #[test]
    fn a_frame_comes_back_from_png_unchanged() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frame.png");
        let frame = Frame::new(5, 3, (0..45).collect()).unwrap();
        write_png(&path, &frame).unwrap();
        assert_eq!(read_all(&path).unwrap(), [frame]);
    }

    #[test]
    fn deep_grey_and_transparent_pictures_become_rgb() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("deep.png");
        ImageBuffer::<Luma<u16>, _>::from_fn(4, 2, |x, _| Luma([x as u16 * 257 * 10])).save(&path).unwrap();
        assert_eq!(read(&path).unwrap().rgb()[9..12], [30, 30, 30]);
        GrayAlphaImage::from_fn(4, 2, |x, _| LumaA([x as u8 * 7, 0])).save(&path).unwrap();
        assert_eq!(read(&path).unwrap().rgb()[9..12], [21, 21, 21]);
    }

    #[test]
    fn resizing_keeps_the_mean() {
        let frame = Frame::new(320, 240, (0..320 * 240 * 3).map(|i| (i / 960) as u8).collect()).unwrap();
        let mean = |f: &Frame| f.rgb().iter().map(|v| f64::from(*v)).sum::<f64>() / f.rgb().len() as f64;
        let small = resize(&frame, [72, 50]).unwrap();
        assert_eq!([small.width_px(), small.height_px()], [72, 50]);
        // Each pixel rounds by at most one count.
        assert!((mean(&small) - mean(&frame)).abs() < 1.0);
    }

    /// Against a sum of every pixel's share in f64: rounding to whole counts is all that is lost.
    #[test]
    fn resizing_is_the_mean_of_the_area_at_any_ratio() {
        let (width, height) = (67, 45);
        let frame = Frame::new(width, height, (0..3 * width * height).map(|i| (i * i % 241) as u8).collect()).unwrap();
        for size in [[20, 13], [33, 45], [67, 10], [100, 77], [1, 1]] {
            let small = resize(&frame, size).unwrap();
            let step = [width as f64 / size[0] as f64, height as f64 / size[1] as f64];
            let share = |pixel: usize, bin: usize, step: f64| {
                let (from, to) = (bin as f64 * step, (bin + 1) as f64 * step);
                (to.min(pixel as f64 + 1.0) - from.max(pixel as f64)).max(0.0)
            };
            for (at, got) in small.rgb().iter().enumerate() {
                let (channel, x, y) = (at % 3, at / 3 % size[0], at / 3 / size[0]);
                let sum: f64 = (0..width * height)
                    .map(|i| {
                        let weight = share(i % width, x, step[0]) * share(i / width, y, step[1]);
                        weight * f64::from(frame.rgb()[3 * i + channel])
                    })
                    .sum();
                let expected = sum / (step[0] * step[1]);
                assert!((f64::from(*got) - expected).abs() <= 0.5 + 1e-3, "{size:?} {at}: {got}, {expected}");
            }
        }
    }

    #[test]
    fn a_picture_that_asks_for_more_than_any_memory_is_refused() {
        // A GIF of 65,535 pixels each way, of which 17 GB would be made, and its first frame.
        let mut gif = b"GIF89a\xff\xff\xff\xff\x80\x00\x00\x00\x00\x00\xff\xff\xff".to_vec();
        gif.extend(b"\x2c\x00\x00\x00\x00\x01\x00\x01\x00\x00\x02\x02\x44\x01\x00\x3b");
        for refused in [frames(gif.clone(), "bomb.gif").map(drop), decode(&gif, "bomb.gif").map(drop)] {
            let error = refused.unwrap_err().to_string();
            assert!(error.starts_with("bomb.gif: ") && !error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn a_broken_picture_is_one_line_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.png");
        fs::write(&path, b"\x89PNG\r\n\x1a\nnothing").unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("broken.png") && !message.contains('\n'), "{message}");
    }
}
