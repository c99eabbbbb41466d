//! `curve.html`: the run on one page, drawn by hand so that it opens anywhere, without a network, in light and
//! dark.

mod chart;
mod style;

use chart::{Level, Line, chart, escape};

use crate::history::Row;
use crate::pairs::Pairs;
use crate::run::Run;
use crate::settings::Settings;
use crate::validate::Validation;

/// Seconds after which a page that is still being rewritten loads itself again.
const RELOAD_SECONDS: usize = 30;

/// Where the run stands.
#[derive(Clone, Copy, Debug)]
pub enum End<'a> {
    /// It goes on.
    Running,
    /// All steps were made.
    Finished,
    /// Somebody asked it to stop.
    Asked,
    /// It stopped for a reason.
    Stopped(&'a str),
}

/// The page of a run.
pub fn render(run: &Run<'_>, pairs: &Pairs<'_>, rows: &[Row], end: End<'_>) -> String {
    let name = escape(&run.dataset.meta().name);
    let reload = match end {
        End::Running => format!(r#"<meta http-equiv="refresh" content="{RELOAD_SECONDS}">"#),
        End::Finished | End::Asked | End::Stopped(_) => String::new(),
    };
    format!(
        r#"<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">{reload}
<title>Training on {name}</title><style>{}</style></head><body>
<h1>Is it learning? Training on {name}</h1>
{}
<div class="tiles">{}</div>
<div class="charts">{}</div>
<h2>Settings</h2>
<dl>{}</dl>
</body></html>
"#,
        style::CSS,
        standing(run, rows, end),
        tiles(rows),
        charts(run, rows),
        settings(run, pairs),
    )
}

fn standing(run: &Run<'_>, rows: &[Row], end: End<'_>) -> String {
    let (step, n_steps) = (rows.last().map_or(0, |row| row.step), run.config.n_steps);
    match end {
        End::Running => format!("<p>Step {step} of {n_steps}; this page is drawn anew at each checkpoint.</p>"),
        End::Finished => format!("<p>All {n_steps} steps are made.</p>"),
        End::Asked => {
            format!("<p>Stopped on request after step {step} of {n_steps}; <code>--resume</code> goes on.</p>")
        }
        End::Stopped(why) => format!(r#"<p class="ill">After step {step} of {n_steps}: {}.</p>"#, escape(why)),
    }
}

fn tiles(rows: &[Row]) -> String {
    let Some(found) = latest(rows) else { return String::new() };
    let percent = |share: f64| format!("{:.1}\u{a0}%", 100.0 * share);
    let mut tiles = Vec::new();
    if let Some(letters) = found.letters {
        tiles.push((
            percent(letters),
            "of holes of parts never trained on find a peg of their part in one touch".into(),
        ));
    }
    if let (Some(near), Some(chance)) = (found.near_1, found.near_chance) {
        tiles.push((
            percent(near),
            format!("of held-out holes find their own peg among near ones; chance {}", percent(chance)),
        ));
    }
    if found.n_holes > 0 {
        let chance = percent(found.chance_1);
        tiles.push((percent(found.retrieval_1), format!("find it among all pegs of their board; chance {chance}")));
        tiles.push((format!("{:.2}", found.cosine_gap), "gap between mating cosines and others".into()));
        tiles.push((
            format!("{:.2}", found.spread),
            "spread of the embedding: 0 has collapsed, 1 fills its space".into(),
        ));
    }
    let tile = |(figure, what): &(String, String)| format!(r#"<div class="tile"><b>{figure}</b>{what}</div>"#);
    tiles.iter().map(tile).collect()
}

fn latest(rows: &[Row]) -> Option<&Validation> {
    rows.iter().rev().find_map(|row| row.validation.as_ref())
}

fn charts(run: &Run<'_>, rows: &[Row]) -> String {
    let (config, found) = (run.config, latest(rows));
    let steps = |of: fn(&Row) -> f64| rows.iter().map(|row| (row.step, of(row))).collect::<Vec<_>>();
    let saves = |of: fn(&Validation) -> Option<f64>| {
        let measured = rows.iter().filter_map(|row| Some((row.step, of(row.validation.as_ref()?)?)));
        measured.collect::<Vec<_>>()
    };
    let line = |label, class, points| Line { label, class, points };
    let chance = found.and_then(|found| found.near_chance).unwrap_or(0.0);
    let figures: [(&str, Vec<Line<'_>>, Option<Level<'_>>, &str); 8] = [
        (
            "Loss",
            vec![line("loss", "first", steps(|row| row.loss))],
            Some(Level { label: "nothing learnt: 4 \u{3c4} ln N", value: config.chance_loss() }),
            "Look for a fall well below the dashed line in the first tenth of the run. Staying on it, the network tells no \
             pair from another; above it, the learning rate is too high. A low loss alone does not make a good model.",
        ),
        (
            "Parts never trained on, one touch, share right",
            vec![line("letters", "first", saves(|v| v.letters))],
            run.letters.map(|letters| Level { label: "chance", value: letters.chance() }),
            "The figure to choose a model by: it should still rise when the loss has long gone flat.",
        ),
        (
            "Own peg among near ones (6 mm, 40\u{b0}), share found",
            vec![line("near", "first", saves(|v| v.near_1))],
            Some(Level { label: "chance", value: chance }),
            "Neighbours look alike, so this keeps rising after the whole board's retrieval is full. It is what fixes the pose.",
        ),
        (
            "Own peg among all of its held-out board, share found",
            vec![
                line("first", "first", saves(|v| Some(v.retrieval_1))),
                line("among five", "second", saves(|v| Some(v.retrieval_5))),
            ],
            None,
            "Rises first and is full early. If it does not leave nought, nothing is being learnt.",
        ),
        (
            "Gap of cosines, and spread of the embedding",
            vec![
                line("gap", "first", saves(|v| Some(v.cosine_gap))),
                line("spread", "second", saves(|v| Some(v.spread))),
            ],
            None,
            "Both should rise and stay. A spread that sinks to nought is a collapse: all views get one embedding.",
        ),
        (
            "Length of the gradient",
            vec![line("gradient", "first", steps(|row| row.gradient_norm))],
            None,
            "Single spikes are harmless; a length that climbs by powers of ten goes before divergence.",
        ),
        (
            "Learning rate, as a share of its peak, and momentum of the key encoder",
            vec![
                line(
                    "rate",
                    "first",
                    rows.iter().map(|row| (row.step, row.learning_rate / config.learning_rate)).collect(),
                ),
                line("momentum", "second", steps(|row| row.momentum)),
            ],
            None,
            "As set: the rate rises over the warm-up and falls to nought on half a cosine, the momentum rises to one.",
        ),
        (
            "Pairs a second",
            vec![line("speed", "first", steps(|row| row.pairs_per_second))],
            None,
            "Mean of the last 50 steps, without validation. A fall means that something else uses the machine.",
        ),
    ];
    let figure = |(title, lines, level, look): &(&str, Vec<Line<'_>>, Option<Level<'_>>, &str)| {
        let svg = chart(title, lines, level.as_ref(), config.n_steps)?;
        Some(format!("<figure><p>{title}</p>{svg}<figcaption>{look}</figcaption></figure>"))
    };
    figures.iter().filter_map(figure).collect()
}

fn settings(run: &Run<'_>, pairs: &Pairs<'_>) -> String {
    let n_blank = pairs.places.iter().filter(|place| place.blank).count();
    let held_out: usize = pairs.held_out.iter().map(Vec::len).sum();
    let data = format!("{} pairs, {n_blank} of them blank, and {held_out} held out", pairs.training.len());
    let toml = toml::to_string(&Settings::from(run.config)).unwrap_or_default();
    let lines = toml.lines().filter_map(|line| line.split_once(" = "));
    let lamps =
        pairs.relight.as_ref().map(|relight| relight.lines_deg().map(|deg| format!("{deg:.0}\u{b0}")).join(", "));
    let found = lamps.as_deref().map(|lamps| ("lamps found, red, green, blue along", lamps));
    let entries = [("dataset", data.as_str())].into_iter().chain(found).chain(lines);
    entries
        .map(|(name, value)| format!("<dt>{}</dt><dd>{}</dd>", escape(name), escape(value.trim_matches('"'))))
        .collect()
}
