//! The frame of a chart: two axes with their ticks, and where values are on them.

use maud::{Markup, html};

use super::numbers::number;

const TOP: f64 = 14.0;
/// From the plot to the picture's edge: on the right, and below for the ticks and the name of the axis.
const MARGIN: [f64; 2] = [12.0, 44.0];

/// The size of a chart, pixels of its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// Width of the whole.
    pub width: f64,
    /// Height of the whole.
    pub height: f64,
    /// Where the plot begins, after the ticks of the y axis.
    pub left: f64,
}

impl Area {
    /// The right edge of the plot.
    pub fn right(&self) -> f64 {
        self.width - MARGIN[0]
    }

    /// The upper edge of the plot.
    pub fn top(&self) -> f64 {
        TOP
    }

    /// The lower edge of the plot.
    pub fn bottom(&self) -> f64 {
        self.height - MARGIN[1]
    }

    /// An axis to the right over a range; its ends may be set in from the plot's edges.
    pub fn x_axis(&self, range: [f64; 2], inset: f64) -> Axis {
        Axis::new(range, [self.left + inset, self.right() - inset])
    }

    /// An axis upwards over a range.
    pub fn y_axis(&self, range: [f64; 2]) -> Axis {
        Axis::new(range, [self.bottom(), self.top()])
    }
}

/// An axis: a range of values over a range of pixels.
#[derive(Clone, Debug)]
pub struct Axis {
    range: [f64; 2],
    ends: [f64; 2],
    is_log: bool,
    has_grid: bool,
    ticks: Vec<(f64, String)>,
}

impl Axis {
    fn new(range: [f64; 2], ends: [f64; 2]) -> Self {
        Self { range, ends, is_log: false, has_grid: true, ticks: Vec::new() }
    }

    /// The same in logarithms; the range is positive.
    pub fn log(self) -> Self {
        Self { is_log: true, ..self }
    }

    /// The same without lines through its ticks.
    pub fn without_grid(self) -> Self {
        Self { has_grid: false, ..self }
    }

    /// The same with ticks.
    pub fn with_ticks(self, ticks: impl IntoIterator<Item = (f64, String)>) -> Self {
        Self { ticks: ticks.into_iter().collect(), ..self }
    }

    /// The same with a tick at each multiple of a step.
    pub fn with_steps(self, step: f64) -> Self {
        let [first, last] = self.range.map(|bound| (bound / step).round() as i64);
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        self.with_ticks((first..=last).map(|tick| (tick as f64 * step, number(tick as f64 * step, decimals))))
    }

    /// Where a value is, pixels; at an end where it is beyond.
    pub fn at(&self, value: f64) -> f64 {
        let ([low, high], [start, end]) = (self.range, self.ends);
        let scaled = |value: f64| if self.is_log { value.log10() } else { value };
        start + (end - start) * (scaled(value.clamp(low, high)) - scaled(low)) / (scaled(high) - scaled(low))
    }
}

/// A chart before its marks are drawn.
pub struct Frame<'a> {
    /// What it shows.
    pub title: &'a str,
    /// Name and unit of the x axis.
    pub x_name: &'a str,
    /// Its size.
    pub area: Area,
    /// The x axis.
    pub x: Axis,
    /// The y axis.
    pub y: Axis,
}

impl Frame<'_> {
    /// The chart with its marks, as SVG.
    pub fn svg(&self, marks: &Markup) -> Markup {
        let Self { title, x_name, area, x, y } = self;
        html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (area.width) " " (area.height) } role="img" aria-label=(title) {
                @for (value, name) in &y.ticks {
                    @let at = y.at(*value);
                    @let class = if *value == 0.0 && y.range[0] < 0.0 { "grid zero" } else { "grid" };
                    @if y.has_grid { path class=(class) d={ "M" (area.left) " " (px(at)) "H" (area.right()) } {} }
                    text.end x=(area.left - 6.0) y=(px(at + 4.0)) { (name) }
                }
                @for (value, name) in &x.ticks {
                    @if x.has_grid { path.grid d={ "M" (px(x.at(*value))) " " (area.top()) "V" (area.bottom()) } {} }
                    text.middle x=(px(x.at(*value))) y=(area.bottom() + 18.0) { (name) }
                }
                text.middle.axis x=((area.left + area.right()) / 2.0) y=(area.height - 7.0) { (x_name) }
                (marks)
            }
        }
    }
}

/// A number of pixels.
pub fn px(value: f64) -> String {
    format!("{value:.1}")
}

/// Places in pixels as a path from the first to the last.
pub fn path(places: impl IntoIterator<Item = [f64; 2]>) -> String {
    let places: Vec<_> = places.into_iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect();
    format!("M{}", places.join("L"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Area = Area { width: 112.0, height: 158.0, left: 0.0 };

    #[test]
    fn equal_steps_or_equal_ratios_are_equally_far_apart() {
        let (x, y) = (AREA.x_axis([1.0, 100.0], 0.0).log(), AREA.y_axis([0.0, 20.0]));
        assert_eq!([1.0, 10.0, 100.0].map(|value| x.at(value).round()), [0.0, 50.0, 100.0]);
        assert_eq!([0.0, 5.0, 20.0, 99.0].map(|value| y.at(value)), [114.0, 89.0, 14.0, 14.0]);
    }

    #[test]
    fn an_axis_goes_below_zero_and_marks_it() {
        let y = AREA.y_axis([-20.0, 40.0]).with_steps(20.0);
        let frame = Frame { title: "a < b", x_name: "x", area: AREA, x: AREA.x_axis([0.0, 1.0], 0.0), y };
        let svg = frame.svg(&html! {}).0;
        // A third of the height from the bottom.
        assert!(svg.contains(r#"<path class="grid zero" d="M0 80.7H100">"#), "{svg}");
        assert!(svg.contains(">−20<") && svg.contains(">40<") && svg.contains("a &lt; b"), "{svg}");
    }
}
