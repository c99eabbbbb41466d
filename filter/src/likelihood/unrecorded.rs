//! What is seen beyond the recorded area, where a bank has no view.

use tactile_data::grid::PoseGrid;
use tactile_infer::Bank;

use crate::touch_model::TouchModel;

/// Around a small part nearly all views are blank and on a large one few, whatever is recorded of them. Were it the
/// recorded views' own share where they are edged, a blank touch would speak for a wrong state that sees it at one of the
/// few blank views inside.
const LEAST_BLANK: f64 = 0.5;

/// Share of the unknown views with an edge that look like recorded ones on average, 0..=1: beyond the border the same edges
/// go on. The others look like none that was recorded ([`TouchModel::unknown_similarity`]). Were it none, a touch made
/// there would speak for the one recorded view, of whichever part, that it resembles by chance (`NOTES.md`).
pub(crate) const LIKE_RECORDED: f64 = 0.8;

/// Probability that a view beyond the recorded area is blank: as many as on its border, where that is most of them, since
/// a bank that reaches past its parts ends where they do not reach; else a half. Never more than recorded views are
/// believed to be blank.
pub(crate) fn blank_share(bank: &Bank, config: &TouchModel) -> f64 {
    let (grid, shares) = (bank.grid(), bank.edge_shares());
    let (mut n_recorded, mut n_blank) = (0_usize, 0_usize);
    for part in 0..bank.parts().len() {
        for row in border(grid).map(|cell| part * grid.len() + cell).filter(|row| bank.is_recorded(*row)) {
            n_recorded += 1;
            n_blank += usize::from(config.is_blank(shares[row]));
        }
    }
    (n_blank as f64 / n_recorded.max(1) as f64).clamp(LEAST_BLANK, config.blank_agreement.max(LEAST_BLANK))
}

/// How likely an edged touch is at an unknown view, above the average of the recorded ones: `of_least_alike` is what it is at
/// a view that looks like none of those.
pub(crate) fn likely(of_least_alike: f64) -> f64 {
    LIKE_RECORDED + (1.0 - LIKE_RECORDED) * of_least_alike
}

/// The cells with the least or the largest x or y.
fn border(grid: &PoseGrid) -> impl Iterator<Item = usize> {
    let [of_x, of_y, _] = grid.strides();
    let last = grid.n_xy() - 1;
    let is_border = move |at: usize| at == 0 || at == last;
    let of_line = move |x: usize| (0..=last).filter(move |y| is_border(x) || is_border(*y));
    (0..=last).flat_map(move |x| of_line(x).flat_map(move |y| (0..of_y).map(move |angle| x * of_x + y * of_y + angle)))
}

#[cfg(test)]
mod tests {
    use tactile_infer::rows::Rows;

    use super::*;

    const GRID: PoseGrid = PoseGrid { xy_half_mm: 2.0, xy_step_mm: 1.0, theta_half_deg: 30.0, theta_step_deg: 30.0 };

    /// A bank of one part whose views are blank where `is_blank` says so of a cell's place.
    fn bank(is_blank: impl Fn(f64, f64) -> bool) -> Bank {
        let edge_share = |cell: usize| {
            let pose = GRID.pose(cell);
            if is_blank(pose.x_mm, pose.y_mm) { 0.0 } else { 0.5 }
        };
        let rows = Rows::new(1, vec![1.0; GRID.len()]).unwrap();
        Bank::from_rows(vec!["a".into()], GRID, rows, (0..GRID.len()).map(edge_share).collect(), "model").unwrap()
    }

    #[test]
    fn what_the_border_shows_goes_on_beyond_it() {
        let config = TouchModel::default();
        let share = |is_blank: &dyn Fn(f64, f64) -> bool| blank_share(&bank(is_blank), &config);
        // Sixteen places of 25 lie on the border.
        assert_eq!(border(&GRID).count(), 3 * 16);
        assert_eq!(share(&|x, y| x.abs() < 2.0 && y.abs() < 2.0), 0.5);
        assert_eq!(share(&|x, _| x < 1.5), 0.6875);
        assert_eq!(share(&|_, _| true), config.blank_agreement);
        // What was not recorded says nothing.
        let half = bank(|x, _| x < 1.5);
        let edged = (0..GRID.len()).filter(|cell| GRID.pose(*cell).x_mm > 1.5).collect();
        assert_eq!(blank_share(&half.with_missing(edged).unwrap(), &config), config.blank_agreement);
    }
}
