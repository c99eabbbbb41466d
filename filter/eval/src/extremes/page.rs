//! The cases as one HTML page: no network, no script.

use super::super::report::escape;
use super::super::report::shell::{Section, shell};
use super::Extremes;
use super::case::{Case, Group};
use super::plot::plot;
use super::speed::Timing;

/// What is this page's own.
const STYLE: &str = "th, td { text-align: left; } .n { text-align: right; } .plots { display: grid; \
    grid-template-columns: repeat(auto-fit, minmax(320px, 1fr)); gap: 8px 28px; } \
    .plots p { font-weight: 600; font-size: .9rem; margin: 10px 0 0; } .plots svg:not(.key) { display: block; width: 100%; }";

/// The whole page.
pub fn html(extremes: &Extremes) -> String {
    let (n, n_failed) = (extremes.cases.len(), extremes.n_failed());
    let figures = [
        format!(r#"<div class="tile"><b>{}</b>of {n} cases as expected</div>"#, n - n_failed),
        extremes.timings.iter().map(tile).collect(),
    ];
    let plots: String =
        [Group::Temperature, Group::Particles, Group::Classes].map(|group| plot(&extremes.cases, group)).concat();
    let tables = Group::ALL.iter().map(|group| table(&extremes.cases, *group));
    let smaller = if extremes.quick { " The largest cases were made smaller (--quick)." } else { "" };
    let top = format!(
        r#"<h1>Numbers at their extremes</h1>
<p>Each case drives the filter to an extreme and compares what it believes with a reference: the posterior from its
definition, in f64, by other code. The error is the largest relative error of any state’s probability unless a unit is
given; the bound is what rounding or chance can explain. Random banks of rows that are alike, seed {}.{smaller}</p>
<div class="tiles">{}</div>
"#,
        extremes.seed,
        figures.concat()
    );
    let plots = format!(
        r#"<figure><div class="plots">{plots}</div><figcaption>Marks: measured errors. Dashed: bounds. Banks kept in f16 are
compared with the f64 reference of their unrounded rows.</figcaption></figure>"#
    );
    let sections: Vec<_> =
        std::iter::once(Section::new("Errors", "Errors and their bounds", plots)).chain(tables).collect();
    shell("Tactile-Filter: numbers at their extremes", STYLE, &top, &sections, &[])
}

fn tile(timing: &Timing) -> String {
    let target = match timing.target_ms {
        Some([half, most]) => format!("; aimed at {half} and {most}&nbsp;ms"),
        None => String::new(),
    };
    let Timing { what, n, p50_ms, p99_ms, .. } = timing;
    format!(
        r#"<div class="tile"><b>{p50_ms:.2}&nbsp;ms</b>{}, one thread: half of {n} within this, 99 of 100 within {p99_ms:.2}&nbsp;ms{target}</div>"#,
        escape(what)
    )
}

fn table(cases: &[Case], group: Group) -> Section {
    let rows: String = cases.iter().filter(|case| case.group == group).map(row).collect();
    let body = format!(
        r#"<div class="scroll"><table><thead><tr><th>Case</th><th class="n">{}</th><th>Expected</th>
<th class="n">Error</th><th class="n">Bound</th><th>Right part</th><th>Verdict</th></tr></thead><tbody>{rows}</tbody></table></div>
"#,
        group.axis()
    );
    Section::new(group.title(), group.title(), body)
}

fn row(case: &Case) -> String {
    let small = |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.1e}"));
    let bound = if case.error.is_some() && case.bound.is_none() { "any".into() } else { small(case.bound) };
    let right = case.right_part.map_or("", |right| if right { "kept" } else { "lost" });
    let (class, verdict) = match (&case.refused, case.holds) {
        (Some(_), true) => ("right", "refused"),
        (_, true) => ("right", "holds"),
        (_, false) => ("wrong", "fails"),
    };
    let said = case.refused.as_ref().map_or(String::new(), |said| format!("<small>{}</small>", escape(said)));
    format!(
        r#"<tr><td>{}</td><td class="n">{}</td><td>{}{said}</td><td class="n">{}</td><td class="n">{bound}</td><td>{right}</td><td class="{class}">{verdict}</td></tr>"#,
        escape(&case.variant),
        case.at.map_or(String::new(), at),
        escape(&case.expected),
        small(case.error),
    )
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
    fn the_page_needs_nothing_else_and_tells_each_verdict() {
        let came = Err::<(), _>(Error::invalid("touch", "a < b", "NaN"));
        let cases = vec![
            Case::measured(Group::Temperature, "f32", "the same", 1e-7, 1e-6).at(0.01),
            Case::measured(Group::Temperature, "f32", "the same", f64::NAN, 1e-6).at(0.1),
            Case::refused(Group::Similarity, "a row with NaN", came),
        ];
        let timing = Timing { what: "update".into(), n: 3, p50_ms: 0.25, p99_ms: 1.5, target_ms: Some([0.5, 1.0]) };
        let html = html(&Extremes { schema: SCHEMA.into(), seed: 1, quick: false, cases, timings: vec![timing] });
        for word in [
            ">holds<",
            ">fails<",
            ">refused<",
            "expected a &lt; b, got NaN",
            "<b>0.25&nbsp;ms</b>update",
            "<b>2</b>of 3",
        ] {
            assert!(html.contains(word), "{word}");
        }
        for outside in ["http:", "https:", "<script", "<link"] {
            assert!(!html.replace("http://www.w3.org/2000/svg", "").contains(outside));
        }
        for tag in ["table", "tr", "td", "svg", "g", "div", "p", "text", "ul", "li"] {
            let open = html.matches(&format!("<{tag} ")).count() + html.matches(&format!("<{tag}>")).count();
            assert_eq!(open, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
