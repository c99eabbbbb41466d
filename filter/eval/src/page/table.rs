//! Tables whose rows sort by a column when its head is pressed.

use maud::{Markup, Render, html};

/// Cells of a row, each whatever maud can render; text is escaped.
macro_rules! cells {
    ($($cell:expr),* $(,)?) => { vec![$(maud::html! { ($cell) }),*] };
}
pub(crate) use cells;

/// A table with heads to press; each row has as many cells as there are heads.
pub fn sortable(heads: &[impl Render], rows: &[Vec<Markup>]) -> Markup {
    html! {
        div.scroll {
            table.sortable {
                thead { tr { @for head in heads { th scope="col" { button type="button" { (head) } } } } }
                tbody { @for row in rows { tr { @for cell in row { td { (cell) } } } } }
            }
        }
    }
}

/// A table with a row for each number of touches after which any column has something: `cell` is given the column and
/// the number. The first head is that of the numbers.
pub fn by_touches<C>(
    columns: &[(String, C)],
    touches: impl Fn(&C) -> Vec<usize>,
    cell: impl Fn(&C, usize) -> Markup,
) -> Markup {
    let mut n_touches: Vec<usize> = columns.iter().flat_map(|(_, column)| touches(column)).collect();
    n_touches.sort_unstable();
    n_touches.dedup();
    let heads: Vec<&str> = std::iter::once("Touches").chain(columns.iter().map(|(head, _)| head.as_str())).collect();
    let row = |n: usize| {
        std::iter::once(html! { (n) }).chain(columns.iter().map(|(_, column)| cell(column, n))).collect::<Vec<_>>()
    };
    sortable(&heads, &n_touches.into_iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_head_can_be_pressed_and_each_cell_is_there() {
        let rows = [["a", "1"], ["b", "2"], ["c<", "3"]].map(|[a, b]| cells![a, b]);
        let html = sortable(&["Way", "%"], &rows).0;
        assert_eq!(html.matches("<button").count(), 2);
        assert_eq!((html.matches("<tr>").count(), html.matches("<td>").count()), (1 + 3, 2 * 3));
        assert!(html.contains("<td>c&lt;</td>"));
    }

    #[test]
    fn each_number_of_touches_has_one_row() {
        let columns = [("a".to_owned(), vec![3, 1]), ("b".into(), vec![3])];
        let html = by_touches(&columns, Vec::clone, |of, n| html! { @if of.contains(&n) { "x" } }).0;
        assert!(html.contains("<tr><td>1</td><td>x</td><td></td></tr><tr><td>3</td><td>x</td><td>x</td></tr>"));
    }
}
