//! Pictures of maps, for people.

use tactile_data::dataset::touch::OUTLINE_REACH_MM;
use tactile_data::frame::Frame;

use super::mosaic::{CELL_MM, Mosaic, Place};
use crate::error::Result;

/// Grey: not seen.
const UNSEEN: [u8; 3] = [128; 3];

/// The outline of a part that is drawn over a mosaic.
const OUTLINE: [u8; 3] = [20, 160, 60];

/// Where they differ.
const DIFFERENT: [u8; 3] = [240, 200, 0];

/// Where what was felt is inside of a part by a probability that is so far from the part's own, the two differ.
const SURELY_OTHER: f32 = 0.7;

/// Black at the outline, blue inside, red outside; the paler, the less sure it is.
pub fn of_distance(mm: f32, error_mm: f32) -> [u8; 3] {
    let far = (mm.abs() / OUTLINE_REACH_MM as f32).min(1.0).sqrt();
    let colour = if mm < 0.0 { [0.25, 0.5, 1.0] } else { [1.0, 0.45, 0.3] };
    let sure = 1.0 / (1.0 + error_mm);
    colour.map(|value| (255.0 * (sure * value * far + (1.0 - sure) * 0.9)) as u8)
}

/// Dark where the gel is touched.
pub fn of_contact(share: f32) -> [u8; 3] {
    [(255.0 * (1.0 - 0.85 * share)) as u8; 3]
}

/// Rows of a mosaic, each cell `enlarged` pixels wide and high, in colours of what is there.
pub fn row_of(mosaic: &Mosaic<'_>, row: usize, enlarged: usize, colour: fn(&Place) -> [u8; 3]) -> Vec<u8> {
    let pixel = |column: usize| {
        let (_, place) = mosaic.cell(column / enlarged, row / enlarged);
        if place.n_seen > 0.0 { colour(&place) } else { UNSEEN }
    };
    (0..enlarged * mosaic.n()).flat_map(pixel).collect()
}

/// Distances of a mosaic, each cell `enlarged` pixels wide and high, with the outline of a part (green) over it and where the two differ
/// (yellow).
///
/// # Errors
/// None that a mosaic gives.
pub fn compared(mosaic: &Mosaic<'_>, part: Option<&Mosaic<'_>>, enlarged: usize) -> Result<Frame> {
    let n = enlarged * mosaic.n();
    let mut rgb = Vec::with_capacity(3 * n * n);
    for row in 0..n {
        let mut line = row_of(mosaic, row, enlarged, |place| of_distance(place.distance_mm, place.error_mm));
        for (column, pixel) in line.as_chunks_mut::<3>().0.iter_mut().enumerate() {
            let at = [column, row].map(|at| ((at as f64 + 0.5) / enlarged as f64 - 0.5 * mosaic.n() as f64) * CELL_MM);
            let Some(there) = part.and_then(|part| part.at(at)) else { continue };
            if f64::from(there.distance_mm.abs()) < 0.5 * CELL_MM {
                *pixel = OUTLINE;
            } else if mosaic.at(at).is_some_and(|here| here.differs(&there)) {
                *pixel = DIFFERENT;
            }
        }
        rgb.extend(line);
    }
    Ok(Frame::new(n, n, rgb)?)
}

/// What was felt as a node tells it, the probability of each cell of a square to be inside, %, rows from the top, -1 where nothing was
/// felt: blue inside, red outside, dark between; with the outline of a part (green) over it and where the two differ (yellow). A cell is
/// `enlarged` pixels wide and high. `None` of cells that are no square.
pub fn felt(percents: &[i8], part: Option<&Mosaic<'_>>, enlarged: usize) -> Option<Frame> {
    let n = percents.len().isqrt();
    if n == 0 || n * n != percents.len() {
        return None;
    }
    let cell = |column: usize, row: usize| match percents[row * n + column] {
        percent @ 0..=100 => Some(f32::from(percent) / 100.0),
        _ => None,
    };
    let mut rgb = Vec::with_capacity(3 * (n * enlarged).pow(2));
    for row in 0..n * enlarged {
        for column in 0..n * enlarged {
            let here = cell(column / enlarged, row / enlarged);
            let at = [column, row].map(|at| ((at as f64 + 0.5) / enlarged as f64 - 0.5 * n as f64) * CELL_MM);
            let there = part.and_then(|part| part.at(at));
            rgb.extend(match (here, there) {
                (_, Some(there)) if f64::from(there.distance_mm.abs()) < 0.5 * CELL_MM => OUTLINE,
                (Some(here), Some(there)) if (here - there.inside).abs() > SURELY_OTHER => DIFFERENT,
                // A distance that is as far as it is sure.
                (Some(here), _) => of_distance((1.0 - 2.0 * here) * OUTLINE_REACH_MM as f32, 0.05),
                (None, _) => UNSEEN,
            });
        }
    }
    Frame::new(n * enlarged, n * enlarged, rgb).ok()
}

#[cfg(test)]
mod tests {
    use tactile_data::dataset::touch::Side;

    use super::super::mosaic::tests::mosaics;
    use super::*;

    #[test]
    fn inside_is_blue_outside_red_the_outline_dark_and_doubt_pale() {
        let [inside, outside, outline] = [-2.0, 2.0, 0.0].map(|mm| of_distance(mm, 0.05));
        assert!(inside[2] > 2 * inside[0] && outside[0] > 2 * outside[2], "{inside:?} {outside:?}");
        assert!(outline.iter().all(|value| *value < 30), "{outline:?}");
        let doubt = of_distance(-2.0, 3.0);
        assert!(doubt[0] > inside[0] + 80, "{doubt:?}");
        assert!(of_contact(1.0)[0] < 60 && of_contact(0.0) == [255; 3]);
    }

    #[test]
    fn the_outline_of_a_part_lies_where_the_mosaic_has_its_own() {
        let mosaics = mosaics();
        let mosaic = mosaics.of(0, Side::Peg);
        let [plain, with] = [None, Some(&mosaic)].map(|part| compared(&mosaic, part, 2).unwrap());
        let pixels = |frame: &Frame| frame.rgb().as_chunks::<3>().0.to_vec();
        let [plain, with] = [pixels(&plain), pixels(&with)];
        let outline: Vec<usize> = (0..with.len()).filter(|at| with[*at] == OUTLINE).collect();
        // An oval of some 5 by 3 mm; twice a cell of 0.3 mm is a pixel of 0.15.
        assert!((100..1_200).contains(&outline.len()), "{}", outline.len());
        assert!(outline.iter().all(|at| plain[*at].iter().all(|value| *value < 120)));
        assert!(!with.contains(&DIFFERENT) && plain[0] == UNSEEN);
        // As a node tells it.
        let n = mosaic.n();
        let percent = |at: usize| match mosaic.cell(at % n, at / n).1 {
            Place { n_seen: 0.0, .. } => -1,
            Place { inside, .. } => (100.0 * inside).round() as i8,
        };
        let told: Vec<i8> = (0..n * n).map(percent).collect();
        let same = pixels(&felt(&told, Some(&mosaic), 2).unwrap());
        assert!(outline.iter().all(|at| same[*at] == OUTLINE) && !same.contains(&DIFFERENT) && same[0] == UNSEEN);
        let other: Vec<i8> = told.iter().map(|percent| if *percent < 0 { -1 } else { 100 - percent }).collect();
        let other = pixels(&felt(&other, Some(&mosaic), 2).unwrap());
        assert!(other.iter().filter(|pixel| **pixel == DIFFERENT).count() > 1_000);
        assert!(felt(&told[1..], None, 2).is_none() && felt(&[], None, 2).is_none());
        // The outline alone, in mm: on the oval.
        let alone = mosaic.outline_mm();
        assert!((30..300).contains(&alone.len()), "{}", alone.len());
        assert!(alone.iter().all(|at| f64::from(mosaic.at(*at).unwrap().distance_mm.abs()) < 0.5 * CELL_MM));
    }
}
