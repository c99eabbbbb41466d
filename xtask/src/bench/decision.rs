//! `cargo xtask bench decision`: how long a whole decision takes on one core, and whether a budget's promise is kept.

use std::path::PathBuf;

use clap::Args;
use serde_json::Value;

use crate::error::{Error, Result};
use crate::json::{self, number};
use crate::workspace::Workspace;

/// Where decisions are timed: name, scene, and for touches anywhere, on a fine bank, the states a step, of which 2 are the
/// default.
const BOARDS: [(&str, &str, Option<u32>); 5] = [
    ("small, recorded poses", "alphabet-small", None),
    ("large, recorded poses", "alphabet-large", None),
    ("small, anywhere", "alphabet-small", Some(2)),
    ("large, anywhere", "alphabet-large", Some(2)),
    ("large, one state a step", "alphabet-large", Some(1)),
];

/// Budgets tried: ms and touches.
const BUDGETS: [[u32; 2]; 4] = [[4, 10], [4, 1], [20, 1], [20, 2]];

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
    let out = workspace.folder(None, &workspace.target.join("bench-decision"))?;
    let bench = Decisions { workspace, out, episodes: args.episodes };
    println!("{:28} {:>14} {:>14} {:>14} {:>14}", "ms, half / 99 of 100", "encode", "update", "choose", "decision");
    for (name, scene, states) in BOARDS {
        let anywhere = states.map_or(String::new(), |states| format!("--poses off-grid --set subdivisions={states}"));
        let way = format!("--engines exact --actions information {anywhere}");
        let found = bench.evaluate(scene, &bench.bank(scene, states.is_some())?, &way)?;
        let cell = |stage| {
            let [half, most] = quantiles(&found, stage)?;
            Ok(format!("{:>14}", format!("{half:6.2} / {most:5.2}")))
        };
        let cells = ["encode", "update", "select", "decision"].into_iter().map(cell).collect::<Result<Vec<_>>>()?;
        println!("{name:28} {}", cells.join(" "));
    }
    let scene = "alphabet-small-dev";
    let bank = bench.bank(scene, true)?;
    budgets(&|ms, touches| {
        bench.evaluate(scene, &bank, &format!("--poses off-grid --budget ms={ms},touches={touches}"))
    })
}

/// Episodes with the shipped model, in one folder.
struct Decisions<'a> {
    workspace: &'a Workspace,
    out: PathBuf,
    episodes: usize,
}

impl Decisions<'_> {
    /// Makes the bank of a scene, fine or at its recorded poses; returns its file.
    fn bank(&self, scene: &str, fine: bool) -> Result<String> {
        let (suffix, steps) = if fine { ("-fine", "--xy-step-mm 2 --theta-step-deg 15") } else { ("", "") };
        let bank = format!("{scene}{suffix}.bank");
        let infer = self.workspace.program("tactile-infer").words("bank --model").arg(self.workspace.shipped_model());
        infer.words(format!("--scene {scene} --out {bank} --views pegs {steps}")).output(&self.out)?;
        Ok(bank)
    }

    /// Evaluates on one core; returns `evaluation.json`.
    fn evaluate(&self, scene: &str, bank: &str, more: &str) -> Result<Value> {
        let filter = self.workspace.program("tactile-filter").words("evaluate --model");
        let filter = filter.arg(self.workspace.shipped_model()).words(format!(
            "--scene {scene} --bank {bank} --episodes {} --stories 0 --out evaluation {more}",
            self.episodes
        ));
        filter.variable("RAYON_NUM_THREADS", "1").output(&self.out)?;
        json::read(&self.out.join("evaluation").join("evaluation.json"))
    }
}

/// Compares each budget's promise with what was measured.
fn budgets(evaluate: &dyn Fn(u32, u32) -> Result<Value>) -> Result<()> {
    println!(
        "{:>10} {:>7} {:>12} {:>12} {:>20}  settings",
        "budget ms", "touches", "promised ms", "measured ms", "measured / promised"
    );
    let mut worst = 0.0_f64;
    for [ms, touches] in BUDGETS {
        let found = evaluate(ms, touches)?;
        let promised = number(&found, "/promise/decision_ms")?;
        let [measured, _] = quantiles(&found, "decision")?;
        let ratio = measured / promised;
        worst = worst.max(ratio);
        let settings = found["promise"]["settings"].as_str().unwrap_or_default();
        println!("{ms:>10} {touches:>7} {promised:12.2} {measured:12.2} {ratio:20.2}  {settings}");
    }
    if worst > KEPT {
        let (expected, got) = (format!("at most {KEPT} times as long"), format!("{worst:.2} times"));
        return Err(Error::invalid("a budget's promise", expected, got));
    }
    println!("every promise kept within {KEPT} times, the worst {worst:.2}");
    Ok(())
}

fn quantiles(found: &Value, stage: &str) -> Result<[f64; 2]> {
    Ok([number(found, &format!("/latency_ms/{stage}/p50"))?, number(found, &format!("/latency_ms/{stage}/p99"))?])
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
        assert!(budgets(&|_, _| found(3.9)).is_ok());
        let error = budgets(&|ms, _| found(if ms == 4 { 4.2 } else { 2.0 })).unwrap_err().to_string();
        assert!(error.contains("at most 2 times as long, got 2.10 times"), "{error}");
        assert!(budgets(&|_, _| Ok(json!({}))).is_err());
    }
}
