//! A part that is not in the bank: how often it is recognised as none of these.

use maud::html;

use super::folder::Reproduction;
use super::section::{Finding, not_run};
use crate::page::numbers::{number, percent, share};
use crate::page::shell::figure;
use crate::page::table::{cells, sortable};
use crate::report::series::leading_stops;
use crate::result::{Evaluation, Stops};
use crate::statistics::share::wilson_95;

/// Its entry in the contents.
const SHORT: &str = "Unknown parts";
/// Folder, name of the board, and the folder in which the parts are all there.
const BOARDS: [(&str, &str, &str); 12] = [
    ("small-absent", "small board", "small"),
    ("large-absent", "large board", "large"),
    ("small-anywhere-absent", "small board, touched anywhere", "small-anywhere"),
    ("known-small-absent", "small board, touched anywhere, holes known", "known-small"),
    ("known-connectors-absent", "connectors, holes known", "known-connectors"),
    ("strangers-small-own", "small board, anywhere, holes known, after ten touches of the sensor", "small-own"),
    ("strangers-alike", "twelve shapes, two and two alike, anywhere, holes known", "look-alikes"),
    ("strangers-alike-own", "shapes two and two alike, anywhere, after ten touches of the sensor", "look-alikes-own"),
    ("strangers-outlines", "twelve new outlines, anywhere, holes known", "known-outlines"),
    ("strangers-outlines-own", "new outlines, anywhere, after ten touches of the sensor", "new-outlines-own"),
    ("strangers-connectors", "connectors, anywhere, holes known", "connectors-fine"),
    ("strangers-connectors-own", "connectors, anywhere, after ten touches of the sensor", "connectors-own"),
];

/// The section.
pub fn finding(found: &Reproduction) -> Finding {
    let title = "A part that is not in the bank";
    let there = BOARDS.iter().filter_map(|board| {
        let evaluation = found.evaluation(board.0).filter(|evaluation| evaluation.absent)?;
        Some((board, evaluation, leading_stops(evaluation)?))
    });
    let there: Vec<_> = there.collect();
    let is_missing = |board: &&(&str, &str, &str)| there.iter().all(|(other, ..)| other.0 != board.0);
    let missing = html! { @for board in BOARDS.iter().filter(is_missing) { (not_run(board.0)) } };
    if there.is_empty() {
        return Finding::missing(SHORT, title, missing);
    }
    let row = |(board, evaluation, of): &(&(&str, &str, &str), &Evaluation, &Stops)| {
        let n = evaluation.n_episodes;
        let cell = |of: f64| share(of, wilson_95((of * n as f64).round() as usize, n));
        let known = found.evaluation(board.2).and_then(leading_stops);
        cells![
            found.report(board.0, board.1),
            cell(of.none_of_these),
            cell(of.confident),
            number(of.mean_touches, 1),
            known.map_or("not run".into(), |known| percent(known.none_of_these)),
            n,
        ]
    };
    let heads = ["Board", "none of these, %", "sure of a part, %", "touches", "known called unknown, %", "episodes"];
    let table = sortable(&heads, &there.iter().map(row).collect::<Vec<_>>());
    let body = html! {
        (figure(table, "Each hole’s own peg was taken out of the bank, and out of all that the bank learnt (how embeddings are \
            compared, the temperature, how well parts match their views): the right answer is “none of these parts”, and to be sure \
            of a part is wrong each time. What is left of 100\u{a0}% stopped undecided. Known called unknown: the same answer where the \
            parts are all there, the price of it. The paper does not treat it."))
        (missing)
    };
    let all: Vec<String> =
        there.iter().map(|(board, _, of)| format!("{} {} %", board.1, percent(of.none_of_these))).collect();
    Finding::new(SHORT, title, body, &format!("none of these, {}", all.join("; ")))
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::result::{Choice, Inference};
    use maud::Render;

    #[test]
    fn unknown_parts_come_with_the_price_of_knowing_them() {
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
        let finding = finding(&of(&[("small", made(false, 0.0125)), ("small-absent", made(true, 0.9))]));
        assert_eq!(finding.line, "Unknown parts: none of these, small board 90.0 %");
        let html = finding.section.render().0;
        // 450 of 500 by Wilson.
        assert!(html.contains("90.0<small>87.1–92.3</small>") && html.contains("<td>1.2</td>"));
        assert_eq!(
            super::finding(&of(&[("small-absent", made(false, 0.9))])).line,
            "Unknown parts: not run",
            "all were there"
        );
    }
}
