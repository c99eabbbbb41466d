//! How each part fares: what it is mistaken for, and how well it is placed.

use crate::page::numbers::{number, percent};
use crate::page::shell::{Section, figure};
use crate::page::table::{cells, sortable};
use crate::result::{Evaluation, PartFigures};

/// A row for each part, in the order of the bank; nothing where no part has figures.
pub fn section(evaluation: &Evaluation, way: &str) -> Option<Section> {
    if evaluation.parts.is_empty() {
        return None;
    }
    let row = |of: &PartFigures| {
        let mistaken = of.mistaken_for.as_ref().map_or_else(|| "–".into(), |(part, n)| format!("{part} ({n})"));
        let right = percent(of.n_right as f64 / of.n.max(1) as f64);
        cells![of.part, of.n, right, mistaken, number(of.xy_mm_mean, 2), number(of.theta_deg_mean, 2)]
    };
    let rows: Vec<_> = evaluation.parts.iter().map(row).collect();
    let heads = ["Part", "holes", "right, %", "mistaken for (times)", "place, mm", "angle, degrees"];
    let caption = format!(
        "After the last touch, {way}. Place and angle are mean errors of the holes named rightly, the angle modulo the part’s \
         own symmetry. Look here for parts that are easily confused, and for those that are named but not well placed."
    );
    Some(Section::new("Parts", "Part by part", figure(sortable(&heads, &rows), caption)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::tests::published;
    use maud::Render;

    #[test]
    fn a_part_has_a_row_and_none_has_none() {
        let mut evaluation: Evaluation = serde_json::from_value(published()).unwrap();
        assert!(section(&evaluation, "exact").is_none());
        evaluation.parts = vec![PartFigures {
            part: "A<".into(),
            n: 40,
            n_right: 39,
            mistaken_for: Some(("B".into(), 1)),
            xy_mm_mean: 0.25,
            theta_deg_mean: 1.5,
        }];
        let html = section(&evaluation, "exact").unwrap().render().0;
        for expected in ["A&lt;", "97.5", "B (1)", "0.25", "1.50"] {
            assert!(html.contains(expected), "{expected}");
        }
    }
}
