//! Columns of a Parquet file, written as `pyarrow` writes them: every value may be null, and none is
//! (<https://parquet.apache.org/docs/file-format/nestedencoding/>).

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use parquet::basic::{Compression, Encoding};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int64Type};
use parquet::errors::ParquetError;
use parquet::file::metadata::KeyValue;
use parquet::file::properties::{EnabledStatistics, WriterProperties};
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::parser::parse_message_type;
use parquet::schema::types::ColumnPath;

use crate::error::{Error, Result};

/// The values of one column in some rows.
pub enum Values {
    /// Whole numbers.
    Longs(Vec<i64>),
    /// Numbers of four bytes.
    Floats(Vec<f32>),
    /// Numbers of eight bytes.
    Doubles(Vec<f64>),
    /// Text.
    Texts(Vec<String>),
    /// Lists of as many numbers each.
    Lists(usize, Vec<f32>),
    /// Lists of one text each.
    Named(Vec<String>),
    /// The files of pictures, and their names.
    Pictures(Vec<Vec<u8>>, Vec<String>),
}

/// A column and its values.
pub struct Column {
    name: String,
    values: Values,
}

impl Column {
    /// A column of some name.
    pub fn new(name: impl Into<String>, values: Values) -> Self {
        Self { name: name.into(), values }
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Its values.
    pub fn values(&self) -> &Values {
        &self.values
    }

    fn field(&self) -> String {
        let name = &self.name;
        match self.values {
            Values::Longs(_) => format!("optional int64 {name}; "),
            Values::Floats(_) => format!("optional float {name}; "),
            Values::Doubles(_) => format!("optional double {name}; "),
            Values::Texts(_) => format!("optional binary {name} (UTF8); "),
            Values::Lists(..) => {
                format!("optional group {name} (LIST) {{ repeated group list {{ optional float element; }} }} ")
            }
            Values::Named(_) => {
                format!("optional group {name} (LIST) {{ repeated group list {{ optional binary element (UTF8); }} }} ")
            }
            Values::Pictures(..) => {
                format!("optional group {name} {{ optional binary bytes; optional binary path (UTF8); }} ")
            }
        }
    }

    fn write(self, group: &mut SerializedRowGroupWriter<'_, File>) -> parquet::errors::Result<()> {
        let bytes =
            |texts: Vec<String>| -> Vec<ByteArray> { texts.into_iter().map(|text| text.into_bytes().into()).collect() };
        match self.values {
            Values::Longs(values) => write::<Int64Type>(group, &values, 1, None),
            Values::Floats(values) => write::<FloatType>(group, &values, 1, None),
            Values::Doubles(values) => write::<DoubleType>(group, &values, 1, None),
            Values::Texts(values) => write::<ByteArrayType>(group, &bytes(values), 1, None),
            Values::Lists(len, values) => write::<FloatType>(group, &values, 3, Some(len)),
            Values::Named(values) => write::<ByteArrayType>(group, &bytes(values), 3, Some(1)),
            Values::Pictures(pictures, names) => {
                let pictures: Vec<ByteArray> = pictures.into_iter().map(ByteArray::from).collect();
                write::<ByteArrayType>(group, &pictures, 2, None)?;
                write::<ByteArrayType>(group, &bytes(names), 2, None)
            }
        }
    }
}

/// Writes the next column of a group: values that are all there, at the deepest level; in lists of `len` where it is a list.
fn write<T: DataType>(
    group: &mut SerializedRowGroupWriter<'_, File>,
    values: &[T::T],
    level: i16,
    len: Option<usize>,
) -> parquet::errors::Result<()> {
    let levels = vec![level; values.len()];
    let begins = len.map(|len| (0..values.len()).map(|i| i16::from(!i.is_multiple_of(len))).collect::<Vec<_>>());
    let missing = || ParquetError::General("a column more than the schema has".into());
    let mut writer = group.next_column()?.ok_or_else(missing)?;
    writer.typed::<T>().write_batch(values, Some(&levels), begins.as_deref())?;
    writer.close()
}

/// A Parquet file that is being written, some rows at a time.
pub struct Table {
    path: PathBuf,
    writer: SerializedFileWriter<File>,
}

impl Table {
    /// Begins a file for columns of these names and kinds; pictures are neither packed again nor put into statistics. `notes` are
    /// the file's own, by name.
    ///
    /// # Errors
    /// A file that cannot be written; a name that a schema cannot have.
    pub fn create(path: &Path, columns: &[Column], notes: &[(&str, String)]) -> Result<Self> {
        let fields: String = columns.iter().map(Column::field).collect();
        let failed = failed(path);
        let schema = parse_message_type(&format!("message schema {{ {fields} }}")).map_err(&failed)?;
        let notes = notes.iter().map(|(name, value)| KeyValue::new((*name).to_owned(), value.clone())).collect();
        let mut properties = WriterProperties::builder()
            .set_compression(Compression::SNAPPY)
            .set_key_value_metadata(Some(notes).filter(|notes: &Vec<KeyValue>| !notes.is_empty()));
        for column in columns.iter().filter(|column| matches!(column.values, Values::Pictures(..))) {
            let bytes = ColumnPath::new(vec![column.name.clone(), "bytes".into()]);
            properties = properties
                .set_column_dictionary_enabled(bytes.clone(), false)
                .set_column_encoding(bytes.clone(), Encoding::PLAIN)
                .set_column_compression(bytes.clone(), Compression::UNCOMPRESSED)
                .set_column_statistics_enabled(bytes, EnabledStatistics::None);
        }
        let file = File::create(path).map_err(Error::io(path))?;
        let writer = SerializedFileWriter::new(file, Arc::new(schema), Arc::new(properties.build())).map_err(failed)?;
        Ok(Self { path: path.to_path_buf(), writer })
    }

    /// Writes a whole file of some rows.
    ///
    /// # Errors
    /// As of [`Self::create`].
    pub fn write(path: &Path, columns: Vec<Column>, notes: &[(&str, String)]) -> Result<()> {
        let mut table = Self::create(path, &columns, notes)?;
        table.push(columns)?;
        table.finish()
    }

    /// Appends rows: a value of each column for each.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn push(&mut self, columns: Vec<Column>) -> Result<()> {
        let pushed = || {
            let mut group = self.writer.next_row_group()?;
            columns.into_iter().try_for_each(|column| column.write(&mut group))?;
            group.close().map(drop)
        };
        pushed().map_err(failed(&self.path))
    }

    /// Bytes written so far.
    pub fn n_bytes(&self) -> usize {
        self.writer.bytes_written()
    }

    /// Completes the file.
    ///
    /// # Errors
    /// A disk that cannot be written.
    pub fn finish(self) -> Result<()> {
        let Self { path, writer } = self;
        writer.close().map(drop).map_err(failed(&path))
    }
}

fn failed(path: &Path) -> impl Fn(ParquetError) -> Error {
    let place = path.display().to_string();
    move |error| Error::invalid(place.clone(), "a Parquet file that can be written", error.to_string())
}
