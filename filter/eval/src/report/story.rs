//! The episodes, touch by touch, as the paper's last figure has them: what was touched, what was seen
//! and where the belief stands.

use std::io;

use tactile_data::se2::Se2;

use super::shell::anchor;
use super::{Board, EpisodeStory, PartPicture, TouchStory, escape, next, number, picture};

/// Belief maps in a row of the page; with more parts, those that were ever the most probable.
const MOST_MAPS: usize = 12;

/// The outlines of all parts, said once and drawn wherever [`outline`] refers to them.
pub fn outlines(board: &Board) -> String {
    let path = |(part, PartPicture { outline_mm, .. }): (usize, &PartPicture)| {
        let contour = |points: &Vec<[f64; 2]>| {
            let places: Vec<_> = points.iter().map(|[x, y]| format!("{x:.2} {y:.2}")).collect();
            format!("M{}Z", places.join("L"))
        };
        let d: String = outline_mm.iter().map(contour).collect();
        format!(r#"<path id="part-{part}" d="{d}" vector-effect="non-scaling-stroke"/>"#)
    };
    let paths: String = board.parts.iter().enumerate().map(path).collect();
    format!(r#"<svg class="defs" aria-hidden="true"><defs>{paths}</defs></svg>"#)
}

/// One episode as a section of the page.
pub fn section(episode: &EpisodeStory, board: &Board) -> io::Result<String> {
    let EpisodeStory { name, why, truth, stop, touches, .. } = episode;
    let Some(TouchStory { guess, probability, .. }) = touches.last() else {
        return Ok(String::new());
    };
    let (class, verdict) = verdict(episode);
    let full_scale = picture::full_scale(touches.iter().map(|touch| &touch.difference));
    let shown = shown_parts(episode, board);
    let half_mm = half_view_mm(episode, board);
    let half_next_mm = next::half_view_mm(touches, board);
    let rows = (0..touches.len())
        .map(|last| {
            let touch = &touches[last];
            Ok(format!(
                r#"<div class="touch"><div class="count">{}</div>{}{}{}{}<div class="belief">{}<p class="said">{}</p><div class="maps">{}</div></div></div>
"#,
                last + 1,
                pane(HEADS[0], &where_touched(&touches[..=last], *truth, half_mm, board)),
                pane(HEADS[1], &format!(r#"<img alt="Camera frame" src="{}">"#, picture::frame(&touch.frame)?)),
                pane(
                    HEADS[2],
                    &format!(
                        r#"<img alt="Difference from rest" src="{}">"#,
                        picture::difference(&touch.difference, full_scale)?
                    )
                ),
                match &touch.next {
                    Some(next) => pane(HEADS[3], &next::picture(touch, next, half_next_mm, board)),
                    None => pane("The end", r#"<div class="end-note">No further touch</div>"#),
                },
                said(touch, board),
                match &touch.next {
                    Some(next) => next::words(next, board),
                    None => format!("It stopped: {}.", escape(stop)),
                },
                maps(touch, *truth, &touches[0].part_from_sensor, &shown, board)?,
            ))
        })
        .collect::<io::Result<String>>()?;
    let part = |part: usize| escape(&board.parts[part].name);
    Ok(format!(
        r#"<section class="episode" id="{}"><h3>{}<span class="verdict {class}">{verdict}</span></h3>
<p>The hole was <b>{}</b>. After {} the likeliest part was <b>{}</b> with {} %. It stopped: {}. Told {}.</p>
<div class="heads"><div></div>{}<div>Where the first touch was, part by part</div></div>
{rows}</section>
"#,
        anchor(name),
        escape(name),
        part(*truth),
        if touches.len() == 1 { "1 touch".into() } else { format!("{} touches", touches.len()) },
        part(*guess),
        number(100.0 * probability, 1),
        escape(stop),
        escape(why),
        HEADS.map(|head| format!("<div>{head}</div>")).concat(),
    ))
}

/// What the pictures of a touch show.
const HEADS: [&str; 4] = ["Where it touched", "What the camera saw", "What changed", "Where next, and why"];

/// A picture with its head, which is shown where there is no row of heads.
fn pane(head: &str, picture: &str) -> String {
    format!(r#"<div class="pane"><div class="head">{head}</div>{picture}</div>"#)
}

/// How an episode came out: a class of the style and words that begin with a mark.
pub fn verdict(episode: &EpisodeStory) -> (&'static str, &'static str) {
    let guess = episode.touches.last().map(|touch| touch.guess);
    match (episode.refused, guess == Some(episode.truth)) {
        (true, _) => ("wrong", "✗ none of these"),
        (false, true) => ("right", "✓ right part"),
        (false, false) => ("wrong", "✗ wrong part"),
    }
}

/// What the filter said after a touch: the likeliest part, and how well it explains the touches.
fn said(touch: &TouchStory, board: &Board) -> String {
    let fit = match (touch.fit, touch.fit_needed) {
        (None, _) => "no edge felt yet".into(),
        (Some(fit), None) => format!("fit {}", number(fit, 2)),
        // No fit is above nought: the fewer the touches, the more is asked for.
        (Some(fit), Some(needed)) if needed > 0.0 => {
            format!("fit {}, too few touches to be confident", number(fit, 2))
        }
        (Some(fit), Some(needed)) => {
            format!("fit {}, to be confident {} or more", number(fit, 2), number(needed, 2))
        }
    };
    format!(
        r#"<p class="said"><b>{}</b> with {} %; {fit}</p>"#,
        escape(&board.parts[touch.guess].name),
        number(100.0 * touch.probability, 1)
    )
}

/// The parts with a map: all, or those of the largest probability at any touch, and the true one.
fn shown_parts(episode: &EpisodeStory, board: &Board) -> Vec<usize> {
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
fn share(touch: &TouchStory, part: usize, board: &Board) -> f64 {
    places(touch, part, board).iter().sum()
}

fn places<'a>(touch: &'a TouchStory, part: usize, board: &Board) -> &'a [f64] {
    let n_places = board.grid.n_xy().pow(2);
    &touch.belief[part * n_places..][..n_places]
}

/// Half the side of the square that shows the part and all touches of an episode, mm.
fn half_view_mm(episode: &EpisodeStory, board: &Board) -> f64 {
    let [width, height] = board.field_of_view_mm.map(|side| side / 2.0);
    let corners = episode.touches.iter().flat_map(|touch| {
        [[-width, -height], [width, -height], [-width, height], [width, height]]
            .map(|corner| touch.part_from_sensor.apply(corner))
    });
    let outline = board.parts[episode.truth].outline_mm.iter().flatten().copied();
    corners.chain(outline).flatten().map(f64::abs).fold(0.0, f64::max) + 1.0
}

/// The true part under the footprints of the touches so far.
fn where_touched(touches: &[TouchStory], truth: usize, half_mm: f64, board: &Board) -> String {
    let poses: Vec<Se2> = touches.iter().map(|touch| touch.part_from_sensor).collect();
    let trail: Vec<_> = poses.iter().map(|pose| format!("{:.2} {:.2}", pose.x_mm, pose.y_mm)).collect();
    let prints: String = poses
        .iter()
        .enumerate()
        .map(|(i, pose)| footprint(pose, board.field_of_view_mm, i + 1 == poses.len()))
        .collect();
    format!(
        r#"<svg class="where" viewBox="{0:.1} {0:.1} {1:.1} {1:.1}" role="img" aria-label="The part and the places touched">{2}<path class="trail" d="M{3}"/>{prints}</svg>"#,
        -half_mm,
        2.0 * half_mm,
        outline(truth),
        trail.join("L"),
    )
}

fn outline(part: usize) -> String {
    format!(r##"<use href="#part-{part}" class="part"/>"##)
}

fn footprint(part_from_sensor: &Se2, [width, height]: [f64; 2], newest: bool) -> String {
    let (x, y) = (-width / 2.0, -height / 2.0);
    let (class, top) = if newest {
        ("print now", format!(r#"<path class="print top" d="M{x} {y}h{width}"/>"#))
    } else {
        ("print", String::new())
    };
    let Se2 { x_mm, y_mm, .. } = part_from_sensor;
    format!(
        r#"<g transform="translate({x_mm:.2} {y_mm:.2}) rotate({:.1})"><rect class="{class}" x="{x}" y="{y}" width="{width}" height="{height}"/>{top}</g>"#,
        part_from_sensor.theta_deg(),
    )
}

/// A belief map for each part shown, all on one scale: the likeliest place of any part is full colour.
fn maps(touch: &TouchStory, truth: usize, part_from_first: &Se2, shown: &[usize], board: &Board) -> io::Result<String> {
    let most = touch.belief.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    let grid = &board.grid;
    let half_mm = grid.xy_half_mm + grid.xy_step_mm / 2.0;
    let side_mm = 2.0 * half_mm;
    let Se2 { x_mm, y_mm, .. } = part_from_first;
    let radius_mm = 0.09 * side_mm;
    let map = |&part: &usize| {
        let (class, ring) = if part == truth {
            (" true", format!(r#"<circle class="ring" cx="{x_mm:.2}" cy="{y_mm:.2}" r="{radius_mm:.2}"/>"#))
        } else {
            ("", String::new())
        };
        let picture = picture::belief(places(touch, part, board), grid.n_xy(), most)?;
        let percent = 100.0 * share(touch, part, board);
        Ok(format!(
            r#"<div class="map{class}"><svg viewBox="{lowest} {lowest} {side_mm} {side_mm}" aria-hidden="true"><image x="{lowest}" y="{lowest}" width="{side_mm}" height="{side_mm}" href="{picture}"/>{}{ring}</svg><div class="name"><span>{}</span><span>{} %</span></div><div class="share"><i style="width:{percent:.1}%"></i></div></div>"#,
            outline(part),
            escape(&board.parts[part].name),
            number(percent, 0),
            lowest = -half_mm,
        ))
    };
    shown.iter().map(map).collect()
}
