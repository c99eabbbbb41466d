//! One Parquet file: the columns that an import knows, some rows at a time
//! (<https://parquet.apache.org/docs/file-format/>).

use std::collections::VecDeque;
use std::fs::File;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;

use parquet::basic::{Compression, ConvertedType, LogicalType, Type as Physical};
use parquet::column::reader::{ColumnReader, ColumnReaderImpl};
use parquet::data_type::{ByteArray, DataType};
use parquet::errors::ParquetError;
use parquet::file::reader::{FileReader, SerializedFileReader};
use parquet::schema::types::ColumnDescriptor;
use serde_json::{Map, Number, Value};

use crate::error::{Error, Result};
use crate::file::bounded_file;
use crate::recording::index::{COLUMNS, Place, Row, TEXT, touch_of};

/// Which columns of a file hold what.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// The column whose field `bytes` holds the picture.
    pub image: String,
    /// Columns that say what one of an index does, each with that one's name; what an index calls the same is known anyway.
    pub renamed: Vec<(String, &'static str)>,
    /// Columns that say nothing of touches.
    pub ignored: Vec<String>,
    /// Whether NaN and empty text say that nobody knows.
    pub has_blanks: bool,
    /// Where lists of numbers hold the pose.
    pub state: Option<State>,
}

/// A column of lists in which each list holds a pose.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// The column.
    pub column: String,
    /// Numbers in each list.
    pub len: usize,
    /// Which of them are x, y and the angle.
    pub axes: [usize; 3],
    /// What brings these to mm, mm and degrees.
    pub units: [f64; 3],
}

impl Layout {
    /// The layout of Hugging Face's images, with the columns of an index.
    pub fn of_index() -> Self {
        Self { image: "image".into(), ..Self::default() }
    }

    /// What a column that is not a picture's is called in an index.
    fn index_name(&self, name: &str) -> Option<&'static str> {
        let renamed = self.renamed.iter().find(|(column, _)| column == name).map(|(_, known)| *known);
        renamed.or_else(|| COLUMNS.into_iter().find(|known| *known != "file" && *known == name))
    }
}

/// Pictures read at once.
const BATCH: usize = 16;

/// A Parquet file whose columns have been checked.
pub struct Table {
    /// Columns that are not known, by name.
    pub unknown: Vec<String>,
    file: Arc<Path>,
    reader: SerializedFileReader<File>,
    image: usize,
    columns: Vec<Column>,
    /// Where each row's pose is a list, the column and what it holds.
    state: Option<(Column, State)>,
    has_blanks: bool,
}

/// A column that is read.
#[derive(Clone, Copy)]
struct Column {
    name: &'static str,
    /// Its number among the leaves of the schema.
    leaf: usize,
}

/// What a row says in one column.
#[derive(Clone, Debug)]
enum Cell {
    Null,
    Integer(i64),
    Number(f64),
    Bytes(ByteArray),
}

impl Table {
    /// Opens a file and checks that its columns are of types, and packed in ways, that are read.
    ///
    /// # Errors
    /// Another format, no pictures, or the column that is not as it should be.
    pub fn open(path: &Path, layout: &Layout) -> Result<Self> {
        let place = || path.display().to_string();
        let (file, len) = bounded_file::open(path)?;
        let reader =
            guarded(|| SerializedFileReader::new(file)).map_err(|e| Error::invalid(place(), "a Parquet file", e))?;
        let about = reader.metadata().file_metadata();
        // Each of them has a picture.
        if u64::try_from(about.num_rows()).is_ok_and(|n_rows| n_rows > len) {
            let got = format!("{} in {len} bytes", about.num_rows());
            return Err(Error::invalid(place(), "at most a row for each byte", got));
        }
        let (mut image, mut columns, mut unknown, mut state) = (None, Vec::new(), Vec::new(), None);
        for (leaf, descriptor) in about.schema_descr().columns().iter().enumerate() {
            let parts: Vec<&str> = descriptor.path().parts().iter().map(String::as_str).collect();
            let known = if let [name] = parts[..] { layout.index_name(name) } else { None };
            let of_state = layout.state.as_ref().filter(|state| parts[0] == state.column);
            match (known, parts.as_slice()) {
                (Some(name), _) if columns.iter().any(|column: &Column| column.name == name) => {
                    return Err(Error::invalid(place(), "each column once", format!("{name} twice")));
                }
                (Some(name), _) => columns.push(Column { name, leaf }),
                (None, [name, "bytes"]) if *name == layout.image => image = Some(leaf),
                (None, [name, "path"]) if *name == layout.image => {}
                _ if of_state.is_some() => state = of_state.map(|of| (Column { name: "state", leaf }, of.clone())),
                (None, [name, ..]) if layout.ignored.iter().any(|ignored| ignored == name) => {}
                (None, _) if unknown.iter().any(|name| name == parts[0]) => {}
                (None, _) => unknown.push(parts[0].to_owned()),
            }
        }
        let Some(image) = image else {
            let got = unknown.first().map_or("none", String::as_str);
            let expected = format!("a column {} with the fields bytes and path", layout.image);
            return Err(Error::invalid(place(), expected, got));
        };
        if let (Some(State { column, .. }), None) = (&layout.state, &state) {
            return Err(Error::invalid(place(), format!("a column {column}"), "none"));
        }
        let table = Self { unknown, file: path.into(), reader, image, columns, state, has_blanks: layout.has_blanks };
        table.check()?;
        Ok(table)
    }

    /// Checks the groups' rows, and the columns' types and codecs.
    fn check(&self) -> Result<()> {
        let about = self.reader.metadata();
        let n_rows = about.row_groups().iter().try_fold(0_i64, |n, group| n.checked_add(group.num_rows().max(0)));
        if n_rows != Some(about.file_metadata().num_rows()) {
            let expected = format!("{} rows", about.file_metadata().num_rows());
            return Err(Error::invalid(self.file.display().to_string(), expected, format!("{n_rows:?} in its groups")));
        }
        let picture = Column { name: "image.bytes", leaf: self.image };
        let state = self.state.as_ref().map(|(column, _)| column);
        for column in self.columns.iter().chain([&picture]).chain(state) {
            let descriptor = about.file_metadata().schema_descr().column(column.leaf);
            let place = format!("{}: column {}", self.file.display(), column.name);
            check_type(column.name, &descriptor, &place)?;
            for group in about.row_groups() {
                check_codec(group.column(column.leaf).compression(), &self.file, &place)?;
            }
        }
        Ok(())
    }

    /// All rows, without their pictures.
    ///
    /// # Errors
    /// A value that is not what its column's name says, with its row.
    pub fn rows(&self) -> Result<Vec<Row>> {
        let mut rows = Vec::new();
        for group in 0..self.reader.num_row_groups() {
            let n = self.n_rows(group);
            let mut cells: Vec<Map<String, Value>> = vec![Map::new(); n];
            for column in &self.columns {
                let mut reader = self.column(group, *column)?;
                for (i, cell) in self.cells(&mut reader, *column, n, rows.len())?.into_iter().enumerate() {
                    if self.has_blanks && cell.is_blank() {
                        continue;
                    }
                    if let Some(value) = cell.value(column.name, &self.place(rows.len() + i))? {
                        cells[i].insert(column.name.to_owned(), value);
                    }
                }
            }
            self.insert_poses(group, rows.len(), &mut cells)?;
            for cells in cells {
                let place = self.place(rows.len());
                rows.push(Row { touch: touch_of(cells, &place)?, place, file: None });
            }
        }
        Ok(rows)
    }

    /// Puts the poses of a group's lists, if it has any, into the cells of its rows, the first of which is `first`.
    fn insert_poses(&self, group: usize, first: usize, cells: &mut [Map<String, Value>]) -> Result<()> {
        let Some((column, State { column: name, len, axes, units })) = &self.state else { return Ok(()) };
        let mut reader = self.column(group, *column)?;
        // The values of all lists, one behind the other.
        let values = self.cells(&mut reader, *column, cells.len(), first)?;
        let bad = |row: usize| {
            let expected = format!("a list of {len} numbers in each row");
            Error::invalid(format!("{}: {name}", self.place(first + row)), expected, format!("{} in all", values.len()))
        };
        if values.len() != len * cells.len() {
            return Err(bad(0));
        }
        for (row, (cells, list)) in cells.iter_mut().zip(values.chunks(*len)).enumerate() {
            for ((axis, unit), named) in axes.iter().zip(units).zip(["x_mm", "y_mm", "theta_deg"]) {
                match list[*axis] {
                    Cell::Number(value) if value.is_nan() => continue,
                    Cell::Number(value) => cells.insert(named.to_owned(), (unit * value).into()),
                    _ => return Err(bad(row)),
                };
            }
        }
        Ok(())
    }

    /// The pictures, in order, each with its place: the bytes of PNG or JPEG files.
    pub fn pictures(self) -> Pictures {
        Pictures { table: self, group: None, waiting: VecDeque::new(), n_groups: 0, n_rows: 0 }
    }

    fn place(&self, row: usize) -> Place {
        Place { file: Arc::clone(&self.file), unit: "row", number: row as u64 + 1 }
    }

    fn n_rows(&self, group: usize) -> usize {
        usize::try_from(self.reader.metadata().row_group(group).num_rows()).unwrap_or_default()
    }

    fn column(&self, group: usize, column: Column) -> Result<ColumnReader> {
        let open = || self.reader.get_row_group(group)?.get_column_reader(column.leaf);
        let place = || format!("{}: column {}", self.file.display(), column.name);
        guarded(open).map_err(|e| Error::invalid(place(), "one that can be read", e))
    }

    /// The next `n` cells of a column, from the row `first` on (from 0).
    fn cells(&self, reader: &mut ColumnReader, column: Column, n: usize, first: usize) -> Result<Vec<Cell>> {
        let descriptor = self.reader.metadata().file_metadata().schema_descr().column(column.leaf);
        let max_level = descriptor.max_def_level();
        let is_unsigned = matches!(descriptor.logical_type_ref(), Some(LogicalType::Integer(i)) if !i.is_signed)
            || matches!(descriptor.converted_type(), ConvertedType::UINT_32 | ConvertedType::UINT_64);
        let cells = guarded(|| match reader {
            ColumnReader::Int32ColumnReader(reader) => values(reader, n, max_level, |value| match is_unsigned {
                true => Cell::Integer(i64::from(value as u32)),
                false => Cell::Integer(i64::from(value)),
            }),
            ColumnReader::Int64ColumnReader(reader) => values(reader, n, max_level, |value| match is_unsigned {
                true => Cell::Number(value as u64 as f64),
                false => Cell::Integer(value),
            }),
            ColumnReader::FloatColumnReader(reader) => {
                values(reader, n, max_level, |value| Cell::Number(f64::from(value)))
            }
            ColumnReader::DoubleColumnReader(reader) => values(reader, n, max_level, Cell::Number),
            ColumnReader::ByteArrayColumnReader(reader) => values(reader, n, max_level, Cell::Bytes),
            // Refused when the file was opened.
            _ => Ok(Vec::new()),
        });
        let place = || format!("{} and behind it: {}", self.place(first), column.name);
        let cells = cells.map_err(|e| Error::invalid(place(), "values that can be read", e))?;
        if cells.len() == n || descriptor.max_rep_level() > 0 {
            return Ok(cells);
        }
        Err(Error::invalid(place(), format!("{n} values"), cells.len().to_string()))
    }
}

/// The cells of a column's next `n` rows, of lists those of one behind the other; fewer where it ends before. A value is there where
/// its level is `max_level`.
fn values<T: DataType>(
    reader: &mut ColumnReaderImpl<T>,
    n: usize,
    max_level: i16,
    cell: impl Fn(T::T) -> Cell,
) -> parquet::errors::Result<Vec<Cell>> {
    let (mut levels, mut begins, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let (_, _, n_levels) = reader.read_records(n, Some(&mut levels), Some(&mut begins), &mut values)?;
    // Of lists each begins at level 0.
    let len = begins.iter().skip(1).position(|level| *level == 0).map_or(begins.len(), |last| last + 1);
    if begins.iter().enumerate().any(|(i, level)| (*level == 0) != i.is_multiple_of(len)) {
        return Err(ParquetError::General("lists of different lengths".into()));
    }
    let mut values = values.into_iter().map(cell);
    if max_level == 0 {
        return Ok(values.collect());
    }
    let of_level = |level| if level == max_level { values.next().unwrap_or(Cell::Null) } else { Cell::Null };
    Ok(levels.into_iter().take(n_levels).map(of_level).collect())
}

/// The pictures of a table.
pub struct Pictures {
    table: Table,
    /// The group that is being read, and its rows still to come.
    group: Option<(ColumnReader, usize)>,
    /// Pictures that have been read.
    waiting: VecDeque<Cell>,
    /// Groups begun, and rows given.
    n_groups: usize,
    n_rows: usize,
}

impl Pictures {
    fn step(&mut self) -> Result<Option<(Place, Vec<u8>)>> {
        let column = Column { name: "image.bytes", leaf: self.table.image };
        while self.waiting.is_empty() {
            match &mut self.group {
                Some((reader, left)) if *left > 0 => {
                    let n = BATCH.min(*left);
                    *left -= n;
                    self.waiting = self.table.cells(reader, column, n, self.n_rows)?.into();
                }
                _ if self.n_groups == self.table.reader.num_row_groups() => return Ok(None),
                _ => {
                    let left = self.table.n_rows(self.n_groups);
                    self.group = Some((self.table.column(self.n_groups, column)?, left));
                    self.n_groups += 1;
                }
            }
        }
        let place = self.table.place(self.n_rows);
        self.n_rows += 1;
        match self.waiting.pop_front() {
            Some(Cell::Bytes(bytes)) if !bytes.is_empty() => Ok(Some((place, bytes.data().to_vec()))),
            _ => Err(Error::invalid(format!("{place}: image.bytes"), "the bytes of a PNG or JPEG", "none")),
        }
    }
}

impl Iterator for Pictures {
    type Item = Result<(Place, Vec<u8>)>;

    fn next(&mut self) -> Option<Self::Item> {
        self.step().transpose()
    }
}

impl Cell {
    /// Whether it says that nobody knows, where a file has no nulls.
    fn is_blank(&self) -> bool {
        match self {
            Self::Null => true,
            Self::Number(value) => value.is_nan(),
            Self::Bytes(bytes) => bytes.is_empty(),
            Self::Integer(_) => false,
        }
    }

    /// What the cell says under a name of an index.
    fn value(self, name: &str, place: &Place) -> Result<Option<Value>> {
        let is_text = TEXT.contains(&name);
        let bad = |expected: &str, got: String| Error::invalid(format!("{place}: {name}"), expected, got);
        let number = |number: f64| {
            let value = Number::from_f64(number).map(Value::Number);
            value.ok_or_else(|| bad("a number", number.to_string()))
        };
        Ok(Some(match self {
            Self::Null => return Ok(None),
            Self::Integer(integer) if is_text => Value::String(integer.to_string()),
            Self::Integer(integer) => number(integer as f64)?,
            Self::Number(value) => number(value)?,
            Self::Bytes(bytes) => match std::str::from_utf8(bytes.data()) {
                Ok(text) => Value::String(text.to_owned()),
                Err(error) => return Err(bad("text in UTF-8", error.to_string())),
            },
        }))
    }
}

fn check_type(name: &str, descriptor: &ColumnDescriptor, place: &str) -> Result<()> {
    use ConvertedType::{ENUM, INT_8, INT_16, INT_32, INT_64, NONE, UINT_8, UINT_16, UINT_32, UINT_64, UTF8};
    // A file states the newer logical type, the older converted type, or both.
    let (logical, converted) = (descriptor.logical_type_ref(), descriptor.converted_type());
    let is_integer = matches!(logical, None | Some(LogicalType::Integer(_)))
        && matches!(converted, NONE | INT_8 | INT_16 | INT_32 | INT_64 | UINT_8 | UINT_16 | UINT_32 | UINT_64);
    let is_text = matches!(logical, None | Some(LogicalType::String | LogicalType::Enum))
        && matches!(converted, NONE | UTF8 | ENUM);
    let (is_right, expected) = match descriptor.physical_type() {
        Physical::FLOAT | Physical::DOUBLE if name == "state" => (descriptor.max_rep_level() == 1, "lists of numbers"),
        _ if name == "state" => (false, "lists of numbers (FLOAT or DOUBLE)"),
        _ if descriptor.max_rep_level() > 0 => (false, "one value in each row"),
        Physical::BYTE_ARRAY if name == "image.bytes" => (true, ""),
        _ if name == "image.bytes" => (false, "bytes (BYTE_ARRAY)"),
        Physical::INT32 | Physical::INT64 => (is_integer, "whole numbers"),
        Physical::BYTE_ARRAY if TEXT.contains(&name) => (is_text, "text"),
        Physical::FLOAT | Physical::DOUBLE if !TEXT.contains(&name) => (true, ""),
        _ if TEXT.contains(&name) => (false, "text or whole numbers"),
        _ => (false, "numbers (FLOAT, DOUBLE, INT32 or INT64)"),
    };
    if is_right {
        return Ok(());
    }
    let got = match (logical, converted) {
        (Some(logical), _) => format!("{logical:?}"),
        (None, NONE) => descriptor.physical_type().to_string(),
        (None, converted) => converted.to_string(),
    };
    Err(Error::invalid(place, expected, got))
}

/// The codecs whose decoder is written in Rust are read; the decoder of zstd is not.
fn check_codec(codec: Compression, file: &Path, place: &str) -> Result<()> {
    use Compression::{GZIP, LZ4, LZ4_RAW, SNAPPY, UNCOMPRESSED};
    if matches!(codec, UNCOMPRESSED | SNAPPY | GZIP(_) | LZ4 | LZ4_RAW) {
        return Ok(());
    }
    let got = format!(
        "{codec}; first: python -c \"import pyarrow.parquet as p; p.write_table(p.read_table('{}'), 'out.parquet', \
         compression='snappy')\"",
        file.display()
    );
    Err(Error::invalid(place, "no compression, snappy, gzip or lz4", got))
}

/// What `read` reads, or why it cannot. The reader of the crate `parquet` panics at some damage in a page; that ends
/// the import with an error, and the reader is not asked again.
fn guarded<T>(read: impl FnOnce() -> parquet::errors::Result<T>) -> std::result::Result<T, String> {
    match catch_unwind(AssertUnwindSafe(read)) {
        Ok(Ok(value)) => Ok(value),
        Ok(Err(error)) => Err(error.to_string().replace(['\n', '\r'], " ")),
        Err(_) => Err("damage".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use parquet::basic::{BrotliLevel, ZstdLevel};

    #[test]
    fn codecs_that_are_not_read_are_refused_with_the_command_that_packs_again() {
        for codec in [Compression::ZSTD(ZstdLevel::default()), Compression::BROTLI(BrotliLevel::default())] {
            let message = check_codec(codec, Path::new("a.parquet"), "a.parquet: column x_mm").unwrap_err().to_string();
            assert!(message.contains("snappy, gzip or lz4, got ") && message.contains("read_table('a.parquet')"));
            assert!(!message.contains('\n'), "{message}");
        }
    }
}
