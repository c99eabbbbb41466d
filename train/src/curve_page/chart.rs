//! A chart over the steps as SVG, coloured by the page's style.

use maud::{Markup, html};

const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 250.0;
const LEFT: f64 = 58.0;
const RIGHT: f64 = 500.0;
const TOP: f64 = 18.0;
const BOTTOM: f64 = 206.0;
const MIDDLE: f64 = (LEFT + RIGHT) / 2.0;

/// Most points of a line, one and a half pixels each. Longer lines are drawn by means of neighbours.
const MAX_POINTS: usize = 300;

/// Lines over steps 0 to `n_steps`, with a title and what to look for.
pub struct Chart<'a> {
    /// What is drawn.
    pub title: &'a str,
    /// What a good run looks like.
    pub look: &'a str,
    /// A level to compare the lines with, and its name.
    pub level: Option<(&'a str, f64)>,
    /// The lines.
    pub lines: Vec<Line<'a>>,
    /// Steps of the whole run.
    pub n_steps: usize,
}

/// A curve over the steps.
pub struct Line<'a> {
    /// Its name, drawn at its end where there are several.
    pub label: &'a str,
    /// Class of the style: colour and dash.
    pub class: &'a str,
    /// Steps and values, ascending.
    pub points: Vec<(usize, f64)>,
}

impl Chart<'_> {
    /// The chart as a figure, empty where there is nothing to draw.
    pub fn figure(&self) -> Markup {
        let lines: Vec<_> = self.lines.iter().map(|line| (line, thinned(&line.points))).collect();
        if lines.iter().all(|(_, points)| points.is_empty()) {
            return html! {};
        }
        let ends = self.n_steps as f64;
        let x = |step: f64| LEFT + (RIGHT - LEFT) * step / ends.max(1.0);
        let ticks = Ticks::over(
            lines.iter().flat_map(|(_, points)| points).map(|point| point.1).chain(self.level.map(|level| level.1)),
        );
        let step_tick = tick_step(ends).max(1.0);
        html! {
            figure {
                p { (self.title) }
                svg xmlns="http://www.w3.org/2000/svg" viewBox={ "0 0 " (WIDTH) " " (HEIGHT) } role="img" aria-label=(self.title) {
                    @for value in ticks.values() {
                        path class="grid" d={ "M" (LEFT) " " (place(ticks.y(value))) "H" (RIGHT) } {}
                        text class="end" x=(LEFT - 6.0) y=(place(ticks.y(value) + 4.0)) { (number(value, ticks.step)) }
                    }
                    @for step in (0..=(ends / step_tick) as usize).map(|i| i as f64 * step_tick) {
                        text class="middle" x=(place(x(step))) y=(BOTTOM + 18.0) { (number(step, 1.0)) }
                    }
                    text class="middle" x=(MIDDLE) y=(HEIGHT - 8.0) { "steps" }
                    @if let Some((label, value)) = self.level {
                        path class="reference" d={ "M" (LEFT) " " (place(ticks.y(value))) "H" (RIGHT) } {}
                        text class="end" x=(RIGHT) y=(place(ticks.y(value) - 5.0)) { (label) }
                    }
                    (drawn(&lines, &x, &ticks))
                }
                figcaption { (self.look) }
            }
        }
    }
}

/// The lines with their names at their ends.
fn drawn(lines: &[(&Line<'_>, Vec<(f64, f64)>)], x: &dyn Fn(f64) -> f64, ticks: &Ticks) -> Markup {
    let mut labelled: Vec<f64> = Vec::new();
    html! {
        @for (line, points) in lines {
            @let at: Vec<[f64; 2]> = points.iter().map(|(step, value)| [x(*step), ticks.y(*value)]).collect();
            g class=(line.class) {
                path class="line" d={ "M" (at.iter().map(|[x, y]| format!("{x:.1} {y:.1}")).collect::<Vec<_>>().join("L")) } {}
                @if let Some([cx, cy]) = at.last() {
                    circle class="mark" cx=(place(*cx)) cy=(place(*cy)) r="3.5" {}
                    @if lines.len() > 1 {
                        // On the side of the last point where there is room.
                        @let (anchor, cx) = if *cx > MIDDLE { ("label end", cx - 8.0) } else { ("label", cx + 8.0) };
                        @let up = free_height(*cy, &labelled);
                        @let () = labelled.push(up);
                        text class=(anchor) x=(place(cx)) y=(place(up)) { (line.label) }
                    }
                }
            }
        }
    }
}

/// The value axis: round numbers from `bottom` to `top`.
struct Ticks {
    bottom: f64,
    top: f64,
    step: f64,
}

impl Ticks {
    /// An axis that spans zero and all finite values.
    fn over(values: impl Iterator<Item = f64>) -> Self {
        let finite = values.filter(|value| value.is_finite());
        let (low, high) = finite.fold((0.0_f64, 0.0_f64), |(low, high), value| (low.min(value), high.max(value)));
        let step = tick_step(high - low);
        let top = ((high / step - 1e-9).ceil() * step).max(low + step);
        Self { bottom: (low / step + 1e-9).floor() * step, top, step }
    }

    fn values(&self) -> impl Iterator<Item = f64> {
        let n = ((self.top - self.bottom) / self.step).round() as usize;
        (0..=n).map(|i| self.bottom + i as f64 * self.step)
    }

    fn y(&self, value: f64) -> f64 {
        BOTTOM - (BOTTOM - TOP) * (value - self.bottom) / (self.top - self.bottom)
    }
}

fn place(pixels: f64) -> String {
    format!("{pixels:.1}")
}

/// The height next to a line's end at which its label covers no other label.
fn free_height(end: f64, labelled: &[f64]) -> f64 {
    const SPACING: f64 = 15.0;
    let places = (0..8).flat_map(|k| [end - 7.0 - SPACING * f64::from(k), end + 17.0 + SPACING * f64::from(k)]);
    let is_free =
        |up: &f64| (TOP + 9.0..BOTTOM).contains(up) && labelled.iter().all(|other| (other - up).abs() >= SPACING - 1.0);
    places.into_iter().find(is_free).unwrap_or(end)
}

/// At most [`MAX_POINTS`] means of neighbouring points; values that are not finite are left out.
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
fn number(value: f64, tick: f64) -> String {
    let digits = (-tick.log10().floor()).clamp(0.0, 8.0) as usize;
    let value = if value.abs() < tick * 1e-6 { 0.0 } else { value };
    format!("{value:.digits$}").replace('-', "\u{2212}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn figure(line: Line<'_>, n_steps: usize) -> String {
        Chart { title: "t", look: "l", level: None, lines: vec![line], n_steps }.figure().into_string()
    }

    #[test]
    fn values_are_drawn_at_their_height_and_steps_at_their_place() {
        let line = Line { label: "l", class: "first", points: vec![(0, 0.0), (50, 0.5), (100, 1.0)] };
        let svg = figure(line, 100);
        let (x, y) = ((LEFT + RIGHT) / 2.0, (TOP + BOTTOM) / 2.0);
        assert!(svg.contains(&format!("M{LEFT:.1} {BOTTOM:.1}L{x:.1} {y:.1}L{RIGHT:.1} {TOP:.1}")), "{svg}");
    }

    #[test]
    fn labels_of_lines_that_end_together_do_not_overlap() {
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
    fn what_is_not_finite_is_not_drawn() {
        let line = |points| Line { label: "l", class: "first", points };
        let svg = figure(line(vec![(1, f64::NAN), (2, f64::INFINITY), (3, -1.0)]), 3);
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert_eq!(figure(line(vec![(1, f64::NAN)]), 3), "");
    }
}
