//! A bank as one file, and the checksum of what an episode's numbers depend on.

use std::path::Path;
use std::sync::Arc;

use tactile_data::grid::PoseGrid;
use tactile_data::symmetry::Symmetry;

use super::{Bank, SCHEMA};
use crate::checkpoint::{from_json, to_json};
use crate::error::{Error, Result};
use crate::matches::Matches;
use crate::model::Model;
use crate::precision::Precision;
use crate::rows::Rows;
use crate::safefile::{NamedTensor, SafeFile};
use crate::views::Views;

impl Bank {
    /// Saves the bank in one file, bound to its model's checksum, its rows in the format they are kept in.
    ///
    /// # Errors
    /// A file that cannot be written; the one that was there stays.
    pub fn save(&self, path: &Path) -> Result<()> {
        let mut file = self.identity()?;
        file.text.push(("symmetries".into(), to_json(&self.symmetries)?));
        if let Some(origin) = &self.origin {
            file.text.push(("origin".into(), to_json(origin)?));
        }
        file.save_as(path, SCHEMA, self.rows.precision())
    }

    /// SHA-256 of its parts, poses, rows and model, as 64 hex digits: of all that an episode's numbers depend on.
    ///
    /// # Errors
    /// None that a bank could have; building the text of it may fail in principle.
    pub fn sha256(&self) -> Result<String> {
        Ok(self.identity()?.sha256())
    }

    fn identity(&self) -> Result<SafeFile> {
        let n_rows = self.n_rows();
        let tensor = |name: &str, shape, values| NamedTensor { name: name.into(), shape, values };
        let (rows, scales) = self.rows.parts();
        let mut tensors = vec![
            tensor("rows", vec![n_rows, self.dim()], rows),
            tensor("edge_shares", vec![n_rows], self.edge_shares.clone()),
        ];
        tensors.extend(scales.map(|scales| tensor("scales", vec![n_rows], scales)));
        let mut text = vec![
            ("parts".into(), to_json(&self.parts)?),
            ("grid".into(), to_json(&self.grid)?),
            ("model_sha256".into(), self.model_sha256.to_string()),
        ];
        if *self.matches != Matches::default() {
            text.push(("matches".into(), to_json(&*self.matches)?));
        }
        if !self.views.is_pegs() {
            text.push(("views".into(), self.views.name().into()));
        }
        if !self.missing.is_empty() {
            text.push(("missing".into(), to_json(&self.missing)?));
        }
        Ok(SafeFile { tensors, blobs: Vec::new(), text })
    }

    /// Loads a bank, its rows in the format that the file holds.
    ///
    /// # Errors
    /// [`Error::WrongModel`] for one made by another model; a file that cannot be read, is damaged or holds no bank.
    pub fn load(path: &Path, model: &Model) -> Result<Self> {
        let (file, precision) = SafeFile::load_as(path, SCHEMA)?;
        let got = file.text("model_sha256").map_err(|error| error.within(path.display()))?;
        if *got != **model.sha256() {
            let (what, expected) = (path.display().to_string(), model.sha256().to_string());
            return Err(Error::WrongModel { what, expected, got: got.into() });
        }
        Self::of_file(file, precision).map_err(|error| error.within(path.display()))
    }

    fn of_file(mut file: SafeFile, precision: Precision) -> Result<Self> {
        let parts: Vec<String> = from_json(file.text("parts")?)?;
        let grid: PoseGrid = from_json(file.text("grid")?)?;
        let model_sha256: Arc<str> = file.text("model_sha256")?.into();
        let symmetries: Vec<Symmetry> = from_json(file.text("symmetries")?)?;
        let origin = file.text("origin").ok().map(from_json).transpose()?;
        let missing: Vec<usize> = file.text("missing").ok().map(from_json).transpose()?.unwrap_or_default();
        let views: Views = file.text("views").ok().map(str::parse).transpose()?.unwrap_or_default();
        let matches: Option<Matches> = file.text("matches").ok().map(from_json).transpose()?;
        let mut take = |name: &str| {
            let at = file.tensors.iter().position(|tensor| tensor.name == name);
            at.map(|at| file.tensors.swap_remove(at)).ok_or_else(|| Error::invalid(name, "a tensor", "none"))
        };
        let rows = take("rows")?;
        let edge_shares = take("edge_shares")?;
        let rows = match (rows.shape.get(1), precision) {
            (Some(dim), Precision::I8) => Rows::scaled(*dim, &rows.values, take("scales")?.values)?,
            (Some(dim), _) => Rows::new(*dim, rows.values)?.to_precision(precision)?,
            (None, _) => return Err(Error::invalid("rows", "a shape [n, dim]", format!("{:?}", rows.shape))),
        };
        let bank = Self::of_rows(parts, grid, rows, edge_shares.values, model_sha256)?;
        let bank = Self { origin, views, ..bank }.with_symmetries(symmetries)?.lacking(missing)?;
        match matches {
            Some(matches) => bank.with_matches(matches),
            None => Ok(bank),
        }
    }
}
