//! Whether the filter is right as often as it says: the reliability diagram.

use maud::{Markup, html};

use super::series::leading_filter;
use crate::page::axes::{Area, Frame, px};
use crate::page::curves::{Marker, entry};
use crate::page::numbers::{interval, number, percent, share, touch_count};
use crate::page::shell::{Section, figure};
use crate::page::table::{cells, sortable};
use crate::result::{Evaluation, Method, ReliabilityBin, Row};

const AREA: Area = Area { width: 330.0, height: 330.0, left: 42.0 };

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
        let n_episodes = bin.n_episodes.map_or("–".into(), |n| n.to_string());
        let right = share(bin.right, bin.right_ci95);
        cells![format!("{low}–{high}"), percent(bin.mean_probability), right, bin.n, n_episodes]
    };
    let rows: Vec<_> = bins.iter().map(row).collect();
    let touches = "Touches with about that probability, 95 % interval; the more touches, the larger";
    let content = html! {
        ul.legend {
            (entry("information", Marker::Circle, false, touches))
            li {
                svg.key viewBox="0 0 30 14" aria-hidden="true" { path.diagonal d="M1 7H29" {} }
                "As right as it says"
            }
        }
        div.charts.and-table {
            div { p { "Right, % against what it says, %" } (diagram("Reliability", bins, 0.0)) }
            div { p { "The same, near certainty" } (diagram("Reliability near certainty", bins, 80.0)) }
            (sortable(&["It says,\u{a0}%", "mean", "right, %", "touches", "episodes"], &rows))
        }
    };
    let caption = format!(
        "After each touch of each episode ({way}), the probability of the most probable part against how often that part is \
         right. On the dashed line the filter is as right as it says; above it, it is more careful than it need be; below it, \
         surer than it should be. {}",
        if bins.iter().all(|bin| bin.n_episodes.is_some()) {
            "Touches of one episode resemble each other: an interval is of as many touches as the differences between episodes allow."
        } else {
            "Touches of one episode resemble each other, so the true intervals are somewhat wider."
        }
    );
    let body = html! { p { (sure(bins)) (off_by(evaluation)) } (figure(content, caption)) };
    Some(Section::new("Sureness", "Is it right as often as it says?", body))
}

/// How often it is right where it says that it is sure.
fn sure(bins: &[ReliabilityBin]) -> Markup {
    let sure = || bins.iter().filter(|bin| bin.probability[0] >= SURE);
    let n: usize = sure().map(|bin| bin.n).sum();
    let least = number(100.0 * SURE, 0);
    if n == 0 {
        return html! { "It was never more than " (least) " % sure." };
    }
    let right: f64 = sure().map(|bin| bin.right * bin.n as f64).sum();
    html! { "Where it is more than " (least) " % sure (" (n) " touches), it is right in " b { (percent(right / n as f64)) " %" } "." }
}

/// How far the leading filter's probabilities are off on average, after a few touches; nothing where that was not counted.
fn off_by(evaluation: &Evaluation) -> Markup {
    let lead = evaluation.rows.iter().find(|row| row.method == Method::Filter);
    let rows = lead.and_then(|lead| leading_filter(evaluation, lead.poses)).map_or(Vec::new(), |series| series.rows);
    let off = |row: &&Row| {
        let (error, ci95) = (row.calibration_error?, row.calibration_error_ci95?);
        Some(format!("{} ({}) after {}", percent(error), interval(ci95), touch_count(row.n_touches)))
    };
    let off: Vec<String> = rows.iter().filter(|row| row.n_touches <= 3).filter_map(off).collect();
    html! {
        @if !off.is_empty() {
            " Its probabilities are off by this many points on average (expected calibration error; over parts 95 %): "
            (off.join(", ")) "."
        }
    }
}

/// Both axes from `lowest` to 100 %; what is below is left out, intervals end at the edge.
fn diagram(title: &str, bins: &[ReliabilityBin], lowest: f64) -> Markup {
    let step = (100.0 - lowest) / 4.0;
    let (x, y) = (AREA.x_axis([lowest, 100.0], 0.0), AREA.y_axis([lowest, 100.0]));
    let frame = Frame { title, x_name: "it says, %", area: AREA, x: x.with_steps(step), y: y.with_steps(step) };
    let most = bins.iter().map(|bin| bin.n).max().unwrap_or(1).max(1) as f64;
    let shown = bins.iter().filter(|bin| 100.0 * bin.mean_probability.min(bin.right) >= lowest);
    frame.svg(&html! {
        path.diagonal d={ "M" (AREA.left) " " (AREA.bottom()) "L" (AREA.right()) " " (AREA.top()) } {}
        g.information {
            @for bin in shown {
                @let [x, y] = [frame.x.at(100.0 * bin.mean_probability), frame.y.at(100.0 * bin.right)];
                @let [low, high] = bin.right_ci95.map(|bound| px(frame.y.at(100.0 * bound)));
                path.bar d={ "M" (px(x)) " " (low) "V" (high) } {}
                circle.dot cx=(px(x)) cy=(px(y)) r=(px(3.5 + 4.0 * (bin.n as f64 / most).sqrt())) {
                    title { "says " (percent(bin.mean_probability)) " %, right in " (percent(bin.right)) " % of " (bin.n) " touches" }
                }
            }
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bin(probability: [f64; 2], mean_probability: f64, right: f64, n: usize) -> ReliabilityBin {
        let right_ci95 = [right - 0.1, (right + 0.1).min(1.0)];
        ReliabilityBin { probability, mean_probability, right, right_ci95, n, n_episodes: None }
    }

    #[test]
    fn a_bin_that_is_as_right_as_it_says_is_on_the_diagonal() {
        let svg = diagram("t", &[bin([0.4, 0.6], 0.5, 0.5, 10)], 0.0).0;
        let (x, y) = ((AREA.left + AREA.right()) / 2.0, (AREA.top() + AREA.bottom()) / 2.0);
        assert!(svg.contains(&format!(r#"cx="{x:.1}" cy="{y:.1}""#)), "{svg}");
        // From 40 to 60 %: a fifth of the height, about the middle.
        let tenth = (AREA.bottom() - AREA.top()) / 10.0;
        assert!(svg.contains(&format!("M{x:.1} {:.1}V{:.1}", y + tenth, y - tenth)), "{svg}");
    }

    #[test]
    fn near_certainty_only_what_is_there_is_shown() {
        let bins = [bin([0.4, 0.6], 0.5, 0.5, 10), bin([0.8, 0.9], 0.9, 0.9, 10), bin([0.9, 1.0], 0.95, 0.7, 10)];
        let svg = diagram("t", &bins, 80.0).0;
        assert_eq!(svg.matches("<circle").count(), 1);
        assert!(svg.contains(&format!(r#"cx="{:.1}""#, (AREA.left + AREA.right()) / 2.0)));
    }

    #[test]
    fn sureness_is_counted_over_all_its_touches() {
        let bins = [bin([0.9, 0.95], 0.92, 0.0, 50), bin([0.95, 0.99], 0.97, 0.5, 10), bin([0.99, 1.0], 1.0, 0.9, 30)];
        // 5 of 10 and 27 of 30: 32 of 40.
        assert!(sure(&bins).0.contains("(40 touches), it is right in <b>80.0 %</b>"), "{}", sure(&bins).0);
        assert!(sure(&bins[..1]).0.contains("never more than 95 % sure"));
    }
}
