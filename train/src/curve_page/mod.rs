//! `curve.html`: the run on one page, which opens without a network.

mod chart;

use chart::{Chart, Line};
use maud::{DOCTYPE, Markup, PreEscaped, html};

use crate::config::TrainConfig;
use crate::error::Result;
use crate::history::Row;
use crate::pairs::Pairs;
use crate::validation::Validation;

/// Seconds after which the page of a run that continues loads itself again.
const RELOAD_SECONDS: usize = 30;

/// How far the run is.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'a> {
    /// It continues.
    Running,
    /// All steps were made.
    Finished,
    /// The user stopped it.
    Interrupted,
    /// It stopped with an error.
    Failed(&'a str),
}

/// What the page shows.
pub struct CurvePage<'a> {
    /// Name of the dataset.
    pub dataset: &'a str,
    /// The run's settings.
    pub config: &'a TrainConfig,
    /// What it trains on.
    pub pairs: &'a Pairs<'a>,
    /// Accuracy by chance on the tuning parts; `None` without them.
    pub tuning_chance: Option<f64>,
    /// All steps so far.
    pub rows: &'a [Row],
}

impl CurvePage<'_> {
    /// The page as HTML.
    pub fn render(&self, progress: Progress<'_>) -> Result<String> {
        let page = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    @if let Progress::Running = progress { meta http-equiv="refresh" content=(RELOAD_SECONDS); }
                    title { "Training on " (self.dataset) }
                    style { (PreEscaped(include_str!("style.css"))) }
                }
                body {
                    h1 { "Is it learning? Training on " (self.dataset) }
                    (self.progress(progress))
                    div class="tiles" { @if let Some(found) = self.latest() { (tiles(found)) } }
                    div class="charts" { @for chart in self.charts() { (chart.figure()) } }
                    h2 { "Settings" }
                    dl { (self.settings()?) }
                }
            }
        };
        Ok(page.into_string())
    }

    fn progress(&self, progress: Progress<'_>) -> Markup {
        let (step, n_steps) = (self.rows.last().map_or(0, |row| row.step), self.config.n_steps);
        html! {
            @match progress {
                Progress::Running => p { "Step " (step) " of " (n_steps) "; this page is updated at each checkpoint." },
                Progress::Finished => p { "All " (n_steps) " steps are made." },
                Progress::Interrupted => p {
                    "Stopped on request after step " (step) " of " (n_steps) "; " code { "--resume" } " continues."
                },
                Progress::Failed(why) => p class="failed" { "After step " (step) " of " (n_steps) ": " (why) "." },
            }
        }
    }

    fn latest(&self) -> Option<&Validation> {
        self.rows.iter().rev().find_map(|row| row.validation.as_ref())
    }

    /// The loss, then what shows how good the model is, then how it was trained.
    fn charts(&self) -> Vec<Chart<'_>> {
        let mut charts = self.charts_of_steps();
        charts.splice(1..1, self.charts_of_validations());
        charts
    }

    fn chart<'a>(&self, [title, look]: [&'a str; 2], level: Option<(&'a str, f64)>, lines: Vec<Line<'a>>) -> Chart<'a> {
        Chart { title, look, level, lines, n_steps: self.config.n_steps }
    }

    fn charts_of_steps(&self) -> Vec<Chart<'_>> {
        let line = |class, label, of: fn(&Row) -> f64| Line {
            label,
            class,
            points: self.rows.iter().map(|row| (row.step, of(row))).collect(),
        };
        let mut rate = line("first", "rate", |row| row.learning_rate);
        rate.points.iter_mut().for_each(|(_, value)| *value /= self.config.learning_rate);
        let chance = ("nothing learned: 4 \u{3c4} ln N", self.config.chance_loss());
        vec![
            self.chart([
    "Loss",
    "It should fall well below the dashed line in the first tenth of the run. On the line, the network cannot \
     distinguish one pair from another; above it, the learning rate is too high. A low loss alone does not make a good \
     model.",
], Some(chance), vec![line("first", "loss", |row| row.loss)]),
            self.chart(["Length of the gradient", "Single spikes are harmless; growth by powers of ten comes before divergence."], None, vec![line("first", "gradient", |row| row.gradient_norm)]),
            self.chart([
    "Learning rate, as a share of its peak, and momentum of the key encoder",
    "As set: the rate rises over the warm-up and falls to zero on half a cosine, the momentum rises to one.",
], None, vec![rate, line("second", "momentum", |row| row.momentum)]),
            self.chart([
    "Pairs per second",
    "Mean of the last 50 steps, without validation. A fall means that something else uses the machine.",
], None, vec![line("first", "speed", |row| row.pairs_per_second)]),
        ]
    }

    fn charts_of_validations(&self) -> [Chart<'_>; 4] {
        let line = |class, label, of: fn(&Validation) -> Option<f64>| {
            let measured = self.rows.iter().filter_map(|row| Some((row.step, of(row.validation.as_ref()?)?)));
            Line { label, class, points: measured.collect() }
        };
        let chance = |value| ("chance", value);
        let near_chance = self.latest().and_then(|found| found.near_chance).unwrap_or(0.0);
        let [first, five] =
            [line("first", "first", |v| Some(v.retrieval_1)), line("second", "among five", |v| Some(v.retrieval_5))];
        let [gap, spread] =
            [line("first", "gap", |v| Some(v.cosine_gap)), line("second", "spread", |v| Some(v.spread))];
        [
            self.chart([
    "Parts never trained on, one touch, share right",
    "Choose a model by this figure: it should still rise when the loss no longer falls.",
], self.tuning_chance.map(chance), vec![line("first", "accuracy", |v| v.tuning_accuracy)]),
            self.chart([
    "Own peg among near ones (6 mm, 40\u{b0}), share found",
    "Neighbours look similar, so this still rises when retrieval on the whole board is complete. It decides how precisely \
     the filter finds the pose.",
], Some(chance(near_chance)), vec![line("first", "near", |v| v.near_1)]),
            self.chart([
    "Own peg among all of its held-out board, share found",
    "Rises first and is complete early. If it stays at zero, nothing is learned.",
], None, vec![first, five]),
            self.chart([
    "Gap of cosines, and spread of the embedding",
    "Both should rise and stay high. A spread that falls to zero is a collapse: all views get one embedding.",
], None, vec![gap, spread]),
        ]
    }

    fn settings(&self) -> Result<Markup> {
        let n_blank = self.pairs.places.iter().filter(|place| place.blank).count();
        let n_held_out: usize = self.pairs.held_out.iter().map(Vec::len).sum();
        let toml = self.config.to_toml()?;
        Ok(html! {
            dt { "dataset" }
            dd { (self.pairs.training.len()) " pairs, " (n_blank) " of them blank, and " (n_held_out) " held out" }
            @if let Some(relighting) = &self.pairs.relighting {
                dt { "lamps found, red, green, blue along" }
                dd { (relighting.lines_deg().map(|deg| format!("{deg:.0}\u{b0}")).join(", ")) }
            }
            @for (name, value) in toml.lines().filter_map(|line| line.split_once(" = ")) {
                dt { (name) }
                dd { (value.trim_matches('"')) }
            }
        })
    }
}

fn tiles(found: &Validation) -> Markup {
    let percent = |share: f64| format!("{:.1}\u{a0}%", 100.0 * share);
    html! {
        @if let Some(accuracy) = found.tuning_accuracy {
            div class="tile" {
                b { (percent(accuracy)) }
                "of holes of parts never trained on find a peg of their part in one touch"
            }
        }
        @if let (Some(near), Some(chance)) = (found.near_1, found.near_chance) {
            div class="tile" {
                b { (percent(near)) }
                "of held-out holes find their own peg among near ones; chance " (percent(chance))
            }
        }
        @if found.n_holes > 0 {
            div class="tile" {
                b { (percent(found.retrieval_1)) }
                "find it among all pegs of their board; chance " (percent(found.chance_1))
            }
            div class="tile" { b { (format!("{:.2}", found.cosine_gap)) } "gap between mating cosines and others" }
            div class="tile" {
                b { (format!("{:.2}", found.spread)) }
                "spread of the embedding: 0 has collapsed, 1 fills its space"
            }
        }
    }
}
