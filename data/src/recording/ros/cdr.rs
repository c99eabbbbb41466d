//! CDR, the bytes of a ROS 2 message: a header of four bytes, then the fields, each aligned to its size.
//!
//! Numbers are little endian; 2, 4 and 8 byte numbers start at a multiple of their size, counted from behind the
//! header (OMG DDS-RTPS 2.5, 10.2; XCDR version 1). Strings are a u32 length with the closing zero byte counted,
//! sequences a u32 count. A ROS 1 message has the same fields without header and alignment, and without the zero byte
//! (<http://wiki.ros.org/roscpp/Overview/MessagesSerializationAndAdaptingTypes>); so one reader does for both.

use crate::error::{Error, Result};

/// The header of plain CDR, little endian.
const HEADER: [u8; 4] = [0, 1, 0, 0];

/// How the fields of a message follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// CDR, as in ROS 2.
    Cdr,
    /// One field directly behind the other, as in ROS 1; a message's header begins with a number, `seq`.
    Ros1,
}

/// Reads fields in order. No length is believed before the bytes are seen to be there.
#[derive(Debug)]
pub struct Reader<'a> {
    /// The fields: of CDR, what follows the header.
    body: &'a [u8],
    at: usize,
    place: &'a str,
    layout: Layout,
}

impl<'a> Reader<'a> {
    /// Begins a message in CDR; `place` names it in errors.
    ///
    /// # Errors
    /// Another header than the header of plain CDR, little endian.
    pub fn new(message: &'a [u8], place: &'a str) -> Result<Self> {
        let got = match message {
            // The last two bytes are options, which say nothing of the layout.
            [0, 1, _, _, body @ ..] => return Ok(Self { body, at: 0, place, layout: Layout::Cdr }),
            [0, 0, _, _, ..] => "big endian".to_owned(),
            [a, b, c, d, ..] => format!("a header of {a:02x} {b:02x} {c:02x} {d:02x}"),
            short => format!("{} bytes", short.len()),
        };
        Err(Error::invalid(place, "a message in plain CDR, little endian (00 01 00 00)", got))
    }

    /// Begins a message in ROS 1's layout; `place` names it in errors.
    pub fn ros1(message: &'a [u8], place: &'a str) -> Self {
        Self { body: message, at: 0, place, layout: Layout::Ros1 }
    }

    /// How the message's fields follow each other.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// The next `n_bytes` bytes of `field`.
    fn take(&mut self, n_bytes: usize, field: &str) -> Result<&'a [u8]> {
        let left = &self.body[self.at..];
        let Some(bytes) = left.get(..n_bytes) else {
            let expected = format!("{n_bytes} bytes of {field}");
            return Err(Error::invalid(self.place, expected, format!("the last {}", left.len())));
        };
        self.at += n_bytes;
        Ok(bytes)
    }

    /// A number's bytes, after its alignment.
    fn number<const N: usize>(&mut self, field: &str) -> Result<[u8; N]> {
        if self.layout == Layout::Cdr {
            self.take(self.at.next_multiple_of(N) - self.at, field)?;
        }
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N, field)?);
        Ok(bytes)
    }

    /// An unsigned byte.
    pub fn u8(&mut self, field: &str) -> Result<u8> {
        Ok(self.number::<1>(field)?[0])
    }

    /// An unsigned number of 32 bits.
    pub fn u32(&mut self, field: &str) -> Result<u32> {
        self.number(field).map(u32::from_le_bytes)
    }

    /// A signed number of 32 bits.
    pub fn i32(&mut self, field: &str) -> Result<i32> {
        self.number(field).map(i32::from_le_bytes)
    }

    /// A number with 32 bits.
    pub fn f32(&mut self, field: &str) -> Result<f32> {
        self.number(field).map(f32::from_le_bytes)
    }

    /// A number with 64 bits.
    pub fn f64(&mut self, field: &str) -> Result<f64> {
        self.number(field).map(f64::from_le_bytes)
    }

    /// A string of UTF-8.
    pub fn string(&mut self, field: &str) -> Result<String> {
        let bytes = self.bytes(field)?;
        let text = std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes));
        text.map(str::to_owned).map_err(|e| Error::invalid(self.place, format!("{field} in UTF-8"), e.to_string()))
    }

    /// A sequence of bytes.
    pub fn bytes(&mut self, field: &str) -> Result<&'a [u8]> {
        let n_bytes = self.u32(field)? as usize;
        self.take(n_bytes, field)
    }

    /// The count of a sequence whose items take at least `item_bytes` each.
    pub fn count(&mut self, item_bytes: usize, field: &str) -> Result<usize> {
        let count = self.u32(field)? as usize;
        let left = self.body.len() - self.at;
        if count.checked_mul(item_bytes).is_none_or(|needed| needed > left) {
            let got = format!("the last {left} bytes");
            return Err(Error::invalid(self.place, format!("{count} {field}"), got));
        }
        Ok(count)
    }
}

/// Writes fields in order.
#[derive(Debug, Default)]
pub struct Writer {
    body: Vec<u8>,
}

impl Writer {
    /// A number, after its alignment.
    fn number<const N: usize>(&mut self, bytes: [u8; N]) {
        self.body.resize(self.body.len().next_multiple_of(N), 0);
        self.body.extend(bytes);
    }

    /// An unsigned byte.
    pub fn u8(&mut self, value: u8) {
        self.body.push(value);
    }

    /// An unsigned number of 32 bits.
    pub fn u32(&mut self, value: u32) {
        self.number(value.to_le_bytes());
    }

    /// A signed number of 32 bits.
    pub fn i32(&mut self, value: i32) {
        self.number(value.to_le_bytes());
    }

    /// A number with 32 bits.
    pub fn f32(&mut self, value: f32) {
        self.number(value.to_le_bytes());
    }

    /// A number with 64 bits.
    pub fn f64(&mut self, value: f64) {
        self.number(value.to_le_bytes());
    }

    /// A string, of less than 4 GiB.
    pub fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.body.extend(text.as_bytes());
        self.body.push(0);
    }

    /// A sequence of bytes, of less than 4 GiB.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.body.extend(bytes);
    }

    /// The whole message: the header and the fields.
    pub fn finish(self) -> Vec<u8> {
        [&HEADER[..], &self.body].concat()
    }
}
