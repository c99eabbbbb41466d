//! The states of one angle, interpolated together: one motion takes them to poses of one angle on a regular lattice.

use std::borrow::Cow;
use std::cell::OnceCell;
use std::ops::Range;

use multiversion::multiversion;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::pose::se2::Se2;
use tactile_infer::bank::between::Around;
use tactile_infer::bank::neighbours::{Across, Neighbours};

use crate::likelihood::cosine_bounds::PartBounds;
use crate::likelihood::interpolation::{Fading, directed, trust};
use crate::likelihood::nearest::Nearest;
use crate::likelihood::softplus::softplus;
use crate::simd;

/// The one index that counts, where a place is a recorded one.
#[inline(always)]
fn recorded(at: &Around) -> Option<usize> {
    let is_only = |k: &usize| at.weights.iter().enumerate().all(|(j, w)| *w == if j == *k { 1.0 } else { 0.0 });
    (0..4).find(is_only).map(|k| at.indices[k])
}

/// [`Around::value`] of each value of a line at each index.
#[inline(always)]
fn values_of<'a>(at: &Around, line: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
    match recorded(at) {
        Some(index) => out.copy_from_slice(&line(index)[..out.len()]),
        None => simd::blend(&at.weights, at.indices.map(line), out),
    }
}

/// [`Around::square`] for each value of a line of cosines.
#[inline(always)]
fn squares_of<'a>(at: &Around, line: impl Fn((usize, usize)) -> &'a [f32], out: &mut [f32]) {
    if recorded(at).is_some() {
        out.fill(1.0);
        return;
    }
    let (constant, weights) = at.square_weights();
    // One by one: an array's `map` is not inlined.
    let [a, b, c, d, e, f] = at.pairs();
    simd::blend_six(constant, &weights, [line(a), line(b), line(c), line(d), line(e), line(f)], out);
}

/// A state's view between recorded ones counts as at most so much more like a touch than the best of its part's views
/// on the lines of places around it, at the angles around it: no state need be looked at to know that it matches no
/// better. 0.1 cuts sharp hills off, and 0.3 adds nothing to 0.2 (`NOTES.md`).
const ABOVE_BEST: f32 = 0.2;

/// The recorded places around a place that have more weight than rounding leaves at a recorded place; the nearest place
/// represents the others.
#[derive(Clone, Copy, Debug)]
struct Counting([usize; 4]);

impl Counting {
    fn of(at: &Around) -> Self {
        Self([0, 1, 2, 3].map(|k: usize| if at.weights[k].abs() > 1e-6 { at.indices[k] } else { at.nearest }))
    }

    /// The largest of their values.
    #[inline(always)]
    fn best(self, value: impl Fn(usize) -> f32) -> f32 {
        let larger = |a: f32, b: f32| if b > a { b } else { a };
        let [a, b, c, d] = self.0.map(value);
        larger(larger(a, b), larger(c, d))
    }
}

/// The weights of poses of one angle, at any places along x and along y: all that is interpolated is, in turn, along
/// theta, y and x. The states of one angle are such poses after any motion, their places as regular as before it.
#[derive(Debug)]
pub struct LatticeWeights {
    n_xy: usize,
    strides: [usize; 3],
    theta: Around,
    ys: Vec<Around>,
    xs: Vec<Around>,
    /// What counts for theta, and for each of the xs and ys, once that was asked for.
    counting: OnceCell<(Counting, [Vec<Counting>; 2])>,
    faded: OnceCell<Vec<Faded>>,
}

/// A state whose view is known though outside the recorded area.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Faded {
    /// The place in the lattice, x slowest.
    pub place: usize,
    /// The nearest cell to it and how far its view is trusted.
    pub nearest: Nearest,
    /// ln(trust / (1 - trust)).
    pub logit: f64,
    /// ln(1 - trust).
    pub log_rest: f64,
}

impl Faded {
    /// log(trust e^log + 1 - trust): what is not known is at 0.
    pub fn mixed(&self, log: f64) -> f64 {
        if self.nearest.trust == 1.0 { log } else { self.log_rest + softplus(log + self.logit) }
    }
}

impl LatticeWeights {
    /// On the grid `views`, at every x and y, mm.
    pub fn at(views: &PoseGrid, theta_rad: f64, xs: &[f64], ys: &[f64]) -> Self {
        let around = |places: &[f64]| places.iter().map(|mm| Around::x_or_y(views, *mm)).collect();
        let (theta, xs, ys) = (Around::theta(views, theta_rad), around(xs), around(ys));
        let (counting, faded) = (OnceCell::new(), OnceCell::new());
        Self { n_xy: views.n_xy(), strides: views.strides(), theta, ys, xs, counting, faded }
    }

    fn counting(&self) -> &(Counting, [Vec<Counting>; 2]) {
        let of_axis = |axis: &Vec<Around>| axis.iter().map(Counting::of).collect();
        self.counting.get_or_init(|| (Counting::of(&self.theta), [&self.xs, &self.ys].map(of_axis)))
    }

    /// On the grid `views`, for the states at angle `angle` of the grid `states`, after the motion `first_from_sensor`.
    pub fn of_states(views: &PoseGrid, states: &PoseGrid, angle: usize, first_from_sensor: &Se2) -> Self {
        let [of_x, of_y, _] = states.strides();
        let at = |index: usize| states.pose(index * (of_x + of_y) + angle) * *first_from_sensor;
        let diagonal: Vec<Se2> = (0..states.n_xy()).map(at).collect();
        let along = |place: fn(&Se2) -> f64| diagonal.iter().map(place).collect::<Vec<_>>();
        Self::at(views, diagonal[0].theta_rad, &along(|pose| pose.x_mm), &along(|pose| pose.y_mm))
    }

    /// `ViewWeights::cosine` at all places, x slowest, from the cosines with one part's views, `[grid.len()]`: for few places
    /// near each other, which share most of what is around them. Without neighbours `ViewWeights::value`.
    pub(crate) fn cosines_of_few(&self, cells: &[f32], neighbours: Option<&Neighbours>) -> Vec<f32> {
        let mut cosines = self.values_of_few(cells);
        if let Some(neighbours) = neighbours {
            let states = Window { theta: &self.theta, xs: &self.xs, ys: &self.ys, n: self.n_xy };
            direct(states, &mut cosines, neighbours);
        }
        cosines
    }

    fn values_of_few(&self, cells: &[f32]) -> Vec<f32> {
        let ([of_x, of_y, _], n_ys) = (self.strides, self.ys.len());
        let (around_x, around_y) = (seen(&self.xs), seen(&self.ys));
        let mut of_angle = vec![0.0; around_y.len()];
        let mut of_ys = Vec::with_capacity(around_x.len() * n_ys);
        for x in around_x.clone() {
            for (value, y) in of_angle.iter_mut().zip(around_y.clone()) {
                *value = self.theta.value(|theta| cells[x * of_x + y * of_y + theta]);
            }
            of_ys.extend(self.ys.iter().map(|y| y.value(|y| of_angle[y - around_y.start])));
        }
        let mut values = Vec::with_capacity(self.xs.len() * n_ys);
        for x in &self.xs {
            values.extend((0..n_ys).map(|y| x.value(|x| of_ys[(x - around_x.start) * n_ys + y])));
        }
        values
    }

    /// The nearest view of each place, x slowest; `None` where the view is unknown.
    pub(crate) fn nearest(&self) -> impl Iterator<Item = Option<Nearest>> {
        (0..self.xs.len() * self.n_ys()).map(|place| {
            let (x, y) = (place / self.n_ys(), place % self.n_ys());
            let trust = trust([self.xs[x].outside, self.ys[y].outside, self.theta.outside])?;
            Some(Nearest { cell: self.cell(x, y), trust })
        })
    }

    /// Whether the view from any state is known.
    pub fn has_known(&self) -> bool {
        let inmost = |axis: &[Around]| axis.iter().map(|at| at.outside.abs()).fold(f64::INFINITY, f64::min);
        trust([inmost(&self.xs), inmost(&self.ys), self.theta.outside]).is_some()
    }

    /// Places along y.
    pub fn n_ys(&self) -> usize {
        self.ys.len()
    }

    /// The places along x and those along y from which views are within the recorded area: none where the angle is
    /// outside it.
    pub fn inside(&self) -> [Range<usize>; 2] {
        let inside = |axis: &[Around]| {
            let is_inside = |at: &Around| at.outside == 0.0;
            let first = axis.iter().position(is_inside).unwrap_or(axis.len());
            first..axis[first..].iter().position(|at| !is_inside(at)).map_or(axis.len(), |n| first + n)
        };
        let ranges = [inside(&self.xs), inside(&self.ys)];
        if self.theta.outside == 0.0 && ranges.iter().all(|range| !range.is_empty()) { ranges } else { [0..0, 0..0] }
    }

    /// The states whose views are known though outside the recorded area; found once.
    pub(crate) fn faded(&self) -> &[Faded] {
        self.faded.get_or_init(|| {
            let mut faded = Vec::new();
            self.for_each_outside(|place, nearest| {
                let Nearest { trust, .. } = nearest;
                faded.push(Faded { place, nearest, logit: (trust / (1.0 - trust)).ln(), log_rest: (1.0 - trust).ln() });
            });
            faded
        })
    }

    /// Calls `take` with each of them, by its place and its view.
    fn for_each_outside(&self, mut take: impl FnMut(usize, Nearest)) {
        let [inside_x, inside_y] = self.inside();
        let fading = |axis: &[Around]| axis.iter().map(|at| Fading::of(at.outside)).collect::<Vec<_>>();
        let (of_ys, of_theta) = (fading(&self.ys), Fading::of(self.theta.outside));
        for (x, of_x) in fading(&self.xs).into_iter().enumerate() {
            let skipped = if inside_x.contains(&x) { inside_y.clone() } else { 0..0 };
            for y in (0..skipped.start).chain(skipped.end..self.ys.len()) {
                if let Some(trust) = of_x.and(of_theta).and(of_ys[y]).trust() {
                    take(x * self.ys.len() + y, Nearest { cell: self.cell(x, y), trust });
                }
            }
        }
    }

    /// The nearest cell to the state at one of the xs and one of the ys.
    #[inline]
    pub fn cell(&self, x: usize, y: usize) -> usize {
        let [of_x, of_y, _] = self.strides;
        self.xs[x].nearest * of_x + self.ys[y].nearest * of_y + self.theta.nearest
    }

    /// The largest cosine that a view at a state may count with, from the largest with any of the part's recorded views
    /// at each angle, `[n_theta]`.
    pub fn most(&self, best_of_angles: &[f32]) -> f32 {
        (self.counting().0.best(|theta| best_of_angles[theta]) + ABOVE_BEST).min(1.0)
    }

    /// The largest cosine that a view at each of the places along x, and along y, may count with: [`ABOVE_BEST`] above
    /// the best recorded view on the lines around it, at the angles around.
    pub(crate) fn most_on_lines(&self, bounds: PartBounds<'_>) -> [Vec<f32>; 2] {
        let (theta, states) = self.counting();
        let most = |lines: &[f32], states: &[Counting]| -> Vec<f32> {
            let of_angles = lines.chunks_exact(bounds.of_angles.len());
            let of_lines: Vec<f32> = of_angles.map(|line| theta.best(|theta| line[theta])).collect();
            states.iter().map(|state| (state.best(|line| of_lines[line]) + ABOVE_BEST).min(1.0)).collect()
        };
        let [of_xs, of_ys] = bounds.lines();
        [most(of_xs, &states[0]), most(of_ys, &states[1])]
    }

    /// `ViewWeights::cosine` at the states of a window, x slowest, from the cosines with one part's recorded views as
    /// [`in_planes`] has them; without neighbours `ViewWeights::value`.
    pub fn cosines(&self, planes: &[f32], neighbours: Option<&Neighbours>, window: [Range<usize>; 2]) -> Vec<f32> {
        let [xs, ys] = window;
        let states = Window { theta: &self.theta, xs: &self.xs[xs], ys: &self.ys[ys], n: self.n_xy };
        cosines(states, planes, neighbours)
    }
}

/// Some of the places of a lattice next to each other.
#[derive(Clone, Copy)]
struct Window<'a> {
    theta: &'a Around,
    xs: &'a [Around],
    ys: &'a [Around],
    /// Places of the views along an axis.
    n: usize,
}

impl Window<'_> {
    /// How many values [`Self::values`] and [`Self::direct`] keep on the way.
    fn n_on_the_way(&self) -> usize {
        self.n * self.n + self.n * self.ys.len() + 2 * self.n + self.ys.len()
    }

    #[inline(always)]
    fn values(self, planes: &[f32], on_the_way: &mut [f32]) -> Vec<f32> {
        let Self { theta, xs, ys, n } = self;
        let (of_angle, rest) = on_the_way.split_at_mut(n * n);
        let (of_ys, rest) = rest.split_at_mut(n * ys.len());
        // Only what the places along y see.
        let seen = seen(ys);
        let seen = seen.start * n..seen.end * n;
        values_of(theta, |theta| &planes[theta * n * n..][seen.clone()], &mut of_angle[seen.clone()]);
        along_y(ys, &mut rest[..n], of_ys, |y, out| values_of(y, |y| &of_angle[y * n..][..n], out));
        let mut values = vec![0.0; xs.len() * ys.len()];
        for (x, values) in xs.iter().zip(values.chunks_exact_mut(ys.len())) {
            values_of(x, |x| &of_ys[x * ys.len()..][..ys.len()], values);
        }
        values
    }

    /// Makes interpolated cosines those with the interpolated embeddings' directions, as `ViewWeights::cosine` does.
    #[inline(always)]
    fn direct(self, cosines: &mut [f32], neighbours: &Neighbours, on_the_way: &mut [f32]) {
        let Self { theta, xs, ys, n } = self;
        let n_states = ys.len();
        // Squared lengths: along theta for each place of the views, along x and y for a state on that axis and a view on the other.
        let (along_theta, rest) = on_the_way.split_at_mut(n * n);
        let (of_ys, rest) = rest.split_at_mut(n * n_states);
        let (of_places, rest) = rest.split_at_mut(n);
        let (of_theta, of_states) = rest.split_at_mut(n);
        let (seen_x, seen_y) = (seen(xs), seen(ys));
        let seen = seen_x.start * n..seen_x.end * n;
        squares_of(theta, |(theta, k)| &neighbours.plane(2, k, theta)[seen.clone()], &mut along_theta[seen.clone()]);
        let between = |axis: usize, seen: &Range<usize>| {
            let lines = seen.start * n..seen.end * n;
            [1, 2, 3].map(|k| between_angles(theta, |theta| &neighbours.plane(axis, k, theta)[lines.clone()]))
        };
        let of_x = between(0, &seen_x);
        let of_y = between(1, &seen_y);
        along_y(ys, of_places, of_ys, |y, out| {
            squares_of(y, |(y, k)| &of_y[k - 1][(y - seen_y.start) * n..][..n], out);
        });
        let across = AcrossAtAngle::of(theta, neighbours, &seen_x, n);
        let half_ys: Vec<_> = ys.iter().map(|y| (y.indices, y.half_weights())).collect();
        for (x, cosines) in xs.iter().zip(cosines.chunks_exact_mut(n_states)) {
            squares_of(x, |(x, k)| &of_x[k - 1][(x - seen_x.start) * n..][..n], of_places);
            line_between(x, |x| &along_theta[x * n..][..n], of_theta);
            of_places.iter_mut().zip(&*of_theta).for_each(|(square, theta)| *square *= theta);
            line_between(x, |x| &of_ys[x * n_states..][..n_states], of_states);
            for (square, y) in of_states.iter_mut().zip(ys) {
                *square *= y.on_line(|y| of_places[y]);
            }
            if let Some(across) = &across {
                across.add_along_x(x, n, [&mut *of_places, &mut *of_theta]);
                for (square, ([_, low, high, _], (half, of))) in of_states.iter_mut().zip(&half_ys) {
                    *square *= 1.0 + half * of_places[*low] + of[0] * of_theta[*low] + of[1] * of_theta[*high];
                }
            }
            for (cosine, square) in cosines.iter_mut().zip(&*of_states) {
                *cosine = directed(*cosine, *square);
            }
        }
    }
}

/// How much more the squared lengths at one angle are than the products of those along each axis, as
/// `ViewWeights` has it: planes, x slowest, from `first_x` on.
struct AcrossAtAngle<'a> {
    first_x: usize,
    xy: Vec<f32>,
    x_theta: Vec<f32>,
    y_theta: &'a [f32],
    half_theta: f32,
}

impl<'a> AcrossAtAngle<'a> {
    fn of(theta: &Around, neighbours: &'a Neighbours, seen_x: &Range<usize>, n: usize) -> Option<Self> {
        let ([_, low, high, _], (half, of)) = (theta.indices, theta.half_weights());
        let plane = |axes, theta| Some(&neighbours.across(axes, theta)?[seen_x.start * n..seen_x.end * n]);
        let all = plane(Across::Xy, low)?.iter().zip(plane(Across::Xy, high)?).zip(plane(Across::All, low)?);
        let xy = all.map(|((low, high), all)| of[0] * low + of[1] * high + half * all).collect();
        let x_theta = plane(Across::XTheta, low)?.iter().map(|value| half * value).collect();
        Some(Self { first_x: seen_x.start, xy, x_theta, y_theta: plane(Across::YTheta, low)?, half_theta: half })
    }

    /// For a place along x, at each recorded place along y: what counts half way to the next one along y, and what there.
    #[inline(always)]
    fn add_along_x(&self, x: &Around, n: usize, [half_way, there]: [&mut [f32]; 2]) {
        let ([_, low, high, _], (half, of)) = (x.indices, x.half_weights());
        let (low, high) = (low - self.first_x, high - self.first_x);
        let line = |plane: &'a [f32], x: usize| &plane[x * n..][..n];
        let of = of.map(|weight| weight * self.half_theta);
        let thetas = line(self.y_theta, low).iter().zip(line(self.y_theta, high));
        for ((out, xy), (low, high)) in half_way.iter_mut().zip(&self.xy[low * n..][..n]).zip(thetas) {
            *out = half * xy + of[0] * low + of[1] * high;
        }
        there.iter_mut().zip(&self.x_theta[low * n..]).for_each(|(out, value)| *out = half * value);
    }
}

/// What is between the planes at the two angles around an angle.
#[inline(always)]
fn between_angles<'a>(theta: &Around, plane: impl Fn(usize) -> &'a [f32]) -> Cow<'a, [f32]> {
    let ([_, low, high, _], share) = (theta.indices, theta.fraction);
    if share == 0.0 {
        return Cow::Borrowed(plane(low));
    }
    let pairs = plane(low).iter().zip(plane(high));
    Cow::Owned(pairs.map(|(low, high)| (1.0 - share) * low + share * high).collect())
}

/// [`Around::on_line`] of each value of a line at each index.
#[inline(always)]
fn line_between<'a>(at: &Around, line: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
    let ([_, low, high, _], share) = (at.indices, at.fraction);
    for (out, (low, high)) in out.iter_mut().zip(line(low).iter().zip(line(high))) {
        *out = (1.0 - share) * low + share * high;
    }
}

/// [`LatticeWeights::cosines`], for the vector unit at hand.
#[multiversion(targets("x86_64+avx2"))]
fn cosines(states: Window<'_>, planes: &[f32], neighbours: Option<&Neighbours>) -> Vec<f32> {
    let mut on_the_way = vec![0.0; states.n_on_the_way()];
    let mut cosines = states.values(planes, &mut on_the_way);
    if let Some(neighbours) = neighbours {
        states.direct(&mut cosines, neighbours, &mut on_the_way);
    }
    cosines
}

/// [`Window::direct`], for the vector unit at hand.
#[multiversion(targets("x86_64+avx2"))]
fn direct(states: Window<'_>, cosines: &mut [f32], neighbours: &Neighbours) {
    states.direct(cosines, neighbours, &mut vec![0.0; states.n_on_the_way()]);
}

/// The recorded places around some places along an axis.
fn seen(places: &[Around]) -> Range<usize> {
    let first = places.iter().map(|at| at.indices[0]).min();
    first.unwrap_or(0)..places.iter().map(|at| at.indices[3] + 1).max().unwrap_or(0)
}

/// One part's cells, `[n_xy, n_xy, n_theta]`, as `[n_theta, n_xy, n_xy]`, in each plane y slowest: what is stored
/// together is interpolated at once.
pub fn in_planes(cells: &[f32], grid: &PoseGrid) -> Vec<f32> {
    let (n, n_theta) = (grid.n_xy(), grid.n_theta());
    let mut planes = vec![0.0; cells.len()];
    for (place, line) in cells.chunks_exact(n_theta).enumerate() {
        let first = place % n * n + place / n;
        planes[first..].iter_mut().step_by(n * n).zip(line).for_each(|(cell, value)| *cell = *value);
    }
    planes
}

/// Puts what `find` finds at each of `ys` for the places along x of a line where it is found, x slowest.
#[inline(always)]
fn along_y(ys: &[Around], line: &mut [f32], found: &mut [f32], find: impl Fn(&Around, &mut [f32])) {
    for (index, y) in ys.iter().enumerate() {
        find(y, line);
        found[index..].iter_mut().step_by(ys.len()).zip(&*line).for_each(|(found, value)| *found = *value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::checks::synthetic::World;
    use crate::likelihood::interpolation::ViewWeights;
    use proptest::prelude::*;
    use rand::SeedableRng;
    use rand::rngs::ChaCha8Rng;

    /// 9 x 9 x 13 poses.
    const FINE: PoseGrid = PoseGrid { xy_half_mm: 8.0, xy_step_mm: 2.0, theta_half_deg: 90.0, theta_step_deg: 15.0 };

    /// The same of a bank, whose lengths along several axes at once are not products of those along each.
    #[test]
    fn a_sheet_of_a_banks_cosines_is_its_stencils() {
        let ring = PoseGrid { xy_half_mm: 4.0, theta_half_deg: 180.0, ..FINE };
        for grid in [FINE, ring] {
            let world = World::new(1, grid, 0.1, 0.02, 4);
            let neighbours = &world.bank.neighbours()[0];
            let mut rng = ChaCha8Rng::seed_from_u64(3);
            let query = world.touch(0, &Se2::from_degrees(1.3, -0.4, 22.0), &mut rng).query;
            let dot = |cell: usize| -> f32 { world.bank.row(cell).iter().zip(&query).map(|(a, b)| a * b).sum() };
            let cells: Vec<f32> = (0..grid.len()).map(dot).collect();
            let (planes, states) = (in_planes(&cells, &grid), grid.subdivided(2, 2));
            for (x, y, degrees) in [(0.0, 0.0, 0.0), (1.3, -0.4, 7.5), (-2.2, 3.1, 38.0), (5.0, 1.0, 1.0)] {
                let moved = Se2::from_degrees(x, y, degrees);
                let mut n_known = 0;
                for angle in 0..states.n_theta() {
                    let lattice = LatticeWeights::of_states(&grid, &states, angle, &moved);
                    let window = [0..lattice.xs.len(), 0..lattice.ys.len()];
                    let sheet = lattice.cosines(&planes, Some(neighbours), window);
                    let few = lattice.cosines_of_few(&cells, Some(neighbours));
                    for (place, (sheet, few)) in sheet.into_iter().zip(few).enumerate() {
                        let pose = states.pose(place * states.n_theta() + angle) * moved;
                        let Some(weights) = ViewWeights::new(&grid, &pose) else { continue };
                        // In f32, in another order.
                        let one = weights.cosine(&cells, neighbours);
                        assert!((sheet - one).abs() < 1e-5 && (few - one).abs() < 1e-5, "{sheet} {few} {one}");
                        n_known += 1;
                    }
                }
                assert!(n_known > 100, "{n_known}");
            }
        }
    }

    proptest! {
        /// All states of one angle at once, as one by one.
        #[test]
        fn a_sheet_is_its_stencils(
            x in -12.0..12.0_f64, y in -12.0..12.0_f64, theta in -100.0..100.0_f64, times in 1..3_usize, seed in 0..99_usize,
        ) {
            let moved = Se2::from_degrees(x, y, theta);
            let noise = |i: usize| ((i * 7919 + seed * 104_729) % 1009) as f32 / 1009.0;
            let cells: Vec<f32> = (0..FINE.len()).map(|cell| 2.0 * noise(cell) - 1.0).collect();
            let neighbours = Neighbours::new(FINE.n_xy(), FINE.n_theta(), |[x, y, theta], axis, k| {
                noise(9 * (117 * x + 13 * y + theta) + 3 * axis + k)
            });
            let states = FINE.subdivided(times, times);
            for angle in [0, states.n_theta() / 3, states.n_theta() - 1] {
                let lattice = LatticeWeights::of_states(&FINE, &states, angle, &moved);
                let planes = in_planes(&cells, &FINE);
                let whole = [0..lattice.xs.len(), 0..lattice.ys.len()];
                let cosines = |neighbours| lattice.cosines(&planes, neighbours, whole.clone());
                let (seen, plain) = (cosines(Some(&neighbours)), cosines(None));
                let mut nearest = vec![None; states.n_xy() * states.n_xy()];
                let [inside_x, inside_y] = lattice.inside();
                for (x, y) in inside_x.flat_map(|x| inside_y.clone().map(move |y| (x, y))) {
                    nearest[x * lattice.n_ys() + y] = Some(Nearest { cell: lattice.cell(x, y), trust: 1.0 });
                }
                lattice.for_each_outside(|place, found| nearest[place] = Some(found));
                for (place, nearest) in nearest.into_iter().enumerate() {
                    let weights = ViewWeights::new(&FINE, &(states.pose(place * states.n_theta() + angle) * moved));
                    prop_assert_eq!(nearest.is_some(), weights.is_some());
                    let (Some(nearest), Some(weights)) = (nearest, weights) else { continue };
                    // A place half-way between two cells may be nearest to either; the length then is another's.
                    prop_assert!((nearest.trust - weights.trust).abs() < 1e-9);
                    prop_assert!((plain[place] - weights.value(&cells)).abs() < 1e-4);
                    if nearest.cell == weights.cell {
                        prop_assert!((seen[place] - weights.cosine(&cells, &neighbours)).abs() < 1e-4);
                    }
                }
            }
        }
    }
}
