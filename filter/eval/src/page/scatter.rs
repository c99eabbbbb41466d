//! Scatter charts with a logarithmic or plain axis, coloured by the page's style.

use maud::{Markup, html};

use super::axes::{Area, Frame, px};
use super::numbers::number;

const AREA: Area = Area { width: 560.0, height: 340.0, left: 44.0 };

/// One mark.
pub struct Dot {
    /// Its place on the x axis.
    pub x: f64,
    /// Its height.
    pub y: f64,
    /// Classes of the style.
    pub class: &'static str,
    /// What it is, for the pointer and for readers aloud.
    pub label: String,
}

/// A chart.
pub struct Scatter<'a> {
    /// What it shows.
    pub title: &'a str,
    /// Name and unit of the x axis.
    pub x_axis: &'a str,
    /// Whether x is logarithmic.
    pub log_x: bool,
    /// Lowest and highest y, multiples of 20: per cent.
    pub y_range: [f64; 2],
    /// The marks, the later over the earlier.
    pub dots: &'a [Dot],
    /// A line from left to right, that rises in steps.
    pub steps: &'a [[f64; 2]],
}

impl Scatter<'_> {
    /// The chart as SVG; marks without a finite place are left out.
    pub fn svg(&self) -> Markup {
        let scaled = |x: f64| if self.log_x { x.log10() } else { x };
        let is_drawn = |dot: &&Dot| scaled(dot.x).is_finite() && dot.y.is_finite();
        let xs = || self.dots.iter().map(|dot| scaled(dot.x)).filter(|x| x.is_finite());
        let (low, high) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
        let (low, high) = if low < high { (low, high) } else { (low.min(0.0) - 0.5, low.max(0.0) + 0.5) };
        let margin = 0.04 * (high - low);
        let (low, high) = (low - margin, high + margin);
        let x = if self.log_x {
            AREA.x_axis([10f64.powf(low), 10f64.powf(high)], 0.0).log()
        } else {
            AREA.x_axis([low, high], 0.0)
        };
        let x_name = |value: f64| number(value, if value < 0.995 { 1 } else { 0 });
        let x = x.with_ticks(self.x_ticks(low, high).into_iter().map(|value| (value, x_name(value))));
        let y_step = if self.y_range[1] - self.y_range[0] > 40.0 { 20.0 } else { 10.0 };
        let y = AREA.y_axis(self.y_range).with_steps(y_step);
        let frame = Frame { title: self.title, x_name: self.x_axis, area: AREA, x, y };
        let at = |x: f64, y: f64| [px(frame.x.at(x)), px(frame.y.at(y))];
        frame.svg(&html! {
            @if let Some(([x0, y0], rest)) = self.steps.split_first() {
                @let [x0, y0] = at(*x0, *y0);
                path.line.frontier d={
                    "M" (x0) " " (y0) @for [x, y] in rest { @let [x, y] = at(*x, *y); "H" (x) "V" (y) }
                } {}
            }
            @for dot in self.dots.iter().filter(is_drawn) {
                @let [cx, cy] = at(dot.x, dot.y);
                circle class={ "dot " (dot.class) } cx=(cx) cy=(cy) r="4.5" { title { (dot.label) } }
            }
        })
    }

    /// 1, 2 and 5 of each decade, or whole numbers, within a range of the axis as it is drawn.
    fn x_ticks(&self, low: f64, high: f64) -> Vec<f64> {
        if !self.log_x {
            return (low.ceil() as i64..=high.floor() as i64).map(|n| n as f64).collect();
        }
        let decades = low.floor() as i32..=high.ceil() as i32;
        let ticks = decades.flat_map(|decade| [1.0, 2.0, 5.0].map(|of| of * 10f64.powi(decade)));
        ticks.filter(|tick| (low..=high).contains(&tick.log10())).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(x: f64, y: f64) -> Dot {
        Dot { x, y, class: "a", label: "b < c".into() }
    }

    fn chart(dots: &[Dot], log_x: bool) -> String {
        Scatter { title: "t", x_axis: "x, ms", log_x, y_range: [0.0, 100.0], dots, steps: &[] }.svg().0
    }

    #[test]
    fn equal_ratios_are_equally_far_apart_on_a_logarithmic_axis() {
        let html = chart(&[dot(1.0, 50.0), dot(10.0, 50.0), dot(100.0, 50.0)], true);
        let at: Vec<f64> =
            html.split("cx=\"").skip(1).map(|rest| rest[..rest.find('"').unwrap()].parse().unwrap()).collect();
        assert!((at[1] - at[0] - (at[2] - at[1])).abs() < 0.11, "{at:?}");
        assert!(html.contains(">20</text>") && html.contains("b &lt; c"));
    }

    #[test]
    fn one_mark_alone_and_one_without_a_place_are_no_trouble() {
        let html = chart(&[dot(3.0, 50.0), dot(f64::NAN, 1.0), dot(0.0, 1.0)], true);
        assert_eq!(html.matches("<circle").count(), 1);
        assert!(!html.contains("NaN") && !chart(&[dot(2.0, 1.0)], false).contains("NaN"));
    }
}
