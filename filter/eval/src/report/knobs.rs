//! Which knob of a trade-off buys most.

use maud::{Markup, html};
use tactile_filter::budget::{Knob, Point, Setup, Tradeoff};

use crate::page::numbers::{milliseconds, number, percent, percent_sign, signed, touch_count};
use crate::page::shell::figure;
use crate::page::table::{cells, sortable};

/// The knobs in the order in which a setting is described.
pub(crate) const KNOBS: [Knob; 9] = [
    Knob::Model,
    Knob::BankStep,
    Knob::Rows,
    Knob::Engine,
    Knob::Subdivisions,
    Knob::Rule,
    Knob::Effort,
    Knob::Verify,
    Knob::Risk,
];

/// A setting in words.
pub fn in_words(settings: &Setup) -> String {
    told(settings, &KNOBS)
}

/// The values of some knobs in words.
pub(super) fn told(settings: &Setup, knobs: &[Knob]) -> String {
    knobs.iter().map(|knob| settings.tell(*knob)).collect::<Vec<_>>().join(", ")
}

/// The number of touches at which knobs are compared.
const COMPARED: usize = 3;

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
        // Which part is named does not depend on it.
        [Knob::Risk] => None,
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

/// From each base a table of what its knobs buy.
pub(super) fn knobs(tradeoff: &Tradeoff) -> Markup {
    html! {
        p { "After " (touch_count(COMPARED)) ". " (by_chance(tradeoff)) }
        @for turns in turns(tradeoff) { (knob_table(&turns)) }
    }
}

/// Which differences of accuracy the number of episodes cannot separate from chance.
fn by_chance(tradeoff: &Tradeoff) -> String {
    let compared = || tradeoff.points.iter().filter(|p| p.n_touches == COMPARED).map(|p| p.accuracy);
    let (n_points, n) = (compared().count().max(1) as f64, tradeoff.n_episodes.max(1) as f64);
    let mean = compared().sum::<f64>() / n_points;
    // Two shares of n episodes each; at least one episode's worth where all are right.
    let points = (100.0 * 1.96 * (2.0 * mean * (1.0 - mean) / n).sqrt()).max(100.0 / n);
    format!(
        "{} episodes stand behind each point: a difference of less than about {} points is within what chance makes of two \
         settings that are equally good (95 % interval of two shares near {} %, as if of different holes; they are the same \
         holes, so it is rather too wide).",
        tradeoff.n_episodes,
        number(points, 1),
        percent(mean)
    )
}

fn knob_table(turns: &[Turn<'_>]) -> Markup {
    let Some(first) = turns.first() else { return html! {} };
    let base = first.points[0];
    let most = turns.iter().max_by(|a, b| a.gain().total_cmp(&b.gain()));
    let cheap = turns.iter().filter(|turn| turn.gain() >= -2.0).min_by(|a, b| a.times().total_cmp(&b.times()));
    let what = |turn: &Turn<'_>| turn.points[1].settings.tell(turn.knob);
    let row = |turn: &Turn<'_>| {
        let [before, after] = turn.points;
        cells![
            after.settings.tell(turn.knob),
            before.settings.tell(turn.knob),
            signed(turn.gain(), 1),
            number(turn.times(), 2),
            number(after.memory_mb / before.memory_mb, 2),
        ]
    };
    let rows: Vec<_> = turns.iter().map(row).collect();
    let content = html! {
        h4 {
            "From " (in_words(&base.settings)) ": " (percent_sign(base.accuracy)) ", " (milliseconds(base.decision_ms_p50))
        }
        (sortable(&["Turned to", "from", "Accuracy, points", "Time, times", "Memory, times"], &rows))
    };
    let caption = html! {
        @if let Some(turn) = most {
            "Most is bought by " (what(turn)) " (" (signed(turn.gain(), 1)) " points, " (number(turn.times(), 1)) " times as long)"
        }
        @if let Some(turn) = cheap.filter(|turn| turn.times() < 1.0) {
            "; most time is saved by " (what(turn)) " (" (number(turn.times(), 2)) " of it, " (signed(turn.gain(), 1)) " points)"
        }
        "."
    };
    figure(content, caption)
}

#[cfg(test)]
mod tests {
    use super::super::tradeoff::tests::{settings, tradeoff};
    use super::*;

    #[test]
    fn a_turn_is_of_one_knob_alone() {
        let tradeoff = tradeoff();
        let turns = turns(&tradeoff);
        let base = turns.iter().find(|turns| turns.len() == 3).unwrap();
        assert_eq!(base[0].points[0].settings, settings());
        let found: Vec<(Knob, f64)> = base.iter().map(|turn| (turn.knob, turn.times())).collect();
        assert_eq!(found, [(Knob::Effort, 0.25), (Knob::BankStep, 10.0), (Knob::Subdivisions, 0.5)]);
        assert!((base[0].gain() + 20.0).abs() < 1e-9);
    }

    #[test]
    fn chance_is_stated_for_the_number_of_episodes() {
        let few = Tradeoff { n_episodes: 40, ..tradeoff() };
        // After three touches 80.6 % on average of five settings: 1.96 sqrt(2 x 0.806 x 0.194 / 40).
        assert!(by_chance(&few).contains("less than about 17.3 points"), "{}", by_chance(&few));
        assert!(by_chance(&Tradeoff { n_episodes: 4000, ..few }).contains("about 1.7 points"));
    }
}
