//! Informed touches against random ones, on the same holes.

use maud::{Markup, html};

use super::experiments::{Row, Section};
use super::folder::Reproduction;
use super::section::{Finding, not_run};
use crate::page::curves::{Line, Marker, chart, legend};
use crate::page::numbers::{signed, signed_interval};
use crate::page::shell::figure;
use crate::report::comparison::{clearly, points, range, table};
use crate::result::{Choice, Comparison, Evaluation, Method};

/// Rules of chance, with what touches by them are called.
const CHANCE: [(Choice, &str); 2] =
    [(Choice::Random, "random ones"), (Choice::RandomEdge, "random ones that should show an edge")];

/// A board with the leading rule minus one of chance.
type Board<'a> = (&'a Row, Vec<&'a Comparison>);

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let of_rule =
        |(chance, words)| Some((words, boards(found, section, chance))).filter(|(_, boards)| !boards.is_empty());
    let all: Vec<(&str, Vec<Board<'_>>)> = CHANCE.into_iter().filter_map(of_rule).collect();
    let is_there = |name: &str| all.iter().flat_map(|(_, boards)| boards).any(|(there, _)| there.of == name);
    let missing = html! {
        @for row in section.rows.iter().filter(|row| !is_there(&row.of)) {
            @if found.evaluation(&row.of).is_some() {
                p.note { "Not run: " code { (row.of) "/" } " compares nothing with random." }
            } @else {
                (not_run(&row.of))
            }
        }
    };
    if all.is_empty() {
        return Finding::missing(section, missing);
    }
    let body = html! {
        @for (words, boards) in &all { (against(section, words, boards)) }
        (missing)
    };
    let in_short = |(words, boards): &(&str, Vec<Board<'_>>)| {
        let at_three: Vec<String> =
            boards.iter().filter_map(|(of, comparisons)| at_three(&of.text.concat(), comparisons)).collect();
        format!("against {words} {}", at_three.join("; "))
    };
    let line: Vec<String> = all.iter().map(in_short).collect();
    Finding::new(section, body, &format!("after 3 touches {}", line.join("; ")))
}

/// Informed touches against those of one rule of chance.
fn against(section: &Section, words: &str, boards: &[Board<'_>]) -> Markup {
    let line = |(row, comparisons): &Board<'_>| Line {
        label: row.text.concat(),
        class: row.style.clone(),
        marker: row.marker.unwrap_or(Marker::Circle),
        points: points(comparisons),
    };
    let lines: Vec<Line> = boards.iter().map(line).collect();
    let columns: Vec<(String, &[&Comparison])> =
        boards.iter().map(|(of, of_board)| (of.text.concat(), &of_board[..])).collect();
    let every: Vec<&Comparison> = boards.iter().flat_map(|(_, comparisons)| comparisons.iter().copied()).collect();
    let title = format!("Informed minus {words}");
    let content = html! {
        div.charts.two {
            div {
                p { (title) ", points" }
                (chart(&title, &lines, Some(range(&every))))
                (legend(&lines))
            }
            (table(&columns))
        }
    };
    html! {
        p { "Informed touches are, against " (words) ":" }
        ul { @for (of, comparisons) in boards { li { (of.text.concat()) ": " (clearly(comparisons)) "." } } }
        (figure(content, &section.caption))
    }
}

/// The boards that compare the leading rule with one of chance.
fn boards<'a>(found: &'a Reproduction, section: &'a Section, chance: Choice) -> Vec<Board<'a>> {
    let all = section.rows.iter().filter_map(|row| Some((row, minus(found.evaluation(&row.of)?, chance))));
    all.filter(|(_, comparisons)| !comparisons.is_empty()).collect()
}

/// The leading rule minus a rule of chance, by touches.
fn minus(evaluation: &Evaluation, chance: Choice) -> Vec<&Comparison> {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter);
    let is_it = |c: &&Comparison| {
        c.against == chance && lead.is_some_and(|lead| (lead.inference, lead.action) == (c.inference, c.action))
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
    use super::super::experiments::tests::section;
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
            comparison(Choice::Information, Choice::RandomEdge, 3, 0.0625),
        ];
        let finding = finding(&of(&[("small", made.clone())]), &section("Informed or random"));
        assert_eq!(
            finding.line,
            "Informed or random: after 3 touches against random ones small +12.5 points (+9.4 to +15.6); against random ones that \
             should show an edge small +6.2 points (+3.1 to +9.4)"
        );
        let html = finding.section.render().0;
        assert!(html.contains("clearly better after 3 touches") && !html.contains("50.0"));
        made.comparisons.clear();
        let html = super::finding(&of(&[("small", made)]), &section("Informed or random")).section.render().0;
        assert!(html.contains("<code>small/</code> compares nothing") && html.contains("<code>large/</code> is not"));
    }
}
