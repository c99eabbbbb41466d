//! One picture for README: how often the right part is named after each touch, from three starts, next to the paper.

use maud::html;

use super::experiments::Row;
use super::folder::Reproduction;
use crate::page::curves::{Line, Marker, Point, chart, mark};
use crate::report::PaperNumbers;
use crate::result::{Choice, Inference, Method};

/// The paper's curve is of recorded poses on a real robot.
const PAPER: (&str, &str, Marker) = ("the paper: recorded poses, a real robot", "paper", Marker::Diamond);

/// Colours that differ in print and for colour-blind readers, on white in light and dark themes.
const STYLE: &str = "text{font:11px system-ui,sans-serif;fill:#333}.end{text-anchor:end}.middle{text-anchor:middle}\
    .grid{stroke:#ddd;fill:none}.line{fill:none;stroke:currentColor;stroke-width:2}.band{fill:currentColor;opacity:.12}\
    .mark{fill:#fff;stroke:currentColor;stroke-width:1.5}.recorded{color:#0b6fa4}.anywhere{color:#b3470f}\
    .wide{color:#6a3d9a}.paper{color:#777}.paper .line{stroke-dasharray:5 4}";

/// The picture as an SVG file of its own; `None` where none of its evaluations was run.
pub fn picture(found: &Reproduction) -> Option<String> {
    let of_ours = |row: &Row| {
        let evaluation = found.evaluation(&row.of)?;
        let is_default = |method, inference, action| {
            (method, inference, action) == (Method::Filter, Inference::Exact, Choice::Information)
        };
        let rows = evaluation.rows.iter().filter(|row| is_default(row.method, row.inference, row.action));
        let points = rows.map(|row| Point::percent(row.n_touches, row.accuracy, row.accuracy_ci95)).collect();
        let marker = row.marker.unwrap_or(Marker::Circle);
        Some(Line { label: row.text.concat(), class: row.style.clone(), marker, points })
    };
    let mut lines: Vec<Line> =
        found.experiments.picture.iter().filter_map(of_ours).filter(|line| !line.points.is_empty()).collect();
    if lines.is_empty() {
        return None;
    }
    let (label, class, marker) = PAPER;
    let rows = PaperNumbers::of_scene("alphabet-small").rows;
    let points = rows
        .iter()
        .map(|row| Point { n_touches: row.n_touches, value: row.accuracy_percent, interval: None })
        .collect();
    lines.push(Line { label: label.into(), class: class.into(), marker, points });
    let title = "Right part named, % of holes of twelve small letters, after each touch";
    let svg = html! {
        svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 700 330" width="700" height="330" {
            style { (maud::PreEscaped(STYLE)) }
            rect width="700" height="330" fill="#fff" {}
            text x="20" y="24" style="font-weight:600" { (title) }
            g transform="translate(0 36)" { g { (sized(&chart(title, &lines, Some([0.0, 100.0])).0)) } }
            @for (index, line) in lines.iter().enumerate() {
                @let y = 90.0 + 26.0 * index as f64;
                g class=(line.class) {
                    path.line d={ "M395 " (y) "H425" } {}
                    path.mark d=(mark(line.marker, [410.0, y])) {}
                }
                text x="434" y=(y + 4.0) { (line.label) }
            }
            text x="395" y="220" { "Ours are simulated; bands: 95 % intervals over holes." }
        }
    };
    Some(svg.into_string())
}

/// A chart that is part of another picture has a size of its own.
fn sized(chart: &str) -> maud::PreEscaped<String> {
    maud::PreEscaped(chart.replacen("<svg ", "<svg width=\"360\" height=\"280\" ", 1))
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;

    #[test]
    fn it_has_each_start_that_was_run_and_the_paper() {
        let made = |scene| evaluation(scene, 0.5, &[(1, 0.5), (3, 0.9)]);
        let found = of(&[("small", made("alphabet-small")), ("parts-wide", made("wide-letters"))]);
        let svg = picture(&found).unwrap();
        assert!(svg.starts_with("<svg xmlns=") && svg.contains("at every angle") && svg.contains("the paper"));
        assert!(!svg.contains("within 8 mm") && svg.contains("3 touches: 90.00"), "{svg}");
        assert_eq!(picture(&of(&[("large", made("alphabet-large"))])), None);
    }
}
