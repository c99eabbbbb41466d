//! Assembly of M, L, T and F, with its belief maps.

use super::super::assembly::{Assembly, Group, Share};
use super::super::report::table::sortable;
use super::super::report::{escape, number};
use super::folder::Reproduction;
use super::{Told, page};

/// Its entry in the contents.
const SHORT: &str = "Assembly";
/// Share of trials in which every peg is to be in its hole.
const AIM_SHARE: f64 = 0.95;
/// Touches a hole is to take, median.
const AIM_TOUCHES: f64 = 4.0;

/// The section.
pub fn tell(found: &Reproduction) -> Told {
    let title = "Assembly of M, L, T and F, and belief maps";
    let Some(assembly) = &found.assembly else { return Told::not_run(SHORT, title, "assembly") };
    let line = verdict(assembly);
    let groups: Vec<&Group> = assembly.parts.iter().chain([&assembly.holes]).collect();
    let seeds: Vec<_> = assembly.seeds.iter().map(u64::to_string).collect();
    let body = format!(
        r#"<p>{}.</p><figure>{}
<figcaption>In each trial a robot touches one hole after the other until the filter stops by its own rule, then brings the peg that was named to
where the hole is believed. A peg is in where it goes into the hole of its own part, wider than the peg by {} mm on every side, held up to
{} mm and {}° off. Place and angle: where a right peg was brought, the grasp’s error included. It is the paper’s last
experiment, there on a real robot. {} trials, seeds {}. <b>Belief maps</b>, hole by hole and touch by touch, in which the belief
should gather in one place of one letter: {}.</figcaption></figure>"#,
        page::capital(&line),
        sortable(
            &["Part", "holes", "own peg in, %", "touches", "place, mm", "angle, degrees", "wrong place", "wrong peg"],
            &groups.iter().map(|group| row(group)).collect::<Vec<_>>()
        ),
        assembly.run.clearance_mm,
        assembly.grasp_error_mm,
        assembly.grasp_error_deg,
        assembly.n_trials,
        seeds.join(", "),
        found.link("assembly/report.html", "belief-maps", "the assembly’s own page"),
    );
    Told::new(SHORT, title, body, format!("{SHORT}: {line}"))
}

/// Against the two aims.
fn verdict(assembly: &Assembly) -> String {
    let Share { n, of, share, ci95 } = assembly.all_inserted;
    let [low, high] = ci95.map(|bound| number(100.0 * bound, 1));
    let met = |is_met| if is_met { "met" } else { "not met" };
    let touches = assembly.holes.touches_median;
    format!(
        "every peg in its hole in {n} of {of} trials, {} % ({low}–{high}; aim 95 %: {}); median {} touches a hole (aim at most {}: {})",
        number(100.0 * share, 1),
        met(share >= AIM_SHARE),
        number(touches, 0),
        number(AIM_TOUCHES, 0),
        met(touches <= AIM_TOUCHES)
    )
}

fn row(group: &Group) -> Vec<String> {
    let [low, high] = group.inserted.ci95.map(|bound| number(100.0 * bound, 1));
    let with_median = |mean, median, decimals| {
        format!("{}<small>median {}</small>", number(mean, decimals), number(median, decimals))
    };
    vec![
        escape(&group.name),
        group.inserted.of.to_string(),
        format!("{}<small>{low}–{high}</small>", number(100.0 * group.inserted.share, 1)),
        with_median(group.touches_mean, group.touches_median, 1),
        with_median(group.xy_mm_mean, group.xy_mm_median, 2),
        with_median(group.theta_deg_mean, group.theta_deg_median, 1),
        group.wrong_pose.to_string(),
        group.wrong_part.to_string(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::assembly::tests_made as made;

    #[test]
    fn an_aim_that_was_missed_is_said_to_be() {
        let found = Reproduction { assembly: Some(made()), ..Reproduction::default() };
        let told = tell(&found);
        // Two of four trials; Wilson's interval of 1/2 with n = 4: 15.0 to 85.0 %; median 3 touches.
        let expected = "Assembly: every peg in its hole in 2 of 4 trials, 50.0 % (15.0–85.0; aim 95 %: not met); \
                        median 3 touches a hole (aim at most 4: met)";
        assert_eq!(told.line, expected);
        assert!(told.section.html().contains("L&lt;"));
        assert_eq!(tell(&Reproduction::default()).line, "Assembly: not run");
    }
}
