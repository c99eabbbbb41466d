//! A sheet of dark paper with frames and text on it.

use crate::error::Result;
use crate::frame::Frame;
use crate::scene::shape::Raster;
use crate::scene::shape::glyph::line_of_text;

/// Height of a line of text, pixels.
pub(crate) const LINE_PX: usize = 14;

/// Size of the letters, pixels.
const EM_PX: f64 = 11.0;

/// Grey of the paper and of the text, counts.
pub(crate) const PAPER: u8 = 32;
const INK: u8 = 220;

/// Amplification of a difference, so that the usual 40 to 60 counts of an edge nearly fill the range
/// of 128 either way.
const DIFFERENCE_GAIN: f32 = 2.0;

/// Differences, interleaved RGB in counts, amplified on mid-grey.
pub(crate) fn amplified(counts: &[f32], [width, height]: [usize; 2]) -> Result<Frame> {
    // The conversion to u8 saturates.
    let rgb = counts.iter().map(|counts| (128.0 + DIFFERENCE_GAIN * counts).round() as u8).collect();
    Frame::new(width, height, rgb)
}

/// Frames on dark paper.
pub(crate) struct Sheet {
    size_px: [usize; 2],
    rgb: Vec<u8>,
}

impl Sheet {
    pub(crate) fn new(size_px: [usize; 2]) -> Self {
        Self { size_px, rgb: vec![PAPER; 3 * size_px[0] * size_px[1]] }
    }

    /// Copies a frame in, its top left corner at `x`, `y`; it must be inside the sheet.
    pub(crate) fn put(&mut self, [x, y]: [usize; 2], frame: &Frame) {
        let line_len = 3 * frame.width_px();
        for (row, line) in frame.rgb().chunks(line_len).enumerate() {
            let start = 3 * ((y + row) * self.size_px[0] + x);
            self.rgb[start..start + line_len].copy_from_slice(line);
        }
    }

    /// Writes a line of text, the top left corner of its [`LINE_PX`] at `x`, `y`, smaller where it would be wider
    /// than `width`.
    pub(crate) fn write(&mut self, [x, y]: [usize; 2], width: usize, text: &str) -> Result<()> {
        let (_, full_px) = line_of_text(text, EM_PX)?;
        let em_px = EM_PX * (width as f64 / full_px.max(1.0)).min(1.0);
        let (line, width_px) = line_of_text(text, em_px)?;
        // The raster is a square round its middle.
        let half_px = (0.5 * width_px.max(LINE_PX as f64)).ceil();
        let base_px = 0.8 * LINE_PX as f64;
        let centred = line.map(|[x, y]| [x - half_px, y + base_px - half_px]);
        let ink = Raster::coverage(&centred, half_px, 1.0);
        for (row, cells) in ink.values.chunks_exact(ink.n).take(LINE_PX).enumerate() {
            for (column, covered) in cells.iter().enumerate().take_while(|(column, _)| x + column < self.size_px[0]) {
                let start = 3 * ((y + row) * self.size_px[0] + x + column);
                let counts = f32::from(PAPER) + covered * f32::from(INK - PAPER);
                self.rgb[start..start + 3].fill(counts.round() as u8);
            }
        }
        Ok(())
    }

    pub(crate) fn into_frame(self) -> Result<Frame> {
        Frame::new(self.size_px[0], self.size_px[1], self.rgb)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_copied_to_their_place() {
        let mut sheet = Sheet::new([3, 2]);
        sheet.put([1, 1], &Frame::new(2, 1, vec![1, 2, 3, 4, 5, 6]).unwrap());
        let expected = [[PAPER; 12].as_slice(), &[1, 2, 3, 4, 5, 6]].concat();
        assert_eq!(sheet.into_frame().unwrap().rgb(), expected);
    }

    #[test]
    fn text_is_where_it_is_written_and_as_wide_as_it_may_be() {
        for (width, text) in [(200, "A hole"), (20, "A hole 12.5, -3 mm")] {
            let mut sheet = Sheet::new([240, 40]);
            sheet.write([10, 8], width, text).unwrap();
            let frame = sheet.into_frame().unwrap();
            let inked = (0..240 * 40).filter(|i| frame.rgb()[3 * i] > PAPER).collect::<Vec<_>>();
            assert!(!inked.is_empty());
            assert!(
                inked
                    .iter()
                    .all(|i| (10..10 + width + 1).contains(&(i % 240)) && (8..8 + LINE_PX).contains(&(i / 240)))
            );
        }
    }
}
