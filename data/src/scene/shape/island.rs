//! Islands: separate closed outlines on a MAZE board, each of another size and form.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use super::{Contour, Shape};
use crate::scene::random::uniform;

/// Share of the nodes without an island.
const EMPTY_SHARE: f64 = 0.15;

/// Length of an island, as a share of the nodes' distance, and its height as a share of its length.
const LENGTH_SHARE: [f64; 2] = [0.4, 0.95];
const HEIGHT_SHARE: [f64; 2] = [0.15, 1.0];

/// Shares of the corners that are cut and that are rounded; the others are square.
const CUT_SHARE: f64 = 0.3;
const ROUND_SHARE: f64 = 0.3;

/// Share of the islands that narrow towards one side, and by how much of the length at most.
const TAPER_SHARE: f64 = 0.35;
const MOST_TAPER: f64 = 0.4;

/// Share of the islands with a tab on their long side.
const TAB_SHARE: f64 = 0.25;

/// How far an island is turned against its board, radians either way.
const TURN_RAD: f64 = 0.15;

/// Straight pieces of a rounded corner.
const ARC_PIECES: usize = 6;

/// One island round each of most nodes, `pitch` mm apart, nearly all turned the same way, up to quarter turns.
pub(super) fn islands(nodes: &[[f64; 2]], pitch: f64, rng: &mut ChaCha8Rng) -> Shape {
    let board_rad = uniform(rng, [0.0, std::f64::consts::FRAC_PI_2]);
    let mut regions = Vec::new();
    for node in nodes {
        if rng.random_bool(EMPTY_SHARE) {
            continue;
        }
        let quarter = f64::from(rng.random_range(0..4_u8)) * std::f64::consts::FRAC_PI_2;
        let (sin, cos) = (board_rad + quarter + uniform(rng, [-TURN_RAD, TURN_RAD])).sin_cos();
        let placed = |[x, y]: [f64; 2]| [node[0] + cos * x - sin * y, node[1] + sin * x + cos * y];
        let contours = island(pitch, rng);
        regions.extend(contours.into_iter().map(|contour| vec![contour.into_iter().map(placed).collect()]));
    }
    Shape { regions }
}

/// A rectangle with square, cut or round corners, perhaps narrower on one side, perhaps with a tab.
fn island(pitch: f64, rng: &mut ChaCha8Rng) -> Vec<Contour> {
    let length = pitch * uniform(rng, LENGTH_SHARE);
    let height = length * uniform(rng, HEIGHT_SHARE);
    let taper = if rng.random_bool(TAPER_SHARE) { uniform(rng, [0.0, MOST_TAPER]) } else { 0.0 };
    let [x, y] = [0.5 * length, 0.5 * height];
    let narrow = x * (1.0 - taper);
    let corners = [[-x, -y], [x, -y], [narrow, y], [-narrow, y]];
    let mut outline = Contour::new();
    for at in 0..4 {
        let [before, corner, after] = [corners[(at + 3) % 4], corners[at], corners[(at + 1) % 4]];
        let kind: f64 = rng.random();
        let leg = height.min(2.0 * narrow) * uniform(rng, [0.1, 0.5]);
        let toward = |other: [f64; 2]| {
            let d = [0, 1].map(|k| other[k] - corner[k]);
            let share = leg / d[0].hypot(d[1]);
            [0, 1].map(|k| corner[k] + share.min(0.5) * d[k])
        };
        let (from, to) = (toward(before), toward(after));
        if kind < CUT_SHARE {
            outline.extend([from, to]);
        } else if kind < CUT_SHARE + ROUND_SHARE {
            // A quadratic Bezier curve round the corner.
            outline.extend((0..=ARC_PIECES).map(|i| {
                let t = i as f64 / ARC_PIECES as f64;
                [0, 1].map(|k| (1.0 - t) * (1.0 - t) * from[k] + 2.0 * t * (1.0 - t) * corner[k] + t * t * to[k])
            }));
        } else {
            outline.push(corner);
        }
    }
    let mut contours = vec![outline];
    if rng.random_bool(TAB_SHARE) {
        let half = length * uniform(rng, [0.08, 0.25]);
        let middle = uniform(rng, [-0.3, 0.3]) * length;
        let low = -y - length * uniform(rng, [0.05, 0.15]);
        // Into the island, so that no slit is left between the two.
        contours.push(vec![[middle - half, low], [middle + half, low], [middle + half, 0.0], [middle - half, 0.0]]);
    }
    contours
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::Raster;
    use rand::SeedableRng;

    #[test]
    fn an_island_is_no_larger_than_its_node_allows_and_not_empty() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        for _ in 0..50 {
            let shape = Shape { regions: island(10.0, &mut rng).into_iter().map(|contour| vec![contour]).collect() };
            let area: f32 = Raster::coverage(&shape, 10.0, 0.1).values.iter().sum::<f32>() * 0.01;
            // Length 4 to 9.5 mm; height 0.15 to 1 of it, a tab 0.15 more; corners and taper take at most half.
            assert!((0.5 * 0.15 * 16.0..1.15 * 90.25).contains(&area), "{area}");
            let [x_min, y_min, x_max, y_max] = shape.bounds();
            assert!(x_min >= -4.75 && x_max <= 4.75 && y_min >= -6.2 && y_max <= 4.75);
        }
    }

    #[test]
    fn islands_stand_apart() {
        let nodes: Vec<[f64; 2]> =
            (0..9).map(|i| [20.0 * f64::from(i % 3) - 20.0, 20.0 * f64::from(i / 3) - 20.0]).collect();
        let shape = islands(&nodes, 14.0, &mut ChaCha8Rng::seed_from_u64(2));
        let raster = Raster::coverage(&shape, 30.0, 0.25);
        let column = |x: f64| ((x + 30.0) / 0.25) as usize;
        // Between the nodes' columns there is nothing: 20 mm apart, at most 13.3 long and 15 across with a tab.
        assert!((0..raster.n).all(|row| raster.values[row * raster.n + column(10.0)] == 0.0));
        assert!(raster.values.iter().sum::<f32>() > 0.0);
    }
}
