//! Accuracy against touches for 4, 8 and 12 classes.

use maud::{Markup, html};

use super::experiments::{self, Section};
use super::folder::Reproduction;
use super::section::{Finding, not_run};
use crate::page::curves::{Line, Marker, Point, chart, entry};
use crate::page::numbers::{number, percent, share};
use crate::page::shell::figure;
use crate::page::table::by_touches;
use crate::report::PaperNumbers;
use crate::report::series::leading_filter;
use crate::result::{Evaluation, Poses, Row};

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let there: Vec<_> = section.rows.iter().filter_map(|row| Some((row, found.evaluation(&row.of)?))).collect();
    if there.is_empty() {
        return Finding::not_run(section, "large-4");
    }
    let lines = there.iter().map(|(of, evaluation)| curve(evaluation, of));
    let paper = there
        .iter()
        .find(|(_, evaluation)| evaluation.n_classes == 12)
        .map(|(_, evaluation)| PaperNumbers::of(evaluation));
    let paper = paper.filter(|paper| !paper.rows.is_empty());
    let drawn: Vec<Line> = lines.chain(paper.as_ref().map(papers_points)).collect();
    let evaluations: Vec<&Evaluation> = there.iter().map(|(_, evaluation)| *evaluation).collect();
    let content = html! {
        div.charts.two {
            div {
                p { "Right part, %" }
                (chart("Right part against touches", &drawn, Some([0.0, 100.0])))
                ul.legend {
                    @for line in &drawn { (entry(&line.class, line.marker, line.marker != Marker::Diamond, &line.label)) }
                }
            }
            (numbers(&evaluations, paper.as_ref()))
        }
    };
    let caption = html! {
        (section.caption)
        @for (of, _) in &there { " " (found.report(&of.of, &of.of)) } "."
    };
    let body = html! {
        (figure(content, caption))
        @for row in section.rows.iter().filter(|row| found.evaluation(&row.of).is_none()) { (not_run(&row.of)) }
    };
    let at_three = |evaluation: &&Evaluation| {
        let share = row_at(evaluation, 3).map_or(f64::NAN, |row| row.accuracy);
        format!("{} classes {} %", evaluation.n_classes, percent(share))
    };
    let all: Vec<String> = evaluations.iter().map(at_three).collect();
    Finding::new(section, body, &format!("after 3 touches {}", all.join(", ")))
}

fn row_at(evaluation: &Evaluation, n_touches: usize) -> Option<&Row> {
    leading_filter(evaluation, Poses::OnGrid)?.at(n_touches)
}

fn curve(evaluation: &Evaluation, of: &experiments::Row) -> Line {
    let rows = leading_filter(evaluation, Poses::OnGrid).map_or(Vec::new(), |series| series.rows);
    let points = rows.iter().map(|row| Point::percent(row.n_touches, row.accuracy, row.accuracy_ci95)).collect();
    Line {
        label: format!("{} classes", evaluation.n_classes),
        class: of.style.clone(),
        marker: of.marker.unwrap_or(Marker::Circle),
        points,
    }
}

fn papers_points(paper: &PaperNumbers) -> Line {
    let points = paper.rows.iter();
    let points =
        points.map(|row| Point { n_touches: row.n_touches, value: row.accuracy_percent, interval: None }).collect();
    let label = "The paper’s Table II, 12 classes".into();
    Line { label, class: "reference".into(), marker: Marker::Diamond, points }
}

/// A row for each number of touches, a column for each number of classes.
fn numbers(evaluations: &[&Evaluation], paper: Option<&PaperNumbers>) -> Markup {
    let ours = evaluations.iter().map(|of| (format!("{} classes", of.n_classes), Some(*of)));
    let columns: Vec<_> = ours.chain(paper.map(|_| ("the paper, 12".to_owned(), None))).collect();
    let touches = |of: &Option<&Evaluation>| {
        let series = of.and_then(|of| leading_filter(of, Poses::OnGrid));
        series.map_or(Vec::new(), |series| series.rows.iter().map(|row| row.n_touches).collect())
    };
    by_touches(&columns, touches, |of, n| {
        html! {
            @match of {
                Some(of) => @if let Some(row) = row_at(of, n) { (share(row.accuracy, row.accuracy_ci95)) },
                None => @if let Some(row) = paper.and_then(|paper| paper.at(n)) { (number(row.accuracy_percent, 1)) },
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::experiments::tests::section;
    use super::super::folder::tests::of;
    use super::*;
    use maud::Render;

    #[test]
    fn each_number_of_classes_is_a_curve_and_only_twelve_are_compared_with_the_paper() {
        let made = |n_classes, accuracy| Evaluation {
            n_classes,
            ..evaluation("alphabet-large", 0.5, &[(1, 0.5), (3, accuracy)])
        };
        let found = of(&[("large", made(12, 0.9)), ("large-4", made(4, 0.98))]);
        let finding = finding(&found, &section("4, 8, 12 classes"));
        assert_eq!(finding.line, "4, 8, 12 classes: after 3 touches 4 classes 98.0 %, 12 classes 90.0 %");
        let html = finding.section.render().0;
        assert_eq!(html.matches(r#"<path class="band""#).count(), 2);
        assert!(html.contains("<td>58.7</td>") && html.contains("<code>large-8/</code>"));
        let without =
            super::finding(&of(&[("large-4", made(4, 0.98))]), &section("4, 8, 12 classes")).section.render().0;
        assert!(!without.contains("58.7") && !without.contains("the paper, 12"));
    }
}
