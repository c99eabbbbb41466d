//! How each stranger fares: which part of the bank it is taken for.

use crate::page::numbers::percent;
use crate::page::shell::{Section, figure};
use crate::page::table::{cells, sortable};
use crate::result::{Evaluation, StrangerFigures};

/// A row for each part that was taken out of the bank; nothing where none was.
pub fn section(evaluation: &Evaluation) -> Option<Section> {
    if evaluation.strangers.is_empty() {
        return None;
    }
    let row = |of: &StrangerFigures| {
        let share = |n: usize| percent(n as f64 / of.n.max(1) as f64);
        cells![of.part, of.n, share(of.n_none), share(of.n_named()), of.named_line()]
    };
    let rows: Vec<_> = evaluation.strangers.iter().map(row).collect();
    let heads = ["Part, not in the bank", "holes", "none of these, %", "named with confidence, %", "named (times)"];
    let caption = "Where the episodes stop. A part that is named for another one feels like it: of such a pair the bank must hold \
                   both, or neither may be relied on.";
    Some(Section::new("Strangers", "Which part is taken for which", figure(sortable(&heads, &rows), caption)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::tests::published;
    use maud::Render;

    #[test]
    fn a_stranger_has_a_row_and_none_has_none() {
        let mut evaluation: Evaluation = serde_json::from_value(published()).unwrap();
        assert!(section(&evaluation).is_none());
        let named = vec![("ball<8".into(), 3), ("C".into(), 1)];
        evaluation.strangers = vec![StrangerFigures { part: "A".into(), n: 16, n_none: 8, named }];
        let html = section(&evaluation).unwrap().render().0;
        let row = "<td>A</td><td>16</td><td>50.0</td><td>25.0</td><td>ball&lt;8 (3), C (1)</td>";
        assert!(html.contains(row), "{html}");
    }
}
