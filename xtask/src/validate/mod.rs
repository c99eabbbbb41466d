//! The simulated sensor held against real images, as a page and as JSON.
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
use crate::program;
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

/// What one set of real images shows.
struct Set {
    title: &'static str,
    /// Where the images come from, and what was done with them.
    about: String,
    rows: Vec<Row>,
    pictures: Vec<Picture>,
}

/// `tactile-data`, run in the output folder on the real images.
struct Lab {
    program: PathBuf,
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
    let out = args.out.clone().unwrap_or_else(|| workspace.target.join("validation"));
    let out = std::path::absolute(&out).map_err(Error::io(&out))?;
    fs::create_dir_all(&out).map_err(Error::io(&out))?;
    workspace.build_package("tactile-data")?;
    let lab = Lab { program: workspace.program("tactile-data"), real, out };
    let sets = [ball::check(&lab)?, groove::check(&lab)?, cuboid::check(&lab)?, digit::check(&lab)?, elsewhere()];
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
    let row = |row: &Row| json!({ "what": row.what, "target": row.target, "measured": row.measured, "verdict": row.verdict.words() });
    let rows: Vec<Value> = sets.iter().flat_map(|set| &set.rows).map(row).collect();
    json!({ "schema": "tactile-filter/validation/1", "scope": SCOPE, "rows": rows })
}

/// Two sets that others hold.
fn elsewhere() -> Set {
    let row = |what, target| Row { what, target, measured: "not in the folder".into(), verdict: Verdict::Missing };
    Set {
        title: "Flat punches and edges on a Mini",
        about: "Two further sets are not in the folder: flat punches at four depths, and edges of 10 mm. With a \
                height map of the part and a frame of the sensor at rest, each picture is made and judged by: \
                tactile-data render punch.npy --map-mm-per-px 0.03,0.03 --depth-mm 1 --no-contact rest.png \
                --out punch.png; then tactile-data compare photo.png punch.png --real-background rest.png \
                --simulated-background rest.png --out both.png."
            .into(),
        rows: vec![
            row("flat punches, four depths", "contact r at least 0.92, L1 at most 8.7"),
            row("10 mm edges", "near the edge L1 at most 8.0, r at least 0.84"),
        ],
        pictures: Vec::new(),
    }
}

impl Verdict {
    fn of(is_met: bool) -> Self {
        if is_met { Self::Met } else { Self::FallsShort }
    }

    fn words(self) -> &'static str {
        match self {
            Self::Met => "met",
            Self::FallsShort => "falls short",
            Self::Missing => "not there",
        }
    }
}

impl Set {
    /// A set whose folder is not there.
    fn missing(title: &'static str, rows: &[(&'static str, &'static str)]) -> Self {
        println!("skipped: {title} is not in the folder");
        let row = |(what, target): &(&'static str, &'static str)| Row {
            what,
            target,
            measured: "not in the folder".into(),
            verdict: Verdict::Missing,
        };
        Self { title, about: String::new(), rows: rows.iter().map(row).collect(), pictures: Vec::new() }
    }
}

impl Lab {
    /// A file or folder of the real images; none where it is missing.
    fn real(&self, name: &str) -> Option<PathBuf> {
        Some(self.real.join(name)).filter(|path| path.exists())
    }

    /// Runs `tactile-data` in the output folder; words are parted by spaces, and `REAL/` stands for the folder of
    /// the images.
    fn run(&self, line: &str) -> Result<String> {
        println!("== tactile-data {line}");
        let real = format!("{}/", self.real.display());
        let words: Vec<String> = line.split_whitespace().map(|word| word.replace("REAL/", &real)).collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        program::output(self.program.as_os_str(), &words, &self.out)
    }

    /// The same with `--json`, read.
    fn json(&self, line: &str) -> Result<Value> {
        let text = self.run(&format!("{line} --json"))?;
        serde_json::from_str(&text).map_err(|error| Error::invalid(line, "JSON", error.to_string()))
    }
}

/// A number at a JSON pointer.
fn number(value: &Value, pointer: &str) -> Result<f64> {
    let found = value.pointer(pointer);
    found.and_then(Value::as_f64).ok_or_else(|| Error::invalid(pointer, "a number", format!("{found:?}")))
}

/// Numbers of an array at a JSON pointer.
fn numbers(value: &Value, pointer: &str) -> Result<Vec<f64>> {
    let found = value.pointer(pointer);
    let list = found.and_then(Value::as_array);
    let list = list.and_then(|list| list.iter().map(Value::as_f64).collect());
    list.ok_or_else(|| Error::invalid(pointer, "an array of numbers", format!("{found:?}")))
}

/// Entries of an array at a JSON pointer.
fn entries<'a>(value: &'a Value, pointer: &str) -> Result<&'a [Value]> {
    let found = value.pointer(pointer);
    let list = found.and_then(Value::as_array).map(Vec::as_slice);
    list.ok_or_else(|| Error::invalid(pointer, "an array", format!("{found:?}")))
}

/// Removes a folder of an earlier run.
fn remove(folder: &Path) -> Result<()> {
    if folder.exists() { fs::remove_dir_all(folder).map_err(Error::io(folder)) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_found_by_pointer_or_named_in_the_error() {
        let value = json!({ "a": { "b": 1.5, "c": [1, 2] } });
        assert_eq!(number(&value, "/a/b").unwrap(), 1.5);
        assert_eq!(numbers(&value, "/a/c").unwrap(), [1.0, 2.0]);
        assert!(number(&value, "/a/d").unwrap_err().to_string().starts_with("/a/d: expected a number"));
        assert!(numbers(&value, "/a/b").is_err());
    }

    #[test]
    fn the_summary_holds_each_row_with_its_verdict() {
        let rows = summary(&[elsewhere()]);
        assert_eq!(rows["rows"].as_array().unwrap().len(), 2);
        assert_eq!(rows["rows"][0]["verdict"], "not there");
        assert!(rows["scope"].as_str().unwrap().contains("No public real image of a letter"));
    }
}
