//! From the pictures of a recording, wherever they come from, to a dataset.

use std::path::PathBuf;

use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::picture;
use crate::se2::Se2;
use crate::store::DatasetWriter;
use crate::touch::Touch;

/// A picture as its recording holds it.
#[derive(Clone, Debug)]
pub enum Picture {
    /// A file of its own; every frame of an animation counts.
    File(PathBuf),
    /// The bytes of a PNG or JPEG.
    Encoded(Vec<u8>),
    /// Decoded already.
    Raw(Frame),
}

/// One picture of a recording, and what is known of it.
#[derive(Clone, Debug)]
pub struct Item {
    /// What was seen.
    pub picture: Picture,
    /// What is known.
    pub touch: Touch,
    /// Where it stands in the recording, for errors: a file and its row, or a bag, its topic and the time.
    pub place: String,
}

/// Pushes the items of a recording, in order, to a dataset that has been begun; returns how many frames came of them.
/// All pictures must have the size `source_px`. `progress` gets the items done and `n_items`.
///
/// # Errors
/// An item that cannot be read or decoded, named by its place.
pub fn push(
    items: &mut dyn Iterator<Item = Result<Item>>,
    n_items: usize,
    source_px: [usize; 2],
    frame_px: [usize; 2],
    writer: &mut DatasetWriter,
    progress: &dyn Fn(usize, usize),
) -> Result<usize> {
    let mut n_frames = 0;
    for (done, item) in items.enumerate() {
        let Item { picture, touch, place } = item?;
        let frames = match picture {
            Picture::File(path) => picture::read_all(&path)?,
            Picture::Encoded(bytes) => vec![picture::decode(&bytes, &place)?],
            Picture::Raw(frame) => vec![frame],
        };
        for (i, frame) in frames.iter().enumerate() {
            check_px(frame, source_px, &place)?;
            // The sensor does not move within an animation.
            let moved = touch.moved.map(|moved| if i == 0 { moved } else { Se2::IDENTITY });
            writer.push(&picture::resize(frame, frame_px)?, &Touch { moved, ..touch.clone() })?;
            n_frames += 1;
        }
        progress(done + 1, n_items);
    }
    Ok(n_frames)
}

/// Refuses a picture of another size than the frame at rest; `place` names it.
pub fn check_px(frame: &Frame, expected: [usize; 2], place: &str) -> Result<()> {
    let got = [frame.width_px(), frame.height_px()];
    if got == expected {
        return Ok(());
    }
    let show = |[width, height]: [usize; 2]| format!("{width}x{height} pixels");
    Err(Error::invalid(place, format!("{}, as the no-contact frame", show(expected)), show(got)))
}
