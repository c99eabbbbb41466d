//! Parquet files for tests.

use std::io::{Cursor, Write};
use std::ops::Range;
use std::sync::Arc;

use image::{ImageFormat, Rgb, RgbImage};
use parquet::basic::Compression;
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type, Int64Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;

/// A column of a test's file.
#[derive(Clone, Debug)]
pub enum Cells {
    /// The bytes of `image`; without a path.
    Pictures(Vec<Option<Vec<u8>>>),
    Text(&'static str, Vec<Option<&'static str>>),
    Floats(&'static str, Vec<Option<f32>>),
    Doubles(&'static str, Vec<Option<f64>>),
    Ints(&'static str, Vec<Option<i32>>),
    Longs(&'static str, Vec<Option<i64>>),
    /// Nanoseconds since 1970.
    Times(&'static str, Vec<Option<i64>>),
}

/// A file with groups of `group_len` rows.
pub fn table(columns: &[Cells], codec: Compression, group_len: usize) -> Vec<u8> {
    let fields: String = columns.iter().map(Cells::field).collect();
    let schema = Arc::new(parse_message_type(&format!("message schema {{ {fields} }}")).unwrap());
    let properties = Arc::new(WriterProperties::builder().set_compression(codec).build());
    let mut bytes = Vec::new();
    let mut writer = SerializedFileWriter::new(&mut bytes, schema, properties).unwrap();
    let n_rows = columns[0].len();
    for start in (0..n_rows).step_by(group_len) {
        let range = start..(start + group_len).min(n_rows);
        let mut group = writer.next_row_group().unwrap();
        for column in columns {
            column.write(range.clone(), &mut group);
        }
        group.close().unwrap();
    }
    writer.close().unwrap();
    bytes
}

impl Cells {
    fn field(&self) -> String {
        match self {
            Self::Pictures(_) => "optional group image { optional binary bytes; optional binary path (UTF8); } ".into(),
            Self::Text(name, _) => format!("optional binary {name} (UTF8); "),
            Self::Floats(name, _) => format!("optional float {name}; "),
            Self::Doubles(name, _) => format!("optional double {name}; "),
            Self::Ints(name, _) => format!("optional int32 {name} (INTEGER(8, true)); "),
            Self::Longs(name, _) => format!("optional int64 {name}; "),
            Self::Times(name, _) => format!("optional int64 {name} (TIMESTAMP(NANOS, true)); "),
        }
    }

    fn len(&self) -> usize {
        match self {
            Self::Pictures(cells) => cells.len(),
            Self::Text(_, cells) => cells.len(),
            Self::Floats(_, cells) => cells.len(),
            Self::Doubles(_, cells) => cells.len(),
            Self::Ints(_, cells) => cells.len(),
            Self::Longs(_, cells) | Self::Times(_, cells) => cells.len(),
        }
    }

    fn write<W: Write + Send>(&self, range: Range<usize>, group: &mut SerializedRowGroupWriter<W>) {
        match self {
            Self::Pictures(cells) => {
                let bytes: Vec<Option<ByteArray>> = cells[range.clone()].iter().cloned().map(bytes).collect();
                write::<ByteArrayType>(group, &bytes, 2);
                write::<ByteArrayType>(group, &vec![None; range.len()], 2);
            }
            Self::Text(_, cells) => {
                let text = |cell: &Option<&str>| bytes(cell.map(|text| text.as_bytes().to_vec()));
                write::<ByteArrayType>(group, &cells[range].iter().map(text).collect::<Vec<_>>(), 1);
            }
            Self::Floats(_, cells) => write::<FloatType>(group, &cells[range], 1),
            Self::Doubles(_, cells) => write::<DoubleType>(group, &cells[range], 1),
            Self::Ints(_, cells) => write::<Int32Type>(group, &cells[range], 1),
            Self::Longs(_, cells) | Self::Times(_, cells) => write::<Int64Type>(group, &cells[range], 1),
        }
    }
}

fn bytes(cell: Option<Vec<u8>>) -> Option<ByteArray> {
    cell.map(ByteArray::from)
}

fn write<T: DataType>(group: &mut SerializedRowGroupWriter<impl Write + Send>, cells: &[Option<T::T>], max_level: i16) {
    let levels: Vec<i16> = cells.iter().map(|cell| if cell.is_some() { max_level } else { 0 }).collect();
    let values: Vec<T::T> = cells.iter().flatten().cloned().collect();
    let mut writer = group.next_column().unwrap().unwrap();
    writer.typed::<T>().write_batch(&values, Some(&levels), None).unwrap();
    writer.close().unwrap();
}

/// A PNG of 16 x 12 pixels, lit everywhere.
pub fn png(value: u8) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let picture = RgbImage::from_fn(16, 12, |x, _| Rgb([value, value, value + 4 * x as u8]));
    picture.write_to(&mut bytes, ImageFormat::Png).unwrap();
    bytes.into_inner()
}
