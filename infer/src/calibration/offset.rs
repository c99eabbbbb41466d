//! The pose of the hole board in the peg board's frame, found from the touches themselves.
//!
//! A robot that touches both boards at the poses it was given knows nothing of how the boards are mounted. The model
//! does: it was trained to match a hole with the peg touched at the very same place. For each offset on a lattice,
//! every peg's picture is moved to where its hole would then have been touched, and the mean cosine says how well the
//! pairs mate; the top of a paraboloid through the lattice is the offset. Only what both pictures show is compared: the
//! middle of each view, so that no moved picture lacks a border.

use rayon::prelude::*;
use serde::Serialize;
use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::Side;
use tactile_data::frame::moved_view::moved_view;
use tactile_data::frame::picture;
use tactile_data::frame::{Background, Frame, TactileImage};
use tactile_data::pose::se2::{Se2, wrap_angle};

use crate::bank::similarity::dot;
use crate::calibration::BLANK_SHARE;
use crate::embedding::model::Model;
use crate::error::{Error, Result};

/// Pairs whose stated poses are further apart are not compared, mm and degrees.
const NEAR: (f64, f64) = (3.0, 6.0);

/// Fewer pairs than this say too little.
const MIN_PAIRS: usize = 20;

/// Share of each side of a view that is compared: what is left moves by 2 mm and 6 degrees on a GelSight Mini.
const MIDDLE: f64 = 0.8;

/// Steps of the lattices, mm and degrees, and the most pairs compared on each.
const ROUNDS: [(f64, f64, usize); 3] = [(1.0, 1.5, 100), (0.5, 0.75, 200), (0.3, 0.5, 400)];

/// Places of a lattice along each axis: two steps either way.
const N_PLACES: usize = 5;

/// Groups of pairs, each left out in turn, from whose offsets the errors are found.
const N_GROUPS: usize = 10;

/// The pose of the hole board, and how sure it is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Offset {
    /// The pose of the hole board in the peg board's frame.
    pub peg_from_hole: Se2,
    /// Standard error along x and y, mm, and of the angle, degrees; of chance alone.
    pub error: [f64; 3],
    /// Pairs of touches compared.
    pub n_pairs: usize,
    /// Their mean cosine at the offset, and without one.
    pub cosine: [f64; 2],
}

impl Offset {
    /// Whether it is more than three standard errors from none, along some axis.
    pub fn is_significant(&self) -> bool {
        let Se2 { x_mm, y_mm, .. } = self.peg_from_hole;
        let values = [x_mm, y_mm, self.peg_from_hole.theta_deg()];
        values.iter().zip(self.error).any(|(value, error)| value.abs() > 3.0 * error)
    }
}

/// A hole and a peg touched near one another.
struct Near {
    hole: usize,
    peg: usize,
    part_from_hole: Se2,
    part_from_peg: Se2,
}

/// Finds the offset by a model. The poses of `holes` are taken as its dataset gives them: an offset that is noted with it
/// is contained in them, and what is found comes on top.
///
/// # Errors
/// Fewer than 20 pairs of one part within 3 mm and 6 degrees that both show an edge, frames that the model cannot take,
/// or touches that mate equally well wherever the board is.
pub fn estimate(
    model: &Model,
    holes: &Dataset,
    pegs: &Dataset,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Offset> {
    let views = Views::new(model, holes, pegs)?;
    let near = views.near()?;
    let mut centre = Se2::IDENTITY;
    let mut found = None;
    for (round, (step_mm, step_deg, n_pairs)) in ROUNDS.into_iter().enumerate() {
        let every = near.len().div_ceil(n_pairs);
        let pairs: Vec<&Near> = near.iter().step_by(every).collect();
        let offsets = lattice(&centre, step_mm, step_deg);
        let done = |n: usize| progress(round * 100 + n * 100 / pairs.len(), 100 * ROUNDS.len());
        let cosines: Vec<Vec<f64>> = (pairs.iter().enumerate())
            .map(|(n, pair)| {
                done(n);
                views.cosines(model, pair, &offsets)
            })
            .collect::<Result<_>>()?;
        let all: Vec<&Vec<f64>> = cosines.iter().collect();
        let top = top(&mean(&all)).ok_or_else(|| {
            Error::invalid(&holes.meta().name, "an offset at which holes and pegs mate best", "none within reach")
        })?;
        let at = |[x, y, turn]: [f64; 3]| moved(&centre, [x * step_mm, y * step_mm, turn * step_deg]);
        let error = jackknife(&cosines).map(|error| error.map_or(f64::INFINITY, |e| e));
        found = Some(Offset {
            peg_from_hole: at(top.place),
            error: [error[0] * step_mm, error[1] * step_mm, error[2] * step_deg],
            n_pairs: pairs.len(),
            cosine: [top.value, f64::NAN],
        });
        centre = at(top.place);
    }
    progress(100, 100);
    let found = found.ok_or_else(|| Error::invalid("offset", "a round", "none"))?;
    let every = near.len().div_ceil(ROUNDS[2].2);
    let without = near.iter().step_by(every).map(|pair| Ok(views.cosines(model, pair, &[Se2::IDENTITY])?[0]));
    let without = without.collect::<Result<Vec<f64>>>()?;
    let none = without.iter().sum::<f64>() / without.len() as f64;
    Ok(Offset { cosine: [found.cosine[0], none], ..found })
}

/// The frames as they are compared: of about twice the network's input, with their frames at rest.
struct Views<'a> {
    holes: &'a Dataset,
    pegs: &'a Dataset,
    size_px: [usize; 2],
    mm_per_px: [f64; 2],
    rests: [Frame; 2],
    backgrounds: [Background; 2],
}

impl<'a> Views<'a> {
    fn new(model: &Model, holes: &'a Dataset, pegs: &'a Dataset) -> Result<Self> {
        let (px, meta) = (model.config().input_px.map(|n| 2 * n), pegs.meta());
        let size_px = [0, 1].map(|axis| px[axis].min(meta.frame_px[axis]));
        let mm_per_px = [0, 1].map(|axis| meta.mm_per_px[axis] * meta.frame_px[axis] as f64 / size_px[axis] as f64);
        let rest = |of: &Dataset| picture::resize(of.no_contact(), size_px);
        let rests = [rest(holes)?, rest(pegs)?];
        let background = |of: &Dataset, rest: &Frame| -> Result<Background> {
            let background = model.background(&middle(rest, None, &Se2::IDENTITY, mm_per_px)?)?;
            Ok(background.lit_by(&of.meta().lamps)?)
        };
        let backgrounds = [background(holes, &rests[0])?, background(pegs, &rests[1])?];
        Ok(Self { holes, pegs, size_px, mm_per_px, rests, backgrounds })
    }

    /// Each hole with the nearest peg of its part, where both show an edge; in the order of the holes.
    fn near(&self) -> Result<Vec<Near>> {
        let of_side = |dataset: &'a Dataset, side: Side| {
            let known = move |index: usize| {
                let touch = dataset.touch(index);
                (touch.side == Some(side)).then_some((index, touch.part.as_ref()?, touch.part_from_sensor?))
            };
            (0..dataset.len()).filter_map(known).collect::<Vec<_>>()
        };
        let (holes, pegs) = (of_side(self.holes, Side::Hole), of_side(self.pegs, Side::Peg));
        let nearest = |(hole, part, part_from_hole): &(usize, &String, Se2)| {
            let of_part = pegs.iter().filter(|(_, of, _)| of == part);
            let near = of_part.filter_map(|(peg, _, part_from_peg)| {
                let mm = part_from_hole.distance_mm(part_from_peg);
                let deg = wrap_angle(part_from_hole.theta_rad - part_from_peg.theta_rad).to_degrees().abs();
                let is_near = mm <= NEAR.0 && deg <= NEAR.1;
                is_near.then_some((mm / NEAR.0 + deg / NEAR.1, *peg, *part_from_peg))
            });
            let (_, peg, part_from_peg) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
            Some(Near { hole: *hole, peg, part_from_hole: *part_from_hole, part_from_peg })
        };
        let near: Vec<Near> = holes.par_iter().filter_map(nearest).collect();
        let is_edged = |pair: &Near| -> Result<bool> {
            let seen = [self.seen(0, pair.hole, &Se2::IDENTITY)?, self.seen(1, pair.peg, &Se2::IDENTITY)?];
            Ok(seen.iter().all(|image| image.edge_share >= BLANK_SHARE))
        };
        let edged = near.par_iter().map(is_edged).collect::<Result<Vec<_>>>()?;
        let near: Vec<Near> = near.into_iter().zip(edged).filter(|(_, edged)| *edged).map(|(pair, _)| pair).collect();
        if near.len() < MIN_PAIRS {
            let expected = format!(
                "{MIN_PAIRS} or more holes with a peg of their part within {} mm and {} degrees, both with an edge",
                NEAR.0, NEAR.1
            );
            return Err(Error::invalid(&self.holes.meta().name, expected, near.len().to_string()));
        }
        Ok(near)
    }

    /// The middle of a view (0: of a hole, 1: of a peg), as if the sensor had been moved by `moved`.
    fn seen(&self, which: usize, index: usize, moved: &Se2) -> Result<TactileImage> {
        let dataset = [self.holes, self.pegs][which];
        let frame = picture::resize(&dataset.frame(index), self.size_px)?;
        Ok(self.backgrounds[which].tactile_image(&middle(&self.rests[which], Some(&frame), moved, self.mm_per_px)?)?)
    }

    /// How well a pair mates were the hole board at each of some offsets.
    fn cosines(&self, model: &Model, pair: &Near, offsets: &[Se2]) -> Result<Vec<f64>> {
        let hole = self.seen(0, pair.hole, &Se2::IDENTITY)?;
        let query = model.embed_holes(&[hole])?;
        let frame = picture::resize(&self.pegs.frame(pair.peg), self.size_px)?;
        let peg_from_part = pair.part_from_peg.inverse();
        let image = |offset: &Se2| {
            let moved = peg_from_part * *offset * pair.part_from_hole;
            Ok(self.backgrounds[1].tactile_image(&middle(&self.rests[1], Some(&frame), &moved, self.mm_per_px)?)?)
        };
        let images = offsets.par_iter().map(image).collect::<Result<Vec<_>>>()?;
        let keys = model.embed_pegs(&images)?;
        Ok(keys.chunks_exact(query.len()).map(|key| f64::from(dot(&query, key))).collect())
    }
}

/// The middle of a view as a frame of its own, as if the sensor had been moved; without a frame, of rest.
fn middle(rest: &Frame, frame: Option<&Frame>, moved: &Se2, mm_per_px: [f64; 2]) -> Result<Frame> {
    let view = frame.map(|frame| moved_view(rest, frame, moved, mm_per_px));
    let rgb = view.as_ref().unwrap_or(rest).rgb();
    let (width, height) = (rest.width_px(), rest.height_px());
    let size = [width, height].map(|n| ((n as f64 * MIDDLE) as usize).max(1));
    let corner = [(width - size[0]) / 2, (height - size[1]) / 2];
    let row = |y: usize| &rgb[3 * ((corner[1] + y) * width + corner[0])..][..3 * size[0]];
    Ok(Frame::new(size[0], size[1], (0..size[1]).flat_map(row).copied().collect())?)
}

/// The offsets around one, x slowest.
fn lattice(centre: &Se2, step_mm: f64, step_deg: f64) -> Vec<Se2> {
    let place = |i: usize| place(i).map(|steps| steps as f64);
    let at = |[x, y, turn]: [f64; 3]| moved(centre, [x * step_mm, y * step_mm, turn * step_deg]);
    (0..N_PLACES.pow(3)).map(|i| at(place(i))).collect()
}

/// The place of an offset on its lattice, steps from the middle.
fn place(i: usize) -> [isize; 3] {
    [i / (N_PLACES * N_PLACES), i / N_PLACES % N_PLACES, i % N_PLACES].map(|n| n as isize - N_PLACES as isize / 2)
}

fn moved(centre: &Se2, [x_mm, y_mm, deg]: [f64; 3]) -> Se2 {
    Se2::new(centre.x_mm + x_mm, centre.y_mm + y_mm, centre.theta_rad + deg.to_radians())
}

fn mean(cosines: &[&Vec<f64>]) -> Vec<f64> {
    let n = cosines.len() as f64;
    (0..N_PLACES.pow(3)).map(|i| cosines.iter().map(|of_pair| of_pair[i]).sum::<f64>() / n).collect()
}

/// Where on a lattice values are the largest.
struct Top {
    /// Steps from the middle, at most two and a half.
    place: [f64; 3],
    value: f64,
}

/// The top of the paraboloid of least squares through the values around the largest one; that one itself where it is
/// at the border, from where the next lattice goes on. `None` for values that are no numbers.
fn top(values: &[f64]) -> Option<Top> {
    let best = (0..values.len()).filter(|i| values[*i].is_finite()).max_by(|a, b| values[*a].total_cmp(&values[*b]))?;
    let around = place(best);
    let last = N_PLACES as isize / 2;
    if around.iter().any(|steps| steps.abs() == last) {
        return Some(Top { place: around.map(|steps| steps as f64), value: values[best] });
    }
    let mut normal = [[0.0_f64; 11]; 10];
    for (i, value) in values.iter().enumerate() {
        let p = place(i);
        let off = [0, 1, 2].map(|axis| (p[axis] - around[axis]) as f64);
        if off.iter().any(|steps| steps.abs() > 1.0) {
            continue;
        }
        let [x, y, t] = off;
        let terms = [1.0, x, y, t, x * x, y * y, t * t, x * y, x * t, y * t];
        for (row, a) in normal.iter_mut().zip(terms) {
            row.iter_mut().zip(terms).for_each(|(sum, b)| *sum += a * b);
            row[10] += a * value;
        }
    }
    let c = solve(normal)?;
    // The gradient is zero at the top.
    let hessian = [[2.0 * c[4], c[7], c[8], -c[1]], [c[7], 2.0 * c[5], c[9], -c[2]], [c[8], c[9], 2.0 * c[6], -c[3]]];
    let is_top = c[4] < 0.0 && c[5] < 0.0 && c[6] < 0.0;
    let shift = solve(hessian).filter(|shift| is_top && shift.iter().all(|s| s.abs() <= 1.0)).unwrap_or([0.0; 3]);
    let value = c[0] + 0.5 * (c[1] * shift[0] + c[2] * shift[1] + c[3] * shift[2]);
    Some(Top { place: [0, 1, 2].map(|axis| around[axis] as f64 + shift[axis]), value })
}

/// The standard error of the top along each axis, steps, from leaving out one group of pairs after the other.
fn jackknife(cosines: &[Vec<f64>]) -> [Option<f64>; 3] {
    let n_groups = N_GROUPS.min(cosines.len());
    let without = |group: usize| {
        // Neighbouring pairs, which are of one board, are left out together.
        let is_kept = |i: usize| i * n_groups / cosines.len() != group;
        let kept: Vec<&Vec<f64>> = cosines.iter().enumerate().filter(|(i, _)| is_kept(*i)).map(|(_, c)| c).collect();
        if kept.is_empty() { None } else { top(&mean(&kept)).map(|top| top.place) }
    };
    let places: Option<Vec<[f64; 3]>> = (0..n_groups).map(without).collect();
    [0, 1, 2].map(|axis| {
        let values: Vec<f64> = places.as_ref()?.iter().map(|place| place[axis]).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        Some(((n - 1.0) / n * values.iter().map(|v| (v - mean).powi(2)).sum::<f64>()).sqrt())
    })
}

/// Solves N equations, the right side in the last of M = N + 1 columns, with the largest pivot first.
fn solve<const N: usize, const M: usize>(mut rows: [[f64; M]; N]) -> Option<[f64; N]> {
    for at in 0..N {
        let pivot = (at..N).max_by(|a, b| rows[*a][at].abs().total_cmp(&rows[*b][at].abs()))?;
        rows.swap(at, pivot);
        let above = rows[at];
        if above[at].abs() < 1e-12 {
            return None;
        }
        for row in &mut rows[at + 1..] {
            let share = row[at] / above[at];
            row.iter_mut().zip(above).for_each(|(value, above)| *value -= share * above);
        }
    }
    let mut solution = [0.0; N];
    for at in (0..N).rev() {
        let known: f64 = (at + 1..N).map(|later| rows[at][later] * solution[later]).sum();
        solution[at] = (rows[at][N] - known) / rows[at][at];
    }
    Some(solution)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_top_of_a_paraboloid_is_found_and_one_outside_is_approached() {
        let values = |at: [f64; 3]| -> Vec<f64> {
            let value = |i: usize| {
                let p = place(i).map(|steps| steps as f64);
                let d = [0, 1, 2].map(|axis| p[axis] - at[axis]);
                0.9 - 0.03 * d[0] * d[0] - 0.02 * d[1] * d[1] - 0.01 * d[2] * d[2] + 0.005 * d[0] * d[1]
            };
            (0..N_PLACES.pow(3)).map(value).collect()
        };
        for at in [[0.3, -0.4, 0.1], [-1.2, 0.0, 0.9], [0.0; 3]] {
            let top = top(&values(at)).unwrap();
            assert!((0..3).all(|axis| (top.place[axis] - at[axis]).abs() < 1e-9), "{:?}", top.place);
            assert!((top.value - 0.9).abs() < 1e-9);
        }
        assert_eq!(top(&values([4.0, 0.0, 0.0])).unwrap().place[0], 2.0);
        assert!(top(&vec![f64::NAN; N_PLACES.pow(3)]).is_none());
    }

    #[test]
    fn a_view_moved_back_is_the_view() {
        let rest = Frame::new(40, 30, vec![100; 3600]).unwrap();
        let blob = |cx: f64, cy: f64| {
            let value = |i: usize| {
                let (x, y) = ((i / 3 % 40) as f64 - 19.5 - cx, (i / 3 / 40) as f64 - 14.5 - cy);
                (100.0 + 90.0 * (-(x * x + y * y) / 18.0).exp()) as u8
            };
            Frame::new(40, 30, (0..3600).map(value).collect()).unwrap()
        };
        // What a sensor moved by (2, -1) pixels of 0.5 mm sees lies 2 px further left and 1 px lower.
        let moved = middle(&rest, Some(&blob(0.0, 0.0)), &Se2::new(1.0, -0.5, 0.0), [0.5, 0.5]).unwrap();
        let expected = middle(&rest, Some(&blob(-2.0, 1.0)), &Se2::IDENTITY, [0.5, 0.5]).unwrap();
        assert!(moved.rgb().iter().zip(expected.rgb()).all(|(a, b)| a.abs_diff(*b) <= 1));
        assert_eq!([moved.width_px(), moved.height_px()], [32, 24]);
    }
}
