//! A chart over the steps as SVG, coloured by the page's style.

use std::fmt::Write;

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 250.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 500.0;
const TOP: f64 = 18.0;
const BOTTOM: f64 = 206.0;

/// Most points that a line is drawn with: a pixel and a half each. Longer ones become means of neighbours.
const MAX_POINTS: usize = 300;

/// A curve over the steps.
pub struct Line<'a> {
    /// Its name, drawn at its end where there are several.
    pub label: &'a str,
    /// Class of the style: colour and dash.
    pub class: &'a str,
    /// Steps and values, ascending.
    pub points: Vec<(usize, f64)>,
}

/// A level to hold a curve against.
pub struct Level<'a> {
    /// What it is.
    pub label: &'a str,
    /// Where it lies.
    pub value: f64,
}

/// Draws lines over steps 0 to `n_steps`. The axis spans nought, the lines and the level; `None` where there
/// is nothing to draw.
pub fn chart(title: &str, lines: &[Line<'_>], level: Option<&Level<'_>>, n_steps: usize) -> Option<String> {
    let lines: Vec<_> = lines.iter().map(|line| (line, thinned(&line.points))).collect();
    let values = lines.iter().flat_map(|(_, points)| points).map(|point| point.1);
    let values: Vec<f64> = values.chain(level.map(|level| level.value)).filter(|value| value.is_finite()).collect();
    if lines.iter().all(|(_, points)| points.is_empty()) {
        return None;
    }
    let (low, high) = values.iter().fold((0.0_f64, 0.0_f64), |(low, high), value| (low.min(*value), high.max(*value)));
    let tick = tick_step(high - low);
    let [bottom, top] = [(low / tick + 1e-9).floor() * tick, ((high / tick - 1e-9).ceil() * tick).max(low + tick)];
    let x = |step: f64| LEFT + (RIGHT - LEFT) * step / n_steps.max(1) as f64;
    let y = |value: f64| BOTTOM - (BOTTOM - TOP) * (value - bottom) / (top - bottom);

    let mut svg = format!(r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img" "#);
    add(&mut svg, format_args!(r#"aria-label="{}">"#, escape(title)));
    for i in 0..=((top - bottom) / tick).round() as usize {
        let value = bottom + i as f64 * tick;
        let at = y(value);
        add(&mut svg, format_args!(r#"<path class="grid" d="M{LEFT} {at:.1}H{RIGHT}"/>"#));
        let (label, value) = (LEFT - 6.0, number(value, tick));
        add(&mut svg, format_args!(r#"<text class="end" x="{label}" y="{:.1}">{value}</text>"#, at + 4.0));
    }
    let step_tick = tick_step(n_steps as f64).max(1.0);
    for i in 0..=(n_steps as f64 / step_tick) as usize {
        let (at, label) = (x(i as f64 * step_tick), number(i as f64 * step_tick, 1.0));
        add(&mut svg, format_args!(r#"<text class="middle" x="{at:.1}" y="{}">{label}</text>"#, BOTTOM + 18.0));
    }
    let middle = (LEFT + RIGHT) / 2.0;
    add(&mut svg, format_args!(r#"<text class="middle" x="{middle}" y="{}">steps</text>"#, HEIGHT - 8.0));
    if let Some(level) = level {
        let (at, label) = (y(level.value), escape(level.label));
        add(&mut svg, format_args!(r#"<path class="reference" d="M{LEFT} {at:.1}H{RIGHT}"/>"#));
        add(&mut svg, format_args!(r#"<text class="end" x="{RIGHT}" y="{:.1}">{label}</text>"#, at - 5.0));
    }
    let mut labelled: Vec<f64> = Vec::new();
    for (line, points) in &lines {
        let places: Vec<String> = points.iter().map(|(step, v)| format!("{:.1} {:.1}", x(*step), y(*v))).collect();
        add(&mut svg, format_args!(r#"<g class="{}"><path class="line" d="M{}"/>"#, line.class, places.join("L")));
        let Some(last) = points.last() else { continue };
        let (cx, cy) = (x(last.0), y(last.1));
        add(&mut svg, format_args!(r#"<circle class="mark" cx="{cx:.1}" cy="{cy:.1}" r="3.5"/>"#));
        if lines.len() > 1 {
            // On the side of the last point where there is room.
            let (anchor, at) = if cx > middle { ("label end", cx - 8.0) } else { ("label", cx + 8.0) };
            let label = escape(line.label);
            let up = free_height(cy, &labelled);
            labelled.push(up);
            add(&mut svg, format_args!(r#"<text class="{anchor}" x="{at:.1}" y="{up:.1}">{label}</text>"#));
        }
        svg.push_str("</g>");
    }
    Some(svg + "</svg>")
}

/// The height nearest above or below a line's end at which its label covers no other label.
fn free_height(end: f64, labelled: &[f64]) -> f64 {
    const SPACING: f64 = 15.0;
    let places = (0..8).flat_map(|k| [end - 7.0 - SPACING * f64::from(k), end + 17.0 + SPACING * f64::from(k)]);
    let is_free =
        |up: &f64| (TOP + 9.0..BOTTOM).contains(up) && labelled.iter().all(|other| (other - up).abs() >= SPACING - 1.0);
    places.into_iter().find(is_free).unwrap_or(end)
}

/// At most [`MAX_POINTS`] means of neighbouring points; what is no number is left out.
fn thinned(points: &[(usize, f64)]) -> Vec<(f64, f64)> {
    let points: Vec<_> = points.iter().filter(|(_, value)| value.is_finite()).collect();
    let means = points.chunks(points.len().div_ceil(MAX_POINTS).max(1)).map(|chunk| {
        let mean = |of: fn(&(usize, f64)) -> f64| chunk.iter().map(|p| of(p)).sum::<f64>() / chunk.len() as f64;
        (mean(|p| p.0 as f64), mean(|p| p.1))
    });
    means.collect()
}

/// The distance between ticks: 1, 2 or 5 times a power of ten, so that there are at most five.
fn tick_step(span: f64) -> f64 {
    let rough = if span > 0.0 { span / 5.0 } else { 0.2 };
    let power = 10f64.powf(rough.log10().floor());
    let times = [1.0, 2.0, 5.0, 10.0].into_iter().find(|times| times * power >= rough * (1.0 - 1e-9));
    times.unwrap_or(10.0) * power
}

/// A number with the digits that a step of `tick` needs.
pub fn number(value: f64, tick: f64) -> String {
    let digits = (-tick.log10().floor()).clamp(0.0, 8.0) as usize;
    let value = if value.abs() < tick * 1e-6 { 0.0 } else { value };
    format!("{value:.digits$}").replace('-', "\u{2212}")
}

/// Text for HTML.
pub fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Writing into a string never fails.
fn add(svg: &mut String, text: std::fmt::Arguments<'_>) {
    svg.write_fmt(text).ok();
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_at_their_height_and_steps_at_their_place() {
        let line = Line { label: "l", class: "first", points: vec![(0, 0.0), (50, 0.5), (100, 1.0)] };
        let svg = chart("t", &[line], None, 100).unwrap();
        let (x, y) = ((LEFT + RIGHT) / 2.0, (TOP + BOTTOM) / 2.0);
        assert!(svg.contains(&format!("M{LEFT:.1} {BOTTOM:.1}L{x:.1} {y:.1}L{RIGHT:.1} {TOP:.1}")), "{svg}");
    }

    #[test]
    fn labels_of_lines_that_end_together_stand_apart() {
        let mut labelled = Vec::new();
        for end in [TOP, TOP + 1.0, TOP + 1.0, BOTTOM - 1.0, BOTTOM] {
            labelled.push(free_height(end, &labelled));
        }
        let apart = |i: usize, j: usize| (labelled[i] - labelled[j]).abs() >= 14.0;
        assert!((0..5).all(|i| (0..i).all(|j| apart(i, j))), "{labelled:?}");
        assert!(labelled.iter().all(|up| (TOP..BOTTOM).contains(up)), "{labelled:?}");
    }

    #[test]
    fn a_long_line_is_drawn_by_means() {
        let points: Vec<_> = (0..900).map(|step| (step, f64::from(step as u32 % 3))).collect();
        let thin = thinned(&points);
        assert_eq!(thin.len(), 300);
        assert!(thin.iter().all(|(_, value)| (value - 1.0).abs() < 1e-12));
    }

    #[test]
    fn what_is_no_number_is_not_drawn() {
        let line = |points| Line { label: "l", class: "first", points };
        let svg = chart("t", &[line(vec![(1, f64::NAN), (2, f64::INFINITY), (3, -1.0)])], None, 3).unwrap();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(chart("t", &[line(vec![(1, f64::NAN)])], None, 3).is_none());
    }
}
