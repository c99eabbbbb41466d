//! Speed against accuracy: the verdict, the planes, the default setting.

use maud::{Markup, html};
use tactile_filter::Settings;
use tactile_filter::belief::EngineConfig;
use tactile_filter::budget::{Point, Setup, Tradeoff};
use tactile_filter::choice::ActionRule;
use tactile_infer::embedding::precision::Precision;

use super::experiments::Section;
use super::folder::Reproduction;
use super::section::{Finding, met};
use crate::page::numbers::{number, percent};
use crate::report::tradeoff::{Verdict, planes, tiles, verdict};

/// Median and 99th percentile that a whole decision of the default setting is to take on one core, ms.
const AIM_MS: [f64; 2] = [6.0, 12.0];
/// How many times as fast as the best the fastest setting within two points of it is to be.
const AIM_FASTER: f64 = 5.0;
/// Setup that are to be measured, points on the frontier and the factor in time that these are to span.
const AIM_FRONTIER: (usize, usize, f64) = (40, 8, 20.0);

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let Some(tradeoff) = &found.tradeoff else { return Finding::not_run(section, "tradeoff") };
    let Some(verdict) = verdict(tradeoff) else {
        return Finding::missing(section, html! { p.note { "Not run: no setting was measured." } });
    };
    let model = found.evaluations.first().map(|(_, evaluation)| evaluation.model.sha256.as_str());
    let body = html! {
        div.tiles { (tiles(&verdict)) }
        p { (aims(&verdict)) }
        p {
            @match default_setting(tradeoff, model) {
                Some(point) => (of_default(point)),
                None => "The default setting is not among those measured.",
            }
        }
        (planes(tradeoff))
        p {
            "Which knob buys most, and every point: " (found.link("tradeoff/tradeoff.html", "", "the trade-off’s own page")) ". "
            (tradeoff.n_episodes) " episodes of " (tradeoff.scene) ", timed on " (tradeoff.machine) "."
        }
    };
    Finding::new(section, body, &fastest(&verdict))
}

/// The fastest setting near the best, in words.
pub fn fastest(verdict: &Verdict<'_>) -> String {
    let Verdict { best, fast, .. } = verdict;
    format!(
        "{} ms a decision within 2 points of the best ({} % against {} %), {} times as fast (aim {}: {})",
        number(fast.decision_ms_p50, 2),
        percent(fast.accuracy),
        percent(best.accuracy),
        number(best.decision_ms_p50 / fast.decision_ms_p50, 1),
        number(AIM_FASTER, 0),
        met(best.decision_ms_p50 >= AIM_FASTER * fast.decision_ms_p50)
    )
}

fn aims(verdict: &Verdict<'_>) -> String {
    let (n_settings, n_frontier, span) = AIM_FRONTIER;
    format!(
        "The fastest: {}. {} settings measured (aim {n_settings}: {}), {} points on the frontier (aim {n_frontier}: {}), whose times span a \
         factor of {} (aim {span}: {}).",
        fastest(verdict),
        verdict.n_settings,
        met(verdict.n_settings >= n_settings),
        verdict.n_frontier,
        met(verdict.n_frontier >= n_frontier),
        number(verdict.span, 0),
        met(verdict.span >= span)
    )
}

fn of_default(point: &Point) -> Markup {
    let [half, most] = AIM_MS;
    let (p50, p99) = (point.decision_ms_p50, point.decision_ms_p99);
    html! {
        b { "The default setting" } " takes " (number(p50, 1)) " ms for a whole decision (encode, update, choose) on one core, median "
        "(aim " (half) ": " (met(p50 <= half)) "), and 99 in 100 take no more than " (number(p99, 1)) " ms (aim " (most) ": "
        (met(p99 <= most)) "); the paper takes about 600 ms on a GPU (0.3 s for the weights, 0.3 s for the action)."
    }
}

/// The default of the filter with the bank for poses anywhere: of the model of the evaluations, where it was measured.
fn default_setting<'a>(tradeoff: &'a Tradeoff, model_sha256: Option<&str>) -> Option<&'a Point> {
    let is_default = |of: &Setup| {
        (of.xy_step_mm, of.theta_step_deg, of.subdivisions) == (2.0, 15.0, 2)
            && (of.rows, of.rule) == (Precision::F32, ActionRule::Information)
            && matches!(of.engine, EngineConfig::Exact)
            && (of.n_finalists, of.n_draws, of.n_suppositions) == (Some(24), 160, 24)
            && (of.verify, of.false_accept) == (None, Settings::default().false_accept)
    };
    let points = || tradeoff.points.iter().filter(|point| is_default(&point.settings));
    let same_model = |point: &&Point| Some(point.settings.model_sha256.as_str()) == model_sha256;
    points().find(same_model).or_else(|| points().next())
}

#[cfg(test)]
mod tests {
    use super::super::experiments::tests::section;
    use super::*;
    use crate::report::tradeoff::tests::{halves, settings};
    use maud::Render;
    use tactile_filter::budget::{SCHEMA, Speeds};

    fn tradeoff() -> Tradeoff {
        let point = |settings, accuracy, ms: f64| Point {
            settings,
            n_touches: 3,
            accuracy,
            accuracy_ci95: [0.5, 1.0],
            halves: halves(accuracy, 3),
            strangers: None,
            xy_mm_mean: 0.5,
            theta_deg_mean: 2.0,
            decision_ms_p50: ms,
            decision_ms_p99: 3.0 * ms,
            pace_ms: ms,
            memory_mb: 10.0,
            dominated: false,
        };
        let slow = Setup { n_finalists: None, ..settings() };
        let other_model = Setup { model_sha256: "cd".into(), ..settings() };
        Tradeoff {
            schema: SCHEMA.into(),
            scene: "a<b".into(),
            recorded: false,
            poses: "off-grid".into(),
            n_classes: 12,
            n_episodes: 100,
            seeds: vec![1],
            machine: "one core".into(),
            command: "tactile-filter tradeoff".into(),
            speeds: Speeds::default(),
            points: vec![point(slow, 0.96, 40.0), point(settings(), 0.95, 5.0), point(other_model, 0.9, 1.0)],
        }
    }

    #[test]
    fn the_default_setting_is_compared_with_its_aims() {
        let found = Reproduction { tradeoff: Some(tradeoff()), ..Reproduction::default() };
        let finding = finding(&found, &section("Speed"));
        assert_eq!(
            finding.line,
            "Speed: 5.00 ms a decision within 2 points of the best (95.0 % against 96.0 %), 8.0 times as fast (aim 5: met)"
        );
        let html = finding.section.render().0;
        assert!(
            html.contains("takes 5.0 ms for")
                && html.contains("(aim 6: met)")
                && html.contains("15.0 ms (aim 12: not met)")
        );
        assert!(html.contains("a&lt;b") && html.contains("3 settings measured (aim 40: not met)"));
    }

    #[test]
    fn the_default_of_the_same_model_comes_first() {
        let tradeoff = tradeoff();
        let of = |sha| default_setting(&tradeoff, sha).unwrap().decision_ms_p50;
        assert_eq!((of(Some("cd")), of(Some("ab")), of(Some("ef"))), (1.0, 5.0, 5.0));
    }
}
