//! A bank from a dataset of recorded or simulated peg touches.

use rayon::prelude::*;
use tactile_data::frame::{Background, TactileImage};
use tactile_data::grid::PoseGrid;
use tactile_data::origin::{Origin, PartOrigin, SensorOrigin};
use tactile_data::store::Dataset;
use tactile_data::touch::Side;

use crate::bank::{Bank, POSE_TOLERANCE};
use crate::error::{Error, Result};
use crate::model::Model;
use crate::rows::Rows;

/// Embeds a dataset of peg touches: each part at each pose of the dataset's reach, once.
///
/// # Errors
/// A dataset without a reach, with a pose missing or off the grid, or frames that the model cannot take.
pub fn bank_of_dataset(model: &Model, dataset: &Dataset, progress: &(dyn Fn(usize, usize) + Sync)) -> Result<Bank> {
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
    let origin = origin(dataset, &parts);
    let bank = Bank::from_rows(parts, grid, Rows::new(model.dim(), rows)?, edge_shares, model.sha256().clone())?;
    Ok(bank.with_origin(origin))
}

/// What a dataset's touches were made of: as its scene says where it was simulated, else only its scale is known.
fn origin(dataset: &Dataset, parts: &[String]) -> Origin {
    let meta = dataset.meta();
    #[cfg(feature = "sim")]
    if let Some(Ok(scene)) = meta.scene.clone().map(serde_json::from_value::<tactile_data::scene::Scene>) {
        return scene.origin();
    }
    let field_of_view_mm = [0, 1].map(|axis| meta.mm_per_px[axis] * meta.frame_px[axis] as f64);
    let part = |name: &String| PartOrigin { name: name.clone(), size_mm: None };
    let sensor = SensorOrigin { field_of_view_mm, light: None };
    Origin { name: meta.name.clone(), parts: parts.iter().map(part).collect(), sensor }
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
