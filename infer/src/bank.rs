//! The bank: one embedding for each recorded pose of each peg.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use rayon::prelude::*;
use tactile_data::frame::{Background, TactileImage};
use tactile_data::grid::PoseGrid;
use tactile_data::se2::Se2;
use tactile_data::store::Dataset;
use tactile_data::touch::Side;

use crate::checkpoint::{Model, from_json, to_json};
use crate::encoder::NamedTensor;
use crate::error::{Error, Result};
use crate::neighbours::{Neighbours, Once, neighbours};
use crate::precision::Precision;
use crate::rows::Rows;
use crate::safefile::SafeFile;
use crate::symmetry::{Symmetry, symmetry};

/// The version of the bank's layout.
pub const SCHEMA: &str = "tactile-filter/bank/1";

/// How far a recorded pose may lie from its grid cell: the robot's own repeatability.
const POSE_TOLERANCE: (f64, f64) = (0.5, 2.0);

/// Peg embeddings on a grid of poses: rows part-major, then grid cell, each of unit length.
#[derive(Clone, Debug, PartialEq)]
pub struct Bank {
    parts: Vec<String>,
    grid: PoseGrid,
    rows: Rows,
    edge_shares: Vec<f32>,
    model_sha256: String,
    symmetries: Vec<Once<Symmetry>>,
    neighbours: Once<Arc<[Neighbours]>>,
}

impl Bank {
    /// A bank from its rows, `[parts * grid.len(), dim]` in f32, and the share of each view that shows an edge.
    ///
    /// # Errors
    /// Numbers of rows or shares that do not fit parts and grid, rows that are not finite, shares outside 0..=1.
    pub fn from_rows(
        parts: Vec<String>,
        grid: PoseGrid,
        dim: usize,
        rows: Vec<f32>,
        edge_shares: Vec<f32>,
        model_sha256: String,
    ) -> Result<Self> {
        Self::of(parts, grid, Rows::new(dim, rows)?, edge_shares, model_sha256)
    }

    fn of(parts: Vec<String>, grid: PoseGrid, rows: Rows, edge_shares: Vec<f32>, model_sha256: String) -> Result<Self> {
        grid.validate()?;
        let n_rows = parts.len() * grid.len();
        if n_rows == 0 || rows.len() != n_rows || edge_shares.len() != n_rows {
            return Err(Error::invalid(
                "bank",
                format!("{} parts x {} poses", parts.len(), grid.len()),
                format!("{} rows and {} edge shares", rows.len(), edge_shares.len()),
            ));
        }
        if let Some(row) = edge_shares.iter().position(|share| !(0.0..=1.0).contains(share)) {
            let got = edge_shares[row].to_string();
            return Err(Error::invalid(format!("bank row {row}"), "an edge share in 0..=1", got));
        }
        let symmetries = vec![Once::new(); parts.len()];
        Ok(Self { parts, grid, rows, edge_shares, model_sha256, symmetries, neighbours: Once::new() })
    }

    /// The same bank with its rows kept in another format: less memory, and cosines a little off
    /// (ARCHITECTURE.md gives what each costs).
    ///
    /// # Errors
    /// A value beyond the format's range.
    pub fn with_precision(self, precision: Precision) -> Result<Self> {
        Self::of(self.parts, self.grid, self.rows.to_precision(precision)?, self.edge_shares, self.model_sha256)
    }

    /// Embeds a dataset of peg touches: each part at each pose of the dataset's reach, once.
    pub fn build(model: &Model, dataset: &Dataset, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Self> {
        let name = &dataset.meta().name;
        let grid = dataset.meta().reach.ok_or_else(|| {
            Error::invalid(format!("{name}: meta.json"), "a reach: the grid at which each peg was touched", "none")
        })?;
        let (parts, frame_of_row) = frames_by_row(dataset, &grid)?;
        let background = model.background(dataset.no_contact())?;
        let (mut rows, mut edge_shares) = (Vec::new(), Vec::new());
        for (done, frames) in frame_of_row.chunks(256).enumerate() {
            progress(done * 256, frame_of_row.len());
            let images = tactile_images(&background, dataset, frames)?;
            rows.extend(model.embed_pegs(&images)?);
            edge_shares.extend(images.iter().map(|image| image.edge_share));
        }
        progress(frame_of_row.len(), frame_of_row.len());
        Self::from_rows(parts, grid, model.dim(), rows, edge_shares, model.sha256().to_owned())
    }

    /// The bank without one part, by its index. What was worked out of the others is kept: bank after bank can
    /// be made so.
    ///
    /// # Errors
    /// A part that the bank does not hold, or the only one that it holds.
    pub fn without(&self, part: usize) -> Result<Self> {
        if part >= self.parts.len() {
            let got = format!("part {part}");
            return Err(Error::invalid("bank", format!("one of {} parts", self.parts.len()), got));
        }
        let n_cells = self.grid.len();
        let cut = part * n_cells..(part + 1) * n_cells;
        let keep = |i: &usize| *i != part;
        let parts = (0..self.parts.len()).filter(keep).map(|i| self.parts[i].clone()).collect();
        let edge_shares = [&self.edge_shares[..cut.start], &self.edge_shares[cut.end..]].concat();
        let rest = Self::of(parts, self.grid, self.rows.without(cut.clone()), edge_shares, self.model_sha256.clone())?;
        let symmetries = (0..self.parts.len()).filter(keep).map(|i| self.symmetries[i].clone()).collect();
        let known = self.neighbours.known();
        let neighbours = known.map(|of| Once::with([&of[..part], &of[part + 1..]].concat().into()));
        Ok(Self { symmetries, neighbours: neighbours.unwrap_or_else(Once::new), ..rest })
    }

    /// Saves the bank in one file, bound to its model's checksum, its rows in the format they are kept in.
    pub fn save(&self, path: &Path) -> Result<()> {
        self.file()?.save_as(path, SCHEMA, self.rows.precision())
    }

    /// SHA-256 of its parts, poses, rows and model, as 64 hex digits.
    pub fn sha256(&self) -> Result<String> {
        Ok(self.file()?.sha256())
    }

    fn file(&self) -> Result<SafeFile> {
        let n_rows = self.n_rows();
        let tensor = |name: &str, shape, values| NamedTensor { name: name.into(), shape, values };
        let (rows, scales) = self.rows.parts();
        let mut tensors = vec![
            tensor("rows", vec![n_rows, self.dim()], rows),
            tensor("edge_shares", vec![n_rows], self.edge_shares.clone()),
        ];
        tensors.extend(scales.map(|scales| tensor("scales", vec![n_rows], scales)));
        let text = vec![
            ("parts".into(), to_json(&self.parts)?),
            ("grid".into(), to_json(&self.grid)?),
            ("model_sha256".into(), self.model_sha256.clone()),
        ];
        Ok(SafeFile { tensors, blobs: Vec::new(), text })
    }

    /// Loads a bank, its rows in the format that the file holds, and refuses one made by another model.
    pub fn load(path: &Path, model: &Model) -> Result<Self> {
        let (mut file, precision) = SafeFile::load_as(path, SCHEMA)?;
        let parts: Vec<String> = from_json(path, file.text(path, "parts")?)?;
        let grid: PoseGrid = from_json(path, file.text(path, "grid")?)?;
        let model_sha256 = file.text(path, "model_sha256")?.to_owned();
        if model_sha256 != model.sha256() {
            return Err(Error::invalid(
                path.display().to_string(),
                format!("a bank made by model {}", short(model.sha256())),
                format!("one made by {}", short(&model_sha256)),
            ));
        }
        let mut take = |name: &str| {
            let at = file.tensors.iter().position(|tensor| tensor.name == name);
            let missing = || Error::invalid(path.display().to_string(), format!("a tensor '{name}'"), "none");
            at.map(|at| file.tensors.swap_remove(at)).ok_or_else(missing)
        };
        let rows = take("rows")?;
        let edge_shares = take("edge_shares")?;
        let rows = match (rows.shape.get(1), precision) {
            (Some(dim), Precision::I8) => Rows::scaled(*dim, &rows.values, take("scales")?.values)?,
            (Some(dim), _) => Rows::new(*dim, rows.values)?.to_precision(precision)?,
            (None, _) => {
                let expected = "rows of shape [n, dim]";
                return Err(Error::invalid(path.display().to_string(), expected, format!("{:?}", rows.shape)));
            }
        };
        Self::of(parts, grid, rows, edge_shares.values, model_sha256)
    }

    /// Names of the parts, in row order.
    pub fn parts(&self) -> &[String] {
        &self.parts
    }

    /// The poses at which each part was touched.
    pub fn grid(&self) -> &PoseGrid {
        &self.grid
    }

    /// Length of a row.
    pub fn dim(&self) -> usize {
        self.rows.dim()
    }

    /// Number of rows: parts times poses.
    pub fn n_rows(&self) -> usize {
        self.edge_shares.len()
    }

    /// All rows, `[n_rows, dim]`, in the format they are kept in.
    pub fn rows(&self) -> &Rows {
        &self.rows
    }

    /// One row, `[dim]`, in f32.
    ///
    /// # Panics
    /// Where `row` is not below [`Self::n_rows`].
    pub fn row(&self, row: usize) -> Cow<'_, [f32]> {
        self.rows.row(row)
    }

    /// The row recorded of a part at a pose, to within the robot's repeatability; `None` where there is none.
    pub fn row_at(&self, part: &str, part_from_sensor: &Se2) -> Option<usize> {
        let part = self.parts.iter().position(|name| name == part)?;
        let cell = self.grid.exact(part_from_sensor, POSE_TOLERANCE.0, POSE_TOLERANCE.1)?;
        Some(part * self.grid.len() + cell)
    }

    /// For each row, the share of the view that shows an edge, 0..=1; nought for a blank view.
    pub fn edge_shares(&self) -> &[f32] {
        &self.edge_shares
    }

    /// The turns under which a part stays the same ([`symmetry`]); worked out when first asked for.
    ///
    /// # Panics
    /// Where `part` is not below the number of parts.
    pub fn symmetry(&self, part: usize) -> Symmetry {
        *self.symmetries[part].get(|| symmetry(self, part))
    }

    /// How alike each part's views beside each other are, `[n_parts]`; worked out when first asked for.
    pub fn neighbours(&self) -> Arc<[Neighbours]> {
        self.neighbours.get(|| neighbours(self)).clone()
    }

    /// Checksum of the model that made the rows.
    pub fn model_sha256(&self) -> &str {
        &self.model_sha256
    }
}

/// What the network sees of some frames of a dataset, in their order.
pub fn tactile_images(background: &Background, dataset: &Dataset, frames: &[usize]) -> Result<Vec<TactileImage>> {
    frames.par_iter().map(|frame| Ok(background.tactile_image(&dataset.frame(*frame))?)).collect()
}

/// The parts of a dataset in order of appearance, and for each (part, cell) the frame that recorded it.
pub fn frames_by_row(dataset: &Dataset, grid: &PoseGrid) -> Result<(Vec<String>, Vec<usize>)> {
    let mut parts: Vec<String> = Vec::new();
    let mut frames: Vec<Option<usize>> = Vec::new();
    for index in 0..dataset.len() {
        let touch = dataset.touch(index);
        if touch.side != Some(Side::Peg) {
            continue;
        }
        let (Some(part), Some(pose)) = (&touch.part, &touch.part_from_sensor) else {
            return Err(Error::invalid(format!("index row {index}"), "a part and a pose for each peg", "none"));
        };
        let cell = grid.exact(pose, POSE_TOLERANCE.0, POSE_TOLERANCE.1).ok_or_else(|| {
            Error::invalid(format!("index row {index}"), "a pose on the dataset's reach grid", format!("{pose:?}"))
        })?;
        let at = parts.iter().position(|p| p == part).unwrap_or_else(|| {
            parts.push(part.clone());
            frames.resize(frames.len() + grid.len(), None);
            parts.len() - 1
        });
        frames[at * grid.len() + cell] = Some(index);
    }
    if parts.is_empty() {
        return Err(Error::invalid(dataset.meta().name.clone(), "touches of pegs", "none"));
    }
    let missing = |row: usize| {
        let (part, pose) = (&parts[row / grid.len()], grid.pose(row % grid.len()));
        let pose = format!("x {} mm, y {} mm, theta {:.0} deg", pose.x_mm, pose.y_mm, pose.theta_deg());
        Error::invalid(dataset.meta().name.clone(), format!("a peg touch of '{part}' at {pose}"), "none")
    };
    let frames =
        frames.iter().enumerate().map(|(row, frame)| frame.ok_or_else(|| missing(row))).collect::<Result<_>>()?;
    Ok((parts, frames))
}

fn short(sha256: &str) -> &str {
    sha256.get(..12).unwrap_or(sha256)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checkpoint::{Checkpoint, Provenance};
    use crate::device::DeviceKind;
    use crate::encoder::NetworkConfig;
    use tactile_data::frame::Preprocessing;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 0.0, xy_step_mm: 4.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    fn bank(edge_shares: Vec<f32>, model_sha256: &str) -> Result<Bank> {
        let rows = (0..54).map(|i| (i as f32 * 0.7).sin() / 3.0).collect();
        Bank::from_rows(["A", "B", "C"].map(String::from).into(), GRID, 6, rows, edge_shares, model_sha256.into())
    }

    #[test]
    fn a_share_that_is_none_is_refused_with_its_row() {
        for odd in [-0.1, 1.1, f32::NAN, f32::INFINITY] {
            let shares = (0..9).map(|row| if row == 7 { odd } else { 0.5 }).collect();
            let error = bank(shares, "").unwrap_err().to_string();
            assert_eq!(error, format!("bank row 7: expected an edge share in 0..=1, got {odd}"));
        }
        assert!(bank([0.0, 1.0].into_iter().cycle().take(9).collect(), "").is_ok());
    }

    #[test]
    fn a_bank_comes_back_in_the_format_it_was_kept_in() {
        let config = NetworkConfig { input_px: [16, 12], width: 1, hidden: 2, dim: 6 };
        let network = config.init(3, &DeviceKind::Flex.tensor_device());
        let checkpoint = Checkpoint::of(&network, config, Preprocessing::counts([16, 12]), Provenance::default());
        let model = Model::new(checkpoint, "mine".into(), DeviceKind::Flex).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bank");
        for precision in [Precision::F32, Precision::F16, Precision::Bf16, Precision::I8] {
            let kept = bank(vec![0.2; 9], "mine").unwrap().with_precision(precision).unwrap();
            kept.save(&path).unwrap();
            assert_eq!(Bank::load(&path, &model).unwrap(), kept);
            let without = kept.without(1).unwrap();
            assert_eq!((without.parts().join(""), without.row(3)), ("AC".into(), kept.row(6)));
        }
        let other = bank(vec![0.2; 9], "another").unwrap();
        other.save(&path).unwrap();
        assert!(Bank::load(&path, &model).unwrap_err().to_string().contains("made by another"));
    }
    #[test]
    fn bank_after_bank_keeps_what_the_rows_say() {
        let whole = bank(vec![0.2; 9], "mine").unwrap();
        let afresh = |names: &[&str], from: usize| {
            let rows = (from..from + names.len() * 3).flat_map(|row| whole.row(row).into_owned()).collect();
            let names: Vec<String> = names.iter().map(|name| (*name).into()).collect();
            let shares = vec![0.2; 3 * names.len()];
            Bank::from_rows(names, GRID, 6, rows, shares, "mine".into()).unwrap()
        };
        // Asked before and after the parts are taken out.
        for ask_first in [true, false] {
            let whole = bank(vec![0.2; 9], "mine").unwrap();
            if ask_first {
                assert_eq!(whole.neighbours().len(), 3);
                let _: Vec<_> = (0..3).map(|part| whole.symmetry(part)).collect();
            }
            let two = whole.without(0).unwrap();
            let one = two.without(1).unwrap();
            for (kept, fresh) in [(two, afresh(&["B", "C"], 3)), (one, afresh(&["B"], 3))] {
                assert_eq!(kept, fresh);
                assert_eq!(kept.neighbours(), fresh.neighbours());
                for part in 0..kept.parts().len() {
                    assert_eq!(kept.symmetry(part), fresh.symmetry(part));
                }
            }
        }
    }
}
