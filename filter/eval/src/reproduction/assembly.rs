//! Assembly of M, L, T and F, with its belief maps.

use maud::html;

use super::experiments::Section;
use super::folder::Reproduction;
use super::section::{Finding, met};
use crate::assembly::{Assembly, Share, group_table};
use crate::page::numbers::{capital, interval, number, percent, seeds};
use crate::page::shell::figure;

/// Share of trials in which every peg is to be in its hole.
const AIM_SHARE: f64 = 0.95;
/// Touches a hole is to take, median.
const AIM_TOUCHES: f64 = 4.0;

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let Some(assembly) = &found.assembly else { return Finding::not_run(section, "assembly") };
    let line = verdict(assembly);
    let caption = html! {
        "In each trial a robot touches one hole after the other until the filter stops by its own rule, or at the touch limit; in "
        "both cases it then brings the peg that was named to where the hole is believed to be and slides it until it goes in. The hole "
        "is wider by " (assembly.run.clearance_mm) " mm on every side; the peg is held up to " (assembly.grasp_error_mm) " mm and "
        (assembly.grasp_error_deg) "° off, which " (assembly.insertion.peg_touches) " touches of a second sensor feel. Geometry decides: "
        "there is no friction and no force. Place and angle: where a right peg was brought, the "
        "grasp’s error included. It is the paper’s last experiment, there on a real robot. " (assembly.n_trials) " trials, "
        (seeds(&assembly.seeds)) ". " b { "Belief maps" } ", hole by hole and touch by touch, in which the belief should gather in "
        "one place of one letter: " (found.link("assembly/report.html", "belief-maps", "the assembly’s own page")) "."
    };
    let table = group_table("Part", assembly.parts.iter().chain([&assembly.holes]));
    let body = html! { p { (capital(&line)) "." } (figure(table, caption)) };
    Finding::new(section, body, &line)
}

/// Against the two aims.
fn verdict(assembly: &Assembly) -> String {
    let Share { n, of, share, ci95 } = assembly.all_inserted;
    let touches = assembly.holes.touches_median;
    format!(
        "every peg in its hole in {n} of {of} trials, {} % ({}; aim 95 %: {}); median {} touches a hole (aim at most {}: {})",
        percent(share),
        interval(ci95),
        met(share >= AIM_SHARE),
        number(touches, 0),
        number(AIM_TOUCHES, 0),
        met(touches <= AIM_TOUCHES)
    )
}

#[cfg(test)]
mod tests {
    use super::super::experiments::tests::section;
    use super::*;
    use crate::assembly::example;
    use maud::Render;

    #[test]
    fn an_aim_that_was_missed_is_said_to_be() {
        let found = Reproduction { assembly: Some(example()), ..Reproduction::default() };
        let finding = finding(&found, &section("Assembly"));
        // Two of four trials; Wilson's interval of 1/2 with n = 4: 15.0 to 85.0 %; median 3 touches.
        let expected = "Assembly: every peg in its hole in 2 of 4 trials, 50.0 % (15.0–85.0; aim 95 %: not met); \
                        median 3 touches a hole (aim at most 4: met)";
        assert_eq!(finding.line, expected);
        assert!(finding.section.render().0.contains("L&lt;"));
        assert_eq!(super::finding(&Reproduction::default(), &section("Assembly")).line, "Assembly: not run");
    }
}
