//! MAZE boards: random polygonal walls to train on (paper, Sec. V-A).

use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use serde::{Deserialize, Serialize};

use super::island::islands;
use super::{Contour, Shape};
use crate::scene::random::uniform;

/// How MAZE boards are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MazeSpec {
    /// Side of a board, mm.
    pub side_mm: f64,
    /// Narrowest and widest distance between the maze's nodes, mm; one is drawn for each board.
    pub pitch_mm: [f64; 2],
    /// Narrowest and widest wall as a share of the pitch, drawn for each board and jittered for each wall.
    pub wall_share: [f64; 2],
    /// Least and greatest share of the maze's walls that are kept, drawn for each board: what is left of a sparse
    /// one are separate strokes.
    pub kept_share: [f64; 2],
    /// How far a node is moved, as a share of the pitch.
    pub node_jitter: f64,
    /// Share of walls that are bent into an arc.
    pub bent_share: f64,
    /// Share of the boards with islands instead of walls: separate closed outlines, as plugs are.
    pub island_share: f64,
}

impl Default for MazeSpec {
    fn default() -> Self {
        // Strokes of 12 mm letters are 2 to 3 mm wide, those of 32 mm letters 6 to 8.
        Self {
            side_mm: 64.0,
            pitch_mm: [5.0, 18.0],
            wall_share: [0.25, 0.5],
            kept_share: [0.3, 0.9],
            node_jitter: 0.25,
            bent_share: 0.3,
            island_share: 0.2,
        }
    }
}

/// One board: the walls of a random spanning tree on jittered nodes. Walls are the peg's face and the
/// hole's opening. The same seed draws the same board, from stream 0 of its generator.
pub fn maze(spec: &MazeSpec, seed: u64) -> Shape {
    draw(spec, &mut ChaCha8Rng::seed_from_u64(seed))
}

/// One board as [`maze`] draws it, from any generator.
pub(super) fn draw(spec: &MazeSpec, rng: &mut ChaCha8Rng) -> Shape {
    // Log-uniform: as many fine boards as coarse ones in each octave.
    let pitch = spec.pitch_mm[0] * (spec.pitch_mm[1] / spec.pitch_mm[0]).powf(rng.random());
    let width = pitch * uniform(rng, spec.wall_share);
    let n = (spec.side_mm / pitch).ceil() as usize + 1;
    let nodes: Vec<[f64; 2]> = (0..n * n)
        .map(|i| {
            [i % n, i / n].map(|k| {
                let jitter = uniform(rng, [-spec.node_jitter, spec.node_jitter]);
                (k as f64 - 0.5 * (n - 1) as f64 + jitter) * pitch
            })
        })
        .collect();
    if rng.random_bool(spec.island_share) {
        return islands(&nodes, pitch, rng);
    }
    let kept = uniform(rng, spec.kept_share);
    let regions = tree(n, kept, rng)
        .into_iter()
        .map(|(a, b)| {
            let half_widths = [0, 1].map(|_| 0.5 * width * uniform(rng, [0.7, 1.3]));
            let bend = if rng.random_bool(spec.bent_share) { uniform(rng, [-0.35, 0.35]) } else { 0.0 };
            let round = rng.random_bool(0.5);
            vec![wall(nodes[a], nodes[b], half_widths, bend * pitch, round)]
        })
        .collect();
    Shape { regions }
}

/// Edges of a random spanning tree of an `n` x `n` grid, by a random walk that backtracks, and a few
/// more that close loops.
fn tree(n: usize, kept: f64, rng: &mut ChaCha8Rng) -> Vec<(usize, usize)> {
    let neighbours = |i: usize| {
        let (x, y) = (i % n, i / n);
        let candidates =
            [(x > 0, i.wrapping_sub(1)), (x + 1 < n, i + 1), (y > 0, i.wrapping_sub(n)), (y + 1 < n, i + n)];
        candidates.into_iter().filter(|(inside, _)| *inside).map(|(_, j)| j)
    };
    let mut seen = vec![false; n * n];
    let start = rng.random_range(0..n * n);
    seen[start] = true;
    let (mut stack, mut edges) = (vec![start], Vec::new());
    while let Some(&at) = stack.last() {
        let open: Vec<usize> = neighbours(at).filter(|j| !seen[*j]).collect();
        if open.is_empty() {
            stack.pop();
            continue;
        }
        let next = open[rng.random_range(0..open.len())];
        seen[next] = true;
        edges.push((at, next));
        stack.push(next);
    }
    // A maze without a few walls has ends, corners and gaps; a tenth as many loops give T and X joints.
    edges.retain(|_| rng.random_bool(kept));
    for _ in 0..n * n / 10 {
        let at = rng.random_range(0..n * n);
        if let Some(next) = neighbours(at).nth(rng.random_range(0..2)) {
            edges.push((at, next));
        }
    }
    edges
}

/// The outline of one wall: a strip from `a` to `b` whose half width goes from one to the other, its
/// middle pushed sideways by `bend_mm`, its ends square or round.
fn wall(a: [f64; 2], b: [f64; 2], half_widths: [f64; 2], bend_mm: f64, round: bool) -> Contour {
    const PIECES: usize = 16;
    let length = (b[0] - a[0]).hypot(b[1] - a[1]).max(1e-6);
    let along = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
    let across = [-along[1], along[0]];
    // Square ends reach past the node by half a width, so that corners are filled.
    let place = |t: f64, side: f64| {
        let half = half_widths[0] + (half_widths[1] - half_widths[0]) * t.clamp(0.0, 1.0);
        let inside = t.clamp(0.0, 1.0);
        let s = t * length;
        // A parabola through both ends; its slope is small enough that the strip keeps its width.
        let sag = 4.0 * bend_mm * inside * (1.0 - inside) + side * half;
        [0, 1].map(|k| a[k] + s * along[k] + sag * across[k])
    };
    let mut contour: Contour = Vec::with_capacity(4 * PIECES);
    let steps = if bend_mm == 0.0 { 1 } else { PIECES };
    let extend = if round { [0.0, 0.0] } else { half_widths.map(|h| h / length) };
    let ts = |i: usize| -extend[0] + (1.0 + extend[0] + extend[1]) * i as f64 / steps as f64;
    contour.extend((0..=steps).map(|i| place(ts(i), 1.0)));
    if round {
        contour.extend(cap(b, along, across, half_widths[1], 1.0));
    }
    contour.extend((0..=steps).rev().map(|i| place(ts(i), -1.0)));
    if round {
        contour.extend(cap(a, along, across, half_widths[0], -1.0));
    }
    contour
}

/// Half a circle round an end, from one side to the other.
fn cap(centre: [f64; 2], along: [f64; 2], across: [f64; 2], radius: f64, end: f64) -> impl Iterator<Item = [f64; 2]> {
    (1..8).map(move |i| {
        let angle = std::f64::consts::PI * f64::from(i) / 8.0;
        let (forward, side) = (end * radius * angle.sin(), end * radius * angle.cos());
        [0, 1].map(|k| centre[k] + forward * along[k] + side * across[k])
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::shape::Raster;

    #[test]
    fn the_same_seed_draws_the_same_board_and_another_does_not() {
        let spec = MazeSpec::default();
        assert_eq!(maze(&spec, 5), maze(&spec, 5));
        assert_ne!(maze(&spec, 5), maze(&spec, 6));
    }

    #[test]
    fn boards_are_neither_empty_nor_full() {
        let spec = MazeSpec::default();
        for seed in 0..8 {
            let raster = Raster::coverage(&maze(&spec, seed), 0.5 * spec.side_mm, 0.25);
            let share = raster.values.iter().sum::<f32>() / raster.values.len() as f32;
            assert!((0.1..0.8).contains(&share), "board {seed} is covered to {share}");
        }
    }

    #[test]
    fn sparse_boards_have_less_wall() {
        let covered = |kept: f64| -> f32 {
            let spec = MazeSpec { kept_share: [kept, kept], ..MazeSpec::default() };
            (0..6).map(|seed| Raster::coverage(&maze(&spec, seed), 32.0, 0.5).values.iter().sum::<f32>()).sum()
        };
        let [none, few, all] = [0.0, 0.3, 1.0].map(covered);
        assert!(none < few && few < 0.7 * all, "{none}, {few}, {all}");
    }

    #[test]
    fn a_straight_wall_has_the_area_of_its_strip_and_ends() {
        let strip = |round| Shape { regions: vec![vec![wall([-3.0, 0.0], [3.0, 0.0], [0.5, 0.5], 0.0, round)]] };
        let area = |shape: &Shape| Raster::coverage(shape, 6.0, 0.05).values.iter().sum::<f32>() * 0.0025;
        assert!((area(&strip(false)) - 7.0).abs() < 0.03);
        assert!((area(&strip(true)) - (6.0 + std::f32::consts::PI * 0.25)).abs() < 0.05, "{}", area(&strip(true)));
    }
}
