//! How it was made: every step, its command and what it took; the models and the seeds.

use std::collections::BTreeSet;

use super::super::report::table::sortable;
use super::super::report::{escape, number};
use super::super::result::Evaluation;
use super::folder::{Reproduction, Step};
use super::{Told, page};

/// Its entry in the contents.
const SHORT: &str = "Every step";
/// CSS of these tables: command lines are long.
pub const STYLE: &str = ".steps td { vertical-align: top; } .steps td:last-child, .steps th:last-child { text-align: left; white-space: normal;
overflow-wrap: anywhere; min-width: 20rem; }";

/// The section.
pub fn tell(found: &Reproduction) -> Told {
    let title = "Every step, its command and its time";
    let steps = if found.steps.is_empty() {
        r#"<p class="note">Not known: <code>reproduce.json</code> is not there.</p>"#.into()
    } else {
        of_steps(found)
    };
    let models: BTreeSet<(&str, &str)> = models(found);
    let names: String = models
        .iter()
        .map(|(name, sha256)| format!("<dt>Model {}</dt><dd><code>{}</code></dd>", escape(name), escape(sha256)))
        .collect();
    let caution = if models.len() > 1 {
        r#"<p class="caution">Not all was measured with the same model: the tables are not of one kind.</p>"#
    } else {
        ""
    };
    let body = format!("{steps}{caution}<dl>{names}</dl>{}", of_evaluations(found));
    Told::new(SHORT, title, body, format!("{SHORT}: {}", total(found).unwrap_or_else(|| "time not known".into())))
}

fn of_steps(found: &Reproduction) -> String {
    let row = |(name, step): (&String, &Step)| {
        let unfinished = if step.finished { "" } else { "<small>not finished</small>" };
        vec![
            escape(name) + unfinished,
            number(step.seconds, 1),
            step.peak_mib.map_or("–".into(), |mib| number(mib, 0)),
            format!("<code>{}</code>", escape(&step.command)),
        ]
    };
    let rows: Vec<_> = found.steps.iter().map(row).collect();
    format!(
        r#"<p>{}.</p><figure class="steps">{}<figcaption>Each command makes its step again. Sort by seconds to see where the time went. A step that was cut short
and gone on with has the sum of its times.</figcaption></figure>"#,
        page::capital(&total(found).unwrap_or_default()),
        sortable(&["Step", "seconds", "peak, MiB", "command"], &rows)
    )
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

fn of_evaluations(found: &Reproduction) -> String {
    if found.evaluations.is_empty() {
        return String::new();
    }
    let row = |(name, evaluation): &(String, Evaluation)| {
        let seeds: Vec<_> = evaluation.seeds.iter().map(u64::to_string).collect();
        vec![
            found.report(name, name),
            escape(&evaluation.scene),
            evaluation.n_classes.to_string(),
            evaluation.n_episodes.to_string(),
            seeds.join(", "),
            format!("<code>{}</code>", escape(&evaluation.model.sha256.chars().take(8).collect::<String>())),
            evaluation.command.as_ref().map_or("–".into(), |line| format!("<code>{}</code>", escape(line))),
        ]
    };
    let rows: Vec<_> = found.evaluations.iter().map(row).collect();
    let heads = ["Evaluation", "scene", "classes", "episodes", "seeds", "model", "command"];
    format!(
        r#"<figure class="steps">{}<figcaption>What stands behind each evaluation of this page; its name leads to its own report.</figcaption></figure>"#,
        sortable(&heads, &rows)
    )
}

#[cfg(test)]
mod tests {
    use super::super::cell::tests::evaluation;
    use super::super::folder::tests::of;
    use super::*;

    #[test]
    fn times_add_up_and_what_was_cut_short_is_said() {
        let step = |finished, seconds, peak_mib| Step { command: "a < b".into(), finished, seconds, peak_mib };
        let mut found = of(&[("small", evaluation("s", 0.5, &[]))]);
        assert!(tell(&found).section.html().contains("reproduce.json"));
        found.steps.insert("one".into(), step(true, 3_599.5, Some(64.0)));
        found.steps.insert("two".into(), step(false, 61.0, None));
        let told = tell(&found);
        assert_eq!(told.line, "Every step: 1 of 2 steps done in 1 h 1 min, at most 64 MiB");
        let html = told.section.html();
        assert!(html.contains("two<small>not finished</small>") && html.contains("a &lt; b"));
    }

    #[test]
    fn two_models_on_one_page_are_a_caution() {
        let one = evaluation("s", 0.5, &[]);
        let mut other = one.clone();
        other.model.sha256 = "cd".into();
        assert!(!tell(&of(&[("small", one.clone())])).section.html().contains("caution"));
        assert!(tell(&of(&[("small", one), ("large", other)])).section.html().contains("caution"));
    }

    #[test]
    fn a_time_has_two_units() {
        assert_eq!([7.4, 90.0, 7_260.0].map(duration), ["7 s", "1 min 30 s", "2 h 1 min"]);
    }
}
