//! Tables I, II and III in the paper's form.

use maud::html;

use super::cell::{Cell, Line, Tally, columns, papers, particle_columns, poses, table};
use super::experiments::{Row, Section};
use super::folder::Reproduction;
use super::section::{Finding, made_of, not_run};
use crate::page::shell::figure;
use crate::report::PaperNumbers;
use crate::result::{self, Evaluation, Poses};

/// The evaluation of a table with evidence as in the paper.
pub fn on_grid<'a>(found: &'a Reproduction, board: &Section) -> Option<&'a Evaluation> {
    board.rows.first().and_then(|row| found.evaluation(&row.of))
}

/// The heads of the columns.
const HEADS: [&str; 5] = ["Pixel", "MoCo, 1 touch", "3 touches", "5", "10"];

/// The section of a table.
pub fn finding(found: &Reproduction, board: &Section) -> Finding {
    let Some(evaluation) = on_grid(found, board) else {
        return Finding::not_run(board, board.rows.first().map_or("", |row| &row.of));
    };
    let [accuracy, errors] = tallies(evaluation, board);
    let elsewhere = board.rows.get(1).and_then(|row| Some((row, found.evaluation(&row.of)?)));
    let lines = lines(board, evaluation, elsewhere);
    let groups = [
        ("Right part, %", lines.iter().map(|line| line.accuracy()).collect()),
        ("Mean error of the place, mm", lines.iter().map(Way::place).collect()),
        ("Mean error of the angle, degrees", lines.iter().map(Way::angle).collect()),
    ];
    let line = verdict(&accuracy, &errors);
    let caption = html! {
        (board.caption)
        @for name in board.rows.iter().map(|row| &row.of) {
            @if let Some(evaluation) = found.evaluation(name) { " " (found.report(name, name)) ": " (made_of(evaluation)) }
        }
    };
    let body = html! {
        p { "After " @if board.one_touch { "one touch" } @else { "3, 5 and 10 touches" } ": " (line) "." }
        (figure(table(&HEADS, &groups), caption))
        @if let Some(row) = board.rows.get(1).filter(|_| elsewhere.is_none()) { (not_run(&row.of)) }
    };
    Finding::new(board, body, &line)
}

/// What a table comes to, in words.
fn verdict(accuracy: &Tally, errors: &Tally) -> String {
    match (accuracy.n(), errors.n()) {
        (0, _) => "nothing to compare with the paper".into(),
        (_, 0) => format!("accuracy {}", accuracy.in_words()),
        _ => format!("accuracy {}; mean errors {}", accuracy.in_words(), errors.in_words()),
    }
}

/// The verdicts on accuracy and on errors where the paper has its own method: at 3, 5 and 10 touches, or at one
/// where the table has no more.
pub fn tallies(evaluation: &Evaluation, board: &Section) -> [Tally; 2] {
    let [on_grid, ..] = &lines(board, evaluation, None)[..] else { return [Tally::default(); 2] };
    let counted = if board.one_touch { 1..2 } else { 2..5 };
    let errors = [on_grid.place(), on_grid.angle()];
    let errors = errors.iter().flat_map(|line| &line.cells[counted.clone()]);
    [Tally::of(&on_grid.accuracy().cells[counted.clone()]), Tally::of(errors)]
}

/// A way of inferring in the paper's columns, with its numbers where they are of the same kind.
struct Way<'a> {
    label: &'a str,
    ours: [Option<&'a result::Row>; 5],
    paper: PaperNumbers,
}

/// The ways of a table: ours, the paper's algorithm on our boards, ours elsewhere.
fn lines<'a>(
    board: &'a Section,
    on_grid: &'a Evaluation,
    elsewhere: Option<(&'a Row, &'a Evaluation)>,
) -> Vec<Way<'a>> {
    let paper = PaperNumbers::of(on_grid);
    // The paper does not say where it touches connectors; anywhere else its numbers are of recorded poses.
    let of_elsewhere = if board.one_touch { paper.clone() } else { PaperNumbers::of_scene("") };
    let mut filter_only = paper.clone();
    filter_only.pixel = None;
    filter_only.rows.retain(|row| row.n_touches > 1);
    let ours = Way { label: "Ours", ours: columns(on_grid, Poses::OnGrid), paper };
    let particles = particle_columns(on_grid, Poses::OnGrid);
    let particles = particles.map(|ours| Way { label: "Particles, the paper’s rule", ours, paper: filter_only });
    let elsewhere = elsewhere.map(|(row, evaluation)| {
        let label = row.text.first().map_or("", String::as_str);
        Way { label, ours: columns(evaluation, poses(evaluation)), paper: of_elsewhere }
    });
    [Some(ours), particles, elsewhere].into_iter().flatten().collect()
}

impl Way<'_> {
    fn accuracy(&self) -> Line {
        let cells = self.ours.iter().zip(papers(&self.paper));
        let cells = cells.map(|(ours, paper)| Cell::accuracy(*ours, paper.map(|row| row.accuracy_percent)));
        self.line(cells)
    }

    fn place(&self) -> Line {
        let cells = self.ours.iter().zip(papers(&self.paper));
        self.line(cells.map(|(ours, paper)| {
            let median = ours.and_then(|row| row.xy_mm_median);
            Cell::error(ours.map(|row| row.xy_mm_mean), median, paper.and_then(|row| row.xy_mm))
        }))
    }

    fn angle(&self) -> Line {
        let cells = self.ours.iter().zip(papers(&self.paper));
        self.line(cells.map(|(ours, paper)| {
            let median = ours.and_then(|row| row.theta_deg_median);
            Cell::error(ours.map(|row| row.theta_deg_mean), median, paper.and_then(|row| row.theta_deg))
        }))
    }

    /// Pixel is nobody's method to win with: shown, not judged.
    fn line(&self, cells: impl Iterator<Item = Cell>) -> Line {
        let judge = |(at, cell): (usize, Cell)| if at == 0 { cell.unjudged() } else { cell };
        Line { label: self.label.into(), cells: cells.enumerate().map(judge).collect() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::experiments::tests::section;
    use super::super::folder::tests::of;
    use super::*;
    use maud::Render;

    #[test]
    fn a_shortfall_is_in_the_table_like_a_victory() {
        // The paper: 81.8, 90.7, 95.0 %; intervals of 500 are about 1 to 4 points to each side.
        let made = evaluation("alphabet-small", 0.5, &[(3, 0.95), (5, 0.91), (10, 0.8)]);
        let finding = super::finding(&of(&[("small", made)]), &section("Table I"));
        assert!(
            finding.line.starts_with("Table I: accuracy 1 of 3 better than the paper, 1 equal, 1 worse; mean errors")
        );
        let html = finding.section.render().0;
        assert!(html.contains(r#"<b>80.0</b><span class="theirs">95.0</span>"#));
        assert!(
            html.contains(r#"<small class="wrong">worse</small>"#) && html.contains("<code>small-anywhere/</code>")
        );
    }

    #[test]
    fn the_paper_is_compared_only_with_what_it_measured() {
        let mut anywhere = evaluation("alphabet-small", 0.5, &[(3, 0.97)]);
        anywhere.rows.iter_mut().for_each(|row| row.poses = Poses::OffGrid);
        let made = evaluation("alphabet-small", 0.5, &[(3, 0.96)]);
        let html =
            finding(&of(&[("small", made), ("small-anywhere", anywhere)]), &section("Table I")).section.render().0;
        assert_eq!(html.matches(r#"<b>97.0</b><small>"#).count(), 1, "no number of the paper next to it");
        let other = evaluation("own-parts", 0.5, &[(3, 0.96)]);
        assert_eq!(
            super::finding(&of(&[("small", other)]), &section("Table I")).line,
            "Table I: nothing to compare with the paper"
        );
    }

    #[test]
    fn connectors_are_judged_by_one_touch() {
        let mut made = evaluation("connectors", 0.9, &[(3, 0.99)]);
        made.n_classes = 6;
        let finding = super::finding(&of(&[("connectors", made)]), &section("Table III"));
        assert_eq!(finding.line, "Table III: accuracy 1 of 1 better than the paper, 0 equal, 0 worse");
        assert_eq!(super::finding(&of(&[]), &section("Table III")).line, "Table III: not run");
        // At the middle alone the paper's numbers are shown too, but do not count.
        let [mut made, mut centred] =
            [("connectors", 0.7), ("connectors-centred", 0.9)].map(|(scene, one)| evaluation(scene, one, &[(3, 0.99)]));
        (made.n_classes, centred.n_classes) = (6, 6);
        let finding =
            super::finding(&of(&[("connectors", made), ("connectors-centred", centred)]), &section("Table III"));
        assert_eq!(finding.line, "Table III: accuracy 0 of 1 better than the paper, 0 equal, 1 worse");
        assert_eq!(finding.section.render().0.matches(r#"<span class="theirs">83.3</span>"#).count(), 2);
    }
}
