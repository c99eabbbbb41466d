//! The simulated sensor compared with real images, as a page and as JSON.
//!
//! Only programs are run: what a row says is what `tactile-data` printed.

mod ball;
mod cuboid;
mod digit;
mod groove;
mod page;

use std::fs;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use crate::error::{Error, Result};
use crate::program::Program;
use crate::workspace::Workspace;

/// What every write-up must say.
const SCOPE: &str = "These images validate the optics and the gel law. No public real image of a letter, a hole or \
                     a connector is known, so they do not validate the task of finding a hole for a part.";

/// What `cargo xtask validate` takes.
#[derive(Args)]
pub struct ValidateArgs {
    /// Folder of the real images; what is missing there is skipped.
    #[arg(long, default_value = "../shared/real-gelsight")]
    real: PathBuf,
    /// Folder for the page, the JSON and the pictures [default: validation in the build folder].
    #[arg(long)]
    out: Option<PathBuf>,
}

/// How a row came out.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Verdict {
    Met,
    FallsShort,
    /// The images are not in the folder.
    Missing,
}

/// One line of the table.
struct Row {
    what: &'static str,
    target: &'static str,
    measured: String,
    verdict: Verdict,
}

/// A picture of the page.
struct Picture {
    /// The file, in the output folder or anywhere.
    path: PathBuf,
    caption: String,
}

/// Who published a set of real images.
struct Source {
    /// Address of the repository; the commit that the images were taken at was not recorded.
    repository: &'static str,
    /// Where in the repository they are, as far as it is known.
    path: Option<&'static str>,
    licence: &'static str,
}

/// What one set of real images shows.
struct Set {
    title: &'static str,
    /// `None` where the set is not in the folder.
    source: Option<Source>,
    /// What was done with the images.
    about: String,
    rows: Vec<Row>,
    pictures: Vec<Picture>,
}

/// `tactile-data`, run in the output folder on the real images.
struct Lab {
    program: Program,
    real: PathBuf,
    out: PathBuf,
}

/// Builds `tactile-data`, runs every check and writes the report. A figure that falls short is a finding, not a
/// failure of this program.
pub fn validate(workspace: &Workspace, args: &ValidateArgs) -> Result<()> {
    let Ok(real) = args.real.canonicalize() else {
        println!("skipped: {} is not there", args.real.display());
        return Ok(());
    };
    let out = workspace.folder(args.out.as_deref(), &workspace.target.join("validation"))?;
    workspace.build_program("tactile-data")?;
    let lab = Lab { program: workspace.program("tactile-data"), real, out };
    let sets = [ball::check(&lab)?, groove::check(&lab)?, cuboid::check(&lab)?, digit::check(&lab)?];
    for row in sets.iter().flat_map(|set| &set.rows) {
        println!("{:<12} {}: {}; target {}", row.verdict.words(), row.what, row.measured, row.target);
    }
    let (json, page) = (lab.out.join("validation.json"), lab.out.join("validation.html"));
    fs::write(&json, format!("{:#}\n", summary(&sets))).map_err(Error::io(&json))?;
    fs::write(&page, page::draw(&sets)?).map_err(Error::io(&page))?;
    println!("{SCOPE}");
    println!("report: {}", page.display());
    Ok(())
}

fn summary(sets: &[Set]) -> Value {
    let row = |Row { what, target, measured, verdict }: &Row| json!({ "what": what, "target": target, "measured": measured, "verdict": verdict.words() });
    let source = |set: &Set| {
        let Source { repository, path, licence } = set.source.as_ref()?;
        Some(json!({ "set": set.title, "repository": repository, "path": path, "licence": licence, "commit": null }))
    };
    let rows: Vec<Value> = sets.iter().flat_map(|set| &set.rows).map(row).collect();
    let sources: Vec<Value> = sets.iter().filter_map(source).collect();
    json!({ "schema": "tactile-filter/validation/1", "scope": SCOPE, "rows": rows, "sources": sources })
}

impl Verdict {
    fn words(self) -> &'static str {
        match self {
            Self::Met => "met",
            Self::FallsShort => "falls short",
            Self::Missing => "not there",
        }
    }
}

impl Row {
    fn new(what: &'static str, target: &'static str, measured: String, is_met: bool) -> Self {
        Self { what, target, measured, verdict: if is_met { Verdict::Met } else { Verdict::FallsShort } }
    }
}

impl Set {
    /// A set whose folder is not there.
    fn missing(title: &'static str, rows: &[(&'static str, &'static str)]) -> Self {
        println!("skipped: {title} is not in the folder");
        let measured = || "not in the folder".into();
        let row = |&(what, target): &_| Row { what, target, measured: measured(), verdict: Verdict::Missing };
        let rows = rows.iter().map(row).collect();
        Self { title, source: None, about: String::new(), rows, pictures: Vec::new() }
    }
}

impl Lab {
    /// A file or folder of the real images; none where it is missing.
    fn real(&self, name: &str) -> Option<PathBuf> {
        Some(self.real.join(name)).filter(|path| path.exists())
    }

    /// `tactile-data` with words separated by blanks; `REAL/` in a word is the folder of the images.
    fn line(&self, line: &str) -> Program {
        println!("== tactile-data {line}");
        let real = format!("{}/", self.real.display());
        let words = line.split_whitespace().map(|word| word.replace("REAL/", &real));
        words.fold(self.program.clone(), Program::arg)
    }

    /// Runs a line in the output folder.
    fn run(&self, line: &str) -> Result<()> {
        self.line(line).output(&self.out).map(|_| ())
    }

    /// The same with `--json`, read.
    fn json(&self, line: &str) -> Result<Value> {
        self.line(&format!("{line} --json")).json(&self.out)
    }

    /// A picture in the output folder.
    fn picture(&self, name: &str, caption: impl Into<String>) -> Picture {
        Picture { path: Path::new(&self.out).join(name), caption: caption.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_summary_holds_each_row_with_its_verdict_and_each_source() {
        let source = Source { repository: "https://a.org/b", path: Some("c"), licence: "MIT" };
        let known = Set { source: Some(source), ..Set::missing("Known", &[]) };
        let summary = summary(&[Set::missing("Missing", &[("a", "b"), ("c", "d")]), known]);
        assert_eq!(summary["rows"].as_array().unwrap().len(), 2);
        assert_eq!(summary["rows"][0]["verdict"], "not there");
        assert_eq!(summary["sources"].as_array().unwrap().len(), 1);
        assert_eq!(summary["sources"][0]["licence"], "MIT");
        assert!(summary["scope"].as_str().unwrap().contains("No public real image of a letter"));
    }
}
