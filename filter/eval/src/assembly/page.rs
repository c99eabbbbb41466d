//! The assembly as one HTML page: figures, parts, what went wrong, belief maps.

use std::io;

use super::super::report::shell::{Section, shell};
use super::super::report::table::{SCRIPT, sortable};
use super::super::report::{Board, EpisodeStory, escape, number, story};
use super::result::{Assembly, Failure, Group, stop_name};

/// Failures listed at most.
const MOST_FAILURES: usize = 100;

/// The whole page; `stories` are one trial's holes.
///
/// # Errors
/// A frame that cannot be drawn.
pub fn html(assembly: &Assembly, board: &Board, stories: &[EpisodeStory]) -> io::Result<String> {
    let sections: Vec<Section> = [
        Some(by_part(assembly)),
        Some(by_stop(assembly)),
        (!assembly.failures.is_empty()).then(|| failures(assembly)),
        maps(board, stories)?,
        Some(how_made(assembly)),
    ]
    .into_iter()
    .flatten()
    .collect();
    Ok(shell(&format!("Tactile-Filter: assembly of {}", assembly.run.scene), "", &top(assembly), &sections, &[SCRIPT]))
}

fn top(assembly: &Assembly) -> String {
    let holes = &assembly.holes;
    let [low, high] = assembly.all_inserted.ci95.map(percent);
    let tiles = [
        tile(
            &format!("{}&nbsp;%", percent(assembly.all_inserted.share)),
            &format!("of trials: every peg in its hole ({low}–{high}&nbsp;%); aim: 95&nbsp;%"),
        ),
        tile(&format!("{}&nbsp;%", percent(holes.inserted.share)), "of holes got their own peg"),
        tile(
            &number(holes.touches_median, 0),
            &format!("touches a hole, median; mean {}; aim: 4", number(holes.touches_mean, 1)),
        ),
        tile(
            &format!("{} mm · {}°", number(holes.xy_mm_median, 2), number(holes.theta_deg_median, 1)),
            "median error of a right peg where it was brought, grasp error included",
        ),
        tile(
            &format!("{}&nbsp;ms", number(assembly.decision_ms.p50, 1)),
            &format!(
                "from frame to decision, median; 99 of 100 within {}&nbsp;ms",
                number(assembly.decision_ms.p99, 0)
            ),
        ),
    ];
    let names: Vec<_> = assembly.parts.iter().map(|group| escape(&group.name)).collect();
    format!(
        r#"<h1>Touch, name, insert: {}</h1>
<p>In simulation, as the paper’s last experiment: a robot has the pegs {} and touches one hole after the other, first
anywhere on it and at any angle, until the filter stops by its own rule. It then brings the peg that was named to the pose that was
estimated. A peg is in where its outline goes into the hole, wider than the peg by {} mm on every side; the robot holds it up to {} mm
and {}° off. A peg that is in is no candidate for later holes. Boards, sensor and robot are simulated: no real peg was inserted.</p>
<div class="tiles">{}</div>
"#,
        escape(&assembly.run.scene),
        names.join(", "),
        assembly.run.clearance_mm,
        assembly.grasp_error_mm,
        assembly.grasp_error_deg,
        tiles.concat()
    )
}

fn tile(figure: &str, what: &str) -> String {
    format!(r#"<div class="tile"><b>{figure}</b>{what}</div>"#)
}

fn percent(share: f64) -> String {
    number(100.0 * share, 1)
}

/// A table of groups; `head` says what they have in common.
fn table(head: &str, groups: &[&Group]) -> String {
    let row = |group: &&Group| {
        let [low, high] = group.inserted.ci95.map(percent);
        let with_median = |mean, median, decimals| {
            format!("{}<small>median {}</small>", number(mean, decimals), number(median, decimals))
        };
        vec![
            escape(&group.name),
            group.inserted.of.to_string(),
            format!("{}<small>{low}–{high}</small>", percent(group.inserted.share)),
            with_median(group.touches_mean, group.touches_median, 1),
            with_median(group.xy_mm_mean, group.xy_mm_median, 2),
            with_median(group.theta_deg_mean, group.theta_deg_median, 1),
            group.wrong_pose.to_string(),
            group.wrong_part.to_string(),
            group.wrong_part_went_in.to_string(),
        ]
    };
    let columns = ["holes", "own peg in, %", "touches", "place, mm", "angle, degrees"];
    let wrong = ["right peg, wrong place", "wrong peg", "which went in"];
    let heads: Vec<&str> = [head].into_iter().chain(columns).chain(wrong).collect();
    sortable(&heads, &groups.iter().map(row).collect::<Vec<_>>())
}

fn by_part(assembly: &Assembly) -> Section {
    let groups: Vec<&Group> = assembly.parts.iter().chain([&assembly.holes]).collect();
    let body = format!(
        r#"<figure>{}
<figcaption>Each hole’s part. Place and angle: how far from its hole a peg of the right part was brought, whether it went in or not, so
that a few far misses pull the mean away from the median. Look here for the part that costs trials.</figcaption></figure>"#,
        table("Part", &groups)
    );
    Section::new("Parts", "Part by part", body)
}

fn by_stop(assembly: &Assembly) -> Section {
    let groups = |of: &'static str, groups: &[Group]| table(of, &groups.iter().collect::<Vec<_>>());
    let body = format!(
        r#"<figure>{}
<figcaption>Why the touching ended. The robot tries its best estimate whatever that was: a peg that does not go in is felt.</figcaption></figure>
<figure>{}
<figcaption>How many pegs it chose from. With one peg left there is nothing to name, only a place to find.</figcaption></figure>"#,
        groups("Stopped by", &assembly.stops),
        groups("Pegs left", &assembly.pegs_left)
    );
    Section::new("Stops", "Why it stopped, and what it chose from", body)
}

fn failures(assembly: &Assembly) -> Section {
    let row = |failure: &Failure| {
        vec![
            failure.trial.to_string(),
            failure.hole.to_string(),
            escape(&failure.part),
            escape(&failure.named),
            if failure.went_in { "yes" } else { "no" }.into(),
            failure.n_pegs.to_string(),
            stop_name(failure.stop).into(),
            failure.n_touches.to_string(),
            number(100.0 * failure.probability, 1),
            number(failure.fit.unwrap_or(f64::NAN), 2),
            number(failure.xy_mm, 2),
            number(failure.theta_deg, 1),
        ]
    };
    let rows: Vec<_> = assembly.failures.iter().take(MOST_FAILURES).map(row).collect();
    let heads = ["Trial", "hole", "part", "peg tried", "went in", "pegs left", "stopped by", "touches"];
    let heads: Vec<&str> = heads.into_iter().chain(["sure, %", "fit", "place, mm", "angle, degrees"]).collect();
    let shown = if assembly.failures.len() > MOST_FAILURES { ", the first of them" } else { "" };
    let body = format!(
        r#"<figure>{}
<figcaption>The {} holes that did not get their own peg{shown}. Place and angle: where the peg that was tried was brought. Sort by what
you suspect: many touches, little probability, a fit near the limit.</figcaption></figure>"#,
        sortable(&heads, &rows),
        assembly.failures.len()
    );
    Section::new("Failures", "What went wrong", body)
}

fn maps(board: &Board, stories: &[EpisodeStory]) -> io::Result<Option<Section>> {
    if stories.is_empty() {
        return Ok(None);
    }
    let told = stories.iter().map(|told| story::section(told, board)).collect::<io::Result<String>>()?;
    let body = format!(
        r#"{}<p class="note">The first trial, hole by hole; a row is a touch. <b>Where it touched:</b> the true part in grey, what the sensor covered
in red, the newest filled. <b>What the camera saw,</b> and <b>what changed</b> from the sensor at rest. <b>Where the first touch was:</b> a map
for each part, the stronger the blue the more probable; the red ring is the truth. A part whose peg is in already has 0 %.</p>
{told}"#,
        story::outlines(board)
    );
    Ok(Some(Section::new("Belief maps", "Belief maps, touch by touch", body)))
}

fn how_made(assembly: &Assembly) -> Section {
    let run = &assembly.run;
    let [width, height] = run.model.input_px;
    let seeds: Vec<_> = assembly.seeds.iter().map(u64::to_string).collect();
    let command = run.command.as_ref();
    let command = command.map(|line| format!("<dt>Command</dt><dd><code>{}</code></dd>", escape(line)));
    let body = format!(
        r#"<dl>{}<dt>Model</dt><dd>{}, {} parameters, input {width} × {height} pixels</dd>
<dt>Model’s SHA-256</dt><dd><code>{}</code></dd><dt>Bank</dt><dd>pegs recorded every {} mm and {}°</dd>
<dt>Trials</dt><dd>{}, seeds {}</dd><dt>Device</dt><dd>{}</dd></dl>"#,
        command.unwrap_or_default(),
        escape(&run.model.name),
        run.model.parameters,
        escape(&run.model.sha256),
        run.recorded.xy_step_mm,
        run.recorded.theta_step_deg,
        assembly.n_trials,
        seeds.join(", "),
        escape(&run.device),
    );
    Section::new("How made", "How this was made", body)
}

#[cfg(test)]
mod tests {
    use super::super::result::tests::made;
    use super::*;
    use tactile_data::grid::PoseGrid;

    #[test]
    fn the_page_tells_every_figure_and_needs_nothing_else() {
        let board = Board { parts: Vec::new(), grid: PoseGrid::LARGE, field_of_view_mm: [17.0, 13.0] };
        let html = html(&made(), &board, &[]).unwrap();
        // Two of four trials; five of eight holes; median 3 and mean 33 / 8 touches.
        for figure in ["<b>50.0&nbsp;%</b>", "<b>62.5&nbsp;%</b>", "<b>3</b>touches a hole, median; mean 4.1"] {
            assert!(html.contains(figure), "{figure}");
        }
        assert!(html.contains("two &lt;letters&gt;") && html.contains("L&lt;") && !html.contains("L<<"));
        assert!(html.contains("The 3 holes that did not get their own peg."));
        for outside in ["http:", "https:", "<link", "@import", "fetch("] {
            assert!(!html.contains(outside), "{outside}");
        }
        for tag in ["table", "tr", "td", "th", "section", "figure", "figcaption", "div", "p", "dl", "dt", "dd", "small"]
        {
            let open = html.matches(&format!("<{tag} ")).count() + html.matches(&format!("<{tag}>")).count();
            assert_eq!(open, html.matches(&format!("</{tag}>")).count(), "{tag}");
        }
    }
}
