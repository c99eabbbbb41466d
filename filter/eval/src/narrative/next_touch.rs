//! Why this next touch: the candidates as the rule judged them, drawn where they are thought to lead, and in words.

use maud::{Markup, html};
use tactile_data::pose::se2::Se2;
use tactile_filter::choice::{ActionRule, Expected, Scored};

use super::drawing::{mm, outline, transform, view_box};
use super::{Board, NarrativeTouch, NextTouch};
use crate::page::numbers::number;

/// One place that candidates lead to, with the best of their scores there.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Place {
    at_mm: [f64; 2],
    score: Option<f64>,
    n_angles: usize,
}

/// Half the side of the square that shows the most probable part and where every candidate leads, over all touches, mm.
pub fn half_view_mm(touches: &[NarrativeTouch], board: &Board) -> f64 {
    let [width, height] = board.field_of_view_mm;
    let reach_mm = 0.5 * width.hypot(height);
    let touch_mm = |touch: &NarrativeTouch| {
        let scored = touch.next.iter().flat_map(|next| &next.choice.scored);
        let led = scored.map(|scored| touch.guess_from_sensor * scored.sensor_from_next);
        let chosen = touch.next.as_ref().map(|next| touch.guess_from_sensor * next.choice.action.sensor_from_next);
        let chosen = chosen.into_iter().chain([touch.guess_from_sensor]);
        let prints_mm = chosen.flat_map(|pose| [pose.x_mm, pose.y_mm]).map(|mm| mm.abs() + reach_mm);
        let outline_mm = board.parts[touch.guess].outline_mm.iter().flatten().flatten().map(|mm| mm.abs());
        led.flat_map(|pose| [pose.x_mm.abs(), pose.y_mm.abs()]).chain(outline_mm).chain(prints_mm).fold(0.0, f64::max)
    };
    touches.iter().map(touch_mm).fold(0.0, f64::max) + 1.0
}

/// The choice of a next touch as a picture.
pub struct Candidates<'a> {
    /// The touch before it.
    pub touch: &'a NarrativeTouch,
    /// The choice.
    pub next: &'a NextTouch,
    /// Half the side of the picture, mm.
    pub half_mm: f64,
    /// What is drawn.
    pub board: &'a Board,
}

impl Candidates<'_> {
    /// The most probable part with the candidates on it: a dot for each place, the larger and stronger the more the best
    /// angle there is expected to inform; the chosen one ringed, with what the sensor would cover.
    pub fn svg(&self) -> Markup {
        let Self { touch, next, half_mm, board } = self;
        let chosen = touch.guess_from_sensor * next.choice.action.sensor_from_next;
        let places = places(&touch.guess_from_sensor, &next.choice.scored);
        let most = places.iter().filter_map(|place| place.score).fold(f64::MIN_POSITIVE, f64::max);
        let radius_mm = 0.028 * 2.0 * half_mm;
        let unit = if next.rule == ActionRule::Information { " nats" } else { "" };
        let [width, height] = board.field_of_view_mm;
        let footprint = |pose: &Se2, class: &str| {
            html! {
                rect class=(class) x=(-width / 2.0) y=(-height / 2.0) width=(width) height=(height) transform=(transform(pose)) {}
            }
        };
        html! {
            svg.where viewBox=(view_box(*half_mm)) role="img" aria-label="The most probable part and the candidates for the next touch" {
                (outline(touch.guess))
                (footprint(&touch.guess_from_sensor, "print"))
                g.gain {
                    @for Place { at_mm: [x, y], score, n_angles } in &places {
                        @if let Some(score) = score {
                            @let share = (score / most).clamp(0.0, 1.0);
                            circle cx=(mm(*x)) cy=(mm(*y)) r=(mm(radius_mm * (0.3 + 0.7 * share))) opacity=(mm(0.25 + 0.75 * share)) {
                                title { (number(*score, 2)) (unit) ", best of " (n_angles) @if *n_angles == 1 { " angle" } @else { " angles" } }
                            }
                        } @else {
                            circle.blank cx=(mm(*x)) cy=(mm(*y)) r=(mm(0.3 * radius_mm)) { title { "no edge expected" } }
                        }
                    }
                }
                (footprint(&chosen, "next"))
                circle.chosen cx=(mm(chosen.x_mm)) cy=(mm(chosen.y_mm)) r=(mm(1.5 * radius_mm)) {}
            }
        }
    }
}

/// Where candidates lead, each place once, in the order of their first.
fn places(guess_from_sensor: &Se2, scored: &[Scored]) -> Vec<Place> {
    /// Nearer than a robot can place its sensor, farther than rounding moves a pose, mm.
    const SAME_MM: f64 = 0.05;
    let mut places: Vec<Place> = Vec::new();
    for scored in scored {
        let Se2 { x_mm, y_mm, .. } = *guess_from_sensor * scored.sensor_from_next;
        let is_here = |place: &&mut Place| (place.at_mm[0] - x_mm).hypot(place.at_mm[1] - y_mm) < SAME_MM;
        match places.iter_mut().find(is_here) {
            Some(place) => {
                place.n_angles += 1;
                place.score = place.score.into_iter().chain(scored.score).reduce(f64::max);
            }
            None => places.push(Place { at_mm: [x_mm, y_mm], score: scored.score, n_angles: 1 }),
        }
    }
    places
}

/// The choice in one line.
pub fn words(next: &NextTouch, board: &Board) -> Markup {
    let n = next.choice.scored.len();
    if let Some(nats) = next.choice.presence_nats {
        let told = html! { b { (number(nats, 2)) " nats" } " about whether that part is there at all" };
        return html! { "Next touch, chosen of " (n) " candidates: it shows most of what is left to feel, and is expected to give " (told) "." };
    }
    html! {
        @match (next.rule, &next.choice.expected) {
            (ActionRule::Random, _) => { "Next touch: by chance, one of " (next.n_candidates) " candidates." },
            (ActionRule::RandomEdge, _) => {
                "Next touch: by chance among those of " (next.n_candidates) " candidates that should show an edge."
            },
            (ActionRule::Paper, _) => {
                "Next touch: of " (n) " candidates the one with the largest sum of 1 / f_PP, the paper’s rule."
            },
            (ActionRule::Information, None) => {
                "Next touch: by chance, because none of " (n) " candidates is expected to show an edge."
            },
            (ActionRule::Information, Some(expected)) => {
                "Next touch, chosen of " (n) " candidates: " (information(expected, board)) "."
            },
        }
    }
}

/// How much information a touch is expected to give, and what most of it is about.
fn information(expected: &Expected, board: &Board) -> Markup {
    let Expected { nats, part_nats, pair } = expected;
    let nats_of = |nats: f64| number(nats.max(0.0), 2);
    // Less than what is printed as 0.01.
    if *nats < 0.005 {
        return html! { "it is expected to give next to nothing" };
    }
    let whole = html! { "it is expected to give " b { (nats_of(*nats)) " nats" } };
    let Some(([a, b], between)) = pair else { return html! { (whole) " about where on the part it is" } };
    let pair = html! { b { (board.parts[*a].name) } " and " b { (board.parts[*b].name) } };
    let share = nats_of(*between);
    html! {
        (whole) ", most of it ("
        @if *between > 0.5 * nats {
            (share) ") between " (pair)
        } @else if *part_nats > 0.5 * nats {
            (nats_of(*part_nats)) ") about which part it is; " (share) " between " (pair)
        } @else {
            (nats_of(nats - part_nats)) ") about where on the part; " (share) " between " (pair)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::narrative::PartPicture;
    use tactile_data::pose::grid::PoseGrid;

    fn board() -> Board {
        let part = |name: &str| PartPicture { name: name.into(), outline_mm: Vec::new() };
        let parts = ["E", "F", "G"].map(part).to_vec();
        Board { parts, grid: PoseGrid::SMALL, field_of_view_mm: [17.0, 13.0] }
    }

    #[test]
    fn the_larger_share_is_named() {
        let words_of = |nats, part_nats, between| {
            information(&Expected { nats, part_nats, pair: Some(([0, 1], between)) }, &board()).0
        };
        assert!(words_of(0.83, 0.6, 0.52).contains("0.83 nats</b>, most of it (0.52) between <b>E</b> and <b>F</b>"));
        assert!(words_of(0.83, 0.6, 0.1).contains("most of it (0.60) about which part it is; 0.10 between <b>E</b>"));
        assert!(words_of(0.83, 0.2, -0.01).contains("most of it (0.63) about where on the part; 0.00 between"));
        assert!(words_of(0.001, 0.001, 0.001).contains("next to nothing"));
    }

    #[test]
    fn angles_at_one_place_are_one_dot_with_the_best_of_them() {
        let scored = |x, degrees, score| Scored {
            sensor_from_next: Se2::from_degrees(x, 0.0, degrees),
            score,
            by_all_draws: true,
        };
        let all = [
            scored(4.0, 0.0, Some(0.25)),
            scored(4.0, 30.0, None),
            scored(4.0, 60.0, Some(0.5)),
            scored(8.0, 0.0, None),
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
