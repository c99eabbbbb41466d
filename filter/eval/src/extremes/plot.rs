//! A chart with logarithmic axes: an error over what drives it, and the error that is explained.

use std::fmt::Write;

use super::super::report::curves::{Marker, legend_mark, mark};
use super::super::report::escape;
use super::case::{Case, Group};

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 330.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 508.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 280.0;

/// The style of each variant of a group, in order.
const STYLES: [(&str, Marker); 4] = [
    ("information", Marker::Circle),
    ("paper-rule", Marker::Square),
    ("random", Marker::Triangle),
    ("moco", Marker::Diamond),
];

/// Below this an error is drawn as this: f64 has no more digits, and nought has no logarithm.
const SMALLEST: f64 = 1e-16;
/// Above this a bound says nothing.
const LARGEST: f64 = 10.0;

/// The cases of a group as curves over [`Case::at`], and what the curves are.
pub fn plot(cases: &[Case], group: Group) -> String {
    let cases: Vec<&Case> = cases.iter().filter(|case| case.group == group && case.error.is_some()).collect();
    let mut variants: Vec<&str> = cases.iter().map(|case| case.variant.as_str()).collect();
    variants.dedup();
    let decade = |value: f64| value.log10();
    let ats = || cases.iter().filter_map(|case| case.at).map(decade);
    let (first, last) = (ats().fold(f64::INFINITY, f64::min).floor(), ats().fold(f64::NEG_INFINITY, f64::max).ceil());
    let errors = cases.iter().filter_map(|case| case.error).map(|error| decade(error.max(SMALLEST)));
    let lowest = errors.fold(0.0, f64::min).floor();
    let highest = decade(LARGEST);
    let x = |at: f64| LEFT + (RIGHT - LEFT) * (decade(at) - first) / (last - first).max(1.0);
    let y = |error: f64| {
        let height = (decade(error.clamp(SMALLEST, LARGEST)) - lowest) / (highest - lowest);
        BOTTOM - (BOTTOM - TOP) * height.max(0.0)
    };
    let title = format!("error over {}", group.axis());
    let mut svg = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{title}">"#
    );
    let decades = |from: f64, to: f64| (from as i32..=to as i32).map(|power| (power, 10.0_f64.powi(power)));
    for (power, value) in decades(lowest, highest).filter(|(power, _)| power % 2 == 0) {
        let (y, label) = (y(value), LEFT - 6.0);
        add(&mut svg, format_args!(r#"<path class="grid" d="M{LEFT} {y:.1}H{RIGHT}"/>"#));
        add(&mut svg, format_args!(r#"<text class="end" x="{label}" y="{:.1}">1e{power}</text>"#, y + 4.0));
    }
    for (power, value) in decades(first, last) {
        add(
            &mut svg,
            format_args!(r#"<text class="middle" x="{:.1}" y="{}">1e{power}</text>"#, x(value), BOTTOM + 18.0),
        );
    }
    let middle = (LEFT + RIGHT) / 2.0;
    add(
        &mut svg,
        format_args!(r#"<text class="middle axis" x="{middle}" y="{}">{}</text>"#, HEIGHT - 8.0, group.axis()),
    );
    let mut legend = String::new();
    for (variant, (class, marker)) in variants.iter().zip(STYLES) {
        let line = |value: &dyn Fn(&Case) -> Option<f64>| -> Vec<(f64, f64, f64)> {
            let of_variant = cases.iter().filter(|case| case.variant == *variant);
            of_variant.filter_map(|case| Some((x(case.at?), y(value(case)?), value(case)?))).collect()
        };
        let path = |points: &[(f64, f64, f64)]| {
            points.iter().map(|(x, y, _)| format!("{x:.1} {y:.1}")).collect::<Vec<_>>().join("L")
        };
        let bounds = line(&|case| case.bound.filter(|bound| *bound <= LARGEST));
        if bounds.len() > 1 {
            add(
                &mut svg,
                format_args!(r#"<g class="{class} particle"><path class="line" d="M{}"/></g>"#, path(&bounds)),
            );
        }
        let errors = line(&|case| case.error);
        add(&mut svg, format_args!(r#"<g class="{class}"><path class="line" d="M{}"/>"#, path(&errors)));
        for (x, y, error) in errors {
            let tip = format!("{}: {error:.1e}", escape(variant));
            add(&mut svg, format_args!(r#"<path class="mark" d="{}"><title>{tip}</title></path>"#, mark(marker, x, y)));
        }
        svg.push_str("</g>");
        add(&mut legend, format_args!("<li>{}{}</li>", legend_mark(class, marker, true), escape(variant)));
    }
    format!(r#"<div><p>{title}</p>{svg}</svg><ul class="legend">{legend}</ul></div>"#)
}

/// Appends formatted text; a `String` takes all of it.
fn add(text: &mut String, more: std::fmt::Arguments) {
    text.write_fmt(more).ok();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_the_error_is_one_decade_lower() {
        let case = |at: f64, error| Case::measured(Group::Particles, "v", "", error, f64::INFINITY).at(at);
        let svg = plot(&[case(1.0, 1.0), case(10.0, 0.1), case(100.0, 0.01)], Group::Particles);
        // Two decades over the width; three from 1e-2 to 10 over the height.
        let (step_x, step_y) = ((RIGHT - LEFT) / 2.0, (BOTTOM - TOP) / 3.0);
        let points: Vec<String> = (0..3)
            .map(f64::from)
            .map(|n| format!("{:.1} {:.1}", LEFT + n * step_x, TOP + (1.0 + n) * step_y))
            .collect();
        assert!(svg.contains(&format!("M{}\"", points.join("L"))), "{svg} {points:?}");
    }

    #[test]
    fn no_error_at_all_is_drawn_at_the_bottom() {
        let svg = plot(&[Case::measured(Group::Classes, "v", "", 0.0, 1.0).at(1.0)], Group::Classes);
        assert!(svg.contains(&format!("{BOTTOM:.1}")) && !svg.contains("NaN") && !svg.contains(" inf"));
    }
}
