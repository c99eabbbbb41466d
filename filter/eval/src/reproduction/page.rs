//! The page: its first screen, then a section for each table and figure.

use super::super::report::number;
use super::super::report::shell::{Section, shell};
use super::super::report::table::SCRIPT;
use super::super::report::tradeoff;
use super::super::result::{Evaluation, Poses};
use super::folder::Reproduction;
use super::tables::{CONNECTORS, LARGE, SMALL, tallies};
use super::{Told, assembly, cell, classes, hard, informed, robust, speed, steps, strangers, tables};

/// The whole page.
pub fn html(found: &Reproduction) -> String {
    let sections: Vec<Section> = all(found).into_iter().map(|told| told.section).collect();
    let style = [cell::STYLE, classes::STYLE, informed::STYLE, steps::STYLE, tradeoff::STYLE].join("\n");
    shell("Tactile-Filter, reproduced", &style, &top(found), &sections, &[SCRIPT])
}

/// What each section comes to, in a line.
pub fn summary(found: &Reproduction) -> Vec<String> {
    all(found).into_iter().map(|told| told.line).collect()
}

fn all(found: &Reproduction) -> Vec<Told> {
    vec![
        tables::tell(found, &SMALL),
        tables::tell(found, &LARGE),
        tables::tell(found, &CONNECTORS),
        classes::tell(found),
        informed::tell(found),
        assembly::tell(found),
        hard::tell(found),
        robust::tell(found),
        strangers::tell(found),
        speed::tell(found),
        steps::tell(found),
    ]
}

fn top(found: &Reproduction) -> String {
    let time = steps::total(found).map_or(String::new(), |total| format!(" {}.", capital(&total)));
    format!(
        r##"<h1>Tactile-Filter, reproduced</h1>
<p>Which peg fits a hole, and where the hole is, by touch alone: each table and figure of <i>Tactile-Filter: Interactive Tactile
Perception for Part Mating</i> (Ota, Jha, Tung and Tenenbaum, RSS 2023), our number beside the paper’s in each cell, whichever is better.
The paper’s are of a real robot and printed boards, ours of simulated ones: a yardstick, not a race.{time} How each number was made stands
<a href="#every-step">at the end</a>.</p>
<p class="caution"><b>Our boards are simulated:</b> the parts, the robot, each touch. What was held against reality is the sensor’s
optics and gel, by real images of a ball, grooves, a cuboid and a digit (<code>cargo xtask validate</code>). What was not: no real
hole, peg or letter was touched, so how these figures carry over to a real board is not known.</p>
<div class="tiles">{}</div>
"##,
        [board_tile(found), connectors_tile(found), assembly_tile(found), speed_tile(found)].concat()
    )
}

fn tile(figure: &str, what: &str) -> String {
    format!(r#"<div class="tile"><b>{figure}</b>{what}</div>"#)
}

const NOT_RUN: &str = "not run";

fn board_tile(found: &Reproduction) -> String {
    let boards = [&SMALL, &LARGE].map(|board| (board, found.evaluation(board.on_grid)));
    let run = boards.iter().filter_map(|(board, evaluation)| Some(tallies((*evaluation)?, board)));
    let (mut n_better, mut n, mut n_no_worse, mut n_errors) = (0, 0, 0, 0);
    for [accuracy, errors] in run {
        (n_better, n) = (n_better + accuracy.n_better, n + accuracy.n());
        (n_no_worse, n_errors) = (n_no_worse + errors.n() - errors.n_worse, n_errors + errors.n());
    }
    let missing: Vec<&str> = boards.iter().filter(|(_, there)| there.is_none()).map(|(board, _)| board.name).collect();
    let missing = if missing.is_empty() { String::new() } else { format!(" ({} not run)", missing.join(", ")) };
    let figure = if n == 0 { NOT_RUN.into() } else { format!("{n_better} of {n}") };
    let errors = if n_errors == 0 {
        String::new()
    } else {
        format!("; mean errors of place and angle no larger than the paper’s in {n_no_worse} of {n_errors}")
    };
    let what = format!(
        "accuracy cells of Tables I and II (3, 5, 10 touches) better than the paper, outside the 95&nbsp;% interval{missing}{errors}"
    );
    tile(&figure, &what)
}

fn connectors_tile(found: &Reproduction) -> String {
    let one = found.evaluation(CONNECTORS.on_grid).map(|evaluation| cell::columns(evaluation, Poses::OnGrid)[1]);
    match one.flatten() {
        Some(row) => {
            let [low, high] = row.accuracy_ci95.map(|bound| number(100.0 * bound, 1));
            let what = format!("of connectors named by one touch ({low}–{high}); the paper: 83.3&nbsp;%");
            tile(&format!("{}&nbsp;%", number(100.0 * row.accuracy, 1)), &what)
        }
        None => tile(NOT_RUN, "connectors named by one touch; the paper: 83.3&nbsp;%"),
    }
}

fn assembly_tile(found: &Reproduction) -> String {
    let Some(assembly) = &found.assembly else { return tile(NOT_RUN, "assembly of M, L, T and F; aim: 95&nbsp;%") };
    let share = assembly.all_inserted;
    let [low, high] = share.ci95.map(|bound| number(100.0 * bound, 1));
    let what = format!(
        "of assemblies with every peg in its hole ({low}–{high}; aim: 95&nbsp;%), median {} touches a hole (aim: 4)",
        number(assembly.holes.touches_median, 0)
    );
    tile(&format!("{}&nbsp;%", number(100.0 * share.share, 1)), &what)
}

fn speed_tile(found: &Reproduction) -> String {
    match found.tradeoff.as_ref().and_then(tradeoff::verdict) {
        Some(verdict) => {
            let times = number(verdict.best.decision_ms_p50 / verdict.fast.decision_ms_p50, 1);
            let what = format!(
                "a decision of the fastest setting within 2 points of the best, {times} times as fast (aim: 5); the paper: about 600&nbsp;ms on a GPU"
            );
            tile(&format!("{}&nbsp;ms", number(verdict.fast.decision_ms_p50, 1)), &what)
        }
        None => tile(NOT_RUN, "speed against accuracy; the paper: about 600&nbsp;ms a decision on a GPU"),
    }
}

/// How many episodes stand behind an evaluation, and of which seeds.
pub(super) fn made_of(evaluation: &Evaluation) -> String {
    let seeds: Vec<_> = evaluation.seeds.iter().map(u64::to_string).collect();
    format!("{} episodes, seeds {}.", evaluation.n_episodes, seeds.join(", "))
}

/// The text with its first letter large.
pub(super) fn capital(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::assembly::tests_made;

    fn some() -> Reproduction {
        let small = evaluation("alphabet-small", 0.5, &[(1, 0.5), (3, 0.95), (5, 0.91), (10, 0.8)]);
        let hard = evaluation("alphabet-small-hard", 0.3, &[(3, 0.75), (5, 0.7), (10, 0.95)]);
        Reproduction { assembly: Some(tests_made()), ..of(&[("small", small), ("small-hard", hard)]) }
    }

    #[test]
    fn the_first_screen_says_what_is_simulated_and_what_fell_short() {
        let html = html(&some());
        let top = &html[..html.find(r#"<nav class="contents""#).unwrap()];
        assert!(top.contains("Our boards are simulated") && top.contains("no real\nhole, peg or letter was touched"));
        // Better at 3 touches, equal at 5, worse at 10.
        assert!(
            top.contains("<b>1 of 3</b>") && top.contains("(Table II not run)") && top.contains("<b>50.0&nbsp;%</b>")
        );
        assert_eq!(top.matches("<b>not run</b>").count(), 2, "connectors and speed");
    }

    #[test]
    fn each_section_stands_whether_it_was_run_or_not() {
        let (html, lines) = (html(&some()), summary(&some()));
        assert_eq!((html.matches("<section id=").count(), lines.len()), (11, 11));
        let n_missing = lines.iter().filter(|line| line.ends_with("not run")).count();
        // Tables II and III, classes, informed, robustness, strangers, speed.
        assert_eq!(n_missing, 7, "{lines:#?}");
        assert!(html.contains(r##"href="#every-step""##) && html.contains(r#"id="every-step""#));
    }

    #[test]
    fn the_page_needs_nothing_else_and_each_tag_closes() {
        let html = html(&some());
        for outside in ["http:", "https:", "<script ", "<link", "@import", "import(", "fetch(", "src="] {
            assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
        }
        for tag in
            ["table", "tr", "td", "th", "svg", "g", "figure", "figcaption", "section", "div", "p", "ul", "li", "small"]
        {
            let open = html.matches(&format!("<{tag} ")).count() + html.matches(&format!("<{tag}>")).count();
            assert_eq!(open, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
