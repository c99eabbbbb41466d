//! The page of a trade-off: the frontier in planes of a cost and a share, what each knob buys, every point.

use std::cmp::{Ordering, Reverse};

use maud::{Markup, html};
use tactile_filter::Settings;
use tactile_filter::budget::{Point, Setup, Tradeoff};

use super::knobs::{KNOBS, in_words, knobs};
use super::risk;
use crate::page::numbers::{interval, milliseconds, number, over, percent, percent_sign, seeds, touch_count};
use crate::page::scatter::{Dot, Scatter};
use crate::page::shell::{Section, definitions, figure, page, tile};
use crate::page::table::{cells, sortable};

/// What a trade-off comes to in figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict<'a> {
    /// The most accurate point; of equals the fastest.
    pub best: &'a Point,
    /// The fastest of at most two points less than `best`, after as many touches or fewer.
    pub fast: &'a Point,
    /// The one with which most episodes end sure and right, at the usual rate of strangers where that was measured; of equals the most
    /// accurate, then the fastest.
    pub surest: &'a Point,
    /// Distinct settings.
    pub n_settings: usize,
    /// Points that none dominates.
    pub n_frontier: usize,
    /// Longest by shortest time of a decision on the frontier.
    pub span: f64,
}

/// Works out the verdict; `None` for no points.
pub fn verdict(tradeoff: &Tradeoff) -> Option<Verdict<'_>> {
    let points = &tradeoff.points;
    let faster = |a: &&Point, b: &&Point| a.decision_ms_p50.total_cmp(&b.decision_ms_p50);
    let highest = points.iter().map(|p| p.accuracy).fold(f64::NEG_INFINITY, f64::max);
    let best = points.iter().filter(|p| p.accuracy == highest).min_by(faster)?;
    let fast = points.iter().filter(|p| p.accuracy >= highest - 0.02).min_by(faster)?;
    let decided =
        |p: &Point| (p.halves.together().decided_and_right(), p.accuracy, -p.decision_ms_p50, Reverse(p.n_touches));
    let surest = |a: &&Point, b: &&Point| decided(a).partial_cmp(&decided(b)).unwrap_or(Ordering::Equal);
    let is_usual = |p: &&Point| p.settings.false_accept == Settings::default().false_accept;
    let mut settings: Vec<&Setup> = Vec::new();
    for point in points {
        if !settings.contains(&&point.settings) {
            settings.push(&point.settings);
        }
    }
    let kept = || points.iter().filter(|p| !p.dominated).map(|p| p.decision_ms_p50);
    Some(Verdict {
        best,
        fast,
        surest: points.iter().filter(is_usual).max_by(surest).or_else(|| points.iter().max_by(surest))?,
        n_settings: settings.len(),
        n_frontier: kept().count(),
        span: kept().fold(0.0, f64::max) / kept().fold(f64::INFINITY, f64::min),
    })
}

/// The whole page.
pub fn html(tradeoff: &Tradeoff) -> String {
    let Tradeoff { scene, n_episodes, command, .. } = tradeoff;
    let top = html! {
        h1 { "Speed against accuracy: " (scene) }
        (about(tradeoff))
        div.tiles { @if let Some(verdict) = verdict(tradeoff) { (tiles(&verdict)) } }
    };
    let how =
        [("Command", html! { code { (command) } }), ("Episodes", html! { (n_episodes) ", " (seeds(&tradeoff.seeds)) })];
    let sections = [
        Section::new("Frontier", "What can be had for what", planes(tradeoff)),
        Section::new("Knobs", "Which knob buys most", knobs(tradeoff)),
        Section::new("Risk", "What a lower rate of strangers costs", risk::tables(tradeoff)),
        Section::new("Points", "Every setting measured", every_point(tradeoff)),
        Section::new("How", "How it was made", definitions(&how)),
    ];
    page(&format!("Tactile-Filter: speed against accuracy, {scene}"), &top, &sections)
}

/// What was run on what, and what that says of other parts and sensors.
fn about(tradeoff: &Tradeoff) -> Markup {
    let Tradeoff { n_episodes, n_classes, machine, speeds, .. } = tradeoff;
    let is_anywhere = tradeoff.poses == "off-grid";
    html! {
        p {
            "Every setting was run on the same " (n_episodes)
            @if tradeoff.recorded {
                " episodes with recorded holes of " (n_classes) " parts, "
                @if is_anywhere { "whose touches may lie between the bank’s poses" } @else { "touched at the bank’s poses" }
            } @else {
                " simulated holes of " (n_classes) " parts, "
                @if is_anywhere { "touched anywhere, at any angle" } @else { "touched at recorded poses" }
            }
            ", and its decisions were timed on one core (" (machine) "). A decision is to see (encode), to update the belief and to "
            "choose the next touch. " b { "Robot seconds" } " are those of the touches and of the ways between them (" (speeds.touch_s)
            " s a touch, " (speeds.mm_s) " mm/s), until the stopping rule ends an episode or its touches are used up. "
            " An episode is " b { "decided and right" } " if the stopping rule ended it as confident by then and its part was "
            "right. Half of the parts choose among the settings; what a budget promises is what the other half found."
            @if !tradeoff.recorded {
                " Where the scene is one of letters for tuning, what is chosen here says nothing in advance about the letters of "
                "the evaluation."
            }
        }
        @if tradeoff.recorded {
            p.caution {
                b { "The touches are recorded:" } " banks are made of recorded pegs, with no finer steps than these were touched at; "
                "the filter chooses among the holes’ recorded touches, each at most once. The 95 % intervals cover which of the "
                "touches an episode draws, not other sensors, parts or prints: episodes share their touches, so that many of them "
                "say little more than the recording holds."
            }
        }
    }
}

/// The verdict as tiles.
pub(crate) fn tiles(verdict: &Verdict<'_>) -> Markup {
    let Verdict { best, fast, surest, n_settings, n_frontier, span } = verdict;
    let ms = |point: &Point| milliseconds(point.decision_ms_p50);
    let faster = number(best.decision_ms_p50 / fast.decision_ms_p50, 1);
    html! {
        (tile(percent_sign(best.accuracy), html! { "the best: " (ms(best)) " a decision, " (touch_count(best.n_touches)) }))
        (tile(ms(fast), html! {
            "the fastest within 2 points of it: " (percent_sign(fast.accuracy)) " after " (touch_count(fast.n_touches)) ", "
            (faster) " times as fast"
        }))
        (tile(percent_sign(surest.halves.together().decided_and_right()), html! {
            "of the episodes end sure and right, the most: within " (touch_count(surest.n_touches)) ", " (ms(surest)) " a decision"
        }))
        (tile(n_settings, "settings measured"))
        (tile(n_frontier, html! { "points on the frontier, whose decisions span a factor of " (number(*span, 0)) }))
    }
}

/// Accuracy against time, touches and memory; and where they were counted, decisions against time and touches.
pub(crate) fn planes(tradeoff: &Tradeoff) -> Markup {
    const TIME: (&str, bool, fn(&Point) -> f64) = ("milliseconds a decision", true, |p| p.decision_ms_p50);
    let right = |p: &Point| 100.0 * p.accuracy;
    let decided = |p: &Point| 100.0 * p.halves.together().decided_and_right();
    let speeds = tradeoff.speeds;
    let seconds = |p: &Point| p.halves.together().seconds(&speeds);
    let planes = html! {
        div.planes {
            (plane(tradeoff, "Right part, %, against time", TIME, right))
            (plane(tradeoff, "Right part, %, against touches", ("touches", false, |p: &Point| p.n_touches as f64), right))
            (plane(tradeoff, "Right part, %, against memory", ("megabytes an episode holds", true, |p: &Point| p.memory_mb), right))
            (plane(tradeoff, "Decided and right, %, against time", TIME, decided))
            (plane(tradeoff, "Decided and right, %, against robot seconds", ("robot seconds an episode, mean", false, seconds), decided))
        }
    };
    figure(
        planes,
        "A dot is a setting after a number of touches; point at one to read what it is. Blue: nothing else that names strangers as \
        rarely decides as much, is as fast and takes as few robot seconds for each hole that it decides. Grey: something else is. \
        The line is the best that can be had for the cost on the axis, at any other cost.",
    )
}

/// One plane: a cost (name and unit, whether its axis is logarithmic, value) against a share in per cent.
fn plane(
    tradeoff: &Tradeoff,
    title: &str,
    (x_axis, log_x, x): (&str, bool, impl Fn(&Point) -> f64),
    y: impl Fn(&Point) -> f64,
) -> Markup {
    let dot = |point: &Point| Dot {
        x: x(point),
        y: y(point),
        class: if point.dominated { "dominated" } else { "kept" },
        label: [
            in_words(&point.settings) + ": " + &percent_sign(y(point) / 100.0),
            touch_count(point.n_touches),
            milliseconds(point.decision_ms_p50),
            format!("{}\u{a0}MB", number(point.memory_mb, 1)),
        ]
        .join(", "),
    };
    let (under, over): (Vec<&Point>, Vec<&Point>) = tradeoff.points.iter().partition(|p| p.dominated);
    let dots: Vec<Dot> = under.into_iter().chain(over).map(dot).collect();
    let steps = staircase(tradeoff.points.iter().map(|p| [x(p), y(p)]).collect());
    let lowest = tradeoff.points.iter().map(y).fold(100.0, f64::min);
    let y_range = [(lowest / 20.0).floor().min(4.0) * 20.0, 100.0];
    html! { div { p { (title) } (Scatter { title, x_axis, log_x, y_range, dots: &dots, steps: &steps }.svg()) } }
}

/// The points that no other beats in both coordinates, from left to right.
fn staircase(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(b[1].total_cmp(&a[1])));
    let mut best = f64::NEG_INFINITY;
    points.retain(|[_, y]| {
        let rises = *y > best;
        best = best.max(*y);
        rises
    });
    points
}

fn every_point(tradeoff: &Tradeoff) -> Markup {
    let row = |point: &Point| {
        let mut row: Vec<Markup> = KNOBS.map(|knob| html! { (point.settings.tell(knob)) }).into();
        row.extend(cells![
            point.n_touches,
            over(percent(point.accuracy), interval(point.accuracy_ci95)),
            percent(point.halves.together().decided_and_right()),
            number(point.halves.together().seconds(&tradeoff.speeds), 1),
            percent(point.strangers.map_or(f64::NAN, |of| of.n_named as f64 / of.n_episodes as f64)),
            number(point.xy_mm_mean, 2),
            number(point.theta_deg_mean, 1),
            over(number(point.decision_ms_p50, 2), number(point.decision_ms_p99, 2)),
            number(point.memory_mb, 1),
            if point.dominated { "" } else { "yes" },
        ]);
        row
    };
    let rows: Vec<_> = tradeoff.points.iter().map(row).collect();
    let of_settings = ["Model", "Bank", "Rows", "Inference", "States", "Rule", "Effort", "Maps", "Strangers asked for"];
    let heads = [
        "Touches",
        "Right, %",
        "Decided and right, %",
        "Robot seconds",
        "Strangers named, %",
        "mm",
        "degrees",
        "ms, half (99 %)",
        "MB",
        "Frontier",
    ];
    html! {
        details { summary { (rows.len()) " points, sortable" } (sortable(&[&of_settings[..], &heads].concat(), &rows)) }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use tactile_filter::belief::EngineConfig;
    use tactile_filter::budget::{Half, Halves, SCHEMA, Speeds};
    use tactile_filter::choice::ActionRule;
    use tactile_infer::embedding::precision::Precision;

    /// The default settings of the filter.
    pub(crate) fn settings() -> Setup {
        Setup {
            model: "small".into(),
            model_sha256: "ab".into(),
            xy_step_mm: 2.0,
            theta_step_deg: 15.0,
            rows: Precision::F32,
            engine: EngineConfig::Exact,
            subdivisions: 2,
            rule: ActionRule::Information,
            n_draws: 160,
            n_suppositions: 24,
            n_finalists: Some(24),
            verify: None,
            false_accept: Some(0.01),
        }
    }

    /// Halves of 100 episodes each of which so many named the right part, half of these sure of it.
    pub(crate) fn halves(accuracy: f64, n_touches: usize) -> Halves {
        let n_right = (100.0 * accuracy).round() as usize;
        let n_decided = n_right / 2;
        let half = Half {
            n_episodes: 100,
            n_right,
            n_decided,
            n_decided_and_right: n_decided,
            touches: 100 * n_touches,
            travel_mm: 0.0,
        };
        Halves { choosing: half, promising: half }
    }

    fn point(change: impl Fn(&mut Setup), n_touches: usize, accuracy: f64, ms: f64) -> Point {
        let mut settings = settings();
        change(&mut settings);
        Point {
            settings,
            n_touches,
            accuracy,
            accuracy_ci95: [0.25, 1.0],
            halves: halves(accuracy, n_touches),
            strangers: None,
            xy_mm_mean: 0.5,
            theta_deg_mean: 2.0,
            decision_ms_p50: ms,
            decision_ms_p99: 2.0 * ms,
            pace_ms: ms,
            memory_mb: 10.0,
            dominated: false,
        }
    }

    /// Five settings, one of them after two numbers of touches.
    pub(crate) fn tradeoff() -> Tradeoff {
        let points = vec![
            point(|_| (), 3, 0.90, 4.0),
            point(|s| s.n_draws = 8, 3, 0.70, 1.0),
            point(|s| s.xy_step_mm = 1.0, 3, 0.92, 40.0),
            point(|s| (s.xy_step_mm, s.n_draws) = (1.0, 8), 3, 0.60, 9.0),
            point(|s| s.subdivisions = 1, 3, 0.91, 2.0),
            point(|s| s.subdivisions = 1, 1, 0.50, 2.0),
        ];
        let mut tradeoff = Tradeoff {
            schema: SCHEMA.into(),
            scene: "a<b".into(),
            recorded: false,
            poses: "off-grid".into(),
            n_classes: 12,
            n_episodes: 100,
            seeds: vec![1, 2],
            machine: "two cores".into(),
            command: "tactile-filter tradeoff".into(),
            speeds: Speeds::default(),
            points,
        };
        tradeoff.mark_dominated();
        tradeoff
    }

    #[test]
    fn the_verdict_names_the_best_and_the_fastest_near_it() {
        let tradeoff = tradeoff();
        let verdict = verdict(&tradeoff).unwrap();
        assert_eq!((verdict.best.accuracy, verdict.fast.accuracy), (0.92, 0.91));
        // On the frontier: 4 draws fewer, finer steps, fewer states (twice).
        assert_eq!((verdict.n_settings, verdict.n_frontier, verdict.span), (5, 4, 40.0));
    }

    #[test]
    fn a_staircase_only_rises() {
        let steps = staircase(vec![[3.0, 5.0], [1.0, 2.0], [2.0, 1.0], [4.0, 5.0], [1.0, 1.0]]);
        assert_eq!(steps, [[1.0, 2.0], [3.0, 5.0]]);
    }

    #[test]
    fn the_page_shows_every_point_and_needs_nothing_else() {
        let html = html(&tradeoff());
        assert!(html.contains("a&lt;b") && !html.contains("a<b"));
        assert_eq!(html.matches("<circle").count(), 5 * 6);
        assert!(!html.replace("http://www.w3.org/2000/svg", "").contains("http"));
        assert!(html.contains("Most is bought by bank of 1 mm, 15° (+2.0 points, 10.0 times as long)"));
    }

    #[test]
    fn the_surest_is_the_one_that_decides_most() {
        let mut counted = tradeoff();
        for (n, point) in counted.points.iter_mut().enumerate() {
            let half =
                |n_right| Half { n_episodes: 50, touches: 150, n_decided_and_right: n_right, ..point.halves.choosing };
            point.halves = Halves { choosing: half(40 - n), promising: half(20 + 3 * n) };
        }
        // 60, 62, 64, ... of 100; three touches each, 9 s.
        assert_eq!(verdict(&counted).unwrap().surest.n_touches, 1);
        let page = html(&counted);
        assert!(page.contains("70.0\u{a0}%") && page.contains("Decided and right, %, against robot seconds"));
        assert!(page.contains(">9.0<") && page.contains("3 s a touch, 50 mm/s"));
    }

    #[test]
    fn the_page_says_whether_touches_are_recorded() {
        let simulated = tradeoff();
        let recorded = Tradeoff { recorded: true, ..simulated.clone() };
        let [of_simulated, of_recorded] = [&simulated, &recorded].map(html);
        assert!(of_simulated.contains("100 simulated holes of 12 parts, touched anywhere"));
        assert!(!of_simulated.contains("The touches are recorded:"));
        assert!(of_recorded.contains("The touches are recorded:") && !of_recorded.contains("simulated"));
        // What was published of simulated scenes stays as it is.
        let [a, b] = [&simulated, &recorded].map(|tradeoff| serde_json::to_value(tradeoff).unwrap());
        assert_eq!((a.get("recorded"), b.get("recorded")), (None, Some(&true.into())));
        assert_eq!(serde_json::from_value::<Tradeoff>(b).unwrap(), recorded);
    }
}
