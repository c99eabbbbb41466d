//! What the intervals of an evaluation cover, in words.

use maud::{Markup, html};

use crate::result::Evaluation;

/// What they cover and what not.
pub fn cover(evaluation: &Evaluation) -> Markup {
    let has_parts = evaluation.rows.iter().any(|row| row.accuracy_ci95_clustered.is_some());
    html! {
        @if evaluation.recorded {
            "The 95 % intervals cover which of the touches an episode draws, not other sensors, parts or prints: episodes share their "
            "touches, so that many of them say little more than the recording holds."
        } @else {
            "The 95 % intervals cover other poses and frames of this one model and "
            @if evaluation.n_prints == 1 { "one simulated print of each part" }
            @else { (evaluation.n_prints) " simulated prints of each part, which differ in their layer lines alone" }
            ", not other models or " @if evaluation.n_prints == 1 { "prints" } @else { "printers" } "."
        }
        @if has_parts && !evaluation.absent {
            " Those that say “parts” cover other parts of this kind, other prints included, as far as these parts show how parts "
            "differ: whole parts are drawn anew. They are never narrower than the others."
        }
        @if let Some(n) = evaluation.distinct_first_views.filter(|n| *n < evaluation.n_episodes) {
            " The " (evaluation.n_episodes) " episodes begin with " b { (n) " different views" } ", pairs of part and pose: intervals "
            "after one touch are of " (n) "."
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::tests::published;

    fn evaluation() -> Evaluation {
        serde_json::from_value(published()).unwrap()
    }

    #[test]
    fn prints_and_parts_are_said_where_they_are_covered() {
        let one = cover(&evaluation()).0;
        assert!(
            one.contains("this one model and one simulated print of each part, not other models or prints."),
            "{one}"
        );
        assert!(!one.contains("“parts”"));
        let mut four = Evaluation { n_prints: 4, ..evaluation() };
        four.rows[0].accuracy_ci95_clustered = Some([0.8, 1.0]);
        let html = cover(&four).0;
        assert!(html.contains("4 simulated prints") && html.contains("whole parts are drawn anew"), "{html}");
        assert!(!cover(&Evaluation { absent: true, ..four }).0.contains("whole parts"));
    }

    #[test]
    fn six_views_are_six() {
        let with = |n| cover(&Evaluation { distinct_first_views: Some(n), ..evaluation() }).0;
        assert!(with(6).contains("<b>6 different views</b>") && with(6).contains("after one touch are of 6."));
        assert!(!with(500).contains("different views"));
    }
}
