//! Line charts as SVG, coloured by the page's style so that they follow its light or dark theme.

use std::fmt::Write;

use super::{escape, number};

const WIDTH: f64 = 360.0;
const HEIGHT: f64 = 280.0;
const LEFT: f64 = 40.0;
const RIGHT: f64 = 348.0;
const TOP: f64 = 14.0;
const BOTTOM: f64 = 236.0;

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

/// The shape of a mark, so that curves differ without colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// A chart of `lines`. The axis of values spans `range`, or nought to the largest value, and ends at ticks.
pub fn chart(title: &str, lines: &[Line], range: Option<[f64; 2]>) -> String {
    let values = lines.iter().flat_map(|line| &line.points).map(|point| point.value);
    let highest = values.filter(|value| value.is_finite()).fold(0.0, f64::max);
    let [low, high] = range.unwrap_or([0.0, highest]);
    let step = tick_step(high - low);
    let first_tick = (low / step + 1e-9).floor() as i64;
    let last_tick = ((high / step - 1e-9).ceil() as i64).max(first_tick + 1);
    let [bottom, top] = [first_tick, last_tick].map(|tick| tick as f64 * step);
    let n_last = lines.iter().flat_map(|line| &line.points).map(|point| point.n_touches).max().unwrap_or(1);
    let x =
        |n_touches: usize| LEFT + 12.0 + (RIGHT - LEFT - 24.0) * (n_touches as f64 - 1.0) / (n_last.max(2) - 1) as f64;
    let y = |value: f64| BOTTOM - (BOTTOM - TOP) * (value.clamp(bottom, top) - bottom) / (top - bottom);

    let mut svg = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{}">"#,
        escape(title)
    );
    let decimals = (-step.log10().floor()).max(0.0) as usize;
    for tick in first_tick..=last_tick {
        let (value, nought) = (tick as f64 * step, if tick == 0 && bottom < 0.0 { " nought" } else { "" });
        let y = y(value);
        add(&mut svg, format_args!(r#"<path class="grid{nought}" d="M{LEFT} {y:.1}H{RIGHT}"/>"#));
        let (label, value) = (LEFT - 6.0, number(value, decimals));
        add(&mut svg, format_args!(r#"<text class="end" x="{label}" y="{:.1}">{value}</text>"#, y + 4.0));
    }
    for n_touches in 1..=n_last {
        let (x, y) = (x(n_touches), BOTTOM + 17.0);
        add(&mut svg, format_args!(r#"<text class="middle" x="{x:.1}" y="{y}">{n_touches}</text>"#));
    }
    let middle = (LEFT + RIGHT) / 2.0;
    add(&mut svg, format_args!(r#"<text class="middle axis" x="{middle}" y="{}">touches</text>"#, HEIGHT - 6.0));
    for line in lines {
        draw(&mut svg, line, x, y);
    }
    svg + "</svg>"
}

/// A mark with a piece of its line, as in a chart, for a legend.
pub fn legend_mark(class: &str, marker: Marker, has_line: bool) -> String {
    let line = if has_line { r#"<path class="line" d="M1 7H29"/>"# } else { "" };
    let mark = mark(marker, 15.0, 7.0);
    format!(
        r#"<svg class="key" viewBox="0 0 30 14" aria-hidden="true"><g class="{class}">{line}<path class="mark" d="{mark}"/></g></svg>"#
    )
}

fn draw(svg: &mut String, line: &Line, x: impl Fn(usize) -> f64, y: impl Fn(f64) -> f64) {
    let points: Vec<&Point> = line.points.iter().filter(|point| point.value.is_finite()).collect();
    let path = |values: &mut dyn Iterator<Item = (usize, f64)>| {
        let places = values.map(|(n_touches, value)| format!("{:.1} {:.1}", x(n_touches), y(value)));
        places.collect::<Vec<_>>().join("L")
    };
    add(svg, format_args!(r#"<g class="{}">"#, line.class));
    let bounds: Option<Vec<_>> = points.iter().map(|point| Some((point.n_touches, point.interval?))).collect();
    if let Some(bounds) = bounds.filter(|bounds| bounds.len() > 1) {
        let lower = bounds.iter().map(|(n_touches, [low, _])| (*n_touches, *low));
        let upper = bounds.iter().rev().map(|(n_touches, [_, high])| (*n_touches, *high));
        add(svg, format_args!(r#"<path class="band" d="M{}Z"/>"#, path(&mut lower.chain(upper))));
    }
    if points.len() > 1 {
        let d = path(&mut points.iter().map(|point| (point.n_touches, point.value)));
        add(svg, format_args!(r#"<path class="line" d="M{d}"/>"#));
    }
    for point in points {
        let (x, y_mark) = (x(point.n_touches), y(point.value));
        if let (Some([low, high]), 1) = (point.interval, line.points.len()) {
            add(svg, format_args!(r#"<path class="bar" d="M{x:.1} {:.1}V{:.1}"/>"#, y(low), y(high)));
        }
        let interval = point.interval.map(|[low, high]| format!(" ({} to {})", number(low, 2), number(high, 2)));
        let value = number(point.value, 2) + &interval.unwrap_or_default();
        let tip = format!("{}, {} touches: {value}", line.label, point.n_touches);
        let (mark, tip) = (mark(line.marker, x, y_mark), escape(&tip));
        add(svg, format_args!(r#"<path class="mark" d="{mark}"><title>{tip}</title></path>"#));
    }
    svg.push_str("</g>");
}

/// The outline of a mark round a place of the chart.
pub fn mark(marker: Marker, x: f64, y: f64) -> String {
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

/// Appends formatted text; a `String` takes all of it.
fn add(svg: &mut String, text: std::fmt::Arguments) {
    svg.write_fmt(text).ok();
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
    fn values_stand_at_their_height() {
        let svg = chart("t", &[line(&[0.0, 50.0, 100.0])], Some([0.0, 100.0]));
        let middle = (TOP + BOTTOM) / 2.0;
        assert!(svg.contains(&format!("M52.0 {BOTTOM:.1}L194.0 {middle:.1}L336.0 {TOP:.1}")), "{svg}");
    }

    #[test]
    fn an_axis_goes_below_nought_and_marks_it() {
        let svg = chart("t", &[line(&[-10.0, 10.0])], Some([-13.0, 31.0]));
        // Ticks at -20, -10, ..., 40: nought lies a third of the height above the bottom.
        let nought = BOTTOM - (BOTTOM - TOP) / 3.0;
        assert!(svg.contains(&format!(r#"<path class="grid nought" d="M{LEFT} {nought:.1}H"#)), "{svg}");
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
        let svg = chart("t", &[line(&[f64::NAN, 1.0])], None);
        assert_eq!(svg.matches("class=\"mark\"").count(), 1);
        assert!(!svg.contains("NaN"));
    }
}
