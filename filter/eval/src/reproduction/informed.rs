//! Informed touches against random ones, on the same holes.

use maud::html;

use super::folder::Reproduction;
use super::section::{Finding, not_run};
use crate::page::curves::{Line, Marker, chart, legend};
use crate::page::numbers::{signed, signed_interval};
use crate::page::shell::figure;
use crate::report::comparison::{clearly, points, range, table};
use crate::result::{Choice, Comparison, Evaluation, Method};

/// Folder, name, class of the style and mark of a curve; dashed (particle) where touched anywhere.
const CURVES: [(&str, &str, &str, Marker); 4] = [
    ("small", "small", "small-board", Marker::Circle),
    ("large", "large", "large-board", Marker::Square),
    ("small-anywhere", "small, anywhere", "small-board particle", Marker::Circle),
    ("large-anywhere", "large, anywhere", "large-board particle", Marker::Square),
];

/// Its entry in the contents.
const SHORT: &str = "Informed or random";

/// The section.
pub fn finding(found: &Reproduction) -> Finding {
    let title = "Informed against random touches";
    let all: Vec<_> = CURVES
        .iter()
        .filter_map(|of| Some((of, against_random(found.evaluation(of.0)?))))
        .filter(|(_, comparisons)| !comparisons.is_empty())
        .collect();
    let missing = html! {
        @for of in CURVES.iter().filter(|of| all.iter().all(|(there, _)| there.0 != of.0)) {
            @if found.evaluation(of.0).is_some() {
                p.note { "Not run: " code { (of.0) "/" } " compares nothing with random." }
            } @else {
                (not_run(of.0))
            }
        }
    };
    if all.is_empty() {
        return Finding::missing(SHORT, title, missing);
    }
    let line = |((_, name, class, marker), comparisons): &(&(&str, &str, &str, Marker), Vec<&Comparison>)| Line {
        label: (*name).into(),
        class: (*class).into(),
        marker: *marker,
        points: points(comparisons),
    };
    let lines: Vec<Line> = all.iter().map(line).collect();
    let columns: Vec<(String, &[&Comparison])> =
        all.iter().map(|(of, of_board)| (of.1.into(), &of_board[..])).collect();
    let every: Vec<&Comparison> = all.iter().flat_map(|(_, comparisons)| comparisons.iter().copied()).collect();
    let content = html! {
        div.charts.two {
            div {
                p { "Informed minus random, points" }
                (chart("Informed minus random", &lines, Some(range(&every))))
                (legend(&lines))
            }
            (table(&columns))
        }
    };
    let body = html! {
        p { "Informed touches are, against random ones:" }
        ul { @for (of, comparisons) in &all { li { (of.1) ": " (clearly(comparisons)) "." } } }
        (figure(content, "The same holes from the same first touch, by the most informative touch and by any; the accuracy of the one \
            minus that of the other, with the 95\u{a0}% interval of the paired difference. Above zero informed touches are better; \
            where the band contains zero, these episodes cannot decide. The paper has no number for this."))
        (missing)
    };
    let at_three: Vec<String> = all.iter().filter_map(|(of, comparisons)| at_three(of.1, comparisons)).collect();
    Finding::new(SHORT, title, body, &format!("after 3 touches {}", at_three.join("; ")))
}

/// The leading rule minus chance, by touches.
fn against_random(evaluation: &Evaluation) -> Vec<&Comparison> {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter);
    let is_it = |c: &&Comparison| {
        c.against == Choice::Random && lead.is_some_and(|lead| (lead.inference, lead.action) == (c.inference, c.action))
    };
    let mut found: Vec<&Comparison> = evaluation.comparisons.iter().filter(is_it).collect();
    found.sort_by_key(|c| c.n_touches);
    found
}

fn at_three(name: &str, comparisons: &[&Comparison]) -> Option<String> {
    let c = comparisons.iter().find(|c| c.n_touches == 3)?;
    Some(format!("{name} {} points ({})", signed(100.0 * c.difference, 1), signed_interval(c.ci95)))
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::result::Inference;
    use maud::Render;

    #[test]
    fn only_the_leading_rule_against_chance_is_shown() {
        let mut made = evaluation("alphabet-small", 0.5, &[(1, 0.5), (3, 0.9)]);
        let comparison = |action, against, n_touches, difference: f64| Comparison {
            inference: Inference::Exact,
            action,
            against,
            n_touches,
            difference,
            ci95: [difference - 0.03125, difference + 0.03125],
            paired: None,
        };
        made.comparisons = vec![
            comparison(Choice::Information, Choice::Paper, 3, 0.5),
            comparison(Choice::Information, Choice::Random, 3, 0.125),
            comparison(Choice::Information, Choice::Random, 1, 0.0),
        ];
        let finding = finding(&of(&[("small", made.clone())]));
        assert_eq!(finding.line, "Informed or random: after 3 touches small +12.5 points (+9.4 to +15.6)");
        let html = finding.section.render().0;
        assert!(html.contains("clearly better after 3 touches") && !html.contains("50.0"));
        made.comparisons.clear();
        let html = super::finding(&of(&[("small", made)])).section.render().0;
        assert!(html.contains("<code>small/</code> compares nothing") && html.contains("<code>large/</code> is not"));
    }
}
