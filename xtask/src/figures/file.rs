//! `figures.json`: the figures of the documents' tables, each with what made it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::code::Code;
use crate::error::{Error, Result};
use crate::workspace::Workspace;

/// The file, relative to the workspace.
pub const FILE: &str = "filter/eval/figures.json";

/// The value of [`Figures::schema`].
const SCHEMA: &str = "tactile-filter/figures/1";

/// The figures of the documents' tables.
#[derive(Debug, PartialEq, Serialize, Deserialize)]
pub struct Figures {
    /// `tactile-filter/figures/1`.
    pub schema: String,
    /// By the evaluation's name.
    pub evaluations: BTreeMap<String, Evaluated>,
}

/// The figures of an evaluation, and what made them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Evaluated {
    /// Episodes behind each figure.
    pub n_episodes: usize,
    /// The evaluation's checksum.
    pub checksum: String,
    /// SHA-256 that names the model.
    pub model: String,
    /// The code that made the evaluation and all that it was made of.
    pub code: Code,
    /// By the way of naming the part, then by the figure.
    pub ways: BTreeMap<String, BTreeMap<String, Figure>>,
}

/// A figure, rounded as it is shown.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Figure {
    /// Its value; nothing where no episode has it.
    pub value: Option<f64>,
    /// Bounds of its 95 % interval, where it has one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ci95: Option<[f64; 2]>,
}

impl Evaluated {
    /// Whether it has all of some figures, each named by its way and itself.
    pub(super) fn has(&self, figures: &BTreeSet<(String, String)>) -> bool {
        figures.iter().all(|(way, figure)| self.ways.get(way).is_some_and(|ways| ways.contains_key(figure)))
    }
}

impl Figures {
    /// Figures of these evaluations.
    pub fn new(evaluations: BTreeMap<String, Evaluated>) -> Self {
        Self { schema: SCHEMA.into(), evaluations }
    }

    /// Reads the workspace's file.
    pub fn read(workspace: &Workspace) -> Result<Self> {
        let path = workspace.root.join(FILE);
        Self::parse(&fs::read_to_string(&path).map_err(Error::io(&path))?)
    }

    fn parse(text: &str) -> Result<Self> {
        let read: Self = serde_json::from_str(text).map_err(|e| Error::invalid(FILE, "figures", e.to_string()))?;
        if read.schema == SCHEMA {
            Ok(read)
        } else {
            Err(Error::invalid(format!("{FILE}: schema"), SCHEMA, read.schema))
        }
    }

    /// Writes the workspace's file, a line for each way, so that a difference is read line by line.
    pub fn write(&self, workspace: &Workspace) -> Result<()> {
        let path = workspace.root.join(FILE);
        let value = serde_json::to_value(self).map_err(|e| Error::invalid(FILE, "figures", e.to_string()))?;
        fs::write(&path, laid_out(&value, 0) + "\n").map_err(Error::io(&path))
    }
}

/// JSON whose objects of objects have a line for each entry, down to the ways.
fn laid_out(value: &Value, depth: usize) -> String {
    match value {
        Value::Object(entries) if depth < 4 && entries.values().any(Value::is_object) => {
            let indent = "  ".repeat(depth + 1);
            let entry = |(name, value): (&String, &Value)| format!("{indent}{name:?}: {}", laid_out(value, depth + 1));
            let entries: Vec<String> = entries.iter().map(entry).collect();
            format!("{{\n{}\n{}}}", entries.join(",\n"), "  ".repeat(depth))
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_read_again_with_a_line_for_each_way() {
        let figure = |value, ci95| Figure { value, ci95 };
        let way = BTreeMap::from([
            ("right 1".to_owned(), figure(Some(88.4), Some([85.3, 90.9]))),
            ("wrong".to_owned(), figure(None, None)),
        ]);
        let evaluated = Evaluated {
            n_episodes: 500,
            checksum: "c".into(),
            model: "m".into(),
            code: Code::Commit { commit: "a".repeat(40), dirty: false },
            ways: BTreeMap::from([("information".to_owned(), way.clone()), ("random".into(), way)]),
        };
        let figures = Figures::new(BTreeMap::from([("small".to_owned(), evaluated)]));
        let text = laid_out(&serde_json::to_value(&figures).unwrap(), 0);
        let line = r#"        "information": {"right 1":{"ci95":[85.3,90.9],"value":88.4},"wrong":{"value":null}},"#;
        assert!(text.lines().any(|of| of == line), "{text}");
        assert_eq!(Figures::parse(&text).unwrap(), figures);
        let has = |way: &str, figure: &str| {
            figures.evaluations["small"].has(&BTreeSet::from([(way.to_owned(), figure.to_owned())]))
        };
        assert!(has("random", "wrong") && !has("random", "right 2") && !has("paper", "wrong"));
        let error = Figures::parse(&text.replace("figures/1", "figures/0")).unwrap_err().to_string();
        assert!(error.starts_with("filter/eval/figures.json: schema: expected"), "{error}");
    }
}
