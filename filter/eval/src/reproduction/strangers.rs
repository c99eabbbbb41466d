//! A part that is not in the bank: how often it is recognised as none of these.

use super::super::report::series::leading_filter;
use super::super::report::table::sortable;
use super::super::report::{escape, number};
use super::super::result::{Evaluation, Method, Stops};
use super::super::summary::wilson_95;
use super::Told;
use super::folder::{Reproduction, not_run};

/// Its entry in the contents.
const SHORT: &str = "Strangers";
/// Folder, name of the board, and the folder in which the parts are all there.
const BOARDS: [(&str, &str, &str); 3] = [
    ("small-absent", "small board", "small"),
    ("large-absent", "large board", "large"),
    ("small-anywhere-absent", "small board, touched anywhere", "small-anywhere"),
];

/// The section.
pub fn tell(found: &Reproduction) -> Told {
    let title = "A part that is not in the bank";
    let there = BOARDS.iter().filter_map(|board| {
        let evaluation = found.evaluation(board.0).filter(|evaluation| evaluation.absent)?;
        Some((board, evaluation, stops(evaluation)?))
    });
    let there: Vec<_> = there.collect();
    let is_missing = |board: &&(&str, &str, &str)| there.iter().all(|(other, ..)| other.0 != board.0);
    let missing: String = BOARDS.iter().filter(is_missing).map(|board| not_run(board.0)).collect();
    if there.is_empty() {
        return Told::new(SHORT, title, missing, format!("{SHORT}: not run"));
    }
    let row = |(board, evaluation, of): &(&(&str, &str, &str), &Evaluation, &Stops)| {
        let share = |share: f64| {
            let n = evaluation.n_episodes;
            let [low, high] = wilson_95((share * n as f64).round() as usize, n).map(|bound| number(100.0 * bound, 1));
            format!("{}<small>{low}–{high}</small>", number(100.0 * share, 1))
        };
        let known = found.evaluation(board.2).and_then(stops);
        vec![
            found.report(board.0, board.1),
            share(of.none_of_these),
            share(of.confident),
            number(of.mean_touches, 1),
            known.map_or("not run".into(), |known| number(100.0 * known.none_of_these, 1)),
            evaluation.n_episodes.to_string(),
        ]
    };
    let heads = ["Board", "none of these, %", "sure of a part, %", "touches", "known called unknown, %", "episodes"];
    let table = sortable(&heads, &there.iter().map(row).collect::<Vec<_>>());
    let body = format!(
        r#"<figure>{table}<figcaption>Each hole’s own peg was taken out of the bank: the right answer is “none of these parts”, and to be sure of a part is wrong
each time. What is left of 100&nbsp;% stopped undecided. Known called unknown: the same answer where the parts are all there, the price
of it. The paper does not treat it.</figcaption></figure>{missing}"#
    );
    let told: Vec<String> = there
        .iter()
        .map(|(board, _, of)| format!("{} {} %", escape(board.1), number(100.0 * of.none_of_these, 1)))
        .collect();
    Told::new(SHORT, title, body, format!("{SHORT}: none of these, {}", told.join("; ")))
}

/// What the stopping rule did with the leading filter.
pub fn stops(evaluation: &Evaluation) -> Option<&Stops> {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter)?;
    let series = leading_filter(evaluation, lead.poses)?;
    let is_lead = |stops: &&Stops| (stops.inference, stops.action) == (series.inference, series.action);
    evaluation.stops.iter().find(is_lead)
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::result::{Choice, Inference};

    #[test]
    fn strangers_stand_with_the_price_of_knowing_them() {
        let made = |absent, none_of_these| {
            let mut made = evaluation("alphabet-small", 0.5, &[(3, 0.5)]);
            made.absent = absent;
            let (inference, action) = (Inference::Exact, Choice::Information);
            made.stops = vec![Stops {
                inference,
                action,
                mean_touches: 2.5,
                confident: 0.05,
                confident_and_wrong: 1.0,
                none_of_these,
                touches_to_95: 4.0,
            }];
            made
        };
        let told = tell(&of(&[("small", made(false, 0.0125)), ("small-absent", made(true, 0.9))]));
        assert_eq!(told.line, "Strangers: none of these, small board 90.0 %");
        let html = told.section.html();
        // 450 of 500 by Wilson.
        assert!(html.contains("90.0<small>87.1–92.3</small>") && html.contains("<td>1.2</td>"));
        assert_eq!(tell(&of(&[("small-absent", made(false, 0.9))])).line, "Strangers: not run", "all were there");
    }
}
