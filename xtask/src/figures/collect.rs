//! The figures of the documents' tables from the folder of a whole `cargo xtask reproduce`.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use clap::ValueEnum;
use serde_json::Value;

use super::file::{Evaluated, Figure, Figures};
use super::table::Selected;
use crate::code::Code;
use crate::error::{Error, Result};
use crate::experiments::{Experiments, Part};
use crate::json;
use crate::reproduce::{Job, steps};
use crate::step::Step;
use crate::workspace::Workspace;

/// Takes every figure that a table has. Each must be of a step that finished with the command that the experiments give
/// to a whole run, and so must all that it was made of. What the folder has not finished stays as `before` has it.
pub fn collect(
    workspace: &Workspace,
    experiments: &Experiments,
    folder: &Path,
    before: &BTreeMap<String, Evaluated>,
) -> Result<Figures> {
    let notes = json::read(&folder.join("reproduce.json"))?;
    let model = workspace.shipped_model();
    let steps = steps(&Job::whole(workspace, experiments, &model), Part::value_variants())?;
    let mut wanted: BTreeMap<String, BTreeSet<(String, String)>> = BTreeMap::new();
    for table in &experiments.tables {
        for Selected { evaluation, way, figure } in table.selected()? {
            wanted.entry(evaluation).or_default().insert((way, figure));
        }
    }
    let mut evaluations = BTreeMap::new();
    for (name, figures) in wanted {
        if notes[&name]["finished"] != true
            && let Some(kept) = before.get(&name).filter(|kept| kept.has(&figures))
        {
            evaluations.insert(name, kept.clone());
            continue;
        }
        let code = code_of(&steps, &notes, &name).map_err(|error| error.within(folder))?;
        let path = folder.join(&name).join("evaluation.json");
        let evaluation = json::read(&path)?;
        let evaluated = evaluated(&evaluation, code, &figures).map_err(|error| error.within(&path))?;
        evaluations.insert(name, evaluated);
    }
    Ok(Figures::new(evaluations))
}

/// The code that made a step's product and all that it was made of.
fn code_of(steps: &[Step], notes: &Value, name: &str) -> Result<Code> {
    let Some(step) = steps.iter().find(|step| step.name == name) else {
        return Err(Error::invalid(name, "an evaluation of the experiments", "another"));
    };
    let note = &notes[name];
    let (expected, got) = (without_folders(&step.command()), note["command"].as_str().map(without_folders));
    if note["finished"] != true || got.as_ref() != Some(&expected) {
        let got = got.map_or("nothing".into(), |got| format!("`{got}`"));
        let got = if note["finished"] == true { got } else { format!("{got}, not finished") };
        return Err(Error::invalid(name, format!("a whole run's `{expected}`"), got));
    }
    // A preset may have the name of an evaluation: what a step is made of comes before it.
    let earlier = steps.iter().take_while(|input| input.name != name);
    let inputs = earlier.filter(|input| step.is_made_of(input));
    inputs.map(|input| Ok((input, code_of(steps, notes, &input.name)?))).try_fold(Code::read(note), |code, input| {
        let (input, of_input) = input?;
        Ok(code.and(of_input, &format!("{} was made by other code", input.name)))
    })
}

/// A command without the folders of absolute paths, which differ between machines.
fn without_folders(command: &str) -> String {
    let word = |word: &str| {
        if word.starts_with('/') { word.rsplit('/').next().unwrap_or(word).into() } else { word.to_owned() }
    };
    command.split_whitespace().map(word).collect::<Vec<_>>().join(" ")
}

fn evaluated(evaluation: &Value, code: Code, figures: &BTreeSet<(String, String)>) -> Result<Evaluated> {
    let text = |at: &str| json::text(evaluation, at);
    let mut ways: BTreeMap<String, BTreeMap<String, Figure>> = BTreeMap::new();
    for (way, figure) in figures {
        let found = found(evaluation, way, figure)?;
        ways.entry(way.clone()).or_default().insert(figure.clone(), found);
    }
    let n_episodes = json::number(evaluation, "/n_episodes")? as usize;
    Ok(Evaluated { n_episodes, checksum: text("/checksum")?, model: text("/model/sha256")?, code, ways })
}

/// A figure of an evaluation by its name; see the experiments' file.
fn found(evaluation: &Value, way: &str, figure: &str) -> Result<Figure> {
    let missing = || Error::invalid(format!("{way}: {figure}"), "a figure that an evaluation has", "another");
    let (method, inference, action) = match way {
        "nearest" => ("moco", "none", "none"),
        "pixel" => ("pixel", "none", "none"),
        "alg-1" => ("filter", "particle", "paper"),
        action => ("filter", "exact", action),
    };
    let is_of_way = |entry: &&Value| entry["inference"] == inference && entry["action"] == action;
    let of_stops = |field: &str, scale: f64| {
        let stops = json::entries(evaluation, "/stops")?.iter().find(is_of_way).ok_or_else(missing)?;
        Ok(Figure { value: stops[field].as_f64().map(|value| rounded(scale * value)), ci95: None })
    };
    let of_row = |n: &str, field: &str, interval: &str, scale: f64| {
        let is_it =
            |row: &&Value| is_of_way(row) && row["method"] == method && row["n_touches"].as_u64() == n.parse().ok();
        let row = json::entries(evaluation, "/rows")?.iter().find(is_it).ok_or_else(missing)?;
        let value = row[field].as_f64().ok_or_else(missing)?;
        let bound = |at: usize| row[interval][at].as_f64().map(|bound| rounded(scale * bound));
        let ci95 = bound(0).zip(bound(1)).map(|(low, high)| [low, high]);
        Ok(Figure { value: Some(rounded(scale * value)), ci95 })
    };
    match figure.split_once(' ').unwrap_or((figure, "")) {
        ("touches", "") => of_stops("mean_touches", 1.0),
        ("sure", "") => of_stops("confident", 100.0),
        ("wrong", "") => of_stops("confident_and_wrong", 100.0),
        ("none", "") => of_stops("none_of_these", 100.0),
        ("right", n) => of_row(n, "accuracy", "accuracy_ci95", 100.0),
        ("error", n) => of_row(n, "calibration_error", "calibration_error_ci95", 100.0),
        ("squared", n) => of_row(n, "normalised_pose_error", "", 1.0),
        ("within", n) => of_row(n, "within_ellipsoid", "", 100.0),
        _ => Err(missing()),
    }
}

/// A value as a table shows it.
fn rounded(value: f64) -> f64 {
    super::table::shown(value).parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    /// The steps of a whole run, and their notes, all of one commit.
    fn whole() -> (Vec<Step>, Value) {
        let workspace = Workspace { root: "/r".into(), target: "/t".into() };
        let experiments = Experiments::of_the_project();
        let steps = steps(&Job::whole(&workspace, &experiments, Path::new("/m")), &[Part::Tables]).unwrap();
        let note = |step: &Step| {
            let code = json!({ "commit": "a", "dirty": false });
            // Made on another machine.
            let command = step.command().replace("--model /m", "--model /elsewhere/m");
            (step.name.clone(), json!({ "command": command, "finished": true, "code": code }))
        };
        let notes = Value::Object(steps.iter().map(note).collect());
        (steps, notes)
    }

    #[test]
    fn a_figure_is_of_the_code_of_all_that_it_was_made_of() {
        let (steps, mut notes) = whole();
        assert_eq!(code_of(&steps, &notes, "small").unwrap(), Code::Commit { commit: "a".into(), dirty: false });
        notes["small-pegs"]["code"]["commit"] = json!("b");
        let unknown = |name: &str| Code::unknown(&format!("{name} was made by other code"));
        assert_eq!(code_of(&steps, &notes, "small").unwrap(), unknown("small.bank"));
        notes["small-pegs"].as_object_mut().unwrap().remove("code");
        assert_eq!(code_of(&steps, &notes, "small").unwrap(), unknown("small.bank"));
    }

    #[test]
    fn fewer_episodes_what_is_not_finished_and_what_nobody_runs_are_refused() {
        let (steps, notes) = whole();
        let error = |notes: &Value, name: &str| code_of(&steps, notes, name).unwrap_err().to_string();
        let mut smoke = notes.clone();
        let command = smoke["small"]["command"].as_str().unwrap().replace("--episodes 500", "--episodes 24");
        smoke["small"]["command"] = json!(command);
        let of_smoke = error(&smoke, "small");
        assert!(
            of_smoke.starts_with("small: expected a whole run's `tactile-filter evaluate --model m --bank small.bank")
        );
        assert!(
            of_smoke.contains("--episodes 500") && of_smoke.contains("got `tactile-filter") && of_smoke.contains("24")
        );
        let mut cut = notes.clone();
        cut["small.bank"]["finished"] = json!(false);
        assert!(error(&cut, "small").starts_with("small.bank: ") && error(&cut, "small").ends_with("`, not finished"));
        assert!(error(&json!({}), "small").ends_with("got nothing, not finished"));
        assert_eq!(error(&notes, "smal"), "smal: expected an evaluation of the experiments, got another");
    }

    #[test]
    fn figures_are_found_by_way_and_rounded_as_they_are_shown() {
        let row = |action, n_touches, accuracy: f64| {
            json!({
                "method": "filter", "inference": "exact", "action": action, "n_touches": n_touches, "accuracy": accuracy,
                "accuracy_ci95": [accuracy - 0.0104, accuracy + 0.0106], "normalised_pose_error": 0.6789
            })
        };
        let evaluation = json!({
            "rows": [row("random", 1, 0.5), row("information", 1, 0.8841), row("information", 10, 0.99)],
            "stops": [{ "inference": "exact", "action": "information", "mean_touches": 2.96, "confident": 0.992,
                        "confident_and_wrong": null, "none_of_these": 0.0 }],
        });
        let of = |way, figure| found(&evaluation, way, figure).unwrap();
        assert_eq!(of("information", "right 1"), Figure { value: Some(88.4), ci95: Some([87.4, 89.5]) });
        assert_eq!(of("random", "right 1").value, Some(50.0));
        assert_eq!(of("information", "squared 10"), Figure { value: Some(0.7), ci95: None });
        assert_eq!(of("information", "touches").value, Some(3.0));
        assert_eq!(of("information", "sure").value, Some(99.2));
        assert_eq!(of("information", "wrong").value, None);
        for (way, figure) in
            [("information", "right 2"), ("random", "sure"), ("nearest", "right 1"), ("information", "left")]
        {
            let expected = format!("{way}: {figure}: expected a figure that an evaluation has, got another");
            assert_eq!(found(&evaluation, way, figure).unwrap_err().to_string(), expected);
        }
    }
}
