//! Frames in picture files: PNG, JPEG and GIF in, PNG out.

use std::fs::File;
use std::io::{BufReader, Cursor};
use std::path::Path;

use image::codecs::gif::GifDecoder;
use image::{AnimationDecoder, DynamicImage, ImageFormat, ImageReader, RgbImage};

use crate::error::{Error, Result};
use crate::frame::Frame;

/// Whether a file's name ends as a picture's that [`read_all`] reads.
pub fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    matches!(extension.as_str(), "png" | "jpg" | "jpeg" | "gif")
}

/// Every frame of a picture file, in order: one of a PNG or JPEG, all of an animated GIF.
///
/// The format is recognised by the file's first bytes, not its name. Grey, 16-bit and transparent pictures
/// become 8-bit RGB; transparency is dropped, not blended. Fails where the file cannot be decoded.
pub fn read_all(path: &Path) -> Result<Vec<Frame>> {
    let reader = ImageReader::open(path).and_then(|r| r.with_guessed_format()).map_err(Error::io(path))?;
    if reader.format() != Some(ImageFormat::Gif) {
        return Ok(vec![frame_from(reader.decode().map_err(Error::picture(path))?)?]);
    }
    let file = BufReader::new(File::open(path).map_err(Error::io(path))?);
    let animation = GifDecoder::new(file).map_err(Error::picture(path))?;
    let frames = animation
        .into_frames()
        .map(|frame| frame_from(DynamicImage::from(frame.map_err(Error::picture(path))?.into_buffer())))
        .collect::<Result<Vec<_>>>()?;
    if frames.is_empty() {
        return Err(Error::invalid(path.display().to_string(), "at least one frame", "none"));
    }
    Ok(frames)
}

/// The only frame of a picture file, or the first of an animation.
pub fn read(path: &Path) -> Result<Frame> {
    Ok(read_all(path)?.swap_remove(0))
}

/// The frame that the bytes of a PNG or JPEG hold; `place` names them in an error.
pub fn decode(bytes: &[u8], place: &str) -> Result<Frame> {
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(Error::io(place))?;
    frame_from(reader.decode().map_err(Error::picture(Path::new(place)))?)
}

/// Writes a frame as an 8-bit RGB PNG.
pub fn write_png(path: &Path, frame: &Frame) -> Result<()> {
    let mut png = Cursor::new(Vec::new());
    image_from(frame)?.write_to(&mut png, ImageFormat::Png).map_err(Error::picture(path))?;
    std::fs::write(path, png.into_inner()).map_err(Error::io(path))
}

/// The frame at another size by area average, `[width, height]` pixels.
pub fn resize(frame: &Frame, size_px: [usize; 2]) -> Result<Frame> {
    if size_px == [frame.width_px(), frame.height_px()] {
        return Ok(frame.clone());
    }
    let [width, height] = size_px.map(u32::try_from);
    let (Ok(width @ 1..), Ok(height @ 1..)) = (width, height) else {
        return Err(Error::invalid("frame size", "1 pixel or more each way", format!("{size_px:?}")));
    };
    frame_from(DynamicImage::from(image::imageops::thumbnail(&image_from(frame)?, width, height)))
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

    #[test]
    fn a_broken_picture_is_one_line_with_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.png");
        std::fs::write(&path, b"\x89PNG\r\n\x1a\nnothing").unwrap();
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("broken.png") && !message.contains('\n'), "{message}");
    }
}
