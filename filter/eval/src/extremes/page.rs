//! The cases as one HTML page.

use maud::{Markup, html};

use super::Extremes;
use super::case::{Case, Group};
use super::plot::plot;
use super::speed::Timing;
use crate::page::numbers::milliseconds;
use crate::page::shell::{Section, figure, page, tile};

/// The whole page.
pub fn html(extremes: &Extremes) -> String {
    let (n, n_failed) = (extremes.cases.len(), extremes.n_failed());
    let top = html! {
        h1 { "Numbers at their extremes" }
        p {
            "Each case drives the filter to an extreme and compares what it believes with a reference: the posterior from its "
            "definition, in f64, by other code. The error is the largest relative error of any state’s probability unless a unit is "
            "given; the bound is what rounding or chance can explain, and below each it says where it comes from. A bound above 1 "
            "says nothing: such a case shows its error and judges nothing. Random banks of rows that are alike, seed " (extremes.seed) "."
            @if extremes.quick { " The largest cases were made smaller (--quick)." }
        }
        div.tiles {
            (tile(n - n_failed, html! { "of " (n) " cases as expected" }))
            (tile(extremes.n_says_nothing(), html! { "of them with a bound above 1, which says nothing" }))
            @for timing in &extremes.timings { (timing_tile(timing)) }
        }
    };
    let plots = html! {
        div.planes {
            @for group in [Group::Steepness, Group::Temperature, Group::Particles, Group::Classes] {
                (plot(&extremes.cases, group))
            }
        }
    };
    let caption = "Marks: measured errors. Dashed: bounds. A bank in f16 is compared with the f64 reference of its rounded rows and with \
        that of the rows before rounding. Bounds above 10 are not drawn.";
    let plots = Section::new("Errors", "Errors and their bounds", figure(plots, caption));
    let tables = Group::ALL.iter().map(|group| table(&extremes.cases, *group));
    let sections: Vec<_> = std::iter::once(plots).chain(tables).collect();
    page("Tactile-Filter: numbers at their extremes", &top, &sections)
}

fn timing_tile(timing: &Timing) -> Markup {
    let Timing { what, n, p50_ms, p99_ms, target_ms } = timing;
    tile(
        milliseconds(*p50_ms),
        html! {
            (what) ", one thread: half of " (n) " within this, 99 of 100 within " (milliseconds(*p99_ms))
            @if let Some([half, most]) = target_ms { "; aimed at " (half) " and " (most) "\u{a0}ms" }
        },
    )
}

fn table(cases: &[Case], group: Group) -> Section {
    let body = html! {
        div.scroll { table.cases {
            thead { tr {
                th { "Case" } th.n { (group.axis()) } th { "Expected" } th.n { "Error" } th.n { "Bound" } th { "Right part" }
                th { "Verdict" }
            } }
            tbody { @for case in cases.iter().filter(|case| case.group == group) { (row(case)) } }
        } }
    };
    Section::new(group.title(), group.title(), body)
}

fn row(case: &Case) -> Markup {
    let small = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.1e}"));
    let bound = if case.says_nothing { "> 1".into() } else { small(case.bound) };
    let right = case.right_part.map_or("", |right| if right { "kept" } else { "lost" });
    let (class, verdict) = match (&case.refused, case.holds) {
        (Some(_), true) => ("right", "refused"),
        (_, false) => ("wrong", "fails"),
        (_, true) if case.says_nothing => ("", "bound says nothing: > 1"),
        (_, true) => ("right", "holds"),
    };
    html! {
        tr {
            td { (case.variant) }
            td.n { (case.at.map_or(String::new(), at)) }
            td {
                (case.expected)
                @if let Some(refused) = &case.refused { small { (refused) } }
                @if !case.source.is_empty() { small { "bound: " (case.source) } }
            }
            td.n { (small(case.error)) }
            td.n { (bound) }
            td { (right) }
            td class=(class) { (verdict) }
        }
    }
}

/// A place on an axis: short, and exact near half a turn.
fn at(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e5 { format!("{value}") } else { format!("{value:.3e}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Error;
    use crate::extremes::SCHEMA;

    #[test]
    fn the_page_has_each_verdict() {
        let came = Err::<(), _>(Error::invalid("touch", "a < b", "NaN"));
        let cases = vec![
            Case::measured(Group::Steepness, "f32", "the same", 1e-7, 1e-6).at(0.01),
            Case::measured(Group::Steepness, "f32", "the same", f64::NAN, 1e-6).at(0.1),
            Case::refused(Group::Similarity, "a row with NaN", came),
            Case::measured(Group::Precision, "bf16", "the same", 0.2, 7.0).by("rows of 8 bits"),
            Case::measured(Group::Steepness, "f16", "the same", 0.2, f64::INFINITY).at(0.01),
        ];
        let timing = Timing { what: "update".into(), n: 3, p50_ms: 0.25, p99_ms: 1.5, target_ms: Some([0.5, 1.0]) };
        let html = html(&Extremes { schema: SCHEMA.into(), seed: 1, quick: false, cases, timings: vec![timing] });
        for word in [
            ">holds<",
            ">fails<",
            ">refused<",
            "expected a &lt; b, got NaN",
            "<b>0.25\u{a0}ms</b>update",
            "<b>4</b>of 5",
            ">bound says nothing: &gt; 1<",
            "<b>2</b>of them with a bound above 1",
            "bound: rows of 8 bits",
        ] {
            assert!(html.contains(word), "{word}");
        }
    }
}
