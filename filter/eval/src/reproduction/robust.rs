//! The small board with one thing changed at a time.

use super::super::report::number;
use super::super::report::series::leading_filter;
use super::super::report::table::sortable;
use super::super::result::{Evaluation, Poses, Row};
use super::folder::{ROBUST, Reproduction};
use super::strangers::stops;
use super::{Told, cell};

/// Its entry in the contents.
const SHORT: &str = "Robustness";
/// The numbers of touches shown.
const TOUCHES: [usize; 4] = [1, 3, 5, 10];

/// The section.
pub fn tell(found: &Reproduction) -> Told {
    let title = "Robustness: one thing changed at a time";
    let changed: Vec<(&str, &Evaluation)> = found
        .evaluations
        .iter()
        .filter_map(|(name, evaluation)| Some((name.strip_prefix(ROBUST)?, evaluation)))
        .collect();
    if changed.is_empty() {
        return Told::not_run(SHORT, title, "robust-NAME");
    }
    let baseline = found.evaluation("small");
    let plain = baseline.map(|evaluation| row(found.report("small", "nothing (small)"), evaluation, evaluation));
    let others = changed.iter().map(|(name, evaluation)| {
        row(found.report(&format!("{ROBUST}{name}"), name), evaluation, baseline.unwrap_or(evaluation))
    });
    let rows: Vec<Vec<String>> = plain.into_iter().chain(others).collect();
    let heads = ["Changed", "1 touch, %", "3 touches", "5", "10", "place, mm", "angle, degrees", "sure and wrong, %"];
    let heads: Vec<&str> = heads.into_iter().chain(["episodes"]).collect();
    let lowest = changed.iter().filter_map(|(name, evaluation)| Some((*name, at(evaluation, 3)?.accuracy)));
    let lowest = lowest.min_by(|a, b| a.1.total_cmp(&b.1));
    let line = lowest.map_or("nothing measured after 3 touches".into(), |(name, accuracy)| {
        format!("after 3 touches {} % or more, the least with {name}", number(100.0 * accuracy, 1))
    });
    let body = format!(
        r#"<figure>{}<figcaption>The small board, touched at recorded poses, with one thing changed for the pegs and the holes, or for the holes alone where its
report says so. Marked in red: after as many touches clearly below the plain board (the intervals do not meet). Place and angle: mean errors after the
last touch. Sure and wrong: of the stops for confidence. No number of the paper stands beside these.</figcaption></figure>"#,
        sortable(&heads, &rows)
    );
    Told::new(SHORT, title, body, format!("{SHORT}: {line}"))
}

fn at(evaluation: &Evaluation, n_touches: usize) -> Option<&Row> {
    cell::row_of(&leading_filter(evaluation, Poses::OnGrid)?, n_touches)
}

fn row(name: String, evaluation: &Evaluation, baseline: &Evaluation) -> Vec<String> {
    let share = |n: &usize| {
        at(evaluation, *n).map_or(String::new(), |row| {
            let [low, high] = row.accuracy_ci95;
            let is_below = at(baseline, *n).is_some_and(|plain| high < plain.accuracy_ci95[0]);
            let class = if is_below { r#" class="wrong""# } else { "" };
            let interval = format!("{}–{}", number(100.0 * low, 1), number(100.0 * high, 1));
            format!("<span{class}>{}</span><small>{interval}</small>", number(100.0 * row.accuracy, 1))
        })
    };
    let last = leading_filter(evaluation, Poses::OnGrid).and_then(|series| series.rows.last().copied());
    let sure_and_wrong = stops(evaluation).map(|stops| stops.confident_and_wrong);
    let error = |of: fn(&Row) -> f64, decimals| number(last.map_or(f64::NAN, of), decimals);
    std::iter::once(name)
        .chain(TOUCHES.iter().map(share))
        .chain([
            error(|row| row.xy_mm_mean, 2),
            error(|row| row.theta_deg_mean, 1),
            number(100.0 * sure_and_wrong.unwrap_or(f64::NAN), 1),
            evaluation.n_episodes.to_string(),
        ])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;

    #[test]
    fn a_change_that_clearly_costs_is_marked() {
        let made = |accuracy| evaluation("x", 0.5, &[(1, 0.9), (3, accuracy)]);
        let found = of(&[("small", made(0.99)), ("robust-dim", made(0.98)), ("robust-d<rk", made(0.9))]);
        let told = tell(&found);
        assert_eq!(told.line, "Robustness: after 3 touches 90.0 % or more, the least with d<rk");
        let html = told.section.html();
        assert_eq!(html.matches(r#"<span class="wrong">"#).count(), 1);
        assert!(html.contains("d&lt;rk") && html.contains(r#"<span class="wrong">90.0</span>"#));
    }
}
