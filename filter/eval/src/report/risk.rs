//! What a lower rate of strangers costs: touches, robot seconds, holes left undecided.

use maud::{Markup, html};
use tactile_filter::budget::{Knob, Point, Strangers, Tradeoff};

use super::knobs::{KNOBS, told};
use crate::page::numbers::{interval, number, over, percent};
use crate::page::shell::figure;
use crate::page::table::{cells, sortable};
use crate::statistics::share::wilson_95;

/// Settings that differ in the rate of strangers alone, the highest rate first, each after the most touches measured; none with
/// one rate only.
fn by_rate(tradeoff: &Tradeoff) -> Vec<Vec<&Point>> {
    let longest = tradeoff.points.iter().map(|point| point.n_touches).max();
    let compared = || tradeoff.points.iter().filter(|point| Some(point.n_touches) == longest);
    let mut all = Vec::new();
    for base in compared() {
        let differs = |other: &&Point| base.settings.turned(&other.settings) == [Knob::Risk];
        let mut same: Vec<&Point> = compared().filter(differs).chain([base]).collect();
        let rate = |point: &Point| point.settings.false_accept.unwrap_or(1.0);
        same.sort_by(|a, b| rate(b).total_cmp(&rate(a)));
        if same.len() > 1 && !all.contains(&same) {
            all.push(same);
        }
    }
    all
}

/// A table for each setting that was measured at several rates.
pub(super) fn tables(tradeoff: &Tradeoff) -> Markup {
    let all = by_rate(tradeoff);
    if all.is_empty() {
        return html! { p { "Every setting was measured at one rate of strangers." } };
    }
    html! { @for points in all { (table(tradeoff, &points)) } }
}

fn table(tradeoff: &Tradeoff, points: &[&Point]) -> Markup {
    let row = |point: &&Point| {
        let of_all = point.halves.together();
        let strangers = point.strangers.map_or(html! { "–" }, |Strangers { n_episodes, n_named }| {
            over(percent(n_named as f64 / n_episodes as f64), interval(wilson_95(n_named, n_episodes)))
        });
        let wrong = (of_all.n_decided - of_all.n_decided_and_right) as f64 / of_all.n_episodes as f64;
        cells![
            point.settings.false_accept.map_or("not asked".into(), percent),
            number(of_all.touches as f64 / of_all.n_episodes as f64, 1),
            number(of_all.seconds(&tradeoff.speeds), 1),
            percent(of_all.decided_and_right()),
            percent(wrong),
            strangers,
        ]
    };
    let rows: Vec<_> = points.iter().map(row).collect();
    let others: Vec<Knob> = KNOBS.into_iter().filter(|knob| *knob != Knob::Risk).collect();
    let heads = [
        "Strangers asked for, %",
        "Touches",
        "Robot seconds",
        "Decided and right, %",
        "Decided and wrong, %",
        "Strangers named, %",
    ];
    let content = html! {
        h4 { (told(&points[0].settings, &others)) }
        (sortable(&heads, &rows))
    };
    let n_touches = points[0].n_touches;
    let caption = html! {
        "Means and shares of all episodes, of at most " (n_touches) " touches. " b { "Strangers named:" } " the same holes where the "
        "bank lacks their part, ended sure of another; below it the 95 % interval. The rate was fitted to strangers among MAZE "
        "parts and promises nothing of parts that are more alike."
    };
    figure(content, caption)
}

#[cfg(test)]
mod tests {
    use super::super::tradeoff::tests::tradeoff;
    use super::*;
    use maud::Render;

    #[test]
    fn rates_are_compared_where_nothing_else_differs() {
        let mut tradeoff = tradeoff();
        assert!(tables(&tradeoff).render().0.contains("one rate of strangers"));
        for (rate, n_named) in [(0.001, 0), (0.1, 12)] {
            let mut point = tradeoff.points[0].clone();
            point.settings.false_accept = Some(rate);
            point.strangers = Some(Strangers { n_episodes: 100, n_named });
            tradeoff.points.push(point);
        }
        let all = by_rate(&tradeoff);
        let rates: Vec<Option<f64>> = all[0].iter().map(|point| point.settings.false_accept).collect();
        assert_eq!((all.len(), rates), (1, vec![Some(0.1), Some(0.01), Some(0.001)]));
        let html = tables(&tradeoff).render().0;
        // Wilson's interval of 0 of 100, and of 12.
        assert!(html.contains("0.0–3.7") && html.contains("7.0–19.8"), "{html}");
    }
}
