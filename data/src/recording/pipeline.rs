//! From the pictures of a recording, wherever they come from, to a dataset.

use rayon::prelude::*;

use crate::dataset::store::DatasetWriter;
use crate::dataset::touch::Touch;
use crate::error::Result;
use crate::frame::Frame;
use crate::frame::picture;
use crate::pose::se2::Se2;
use crate::recording::geometry::View;

/// Pictures decoded at once, and frames waiting to be written, take about this much memory each, bytes.
const CHUNK_BYTES: usize = 32 << 20;

/// Pictures decoded at once are at most this many.
const MAX_CHUNK: usize = 256;

/// A picture as its recording holds it.
#[derive(Clone, Debug)]
pub enum Picture {
    /// The bytes of a PNG, JPEG or GIF; every frame of an animation counts.
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
    /// The touch's place in the recording, for errors: a file and its row, or a bag, its topic and the time.
    pub place: String,
}

/// Pushes the items of a recording, in order, to a dataset that has been begun; returns how many frames came of them.
/// All pictures must have the size that `view` was settled for. `progress` gets the items read and `n_items`.
///
/// A chunk of pictures is decoded and resized on all threads while the chunk before is written, so memory does not
/// grow with the recording. Items are taken on the calling thread.
///
/// # Errors
/// The first item that cannot be read or decoded, named by its place.
pub fn push(
    items: &mut dyn Iterator<Item = Result<Item>>,
    n_items: usize,
    view: &View,
    writer: &mut DatasetWriter,
    progress: &dyn Fn(usize, usize),
) -> Result<usize> {
    let chunk_len = chunk_len(view);
    let mut shots = Shots { items, animation: None, n_taken: 0 };
    let mut n_frames = 0;
    let mut decoded = Vec::new();
    loop {
        let chunk = shots.take(chunk_len)?;
        let is_last = chunk.is_empty();
        n_frames += chunk.len();
        let (next, written) = rayon::join(
            || chunk.into_par_iter().map(|item| frame_of(item, view)).collect::<Vec<_>>(),
            || write(decoded, writer),
        );
        written?;
        if is_last {
            return Ok(n_frames);
        }
        // In the order of the items, so that the first bad one is named.
        decoded = next.into_iter().collect::<Result<Vec<_>>>()?;
        progress(shots.n_taken, n_items);
    }
}

fn frame_of(Item { picture, touch, place }: Item, view: &View) -> Result<(Frame, Touch)> {
    let picture = match picture {
        Picture::Encoded(bytes) => picture::decode(&bytes, &place)?,
        Picture::Raw(frame) => frame,
    };
    Ok((view.frame(&picture, &place)?, touch))
}

fn write(decoded: Vec<(Frame, Touch)>, writer: &mut DatasetWriter) -> Result<()> {
    decoded.iter().try_for_each(|(frame, touch)| writer.push(frame, touch))
}

/// Pictures decoded at once: few of large ones, and never fewer than there are threads.
fn chunk_len(view: &View) -> usize {
    let bytes = |[width, height]: [usize; 2]| 3 * width * height;
    let most = bytes(view.source_px()).max(bytes(view.frame_px())).max(1);
    (CHUNK_BYTES / most).max(rayon::current_num_threads()).min(MAX_CHUNK)
}

/// The items of a recording, each animation taken apart into its frames.
struct Shots<'a> {
    items: &'a mut dyn Iterator<Item = Result<Item>>,
    /// The rest of an animation, and what is known of its further frames.
    animation: Option<(picture::Frames, Touch, String)>,
    n_taken: usize,
}

impl Shots<'_> {
    /// The next items of one frame each: `n` of them, fewer only at the end.
    fn take(&mut self, n: usize) -> Result<Vec<Item>> {
        let mut taken = Vec::with_capacity(n);
        while taken.len() < n {
            match self.next()? {
                Some(item) => taken.push(item),
                None => break,
            }
        }
        Ok(taken)
    }

    fn next(&mut self) -> Result<Option<Item>> {
        loop {
            if let Some((frames, touch, place)) = &mut self.animation {
                if let Some(frame) = frames.next() {
                    let item = Item { picture: Picture::Raw(frame?), touch: touch.clone(), place: place.clone() };
                    // The sensor does not move within an animation.
                    let is_placed = touch.moved.is_some() || touch.part_from_sensor.is_some();
                    touch.moved = is_placed.then_some(Se2::IDENTITY);
                    return Ok(Some(item));
                }
                self.animation = None;
            }
            let Some(item) = self.items.next().transpose()? else { return Ok(None) };
            self.n_taken += 1;
            match item.picture {
                Picture::Encoded(bytes) if picture::is_animation(&bytes) => {
                    self.animation = Some((picture::frames(bytes, &item.place)?, item.touch, item.place));
                }
                _ => return Ok(Some(item)),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::store::{Dataset, Meta};
    use crate::error::Error;
    use std::path::Path;

    fn writer(out: &Path) -> DatasetWriter {
        let meta = Meta::new("some", "a test", [4, 2], [1.0; 2]);
        DatasetWriter::create(out, meta, &frame(0)).unwrap()
    }

    fn frame(value: usize) -> Frame {
        Frame::new(4, 2, (0..24).map(|i| (value + i) as u8).collect()).unwrap()
    }

    fn item(i: usize) -> Result<Item> {
        let touch = Touch { part: Some(i.to_string()), ..Touch::default() };
        Ok(Item { picture: Picture::Raw(frame(i)), touch, place: format!("row {i}") })
    }

    #[test]
    fn frames_of_many_chunks_stay_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let mut writer = writer(&out);
        let n = 3 * MAX_CHUNK + 7;
        let view = View::whole([4, 2], [4, 2]);
        assert_eq!(push(&mut (0..n).map(item), n, &view, &mut writer, &|_, _| ()).unwrap(), n);
        writer.finish().unwrap();
        let dataset = Dataset::open(&out).unwrap();
        assert_eq!(dataset.len(), n);
        for i in 0..n {
            assert_eq!((dataset.frame(i), dataset.touch(i).part.clone()), (frame(i), Some(i.to_string())));
        }
    }

    #[test]
    fn the_first_bad_item_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = writer(&folder.path().join("out"));
        let view = View::whole([4, 2], [4, 2]);
        let odd = |i: usize| match i {
            70 | 90 => Ok(Item { picture: Picture::Encoded(b"nothing".to_vec()), ..item(i)? }),
            95 => Err(Error::invalid("row 95", "a file", "none")),
            _ => item(i),
        };
        let mut refusal = |n| push(&mut (0..n).map(odd), n, &view, &mut writer, &|_, _| ()).unwrap_err().to_string();
        assert!(refusal(94).starts_with("row 70"));
    }
}
