//! Tables I, II and III in the paper's form.

use maud::html;

use super::cell::{Cell, Line, Tally, columns, papers, particle_columns, table};
use super::folder::Reproduction;
use super::section::{Finding, made_of, not_run};
use crate::page::shell::figure;
use crate::report::PaperNumbers;
use crate::result::{Evaluation, Poses, Row};

/// A table of the paper, and the folders of its figures.
pub struct Board {
    /// Its number in the paper, which is its entry in the contents.
    pub name: &'static str,
    /// What it is about.
    pub title: &'static str,
    /// Evidence as in the paper.
    pub on_grid: &'static str,
    /// The same parts touched elsewhere.
    pub elsewhere: Elsewhere,
    /// Whether it has the paper's filter; else its one touch is what counts.
    pub has_filter: bool,
}

/// A second line of a table: parts of its board touched at other poses.
pub struct Elsewhere {
    /// Its folder.
    pub folder: &'static str,
    /// What the line is called.
    label: &'static str,
    poses: Poses,
    /// Whether the paper's numbers are of the same kind.
    has_paper: bool,
}

const fn anywhere(folder: &'static str) -> Elsewhere {
    Elsewhere { folder, label: "Ours, touched anywhere", poses: Poses::OffGrid, has_paper: false }
}

/// Its Table I.
pub const SMALL: Board = Board {
    name: "Table I",
    title: "Table I: the small board, 12 letters of 12 mm",
    on_grid: "small",
    elsewhere: anywhere("small-anywhere"),
    has_filter: true,
};
/// Its Table II.
pub const LARGE: Board = Board {
    name: "Table II",
    title: "Table II: the large board, 12 letters of 32 mm",
    on_grid: "large",
    elsewhere: anywhere("large-anywhere"),
    has_filter: true,
};
/// Its Table III.
pub const CONNECTORS: Board = Board {
    name: "Table III",
    title: "Table III: 6 connectors of a Raspberry Pi, one touch",
    on_grid: "connectors",
    elsewhere: Elsewhere {
        folder: "connectors-centred",
        label: "Ours, touched at the middle",
        poses: Poses::OnGrid,
        has_paper: true,
    },
    has_filter: false,
};

/// The heads of the columns.
const HEADS: [&str; 5] = ["Pixel", "MoCo, 1 touch", "3 touches", "5", "10"];

/// The section of a table.
pub fn finding(found: &Reproduction, board: &Board) -> Finding {
    let Some(evaluation) = found.evaluation(board.on_grid) else {
        return Finding::not_run(board.name, board.title, board.on_grid);
    };
    let [accuracy, errors] = tallies(evaluation, board);
    let elsewhere = found.evaluation(board.elsewhere.folder);
    let lines = lines(board, evaluation, elsewhere);
    let groups = [
        ("Right part, %", lines.iter().map(|line| line.accuracy()).collect()),
        ("Mean error of the place, mm", lines.iter().map(Way::place).collect()),
        ("Mean error of the angle, degrees", lines.iter().map(Way::angle).collect()),
    ];
    let reports = [(board.on_grid, Some(evaluation)), (board.elsewhere.folder, elsewhere)];
    let line = verdict(&accuracy, &errors);
    let caption = html! {
        (caption(board))
        @for (name, evaluation) in reports {
            @if let Some(evaluation) = evaluation { " " (found.report(name, name)) ": " (made_of(evaluation)) }
        }
    };
    let body = html! {
        p { "After " @if board.has_filter { "3, 5 and 10 touches" } @else { "one touch" } ": " (line) "." }
        (figure(table(&HEADS, &groups), caption))
        @if elsewhere.is_none() { (not_run(board.elsewhere.folder)) }
    };
    Finding::new(board.name, board.title, body, &line)
}

/// What a table comes to, in words.
fn verdict(accuracy: &Tally, errors: &Tally) -> String {
    match (accuracy.n(), errors.n()) {
        (0, _) => "nothing to compare with the paper".into(),
        (_, 0) => format!("accuracy {}", accuracy.in_words()),
        _ => format!("accuracy {}; mean errors {}", accuracy.in_words(), errors.in_words()),
    }
}

fn caption(board: &Board) -> &'static str {
    if board.has_filter {
        "Ours in bold, the paper’s in grey next to it. Right parts: our 95 % interval below; better or worse where the paper’s number is \
         outside it, equal where it is not. Errors: means of the episodes that name the right part, judged at the paper’s one decimal. \
         Particles, the paper’s rule: its Alg. 1 as printed, K = 100, at a temperature of its own and not at the one measured of our model. Evidence anywhere: off the recorded poses, at any angle, which the paper did not do."
    } else {
        "Ours in bold, the paper’s in grey next to it, our 95 % interval below; better or worse where the paper’s number is outside it. The \
         paper touches once, where it does not say: first at 175 poses a part, then at the middle of each. What more touches bring is shown after it, \
         without a number of the paper. How the connectors are mounted was chosen on figures like these."
    }
}

/// The verdicts on accuracy and on errors where the paper has its own method: at 3, 5 and 10 touches, or at one
/// where the table has no more.
pub fn tallies(evaluation: &Evaluation, board: &Board) -> [Tally; 2] {
    let [on_grid, ..] = &lines(board, evaluation, None)[..] else { return [Tally::default(); 2] };
    let counted = if board.has_filter { 2..5 } else { 1..2 };
    let errors = [on_grid.place(), on_grid.angle()];
    let errors = errors.iter().flat_map(|line| &line.cells[counted.clone()]);
    [Tally::of(&on_grid.accuracy().cells[counted.clone()]), Tally::of(errors)]
}

/// A way of inferring in the paper's columns, with its numbers where they are of the same kind.
struct Way<'a> {
    label: &'static str,
    ours: [Option<&'a Row>; 5],
    paper: PaperNumbers,
}

/// The ways of a table: ours, the paper's algorithm on our boards, ours elsewhere.
fn lines<'a>(board: &Board, on_grid: &'a Evaluation, elsewhere: Option<&'a Evaluation>) -> Vec<Way<'a>> {
    let paper = PaperNumbers::of(on_grid);
    let of_elsewhere = if board.elsewhere.has_paper { paper.clone() } else { PaperNumbers::of_scene("") };
    let mut filter_only = paper.clone();
    filter_only.pixel = None;
    filter_only.rows.retain(|row| row.n_touches > 1);
    let ours = Way { label: "Ours", ours: columns(on_grid, Poses::OnGrid), paper };
    let particles = particle_columns(on_grid, Poses::OnGrid);
    let particles = particles.map(|ours| Way { label: "Particles, the paper’s rule", ours, paper: filter_only });
    let elsewhere = elsewhere.map(|evaluation| columns(evaluation, board.elsewhere.poses));
    let elsewhere = elsewhere.map(|ours| Way { label: board.elsewhere.label, ours, paper: of_elsewhere });
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
    use super::super::folder::tests::of;
    use super::*;
    use maud::Render;

    #[test]
    fn a_shortfall_is_in_the_table_like_a_victory() {
        // The paper: 81.8, 90.7, 95.0 %; intervals of 500 are about 1 to 4 points to each side.
        let made = evaluation("alphabet-small", 0.5, &[(3, 0.95), (5, 0.91), (10, 0.8)]);
        let finding = super::finding(&of(&[("small", made)]), &SMALL);
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
        let html = finding(&of(&[("small", made), ("small-anywhere", anywhere)]), &SMALL).section.render().0;
        assert_eq!(html.matches(r#"<b>97.0</b><small>"#).count(), 1, "no number of the paper next to it");
        let other = evaluation("own-parts", 0.5, &[(3, 0.96)]);
        assert_eq!(super::finding(&of(&[("small", other)]), &SMALL).line, "Table I: nothing to compare with the paper");
    }

    #[test]
    fn connectors_are_judged_by_one_touch() {
        let mut made = evaluation("connectors", 0.9, &[(3, 0.99)]);
        made.n_classes = 6;
        let finding = super::finding(&of(&[("connectors", made)]), &CONNECTORS);
        assert_eq!(finding.line, "Table III: accuracy 1 of 1 better than the paper, 0 equal, 0 worse");
        assert_eq!(super::finding(&of(&[]), &CONNECTORS).line, "Table III: not run");
        // At the middle alone the paper's numbers are shown too, but do not count.
        let [mut made, mut centred] =
            [("connectors", 0.7), ("connectors-centred", 0.9)].map(|(scene, one)| evaluation(scene, one, &[(3, 0.99)]));
        (made.n_classes, centred.n_classes) = (6, 6);
        let finding = super::finding(&of(&[("connectors", made), ("connectors-centred", centred)]), &CONNECTORS);
        assert_eq!(finding.line, "Table III: accuracy 0 of 1 better than the paper, 0 equal, 1 worse");
        assert_eq!(finding.section.render().0.matches(r#"<span class="theirs">83.3</span>"#).count(), 2);
    }
}
