//! What an evaluation found, next to the paper's figures, in a few lines.

use std::path::Path;

use serde_json::Value;

use crate::error::{Error, Result};

/// The layout this reads.
const SCHEMA: &str = "tactile-filter/evaluation/1";

/// Touches at which the paper states its accuracy, and that accuracy on the small board, %: one touch
/// is its MoCo row, the others its filter with K = 100 (paper, Table I).
const PAPER: [(u64, f64); 4] = [(1, 39.6), (3, 81.8), (5, 90.7), (10, 95.0)];

/// The paper's Pixel baseline on the small board, %.
const PAPER_PIXEL: f64 = 0.0;

/// The lines for a person; `path` names the evaluation.
pub fn findings(path: &Path, evaluation: &Value) -> Result<Vec<String>> {
    let invalid = |field: &str, expected: &str, got: &Value| {
        Error::invalid(format!("{}: {field}", path.display()), expected, got.to_string())
    };
    if evaluation["schema"] != SCHEMA {
        return Err(invalid("schema", SCHEMA, &evaluation["schema"]));
    }
    let rows = evaluation["rows"].as_array().ok_or_else(|| invalid("rows", "an array", &evaluation["rows"]))?;
    let rows: Vec<&Value> = rows.iter().filter(|row| row["poses"] == "on-grid").collect();

    let mut lines = vec![
        format!(
            "{}: {} holes, {} episodes, {} parameters, {}",
            word(&evaluation["scene"]),
            evaluation["n_classes"],
            evaluation["n_episodes"],
            evaluation["model"]["parameters"],
            word(&evaluation["device"])
        ),
        line("right hole after touches", PAPER.map(|(n, _)| format!("{n:>6}"))),
        line("  the paper", PAPER.map(|(_, percent)| format!("{percent:5.1}%"))),
    ];
    for (inference, action) in combinations(&rows) {
        let cells = PAPER.map(|(n, _)| {
            let of = |row: &&&Value| row["inference"] == inference && row["action"] == action;
            percent(rows.iter().filter(|row| row["method"] == "filter").filter(of).find(|row| row["n_touches"] == n))
        });
        lines.push(line(&format!("  ours, {inference}, {action} action"), cells));
    }
    let single = |method: &str| percent(rows.iter().find(|row| row["method"] == method));
    lines.push(format!(
        "nearest neighbour, one touch: MoCo {} (paper {:.1}%), Pixel {} (paper {PAPER_PIXEL:.1}%)",
        single("moco").trim(),
        PAPER[0].1,
        single("pixel").trim()
    ));
    let stopping = &evaluation["stopping"];
    lines.push(format!(
        "stops by itself after {} touches on average; confident and wrong {}",
        decimal(&stopping["mean_touches"], 1.0, ""),
        decimal(&stopping["confident_and_wrong"], 100.0, "%")
    ));
    let median = |stage: &str| decimal(&evaluation["latency_ms"][stage]["p50"], 1.0, " ms");
    lines.push(format!(
        "median per touch: encode {}, update {}, select {}",
        median("encode"),
        median("update"),
        median("select")
    ));
    Ok(lines)
}

/// Each pair of inference and action of the filter, in the order of the file.
fn combinations<'a>(rows: &[&'a Value]) -> Vec<(&'a str, &'a str)> {
    let mut found = Vec::new();
    for row in rows.iter().filter(|row| row["method"] == "filter") {
        let combination = (word(&row["inference"]), word(&row["action"]));
        if !found.contains(&combination) {
            found.push(combination);
        }
    }
    found
}

fn line(name: &str, cells: [String; 4]) -> String {
    format!("{name:36}{}", cells.join("  "))
}

fn percent(row: Option<&&Value>) -> String {
    let accuracy = row.and_then(|row| row["accuracy"].as_f64());
    accuracy.map_or_else(|| "     -".into(), |share| format!("{:5.1}%", 100.0 * share))
}

fn decimal(value: &Value, scale: f64, unit: &str) -> String {
    value.as_f64().map_or_else(|| "unknown".into(), |value| format!("{:.1}{unit}", value * scale))
}

fn word(value: &Value) -> &str {
    value.as_str().unwrap_or("unknown")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn row(method: &str, inference: &str, action: &str, poses: &str, n_touches: u64, accuracy: f64) -> Value {
        json!({ "method": method, "inference": inference, "action": action, "poses": poses,
                "n_touches": n_touches, "accuracy": accuracy })
    }

    #[test]
    fn each_number_is_in_its_place() {
        let evaluation = json!({
            "schema": SCHEMA, "scene": "alphabet-small", "n_classes": 12, "n_episodes": 500,
            "model": { "parameters": 70000 }, "device": "flex",
            "rows": [
                row("pixel", "none", "none", "on-grid", 1, 0.081),
                row("moco", "none", "none", "off-grid", 1, 0.111),
                row("moco", "none", "none", "on-grid", 1, 0.612),
                row("filter", "exact", "information", "on-grid", 1, 0.633),
                row("filter", "exact", "information", "on-grid", 3, 0.901),
                row("filter", "exact", "information", "on-grid", 10, 1.0),
                row("filter", "particle", "paper", "on-grid", 5, 0.5),
                row("filter", "particle", "random", "off-grid", 5, 0.2),
            ],
            "stopping": { "mean_touches": 3.44, "confident_and_wrong": 0.008 },
            "latency_ms": { "encode": { "p50": 2.04 }, "update": { "p50": 0.3 } },
        });
        let lines = findings(Path::new("e.json"), &evaluation).unwrap();
        assert_eq!(
            lines,
            [
                "alphabet-small: 12 holes, 500 episodes, 70000 parameters, flex",
                "right hole after touches                 1       3       5      10",
                "  the paper                          39.6%   81.8%   90.7%   95.0%",
                "  ours, exact, information action    63.3%   90.1%       -  100.0%",
                "  ours, particle, paper action           -       -   50.0%       -",
                "nearest neighbour, one touch: MoCo 61.2% (paper 39.6%), Pixel 8.1% (paper 0.0%)",
                "stops by itself after 3.4 touches on average; confident and wrong 0.8%",
                "median per touch: encode 2.0 ms, update 0.3 ms, select unknown",
            ]
        );
    }

    #[test]
    fn another_layout_is_refused_in_one_line() {
        let error = findings(Path::new("e.json"), &json!({ "schema": "other/2" })).unwrap_err();
        assert_eq!(error.to_string(), "e.json: schema: expected tactile-filter/evaluation/1, got \"other/2\"");
    }
}
