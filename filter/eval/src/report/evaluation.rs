//! The page of an evaluation: key figures, curves, what the other modules of the report show, episodes, how it was made.

use std::path::Path;

use maud::{Markup, html};

use super::cover::cover;
use super::series::{Series, leading_filter, leading_stops, series, way};
use super::steps::steps;
use super::{PaperNumbers, PaperRow, comparison, parts, reliability, stopping, strangers};
use crate::error::Result;
use crate::narrative::{Board, Narrative, viewer};
use crate::page::curves::{Line, Marker, Point, chart, entry};
use crate::page::model::model_entries;
use crate::page::numbers::{interval, mean, milliseconds, number, percent, percent_sign, seeds, share, touch_count};
use crate::page::shell::{Section, definitions, figure, page, tile, write_page};
use crate::page::table::{cells, sortable};
use crate::result::{Evaluation, Method, Poses, Row};

/// The columns of the first table: the numbers of touches that the paper reports.
const TOUCHES: [usize; 4] = [1, 3, 5, 10];

/// The kinds of poses, and what they are called.
const KINDS: [(Poses, &str); 2] = [(Poses::OnGrid, "on grid"), (Poses::OffGrid, "off grid")];

/// Writes the report of an evaluation with some of its episodes, whole or not at all.
///
/// # Errors
/// As [`html()`], and a file at `path` that is no page of this program, or cannot be written.
pub fn write_report(path: &Path, evaluation: &Evaluation, board: &Board, episodes: &[Narrative]) -> Result<()> {
    write_page(path, &html(evaluation, board, episodes)?)
}

/// The whole page, with the paper's numbers where they are comparable.
///
/// # Errors
/// An episode that does not fit the board, or a frame that cannot be drawn.
pub fn html(evaluation: &Evaluation, board: &Board, episodes: &[Narrative]) -> Result<String> {
    let paper = &PaperNumbers::of(evaluation);
    let mut sections = Vec::new();
    // Without their parts in the bank, nothing is right and no pose is true.
    if evaluation.absent {
        sections.push(stopping::section(evaluation));
        sections.extend(strangers::section(evaluation));
    } else {
        let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter);
        let lead = lead.map_or(String::new(), |row| way(row.inference, row.action));
        sections.extend([against_paper(evaluation, paper), curves(evaluation, paper)]);
        sections.extend(comparison::section(evaluation));
        sections.extend(reliability::section(evaluation, &lead));
        sections.push(stopping::section(evaluation));
        sections.extend(parts::section(evaluation, &lead));
    }
    sections.push(stopping::speed(evaluation));
    sections.extend(viewer::section(["Episodes", "Episodes, touch by touch"], board, episodes)?);
    sections.push(how_made(evaluation));
    Ok(page(&format!("Tactile-Filter: {}", evaluation.scene), &top(evaluation, paper), &sections))
}

fn top(evaluation: &Evaluation, paper: &PaperNumbers) -> Markup {
    let Evaluation { scene, n_classes, n_episodes, side, .. } = evaluation;
    html! {
        h1 { @if side.is_hole() { "Which peg fits this hole? " } @else { "Which peg is this? " } (scene) }
        p {
            @if evaluation.recorded { "The filter chooses among recorded touches of " } @else { "A simulated tactile sensor touches " }
            "the " (side) " of one of " (n_classes) " parts, whose pegs were touched before. "
            @if evaluation.absent {
                "Here each " (side) "’s own part was taken out of the bank: no part is right, and the filter should say “none of these parts”."
            } @else {
                "Touch by touch the filter works out which part it is, and where on it the sensor is."
            }
            " " (n_episodes) " episodes, " (seeds(&evaluation.seeds)) "."
            @if !evaluation.views.is_pegs() {
                " The bank knows more than the paper’s: its scene says what the holes look like, and each view is of a peg and of its \
                 hole, simulated by the same simulator that makes the touches here."
            }
        }
        @if evaluation.recorded {
            p.caution {
                b { "The touches are recorded:" } " the filter chooses the next among those that the recording holds, each at most once, "
                "and is told the motion between their stated poses. How good these poses are, and what was recorded by which sensor, "
                "is not known here. "
                @if !evaluation.recorded_parts.is_empty() {
                    "Recorded, and touched, are " (evaluation.recorded_parts.len()) " parts of the bank: "
                    (evaluation.recorded_parts.join(", ")) ". "
                }
                (cover(evaluation))
            }
        } @else { p.caution {
            b { "All of it is simulated:" } " the boards, the robot, each touch. What was compared with reality is the sensor’s "
            "optics and gel, by real images of a ball, grooves, a cuboid and a digit (" code { "cargo xtask validate" } "). No real "
            "hole, peg or letter was touched: how these figures carry over to a real board is not known. " (cover(evaluation))
        } }
        div.tiles { @if evaluation.absent { (absent_tiles(evaluation)) } @else { (tiles(evaluation, paper)) } }
    }
}

/// The key figures: accuracy, wrong answers, pose, time.
fn tiles(evaluation: &Evaluation, paper: &PaperNumbers) -> Markup {
    let found = KINDS.iter().find_map(|(poses, name)| Some((leading_filter(evaluation, *poses)?, *name)));
    let last = found.as_ref().and_then(|(series, _)| series.at(10).or(series.rows.last().copied()));
    html! {
        @if let Some((series, poses)) = &found {
            @for row in TOUCHES[1..].iter().filter_map(|n| series.at(*n)) {
                (tile(percent_sign(row.accuracy), html! {
                    "right part after " (touch_count(row.n_touches)) ", " (poses)
                    @if let Some(paper) = paper.at(row.n_touches) { "; the paper: " (percent_sign(paper.accuracy_percent / 100.0)) }
                }))
            }
        }
        @match leading_stops(evaluation) {
            Some(stops) => (tile(percent_sign(stops.confident_and_wrong), "of confident stops name a wrong part")),
            None => (tile(percent_sign(evaluation.stopping.confident_and_wrong), "of episodes stop sure of a wrong part")),
        }
        @if let Some(row) = last { (pose_tile(row)) }
        (decision_time(evaluation))
    }
}

fn pose_tile(row: &Row) -> Markup {
    let (what, [mm, deg]) = match (row.xy_mm_median, row.theta_deg_median) {
        (Some(mm), Some(deg)) => ("median", [mm, deg]),
        _ => ("mean", [row.xy_mm_mean, row.theta_deg_mean]),
    };
    let what = format!("{what} error of the pose after {}, where the part is right", touch_count(row.n_touches));
    tile(format!("{} mm · {}°", number(mm, 2), number(deg, 1)), what)
}

/// The key figures where no part is right: how often that is seen.
fn absent_tiles(evaluation: &Evaluation) -> Markup {
    html! {
        @if let Some(stops) = leading_stops(evaluation) {
            (tile(percent_sign(stops.none_of_these), "of episodes rightly stop with “none of these parts”"))
            (tile(percent_sign(stops.confident), "of episodes stop sure of a part, each of them wrong"))
            (tile(number(stops.mean_touches, 1), "touches until it stops, on average"))
        }
        (decision_time(evaluation))
    }
}

fn decision_time(evaluation: &Evaluation) -> Markup {
    let latency = &evaluation.latency_ms;
    let judge = latency.judge.map_or(0.0, |judge| judge.p50);
    let decision_ms = latency.encode.p50 + latency.update.p50 + judge + latency.select.p50;
    tile(milliseconds(decision_ms), "per touch: see, update, judge, choose the next (sum of medians)")
}

/// The filter and the baselines next to the paper at the paper's numbers of touches.
fn against_paper(evaluation: &Evaluation, paper: &PaperNumbers) -> Section {
    let ours: Vec<(Series<'_>, &str)> =
        KINDS.iter().filter_map(|(poses, name)| Some((leading_filter(evaluation, *poses)?, *name))).collect();
    let filters = |cell: &dyn Fn(&Row) -> Markup| {
        html! {
            @for (series, name) in &ours {
                (table_row("ours", &format!("This filter, {name}"), |n| series.at(n).map(cell)))
            }
        }
    };
    let papers = |label: &str, value: &dyn Fn(usize) -> Option<f64>| {
        let is_known = TOUCHES.iter().any(|n| value(*n).is_some());
        html! { @if is_known { (table_row("", label, |n| value(n).map(|value| html! { (number(value, 1)) }))) } }
    };
    let baselines: Vec<_> =
        series(evaluation, Poses::OnGrid).into_iter().filter(|series| series.method != Method::Filter).collect();
    let table = html! {
        div.scroll { table {
            thead { tr { th { "Touches" } @for n in TOUCHES { th { (n) } } } }
            tbody {
                (group("Right part, % (95 % interval; parts: of other parts and prints, too)"))
                (filters(&accuracy))
                (papers("The paper (one touch: its MoCo)", &|n| paper.at(n).map(|row| row.accuracy_percent)))
                @for series in &baselines { (table_row("", &series.label(), |n| series.at(n).map(accuracy))) }
                (papers("The paper’s Pixel", &|n| paper.pixel.filter(|_| n == 1).map(|row| row.accuracy_percent)))
                (group("Mean error of the place, mm"))
                (filters(&|row| mean(row.xy_mm_mean, row.xy_mm_median, 2)))
                (papers("The paper", &|n| paper.at(n)?.xy_mm))
                (group("Mean error of the angle, degrees"))
                (filters(&|row| mean(row.theta_deg_mean, row.theta_deg_median, 1)))
                (papers("The paper", &|n| paper.at(n)?.theta_deg))
            }
        } }
    };
    let ways: Vec<_> = ours.iter().map(|(series, name)| format!("{name}, {}", series.way())).collect();
    let caption = html! {
        "Read along a row how touches add up. "
        @if !ways.is_empty() { "This filter is the default: " (ways.join("; ")) ". " }
        @if paper.rows.is_empty() {
            "The paper has no numbers for this scene."
        } @else {
            "The paper’s numbers are from a real robot and printed boards, these are simulated: a yardstick, not a race."
        }
    };
    Section::new("Beside the paper", "Touch by touch, next to the paper", figure(table, caption))
}

/// A cell with right parts over both intervals.
fn accuracy(row: &Row) -> Markup {
    html! {
        (share(row.accuracy, row.accuracy_ci95))
        @if let Some(of_parts) = row.accuracy_ci95_clustered { small { "parts " (interval(of_parts)) } }
    }
}

fn group(title: &str) -> Markup {
    html! { tr.group { th colspan=(TOUCHES.len() + 1) { (title) } } }
}

fn table_row(class: &str, label: &str, cell: impl Fn(usize) -> Option<Markup>) -> Markup {
    html! { tr class=(class) { td { (label) } @for n in TOUCHES { td { @if let Some(cell) = cell(n) { (cell) } } } } }
}

fn curves(evaluation: &Evaluation, paper: &PaperNumbers) -> Section {
    let kinds: [(Poses, &str, &[PaperRow]); 2] = [
        (Poses::OnGrid, "Poses on the recorded grid, as in the paper", &paper.rows),
        (Poses::OffGrid, "Poses anywhere in the recorded range, at any angle", &[]),
    ];
    let kinds = kinds.map(|(poses, title, paper)| (series(evaluation, poses), title, paper));
    let body = html! {
        @for (series, title, paper) in kinds.iter().filter(|(series, ..)| !series.is_empty()) {
            (charts(series, title, paper))
        }
        (steps(evaluation))
        (all_rows(evaluation))
    };
    Section::new("Accuracy", "Accuracy and error against touches", body)
}

/// The paper's curve of a value.
fn papers_line(paper: &[PaperRow], value: fn(&PaperRow) -> Option<f64>) -> Line {
    let point = |row: &PaperRow| {
        let value = value(row).unwrap_or(f64::NAN);
        Point { n_touches: row.n_touches, value, interval: None }
    };
    let points = paper.iter().map(point).collect();
    Line { label: "The paper".into(), class: "reference".into(), marker: Marker::Diamond, points }
}

fn charts(series: &[Series], title: &str, paper: &[PaperRow]) -> Markup {
    let right = |row: &Row| (100.0 * row.accuracy, Some(row.accuracy_ci95.map(|bound| 100.0 * bound)));
    let accuracy: Vec<Line> = series.iter().map(|series| series.line(right)).collect();
    // Pixel names few parts right, and its errors would press all others flat.
    let errors = |value: fn(&Row) -> Option<f64>| -> Vec<Line> {
        let shown = series.iter().filter(|series| series.method != Method::Pixel);
        shown.map(|series| series.line(|row| (value(row).unwrap_or(f64::NAN), None))).collect()
    };
    let with_paper = |mut lines: Vec<Line>, value| {
        lines.push(papers_line(paper, value));
        lines
    };
    let accuracy = with_paper(accuracy, |row| Some(row.accuracy_percent));
    let means = [
        ("Right part, %", accuracy, Some([0.0, 100.0])),
        ("Place: mean error, mm", with_paper(errors(|row| Some(row.xy_mm_mean)), |row| row.xy_mm), None),
        ("Angle: mean error, degrees", with_paper(errors(|row| Some(row.theta_deg_mean)), |row| row.theta_deg), None),
    ];
    let has_medians = series.iter().flat_map(|series| &series.rows).any(|row| row.xy_mm_median.is_some());
    let medians = [
        ("Place: median error, mm", errors(|row| row.xy_mm_median)),
        ("Angle: median error, degrees", errors(|row| row.theta_deg_median)),
    ];
    let content = html! {
        h4 { (title) }
        div.charts {
            @for (name, lines, range) in &means { div { p { (name) } (chart(name, lines, *range)) } }
            ul.legend {
                @for series in series {
                    @let (class, marker) = series.class_and_marker();
                    (entry(&class, marker, series.rows.len() > 1, series.label()))
                }
                @if !paper.is_empty() { (entry("reference", Marker::Diamond, false, "The paper, real boards")) }
            }
            @for (name, lines) in medians.iter().filter(|_| has_medians) { div { p { (name) } (chart(name, lines, None)) } }
        }
    };
    figure(
        content,
        "Right parts: higher is better; bands and bars are 95 % intervals. Errors: lower is better; they are those of \
        the episodes that name the right part: a mean far above its median is made by few episodes that are far off. Pixel is left \
        out there. Pixel and MoCo: the part of the most similar recorded picture or embedding. “Particles, the paper’s action \
        rule” of the engine “paper” is Alg. 1 as printed, at a temperature of its own (0.08 unless the command says another), not \
        at the one that was measured of this model for the other filters. The stopping rule is off, so that every episode counts \
        at every number of touches.",
    )
}

fn how_made(evaluation: &Evaluation) -> Section {
    let command = evaluation.command.iter().map(|line| ("Command", html! { code { (line) } }));
    let episodes = html! { (evaluation.n_episodes) " of " (evaluation.scene) ", " (seeds(&evaluation.seeds)) };
    let entries: Vec<_> = command.chain(model_entries(&evaluation.model)).chain([("Episodes", episodes)]).collect();
    Section::new("How it was made", "How it was made", definitions(&entries))
}

fn all_rows(evaluation: &Evaluation) -> Markup {
    let row = |label: &str, poses: &str, row: &Row| {
        let median = |value: Option<f64>, decimals| number(value.unwrap_or(f64::NAN), decimals);
        cells![
            label,
            poses,
            row.n_touches,
            percent(row.accuracy),
            interval(row.accuracy_ci95),
            row.accuracy_ci95_clustered.map_or("–".into(), interval),
            percent(row.exact_cell),
            number(row.xy_mm_mean, 2),
            median(row.xy_mm_median, 2),
            number(row.theta_deg_mean, 1),
            median(row.theta_deg_median, 1),
            number(row.brier, 3),
        ]
    };
    let all = KINDS.iter().flat_map(|(poses, name)| series(evaluation, *poses).into_iter().map(move |of| (of, *name)));
    let rows: Vec<_> = all
        .flat_map(|(series, name)| series.rows.iter().map(|of| row(&series.label(), name, of)).collect::<Vec<_>>())
        .collect();
    let heads = [
        "Way",
        "Poses",
        "Touches",
        "Right, %",
        "95 %",
        "95 %, parts",
        "Right cell, %",
        "mm, mean",
        "median",
        "degrees, mean",
        "median",
        "Brier",
    ];
    html! { details { summary { "All numbers" } (sortable(&heads, &rows)) } }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::narrative::tests::{board, episode};
    use crate::result::{self, Choice, Comparison, Inference, ReliabilityBin, Stops};

    fn published() -> Evaluation {
        serde_json::from_value(result::tests::published()).unwrap()
    }

    /// Two rules that stopped, were compared and were sometimes sure.
    fn whole() -> Evaluation {
        let (inference, action) = (Inference::Exact, Choice::Information);
        let stops = Stops {
            seconds: Some(12.5),
            inference,
            action,
            mean_touches: 3.5,
            confident: 0.75,
            confident_and_wrong: 0.015,
            none_of_these: 0.125,
            touches_to_95: 3.75,
        };
        let comparison = |n_touches| Comparison {
            inference,
            action,
            against: Choice::Random,
            n_touches,
            difference: 0.25,
            ci95: [0.125, 0.375],
            paired: None,
        };
        let (probability, right_ci95) = ([0.99, 1.0], [0.95, 0.995]);
        let bin =
            ReliabilityBin { probability, mean_probability: 0.998, right: 0.98, right_ci95, n: 300, n_episodes: None };
        let mut evaluation = published();
        evaluation.stops = vec![stops, Stops { action: Choice::Random, ..stops }];
        evaluation.comparisons = (1..=3).map(comparison).collect();
        evaluation.reliability = vec![bin];
        evaluation.rows[0].xy_mm_median = Some(0.0625);
        evaluation.rows[0].theta_deg_median = Some(0.375);
        evaluation
    }

    fn shown(evaluation: &Evaluation) -> String {
        html(evaluation, &board(), &[]).unwrap()
    }

    #[test]
    fn the_report_is_written_whole_with_its_episodes() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        write_report(&path, &whole(), &board(), &[episode()]).unwrap();
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1, "no other file is left in the folder");
        let html = std::fs::read_to_string(&path).unwrap();
        assert!(html.contains("Episodes, touch by touch") && !shown(&whole()).contains("Episodes, touch by touch"));
        for outside in ["http:", "https:", "<link", "src=\"/"] {
            assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside), "{outside}");
        }
    }

    #[test]
    fn the_measured_and_the_papers_numbers_are_in_the_page() {
        let html = shown(&whole());
        assert!(html.contains("90.0") && html.contains("87.0–92.0"), "accuracy at three touches and its interval");
        assert!(html.contains("81.8"), "the paper's accuracy at three touches");
    }

    #[test]
    fn the_key_figures_are_on_top() {
        let html = shown(&whole());
        let tiles = &html[html.find(r#"<div class="tiles">"#).unwrap()..html.find("<figure>").unwrap()];
        // Encoding 5, updating 0.5 and choosing 3 ms: 8.5.
        for figure in ["90.0\u{a0}%", "1.5\u{a0}%", "0.06 mm · 0.4°", "8.50\u{a0}ms"] {
            assert!(tiles.contains(&format!("<b>{figure}</b>")), "{figure} in {tiles}");
        }
    }

    #[test]
    fn a_mean_comes_with_its_median() {
        let html = shown(&whole());
        assert!(html.contains("0.20<small>median 0.06</small>") && html.contains("0.9<small>median 0.4</small>"));
        let without = shown(&published());
        assert!(without.contains("<td>0.20</td>") && !without.contains("<small>median"));
    }

    #[test]
    fn an_older_evaluation_is_shown_without_what_it_does_not_have() {
        let html = shown(&published());
        assert!(!html.contains("as often as it says") && !html.contains("Does choosing"));
        assert!(html.contains("after 2.5 touches on average"));
    }

    #[test]
    fn without_the_parts_in_the_bank_there_is_no_accuracy_to_show() {
        let html = shown(&Evaluation { absent: true, ..whole() });
        assert!(html.contains("taken out of the bank") && html.contains("<b>12.5\u{a0}%</b>"));
        for gone in ["Accuracy and error", "All numbers", "Does choosing", "as often as it says", "the paper: "] {
            assert!(!html.contains(gone), "{gone}");
        }
    }

    #[test]
    fn the_first_screen_says_what_is_simulated_and_what_intervals_cover() {
        let html = shown(&whole());
        let top = &html[..html.find(r#"<nav class="contents""#).unwrap()];
        assert!(top.contains("All of it is simulated") && top.contains("No real hole, peg or letter"));
        assert!(top.contains("one model and one simulated print"));
    }
}
