//! Accuracy against touches for 4, 8 and 12 classes.

use super::super::report::curves::{Line, Marker, Point, chart, legend_mark};
use super::super::report::series::leading_filter;
use super::super::report::table::sortable;
use super::super::report::{PaperNumbers, number};
use super::super::result::{Evaluation, Poses, Row};
use super::Told;
use super::folder::{Reproduction, not_run};

/// CSS of these curves.
pub const STYLE: &str =
    ".four { color: var(--pixel); } .eight { color: var(--random); } .twelve { color: var(--information); }";

/// Folder, classes, class of the style and mark of a curve.
const CURVES: [(&str, usize, &str, Marker); 3] = [
    ("large-4", 4, "four", Marker::Triangle),
    ("large-8", 8, "eight", Marker::Square),
    ("large", 12, "twelve", Marker::Circle),
];

/// Its entry in the contents.
const SHORT: &str = "4, 8, 12 classes";

/// The section.
pub fn tell(found: &Reproduction) -> Told {
    let title = "Accuracy against touches for 4, 8 and 12 classes";
    let there: Vec<_> = CURVES.iter().filter_map(|of| Some((of, found.evaluation(of.0)?))).collect();
    if there.is_empty() {
        return Told::not_run(SHORT, title, "large-4");
    }
    let lines: Vec<Line> = there.iter().map(|(of, evaluation)| curve(evaluation, of.2, of.3)).collect();
    let paper = there.iter().find(|(of, _)| of.1 == 12).map(|(_, evaluation)| PaperNumbers::of(evaluation));
    let paper = paper.filter(|paper| !paper.rows.is_empty());
    let legend: String = lines
        .iter()
        .map(|line| format!("<li>{}{}</li>", legend_mark(&line.class, line.marker, true), line.label))
        .chain(paper.as_ref().map(|_| {
            format!("<li>{}The paper’s Table II, 12 classes</li>", legend_mark("reference", Marker::Diamond, false))
        }))
        .collect();
    let drawn: Vec<Line> = lines.into_iter().chain(paper.as_ref().map(papers_points)).collect();
    let missing: String = CURVES.iter().filter(|of| found.evaluation(of.0).is_none()).map(|of| not_run(of.0)).collect();
    let evaluations: Vec<&Evaluation> = there.iter().map(|(_, evaluation)| *evaluation).collect();
    let links: Vec<String> = there.iter().map(|(of, _)| found.report(of.0, of.0)).collect();
    let body = format!(
        r#"<figure><div class="charts two"><div><p>Right part, %</p>{}<ul class="legend">{legend}</ul></div>{}</div>
<figcaption>The large board at recorded poses, each hole told from its own part and others drawn at random. Fewer classes are easier;
the curves should meet near 100&nbsp;%. Bands are 95&nbsp;% intervals. The paper prints this figure without numbers: only
its 12 classes, which are its Table II, can stand beside ours. Reports: {}.</figcaption></figure>{missing}"#,
        chart("Right part against touches", &drawn, Some([0.0, 100.0])),
        numbers(&evaluations, paper.as_ref()),
        links.join(", "),
    );
    let at_three = |evaluation: &Evaluation| {
        let row = row_at(evaluation, 3).map_or(f64::NAN, |row| 100.0 * row.accuracy);
        format!("{} classes {} %", evaluation.n_classes, number(row, 1))
    };
    let told: Vec<String> = evaluations.into_iter().map(at_three).collect();
    Told::new(SHORT, title, body, format!("{SHORT}: after 3 touches {}", told.join(", ")))
}

fn row_at(evaluation: &Evaluation, n_touches: usize) -> Option<&Row> {
    super::cell::row_of(&leading_filter(evaluation, Poses::OnGrid)?, n_touches)
}

fn curve(evaluation: &Evaluation, class: &str, marker: Marker) -> Line {
    let point = |row: &&Row| Point {
        n_touches: row.n_touches,
        value: 100.0 * row.accuracy,
        interval: Some(row.accuracy_ci95.map(|bound| 100.0 * bound)),
    };
    let rows = leading_filter(evaluation, Poses::OnGrid).map_or(Vec::new(), |series| series.rows);
    let label = format!("{} classes", evaluation.n_classes);
    Line { label, class: class.into(), marker, points: rows.iter().map(point).collect() }
}

fn papers_points(paper: &PaperNumbers) -> Line {
    let points = paper.rows.iter();
    let points =
        points.map(|row| Point { n_touches: row.n_touches, value: row.accuracy_percent, interval: None }).collect();
    Line { label: "The paper, 12 classes".into(), class: "reference".into(), marker: Marker::Diamond, points }
}

/// A row for each number of touches, a column for each number of classes.
fn numbers(evaluations: &[&Evaluation], paper: Option<&PaperNumbers>) -> String {
    let all = evaluations.iter().filter_map(|evaluation| leading_filter(evaluation, Poses::OnGrid));
    let mut n_touches: Vec<usize> = all.flat_map(|series| series.rows).map(|row| row.n_touches).collect();
    n_touches.sort_unstable();
    n_touches.dedup();
    let cell = |evaluation: &&Evaluation, n: usize| {
        row_at(evaluation, n).map_or(String::new(), |row| {
            let [low, high] = row.accuracy_ci95.map(|bound| number(100.0 * bound, 1));
            format!("{}<small>{low}–{high}</small>", number(100.0 * row.accuracy, 1))
        })
    };
    let papers = |n| paper.and_then(|paper| paper.at(n)).map_or(String::new(), |row| number(row.accuracy_percent, 1));
    let row = |n: &usize| {
        let ours = evaluations.iter().map(|evaluation| cell(evaluation, *n));
        let paper = paper.map(|_| papers(*n));
        std::iter::once(n.to_string()).chain(ours).chain(paper).collect()
    };
    let names = evaluations.iter().map(|evaluation| format!("{} classes", evaluation.n_classes));
    let heads: Vec<String> =
        std::iter::once("Touches".into()).chain(names).chain(paper.map(|_| "the paper, 12".into())).collect();
    let heads: Vec<&str> = heads.iter().map(String::as_str).collect();
    sortable(&heads, &n_touches.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;

    #[test]
    fn each_number_of_classes_is_a_curve_and_only_twelve_stand_beside_the_paper() {
        let made = |n_classes, accuracy| Evaluation {
            n_classes,
            ..evaluation("alphabet-large", 0.5, &[(1, 0.5), (3, accuracy)])
        };
        let found = of(&[("large", made(12, 0.9)), ("large-4", made(4, 0.98))]);
        let told = tell(&found);
        assert_eq!(told.line, "4, 8, 12 classes: after 3 touches 4 classes 98.0 %, 12 classes 90.0 %");
        let html = told.section.html();
        assert_eq!(html.matches(r#"<path class="band""#).count(), 2);
        assert!(html.contains("<td>58.7</td>") && html.contains("<code>large-8/</code>"));
        let without = tell(&of(&[("large-4", made(4, 0.98))])).section.html();
        assert!(!without.contains("58.7") && !without.contains("the paper, 12"));
    }
}
