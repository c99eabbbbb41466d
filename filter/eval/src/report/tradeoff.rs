//! The page of a trade-off: the frontier in three planes, what each knob buys, every point.

use super::scatter::{Dot, Scatter};
use super::shell::{Section, shell};
use super::table::{SCRIPT, sortable};
use super::{escape, number};
use tactile_filter::budget::{Knob, Point, Settings, Tradeoff};

/// What is this page's own.
pub(crate) const STYLE: &str = ".planes { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 420px), 1fr)); gap: 8px 28px; }
.planes p { font-weight: 600; font-size: .9rem; margin: 10px 0 0; } .planes svg { display: block; width: 100%; height: auto; }
.dominated { color: var(--soft); } svg .dot.dominated { fill-opacity: .25; stroke: none; } .kept { color: var(--information); }
svg .line.frontier { stroke: var(--information); opacity: .5; } td.left, th.left { text-align: left; }
tr.dominated td { color: var(--soft); }";

/// The number of touches at which knobs are compared.
const COMPARED: usize = 3;

/// What a trade-off comes to in figures.
#[derive(Clone, Debug, PartialEq)]
pub struct Verdict<'a> {
    /// The most accurate point; of equals the fastest.
    pub best: &'a Point,
    /// The fastest of at most two points less than `best`, after as many touches or fewer.
    pub fast: &'a Point,
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
    let mut settings: Vec<&Settings> = Vec::new();
    for point in points {
        if !settings.contains(&&point.settings) {
            settings.push(&point.settings);
        }
    }
    let kept = || points.iter().filter(|p| !p.dominated).map(|p| p.decision_ms_p50);
    Some(Verdict {
        best,
        fast,
        n_settings: settings.len(),
        n_frontier: kept().count(),
        span: kept().fold(0.0, f64::max) / kept().fold(f64::INFINITY, f64::min),
    })
}

/// A knob turned alone, and what that did.
#[derive(Clone, Debug, PartialEq)]
pub struct Turn<'a> {
    /// The knob.
    pub knob: Knob,
    /// Before and after.
    pub points: [&'a Point; 2],
}

impl Turn<'_> {
    /// Accuracy gained, in points of a per cent.
    pub fn gain(&self) -> f64 {
        100.0 * (self.points[1].accuracy - self.points[0].accuracy)
    }

    /// How many times as long a decision takes.
    pub fn times(&self) -> f64 {
        self.points[1].decision_ms_p50 / self.points[0].decision_ms_p50
    }
}

/// From each of the three settings that most others differ from in one knob only, the fastest first: every such turn,
/// after three touches.
pub fn turns(tradeoff: &Tradeoff) -> Vec<Vec<Turn<'_>>> {
    let compared: Vec<&Point> = tradeoff.points.iter().filter(|p| p.n_touches == COMPARED).collect();
    let turn = |base: &'_ Point, other: &'_ Point| match base.settings.turned(&other.settings)[..] {
        [knob] => Some(knob),
        _ => None,
    };
    let from = |base: usize| -> Vec<Turn<'_>> {
        let alone = |other: &&'_ Point| turn(compared[base], other);
        let others = compared.iter().filter_map(|other| Some((alone(other)?, *other)));
        others.map(|(knob, other)| Turn { knob, points: [compared[base], other] }).collect()
    };
    let mut all: Vec<Vec<Turn<'_>>> = (0..compared.len()).map(from).filter(|turns| !turns.is_empty()).collect();
    all.sort_by_key(|turns| std::cmp::Reverse(turns.len()));
    all.truncate(3);
    all.sort_by(|a, b| a[0].points[0].decision_ms_p50.total_cmp(&b[0].points[0].decision_ms_p50));
    all
}

/// The whole page.
pub fn html(tradeoff: &Tradeoff) -> String {
    let scene = escape(&tradeoff.scene);
    let tiles = verdict(tradeoff).map_or(String::new(), |verdict| tiles(&verdict));
    let top = format!(
        r#"<h1>Speed against accuracy: {scene}</h1>
<p>Every setting was run on the same {} simulated holes of {} parts, {}, and its decisions were timed on one core ({}). A decision is
to see (encode), to update the belief and to choose the next touch; the robot’s motion is not counted. These are letters for tuning, so that
what is chosen here says nothing in advance about the letters of the evaluation.</p>
<div class="tiles">{tiles}</div>
"#,
        tradeoff.n_episodes,
        tradeoff.n_classes,
        if tradeoff.poses == "off-grid" { "touched anywhere, at any angle" } else { "touched at recorded poses" },
        escape(&tradeoff.machine),
    );
    let how = format!(
        r#"<dl><dt>Command</dt><dd><code>{}</code></dd><dt>Seeds</dt><dd>{}</dd></dl>"#,
        escape(&tradeoff.command),
        tradeoff.seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
    );
    let sections = [
        Section::new("Frontier", "What can be had for what", planes(tradeoff)),
        Section::new("Knobs", "Which knob buys most", knobs(tradeoff)),
        Section::new("Points", "Every setting measured", every_point(tradeoff)),
        Section::new("How", "How it was made", how),
    ];
    shell(&format!("Tactile-Filter: speed against accuracy, {}", tradeoff.scene), STYLE, &top, &sections, &[SCRIPT])
}

/// The verdict as tiles.
pub(crate) fn tiles(verdict: &Verdict<'_>) -> String {
    let Verdict { best, fast, n_settings, n_frontier, span } = verdict;
    let tile = |figure: String, what: String| format!(r#"<div class="tile"><b>{figure}</b>{what}</div>"#);
    let ms = |point: &Point| milliseconds(point.decision_ms_p50);
    [
        tile(percent(best.accuracy), format!("the best: {} a decision, {}", ms(best), touches(best.n_touches))),
        tile(
            ms(fast),
            format!(
                "the fastest within 2 points of it: {} after {}, {} times as fast",
                percent(fast.accuracy),
                touches(fast.n_touches),
                number(best.decision_ms_p50 / fast.decision_ms_p50, 1)
            ),
        ),
        tile(n_settings.to_string(), "settings measured".into()),
        tile(
            n_frontier.to_string(),
            format!("points on the frontier, whose decisions span a factor of {}", number(*span, 0)),
        ),
    ]
    .concat()
}

/// Accuracy against time, touches and memory.
pub(crate) fn planes(tradeoff: &Tradeoff) -> String {
    let plane = |title: &str, x_axis: &str, log_x: bool, x: fn(&Point) -> f64| {
        let dot = |point: &Point| Dot {
            x: x(point),
            y: 100.0 * point.accuracy,
            class: if point.dominated { "dominated" } else { "kept" }.into(),
            label: format!(
                "{}: {}, {}, {}, {}",
                told(&point.settings),
                percent(point.accuracy),
                touches(point.n_touches),
                milliseconds(point.decision_ms_p50),
                megabytes(point.memory_mb)
            ),
        };
        let (under, over): (Vec<&Point>, Vec<&Point>) = tradeoff.points.iter().partition(|p| p.dominated);
        let dots: Vec<Dot> = under.into_iter().chain(over).map(dot).collect();
        let steps = staircase(tradeoff.points.iter().map(|p| [x(p), 100.0 * p.accuracy]).collect());
        let lowest = tradeoff.points.iter().map(|p| 100.0 * p.accuracy).fold(100.0, f64::min);
        let y_range = [(lowest / 20.0).floor().min(4.0) * 20.0, 100.0];
        let svg = Scatter { title, x_axis, log_x, y_range, dots: &dots, steps: &steps }.svg();
        format!("<div><p>{title}</p>{svg}</div>")
    };
    let planes = [
        plane("Right part, %, against time", "milliseconds a decision", true, |p| p.decision_ms_p50),
        plane("Right part, %, against touches", "touches", false, |p| p.n_touches as f64),
        plane("Right part, %, against memory", "megabytes an episode holds", true, |p| p.memory_mb),
    ];
    format!(
        r#"<figure><div class="planes">{}</div><figcaption>A dot is a setting after a number of touches; point at one to read what it is. Blue: nothing
else is as accurate, as fast, as sparing of touches and of memory at once. Grey: something else is. The line is the best that can be had for
the cost on the axis, whatever the other costs.</figcaption></figure>"#,
        planes.concat()
    )
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

fn knobs(tradeoff: &Tradeoff) -> String {
    let tables: String = turns(tradeoff).iter().map(|turns| knob_table(turns)).collect();
    format!(
        "<p>After {}. A difference of less than two points is within what chance makes of {} episodes.</p>{tables}",
        touches(COMPARED),
        tradeoff.n_episodes
    )
}

fn knob_table(turns: &[Turn<'_>]) -> String {
    let Some(first) = turns.first() else { return String::new() };
    let base = first.points[0];
    let most = turns.iter().max_by(|a, b| a.gain().total_cmp(&b.gain()));
    let cheap = turns.iter().filter(|turn| turn.gain() >= -2.0).min_by(|a, b| a.times().total_cmp(&b.times()));
    let what = |turn: &Turn<'_>| escape(&turn.points[1].settings.tell(turn.knob));
    let buys = most.map_or(String::new(), |turn| {
        format!(
            "Most is bought by {} ({} points, {} times as long)",
            what(turn),
            signed(turn.gain()),
            number(turn.times(), 1)
        )
    });
    let saves = cheap.filter(|turn| turn.times() < 1.0).map_or(String::new(), |turn| {
        format!(
            "; most time is saved by {} ({} of it, {} points)",
            what(turn),
            number(turn.times(), 2),
            signed(turn.gain())
        )
    });
    let row = |turn: &Turn<'_>| {
        let [before, after] = turn.points;
        vec![
            escape(&after.settings.tell(turn.knob)),
            escape(&before.settings.tell(turn.knob)),
            signed(turn.gain()),
            number(turn.times(), 2),
            number(after.memory_mb / before.memory_mb, 2),
        ]
    };
    let rows: Vec<Vec<String>> = turns.iter().map(row).collect();
    format!(
        r#"<figure><h4>From {}: {}, {}</h4>{}<figcaption>{buys}{saves}.</figcaption></figure>"#,
        escape(&told(&base.settings)),
        percent(base.accuracy),
        milliseconds(base.decision_ms_p50),
        sortable(&["Turned to", "from", "Accuracy, points", "Time, times", "Memory, times"], &rows)
    )
}

fn every_point(tradeoff: &Tradeoff) -> String {
    let row = |point: &Point| {
        let mut cells: Vec<String> =
            [Knob::Model, Knob::BankStep, Knob::Rows, Knob::Engine, Knob::Subdivisions, Knob::Rule, Knob::Effort]
                .map(|knob| escape(&point.settings.tell(knob)))
                .into();
        let [low, high] = point.accuracy_ci95.map(|bound| number(100.0 * bound, 1));
        cells.extend([
            point.n_touches.to_string(),
            format!("{}<small>{low}–{high}</small>", number(100.0 * point.accuracy, 1)),
            number(point.xy_mm_mean, 2),
            number(point.theta_deg_mean, 1),
            format!("{}<small>{}</small>", number(point.decision_ms_p50, 2), number(point.decision_ms_p99, 2)),
            number(point.memory_mb, 1),
            if point.dominated { "" } else { "yes" }.into(),
        ]);
        cells
    };
    let rows: Vec<Vec<String>> = tradeoff.points.iter().map(row).collect();
    let heads = [
        "Model",
        "Bank",
        "Rows",
        "Inference",
        "States",
        "Rule",
        "Effort",
        "Touches",
        "Right, %",
        "mm",
        "degrees",
        "ms, half (99 %)",
        "MB",
        "Frontier",
    ];
    format!("<details><summary>{} points, sortable</summary>{}</details>", rows.len(), sortable(&heads, &rows))
}

/// A setting in words.
pub fn told(settings: &Settings) -> String {
    [Knob::Model, Knob::BankStep, Knob::Rows, Knob::Engine, Knob::Subdivisions, Knob::Rule, Knob::Effort]
        .map(|knob| settings.tell(knob))
        .join(", ")
}

fn touches(n: usize) -> String {
    if n == 1 { "1 touch".into() } else { format!("{n} touches") }
}

fn percent(share: f64) -> String {
    format!("{}\u{a0}%", number(100.0 * share, 1))
}

fn milliseconds(ms: f64) -> String {
    format!("{}\u{a0}ms", number(ms, if ms < 9.95 { 2 } else { 1 }))
}

fn megabytes(mb: f64) -> String {
    format!("{}\u{a0}MB", number(mb, 1))
}

fn signed(points: f64) -> String {
    super::signed(points, 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_filter::budget::SCHEMA;
    use tactile_filter::budget::settings_for_tests as settings;

    fn point(change: impl Fn(&mut Settings), n_touches: usize, accuracy: f64, ms: f64) -> Point {
        let mut settings = settings();
        change(&mut settings);
        Point {
            settings,
            n_touches,
            accuracy,
            accuracy_ci95: [0.25, 1.0],
            xy_mm_mean: 0.5,
            theta_deg_mean: 2.0,
            decision_ms_p50: ms,
            decision_ms_p99: 2.0 * ms,
            pace_ms: ms,
            memory_mb: 10.0,
            dominated: false,
        }
    }

    fn tradeoff() -> Tradeoff {
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
            poses: "off-grid".into(),
            n_classes: 12,
            n_episodes: 100,
            seeds: vec![1, 2],
            machine: "two cores".into(),
            command: "tactile-filter tradeoff".into(),
            points,
        };
        tradeoff.mark_dominated();
        tradeoff
    }

    #[test]
    fn the_verdict_names_the_best_and_the_fastest_beside_it() {
        let tradeoff = tradeoff();
        let verdict = verdict(&tradeoff).unwrap();
        assert_eq!((verdict.best.accuracy, verdict.fast.accuracy), (0.92, 0.91));
        // On the frontier: 4 draws fewer, finer steps, fewer states (twice).
        assert_eq!((verdict.n_settings, verdict.n_frontier, verdict.span), (5, 4, 40.0));
    }

    #[test]
    fn a_turn_is_of_one_knob_alone() {
        let tradeoff = tradeoff();
        let turns = turns(&tradeoff);
        let base = turns.iter().find(|turns| turns.len() == 3).unwrap();
        assert_eq!(base[0].points[0].settings, settings());
        let told: Vec<(Knob, f64)> = base.iter().map(|turn| (turn.knob, turn.times())).collect();
        assert_eq!(told, [(Knob::Effort, 0.25), (Knob::BankStep, 10.0), (Knob::Subdivisions, 0.5)]);
        assert!((base[0].gain() + 20.0).abs() < 1e-9);
    }

    #[test]
    fn a_staircase_only_rises() {
        let steps = staircase(vec![[3.0, 5.0], [1.0, 2.0], [2.0, 1.0], [4.0, 5.0], [1.0, 1.0]]);
        assert_eq!(steps, [[1.0, 2.0], [3.0, 5.0]]);
    }

    #[test]
    fn the_page_tells_every_point_and_needs_nothing_else() {
        let html = html(&tradeoff());
        assert!(html.contains("a&lt;b") && !html.contains("a<b"));
        assert_eq!(html.matches("<circle").count(), 3 * 6);
        assert!(!html.replace("http://www.w3.org/2000/svg", "").contains("http"));
        assert!(html.contains("Most is bought by bank of 1 mm, 15° (+2.0 points, 10.0 times as long)"));
    }
}
