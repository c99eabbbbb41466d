//! Takes a film of JPEGs apart, one picture behind the other, as `ffmpeg -c copy -f mjpeg -` sends them.
//!
//! A picture is followed segment by segment: a search for its end marker alone would stop at that of a thumbnail.

/// A picture of more bytes is none.
const MAX_BYTES: usize = 64 << 20;

/// The marker that begins a picture, behind the byte 0xff.
const START: u8 = 0xd8;

/// The marker that ends it.
const END: u8 = 0xd9;

/// The marker in front of a scan's data.
const SCAN: u8 = 0xda;

/// Bytes of a film that were not taken apart yet.
#[derive(Debug, Default)]
pub struct Splitter {
    bytes: Vec<u8>,
    /// How far the picture at the start was followed.
    at: usize,
    is_in_scan: bool,
    n_skipped: u64,
}

/// What following a picture came to.
enum Step {
    /// The next bytes must come first.
    More,
    /// It ends before this byte.
    Whole(usize),
    /// It is none.
    Broken,
}

impl Splitter {
    /// Takes in the next bytes; the pictures that are whole now.
    pub fn push(&mut self, bytes: &[u8]) -> Vec<Vec<u8>> {
        self.bytes.extend_from_slice(bytes);
        let mut pictures = Vec::new();
        while self.find_start() {
            match self.follow() {
                Step::More if self.bytes.len() > MAX_BYTES => self.skip(2),
                Step::More => break,
                Step::Whole(end) => {
                    let rest = self.bytes.split_off(end);
                    pictures.push(std::mem::replace(&mut self.bytes, rest));
                    (self.at, self.is_in_scan) = (0, false);
                }
                Step::Broken => self.skip(2),
            }
        }
        pictures
    }

    /// Bytes so far that belong to no picture.
    pub fn n_skipped(&self) -> u64 {
        self.n_skipped
    }

    fn skip(&mut self, n: usize) {
        self.bytes.drain(..n);
        self.n_skipped += n as u64;
        (self.at, self.is_in_scan) = (0, false);
    }

    /// Brings the start of a picture to the front; whether there is one.
    fn find_start(&mut self) -> bool {
        if self.at > 0 {
            return true;
        }
        let start = self.bytes.windows(2).position(|pair| pair == [0xff, START]);
        // The last byte may be the first of the marker.
        let before = start.unwrap_or_else(|| self.bytes.len().saturating_sub(1));
        if before > 0 {
            self.skip(before);
        }
        if start.is_some() {
            self.at = 2;
        }
        start.is_some()
    }

    /// Follows the picture at the front as far as its bytes go.
    fn follow(&mut self) -> Step {
        loop {
            if self.is_in_scan && !self.pass_scan() {
                return Step::More;
            }
            let Some([mark, code]) = self.pair(self.at) else { return Step::More };
            match (mark, code) {
                // Any number of 0xff may stand in front of a marker.
                (0xff, 0xff) => self.at += 1,
                (0xff, END) => return Step::Whole(self.at + 2),
                (0xff, START) => return Step::Broken,
                // Markers without a segment: restarts, and TEM.
                (0xff, 0xd0..=0xd7 | 0x01) => self.at += 2,
                (0xff, _) => {
                    let Some(length) = self.pair(self.at + 2) else { return Step::More };
                    let length = usize::from(u16::from_be_bytes(length));
                    if length < 2 {
                        return Step::Broken;
                    }
                    self.at += 2 + length;
                    self.is_in_scan = code == SCAN;
                }
                _ => return Step::Broken,
            }
        }
    }

    /// Goes to the marker behind a scan's data, in which 0xff is followed by zero or a restart; whether it is there.
    fn pass_scan(&mut self) -> bool {
        while let Some([mark, code]) = self.pair(self.at) {
            if mark == 0xff && !matches!(code, 0x00 | 0xd0..=0xd7) {
                self.is_in_scan = false;
                return true;
            }
            self.at += 1;
        }
        false
    }

    fn pair(&self, at: usize) -> Option<[u8; 2]> {
        self.bytes.get(at..at.checked_add(2)?)?.try_into().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::dataset::export::jpeg;
    use tactile_data::frame::Frame;

    fn picture(seed: usize) -> Vec<u8> {
        let rgb = (0..48 * 36 * 3).map(|i| ((i * (seed + 3) * 37 + i * i / 11) % 256) as u8).collect();
        jpeg(&Frame::new(48, 36, rgb).unwrap(), 95).unwrap()
    }

    /// With a thumbnail in an APP1 segment, as cameras write it.
    fn with_thumbnail(picture: &[u8]) -> Vec<u8> {
        let thumbnail = self::picture(9);
        let length = (thumbnail.len() + 2) as u16;
        [&picture[..2], &[0xff, 0xe1], &length.to_be_bytes(), &thumbnail, &picture[2..]].concat()
    }

    #[test]
    fn pictures_come_out_as_they_went_in_however_they_are_cut() {
        let pictures = [picture(1), with_thumbnail(&picture(2)), picture(3), with_thumbnail(&picture(4))];
        let film = [&b"noise\xff"[..], &pictures[0], &pictures[1], &[0; 5], &pictures[2], &pictures[3]].concat();
        for piece in [1, 2, 7, 1000, film.len()] {
            let mut splitter = Splitter::default();
            let found: Vec<Vec<u8>> = film.chunks(piece).flat_map(|bytes| splitter.push(bytes)).collect();
            assert_eq!(found, pictures, "{piece}");
            assert_eq!(splitter.n_skipped(), 11, "{piece}");
        }
    }

    #[test]
    fn a_picture_that_is_cut_off_costs_no_other() {
        let pictures = [picture(1), picture(2), picture(3)];
        let cut = &pictures[1][..pictures[1].len() / 2];
        let mut splitter = Splitter::default();
        let found = splitter.push(&[&pictures[0], cut, &pictures[2], &pictures[0]].concat());
        assert!(found.contains(&pictures[0]) && found.last() == Some(&pictures[0]), "{}", found.len());
        assert_eq!(found.iter().filter(|found| **found == pictures[2]).count(), 1);
    }

    #[test]
    fn noise_is_skipped() {
        let mut state = 1_u32;
        let mut splitter = Splitter::default();
        let mut n_found = 0;
        for _ in 0..2000 {
            let noise: Vec<u8> = (0..997)
                .map(|_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (state >> 24) as u8
                })
                .collect();
            n_found += splitter.push(&noise).len();
        }
        // What looks like a picture is for the decoder to refuse.
        assert!(splitter.bytes.len() < 1 << 20, "{} bytes held, {n_found} found", splitter.bytes.len());
    }
}
