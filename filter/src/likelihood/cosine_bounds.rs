//! Upper bounds of a touch's cosine with the views of a part: at each angle, and along each line of places at each angle.

use tactile_data::pose::grid::PoseGrid;

/// Upper bounds for every part of a bank.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct CosineBounds {
    n_angles: usize,
    /// Cosines of a part.
    n_of_part: usize,
    /// `[n_parts, 1 + 2 n_xy, n_theta]`: of all views, of those at each x, of those at each y.
    cosines: Vec<f32>,
}

impl CosineBounds {
    /// By the cosines with all views, `[n_parts, n_xy, n_xy, n_theta]`.
    pub fn of(similarities: &[f32], grid: &PoseGrid) -> Self {
        let (n_xy, n_angles) = (grid.n_xy(), grid.n_theta());
        let n_of_part = (1 + 2 * n_xy) * n_angles;
        let mut cosines = vec![-1.0_f32; similarities.len() / grid.len() * n_of_part];
        for (views, bounds) in similarities.chunks_exact(grid.len()).zip(cosines.chunks_exact_mut(n_of_part)) {
            let (of_all, lines) = bounds.split_at_mut(n_angles);
            let (of_xs, of_ys) = lines.split_at_mut(n_xy * n_angles);
            for (of_x, views) in of_xs.chunks_exact_mut(n_angles).zip(views.chunks_exact(n_xy * n_angles)) {
                for (of_y, views) in of_ys.chunks_exact_mut(n_angles).zip(views.chunks_exact(n_angles)) {
                    raise(of_x, views);
                    raise(of_y, views);
                }
                raise(of_all, of_x);
            }
        }
        Self { n_angles, n_of_part, cosines }
    }

    /// The bounds of one part.
    pub fn of_part(&self, part: usize) -> PartBounds<'_> {
        let (of_angles, lines) = self.cosines[part * self.n_of_part..][..self.n_of_part].split_at(self.n_angles);
        PartBounds { of_angles, lines }
    }
}

/// Makes each value the larger of two.
fn raise(bounds: &mut [f32], values: &[f32]) {
    bounds.iter_mut().zip(values).for_each(|(best, value)| *best = if *value > *best { *value } else { *best });
}

/// Upper bounds for one part.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PartBounds<'a> {
    /// The largest cosine with its views at each angle, `[n_theta]`.
    pub of_angles: &'a [f32],
    lines: &'a [f32],
}

impl PartBounds<'_> {
    /// The largest cosine with the views at each x, or at each y, `[n_xy, n_theta]`.
    pub fn lines(&self) -> [&[f32]; 2] {
        let (xs, ys) = self.lines.split_at(self.lines.len() / 2);
        [xs, ys]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_line_and_each_angle_has_its_largest() {
        let grid = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 2.0, theta_half_deg: 30.0, theta_step_deg: 15.0 };
        let value = |part: usize, cell: usize| ((cell * 37 + part * 11) % 101) as f32 / 101.0;
        let cosines: Vec<f32> = (0..2).flat_map(|part| (0..grid.len()).map(move |cell| value(part, cell))).collect();
        let bounds = CosineBounds::of(&cosines, &grid);
        for part in 0..2 {
            let found = bounds.of_part(part);
            for angle in 0..5 {
                // x is slowest, the angle fastest.
                let largest = |is: &dyn Fn(usize, usize) -> bool| {
                    let places = (0..9).filter(|place| is(place / 3, place % 3));
                    places.map(|place| value(part, place * 5 + angle)).fold(-1.0, f32::max)
                };
                assert_eq!(found.of_angles[angle], largest(&|_, _| true));
                for line in 0..3 {
                    assert_eq!(found.lines()[0][line * 5 + angle], largest(&|x, _| x == line));
                    assert_eq!(found.lines()[1][line * 5 + angle], largest(&|_, y| y == line));
                }
            }
        }
    }
}
