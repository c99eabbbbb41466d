//! Scatter charts with a logarithmic or plain axis, coloured by the page's style.

use std::fmt::Write;

use super::{escape, number};

const WIDTH: f64 = 560.0;
const HEIGHT: f64 = 340.0;
const LEFT: f64 = 44.0;
const RIGHT: f64 = 548.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 286.0;

/// One mark.
pub struct Dot {
    /// Where it stands.
    pub x: f64,
    /// Its height.
    pub y: f64,
    /// Classes of the style.
    pub class: String,
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
    pub fn svg(&self) -> String {
        let placed = |x: f64| if self.log_x { x.log10() } else { x };
        let xs = || self.dots.iter().map(|dot| placed(dot.x)).filter(|x| x.is_finite());
        let (low, high) = (xs().fold(f64::INFINITY, f64::min), xs().fold(f64::NEG_INFINITY, f64::max));
        let (low, high) = if low < high { (low, high) } else { (low.min(0.0) - 0.5, low.max(0.0) + 0.5) };
        let margin = 0.04 * (high - low);
        let x = |value: f64| LEFT + (RIGHT - LEFT) * (placed(value) - low + margin) / (high - low + 2.0 * margin);
        let [bottom, top] = self.y_range;
        let y = |value: f64| BOTTOM - (BOTTOM - TOP) * (value.clamp(bottom, top) - bottom) / (top - bottom);
        let mut svg = format!(
            r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" aria-label="{}">"#,
            escape(self.title)
        );
        let mut add = |text: std::fmt::Arguments<'_>| svg.write_fmt(text).unwrap_or(());
        let step = if top - bottom > 40.0 { 20.0 } else { 10.0 };
        for tick in 0..=((top - bottom) / step) as usize {
            let value = bottom + step * tick as f64;
            add(format_args!(r#"<path class="grid" d="M{LEFT} {:.1}H{RIGHT}"/>"#, y(value)));
            let (at, text) = (LEFT - 6.0, number(value, 0));
            add(format_args!(r#"<text class="end" x="{at}" y="{:.1}">{text}</text>"#, y(value) + 4.0));
        }
        for value in self.x_ticks(low - margin, high + margin) {
            let text = number(value, if value < 0.995 { 1 } else { 0 });
            add(format_args!(r#"<path class="grid" d="M{:.1} {TOP}V{BOTTOM}"/>"#, x(value)));
            add(format_args!(r#"<text class="middle" x="{:.1}" y="{}">{text}</text>"#, x(value), BOTTOM + 18.0));
        }
        let (middle, under) = (0.5 * (LEFT + RIGHT), HEIGHT - 8.0);
        add(format_args!(r#"<text class="middle" x="{middle}" y="{under}">{}</text>"#, escape(self.x_axis)));
        if let Some(([x0, y0], rest)) = self.steps.split_first() {
            let mut path = format!("M{:.1} {:.1}", x(*x0), y(*y0));
            for [x1, y1] in rest {
                path.push_str(&format!("H{:.1}V{:.1}", x(*x1), y(*y1)));
            }
            add(format_args!(r#"<path class="line frontier" d="{path}"/>"#));
        }
        for dot in self.dots.iter().filter(|dot| placed(dot.x).is_finite() && dot.y.is_finite()) {
            let (class, label) = (escape(&dot.class), escape(&dot.label));
            let (cx, cy) = (x(dot.x), y(dot.y));
            add(format_args!(
                r#"<circle class="dot {class}" cx="{cx:.1}" cy="{cy:.1}" r="4.5"><title>{label}</title></circle>"#
            ));
        }
        svg + "</svg>"
    }

    /// 1, 2 and 5 of each decade, or whole numbers.
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
        Dot { x, y, class: "a".into(), label: "b < c".into() }
    }

    fn chart(dots: &[Dot], log_x: bool) -> String {
        Scatter { title: "t", x_axis: "x, ms", log_x, y_range: [0.0, 100.0], dots, steps: &[] }.svg()
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
