//! When episodes stop by themselves, and how long a touch takes.

use maud::{Markup, html};

use super::series::way;
use crate::page::numbers::{number, percent};
use crate::page::shell::{Section, figure};
use crate::page::table::{cells, sortable};
use crate::result::{Evaluation, Quantiles, Stops};

/// What the stopping rule did, for each way of inferring and choosing.
pub fn section(evaluation: &Evaluation) -> Section {
    Section::new("Stopping", "When it stops", stops(evaluation))
}

fn stops(evaluation: &Evaluation) -> Markup {
    if evaluation.stops.is_empty() {
        return html! {
            p {
                "With the stopping rule on, an episode ends after " (number(evaluation.stopping.mean_touches, 1))
                " touches on average; " (percent(evaluation.stopping.confident_and_wrong)) " % stop sure of a wrong part."
            }
        };
    }
    let row = |stops: &Stops| {
        // Of no stops there is no share.
        let wrong = if stops.confident > 0.0 { stops.confident_and_wrong } else { f64::NAN };
        cells![
            way(stops.inference, stops.action),
            number(stops.mean_touches, 2),
            percent(stops.confident),
            percent(wrong),
            percent(stops.none_of_these),
            number(stops.touches_to_95, 2),
            number(stops.seconds.unwrap_or(f64::NAN), 1),
        ]
    };
    let rows: Vec<_> = evaluation.stops.iter().map(row).collect();
    let heads = [
        "Way",
        "touches to stop",
        "confident, %",
        "of these wrong, %",
        "none of these, %",
        "touches to 95 %",
        "robot seconds to stop",
    ];
    let meaning = if evaluation.absent {
        "Every hole’s own part is missing from the bank, so “none of these parts” is the right answer and each confident \
         stop is wrong."
    } else {
        "Every hole’s part is in the bank, so each “none of these parts” is a false alarm."
    };
    let caption = html! {
        "What the stopping rule does: means, and shares of all episodes. " b { "Confident:" } " sure of one part, which explains "
        "the touches. " b { "None of these:" } " no part explains them. " (meaning) " The rest go on to the last touch. "
        b { "Touches to 95 %:" } " until one part is 95 % sure, with any fit; an episode that is never so sure counts as one "
        "more than its touches. " b { "Robot seconds:" } " touches and the ways between them, at the speeds given (" code { "--touch-s" } ", "
        code { "--mm-s" } "; 3 s and 50 mm/s otherwise); decisions take milliseconds."
    };
    figure(sortable(&heads, &rows), caption)
}

/// How long each stage of a touch takes.
pub fn speed(evaluation: &Evaluation) -> Section {
    let latency = &evaluation.latency_ms;
    let row = |stage: &str, Quantiles { p50, p99 }: Quantiles| cells![stage, number(p50, 2), number(p99, 2)];
    let rows = [
        Some(row("See: frame to embedding", latency.encode)),
        Some(row("Update: embedding to belief", latency.update)),
        latency.judge.map(|judge| row("Judge: belief to part, place, how sure", judge)),
        Some(row("Choose: the next touch", latency.select)),
    ];
    let rows: Vec<_> = rows.into_iter().flatten().collect();
    let table = sortable(&["Time of one touch, ms", "half within", "99 of 100 within"], &rows);
    let caption = html! {
        "Device " code { (evaluation.device) } ", " (evaluation.n_threads) @if evaluation.n_threads == 1 { " thread" } @else { " threads" }
        ", several episodes at once. The time that the robot takes to move is not counted."
    };
    Section::new("Time", "How long it takes", figure(table, caption))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::result::{Choice, Inference, tests::published};
    use maud::Render;

    fn evaluation(absent: bool, confident: f64) -> Evaluation {
        let stops = Stops {
            seconds: Some(12.5),
            inference: Inference::Exact,
            action: Choice::Random,
            mean_touches: 3.25,
            confident,
            confident_and_wrong: 0.125,
            none_of_these: 0.375,
            touches_to_95: 4.75,
        };
        Evaluation { absent, stops: vec![stops], ..serde_json::from_value(published()).unwrap() }
    }

    #[test]
    fn each_way_of_stopping_is_in_its_column() {
        let html = section(&evaluation(false, 0.5)).render().0;
        let row = "<td>exact, random action</td><td>3.25</td><td>50.0</td><td>12.5</td><td>37.5</td><td>4.75</td>";
        assert!(html.contains(row) && html.contains("false alarm"), "{html}");
    }

    #[test]
    fn of_no_confident_stops_none_are_called_wrong() {
        assert!(section(&evaluation(false, 0.0)).render().0.contains("<td>0.0</td><td>–</td>"));
    }

    #[test]
    fn without_its_part_in_the_bank_refusing_is_right() {
        let html = section(&evaluation(true, 0.5)).render().0;
        assert!(html.contains("is the right answer") && !html.contains("false alarm"));
    }
}
