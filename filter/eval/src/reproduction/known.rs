//! Banks that know what the holes look like, next to banks of pegs alone.

use maud::{Markup, html};

use super::folder::Reproduction;
use super::section::{Finding, not_run};
use crate::page::numbers::{number, percent, share};
use crate::page::shell::figure;
use crate::page::table::{cells, sortable};
use crate::report::series::{leading_filter, leading_stops};
use crate::result::{Evaluation, Poses};

/// Its entry in the contents.
const SHORT: &str = "Known holes";

/// Folder, what was touched, the folder of the same with a bank of pegs (compared by the cosine alone where its name says so), and
/// where holes were touched.
const SCENES: [(&str, &str, &str, Poses); 6] = [
    ("known-small", "small letters, anywhere", "small-anywhere", Poses::OffGrid),
    ("known-large", "large letters, anywhere", "large-anywhere", Poses::OffGrid),
    ("known-outlines", "twelve new outlines, anywhere", "outlines-cosine", Poses::OffGrid),
    ("known-connectors", "six connectors", "connectors", Poses::OnGrid),
    ("known-small-hard", "small letters, rough sensor", "small-hard", Poses::OnGrid),
    ("known-large-hard", "large letters, rough sensor", "large-hard", Poses::OnGrid),
];

/// Numbers of touches in the table.
const TOUCHES: [usize; 4] = [1, 3, 5, 10];

/// The section.
pub fn finding(found: &Reproduction) -> Finding {
    let title = "Banks that know what the holes look like";
    let there: Vec<_> = SCENES.iter().filter_map(|of| Some((of, found.evaluation(of.0)?))).collect();
    let missing = html! { @for of in SCENES.iter().filter(|of| found.evaluation(of.0).is_none()) { (not_run(of.0)) } };
    if there.is_empty() {
        return Finding::missing(SHORT, title, missing);
    }
    let mut rows = Vec::new();
    for (of, both) in &there {
        let by_cosine = format!("{}-cosine", of.0.trim_start_matches("known-"));
        let row_of = |pegs| row(found.report(&by_cosine, of.1), "pegs, cosine alone", pegs, of.3);
        rows.extend(found.evaluation(&by_cosine).map(row_of));
        if of.2 != by_cosine {
            rows.extend(found.evaluation(of.2).map(|pegs| row(found.report(of.2, of.1), "pegs", pegs, of.3)));
        }
        let learnt = format!("{}-learnt", of.2);
        let row_of = |pegs| row(found.report(&learnt, of.1), "pegs, learnt from holes", pegs, of.3);
        rows.extend(found.evaluation(&learnt).map(row_of));
        rows.push(row(found.report(of.0, of.1), "pegs and holes", both, of.3));
    }
    let heads = ["Touched", "views of", "1", "3", "5", "10", "touches", "none of these, %", "sure and wrong, %"];
    let body = html! {
        (figure(sortable(&heads, &rows), "Right part in % after so many touches, anywhere or at recorded poses; wrong of those that \
            stopped sure. Where a scene says what the holes look like, each view of the bank can be of a peg and of its hole: the \
            network errs about each view in its own way, and the middle of both is nearer to the touch. The holes are simulated by \
            the same simulator that makes the touches here, with the same clearance: an aid that the paper does not have, and more \
            than a real hole grants. A bank made of a scene learns from simulated holes how to \
            compare embeddings, another aid; recorded pegs (the connectors') and the cosine alone are without."))
        (missing)
    };
    let line = |(of, both): &(&(&str, &str, &str, Poses), &Evaluation)| {
        let at_three = |evaluation| accuracy(evaluation, of.3, 3).map_or("-".into(), |row| percent(row.0));
        let pegs = found.evaluation(of.2).map_or("not run".into(), at_three);
        format!("{} {pegs} -> {} %", of.1, at_three(both))
    };
    let all: Vec<String> = there.iter().map(line).collect();
    Finding::new(SHORT, title, body, &format!("after 3 touches {}", all.join("; ")))
}

fn accuracy(evaluation: &Evaluation, poses: Poses, n_touches: usize) -> Option<(f64, [f64; 2])> {
    leading_filter(evaluation, poses)?.at(n_touches).map(|row| (row.accuracy, row.accuracy_ci95))
}

fn row(name: Markup, views: &str, evaluation: &Evaluation, poses: Poses) -> Vec<Markup> {
    let at = |n| html! { @if let Some((of, ci95)) = accuracy(evaluation, poses, n) { (share(of, ci95)) } };
    let mut row = cells![name, views];
    row.extend(TOUCHES.map(at));
    if let Some(stops) = leading_stops(evaluation) {
        let rest =
            cells![number(stops.mean_touches, 1), percent(stops.none_of_these), percent(stops.confident_and_wrong)];
        row.extend(rest);
    }
    row
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use maud::Render;

    #[test]
    fn each_scene_stands_under_the_same_with_pegs_alone() {
        let made = |first, third| evaluation("connectors", 0.5, &[(1, first), (3, third)]);
        let made = [
            ("connectors", made(0.882, 0.962)),
            ("connectors-learnt", made(0.938, 0.986)),
            ("known-connectors", made(0.982, 0.99)),
        ];
        let found = of(&made);
        let finding = finding(&found);
        assert_eq!(finding.line, "Known holes: after 3 touches six connectors 96.2 -> 99.0 %");
        let html = finding.section.render().0;
        let [pegs, learnt, both] = ["88.2", "93.8", "98.2"].map(|share| html.find(share).unwrap());
        assert!(pegs < learnt && learnt < both && html.contains("<code>known-small/</code>"));
        let pegs = evaluation("connectors", 0.5, &[(1, 0.5)]);
        assert_eq!(super::finding(&of(&[("connectors", pegs)])).line, "Known holes: not run");
    }

    #[test]
    fn what_has_no_aid_comes_first_and_once() {
        let made = |first| {
            let mut made = evaluation("alphabet-small", 0.5, &[(1, first), (3, 0.9)]);
            made.rows.iter_mut().for_each(|row| row.poses = Poses::OffGrid);
            made
        };
        let all = [
            ("small-cosine", made(0.884)),
            ("small-anywhere", made(0.872)),
            ("known-small", made(0.892)),
            ("outlines-cosine", made(0.858)),
            ("known-outlines", made(0.948)),
        ];
        let html = finding(&of(&all)).section.render().0;
        let [cosine, learnt, both] = ["88.4", "87.2", "89.2"].map(|share| html.find(share).unwrap());
        assert!(cosine < learnt && learnt < both);
        assert_eq!((html.matches("85.8").count(), html.matches("pegs, cosine alone").count()), (1, 2));
    }
}
