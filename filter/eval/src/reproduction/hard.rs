//! Scenes in which one touch tells as little as in the paper: what further touches add.

use super::super::report::PaperNumbers;
use super::super::result::{Evaluation, Poses, Row};
use super::cell::{Cell, Line, Tally, columns, papers, table};
use super::folder::{Reproduction, not_run};
use super::{Told, page};

/// Its entry in the contents.
const SHORT: &str = "Hard scenes";
/// Folder and name of each board.
const BOARDS: [(&str, &str); 2] = [("small-hard", "Small board"), ("large-hard", "Large board")];

/// The section.
pub fn tell(found: &Reproduction) -> Told {
    let title = "Hard scenes: what touches add where one tells little";
    let there: Vec<_> =
        BOARDS.iter().filter_map(|(name, told)| Some((*name, *told, found.evaluation(name)?))).collect();
    let missing: String =
        BOARDS.iter().filter(|(name, _)| found.evaluation(name).is_none()).map(|(name, _)| not_run(name)).collect();
    if there.is_empty() {
        return Told::new(SHORT, title, missing, format!("{SHORT}: not run"));
    }
    let lines: Vec<(&str, [Line; 2])> = there.iter().map(|(_, told, evaluation)| (*told, lines(evaluation))).collect();
    let verdicts: Vec<String> = lines
        .iter()
        .map(|(told, [_, gains])| format!("{}: gains {}", told.to_lowercase(), Tally::of(&gains.cells).told()))
        .collect();
    let groups: Vec<(&str, Vec<Line>)> = lines.into_iter().map(|(told, lines)| (told, lines.into())).collect();
    let made: String = there
        .iter()
        .map(|(name, _, evaluation)| format!(" {}: {}", found.report(name, name), page::made_of(evaluation)))
        .collect();
    let line = verdicts.join("; ");
    let body = format!(
        r#"<p>{}.</p><figure>{}<figcaption>The plain scenes are easier than the paper’s boards: one touch names far more of them. In these the sensor is
made so noisy that one touch names about as few as in the paper, chosen on letters that are not measured here; the model is calibrated on those, under the
same sensor. Right parts and then the gain
over one touch (MoCo, the paper’s and ours alike): ours in bold, the paper’s in grey, our 95&nbsp;% interval below (Newcombe’s, of
two shares, as if of different holes: rather too wide). A scene that starts lower has more to gain: read both rows.{made}</figcaption></figure>{missing}"#,
        page::capital(&line),
        table(&["MoCo, 1 touch", "3 touches", "5", "10"], &groups),
    );
    Told::new(SHORT, title, body, format!("{SHORT}: {line}"))
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

/// The accuracy of `later` less that of `first`, points, with Newcombe's interval from those of the two (1998, method
/// 10). It takes them as independent; those of the same holes mostly rise together, so that it is too wide.
fn difference(later: &Row, first: &Row) -> (f64, [f64; 2]) {
    let ([low, high], [first_low, first_high]) = (later.accuracy_ci95, first.accuracy_ci95);
    let points = later.accuracy - first.accuracy;
    let below = (later.accuracy - low).hypot(first_high - first.accuracy);
    let above = (high - later.accuracy).hypot(first.accuracy - first_low);
    (100.0 * points, [100.0 * (points - below), 100.0 * (points + above)])
}

#[cfg(test)]
mod tests {
    use super::super::super::summary::wilson_95;
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;

    #[test]
    fn an_interval_of_a_difference_is_as_published() {
        // 56 of 70 less 48 of 80: 0.0524 to 0.3339, Newcombe 1998 (statistics in medicine 17, p. 877), Table II a.
        let template = evaluation("s", 0.5, &[]).rows[0].clone();
        let row = |n_right: usize, n: usize| Row {
            accuracy: n_right as f64 / n as f64,
            accuracy_ci95: wilson_95(n_right, n),
            ..template.clone()
        };
        let (points, [low, high]) = difference(&row(56, 70), &row(48, 80));
        assert!(
            (points - 20.0).abs() < 1e-9 && (low - 5.24).abs() < 5e-3 && (high - 33.39).abs() < 5e-3,
            "{low} {high}"
        );
    }

    #[test]
    fn the_gain_is_held_against_the_papers() {
        let made = evaluation("alphabet-small-hard", 0.3, &[(1, 0.31), (3, 0.75), (5, 0.7), (10, 0.95)]);
        let told = tell(&of(&[("small-hard", made)]));
        // 45.0, 40.0 and 65.0 points, the paper's 42.2, 51.1 and 55.4, five points to each side.
        assert_eq!(told.line, "Hard scenes: small board: gains 1 of 3 better than the paper, 1 equal, 1 worse");
        let html = told.section.html();
        for cell in
            [r#"<b>+45.0</b><span class="theirs">+42.2</span>"#, r#"<b>+40.0</b><span class="theirs">+51.1</span>"#]
        {
            assert!(html.contains(cell), "{cell}");
        }
        assert!(html.contains("<code>large-hard/</code>"));
    }
}
