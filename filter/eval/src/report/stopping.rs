//! When episodes stop by themselves, and how long a touch takes.

use super::super::result::{Evaluation, Quantiles, Stops};
use super::series::way;
use super::shell::Section;
use super::table::sortable;
use super::{escape, number};

/// What the stopping rule did, for each way of inferring and choosing.
pub fn section(evaluation: &Evaluation) -> Section {
    Section::new("Stopping", "When it stops", stops(evaluation))
}

fn stops(evaluation: &Evaluation) -> String {
    if evaluation.stops.is_empty() {
        return format!(
            "<p>With the stopping rule on, an episode ends after {} touches on average; {} % stop sure of a wrong part.</p>\n",
            number(evaluation.stopping.mean_touches, 1),
            number(100.0 * evaluation.stopping.confident_and_wrong, 1),
        );
    }
    let row = |stops: &Stops| {
        vec![
            way(stops.inference, stops.action),
            number(stops.mean_touches, 2),
            number(100.0 * stops.confident, 1),
            // Of no stops there is no share.
            if stops.confident > 0.0 { number(100.0 * stops.confident_and_wrong, 1) } else { "–".into() },
            number(100.0 * stops.none_of_these, 1),
            number(stops.touches_to_95, 2),
        ]
    };
    let rows: Vec<_> = evaluation.stops.iter().map(row).collect();
    let heads = ["Way", "touches to stop", "confident, %", "of these wrong, %", "none of these, %", "touches to 95 %"];
    let meaning = if evaluation.absent {
        "Every hole’s own part is missing from the bank, so “none of these parts” is the right answer and each confident
stop is wrong."
    } else {
        "Every hole’s part is in the bank, so each “none of these parts” is a false alarm."
    };
    format!(
        r#"<figure>{}
<figcaption>What the stopping rule does: means, and shares of all episodes. <b>Confident:</b> sure of one part, which explains
the touches. <b>None of these:</b> no part explains them. {meaning} The rest go on to the last touch. <b>Touches to 95 %:</b>
until one part is 95 % sure, whatever its fit; an episode that is never so sure counts as one more than its touches.</figcaption></figure>
"#,
        sortable(&heads, &rows)
    )
}

/// How long each stage of a touch takes.
pub fn speed(evaluation: &Evaluation) -> Section {
    let latency = &evaluation.latency_ms;
    let row = |stage: &str, Quantiles { p50, p99 }: Quantiles| vec![stage.into(), number(p50, 2), number(p99, 2)];
    let rows = [
        row("See: frame to embedding", latency.encode),
        row("Update: embedding to belief", latency.update),
        row("Choose: belief to next touch", latency.select),
    ];
    let n = evaluation.n_threads;
    let threads = if n == 1 { "1 thread".into() } else { format!("{n} threads") };
    let body = format!(
        r#"<figure>{}
<figcaption>Device <code>{}</code>, {threads}, episodes side by side. The time that the robot takes to move is not counted.</figcaption></figure>
"#,
        sortable(&["Time of one touch, ms", "half within", "99 of 100 within"], &rows),
        escape(&evaluation.device),
    );
    Section::new("Time", "How long it takes", body)
}

#[cfg(test)]
mod tests {
    use super::super::super::result::{Choice, Inference, tests::published};
    use super::*;

    fn evaluation(absent: bool, confident: f64) -> Evaluation {
        let stops = Stops {
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
    fn each_way_of_stopping_stands_in_its_column() {
        let html = section(&evaluation(false, 0.5)).html();
        let row = "<td>exact, random action</td><td>3.25</td><td>50.0</td><td>12.5</td><td>37.5</td><td>4.75</td>";
        assert!(html.contains(row) && html.contains("false alarm"), "{html}");
    }

    #[test]
    fn of_no_confident_stops_none_are_called_wrong() {
        assert!(section(&evaluation(false, 0.0)).html().contains("<td>0.0</td><td>–</td>"));
    }

    #[test]
    fn without_its_part_in_the_bank_refusing_is_right() {
        let html = section(&evaluation(true, 0.5)).html();
        assert!(html.contains("is the right answer") && !html.contains("false alarm"));
    }
}
