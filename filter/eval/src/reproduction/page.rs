//! The page: its first screen, then a section for each table and figure.

use maud::{Markup, html};

use super::experiments::Kind;
use super::folder::Reproduction;
use super::section::Finding;
use super::tables::{on_grid, tallies};
use super::{assembly, cell, classes, experiments, hard, informed, list, speed, steps, tables};
use crate::page::numbers::{capital, interval, milliseconds, number, percent_sign};
use crate::page::shell::{Section, page, tile};
use crate::report::tradeoff;
use crate::result::Poses;

/// The whole page.
pub fn html(found: &Reproduction) -> String {
    let sections: Vec<Section> = all(found).into_iter().map(|finding| finding.section).collect();
    page("Tactile-Filter, reproduced", &top(found), &sections)
}

/// What each section comes to, in a line.
pub fn summary(found: &Reproduction) -> Vec<String> {
    all(found).into_iter().map(|finding| finding.line).collect()
}

fn all(found: &Reproduction) -> Vec<Finding> {
    let finding = |section: &experiments::Section| match section.kind {
        Kind::Paper => tables::finding(found, section),
        Kind::Classes => classes::finding(found, section),
        Kind::Informed => informed::finding(found, section),
        Kind::Assembly => assembly::finding(found, section),
        Kind::Hard => hard::finding(found, section),
        Kind::List => list::finding(found, section),
        Kind::Speed => speed::finding(found, section),
        Kind::Steps => steps::finding(found, section),
    };
    found.experiments.sections.iter().map(finding).collect()
}

fn top(found: &Reproduction) -> Markup {
    html! {
        h1 { "Tactile-Filter, reproduced" }
        p {
            "Which peg fits a hole, and where the hole is, by touch alone: each table and figure of " i { "Tactile-Filter: Interactive "
            "Tactile Perception for Part Mating" } " (Ota, Jha, Tung and Tenenbaum, RSS 2023), our number next to the paper’s in each "
            "cell, in any case. The paper’s are of a real robot and printed boards, ours of simulated ones: a yardstick, not a race."
            @if let Some(total) = steps::total(found) { " " (capital(&total)) "." }
            " How each number was made is " a href="#every-step" { "at the end" } "."
        }
        p.caution {
            b { "Our boards are simulated:" } " the parts, the robot, each touch. What was compared with reality is the sensor’s optics "
            "and gel, by real images of a ball, grooves, a cuboid and a digit (" code { "cargo xtask validate" } "). What was not: no "
            "real hole, peg or letter was touched, so how these figures carry over to a real board is not known."
        }
        p.caution {
            b { "What the figures cover:" } " the 95 % intervals are of other holes, poses and frames of one model and one simulated "
            "print of each part, not of other models or prints. Settings were chosen on letters that are not in these tables, but for "
            "three: the assembly’s letters M, L, T and F, the mount of the connectors and the stop on an edge were chosen on figures "
            "like these."
        }
        div.tiles { (board_tile(found)) (connectors_tile(found)) (assembly_tile(found)) (speed_tile(found)) }
    }
}

const NOT_RUN: &str = "not run";

fn board_tile(found: &Reproduction) -> Markup {
    let boards = found.experiments.papers().filter(|board| !board.one_touch);
    let boards: Vec<_> = boards.map(|board| (board, on_grid(found, board))).collect();
    let run = boards.iter().filter_map(|(board, evaluation)| Some(tallies((*evaluation)?, board)));
    let (mut n_better, mut n, mut n_no_worse, mut n_errors) = (0, 0, 0, 0);
    for [accuracy, errors] in run {
        (n_better, n) = (n_better + accuracy.n_better, n + accuracy.n());
        (n_no_worse, n_errors) = (n_no_worse + errors.n() - errors.n_worse, n_errors + errors.n());
    }
    let missing: Vec<&str> =
        boards.iter().filter(|(_, there)| there.is_none()).map(|(board, _)| board.short.as_str()).collect();
    let figure = if n == 0 { NOT_RUN.into() } else { format!("{n_better} of {n}") };
    tile(
        figure,
        html! {
            "accuracy cells of Tables I and II (3, 5, 10 touches) better than the paper, outside the 95\u{a0}% interval"
            @if !missing.is_empty() { " (" (missing.join(", ")) " not run)" }
            @if n_errors > 0 {
                "; mean errors of place and angle no larger than the paper’s in " (n_no_worse) " of " (n_errors)
            }
        },
    )
}

fn connectors_tile(found: &Reproduction) -> Markup {
    let mut board = found.experiments.papers().filter(|board| board.one_touch);
    let evaluation = board.next().and_then(|board| on_grid(found, board));
    match evaluation.and_then(|evaluation| cell::columns(evaluation, Poses::OnGrid)[1]) {
        Some(row) => {
            let what =
                format!("of connectors named by one touch ({}); the paper: 83.3\u{a0}%", interval(row.accuracy_ci95));
            tile(percent_sign(row.accuracy), what)
        }
        None => tile(NOT_RUN, "connectors named by one touch; the paper: 83.3\u{a0}%"),
    }
}

fn assembly_tile(found: &Reproduction) -> Markup {
    let Some(assembly) = &found.assembly else { return tile(NOT_RUN, "assembly of M, L, T and F; aim: 95\u{a0}%") };
    let share = assembly.all_inserted;
    let what = format!(
        "of assemblies with every peg in its hole ({}; aim: 95\u{a0}%), median {} touches a hole (aim: 4)",
        interval(share.ci95),
        number(assembly.holes.touches_median, 0)
    );
    tile(percent_sign(share.share), what)
}

fn speed_tile(found: &Reproduction) -> Markup {
    match found.tradeoff.as_ref().and_then(tradeoff::verdict) {
        Some(verdict) => {
            let times = number(verdict.best.decision_ms_p50 / verdict.fast.decision_ms_p50, 1);
            let what = format!(
                "a decision of the fastest setting within 2 points of the best, {times} times as fast (aim: 5); the paper: about \
                 600\u{a0}ms on a GPU"
            );
            tile(milliseconds(verdict.fast.decision_ms_p50), what)
        }
        None => tile(NOT_RUN, "speed against accuracy; the paper: about 600\u{a0}ms a decision on a GPU"),
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use crate::assembly::example;

    fn some() -> Reproduction {
        let small = evaluation("alphabet-small", 0.5, &[(1, 0.5), (3, 0.95), (5, 0.91), (10, 0.8)]);
        let hard = evaluation("alphabet-small-hard", 0.3, &[(3, 0.75), (5, 0.7), (10, 0.95)]);
        Reproduction { assembly: Some(example()), ..of(&[("small", small), ("small-hard", hard)]) }
    }

    #[test]
    fn the_first_screen_says_what_is_simulated_and_what_fell_short() {
        let html = html(&some());
        let top = &html[..html.find(r#"<nav class="contents""#).unwrap()];
        assert!(top.contains("Our boards are simulated") && top.contains("no real hole, peg or letter was touched"));
        // Better at 3 touches, equal at 5, worse at 10.
        assert!(
            top.contains("<b>1 of 3</b>") && top.contains("(Table II not run)") && top.contains("<b>50.0\u{a0}%</b>")
        );
        assert_eq!(top.matches("<b>not run</b>").count(), 2, "connectors and speed");
    }

    #[test]
    fn each_section_is_there_whether_it_was_run_or_not() {
        let (html, lines) = (html(&some()), summary(&some()));
        assert_eq!((html.matches("<section id=").count(), lines.len()), (13, 13));
        let n_missing = lines.iter().filter(|line| line.ends_with("not run")).count();
        // Tables II and III, classes, informed, sensors, unknown parts, speed.
        assert_eq!(n_missing, 7, "{lines:#?}");
        assert!(html.contains(r##"href="#every-step""##) && html.contains(r#"id="every-step""#));
    }

    #[test]
    fn the_page_needs_nothing_else() {
        let html = html(&some());
        for outside in ["http:", "https:", "<script ", "<link", "@import", "import(", "fetch(", "src="] {
            assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
        }
    }
}
