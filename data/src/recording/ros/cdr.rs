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

    /// A sequence of bytes.
    fn bytes(&mut self, field: &str) -> Result<&'a [u8]> {
        let n_bytes = u32::read(self, field)? as usize;
        self.take(n_bytes, field)
    }

    /// The next field.
    ///
    /// # Errors
    /// As [`Field::read`].
    pub fn read<F: Field>(&mut self, name: &str) -> Result<F> {
        F::read(self, name)
    }

    /// The count of a sequence; an item takes at least a byte.
    ///
    /// # Errors
    /// A count of more than the bytes that are left.
    pub fn count(&mut self, field: &str) -> Result<usize> {
        let count = u32::read(self, field)? as usize;
        let left = self.body.len() - self.at;
        if count > left {
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

    /// A sequence of bytes, of less than 4 GiB.
    fn bytes(&mut self, bytes: &[u8]) {
        (bytes.len() as u32).write(self);
        self.body.extend(bytes);
    }

    /// The whole message: the header and the fields.
    pub fn finish(self) -> Vec<u8> {
        [&HEADER[..], &self.body].concat()
    }
}

/// What a message is made of: numbers, texts, sequences, and structs of these.
pub trait Field: Sized {
    /// Reads it; `name` names it in errors.
    ///
    /// # Errors
    /// Bytes that end too early, text that is not UTF-8.
    fn read(cdr: &mut Reader, name: &str) -> Result<Self>;
    /// Writes it.
    fn write(&self, cdr: &mut Writer);
}

/// Numbers of some bytes, little endian.
macro_rules! numbers {
    ($($number:ty),+) => { $(
        impl Field for $number {
            fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
                cdr.number(name).map(Self::from_le_bytes)
            }

            fn write(&self, cdr: &mut Writer) {
                cdr.number(self.to_le_bytes());
            }
        }
    )+ };
}

numbers!(u8, u32, i32, f32, f64);

impl Field for bool {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        u8::read(cdr, name).map(|byte| byte != 0)
    }

    fn write(&self, cdr: &mut Writer) {
        u8::from(*self).write(cdr);
    }
}

impl Field for String {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        let bytes = cdr.bytes(name)?;
        let text = std::str::from_utf8(bytes.strip_suffix(&[0]).unwrap_or(bytes));
        text.map(str::to_owned).map_err(|e| Error::invalid(cdr.place, format!("{name} in UTF-8"), e.to_string()))
    }

    fn write(&self, cdr: &mut Writer) {
        (self.len() as u32 + 1).write(cdr);
        cdr.body.extend(self.as_bytes());
        cdr.body.push(0);
    }
}

impl<const N: usize> Field for [f64; N] {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = f64::read(cdr, name)?;
        }
        Ok(values)
    }

    fn write(&self, cdr: &mut Writer) {
        self.iter().for_each(|value| value.write(cdr));
    }
}

impl Field for Vec<u8> {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        cdr.bytes(name).map(<[u8]>::to_vec)
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.bytes(self);
    }
}

impl Field for Vec<i8> {
    fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
        Ok(cdr.bytes(name)?.iter().map(|byte| byte.cast_signed()).collect())
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.bytes(&self.iter().map(|value| value.cast_unsigned()).collect::<Vec<u8>>());
    }
}

/// A struct as a field, its own fields in this order, and a sequence of such; with `in` it is a message of a type, with a definition.
macro_rules! fields {
    ($of:ident { $($field:ident),+ } $(in $type:literal, $definition:ident)?) => {
        impl Field for $of {
            fn read(cdr: &mut Reader, _: &str) -> Result<Self> {
                Ok(Self { $($field: Field::read(cdr, stringify!($field))?),+ })
            }

            fn write(&self, cdr: &mut Writer) {
                $(self.$field.write(cdr);)+
            }
        }

        impl Field for Vec<$of> {
            fn read(cdr: &mut Reader, name: &str) -> Result<Self> {
                (0..cdr.count(name)?).map(|_| Field::read(cdr, name)).collect()
            }

            fn write(&self, cdr: &mut Writer) {
                (self.len() as u32).write(cdr);
                self.iter().for_each(|item| item.write(cdr));
            }
        }

        $(
            impl Message for $of {
                const TYPE: &str = $type;
                const DEFINITION: &str = definitions::$definition;
            }
        )?
    };
}
pub(super) use fields;
