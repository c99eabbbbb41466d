//! A bank as one file, and the checksum of what an episode's numbers depend on.
//!
//! The file is written and read part by part, so that saving and loading take little more memory than the bank. It
//! states a checksum of the whole, and one of each part, which tells what is spoilt where the whole does not fit.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::ops::{Range, RangeInclusive};
use std::path::Path;
use std::sync::Arc;

use half::f16;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::symmetry::Symmetry;

use super::{Bank, SCHEMA};
use crate::bank::matches::Matches;
use crate::bank::metric::Metric;
use crate::bank::rows::{MAX_DIM, Rows};
use crate::bank::similarity::dot;
use crate::bank::views::Views;
use crate::embedding::checkpoint::{from_json, to_json};
use crate::embedding::model::Model;
use crate::embedding::precision::Precision;
use crate::error::{Error, Result};
use crate::maps::Maps;
use crate::maps::mosaic::Mosaics;
use crate::safefile::pieces::{Entry, Opened, header, read_values, sha256_of};
use crate::safefile::{ContentHash, text_of, write_in_pieces};

/// Names of the tensors.
const ROWS: &str = "rows";
const EDGE_SHARES: &str = "edge_shares";
const SCALES: &str = "scales";
const METRIC: &str = "metric";
const MOSAICS: &str = "mosaics";

/// Name of the text entry with what was measured in a metric.
const MEASURED: &str = "metric_measured";

/// Name of the text entry with what a verifier says of each part's own touches.
const VERIFIED: &str = "verified";

/// Name of the text entry with how a metric was learnt.
const LEARNING: &str = "metric_learning";

/// Name of the text entry with the checksum of each part.
const OF_PARTS: &str = "part_sha256";

/// The tensors of a bank.
struct Content<'b> {
    rows: &'b Rows,
    edge_shares: &'b [f32],
    /// The scales of rows of i8.
    scales: Option<Vec<f32>>,
    /// A metric's matrix, `[dim, dim]`.
    metric: Option<&'b [f32]>,
    mosaics: Option<&'b Mosaics>,
}

impl<'b> Content<'b> {
    fn new(rows: &'b Rows, edge_shares: &'b [f32], metric: Option<&'b [f32]>, mosaics: Option<&'b Mosaics>) -> Self {
        Self { rows, edge_shares, scales: rows.scales(), metric, mosaics }
    }

    fn n_rows(&self) -> usize {
        self.edge_shares.len()
    }

    /// What the header says of them, in the order that they have in a file.
    fn entries(&self) -> Vec<Entry<'static>> {
        let (n, precision) = (self.n_rows(), self.rows.precision());
        let mut entries = vec![(EDGE_SHARES, Precision::F32, vec![n])];
        entries.extend(self.metric.map(|_| (METRIC, Precision::F32, vec![self.rows.dim(); 2])));
        entries.extend(self.scales.as_ref().map(|_| (SCALES, Precision::F32, vec![n])));
        entries.extend(self.mosaics.map(|mosaics| (MOSAICS, Precision::F16, mosaics.shape().to_vec())));
        entries.push((ROWS, precision, vec![n, self.rows.dim()]));
        entries
    }

    /// The rows of each part, where `n_cells` make one.
    fn parts(&self, n_cells: usize) -> impl Iterator<Item = Range<usize>> {
        let n_rows = self.n_rows();
        (0..n_rows).step_by(n_cells.max(1)).map(move |start| start..(start + n_cells).min(n_rows))
    }

    fn write(&self, header: &[u8], n_cells: usize, file: &mut BufWriter<File>) -> std::io::Result<()> {
        file.write_all(header)?;
        file.write_all(&bytes(self.edge_shares))?;
        file.write_all(&bytes(self.metric.unwrap_or_default()))?;
        file.write_all(&bytes(self.scales.as_deref().unwrap_or_default()))?;
        file.write_all(&self.mosaics.map_or(Vec::new(), Mosaics::bytes))?;
        self.parts(n_cells).try_for_each(|part| file.write_all(&self.rows.bytes(part)))
    }

    /// The checksum of a file with some text and these tensors: the one that
    /// [`SafeFile::sha256`](crate::safefile::SafeFile::sha256) has.
    fn sha256(&self, text: &[(String, String)], n_cells: usize) -> String {
        let (n, precision) = (self.n_rows(), self.rows.precision());
        let mut hash = ContentHash::of_text(text);
        hash.begin(EDGE_SHARES, &[n]);
        hash.values(self.edge_shares);
        if let Some(metric) = self.metric {
            hash.begin(METRIC, &[self.rows.dim(); 2]);
            hash.values(metric);
        }
        if let Some(mosaics) = self.mosaics {
            hash.begin(MOSAICS, &mosaics.shape());
            hash.values(mosaics.values());
        }
        hash.begin(ROWS, &[n, self.rows.dim()]);
        self.parts(n_cells).for_each(|part| hash.values(&precision.from_bytes(&self.rows.bytes(part))));
        if let Some(scales) = &self.scales {
            hash.begin(SCALES, &[n]);
            hash.values(scales);
        }
        hash.finish()
    }

    /// The checksum of what a file holds of each part.
    fn of_parts(&self, n_cells: usize) -> Vec<String> {
        let of_part = |part: Range<usize>| {
            let scales = self.scales.as_ref().map_or(Vec::new(), |scales| bytes(&scales[part.clone()]));
            sha256_of(&[&self.rows.bytes(part.clone()), &bytes(&self.edge_shares[part]), &scales])
        };
        self.parts(n_cells).map(of_part).collect()
    }
}

fn bytes(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

impl Bank {
    /// Saves the bank in one file, bound to its model's checksum, its rows in the format they are kept in.
    ///
    /// # Errors
    /// A file that cannot be written; the one that was there stays.
    pub fn save(&self, path: &Path) -> Result<()> {
        let (content, n_cells) = (self.content(), self.grid.len());
        let mut text = self.identity()?;
        text.push(("symmetries".into(), to_json(&self.symmetries)?));
        if let Some(origin) = &self.origin {
            text.push(("origin".into(), to_json(origin)?));
        }
        if let Some(learning) = self.metric().and_then(Metric::learning) {
            text.push((LEARNING.into(), to_json(&learning)?));
        }
        text.push((OF_PARTS.into(), to_json(&content.of_parts(n_cells))?));
        let sha256 = content.sha256(&text, n_cells);
        let header = header(&content.entries(), text, SCHEMA, sha256)?;
        write_in_pieces(path, &|file| content.write(&header, n_cells, file))
    }

    /// SHA-256 of its parts, poses, rows and model, as 64 hex digits: of all that an episode's numbers depend on.
    ///
    /// # Errors
    /// None that a bank could have; building the text of it may fail in principle.
    pub fn sha256(&self) -> Result<String> {
        Ok(self.content().sha256(&self.identity()?, self.grid.len()))
    }

    fn content(&self) -> Content<'_> {
        Content::new(&self.rows, &self.edge_shares, self.metric().map(Metric::matrix), self.mosaics())
    }

    /// The text of all that an episode's numbers depend on.
    fn identity(&self) -> Result<Vec<(String, String)>> {
        let mut text = vec![
            ("parts".into(), to_json(&self.parts)?),
            ("grid".into(), to_json(&self.grid)?),
            ("model_sha256".into(), self.model_sha256.to_string()),
        ];
        if self.start != self.grid {
            text.push(("start".into(), to_json(&self.start)?));
        }
        if let Some(expected) = self.expected() {
            text.push((VERIFIED.into(), to_json(expected)?));
        }
        if *self.matches != Matches::default() {
            text.push(("matches".into(), to_json(&*self.matches)?));
        }
        if !self.views.is_pegs() {
            text.push(("views".into(), self.views.name().into()));
        }
        if let Some(metric) = self.metric() {
            text.push((MEASURED.into(), to_json(&metric.measured())?));
        }
        if !self.missing.is_empty() {
            text.push(("missing".into(), to_json(&self.missing)?));
        }
        Ok(text)
    }

    /// Loads a bank, its rows in the format that the file holds. Where it has maps of its parts, what judges by maps with the model
    /// judges its touches.
    ///
    /// # Errors
    /// [`Error::WrongModel`] for one made by another model; one whose maps are of other networks than the model's; a file that cannot be read, is damaged, in a part that is
    /// named where that is known, or holds no bank.
    pub fn load(path: &Path, model: &Model) -> Result<Self> {
        let within = |error: Error| error.within(path.display());
        let mut file = Opened::new(path, SCHEMA)?;
        let loaded = Loaded::read(&mut file).map_err(within)?;
        loaded.check(&file).map_err(within)?;
        let got = text_of(&file.text, "model_sha256").map_err(within)?;
        if *got != **model.sha256() {
            let (what, expected) = (path.display().to_string(), model.sha256().to_string());
            return Err(Error::WrongModel { what, expected, got: got.into() });
        }
        let bank = loaded.bank(&file).map_err(within)?;
        match model.maps().and_then(Maps::verifier).filter(|_| bank.mosaics().is_some()) {
            Some(verifier) => bank.verified_by(verifier.clone()).map_err(within),
            None => Ok(bank),
        }
    }
}

/// Refuses recorded rows that are no embeddings: all have unit length, to what rounding to i8 leaves of it.
fn check_lengths(bank: &Bank) -> Result<()> {
    /// A value is rounded by up to a 254th of the row's largest: like ones, all to one side, change the length as much.
    const LENGTHS: RangeInclusive<f32> = 0.98..=1.02;
    let length = |row: usize| {
        let values = bank.row(row);
        dot(&values, &values).sqrt()
    };
    let odd = (0..bank.n_rows()).find(|row| bank.is_recorded(*row) && !LENGTHS.contains(&length(*row)));
    match odd {
        Some(row) => Err(Error::invalid(format!("row {row}"), "an embedding of unit length", length(row).to_string())),
        None => Ok(()),
    }
}

fn read_mosaics(file: &mut Opened) -> Result<Mosaics> {
    let found = file.entry(MOSAICS)?;
    let (Precision::F16, [n_sides, n_parts, n, across, n_values]) = (found.0, &found.1[..]) else {
        return Err(Error::invalid(
            MOSAICS,
            "values [sides, parts, n, n, 5] of f16",
            format!("{:?} of {}", found.1, found.0),
        ));
    };
    let shape = [*n_sides, *n_parts, *n, *across, *n_values];
    let values = file.read(MOSAICS, |reader| {
        read_values(reader, shape.iter().product(), |bytes| f16::from_le_bytes(bytes).to_f32())
    })?;
    Mosaics::new(shape, values)
}

/// The tensors of a bank's file as they were read.
struct Loaded {
    rows: Rows,
    edge_shares: Vec<f32>,
    metric: Option<Vec<f32>>,
    mosaics: Option<Mosaics>,
}

impl Loaded {
    fn read(file: &mut Opened) -> Result<Self> {
        let (precision, shape) = file.entry(ROWS)?;
        let [n, dim] = shape[..] else {
            return Err(Error::invalid(ROWS, "a shape [n, dim]", format!("{shape:?}")));
        };
        let has_metric = file.names().iter().any(|name| name == METRIC);
        if !(1..=MAX_DIM).contains(&dim) {
            return Err(Error::invalid(ROWS, format!("rows of 1..={MAX_DIM} values"), dim.to_string()));
        }
        let mut values = |name: &str, shape: Vec<usize>| {
            let (found, n) = (file.entry(name)?, shape.iter().product());
            if found != (Precision::F32, shape) {
                return Err(Error::invalid(
                    name,
                    format!("{n} values of f32"),
                    format!("{:?} of {}", found.1, found.0),
                ));
            }
            file.read(name, |reader| read_values(reader, n, f32::from_le_bytes))
        };
        let edge_shares = values(EDGE_SHARES, vec![n])?;
        let scales = if precision == Precision::I8 { values(SCALES, vec![n])? } else { Vec::new() };
        let metric = has_metric.then(|| values(METRIC, vec![dim; 2])).transpose()?;
        let mosaics = if file.names().iter().any(|name| name == MOSAICS) { Some(read_mosaics(file)?) } else { None };
        let rows = file.read(ROWS, |reader| Rows::read([n, dim], precision, scales, reader))?;
        let loaded = Self { rows, edge_shares, metric, mosaics };
        let mut expected: Vec<&str> = loaded.content().entries().iter().map(|(name, ..)| *name).collect();
        expected.sort_unstable();
        if file.names() != expected {
            return Err(Error::invalid("tensors", expected.join(", "), file.names().join(", ")));
        }
        Ok(loaded)
    }

    fn content(&self) -> Content<'_> {
        Content::new(&self.rows, &self.edge_shares, self.metric.as_deref(), self.mosaics.as_ref())
    }

    /// Compares the checksum of the whole with what the file states, and where they differ the checksums of its parts.
    fn check(&self, file: &Opened) -> Result<()> {
        let content = self.content();
        let n_cells =
            text_of(&file.text, "grid").and_then(from_json).map_or(self.edge_shares.len(), |grid: PoseGrid| {
                if grid.validate().is_ok() { grid.len() } else { self.edge_shares.len() }
            });
        let got = content.sha256(&file.text, n_cells);
        if got == file.sha256 {
            return Ok(());
        }
        let parts: Vec<String> = text_of(&file.text, "parts").and_then(from_json).unwrap_or_default();
        let stated: Vec<String> = text_of(&file.text, OF_PARTS).and_then(from_json).unwrap_or_default();
        let found = content.of_parts(n_cells);
        let compared = parts.iter().zip(stated.iter().zip(&found));
        let spoilt: Vec<&str> = compared.filter(|(_, (a, b))| a != b).map(|(part, _)| part.as_str()).collect();
        let expected = format!("checksum {}", file.sha256);
        match spoilt[..] {
            // All of them: it is their checksums that do not fit.
            [] => Err(Error::invalid("bank", expected, got)),
            _ if spoilt.len() == parts.len() && parts.len() > 1 => Err(Error::invalid("bank", expected, got)),
            [part] => Err(Error::invalid(format!("part {part}"), expected, "spoilt views; make the bank again")),
            [first, ..] => {
                let got = format!("spoilt views of {} parts; make the bank again", spoilt.len());
                Err(Error::invalid(format!("part {first}"), expected, got))
            }
        }
    }

    fn bank(self, file: &Opened) -> Result<Bank> {
        let parts: Vec<String> = from_json(text_of(&file.text, "parts")?)?;
        let grid: PoseGrid = from_json(text_of(&file.text, "grid")?)?;
        let start: Option<PoseGrid> = text_of(&file.text, "start").ok().map(from_json).transpose()?;
        let model_sha256: Arc<str> = text_of(&file.text, "model_sha256")?.into();
        let symmetries: Vec<Symmetry> = from_json(text_of(&file.text, "symmetries")?)?;
        let origin = text_of(&file.text, "origin").ok().map(from_json).transpose()?;
        let missing: Vec<usize> = text_of(&file.text, "missing").ok().map(from_json).transpose()?.unwrap_or_default();
        let views: Views = text_of(&file.text, "views").ok().map(str::parse).transpose()?.unwrap_or_default();
        let matches: Option<Matches> = text_of(&file.text, "matches").ok().map(from_json).transpose()?;
        let bank = Bank::of_rows(parts, grid, self.rows.checked()?, self.edge_shares, model_sha256)?;
        let metric = match self.metric {
            Some(matrix) => {
                let measured = from_json(text_of(&file.text, MEASURED)?)?;
                let metric = Metric::new(bank.dim(), matrix, measured)?;
                let learning = text_of(&file.text, LEARNING).ok().map(from_json).transpose()?;
                Some(Arc::new(match learning {
                    Some(learning) => metric.with_learning(learning),
                    None => metric,
                }))
            }
            None => None,
        };
        let bank = Bank { origin, views, metric, ..bank }.with_symmetries(symmetries)?.lacking(missing)?;
        let bank = match self.mosaics {
            Some(mosaics) => bank.with_mosaics(mosaics)?,
            None => bank,
        };
        let bank = match text_of(&file.text, VERIFIED) {
            Ok(text) => bank.with_expected(from_json(text)?)?,
            Err(_) => bank,
        };
        check_lengths(&bank)?;
        let bank = match start {
            Some(start) => bank.with_start(start)?,
            None => bank,
        };
        match matches {
            Some(matches) => bank.with_matches(matches),
            None => Ok(bank),
        }
    }
}
