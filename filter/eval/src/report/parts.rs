//! How each part fares: what it is mistaken for, and how well it is placed.

use super::super::result::{Evaluation, PartFigures};
use super::shell::Section;
use super::table::sortable;
use super::{escape, number};

/// A row for each part, in the order of the bank; nothing where no part has figures.
pub fn section(evaluation: &Evaluation, way: &str) -> Option<Section> {
    if evaluation.parts.is_empty() {
        return None;
    }
    let row = |of: &PartFigures| {
        let mistaken = of.mistaken_for.as_ref();
        vec![
            escape(&of.part),
            of.n.to_string(),
            number(100.0 * of.n_right as f64 / of.n.max(1) as f64, 1),
            mistaken.map_or_else(|| "–".into(), |(part, n)| format!("{} ({n})", escape(part))),
            number(of.xy_mm_mean, 2),
            number(of.theta_deg_mean, 2),
        ]
    };
    let rows: Vec<_> = evaluation.parts.iter().map(row).collect();
    let heads = ["Part", "holes", "right, %", "mistaken for (times)", "place, mm", "angle, degrees"];
    let body = format!(
        r#"<figure>{}
<figcaption>After the last touch, {way}. Place and angle are mean errors of the holes named rightly, the angle modulo the
part’s own symmetry. Look here for parts that are hard to tell apart, and for those that are named but not well placed.</figcaption></figure>
"#,
        sortable(&heads, &rows)
    );
    Some(Section::new("Parts", "Part by part", body))
}

#[cfg(test)]
mod tests {
    use super::super::super::result::tests::published;
    use super::*;

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
        let html = section(&evaluation, "exact").unwrap().html();
        for expected in ["A&lt;", "97.5", "B (1)", "0.25", "1.50"] {
            assert!(html.contains(expected), "{expected}");
        }
    }
}
