//! `cargo xtask bench decision`: how long a whole decision takes on one core, and whether a budget's promise is kept.

use std::fs;
use std::path::Path;

use clap::Args;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::program;
use crate::step::read_json;
use crate::workspace::Workspace;

/// Where decisions are timed: name, scene, and for touches anywhere, on a fine bank, the states a step, of which 2 are the
/// default.
const BOARDS: [(&str, &str, Option<&str>); 5] = [
    ("small, recorded poses", "alphabet-small", None),
    ("large, recorded poses", "alphabet-large", None),
    ("small, anywhere", "alphabet-small", Some("2")),
    ("large, anywhere", "alphabet-large", Some("2")),
    ("large, one state a step", "alphabet-large", Some("1")),
];

/// Budgets tried: ms and touches.
const BUDGETS: [[&str; 2]; 4] = [["4", "10"], ["4", "1"], ["20", "1"], ["20", "2"]];

/// A decision may take this many times what was promised: paces differ from real touches, machines have other work.
const KEPT: f64 = 2.0;

/// Settings of `cargo xtask bench decision`.
#[derive(Args)]
pub struct DecisionArgs {
    /// Episodes of each run, one after the other.
    #[arg(long, default_value_t = 60)]
    episodes: usize,
}

/// Runs the episodes on one core, first with the defaults, then within budgets.
pub fn decision(workspace: &Workspace, args: &DecisionArgs) -> Result<()> {
    let out = workspace.target.join("bench-decision");
    fs::create_dir_all(&out).map_err(Error::io(&out))?;
    let model = workspace.root.join("infer/models/maze-small.safetensors").to_string_lossy().into_owned();
    let bank = |scene: &str, fine: bool| -> Result<String> {
        let name = format!("{scene}{}.bank", if fine { "-fine" } else { "" });
        let words = ["bank", "--model", &model, "--scene", scene, "--out", &name];
        let steps: &[&str] = if fine { &["--xy-step-mm", "2", "--theta-step-deg", "15"] } else { &[] };
        let infer = workspace.program("tactile-infer").into_os_string();
        program::output(&infer, &[&words[..], steps].concat(), &out)?;
        Ok(name)
    };
    let episodes = args.episodes.to_string();
    let evaluate = |scene: &str, bank: &str, more: &[&str]| -> Result<Value> {
        let words = ["evaluate", "--model", &model, "--scene", scene, "--bank", bank, "--episodes", &episodes];
        let ways = ["--engines", "exact", "--actions", "information", "--stories", "0", "--out", "evaluation"];
        let filter = workspace.program("tactile-filter").into_os_string();
        program::output_on_one_core(&filter, &[&words[..], &ways, more].concat(), &out)?;
        read_json(&out.join("evaluation").join("evaluation.json"))
    };
    println!("{:28} {:>14} {:>14} {:>14} {:>14}", "ms, half / 99 of 100", "encode", "update", "choose", "decision");
    for (name, scene, states) in BOARDS {
        let anywhere = states.map(|states| ["--poses", "off-grid", "--subdivisions", states]);
        let more = anywhere.as_ref().map_or(&[][..], |words| &words[..]);
        let found = evaluate(scene, &bank(scene, states.is_some())?, more)?;
        let cells: Vec<String> = ["encode", "update", "select", "decision"]
            .iter()
            .map(|stage| {
                let [half, most] = quantiles(&found, stage)?;
                Ok(format!("{half:6.2} / {most:5.2}"))
            })
            .collect::<Result<_>>()?;
        println!("{name:28} {}", cells.iter().map(|cell| format!("{cell:>14}")).collect::<Vec<_>>().join(" "));
    }
    let scene = "alphabet-small-dev";
    let bank = bank(scene, true)?;
    let within = |[ms, touches]: [&str; 2]| {
        evaluate(scene, &bank, &["--poses", "off-grid", "--budget-ms", ms, "--max-touches", touches])
    };
    budgets(&within, &workspace.root)
}

/// Holds each budget's promise against what was measured.
fn budgets(evaluate: &dyn Fn([&str; 2]) -> Result<Value>, root: &Path) -> Result<()> {
    println!(
        "{:>10} {:>7} {:>12} {:>12} {:>20}  settings",
        "budget ms", "touches", "promised ms", "measured ms", "measured / promised"
    );
    let mut worst = 0.0_f64;
    for [ms, touches] in BUDGETS {
        let found = evaluate([ms, touches])?;
        let promised = number(&found, "/promise/decision_ms")?;
        let [measured, _] = quantiles(&found, "decision")?;
        worst = worst.max(measured / promised);
        let settings = found["promise"]["settings"].as_str().unwrap_or_default();
        let ratio = measured / promised;
        println!("{ms:>10} {touches:>7} {promised:12.2} {measured:12.2} {ratio:20.2}  {settings}");
    }
    if worst > KEPT {
        let what = format!("{}: a budget's promise", root.display());
        return Err(Error::invalid(what, format!("at most {KEPT} times as long"), format!("{worst:.2} times")));
    }
    println!("every promise kept within {KEPT} times, the worst {worst:.2}");
    Ok(())
}

fn quantiles(found: &Value, stage: &str) -> Result<[f64; 2]> {
    Ok([number(found, &format!("/latency_ms/{stage}/p50"))?, number(found, &format!("/latency_ms/{stage}/p99"))?])
}

fn number(found: &Value, pointer: &str) -> Result<f64> {
    let value = found.pointer(pointer).and_then(Value::as_f64);
    value.ok_or_else(|| Error::invalid(format!("evaluation.json {pointer}"), "a number", "none"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_promise_is_broken_at_more_than_twice_its_time() {
        let found = |measured: f64| {
            let decision = json!({ "p50": measured, "p99": 9.0 });
            Ok(json!({ "promise": { "decision_ms": 2.0, "settings": "s" }, "latency_ms": { "decision": decision } }))
        };
        assert!(budgets(&|_| found(3.9), Path::new("/r")).is_ok());
        let error =
            budgets(&|[ms, _]| found(if ms == "4" { 4.2 } else { 2.0 }), Path::new("/r")).unwrap_err().to_string();
        assert!(error.contains("at most 2 times as long, got 2.10 times"), "{error}");
        assert!(budgets(&|_| Ok(json!({})), Path::new("/r")).is_err());
    }
}
