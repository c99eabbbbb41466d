//! Whether the filter is right as often as it says: the reliability diagram.

use std::fmt::Write;

use super::super::result::{Evaluation, ReliabilityBin};
use super::curves::{Marker, legend_mark};
use super::number;
use super::shell::Section;
use super::table::sortable;

const SIDE: f64 = 330.0;
const LEFT: f64 = 42.0;
const RIGHT: f64 = 318.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 288.0;

/// "Sure", for the sentence above the diagram: the filter's usual stop probability, 0..=1.
const SURE: f64 = 0.95;

/// The diagram whole and near certainty, and its numbers. Nothing where nothing was counted.
pub fn section(evaluation: &Evaluation, way: &str) -> Option<Section> {
    let bins = &evaluation.reliability;
    if bins.is_empty() {
        return None;
    }
    let row = |bin: &ReliabilityBin| {
        let [low, high] = bin.probability.map(|bound| number(100.0 * bound, 0));
        let [right_low, right_high] = bin.right_ci95.map(|bound| number(100.0 * bound, 1));
        vec![
            format!("{low}–{high}"),
            number(100.0 * bin.mean_probability, 1),
            format!("{}<small>{right_low}–{right_high}</small>", number(100.0 * bin.right, 1)),
            bin.n.to_string(),
        ]
    };
    let rows: Vec<_> = bins.iter().map(row).collect();
    let body = format!(
        r#"<p>{}</p>
<figure><ul class="legend"><li>{}Touches with about that probability, 95 % interval; the more touches, the larger</li><li>{}As right as it says</li></ul>
<div class="charts and-table"><div><p>Right, % against what it says, %</p>{}</div><div><p>The same, near certainty</p>{}</div>
{}</div>
<figcaption>After each touch of each episode ({way}), the probability of the likeliest part against how often that part is right. On the dashed
line the filter is as right as it says; above it, it is more careful than it need be; below it, surer than it should be.
Touches of one episode resemble each other, so the true intervals are somewhat wider.</figcaption></figure>
"#,
        sure(bins),
        legend_mark("information", Marker::Circle, false),
        r#"<svg class="key" viewBox="0 0 30 14" aria-hidden="true"><path class="diagonal" d="M1 7H29"/></svg>"#,
        diagram("Reliability", bins, 0.0),
        diagram("Reliability near certainty", bins, 80.0),
        sortable(&["It says,&nbsp;%", "mean", "right, %", "touches"], &rows),
    );
    Some(Section::new("Sureness", "Is it right as often as it says?", body))
}

/// How often it is right where it says that it is sure.
fn sure(bins: &[ReliabilityBin]) -> String {
    let sure = || bins.iter().filter(|bin| bin.probability[0] >= SURE);
    let n: usize = sure().map(|bin| bin.n).sum();
    if n == 0 {
        return format!("It was never more than {} % sure.", number(100.0 * SURE, 0));
    }
    let right: f64 = sure().map(|bin| bin.right * bin.n as f64).sum();
    format!(
        "Where it is more than {} % sure ({n} touches), it is right in <b>{} %</b>.",
        number(100.0 * SURE, 0),
        number(100.0 * right / n as f64, 1)
    )
}

/// Both axes from `lowest` to 100 %; what lies below is left out, intervals end at the edge.
fn diagram(title: &str, bins: &[ReliabilityBin], lowest: f64) -> String {
    let share = |percent: f64| (percent.clamp(lowest, 100.0) - lowest) / (100.0 - lowest);
    let x = |percent: f64| LEFT + (RIGHT - LEFT) * share(percent);
    let y = |percent: f64| BOTTOM - (BOTTOM - TOP) * share(percent);
    let mut svg = format!(
        r#"<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {SIDE} {SIDE}" role="img" aria-label="{title}">"#
    );
    for tick in 0..=4 {
        let percent = lowest + (100.0 - lowest) * f64::from(tick) / 4.0;
        let (x, y, label) = (x(percent), y(percent), number(percent, 0));
        add(&mut svg, format_args!(r#"<path class="grid" d="M{LEFT} {y:.1}H{RIGHT}M{x:.1} {TOP}V{BOTTOM}"/>"#));
        add(&mut svg, format_args!(r#"<text class="end" x="{}" y="{:.1}">{label}</text>"#, LEFT - 6.0, y + 4.0));
        add(&mut svg, format_args!(r#"<text class="middle" x="{x:.1}" y="{}">{label}</text>"#, BOTTOM + 17.0));
    }
    let middle = (LEFT + RIGHT) / 2.0;
    add(&mut svg, format_args!(r#"<text class="middle axis" x="{middle}" y="{}">it says, %</text>"#, SIDE - 6.0));
    add(&mut svg, format_args!(r#"<path class="diagonal" d="M{LEFT} {BOTTOM}L{RIGHT} {TOP}"/>"#));
    let most = bins.iter().map(|bin| bin.n).max().unwrap_or(1).max(1) as f64;
    svg.push_str(r#"<g class="information">"#);
    for bin in bins.iter().filter(|bin| 100.0 * bin.mean_probability.min(bin.right) >= lowest) {
        let (says, right) = (100.0 * bin.mean_probability, 100.0 * bin.right);
        let [low, high] = bin.right_ci95.map(|bound| y(100.0 * bound));
        let radius = 3.5 + 4.0 * (bin.n as f64 / most).sqrt();
        let tip = format!("says {} %, right in {} % of {} touches", number(says, 1), number(right, 1), bin.n);
        let (x, y) = (x(says), y(right));
        add(&mut svg, format_args!(r#"<path class="bar" d="M{x:.1} {low:.1}V{high:.1}"/>"#));
        add(
            &mut svg,
            format_args!(
                r#"<circle class="dot" cx="{x:.1}" cy="{y:.1}" r="{radius:.1}"><title>{tip}</title></circle>"#
            ),
        );
    }
    svg + "</g></svg>"
}

/// Appends formatted text; a `String` takes all of it.
fn add(svg: &mut String, text: std::fmt::Arguments) {
    svg.write_fmt(text).ok();
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bin(probability: [f64; 2], mean_probability: f64, right: f64, n: usize) -> ReliabilityBin {
        ReliabilityBin { probability, mean_probability, right, right_ci95: [right - 0.1, (right + 0.1).min(1.0)], n }
    }

    #[test]
    fn a_bin_that_is_as_right_as_it_says_stands_on_the_diagonal() {
        let svg = diagram("t", &[bin([0.4, 0.6], 0.5, 0.5, 10)], 0.0);
        let (x, y) = ((LEFT + RIGHT) / 2.0, (TOP + BOTTOM) / 2.0);
        assert!(svg.contains(&format!(r#"cx="{x:.1}" cy="{y:.1}""#)), "{svg}");
        // From 40 to 60 %: a fifth of the height, about the middle.
        let tenth = (BOTTOM - TOP) / 10.0;
        assert!(svg.contains(&format!("M{x:.1} {:.1}V{:.1}", y + tenth, y - tenth)), "{svg}");
    }

    #[test]
    fn near_certainty_only_what_lies_there_is_shown() {
        let bins = [bin([0.4, 0.6], 0.5, 0.5, 10), bin([0.8, 0.9], 0.9, 0.9, 10), bin([0.9, 1.0], 0.95, 0.7, 10)];
        let svg = diagram("t", &bins, 80.0);
        assert_eq!(svg.matches("<circle").count(), 1);
        assert!(svg.contains(&format!(r#"cx="{:.1}""#, (LEFT + RIGHT) / 2.0)));
    }

    #[test]
    fn sureness_is_counted_over_all_its_touches() {
        let bins = [bin([0.9, 0.95], 0.92, 0.0, 50), bin([0.95, 0.99], 0.97, 0.5, 10), bin([0.99, 1.0], 1.0, 0.9, 30)];
        // 5 of 10 and 27 of 30: 32 of 40.
        assert!(sure(&bins).contains("(40 touches), it is right in <b>80.0 %</b>"), "{}", sure(&bins));
        assert!(sure(&bins[..1]).contains("never more than 95 % sure"));
    }
}
