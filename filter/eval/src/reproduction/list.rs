//! A section with a row for each evaluation and a column for each figure.

use maud::{Markup, html};

use super::cell::poses;
use super::experiments::{Figure, List, Row, Section};
use super::folder::Reproduction;
use super::section::{Finding, not_run};
use super::sensors;
use crate::page::numbers::{number, percent, share};
use crate::page::shell::figure;
use crate::page::table::sortable;
use crate::report::series::{leading_filter, leading_stops};
use crate::result::{self, Evaluation, Stops};
use crate::statistics::share::wilson_95;

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let lists = section.lists.iter().map(|list| of_list(found, list));
    let lists: Vec<_> = lists.collect();
    let missing = html! { @for (_, _, missing) in &lists { (missing) } };
    if lists.iter().all(|(table, ..)| table.is_none()) {
        return Finding::missing(section, missing);
    }
    let body = html! {
        @for (table, ..) in lists.iter() { @if let Some(table) = table { (table) } }
        (missing)
    };
    let lines: Vec<&str> = lists.iter().map(|(_, line, _)| line.as_str()).filter(|line| !line.is_empty()).collect();
    let lines = lines.join("; ");
    Finding::new(section, body, if lines.is_empty() { "nothing to compare" } else { &lines })
}

/// The table of a list, `None` where no row was run; its line for a terminal; what was not run.
fn of_list(found: &Reproduction, list: &List) -> (Option<Markup>, String, Markup) {
    let all = if list.sensors { sensors::rows(found) } else { list.rows.clone() };
    let there: Vec<(&Row, &Evaluation)> =
        all.iter().filter_map(|row| Some((row, found.evaluation(&row.of)?))).collect();
    let missing = html! {
        @if list.sensors { (sensors::missing(found)) }
        @for row in all.iter().filter(|row| found.evaluation(&row.of).is_none()) { (not_run(&row.of)) }
    };
    if there.is_empty() {
        return (None, String::new(), missing);
    }
    let baseline = list.baseline.as_ref().and_then(|name| found.evaluation(name));
    let row = |(row, evaluation): &(&Row, &Evaluation)| {
        let text = row.text.iter().enumerate();
        let text = text.map(|(at, text)| {
            if at == list.link {
                found.report(&row.of, text)
            } else {
                html! { (text) }
            }
        });
        let known = row.known.as_ref().and_then(|name| found.evaluation(name));
        let cell = |figure| cell(figure, evaluation, known, baseline);
        text.chain(list.columns.iter().map(|column| cell(column.figure))).collect()
    };
    let heads: Vec<&String> = list.text.iter().chain(list.columns.iter().map(|column| &column.head)).collect();
    let rows: Vec<Vec<Markup>> = there.iter().map(row).collect();
    let caption = if list.sensors { sensors::caption(found, &list.caption) } else { list.caption.clone() };
    let line: Vec<String> = list.summary.iter().filter_map(|figure| in_short(*figure, list, &there)).collect();
    (Some(figure(sortable(&heads, &rows), caption)), line.join(", "), missing)
}

/// The least and the largest of a share over the rows, and whose they are.
fn in_short(figure: Figure, list: &List, there: &[(&Row, &Evaluation)]) -> Option<String> {
    let value = |evaluation: &Evaluation| match figure {
        Figure::Right(n_touches) => right(evaluation, n_touches).map(|row| row.accuracy),
        _ => leading_stops(evaluation).map(|stops| stops.none_of_these),
    };
    let values = there.iter().filter_map(|(row, evaluation)| Some((value(evaluation)?, row.text.join(", "))));
    let mut values: Vec<(f64, String)> = values.collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let [(least, of_least), .., (most, of_most)] = &values[..] else { return None };
    let head = list.columns.iter().find(|column| column.figure == figure).map_or("", |column| &column.head);
    Some(format!("{head}: {} ({of_least}) to {} ({of_most})", percent(*least), percent(*most)))
}

fn right(evaluation: &Evaluation, n_touches: usize) -> Option<&result::Row> {
    leading_filter(evaluation, poses(evaluation))?.at(n_touches)
}

fn cell(of: Figure, evaluation: &Evaluation, known: Option<&Evaluation>, baseline: Option<&Evaluation>) -> Markup {
    let stops = leading_stops(evaluation);
    let last = || leading_filter(evaluation, poses(evaluation)).and_then(|series| series.rows.last().copied());
    let or_dash = |value: Option<f64>, decimals| html! { (number(value.unwrap_or(f64::NAN), decimals)) };
    let of_stops = |of: fn(&Stops) -> f64, with_interval: bool| {
        let (value, n) = (stops.map(of), evaluation.n_episodes);
        match value.filter(|_| with_interval) {
            Some(value) => share(value, wilson_95((value * n as f64).round() as usize, n)),
            None => or_dash(value.map(|value| 100.0 * value), 1),
        }
    };
    match of {
        Figure::Right(n) => html! {
            @if let Some(row) = right(evaluation, n) {
                @let plain = baseline.and_then(|baseline| right(baseline, n));
                @if plain.is_some_and(|plain| row.accuracy_ci95[1] < plain.accuracy_ci95[0]) {
                    span.wrong { (share(row.accuracy, row.accuracy_ci95)) }
                } @else {
                    (share(row.accuracy, row.accuracy_ci95))
                }
            }
        },
        Figure::Place => or_dash(last().map(|row| row.xy_mm_mean), 2),
        Figure::Angle => or_dash(last().map(|row| row.theta_deg_mean), 1),
        Figure::Sure | Figure::SureWithin => of_stops(|stops| stops.confident, of == Figure::SureWithin),
        Figure::Wrong => of_stops(|stops| stops.confident_and_wrong, false),
        Figure::None | Figure::NoneWithin => of_stops(|stops| stops.none_of_these, of == Figure::NoneWithin),
        Figure::KnownNone => {
            let known = known.and_then(leading_stops);
            html! { (known.map_or("not run".into(), |known| percent(known.none_of_these))) }
        }
        Figure::Touches => or_dash(stops.map(|stops| stops.mean_touches), 1),
        Figure::Episodes => html! { (evaluation.n_episodes) },
    }
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::experiments::tests::section;
    use super::super::folder::tests::of;
    use super::super::sensors::tests::made;
    use super::*;
    use maud::Render;

    #[test]
    fn a_change_that_clearly_costs_is_marked() {
        let made = |accuracy| evaluation("x", 0.5, &[(1, 0.9), (3, accuracy)]);
        let found = of(&[("small", made(0.99)), ("robust-cmu-light", made(0.98)), ("robust-soft-gel", made(0.9))]);
        let finding = finding(&found, &section("Robustness"));
        assert_eq!(finding.line, "Robustness: 3 touches: 90.0 (soft-gel) to 99.0 (nothing (small))");
        let html = finding.section.render().0;
        assert_eq!(html.matches(r#"<span class="wrong">"#).count(), 1);
        assert!(html.contains(r#"<span class="wrong">90.0"#) && html.contains("<code>robust-attachment/</code>"));
        assert_eq!(super::finding(&of(&[]), &section("Robustness")).line, "Robustness: not run");
    }

    #[test]
    fn letters_for_tuning_are_said_to_be_so_and_other_kinds_have_their_own_table() {
        let tuning = Evaluation { scene: "sensor-default-tuning".into(), ..made(0.99, 0.0) };
        let found = of(&[("sensor-default-shipped", tuning), ("parts-digits", made(0.97, 0.02))]);
        let html = finding(&found, &section("Sensors")).section.render().0;
        assert!(html.contains("M to X, which settings may be chosen on") && html.contains("ten digits"));
        assert_eq!(html.matches("<table").count(), 2);
    }

    #[test]
    fn unknown_parts_come_with_the_price_of_knowing_them() {
        let found = of(&[("small", made(0.5, 0.0125)), ("small-absent", made(0.5, 0.9))]);
        let html = finding(&found, &section("Unknown parts")).section.render().0;
        // 450 of 500 by Wilson.
        assert!(html.contains("90.0<small>87.1–92.3</small>") && html.contains("<td>1.2</td>"));
        let html = finding(&of(&[("small-absent", made(0.5, 0.9))]), &section("Unknown parts")).section.render().0;
        assert!(html.contains("<td>not run</td>"));
    }

    #[test]
    fn each_scene_stands_under_the_same_with_less_aid_and_each_evaluation_once() {
        let all = [
            ("small-cosine", made(0.884, 0.0)),
            ("small-anywhere", made(0.872, 0.0)),
            ("known-small", made(0.892, 0.0)),
            ("outlines-cosine", made(0.858, 0.0)),
        ];
        let html = finding(&of(&all), &section("Known holes")).section.render().0;
        let [cosine, learnt, both] = ["88.4", "87.2", "89.2"].map(|share| html.find(share).unwrap());
        assert!(cosine < learnt && learnt < both);
        assert_eq!((html.matches("85.8").count(), html.matches("pegs, cosine alone").count()), (1, 2));
    }
}
