//! A chart with logarithmic axes: an error over what drives it, and the error that is explained.

use maud::{Markup, html};

use super::case::{Case, Group};
use crate::page::axes::{Area, Frame, path};
use crate::page::curves::{Marker, entry, mark};

const AREA: Area = Area { width: 520.0, height: 330.0, left: 58.0 };

/// The style of each variant of a group, in order.
const STYLES: [(&str, Marker); 6] = [
    ("information", Marker::Circle),
    ("paper-rule", Marker::Square),
    ("random", Marker::Triangle),
    ("moco", Marker::Diamond),
    ("pixel", Marker::Cross),
    ("reference", Marker::Circle),
];

/// Below this an error is drawn as this: f64 has no more digits, and zero has no logarithm.
const SMALLEST: f64 = 1e-16;
/// Above this a bound says nothing.
const LARGEST: f64 = 10.0;

/// The cases of a group as curves over [`Case::at`], and what the curves are.
pub fn plot(cases: &[Case], group: Group) -> Markup {
    let cases: Vec<&Case> = cases.iter().filter(|case| case.group == group && case.error.is_some()).collect();
    let mut variants: Vec<&str> = cases.iter().map(|case| case.variant.as_str()).collect();
    variants.dedup();
    let ats = || cases.iter().filter_map(|case| case.at).map(f64::log10);
    let (first, last) = (ats().fold(f64::INFINITY, f64::min).floor(), ats().fold(f64::NEG_INFINITY, f64::max).ceil());
    let errors = cases.iter().filter_map(|case| case.error).map(|error| error.max(SMALLEST).log10());
    let lowest = errors.fold(0.0, f64::min).floor();
    let decades =
        |from: f64, to: f64| (from as i32..=to as i32).map(|power| (10.0_f64.powi(power), format!("1e{power}")));
    let range = |from: f64, to: f64| [10.0_f64.powf(from), 10.0_f64.powf(to)];
    let last = last.max(first + 1.0);
    let even = decades(lowest, LARGEST.log10()).filter(|(value, _)| value.log10().round() as i32 % 2 == 0);
    let title = format!("error over {}", group.axis());
    let frame = Frame {
        title: &title,
        x_name: group.axis(),
        area: AREA,
        x: AREA.x_axis(range(first, last), 0.0).log().without_grid().with_ticks(decades(first, last)),
        y: AREA.y_axis(range(lowest, LARGEST.log10())).log().with_ticks(even),
    };
    let curves = || variants.iter().zip(STYLES).map(|(variant, (class, marker))| (*variant, class, marker));
    let marks = html! {
        @for (variant, class, marker) in curves() {
            @let of_variant: Vec<&Case> = cases.iter().copied().filter(|case| case.variant == variant).collect();
            @let bounds = places(&frame, &of_variant, |case| case.bound.filter(|bound| *bound <= LARGEST));
            @let errors = places(&frame, &of_variant, |case| case.error);
            @if bounds.len() > 1 {
                g class={ (class) " particle" } { path.line d=(path(bounds.iter().map(|(at, _)| *at))) {} }
            }
            g class=(class) {
                path.line d=(path(errors.iter().map(|(at, _)| *at))) {}
                @for (at, error) in &errors {
                    path.mark d=(mark(marker, *at)) { title { (variant) ": " (format!("{error:.1e}")) } }
                }
            }
        }
    };
    html! {
        div {
            p { (title) }
            (frame.svg(&marks))
            ul.legend { @for (variant, class, marker) in curves() { (entry(class, marker, true, variant)) } }
        }
    }
}

/// Where a value of each case is drawn, with the value.
fn places(frame: &Frame<'_>, cases: &[&Case], value: impl Fn(&Case) -> Option<f64>) -> Vec<([f64; 2], f64)> {
    let place = |case: &&Case| {
        let value = value(case)?;
        Some(([frame.x.at(case.at?), frame.y.at(value.min(LARGEST))], value))
    };
    cases.iter().filter_map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_the_error_is_one_decade_lower() {
        let case = |at: f64, error| Case::measured(Group::Particles, "v", "", error, f64::INFINITY).at(at);
        let svg = plot(&[case(1.0, 1.0), case(10.0, 0.1), case(100.0, 0.01)], Group::Particles).0;
        // Two decades over the width; three from 1e-2 to 10 over the height.
        let (step_x, step_y) = ((AREA.right() - AREA.left) / 2.0, (AREA.bottom() - AREA.top()) / 3.0);
        let points: Vec<String> = (0..3)
            .map(f64::from)
            .map(|n| format!("{:.1} {:.1}", AREA.left + n * step_x, AREA.top() + (1.0 + n) * step_y))
            .collect();
        assert!(svg.contains(&format!("M{}\"", points.join("L"))), "{svg} {points:?}");
    }

    #[test]
    fn an_error_beyond_the_chart_is_drawn_at_its_top() {
        let case = |at: f64, error| Case::measured(Group::Temperature, "v", "", error, f64::INFINITY).at(at);
        let svg = plot(&[case(1.0, 1e20), case(10.0, 0.1)], Group::Temperature).0;
        assert!(svg.contains(&format!("M{:.1} {:.1}L", AREA.left, AREA.top())) && svg.contains("1.0e20"), "{svg}");
    }

    #[test]
    fn no_error_at_all_is_drawn_at_the_bottom() {
        let svg = plot(&[Case::measured(Group::Classes, "v", "", 0.0, 1.0).at(1.0)], Group::Classes).0;
        assert!(svg.contains(&format!("{:.1}", AREA.bottom())) && !svg.contains("NaN") && !svg.contains(" inf"));
    }
}
