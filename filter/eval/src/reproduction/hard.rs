//! Scenes in which one touch names as few parts as in the paper: what further touches add.

use maud::html;

use super::cell::{Cell, Line, Tally, columns, papers, table};
use super::experiments::Section;
use super::folder::Reproduction;
use super::section::{Finding, made_of, not_run};
use crate::page::numbers::capital;
use crate::page::shell::figure;
use crate::report::PaperNumbers;
use crate::result::{Evaluation, Poses, Row};

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let there = section.rows.iter().filter_map(|row| Some((&row.of, row.text.concat(), found.evaluation(&row.of)?)));
    let there: Vec<_> = there.collect();
    let missing = html! {
        @for row in section.rows.iter().filter(|row| found.evaluation(&row.of).is_none()) { (not_run(&row.of)) }
    };
    if there.is_empty() {
        return Finding::missing(section, missing);
    }
    let groups: Vec<(&str, Vec<Line>)> =
        there.iter().map(|(_, board, evaluation)| (board.as_str(), lines(evaluation).into())).collect();
    let verdicts: Vec<String> = groups
        .iter()
        .map(|(board, lines)| format!("{}: gains {}", board.to_lowercase(), Tally::of(&lines[1].cells).in_words()))
        .collect();
    let line = verdicts.join("; ");
    let caption = html! {
        (section.caption)
        @for (name, _, evaluation) in &there { " " (found.report(name, name)) ": " (made_of(evaluation)) }
    };
    let body = html! {
        p { (capital(&line)) "." }
        (figure(table(&["MoCo, 1 touch", "3 touches", "5", "10"], &groups), caption))
        (missing)
    };
    Finding::new(section, body, &line)
}

/// Accuracy, and gain over one touch.
fn lines(evaluation: &Evaluation) -> [Line; 2] {
    let paper = PaperNumbers::of(evaluation);
    let [_, ours @ ..] = columns(evaluation, Poses::OnGrid);
    let [_, theirs @ ..] = papers(&paper).map(|row| row.map(|row| row.accuracy_percent));
    let accuracy = ours.iter().zip(theirs).map(|(ours, theirs)| Cell::accuracy(*ours, theirs));
    // The first touch was made as poor as the paper's: no contest.
    let judge = |(at, cell): (usize, Cell)| if at == 0 { cell.unjudged() } else { cell };
    let accuracy = accuracy.enumerate().map(judge).collect();
    let gain = |(ours, theirs): (&Option<&Row>, Option<f64>), first: (Option<&Row>, Option<f64>)| {
        let paper = theirs.zip(first.1).map(|(later, first)| later - first);
        Cell::gain(ours.zip(first.0).map(|(later, first)| difference(later, first)), paper)
    };
    let first = (ours[0], theirs[0]);
    let gains = ours.iter().zip(theirs).skip(1).map(|of| gain(of, first));
    let gains = std::iter::once(Cell::default()).chain(gains).collect();
    [
        Line { label: "Right part, %".into(), cells: accuracy },
        Line { label: "Gain over one touch, points".into(), cells: gains },
    ]
}

/// The accuracy of `later` minus that of `first`, with Newcombe's interval from those of the two (1998, method
/// 10). It takes them as independent; those of the same holes mostly rise together, so that it is too wide.
fn difference(later: &Row, first: &Row) -> (f64, [f64; 2]) {
    let ([low, high], [first_low, first_high]) = (later.accuracy_ci95, first.accuracy_ci95);
    let gain = later.accuracy - first.accuracy;
    let below = (later.accuracy - low).hypot(first_high - first.accuracy);
    let above = (high - later.accuracy).hypot(first.accuracy - first_low);
    (gain, [gain - below, gain + above])
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::experiments::tests::section;
    use super::super::folder::tests::of;
    use super::*;
    use crate::statistics::share::wilson_95;
    use maud::Render;

    #[test]
    fn an_interval_of_a_difference_is_as_published() {
        // 56 of 70 minus 48 of 80: 0.0524 to 0.3339, Newcombe 1998 (statistics in medicine 17, p. 877), Table II a.
        let template = evaluation("s", 0.5, &[]).rows[0].clone();
        let row = |n_right: usize, n: usize| Row {
            accuracy: n_right as f64 / n as f64,
            accuracy_ci95: wilson_95(n_right, n),
            ..template.clone()
        };
        let (gain, [low, high]) = difference(&row(56, 70), &row(48, 80));
        assert!(
            (gain - 0.2).abs() < 1e-9 && (low - 0.0524).abs() < 5e-5 && (high - 0.3339).abs() < 5e-5,
            "{low} {high}"
        );
    }

    #[test]
    fn the_gain_is_compared_with_the_papers() {
        let made = evaluation("alphabet-small-hard", 0.3, &[(1, 0.31), (3, 0.75), (5, 0.7), (10, 0.95)]);
        let finding = finding(&of(&[("small-hard", made)]), &section("Hard scenes"));
        // 45.0, 40.0 and 65.0 points, the paper's 42.2, 51.1 and 55.4, five points to each side.
        assert_eq!(finding.line, "Hard scenes: small board: gains 1 of 3 better than the paper, 1 equal, 1 worse");
        let html = finding.section.render().0;
        for cell in
            [r#"<b>+45.0</b><span class="theirs">+42.2</span>"#, r#"<b>+40.0</b><span class="theirs">+51.1</span>"#]
        {
            assert!(html.contains(cell), "{cell}");
        }
        assert!(html.contains("<code>large-hard/</code>"));
    }
}
