//! How it was made: every step, its command and what it took; the models and the seeds.

use std::collections::BTreeSet;

use maud::{Markup, html};

use super::experiments::Section;
use super::folder::{Reproduction, Step};
use super::section::Finding;
use crate::page::numbers::{capital, number, seeds};
use crate::page::shell::figure;
use crate::page::table::{cells, sortable};
use crate::result::Evaluation;

/// The section.
pub fn finding(found: &Reproduction, section: &Section) -> Finding {
    let models: BTreeSet<(&str, &str)> = models(found);
    let body = html! {
        @if found.steps.is_empty() {
            p.note { "Not known: " code { "reproduce.json" } " is not there." }
        } @else {
            (of_steps(found))
        }
        @if models.len() > 1 {
            p.caution { "Not all was measured with the same model: the tables are not of one kind." }
        }
        dl { @for (name, sha256) in &models { dt { "Model " (name) } dd { code { (sha256) } } } }
        (of_evaluations(found))
    };
    Finding::new(section, body, &total(found).unwrap_or_else(|| "time not known".into()))
}

fn of_steps(found: &Reproduction) -> Markup {
    let row = |(name, step): (&String, &Step)| {
        cells![
            html! { (name) @if !step.finished { small { "not finished" } } },
            number(step.seconds, 1),
            step.peak_mib.map_or("–".into(), |mib| number(mib, 0)),
            html! { code { (step.command) } },
        ]
    };
    let rows: Vec<_> = found.steps.iter().map(row).collect();
    let table = html! { div.steps { (sortable(&["Step", "seconds", "peak, MiB", "command"], &rows)) } };
    html! {
        p { (capital(&total(found).unwrap_or_default())) "." }
        (figure(table, "Each command makes its step again. Sort by seconds to see where the time went. A step that was cut short and \
            continued has the sum of its times."))
    }
}

/// Steps, time in all and most memory; `None` where no step is known.
pub fn total(found: &Reproduction) -> Option<String> {
    let seconds: f64 = found.steps.values().map(|step| step.seconds).sum();
    let n_finished = found.steps.values().filter(|step| step.finished).count();
    let peak = found.steps.values().filter_map(|step| step.peak_mib).reduce(f64::max);
    let peak = peak.map_or(String::new(), |mib| format!(", at most {} MiB", number(mib, 0)));
    let n = found.steps.len();
    (n > 0).then(|| format!("{n_finished} of {n} steps done in {}{peak}", duration(seconds)))
}

/// A time in its largest two units.
fn duration(seconds: f64) -> String {
    let whole = seconds.max(0.0).round() as u64;
    match (whole / 3_600, whole / 60 % 60, whole % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

/// Name and checksum of each model.
fn models(found: &Reproduction) -> BTreeSet<(&str, &str)> {
    let evaluations = found.evaluations.iter().map(|(_, evaluation)| &evaluation.model);
    let all = evaluations.chain(found.assembly.iter().map(|assembly| &assembly.run.model));
    all.map(|model| (model.name.as_str(), model.sha256.as_str())).collect()
}

fn of_evaluations(found: &Reproduction) -> Markup {
    if found.evaluations.is_empty() {
        return html! {};
    }
    let row = |(name, evaluation): &(String, Evaluation)| {
        cells![
            found.report(name, name),
            evaluation.scene,
            evaluation.n_classes,
            evaluation.n_episodes,
            seeds(&evaluation.seeds),
            html! { code { (evaluation.model.sha256.chars().take(8).collect::<String>()) } },
            html! { @if let Some(line) = &evaluation.command { code { (line) } } @else { "–" } },
        ]
    };
    let rows: Vec<_> = found.evaluations.iter().map(row).collect();
    let heads = ["Evaluation", "scene", "classes", "episodes", "seeds", "model", "command"];
    let table = html! { div.steps { (sortable(&heads, &rows)) } };
    figure(table, "What each evaluation of this page was made with; its name leads to its own report.")
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::experiments::tests::section;
    use super::super::folder::tests::of;
    use super::*;
    use maud::Render;

    #[test]
    fn times_add_up_and_what_was_cut_short_is_said() {
        let step = |finished, seconds, peak_mib| Step { command: "a < b".into(), finished, seconds, peak_mib };
        let mut found = of(&[("small", evaluation("s", 0.5, &[]))]);
        assert!(super::finding(&found, &section("Every step")).section.render().0.contains("reproduce.json"));
        found.steps.insert("one".into(), step(true, 3_599.5, Some(64.0)));
        found.steps.insert("two".into(), step(false, 61.0, None));
        let finding = finding(&found, &section("Every step"));
        assert_eq!(finding.line, "Every step: 1 of 2 steps done in 1 h 1 min, at most 64 MiB");
        let html = finding.section.render().0;
        assert!(html.contains("two<small>not finished</small>") && html.contains("a &lt; b"));
    }

    #[test]
    fn two_models_on_one_page_are_a_caution() {
        let one = evaluation("s", 0.5, &[]);
        let mut other = one.clone();
        other.model.sha256 = "cd".into();
        assert!(
            !finding(&of(&[("small", one.clone())]), &section("Every step"))
                .section
                .render()
                .0
                .contains("class=\"caution\"")
        );
        assert!(
            finding(&of(&[("small", one), ("large", other)]), &section("Every step"))
                .section
                .render()
                .0
                .contains("class=\"caution\"")
        );
    }

    #[test]
    fn a_time_has_two_units() {
        assert_eq!([7.4, 90.0, 7_260.0].map(duration), ["7 s", "1 min 30 s", "2 h 1 min"]);
    }
}
