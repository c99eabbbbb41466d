//! zstd and lz4, unpacked as they are read, in pure Rust.

use std::io::{self, BufRead, ErrorKind, Read};

use lz4_flex::frame::FrameDecoder as Lz4;
use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

/// The first bytes of a zstd frame.
pub const ZSTD_MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Bytes of a chunk packed with `compression`, as MCAP names it: nothing for none; `None` for another name.
pub fn unpack(compression: &str, packed: impl BufRead + Send + 'static) -> Option<Box<dyn Read + Send>> {
    match compression {
        "" => Some(Box::new(packed)),
        "zstd" => Some(Box::new(Zstd::new(packed))),
        "lz4" => Some(Box::new(Lz4::new(packed))),
        _ => None,
    }
}

/// zstd frames, one behind the other; frames that are to be skipped are.
pub struct Zstd<R> {
    packed: R,
    decoder: FrameDecoder,
    is_in_frame: bool,
}

impl<R: BufRead> Zstd<R> {
    /// Begins; nothing is read yet.
    pub fn new(packed: R) -> Self {
        Self { packed, decoder: FrameDecoder::new(), is_in_frame: false }
    }

    /// Begins the next frame; `false` at the end.
    fn begin(&mut self) -> io::Result<bool> {
        while !self.packed.fill_buf()?.is_empty() {
            match self.decoder.reset(&mut self.packed) {
                Ok(()) => return Ok(true),
                Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                    io::copy(&mut self.packed.by_ref().take(u64::from(length)), &mut io::sink())?;
                }
                Err(error) => return Err(io::Error::other(error)),
            }
        }
        Ok(false)
    }
}

impl<R: BufRead> Read for Zstd<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        loop {
            if !self.is_in_frame {
                self.is_in_frame = self.begin()?;
                if !self.is_in_frame {
                    return Ok(0);
                }
            }
            while self.decoder.can_collect() == 0 && !self.decoder.is_finished() {
                let step = self.decoder.decode_blocks(&mut self.packed, BlockDecodingStrategy::UptoBlocks(1));
                step.map_err(io::Error::other)?;
            }
            let n_read = self.decoder.read(buffer)?;
            if n_read > 0 {
                return Ok(n_read);
            }
            let [stated, found] = [self.decoder.get_checksum_from_data(), self.decoder.get_calculated_checksum()];
            if stated.is_some() && stated != found {
                return Err(io::Error::new(ErrorKind::InvalidData, "the checksum of a zstd frame does not fit"));
            }
            self.is_in_frame = false;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ruzstd::encoding::{CompressionLevel, compress_to_vec};
    use std::io::{Cursor, Write};

    fn all(compression: &str, packed: &[u8]) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        unpack(compression, Cursor::new(packed.to_vec())).unwrap().read_to_end(&mut bytes).map(|_| bytes)
    }

    #[test]
    fn frames_behind_each_other_and_frames_to_skip_are_read() {
        let text = b"two frames of zstd and one to skip between them, two frames of zstd".repeat(5000);
        let frame = compress_to_vec(&text[..], CompressionLevel::Fastest);
        let skipped = [&[0x50, 0x2a, 0x4d, 0x18, 3, 0, 0, 0][..], b"abc"].concat();
        let packed = [&frame[..], &skipped, &frame].concat();
        assert_eq!(all("zstd", &packed).unwrap(), [&text[..], &text].concat());
        for end in [1, 3, frame.len() - 1, packed.len() - 1] {
            assert!(all("zstd", &packed[..end]).is_err(), "{end}");
        }
    }

    #[test]
    fn a_frame_of_the_zstd_program_is_read_and_its_checksum_checked() {
        // `python -c "import zstandard; print(zstandard.ZstdCompressor(write_checksum=True).compress(b'a' * 40).hex())"`
        let mut packed = [
            0x28, 0xb5, 0x2f, 0xfd, 0x24, 0x28, 0x45, 0x00, 0x00, 0x10, 0x61, 0x61, 0x01, 0x00, 0x1f, 0x80, 0x05, 0x03,
            0xef, 0x11, 0x31,
        ];
        assert_eq!(all("zstd", &packed).unwrap(), [b'a'; 40]);
        packed[20] ^= 1;
        assert!(all("zstd", &packed).unwrap_err().to_string().contains("checksum"));
    }

    #[test]
    fn lz4_comes_back_and_its_damage_is_found() {
        let text = b"lz4 lz4 lz4 of some length ".repeat(9000);
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(&text).unwrap();
        let packed = encoder.finish().unwrap();
        assert_eq!(all("lz4", &packed).unwrap(), text);
        assert!(all("lz4", &packed[..packed.len() / 2]).is_err());
        assert!(unpack("brotli", Cursor::new(packed)).is_none());
    }
}
