//! A cell of a table: our figure, the paper's next to it, and which is better.

use maud::{Markup, html};

use crate::page::numbers::{interval, number, percent, signed, signed_interval};
use crate::report::series::{Series, leading_filter, series};
use crate::report::{PaperNumbers, PaperRow};
use crate::result::{Choice, Evaluation, Inference, Method, Poses, Row};

/// The numbers of touches after which the paper reports the filter.
pub const TOUCHES: [usize; 3] = [3, 5, 10];

/// Ours against the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Better than the paper, its number outside our interval.
    Better,
    /// Chance could explain the difference, or there is none at the paper's decimals.
    Equal,
    /// Worse than the paper, its number outside our interval.
    Worse,
}

impl Verdict {
    /// Compares the interval of a figure that is the better the higher.
    pub fn of_interval([low, high]: [f64; 2], theirs: f64) -> Self {
        match (low > theirs, high < theirs) {
            (true, _) => Self::Better,
            (_, true) => Self::Worse,
            _ => Self::Equal,
        }
    }

    /// Compares an error at the paper's one decimal: the lower the better.
    pub fn of_error(ours: f64, theirs: f64) -> Self {
        match (10.0 * ours).round().total_cmp(&(10.0 * theirs).round()) {
            std::cmp::Ordering::Less => Self::Better,
            std::cmp::Ordering::Equal => Self::Equal,
            std::cmp::Ordering::Greater => Self::Worse,
        }
    }

    fn word_and_class(self) -> (&'static str, &'static str) {
        match self {
            Self::Better => ("better", "right"),
            Self::Equal => ("equal", ""),
            Self::Worse => ("worse", "wrong"),
        }
    }
}

/// How many cells are better, equal and worse.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Cells better than the paper's.
    pub n_better: usize,
    /// Cells equal to it.
    pub n_equal: usize,
    /// Cells worse.
    pub n_worse: usize,
}

impl Tally {
    /// Counts the verdicts of some cells; those without one do not count.
    pub fn of<'a>(cells: impl IntoIterator<Item = &'a Cell>) -> Self {
        let mut tally = Self::default();
        for cell in cells {
            match cell.verdict {
                Some(Verdict::Better) => tally.n_better += 1,
                Some(Verdict::Equal) => tally.n_equal += 1,
                Some(Verdict::Worse) => tally.n_worse += 1,
                None => {}
            }
        }
        tally
    }

    /// The cells counted.
    pub fn n(self) -> usize {
        self.n_better + self.n_equal + self.n_worse
    }

    /// In words: `5 of 6 better than the paper, 1 equal, 0 worse`.
    pub fn in_words(self) -> String {
        format!(
            "{} of {} better than the paper, {} equal, {} worse",
            self.n_better,
            self.n(),
            self.n_equal,
            self.n_worse
        )
    }
}

/// A cell; what it does not have is left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cell {
    ours: Option<String>,
    interval: Option<String>,
    theirs: Option<String>,
    /// Which is better, where both are there and it is ours to win.
    pub verdict: Option<Verdict>,
}

impl Cell {
    /// Right parts, %, with their interval.
    pub fn accuracy(ours: Option<&Row>, theirs: Option<f64>) -> Self {
        let bounds = ours.map(|row| row.accuracy_ci95.map(|bound| 100.0 * bound));
        Self {
            ours: ours.map(|row| percent(row.accuracy)),
            interval: ours.map(|row| interval(row.accuracy_ci95)),
            theirs: theirs.map(|percent| number(percent, 1)),
            verdict: bounds.zip(theirs).map(|(bounds, theirs)| Verdict::of_interval(bounds, theirs)),
        }
    }

    /// A mean error with its median.
    pub fn error(ours: Option<f64>, median: Option<f64>, theirs: Option<f64>) -> Self {
        Self {
            ours: ours.map(|mean| number(mean, 2)),
            interval: median.map(|median| format!("median {}", number(median, 2))),
            theirs: theirs.map(|error| number(error, 1)),
            verdict: ours.zip(theirs).map(|(ours, theirs)| Verdict::of_error(ours, theirs)),
        }
    }

    /// A difference of shares, the higher the better; the paper's in points of a per cent.
    pub fn gain(ours: Option<(f64, [f64; 2])>, theirs: Option<f64>) -> Self {
        let verdict = |((_, bounds), theirs): ((f64, [f64; 2]), f64)| {
            Verdict::of_interval(bounds.map(|bound| 100.0 * bound), theirs)
        };
        Self {
            ours: ours.map(|(share, _)| signed(100.0 * share, 1)),
            interval: ours.map(|(_, ci95)| signed_interval(ci95)),
            theirs: theirs.map(|points| signed(points, 1)),
            verdict: ours.zip(theirs).map(verdict),
        }
    }

    /// The same without a verdict.
    pub fn unjudged(self) -> Self {
        Self { verdict: None, ..self }
    }

    /// Whether there is a figure of ours.
    pub fn is_measured(&self) -> bool {
        self.ours.is_some()
    }

    /// The cell of a table: ours in bold, the paper's next to it, below them the interval and the verdict.
    pub fn html(&self) -> Markup {
        html! {
            td {
                @if let Some(ours) = &self.ours { b { (ours) } }
                @if let Some(theirs) = &self.theirs { span.theirs { (theirs) } }
                @if let Some(interval) = &self.interval { small { (interval) } }
                @if let Some((word, class)) = self.verdict.map(Verdict::word_and_class) { small class=(class) { (word) } }
            }
        }
    }
}

/// A row of a table: its label and its cells.
pub struct Line {
    /// What it is.
    pub label: String,
    /// One for each column.
    pub cells: Vec<Cell>,
}

/// A table of groups of lines with heads over the columns; lines without a figure of ours are left out.
pub fn table(heads: &[&str], groups: &[(&str, Vec<Line>)]) -> Markup {
    let shown = |lines: &'_ [Line]| -> Vec<usize> {
        (0..lines.len()).filter(|at| lines[*at].cells.iter().any(Cell::is_measured)).collect()
    };
    html! {
        div.scroll { table.compared {
            thead { tr { th {} @for head in heads { th scope="col" { (head) } } } }
            tbody {
                @for (title, lines) in groups.iter().filter(|(_, lines)| !shown(lines).is_empty()) {
                    tr.group { th colspan=(heads.len() + 1) { (title) } }
                    @for line in shown(lines).into_iter().map(|at| &lines[at]) {
                        tr { td { (line.label) } @for cell in &line.cells { (cell.html()) } }
                    }
                }
            }
        } }
    }
}

/// The poses that an evaluation touched.
pub fn poses(evaluation: &Evaluation) -> Poses {
    evaluation.rows.iter().find(|row| row.method == Method::Filter).map_or(Poses::OnGrid, |row| row.poses)
}

/// The rows of an evaluation in the paper's columns: Pixel, MoCo, then the filter at [`TOUCHES`].
pub fn columns(evaluation: &Evaluation, poses: Poses) -> [Option<&Row>; 5] {
    let of = |method| evaluation.rows.iter().find(|row| row.method == method && row.poses == poses);
    let lead = leading_filter(evaluation, poses);
    let at = |n| lead.as_ref()?.at(n);
    let [three, five, ten] = TOUCHES.map(at);
    [of(Method::Pixel), of(Method::Moco), three, five, ten]
}

/// Particles with the paper's rule in the same columns, where they ran as well as another way.
pub fn particle_columns(evaluation: &Evaluation, poses: Poses) -> Option<[Option<&Row>; 5]> {
    let is_it = |of: &Series<'_>| (of.inference, of.action) == (Inference::Particle, Choice::Paper);
    let particles = series(evaluation, poses).into_iter().find(is_it)?;
    let [three, five, ten] = TOUCHES.map(|n| particles.at(n));
    Some([None, None, three, five, ten])
}

/// The paper's numbers in the same columns.
pub fn papers(paper: &PaperNumbers) -> [Option<PaperRow>; 5] {
    let at = |n| paper.at(n).copied();
    [paper.pixel, at(1), at(3), at(5), at(10)]
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::result::tests::published;
    use crate::statistics::share::wilson_95;

    /// An evaluation on the grid: MoCo and the filter with these shares of 500 right.
    pub fn evaluation(scene: &str, moco: f64, filter: &[(usize, f64)]) -> Evaluation {
        let mut made: Evaluation = serde_json::from_value(published()).unwrap();
        let template = made.rows[0].clone();
        let row = |method, n_touches, accuracy: f64| Row {
            method,
            n_touches,
            accuracy,
            accuracy_ci95: wilson_95((500.0 * accuracy).round() as usize, 500),
            ..template.clone()
        };
        made.scene = scene.into();
        made.rows = filter.iter().map(|(n, accuracy)| row(Method::Filter, *n, *accuracy)).collect();
        made.rows.push(Row { inference: Inference::None, action: Choice::None, ..row(Method::Moco, 1, moco) });
        made
    }

    #[test]
    fn a_number_inside_the_interval_is_no_victory() {
        let verdicts = [49.9, 50.0, 60.0, 60.1].map(|theirs| Verdict::of_interval([50.0, 60.0], theirs));
        assert_eq!(verdicts, [Verdict::Better, Verdict::Equal, Verdict::Equal, Verdict::Worse]);
    }

    #[test]
    fn errors_are_compared_at_the_papers_decimal() {
        let verdicts = [0.0, 0.04, 0.06, 0.14, 0.16].map(|ours| Verdict::of_error(ours, 0.1));
        use Verdict::{Better, Equal, Worse};
        assert_eq!(verdicts, [Better, Better, Equal, Equal, Worse]);
    }

    #[test]
    fn a_cell_has_both_numbers_and_what_is_missing_is_left_out() {
        let made = evaluation("alphabet-small", 0.5, &[(3, 0.9)]);
        let [pixel, moco, three, five, _] = columns(&made, Poses::OnGrid);
        assert!(pixel.is_none() && five.is_none() && moco.is_some());
        let html = Cell::accuracy(three, Some(81.8)).html().0;
        // Wilson, 450 of 500: 87.1 to 92.3.
        let expected = r#"<td><b>90.0</b><span class="theirs">81.8</span><small>87.1–92.3</small><small class="right">better</small></td>"#;
        assert_eq!(html, expected);
        assert_eq!(Cell::accuracy(five, Some(1.0)).html().0, r#"<td><span class="theirs">1.0</span></td>"#);
    }

    #[test]
    fn a_tally_counts_each_verdict_once() {
        let cell = |ours| Cell::error(Some(ours), None, Some(0.1));
        let tally = Tally::of(&[cell(0.0), cell(0.1), cell(0.5), cell(0.0), cell(0.0).unjudged()]);
        assert_eq!(tally, Tally { n_better: 2, n_equal: 1, n_worse: 1 });
        assert_eq!(tally.in_words(), "2 of 4 better than the paper, 1 equal, 1 worse");
    }
}
