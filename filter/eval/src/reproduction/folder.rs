//! What a reproduction left in its folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::ErrorKind;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;

use maud::{Markup, html};
use tactile_data::file::bounded_file::{self, Kind};
use tactile_filter::budget::Tradeoff;

use super::experiments::Experiments;
use crate::assembly::Assembly;
use crate::error::{Error, Result};
use crate::result::{Evaluation, SCHEMA};

/// All that was found in a folder.
#[derive(Clone, Debug, Default)]
pub struct Reproduction {
    /// What the page shows.
    pub(super) experiments: Experiments,
    /// The evaluations by their folder's name, in the order of the experiments.
    pub(super) evaluations: Vec<(String, Evaluation)>,
    pub(super) assembly: Option<Assembly>,
    pub(super) tradeoff: Option<Tradeoff>,
    /// The notes of each step, by name.
    pub(super) steps: BTreeMap<String, Step>,
    /// Pages to link to, relative to the folder.
    pub(super) pages: BTreeSet<String>,
    /// The way from the page's folder to this one, percent-encoded, with a slash at its end; empty where it is the same.
    pub(super) way: String,
}

/// The notes of a step.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct Step {
    /// Its command line.
    pub command: String,
    /// Whether it came to its end.
    pub finished: bool,
    /// Wall time, s.
    pub seconds: f64,
    /// Most memory it held, MiB, where the system tells.
    #[serde(default)]
    pub peak_mib: Option<f64>,
}

impl Reproduction {
    /// Reads a folder for a page that is to be `page`, whose own folder exists.
    ///
    /// # Errors
    /// A file that is there and cannot be read or is something else; a folder without any result.
    pub fn load(folder: &Path, page: &Path) -> Result<Self> {
        let beside = page.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let absolute = |path: &Path| fs::canonicalize(path).map_err(Error::io(path));
        let (experiments, way) = (Experiments::read()?, way(&absolute(beside)?, &absolute(folder)?));
        let mut found = Self { experiments, way, ..Self::default() };
        for name in found.experiments.folders() {
            let path = folder.join(&name).join("evaluation.json");
            if let Some(evaluation) = read::<Evaluation>(&path, "an evaluation")? {
                if evaluation.schema != SCHEMA {
                    return Err(Error::invalid(format!("{}: schema", path.display()), SCHEMA, evaluation.schema));
                }
                found.note_page(folder, &format!("{name}/report.html"));
                found.evaluations.push((name, evaluation));
            }
        }
        found.assembly = read(&folder.join("assembly/assembly.json"), "an assembly")?;
        let path = folder.join("tradeoff/tradeoff.json");
        let tradeoff = text(&path)?.map(|text| Tradeoff::from_json(&path.display().to_string(), &text));
        found.tradeoff = tradeoff.transpose()?;
        found.steps = read(&folder.join("reproduce.json"), "notes of steps")?.unwrap_or_default();
        found.note_page(folder, "assembly/report.html");
        found.note_page(folder, "tradeoff/tradeoff.html");
        if found.evaluations.is_empty() && found.assembly.is_none() && found.tradeoff.is_none() {
            let expected = "results of cargo xtask reproduce, such as small/evaluation.json";
            return Err(Error::invalid(folder.display().to_string(), expected, "none"));
        }
        Ok(found)
    }

    /// The evaluation in the folder of this name.
    pub(super) fn evaluation(&self, name: &str) -> Option<&Evaluation> {
        self.evaluations.iter().find(|(of, _)| of == name).map(|(_, evaluation)| evaluation)
    }

    /// `text`, a link to a page of the folder where it is there; `place` is a place in it, or nothing.
    pub(super) fn link(&self, page: &str, place: &str, text: &str) -> Markup {
        html! {
            @if self.pages.contains(page) {
                a href={ (self.way) (encode(page)) @if !place.is_empty() { "#" (place) } } { (text) }
            } @else {
                (text)
            }
        }
    }

    /// A link to the report of an evaluation.
    pub(super) fn report(&self, name: &str, text: &str) -> Markup {
        self.link(&format!("{name}/report.html"), "", text)
    }

    fn note_page(&mut self, folder: &Path, page: &str) {
        if folder.join(page).is_file() {
            self.pages.insert(page.into());
        }
    }
}

/// The text of a file; `None` where there is no such file.
fn text(path: &Path) -> Result<Option<String>> {
    match bounded_file::read_to_string(path, Kind::FIGURES) {
        Ok(text) => Ok(Some(text)),
        Err(tactile_data::Error::Io { source, .. }) if source.kind() == ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.into()),
    }
}

fn read<T: DeserializeOwned>(path: &Path, what: &str) -> Result<Option<T>> {
    let parse = |text: String| {
        serde_json::from_str(&text).map_err(|e| Error::invalid(path.display().to_string(), what, e.to_string()))
    };
    text(path)?.map(parse).transpose()
}

/// The way from one absolute folder to another, percent-encoded.
fn way(from: &Path, to: &Path) -> String {
    let parts = |path: &Path| path.components().map(|part| part.as_os_str().to_owned()).collect::<Vec<_>>();
    let (from, to) = (parts(from), parts(to));
    let n_shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
    let up = std::iter::repeat_n(Component::ParentDir.as_os_str().to_owned(), from.len() - n_shared);
    let path: PathBuf = up.chain(to[n_shared..].iter().cloned()).collect();
    let steps = path.components().map(|part| encode(&part.as_os_str().to_string_lossy()) + "/");
    steps.collect()
}

/// A path as part of an address (RFC 3986: unreserved characters and slashes stay).
fn encode(path: &str) -> String {
    let byte = |byte: u8| match byte {
        b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'.' | b'_' | b'~' | b'/' => char::from(byte).to_string(),
        other => format!("%{other:02X}"),
    };
    path.bytes().map(byte).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::result::tests::published;
    use serde_json::{Value, json};

    /// Writes a result into a folder.
    pub fn put(folder: &Path, name: &str, value: &Value) {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, value.to_string()).unwrap();
    }

    /// What is loaded of some evaluations.
    pub fn of(evaluations: &[(&str, Evaluation)]) -> Reproduction {
        let evaluations = evaluations.iter().map(|(name, evaluation)| (name.to_string(), evaluation.clone()));
        let experiments = Experiments::read().unwrap();
        Reproduction { experiments, evaluations: evaluations.collect(), ..Reproduction::default() }
    }

    #[test]
    fn what_is_there_is_read_and_linked() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["robust-soft-gel", "small", "parts-digits"] {
            put(folder.path(), &format!("{name}/evaluation.json"), &published());
        }
        put(folder.path(), "parts-digits/report.html", &json!(""));
        put(folder.path(), "parts-digits.bank", &json!("no folder"));
        let step = json!({"s": {"command": "c", "finished": true, "seconds": 2.5}});
        put(folder.path(), "reproduce.json", &step);
        let found = Reproduction::load(folder.path(), &folder.path().join("page.html")).unwrap();
        let names: Vec<_> = found.evaluations.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["small", "robust-soft-gel", "parts-digits"]);
        assert_eq!(found.steps["s"], Step { command: "c".into(), finished: true, seconds: 2.5, peak_mib: None });
        assert_eq!(found.report("parts-digits", "<a>").0, r#"<a href="parts-digits/report.html">&lt;a&gt;</a>"#);
        assert_eq!(found.report("small", "small").0, "small", "no page, no link");
        let elsewhere = folder.path().join("robust-soft-gel/page.html");
        let found = Reproduction::load(folder.path(), &elsewhere).unwrap();
        assert!(found.report("parts-digits", "a").0.contains(r#"href="../parts-digits"#));
    }

    #[test]
    fn what_is_broken_is_named_and_an_empty_folder_refused() {
        let folder = tempfile::tempdir().unwrap();
        let load = || Reproduction::load(folder.path(), &folder.path().join("page.html"));
        let path = folder.path().display();
        let empty =
            format!("{path}: expected results of cargo xtask reproduce, such as small/evaluation.json, got none");
        assert_eq!(load().unwrap_err().to_string(), empty);
        let mut foreign = published();
        foreign["schema"] = json!("other/1");
        put(folder.path(), "small/evaluation.json", &foreign);
        let expected = format!("{path}/small/evaluation.json: schema: expected {SCHEMA}, got other/1");
        assert_eq!(load().unwrap_err().to_string(), expected);
        put(folder.path(), "small/evaluation.json", &json!({}));
        let start = format!("{path}/small/evaluation.json: expected an evaluation, got missing field");
        assert!(load().unwrap_err().to_string().starts_with(&start));
    }

    #[test]
    fn a_way_goes_up_and_down() {
        assert_eq!(way(Path::new("/a/b"), Path::new("/a/b")), "");
        assert_eq!(way(Path::new("/a/b/c"), Path::new("/a/d e")), "../../d%20e/");
    }
}
