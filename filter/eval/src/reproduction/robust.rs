//! The small board with one thing changed at a time.

use maud::{Markup, html};

use super::folder::{ROBUST, Reproduction};
use super::section::Finding;
use crate::page::numbers::{interval, number, percent};
use crate::page::shell::figure;
use crate::page::table::sortable;
use crate::report::series::{leading_filter, leading_stops};
use crate::result::{Evaluation, Poses, Row};

/// Its entry in the contents.
const SHORT: &str = "Robustness";
/// The numbers of touches shown.
const TOUCHES: [usize; 4] = [1, 3, 5, 10];

/// The section.
pub fn finding(found: &Reproduction) -> Finding {
    let title = "Robustness: one thing changed at a time";
    let changed: Vec<(&str, &Evaluation)> = found
        .evaluations
        .iter()
        .filter_map(|(name, evaluation)| Some((name.strip_prefix(ROBUST)?, evaluation)))
        .collect();
    if changed.is_empty() {
        return Finding::not_run(SHORT, title, "robust-NAME");
    }
    let baseline = found.evaluation("small");
    let plain = baseline.map(|evaluation| row(found.report("small", "nothing (small)"), evaluation, evaluation));
    let others = changed.iter().map(|(name, evaluation)| {
        row(found.report(&format!("{ROBUST}{name}"), name), evaluation, baseline.unwrap_or(evaluation))
    });
    let rows: Vec<Vec<Markup>> = plain.into_iter().chain(others).collect();
    let heads = [
        "Changed",
        "1 touch, %",
        "3 touches",
        "5",
        "10",
        "place, mm",
        "angle, degrees",
        "sure and wrong, %",
        "episodes",
    ];
    let lowest = changed.iter().filter_map(|(name, evaluation)| Some((*name, at(evaluation, 3)?.accuracy)));
    let lowest = lowest.min_by(|a, b| a.1.total_cmp(&b.1));
    let line = lowest.map_or("nothing measured after 3 touches".into(), |(name, accuracy)| {
        format!("after 3 touches {} % or more, the least with {name}", percent(accuracy))
    });
    let body = figure(
        sortable(&heads, &rows),
        "The small board, touched at recorded poses, with one thing changed for the pegs and \
        the holes, or for the holes alone where its report says so. Marked in red: after as many touches clearly below the plain \
        board (the intervals do not meet). Place and angle: mean errors after the last touch. Sure and wrong: of the stops for \
        confidence. The paper has no numbers for these.",
    );
    Finding::new(SHORT, title, body, &line)
}

fn at(evaluation: &Evaluation, n_touches: usize) -> Option<&Row> {
    leading_filter(evaluation, Poses::OnGrid)?.at(n_touches)
}

fn row(name: Markup, evaluation: &Evaluation, baseline: &Evaluation) -> Vec<Markup> {
    let share = |n: &usize| {
        html! {
            @if let Some(row) = at(evaluation, *n) {
                @let is_below = at(baseline, *n).is_some_and(|plain| row.accuracy_ci95[1] < plain.accuracy_ci95[0]);
                span.wrong[is_below] { (percent(row.accuracy)) } small { (interval(row.accuracy_ci95)) }
            }
        }
    };
    let last = leading_filter(evaluation, Poses::OnGrid).and_then(|series| series.rows.last().copied());
    let wrong = leading_stops(evaluation).map_or(f64::NAN, |stops| stops.confident_and_wrong);
    let error = |of: fn(&Row) -> f64, decimals| html! { (number(last.map_or(f64::NAN, of), decimals)) };
    std::iter::once(name)
        .chain(TOUCHES.iter().map(share))
        .chain([
            error(|row| row.xy_mm_mean, 2),
            error(|row| row.theta_deg_mean, 1),
            html! { (percent(wrong)) },
            html! { (evaluation.n_episodes) },
        ])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;
    use maud::Render;

    #[test]
    fn a_change_that_clearly_costs_is_marked() {
        let made = |accuracy| evaluation("x", 0.5, &[(1, 0.9), (3, accuracy)]);
        let found = of(&[("small", made(0.99)), ("robust-dim", made(0.98)), ("robust-d<rk", made(0.9))]);
        let finding = finding(&found);
        assert_eq!(finding.line, "Robustness: after 3 touches 90.0 % or more, the least with d<rk");
        let html = finding.section.render().0;
        assert_eq!(html.matches(r#"<span class="wrong">"#).count(), 1);
        assert!(html.contains("d&lt;rk") && html.contains(r#"<span class="wrong">90.0</span>"#));
    }
}
