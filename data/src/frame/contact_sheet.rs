//! A picture of a dataset at a glance.

use std::collections::HashMap;

use crate::dataset::store::Dataset;
use crate::dataset::touch::{Side, Touch};
use crate::error::{Error, Result};
use crate::frame::picture;
use crate::frame::sheet::{LINE_PX, Sheet, amplified};
use crate::frame::{Background, Frame, Preprocessing};

/// Samples on a sheet: columns and rows.
const GRID: [usize; 2] = [8, 6];
/// Longest side of a frame's picture, pixels.
const MAX_TILE_PX: usize = 160;
/// Gap between a frame and its difference and within a pair, pixels.
const GAP_PX: usize = 2;
/// Gap round samples and pairs, pixels.
const MARGIN_PX: usize = 12;
/// Lines of text below a sample.
const N_LINES: usize = 2;
/// Draws up to 48 samples spread evenly over a dataset: each frame, and below it its signed
/// difference from rest, amplified on mid-grey, and what is known of it. Where a hole and a peg were touched at
/// one pose, the two are side by side, hole first. A frame that cannot be compared with rest has plain grey below.
pub fn draw(dataset: &Dataset) -> Result<Frame> {
    let groups = samples(dataset.touches());
    let Some(group_len) = groups.first().map(Vec::len) else {
        return Err(Error::invalid("contact sheet", "at least one frame", "none"));
    };
    let n_columns = (GRID[0] / group_len).min(groups.len());
    let n_rows = groups.len().div_ceil(n_columns);
    let [width, height] = dataset.meta().frame_px;
    let longest = width.max(height);
    let tile = [width, height].map(|side| (side * MAX_TILE_PX.min(longest) / longest).max(1));
    let background = Background::new(dataset.no_contact(), &Preprocessing::counts(tile))?;
    let group_px = [group_len * (tile[0] + GAP_PX) - GAP_PX, 2 * (tile[1] + GAP_PX) + N_LINES * LINE_PX];
    let mut sheet =
        Sheet::new([n_columns * (group_px[0] + MARGIN_PX) + MARGIN_PX, n_rows * (group_px[1] + MARGIN_PX) + MARGIN_PX]);
    for (at, group) in groups.iter().enumerate() {
        let y = MARGIN_PX + at / n_columns * (group_px[1] + MARGIN_PX);
        for (member, &i) in group.iter().enumerate() {
            let x = MARGIN_PX + at % n_columns * (group_px[0] + MARGIN_PX) + member * (tile[0] + GAP_PX);
            let frame = dataset.frame(i);
            sheet.put([x, y], &picture::resize(&frame, tile)?);
            sheet.put([x, y + tile[1] + GAP_PX], &difference(&background, &frame, tile)?);
            for (line, text) in label(i, dataset.touch(i)).iter().enumerate() {
                sheet.write([x, y + 2 * (tile[1] + GAP_PX) + line * LINE_PX], tile[0], text)?;
            }
        }
    }
    sheet.into_frame()
}

/// What is known of a frame: its number, part and side, and its pose.
fn label(i: usize, touch: &Touch) -> [String; N_LINES] {
    let side = touch.side.map_or("", |side| if side == Side::Hole { " hole" } else { " peg" });
    let part = touch.part.as_ref().map_or(String::new(), |part| format!(" {part}"));
    let pose = touch.part_from_sensor.map_or(String::new(), |pose| {
        // Zero without a sign.
        let [x, y, deg] = [pose.x_mm, pose.y_mm, pose.theta_deg()].map(|v| (v * 10.0).round() / 10.0 + 0.0);
        format!("{x}, {y} mm {deg}\u{b0}")
    });
    [format!("{i}:{part}{side}"), pose]
}

/// Which frames to show: hole and peg of one pose in pairs where there are any, else singly, evenly
/// spread, as many as the sheet holds. Every group is equally long.
fn samples(touches: &[Touch]) -> Vec<Vec<usize>> {
    let place = |touch: &Touch| {
        let pose = touch.part_from_sensor?;
        Some((touch.part.clone()?, [pose.x_mm, pose.y_mm, pose.theta_rad].map(f64::to_bits)))
    };
    let pegs: HashMap<_, usize> = (touches.iter().enumerate())
        .filter(|(_, touch)| touch.side == Some(Side::Peg))
        .filter_map(|(i, touch)| Some((place(touch)?, i)))
        .collect();
    let pairs: Vec<Vec<usize>> = (touches.iter().enumerate())
        .filter(|(_, touch)| touch.side == Some(Side::Hole))
        .filter_map(|(i, touch)| Some(vec![i, *pegs.get(&place(touch)?)?]))
        .collect();
    let all = if pairs.is_empty() { (0..touches.len()).map(|i| vec![i]).collect() } else { pairs };
    let n_shown = all.first().map_or(0, |group| GRID[0] * GRID[1] / group.len()).min(all.len());
    (0..n_shown).map(|i| all[i * all.len() / n_shown].clone()).collect()
}

fn difference(background: &Background, frame: &Frame, [width, height]: [usize; 2]) -> Result<Frame> {
    let n_pixels = width * height;
    let counts: Vec<f32> = match background.tactile_image(frame) {
        Ok(image) => (0..3 * n_pixels).map(|at| image.planes[at % 3 * n_pixels + at / 3]).collect(),
        Err(_) => vec![0.0; 3 * n_pixels],
    };
    amplified(&counts, [width, height])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::se2::Se2;

    fn touch(part: &str, side: Side, x_mm: f64) -> Touch {
        Touch {
            part: Some(part.into()),
            side: Some(side),
            part_from_sensor: Some(Se2::from_degrees(x_mm, 0.0, 0.0)),
            ..Touch::default()
        }
    }

    #[test]
    fn hole_and_peg_of_one_pose_stand_together_wherever_they_lie() {
        let touches = [
            touch("A", Side::Peg, 4.0),
            touch("A", Side::Hole, 0.0),
            touch("B", Side::Peg, 0.0),
            touch("A", Side::Hole, 4.0),
            touch("A", Side::Peg, 0.0),
        ];
        assert_eq!(samples(&touches), [[1, 4], [3, 0]]);
        assert_eq!(samples(&touches[..3]), [[0], [1], [2]]);
    }

    #[test]
    fn a_large_dataset_is_sampled_from_end_to_end() {
        let touches: Vec<Touch> = (0..480).map(|i| touch("A", Side::Peg, f64::from(i))).collect();
        let shown = samples(&touches);
        assert_eq!((shown.len(), &shown[0], &shown[47]), (48, &vec![0], &vec![470]));
    }
}
