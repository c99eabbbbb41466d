//! Informed touches against random ones, on the same holes.

use super::super::report::comparison::{clearly, range};
use super::super::report::curves::{Line, Marker, Point, chart, legend_mark};
use super::super::report::table::sortable;
use super::super::report::{escape, signed};
use super::super::result::{Choice, Comparison, Evaluation, Method};
use super::Told;
use super::folder::{Reproduction, not_run};

/// CSS of these curves.
pub const STYLE: &str = ".small-board { color: var(--information); } .large-board { color: var(--paper-rule); }";

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
pub fn tell(found: &Reproduction) -> Told {
    let title = "Informed against random touches";
    let all: Vec<_> = CURVES
        .iter()
        .filter_map(|of| Some((of, against_random(found.evaluation(of.0)?))))
        .filter(|(_, comparisons)| !comparisons.is_empty())
        .collect();
    let missing: String = CURVES
        .iter()
        .filter(|of| all.iter().all(|(there, _)| there.0 != of.0))
        .map(|of| match found.evaluation(of.0) {
            Some(_) => format!(r#"<p class="note">Not run: <code>{}/</code> compares nothing with random.</p>"#, of.0),
            None => not_run(of.0),
        })
        .collect();
    if all.is_empty() {
        return Told::new(SHORT, title, missing, format!("{SHORT}: not run"));
    }
    let lines: Vec<Line> = all.iter().map(|(of, comparisons)| line(of, comparisons)).collect();
    let legend: String = lines
        .iter()
        .map(|line| format!("<li>{}{}</li>", legend_mark(&line.class, line.marker, true), escape(&line.label)))
        .collect();
    let verdicts: String =
        all.iter().map(|(of, comparisons)| format!("<li>{}: {}.</li>", escape(of.1), clearly(comparisons))).collect();
    let every: Vec<&Comparison> = all.iter().flat_map(|(_, comparisons)| comparisons.iter().copied()).collect();
    let body = format!(
        r#"<p>Informed touches are, against random ones:</p><ul>{verdicts}</ul><figure><div class="charts two"><div><p>Informed less random, points</p>{}<ul class="legend">{legend}</ul></div>{}</div>
<figcaption>The same holes from the same first touch, by the most informative touch and by any; the accuracy of the one less that of the
other, with the 95&nbsp;% interval of the paired difference. Above nought informed touches are better; where the band holds nought, these
episodes cannot tell. No number of the paper stands beside this.</figcaption></figure>{missing}"#,
        chart("Informed less random", &lines, Some(range(&every))),
        numbers(&all),
    );
    let told: Vec<String> = all.iter().filter_map(|(of, comparisons)| at_three(of.1, comparisons)).collect();
    Told::new(SHORT, title, body, format!("{SHORT}: after 3 touches {}", told.join("; ")))
}

/// The leading rule less chance, by touches.
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
    let [low, high] = c.ci95.map(|bound| signed(100.0 * bound, 1));
    Some(format!("{name} {} points ({low} to {high})", signed(100.0 * c.difference, 1)))
}

fn line((_, name, class, marker): &(&str, &str, &str, Marker), comparisons: &[&Comparison]) -> Line {
    let point = |c: &&Comparison| Point {
        n_touches: c.n_touches,
        value: 100.0 * c.difference,
        interval: Some(c.ci95.map(|bound| 100.0 * bound)),
    };
    let points = comparisons.iter().map(point).collect();
    Line { label: (*name).into(), class: (*class).into(), marker: *marker, points }
}

type Curve<'a> = (&'a (&'a str, &'a str, &'a str, Marker), Vec<&'a Comparison>);

/// A row for each number of touches, a column for each board.
fn numbers(all: &[Curve<'_>]) -> String {
    let mut n_touches: Vec<usize> = all.iter().flat_map(|(_, of)| of).map(|c| c.n_touches).collect();
    n_touches.sort_unstable();
    n_touches.dedup();
    let cell = |comparisons: &[&Comparison], n: usize| {
        comparisons.iter().find(|c| c.n_touches == n).map_or(String::new(), |c| {
            let [low, high] = c.ci95.map(|bound| signed(100.0 * bound, 1));
            format!("{}<small>{low} to {high}</small>", signed(100.0 * c.difference, 1))
        })
    };
    let row = |n: &usize| std::iter::once(n.to_string()).chain(all.iter().map(|(_, of)| cell(of, *n))).collect();
    let heads: Vec<&str> = std::iter::once("Touches").chain(all.iter().map(|(of, _)| of.1)).collect();
    sortable(&heads, &n_touches.iter().map(row).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::result::Inference;

    #[test]
    fn only_the_leading_rule_against_chance_is_told() {
        let mut made = evaluation("alphabet-small", 0.5, &[(1, 0.5), (3, 0.9)]);
        let comparison = |action, against, n_touches, difference: f64| Comparison {
            inference: Inference::Exact,
            action,
            against,
            n_touches,
            difference,
            ci95: [difference - 0.03125, difference + 0.03125],
        };
        made.comparisons = vec![
            comparison(Choice::Information, Choice::Paper, 3, 0.5),
            comparison(Choice::Information, Choice::Random, 3, 0.125),
            comparison(Choice::Information, Choice::Random, 1, 0.0),
        ];
        let told = tell(&of(&[("small", made.clone())]));
        assert_eq!(told.line, "Informed or random: after 3 touches small +12.5 points (+9.4 to +15.6)");
        let html = told.section.html();
        assert!(html.contains("clearly better after 3 touches") && !html.contains("50.0"));
        made.comparisons.clear();
        let html = tell(&of(&[("small", made)])).section.html();
        assert!(html.contains("<code>small/</code> compares nothing") && html.contains("<code>large/</code> is not"));
    }
}
