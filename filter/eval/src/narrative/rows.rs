//! The rows of an episode, one for each touch, as the paper's last figure has them: what was touched, what was seen and
//! how probable each place is.

use maud::{Markup, html};
use tactile_data::pose::se2::Se2;
use tactile_infer::maps::mosaic::Difference;

use super::drawing::{mm, outline, transform, view_box};
use super::next_touch::Candidates;
use super::{Board, Felt, Narrative, NarrativeTouch, next_touch, picture};
use crate::error::Result;
use crate::page::axes::path;
use crate::page::numbers::{number, percent, touch_count};
use crate::page::shell::anchor;

/// Belief maps in a row of the page; with more parts, those that were ever the most probable.
const MOST_MAPS: usize = 12;

/// What the pictures of a touch show.
const HEADS: [&str; 4] = ["Where it touched", "What the camera saw", "What changed", "Where next, and why"];

/// The outlines of all parts, defined once and drawn wherever [`outline`] refers to them.
pub fn outlines(board: &Board) -> Markup {
    html! {
        svg.defs aria-hidden="true" {
            defs {
                @for (part, picture) in board.parts.iter().enumerate() {
                    path id={ "part-" (part) } d=(picture.svg_path()) vector-effect="non-scaling-stroke" {}
                }
            }
        }
    }
}

/// One episode with its heading and its rows; nothing where it has no touch.
pub fn section(episode: &Narrative, board: &Board) -> Result<Markup> {
    let Narrative { name, why, truth, stop, touches, .. } = episode;
    let Some(last) = touches.last() else { return Ok(html! {}) };
    let (class, verdict) = verdict(episode);
    let view = View {
        episode,
        board,
        full_scale: picture::full_scale(touches.iter().map(|touch| &touch.difference)),
        half_mm: half_view_mm(episode, board),
        half_next_mm: next_touch::half_view_mm(touches, board),
        shown: shown_parts(episode, board),
    };
    let rows = (0..touches.len()).map(|index| view.row(index)).collect::<Result<Vec<_>>>()?;
    Ok(html! {
        section.episode id=(anchor(name)) {
            h3 { (name) span class={ "verdict " (class) } { (verdict) } }
            p {
                "The hole was " b { (board.parts[*truth].name) } ". After " (touch_count(touches.len()))
                " the most probable part was " b { (board.parts[last.guess].name) } " with " (percent(last.probability))
                " %. It stopped: " (stop) ". Shown " (why) "."
            }
            div.heads {
                div {}
                @for head in HEADS { div { (head) } }
                div { "Where the first touch was, part by part" }
            }
            @for row in &rows { (row) }
        }
    })
}

/// How an episode came out: a class of the style and words that begin with a mark.
pub fn verdict(episode: &Narrative) -> (&'static str, &'static str) {
    let guess = episode.touches.last().map(|touch| touch.guess);
    match (episode.refused, guess == Some(episode.truth)) {
        (true, _) => ("wrong", "✗ none of these"),
        (false, true) => ("right", "✓ right part"),
        (false, false) => ("wrong", "✗ wrong part"),
    }
}

/// What the rows of an episode have in common.
struct View<'a> {
    episode: &'a Narrative,
    board: &'a Board,
    full_scale: f32,
    half_mm: f64,
    half_next_mm: f64,
    shown: Vec<usize>,
}

impl View<'_> {
    fn row(&self, index: usize) -> Result<Markup> {
        let Self { episode, board, .. } = self;
        let touch = &episode.touches[index];
        let frame = picture::frame(&touch.frame)?;
        let difference = picture::difference(&touch.difference, self.full_scale)?;
        let maps = self.maps(touch)?;
        Ok(html! {
            div.touch {
                div.count { (index + 1) }
                (pane(HEADS[0], &self.where_touched(index)))
                (pane(HEADS[1], &html! { img alt="Camera frame" src=(frame); }))
                (pane(HEADS[2], &html! { img alt="Difference from rest" src=(difference); }))
                @match &touch.next {
                    Some(next) => (pane(HEADS[3], &Candidates { touch, next, half_mm: self.half_next_mm, board }.svg())),
                    None => (end(touch)?),
                }
                div.belief {
                    p.words { b { (board.parts[touch.guess].name) } " with " (percent(touch.probability)) " %; " (none(touch)) }
                    p.words {
                        @match &touch.next {
                            Some(next) => (next_touch::words(next, board)),
                            None => { "It stopped: " (episode.stop) "." },
                        }
                    }
                    div.maps { @for map in &maps { (map) } }
                }
            }
        })
    }

    /// The true part under the footprints of the touches up to one.
    fn where_touched(&self, last: usize) -> Markup {
        let poses: Vec<Se2> = self.episode.touches[..=last].iter().map(|touch| touch.part_from_sensor).collect();
        let view = view_box(self.half_mm);
        html! {
            svg.where viewBox=(view) role="img" aria-label="The part and the places touched" {
                (outline(self.episode.truth))
                path.trail d=(path(poses.iter().map(|pose| [pose.x_mm, pose.y_mm]))) {}
                @for (index, pose) in poses.iter().enumerate() {
                    (footprint(pose, self.board.field_of_view_mm, index == last))
                }
            }
        }
    }

    /// A belief map for each part shown, all on one scale: the most probable place of any part is full colour.
    fn maps(&self, touch: &NarrativeTouch) -> Result<Vec<Markup>> {
        let Self { episode, board, .. } = self;
        let most = touch.belief.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
        let half_mm = board.grid.xy_half_mm + board.grid.xy_step_mm / 2.0;
        let side_mm = 2.0 * half_mm;
        let Se2 { x_mm, y_mm, .. } = episode.touches[0].part_from_sensor;
        let map = |&part: &usize| {
            let picture = picture::belief(places(touch, part, board), board.grid.n_xy(), most)?;
            let percent = 100.0 * share(touch, part, board);
            let is_true = part == episode.truth;
            Ok(html! {
                div.map.true[is_true] {
                    svg viewBox={ (-half_mm) " " (-half_mm) " " (side_mm) " " (side_mm) } aria-hidden="true" {
                        image x=(-half_mm) y=(-half_mm) width=(side_mm) height=(side_mm) href=(picture) {}
                        (outline(part))
                        @if is_true { circle.ring cx=(mm(x_mm)) cy=(mm(y_mm)) r=(mm(0.09 * side_mm)) {} }
                    }
                    div.name { span { (board.parts[part].name) } span { (number(percent, 0)) " %" } }
                    div.share { i style={ "width:" (format!("{percent:.1}")) "%" } {} }
                }
            })
        };
        self.shown.iter().map(map).collect()
    }
}

/// A picture with its head, which is shown where there is no row of heads.
fn pane(head: &str, picture: &Markup) -> Markup {
    html! { div.pane { div.head { (head) } (picture) } }
}

/// What was felt, where maps were drawn.
fn end(touch: &NarrativeTouch) -> Result<Markup> {
    let Some(Felt { picture, difference }) = &touch.felt else {
        return Ok(pane("The end", &html! { div.end-note { "No further touch" } }));
    };
    let src = picture::frame(picture)?;
    let differs = |Difference { only_first_mm2, only_second_mm2, .. }: Difference| {
        format!("{:.0} mm² of it differ (yellow).", only_first_mm2 + only_second_mm2)
    };
    Ok(pane(
        "What was felt",
        &html! {
            img alt="What was felt" src=(src);
            div.end-note { "What was felt: blue is inside, the named part's outline green. " (difference.map(differs).unwrap_or_default()) }
        },
    ))
}

/// How likely the touches so far are those of a part that the bank does not hold.
fn none(touch: &NarrativeTouch) -> String {
    let Some(presence) = touch.presence else { return "no edge felt yet".into() };
    let [none, rate] = [presence.none(), presence.stranger_rate].map(|share| number(100.0 * share, 1));
    format!("none of these {none} %; {rate} % of strangers match so well")
}

/// The parts with a map: all, or those of the largest probability at any touch, and the true one.
fn shown_parts(episode: &Narrative, board: &Board) -> Vec<usize> {
    let highest = |part: usize| {
        let shares = episode.touches.iter().map(|touch| share(touch, part, board));
        if part == episode.truth { f64::INFINITY } else { shares.fold(0.0, f64::max) }
    };
    let mut parts: Vec<usize> = (0..board.parts.len()).collect();
    parts.sort_by(|a, b| highest(*b).total_cmp(&highest(*a)));
    parts.truncate(MOST_MAPS);
    parts.sort_unstable();
    parts
}

/// Probability of a part after a touch.
fn share(touch: &NarrativeTouch, part: usize, board: &Board) -> f64 {
    places(touch, part, board).iter().sum()
}

fn places<'a>(touch: &'a NarrativeTouch, part: usize, board: &Board) -> &'a [f64] {
    let n_places = board.grid.n_xy().pow(2);
    &touch.belief[part * n_places..][..n_places]
}

/// Half the side of the square that shows the part and all touches of an episode, mm.
fn half_view_mm(episode: &Narrative, board: &Board) -> f64 {
    let [width, height] = board.field_of_view_mm.map(|side| side / 2.0);
    let corners = episode.touches.iter().flat_map(|touch| {
        [[-width, -height], [width, -height], [-width, height], [width, height]]
            .map(|corner| touch.part_from_sensor.apply(corner))
    });
    let outline = board.parts[episode.truth].outline_mm.iter().flatten().copied();
    corners.chain(outline).flatten().map(f64::abs).fold(0.0, f64::max) + 1.0
}

fn footprint(part_from_sensor: &Se2, [width, height]: [f64; 2], is_newest: bool) -> Markup {
    let (x, y) = (-width / 2.0, -height / 2.0);
    html! {
        g transform=(transform(part_from_sensor)) {
            rect.print.now[is_newest] x=(x) y=(y) width=(width) height=(height) {}
            @if is_newest { path.print.top d={ "M" (x) " " (y) "h" (width) } {} }
        }
    }
}
