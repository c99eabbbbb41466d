//! Line charts over the number of touches, coloured by the page's style so that they follow its light or dark theme.

use maud::{Markup, Render, html};
use serde::Deserialize;

use super::axes::{Area, Frame, path, px};
use super::numbers::number;

const AREA: Area = Area { width: 360.0, height: 280.0, left: 40.0 };

/// A curve over the number of touches.
pub struct Line {
    /// What it is, for the pointer and for readers aloud.
    pub label: String,
    /// Classes of the style: colour and dash.
    pub class: String,
    /// The mark at each point.
    pub marker: Marker,
    /// The points, by ascending number of touches.
    pub points: Vec<Point>,
}

/// One point of a curve.
pub struct Point {
    /// Number of touches.
    pub n_touches: usize,
    /// The value, in the chart's unit.
    pub value: f64,
    /// Bounds of its 95 % interval, in the chart's unit.
    pub interval: Option<[f64; 2]>,
}

impl Point {
    /// A share or a difference of shares with its interval, in per cent.
    pub fn percent(n_touches: usize, share: f64, ci95: [f64; 2]) -> Self {
        Self { n_touches, value: 100.0 * share, interval: Some(ci95.map(|bound| 100.0 * bound)) }
    }
}

/// The shape of a mark, so that curves differ without colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Marker {
    /// A disc.
    Circle,
    /// A square.
    Square,
    /// A triangle.
    Triangle,
    /// A square on its corner.
    Diamond,
    /// A cross.
    Cross,
}

/// A chart of `lines`. The axis of values spans `range`, or zero to the largest value, and ends at ticks.
pub fn chart(title: &str, lines: &[Line], range: Option<[f64; 2]>) -> Markup {
    let points = || lines.iter().flat_map(|line| &line.points);
    let highest = points().map(|point| point.value).filter(|value| value.is_finite()).fold(0.0, f64::max);
    let [low, high] = range.unwrap_or([0.0, highest]);
    let step = tick_step(high - low);
    let first_tick = (low / step + 1e-9).floor();
    let last_tick = (high / step - 1e-9).ceil().max(first_tick + 1.0);
    let y = AREA.y_axis([first_tick * step, last_tick * step]).with_steps(step);
    let n_last = points().map(|point| point.n_touches).max().unwrap_or(1);
    let x = AREA.x_axis([1.0, n_last.max(2) as f64], 12.0).without_grid();
    let x = x.with_ticks((1..=n_last).map(|n| (n as f64, n.to_string())));
    let frame = Frame { title, x_name: "touches", area: AREA, x, y };
    frame.svg(&html! { @for line in lines { (drawn(&frame, line)) } })
}

/// A list of curves, each with its mark.
pub fn legend(lines: &[Line]) -> Markup {
    html! {
        ul.legend { @for line in lines { (entry(&line.class, line.marker, line.points.len() > 1, &line.label)) } }
    }
}

/// An entry of a legend: a mark with a piece of its line, as in a chart, and what it is.
pub fn entry(class: &str, marker: Marker, has_line: bool, what: impl Render) -> Markup {
    html! {
        li {
            svg.key viewBox="0 0 30 14" aria-hidden="true" {
                g class=(class) {
                    @if has_line { path.line d="M1 7H29" {} }
                    path.mark d=(mark(marker, [15.0, 7.0])) {}
                }
            }
            (what)
        }
    }
}

fn drawn(frame: &Frame<'_>, line: &Line) -> Markup {
    let points: Vec<&Point> = line.points.iter().filter(|point| point.value.is_finite()).collect();
    let at = |n_touches: usize, value: f64| [frame.x.at(n_touches as f64), frame.y.at(value)];
    let bounds: Option<Vec<_>> = points.iter().map(|point| Some((point.n_touches, point.interval?))).collect();
    html! {
        g class=(line.class) {
            @if let Some(bounds) = bounds.filter(|bounds| bounds.len() > 1) {
                @let lower = bounds.iter().map(|(n, [low, _])| at(*n, *low));
                @let upper = bounds.iter().rev().map(|(n, [_, high])| at(*n, *high));
                path.band d={ (path(lower.chain(upper))) "Z" } {}
            }
            @if points.len() > 1 {
                path.line d=(path(points.iter().map(|point| at(point.n_touches, point.value)))) {}
            }
            @for point in &points {
                @let [x, y] = at(point.n_touches, point.value);
                @if let (Some([low, high]), 1) = (point.interval, line.points.len()) {
                    path.bar d={ "M" (px(x)) " " (px(frame.y.at(low))) "V" (px(frame.y.at(high))) } {}
                }
                path.mark d=(mark(line.marker, [x, y])) {
                    title {
                        (line.label) ", " (point.n_touches) " touches: " (number(point.value, 2))
                        @if let Some([low, high]) = point.interval { " (" (number(low, 2)) " to " (number(high, 2)) ")" }
                    }
                }
            }
        }
    }
}

/// The outline of a mark around a place of the chart.
pub fn mark(marker: Marker, [x, y]: [f64; 2]) -> String {
    match marker {
        Marker::Circle => format!("M{:.1} {y:.1}a4 4 0 1 0 8 0a4 4 0 1 0 -8 0Z", x - 4.0),
        Marker::Square => format!("M{:.1} {:.1}h7v7h-7Z", x - 3.5, y - 3.5),
        Marker::Triangle => format!("M{x:.1} {:.1}l4.7 8.2h-9.4Z", y - 5.2),
        Marker::Diamond => format!("M{x:.1} {:.1}l6 6l-6 6l-6 -6Z", y - 6.0),
        Marker::Cross => format!("M{:.1} {:.1}l8 8m0 -8l-8 8", x - 4.0, y - 4.0),
    }
}

/// The distance between ticks: 1, 2 or 5 times a power of ten, so that there are at most five.
fn tick_step(highest: f64) -> f64 {
    let rough = if highest > 0.0 { highest / 5.0 } else { 1.0 };
    let power = 10f64.powf(rough.log10().floor());
    let factors = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power >= rough * (1.0 - 1e-9));
    factors.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(values: &[f64]) -> Line {
        let point = |(value, n_touches): (&f64, usize)| Point { n_touches, value: *value, interval: None };
        let points = values.iter().zip(1..).map(point).collect();
        Line { label: "l".into(), class: "c".into(), marker: Marker::Square, points }
    }

    #[test]
    fn values_are_drawn_at_their_height() {
        let svg = chart("t", &[line(&[0.0, 50.0, 100.0])], Some([0.0, 100.0])).0;
        let (top, bottom) = (AREA.top(), AREA.bottom());
        let middle = (top + bottom) / 2.0;
        assert!(svg.contains(&format!("M52.0 {bottom:.1}L194.0 {middle:.1}L336.0 {top:.1}")), "{svg}");
    }

    #[test]
    fn an_axis_ends_at_ticks_that_hold_its_range() {
        let svg = chart("t", &[line(&[-10.0, 10.0])], Some([-13.0, 31.0])).0;
        assert!(svg.contains(">−20<") && svg.contains(">40<") && !svg.contains(">-"), "{svg}");
    }

    #[test]
    fn ticks_are_few_and_round() {
        for (highest, step) in [(100.0, 20.0), (4.4, 1.0), (0.7, 0.2), (15.5, 5.0), (26.0, 10.0), (0.0, 1.0)] {
            assert!((tick_step(highest) - step).abs() < 1e-9 * step, "{highest}: {}", tick_step(highest));
        }
    }

    #[test]
    fn what_was_not_measured_is_not_drawn() {
        let svg = chart("t", &[line(&[f64::NAN, 1.0])], None).0;
        assert_eq!(svg.matches("class=\"mark\"").count(), 1);
        assert!(!svg.contains("NaN"));
    }
}
