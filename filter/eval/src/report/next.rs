//! Why this next touch: the candidates as the rule judged them, drawn where they are thought to lead, and in words.

use tactile_data::se2::Se2;

use super::{Board, NextTouch, TouchStory, escape, number};
use tactile_filter::action::{ActionRule, Expected, Judged};

/// One place that candidates lead to, with the best of their scores there.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    at_mm: [f64; 2],
    score: Option<f64>,
    n_angles: usize,
}

/// Half the side of the square that shows the likeliest part and where every candidate leads, over all touches, mm.
pub fn half_view_mm(touches: &[TouchStory], board: &Board) -> f64 {
    let [width, height] = board.field_of_view_mm;
    let reach_mm = 0.5 * width.hypot(height);
    let touch_mm = |touch: &TouchStory| {
        let judged = touch.next.iter().flat_map(|next| &next.judgement.judged);
        let led = judged.map(|judged| touch.guess_from_sensor * judged.sensor_from_next);
        let chosen = touch.next.as_ref().map(|next| touch.guess_from_sensor * next.judgement.action.sensor_from_next);
        let chosen = chosen.into_iter().chain([touch.guess_from_sensor]);
        let prints_mm = chosen.flat_map(|pose| [pose.x_mm, pose.y_mm]).map(|mm| mm.abs() + reach_mm);
        let outline_mm = board.parts[touch.guess].outline_mm.iter().flatten().flatten().map(|mm| mm.abs());
        led.flat_map(|pose| [pose.x_mm.abs(), pose.y_mm.abs()]).chain(outline_mm).chain(prints_mm).fold(0.0, f64::max)
    };
    touches.iter().map(touch_mm).fold(0.0, f64::max) + 1.0
}

/// The likeliest part with the candidates on it: a dot for each place, the larger and stronger the more the best
/// angle there is expected to tell; the chosen one ringed, with what the sensor would cover.
pub fn picture(touch: &TouchStory, next: &NextTouch, half_mm: f64, board: &Board) -> String {
    let chosen = touch.guess_from_sensor * next.judgement.action.sensor_from_next;
    let places = places(&touch.guess_from_sensor, &next.judgement.judged);
    let most = places.iter().filter_map(|place| place.score).fold(f64::MIN_POSITIVE, f64::max);
    let radius_mm = 0.028 * 2.0 * half_mm;
    let unit = if next.rule == ActionRule::Information { " nats" } else { "" };
    let dot = |place: &Place| {
        let [x, y] = place.at_mm;
        let angles = if place.n_angles == 1 { "1 angle".into() } else { format!("{} angles", place.n_angles) };
        match place.score {
            None => format!(
                r#"<circle class="blank" cx="{x:.1}" cy="{y:.1}" r="{:.2}"><title>no edge expected</title></circle>"#,
                0.3 * radius_mm
            ),
            Some(score) => {
                let share = (score / most).clamp(0.0, 1.0);
                format!(
                    r#"<circle cx="{x:.1}" cy="{y:.1}" r="{:.2}" opacity="{:.2}"><title>{}{unit}, best of {angles}</title></circle>"#,
                    radius_mm * (0.3 + 0.7 * share),
                    0.25 + 0.75 * share,
                    number(score, 2),
                )
            }
        }
    };
    let dots: String = places.iter().map(dot).collect();
    let print = |pose: &Se2, class: &str| {
        let [width, height] = board.field_of_view_mm;
        format!(
            r#"<rect class="{class}" x="{}" y="{}" width="{width}" height="{height}" transform="translate({:.2} {:.2}) rotate({:.1})"/>"#,
            -width / 2.0,
            -height / 2.0,
            pose.x_mm,
            pose.y_mm,
            pose.theta_deg()
        )
    };
    format!(
        r##"<svg class="where" viewBox="{0:.1} {0:.1} {1:.1} {1:.1}" role="img" aria-label="The likeliest part and the candidates for the next touch"><use href="#part-{2}" class="part"/>{3}<g class="gain">{dots}</g>{4}<circle class="chosen" cx="{5:.2}" cy="{6:.2}" r="{7:.2}"/></svg>"##,
        -half_mm,
        2.0 * half_mm,
        touch.guess,
        print(&touch.guess_from_sensor, "print"),
        print(&chosen, "next"),
        chosen.x_mm,
        chosen.y_mm,
        1.5 * radius_mm,
    )
}

/// Where candidates lead, each place once, in the order of their first.
fn places(guess_from_sensor: &Se2, judged: &[Judged]) -> Vec<Place> {
    /// Nearer than a robot would tell apart, farther than rounding moves a pose, mm.
    const SAME_MM: f64 = 0.05;
    let mut places: Vec<Place> = Vec::new();
    for judged in judged {
        let Se2 { x_mm, y_mm, .. } = *guess_from_sensor * judged.sensor_from_next;
        let is_here = |place: &&mut Place| (place.at_mm[0] - x_mm).hypot(place.at_mm[1] - y_mm) < SAME_MM;
        match places.iter_mut().find(is_here) {
            Some(place) => {
                place.n_angles += 1;
                place.score = place.score.into_iter().chain(judged.score).reduce(f64::max);
            }
            None => places.push(Place { at_mm: [x_mm, y_mm], score: judged.score, n_angles: 1 }),
        }
    }
    places
}

/// The choice in one line, HTML.
pub fn words(next: &NextTouch, board: &Board) -> String {
    let n = next.judgement.judged.len();
    match (next.rule, &next.judgement.expected) {
        (ActionRule::Random, _) => format!("Next touch: by chance, one of {} candidates.", next.n_candidates),
        (ActionRule::Paper, _) => {
            format!("Next touch: of {n} candidates the one with the largest sum of 1 / f_PP, the paper’s rule.")
        }
        (ActionRule::Information, None) => {
            format!("Next touch: by chance, because none of {n} candidates is expected to show an edge.")
        }
        (ActionRule::Information, Some(expected)) => {
            format!("Next touch, chosen of {n} candidates: {}.", told(expected, board))
        }
    }
}

/// What a touch is expected to tell, and what most of that is about.
fn told(expected: &Expected, board: &Board) -> String {
    let Expected { nats, part_nats, pair } = expected;
    let nats_of = |nats: f64| number(nats.max(0.0), 2);
    // Less than what is printed as 0.01.
    if *nats < 0.005 {
        return "it is expected to tell next to nothing".into();
    }
    let whole = format!("it is expected to tell <b>{} nats</b>", nats_of(*nats));
    let Some(([a, b], between)) = pair else { return whole + " of where on the part it is" };
    let [a, b] = [a, b].map(|part| format!("<b>{}</b>", escape(&board.parts[*part].name)));
    let share = nats_of(*between);
    if *between > 0.5 * nats {
        format!("{whole}, most of it ({share}) between {a} and {b}")
    } else if *part_nats > 0.5 * nats {
        format!("{whole}, most of it ({}) about which part it is; {share} between {a} and {b}", nats_of(*part_nats))
    } else {
        let place = nats_of(nats - part_nats);
        format!("{whole}, most of it ({place}) about where on the part; {share} between {a} and {b}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::PartPicture;
    use tactile_data::grid::PoseGrid;

    fn board() -> Board {
        let part = |name: &str| PartPicture { name: name.into(), outline_mm: Vec::new() };
        let parts = ["E", "F", "G"].map(part).to_vec();
        Board { parts, grid: PoseGrid::SMALL, field_of_view_mm: [17.0, 13.0] }
    }

    #[test]
    fn the_larger_share_is_named() {
        let told =
            |nats, part_nats, between| told(&Expected { nats, part_nats, pair: Some(([0, 1], between)) }, &board());
        assert!(told(0.83, 0.6, 0.52).contains("0.83 nats</b>, most of it (0.52) between <b>E</b> and <b>F</b>"));
        assert!(told(0.83, 0.6, 0.1).contains("most of it (0.60) about which part it is; 0.10 between <b>E</b>"));
        assert!(told(0.83, 0.2, -0.01).contains("most of it (0.63) about where on the part; 0.00 between"));
        assert!(told(0.001, 0.001, 0.001).contains("next to nothing"));
    }

    #[test]
    fn angles_at_one_place_are_one_dot_with_the_best_of_them() {
        let judged = |x, degrees, score| Judged {
            sensor_from_next: Se2::from_degrees(x, 0.0, degrees),
            score,
            by_all_draws: true,
        };
        let all = [
            judged(4.0, 0.0, Some(0.25)),
            judged(4.0, 30.0, None),
            judged(4.0, 60.0, Some(0.5)),
            judged(8.0, 0.0, None),
        ];
        // The sensor stands at (1, 2), turned by a quarter: its x is the part's y.
        let found = places(&Se2::from_degrees(1.0, 2.0, 90.0), &all);
        assert_eq!(
            found.iter().map(|place| (place.score, place.n_angles)).collect::<Vec<_>>(),
            [(Some(0.5), 3), (None, 1)]
        );
        let near = |[x, y]: [f64; 2], want: [f64; 2]| (x - want[0]).hypot(y - want[1]) < 1e-9;
        assert!(near(found[0].at_mm, [1.0, 6.0]) && near(found[1].at_mm, [1.0, 10.0]), "{found:?}");
    }
}
