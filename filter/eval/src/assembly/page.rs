//! The assembly as one HTML page: figures, parts, what went wrong, belief maps.

use maud::{Markup, html};

use super::attempt::stop_name;
use super::result::{Assembly, Failure, Group};
use crate::error::Result;
use crate::narrative::{Board, Narrative, viewer};
use crate::page::model::model_entries;
use crate::page::numbers::{interval, mean, milliseconds, number, percent, percent_sign, seeds, share};
use crate::page::shell::{Section, definitions, figure, page, tile};
use crate::page::table::{cells, sortable};

/// Failures listed at most.
const MOST_FAILURES: usize = 100;

/// The columns of a table of groups, after what the groups have in common; [`group_cells`] fills them.
pub const GROUP_HEADS: [&str; 10] = [
    "holes",
    "own peg in, %",
    "touches",
    "tries",
    "seconds",
    "place, mm",
    "angle, degrees",
    "right peg, wrong place",
    "wrong peg",
    "which went in",
];

/// The whole page; `episodes` are one trial's holes.
///
/// # Errors
/// An episode that does not fit the board, or a frame that cannot be drawn.
pub fn html(assembly: &Assembly, board: &Board, episodes: &[Narrative]) -> Result<String> {
    let mut sections = vec![by_part(assembly), by_stop(assembly)];
    sections.extend((!assembly.failures.is_empty()).then(|| failures(assembly)));
    sections.extend(viewer::section(
        ["Belief maps", "Belief maps of the first trial, touch by touch"],
        board,
        episodes,
    )?);
    sections.push(how_made(assembly));
    Ok(page(&format!("Tactile-Filter: assembly of {}", assembly.run.scene), &top(assembly), &sections))
}

fn top(assembly: &Assembly) -> Markup {
    let Assembly { run, holes, all_inserted, decision_ms, .. } = assembly;
    let names: Vec<&str> = assembly.parts.iter().map(|group| group.name.as_str()).collect();
    let insertion = assembly.insertion;
    let felt = match insertion.peg_touches {
        0 => "; it does not feel how it holds it".into(),
        n => format!(", and presses it {n} times on a second sensor to feel how it holds it"),
    };
    let searched = match insertion.search_poses {
        1 => "goes straight down".into(),
        n => format!("slides the peg along the plate until it goes in, over {n} poses at most, the likeliest first"),
    };
    html! {
        h1 { "Touch, name, insert: " (run.scene) }
        p {
            "In simulation, as the paper’s last experiment: a robot has the pegs " (names.join(", ")) " and touches one hole after "
            "the other, first anywhere on it and at any angle, until the filter stops by its own rule. It then brings the peg that "
            "was named to the pose that was estimated. A hole is wider than its peg by " (run.clearance_mm) " mm on every side and its "
            "plate is tilted against the tool by " (assembly.tilt_deg) "°; the robot holds the peg up to " (assembly.grasp_error_mm)
            " mm and " (assembly.grasp_error_deg) "° off" (felt) ". A try " (searched) ". A peg that does not go in is evidence: the "
            "hole is touched again, and tried " (insertion.tries) " times at most. A peg that is in is no candidate for later holes."
        }
        p.caution {
            b { "To know before reading the figures:" } " boards, sensor and robot are simulated, no real peg was inserted. Geometry "
            "decides: a peg is in where its outline goes into the opening. There is no force, no friction and no jamming. A hole at "
            "the touch limit is not given up: its peg is tried at the best estimate so far. The letters M, L, T and F and the stop "
            "on a well-known place were chosen on figures like these, so they are no blind test. The 95 % intervals cover other "
            "holes, poses and frames of one model and one simulated print of each part."
        }
        div.tiles {
            (tile(percent_sign(all_inserted.share), html! {
                "of trials: every peg in its hole (" (interval(all_inserted.ci95)) "\u{a0}%); aim: 95\u{a0}%"
            }))
            (tile(percent_sign(holes.inserted.share), "of holes got their own peg"))
            (tile(number(holes.touches_median, 0), html! {
                "touches a hole, median; mean " (number(holes.touches_mean, 1)) "; aim: 4"
            }))
            (tile(
                format!("{}\u{a0}s", number(holes.seconds_mean, 1)),
                html! {
                    "a hole, mean: " (assembly.speeds.touch_s) " s a touch or a try, " (assembly.speeds.mm_s) " mm/s between touches, "
                    (insertion.slide_mm_s) " mm/s along the plate"
                }
            ))
            (tile(
                format!("{} mm · {}°", number(holes.xy_mm_median, 2), number(holes.theta_deg_median, 1)),
                "median error of a right peg where its last try began, grasp error included"
            ))
            (tile(milliseconds(decision_ms.p50), html! {
                "from frame to decision, median; 99 of 100 within " (milliseconds(decision_ms.p99))
            }))
        }
    }
}

/// The cells of a group: its name and then `GROUP_HEADS`.
pub fn group_cells(group: &Group) -> Vec<Markup> {
    cells![
        group.name,
        group.inserted.of,
        share(group.inserted.share, group.inserted.ci95),
        mean(group.touches_mean, Some(group.touches_median), 1),
        number(group.tries_mean, 2),
        number(group.seconds_mean, 1),
        mean(group.xy_mm_mean, Some(group.xy_mm_median), 2),
        mean(group.theta_deg_mean, Some(group.theta_deg_median), 1),
        group.wrong_pose,
        group.wrong_part,
        group.wrong_part_went_in,
    ]
}

/// A table of groups; `head` says what the holes of each have in common.
pub fn group_table<'g>(head: &str, groups: impl IntoIterator<Item = &'g Group>) -> Markup {
    let rows: Vec<_> = groups.into_iter().map(group_cells).collect();
    sortable(&[&[head], &GROUP_HEADS[..]].concat(), &rows)
}

fn by_part(assembly: &Assembly) -> Section {
    let table = group_table("Part", assembly.parts.iter().chain([&assembly.holes]));
    let caption = "Each hole’s part. Place and angle: how far from its hole a peg of the right part was brought, whether it went in \
        or not, so that a few far misses pull the mean away from the median. Look here for the part that costs trials.";
    Section::new("Parts", "Part by part", figure(table, caption))
}

fn by_stop(assembly: &Assembly) -> Section {
    let body = html! {
        (figure(group_table("Stopped by", &assembly.stops), "Why the touching ended. The robot tries its best estimate for every \
            reason, the touch limit included: a peg that does not go in is felt."))
        (figure(group_table("Pegs left", &assembly.pegs_left), "How many pegs it chose from. With one peg left there is nothing to \
            name, only a place to find."))
    };
    Section::new("Stops", "Why it stopped, and what it chose from", body)
}

fn failures(assembly: &Assembly) -> Section {
    let row = |failure: &Failure| {
        cells![
            failure.trial,
            failure.hole,
            failure.part,
            failure.named,
            if failure.went_in { "yes" } else { "no" },
            failure.n_pegs,
            stop_name(failure.stop),
            failure.n_touches,
            percent(failure.probability),
            number(failure.fit.unwrap_or(f64::NAN), 2),
            number(failure.xy_mm, 2),
            number(failure.theta_deg, 1),
        ]
    };
    let rows: Vec<_> = assembly.failures.iter().take(MOST_FAILURES).map(row).collect();
    let heads = [
        "Trial",
        "hole",
        "part",
        "peg tried",
        "went in",
        "pegs left",
        "stopped by",
        "touches",
        "sure, %",
        "fit",
        "place, mm",
        "angle, degrees",
    ];
    let caption = html! {
        "The " (assembly.failures.len()) " holes that did not get their own peg"
        @if assembly.failures.len() > MOST_FAILURES { ", the first of them" }
        ". Place and angle: where the peg that was tried was brought. Sort by what you suspect: many touches, little probability, a "
        "fit near the limit."
    };
    Section::new("Failures", "What went wrong", figure(sortable(&heads, &rows), caption))
}

fn how_made(assembly: &Assembly) -> Section {
    let run = &assembly.run;
    let mut entries: Vec<_> = run.command.iter().map(|line| ("Command", html! { code { (line) } })).collect();
    entries.extend(model_entries(&run.model));
    entries.extend([
        ("Bank", html! { "recorded every " (run.recorded.xy_step_mm) " mm and " (run.recorded.theta_step_deg) "°" }),
        ("Trials", html! { (assembly.n_trials) ", " (seeds(&assembly.seeds)) }),
        ("Device", html! { (run.device) }),
    ]);
    Section::new("How made", "How this was made", definitions(&entries))
}

#[cfg(test)]
mod tests {
    use super::super::result::tests::example;
    use super::*;

    #[test]
    fn the_page_has_every_figure_and_needs_nothing_else() {
        let html = html(&example(), &Board::empty(), &[]).unwrap();
        // Two of four trials; five of eight holes; median 3 and mean 33 / 8 touches.
        for figure in ["<b>50.0\u{a0}%</b>", "<b>62.5\u{a0}%</b>", "<b>3</b>touches a hole, median; mean 4.1"] {
            assert!(html.contains(figure), "{figure}");
        }
        assert!(html.contains("two &lt;letters&gt;") && html.contains("L&lt;") && !html.contains("L<<"));
        assert!(html.contains("The 3 holes that did not get their own peg."));
        for outside in ["http:", "https:", "<link", "@import", "fetch("] {
            assert!(!html.contains(outside), "{outside}");
        }
    }

    #[test]
    fn the_belief_maps_have_their_styles() {
        let html = html(&example(), &crate::narrative::tests::board(), &[crate::narrative::tests::episode()]).unwrap();
        assert!(html.contains(r##"<use href="#part-0" class="part">"##) && html.contains(".map .part { fill: none;"));
        assert!(html.contains(r#"id="belief-maps""#));
    }

    #[test]
    fn the_page_says_what_limits_its_figures() {
        let html = html(&example(), &Board::empty(), &[]).unwrap();
        for said in ["no force, no friction", "presses it 2 times", "touch limit is not given up", "no blind test"] {
            assert!(html.contains(said), "{said}");
        }
    }
}
