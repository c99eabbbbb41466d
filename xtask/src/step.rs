//! One program of a longer job, run only where its product is missing, older than what it was made from, or
//! made by another command line.

use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use serde_json::{Map, Value, json};

use crate::code::Code;
use crate::error::{Error, Result};
use crate::json;
use crate::program::{Program, Usage};
use crate::workspace::{Workspace, remove};

/// One program to run in the output folder, or a file to write there; every path is relative to it or absolute.
pub struct Step {
    /// Name for people, and in the notes.
    pub name: String,
    work: Work,
    /// Files that it is made from.
    inputs: Vec<PathBuf>,
    /// The file or folder that it makes, removed before it is made anew.
    product: PathBuf,
    /// The file of the product that is written last.
    proof: PathBuf,
    /// A file of the product from which an interrupted run continues with `--resume`.
    resume_from: Option<PathBuf>,
}

/// What a step does.
enum Work {
    Run(Program),
    Write(String),
}

impl fmt::Display for Work {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Run(program) => program.fmt(f),
            Self::Write(text) => write!(f, "write: {}", text.split_whitespace().collect::<Vec<_>>().join(" ")),
        }
    }
}

/// What is left to do of a step.
#[derive(Debug, PartialEq)]
enum Need {
    Nothing,
    Rest,
    All,
}

/// Builds the programs and runs what is left to do of a chore's steps in a folder.
pub fn run_all(chore: &str, steps: &[Step], workspace: &Workspace, out: &Path) -> Result<()> {
    let start = Instant::now();
    let code = Code::of(&workspace.root);
    let mut notes = Notes { code: code.clone(), ..Notes::open(out, chore)? };
    workspace.build()?;
    notes.code = code.and(Code::of(&workspace.root), "changed while it was built");
    println!("everything below happens in {}; interrupted, the same command continues", out.display());
    for (n, step) in steps.iter().enumerate() {
        step.run(&format!("step {} of {}, {}", n + 1, steps.len(), step.name), out, &mut notes)?;
    }
    println!("all of it this time, building included: {:.0} s", start.elapsed().as_secs_f64());
    Ok(())
}

impl Step {
    /// A step that makes `product`, a file, with nothing that it is made from.
    pub fn new(name: impl Into<String>, program: Program, product: impl Into<PathBuf>) -> Self {
        Self::of(name.into(), Work::Run(program), product.into())
    }

    /// A step that writes a file of this name and text.
    pub fn file(name: &str, text: String) -> Self {
        Self::of(name.into(), Work::Write(text), name.into())
    }

    fn of(name: String, work: Work, product: PathBuf) -> Self {
        Self { name, work, inputs: Vec::new(), proof: product.clone(), product, resume_from: None }
    }

    /// Says that its product is a folder, and which file of that is written last.
    pub fn with_last(self, file: &str) -> Self {
        Self { proof: self.product.join(file), ..self }
    }

    /// Adds a file that it is made from.
    pub fn needs(mut self, input: impl Into<PathBuf>) -> Self {
        self.inputs.push(input.into());
        self
    }

    /// Says that it reads a scene: a file, or a preset, which may have the name of another step.
    pub fn needs_scene(self, scene: &str) -> Self {
        if scene.ends_with(".toml") { self.needs(scene) } else { self }
    }

    /// Says that an interrupted run can continue from this file of its product.
    pub fn resumes_from(self, state: &str) -> Self {
        Self { resume_from: Some(self.product.join(state)), ..self }
    }

    /// Its command line, or the file that it writes.
    pub fn command(&self) -> String {
        self.work.to_string()
    }

    /// Whether another step's product is among what it is made from.
    pub fn is_made_of(&self, other: &Self) -> bool {
        self.inputs.iter().any(|input| input.starts_with(&other.product))
    }

    /// Runs what is left to do in the folder `out`; `title` names the step on the screen.
    fn run(&self, title: &str, out: &Path, notes: &mut Notes) -> Result<()> {
        let need = self.need(out, notes);
        if need == Need::Nothing {
            println!("== {title}: {} is there already", self.product.display());
            return Ok(());
        }
        if need == Need::All {
            remove(&out.join(&self.product))?;
            notes.note(self, false, Usage::default())?;
        }
        println!("== {title}: {}", self.work);
        let usage = match &self.work {
            Work::Write(text) => {
                let path = out.join(&self.product);
                fs::write(&path, text).map_err(Error::io(&path))?;
                Usage::default()
            }
            Work::Run(program) if need == Need::Rest => program.clone().words("--resume").run(out)?,
            Work::Run(program) => program.run(out)?,
        };
        println!("== {title}: {usage}");
        notes.note(self, true, usage)
    }

    fn need(&self, out: &Path, notes: &Notes) -> Need {
        let since = self.inputs.iter().filter_map(|input| modified(&out.join(input))).max();
        let fresh = |path: &Path| modified(&out.join(path)).is_some_and(|made| since.is_none_or(|since| since <= made));
        match notes.finished(self) {
            Some(true) if fresh(&self.proof) => Need::Nothing,
            Some(false) if self.resume_from.as_deref().is_some_and(fresh) => Need::Rest,
            _ => Need::All,
        }
    }
}

/// What each step was run with and what it took, kept in the output folder.
struct Notes {
    path: PathBuf,
    steps: Map<String, Value>,
    /// The code that runs the steps of this run.
    code: Code,
}

impl Notes {
    /// Reads the notes of an earlier run of `chore`, kept in `chore.json`. A folder that holds something else is
    /// refused, because steps remove what they make anew. The code of this run is unknown at first.
    fn open(out: &Path, chore: &str) -> Result<Self> {
        let (path, code) = (out.join(chore).with_extension("json"), Code::unknown("not asked for"));
        if path.exists() {
            let Value::Object(steps) = json::read(&path)? else {
                return Err(Error::invalid(path.display().to_string(), "an object", "something else"));
            };
            return Ok(Self { path, steps, code });
        }
        if fs::read_dir(out).map_err(Error::io(out))?.next().is_some() {
            let expected = format!("an empty folder or one that {chore} made");
            return Err(Error::invalid(out.display().to_string(), expected, "another"));
        }
        Ok(Self { path, steps: Map::new(), code })
    }

    /// Whether a run with the step's command line came to its end; `None` where there was none.
    fn finished(&self, step: &Step) -> Option<bool> {
        let note = self.steps.get(&step.name).filter(|note| note["command"] == step.command())?;
        Some(note["finished"] == true)
    }

    /// Notes that a step began or finished, and of which code; one that continued an earlier run adds to its time.
    fn note(&mut self, step: &Step, finished: bool, usage: Usage) -> Result<()> {
        let earlier = self.steps.get(&step.name).filter(|_| finished);
        let seconds = earlier.and_then(|note| note["seconds"].as_f64()).unwrap_or(0.0) + usage.seconds;
        let code = match earlier {
            Some(note) => Code::read(note).and(self.code.clone(), "begun and continued by different code"),
            None => self.code.clone(),
        };
        let mut note = json!({
            "command": step.command(), "finished": finished, "seconds": seconds, "peak_mib": usage.peak_mib
        });
        code.write(&mut note);
        self.steps.insert(step.name.clone(), note);
        let text = format!("{:#}\n", Value::Object(self.steps.clone()));
        let temporary = self.path.with_extension("json.tmp");
        fs::write(&temporary, text).map_err(Error::io(&temporary))?;
        fs::rename(&temporary, &self.path).map_err(Error::io(&self.path))
    }
}

fn modified(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).and_then(|metadata| metadata.modified()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A new empty folder, removed at the end.
    struct Folder(PathBuf);

    impl Folder {
        fn new(name: &str) -> Self {
            let path = std::env::temp_dir().join(format!("xtask-step-{name}-{}", std::process::id()));
            remove(&path).unwrap();
            fs::create_dir(&path).unwrap();
            Self(path)
        }
    }

    impl Drop for Folder {
        fn drop(&mut self) {
            remove(&self.0).unwrap();
        }
    }

    fn step(arg: &str) -> Step {
        Step::new("a step", Program::new("program").arg(arg), "out").with_last("last").needs("in").resumes_from("state")
    }

    fn write(path: PathBuf, seconds_ago: u64) {
        let then = SystemTime::now() - std::time::Duration::from_secs(seconds_ago);
        fs::File::create(path).unwrap().set_modified(then).unwrap();
    }

    #[test]
    fn a_step_runs_again_only_where_something_changed() {
        let folder = Folder::new("again");
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        write(folder.0.join("in"), 30);
        fs::create_dir(folder.0.join("out")).unwrap();
        write(folder.0.join("out/last"), 20);
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "nobody noted how it was made");
        notes.note(&step("a"), false, Usage::default()).unwrap();
        notes.note(&step("a"), true, Usage::default()).unwrap();
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        assert_eq!(step("a").need(&folder.0, &notes), Need::Nothing);
        assert_eq!(step("b").need(&folder.0, &notes), Need::All, "another command line");
        write(folder.0.join("in"), 10);
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "a newer input");
        write(folder.0.join("out/last"), 0);
        notes.note(&step("a"), false, Usage::default()).unwrap();
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "interrupted with nothing to continue from");
        write(folder.0.join("out/state"), 5);
        assert_eq!(step("a").need(&folder.0, &notes), Need::Rest);
        write(folder.0.join("out/state"), 15);
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "a state older than the input");
    }

    #[test]
    fn a_file_is_written_again_only_where_its_text_changed() {
        let folder = Folder::new("file");
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        let path = folder.0.join("a.toml");
        let write = |text: &str, notes: &mut Notes| {
            Step::file("a.toml", text.into()).run("a file", &folder.0, notes).unwrap();
            fs::read_to_string(&path).unwrap()
        };
        assert_eq!(write("x = 1\n", &mut notes), "x = 1\n");
        fs::write(&path, "kept").unwrap();
        assert_eq!(write("x = 1\n", &mut notes), "kept");
        assert_eq!(write("x = 2\n", &mut notes), "x = 2\n");
    }

    #[test]
    fn a_folder_of_something_else_is_refused() {
        let folder = Folder::new("other");
        write(folder.0.join("thesis.tex"), 0);
        assert!(Notes::open(&folder.0, "demo").is_err());
    }

    #[test]
    fn a_note_says_which_code_made_it_and_a_run_continued_by_other_code_does_not_know() {
        let folder = Folder::new("code");
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        let [one, other] = ["1", "2"].map(|commit| Code::Commit { commit: commit.repeat(40), dirty: false });
        notes.code = one.clone();
        notes.note(&step("a"), false, Usage::default()).unwrap();
        notes.note(&step("a"), true, Usage::default()).unwrap();
        let made_by = |notes: &Notes| Code::read(&notes.steps["a step"]);
        assert_eq!(made_by(&notes), one);
        notes = Notes { code: other.clone(), ..Notes::open(&folder.0, "demo").unwrap() };
        assert_eq!(made_by(&notes), one, "what is there already keeps its code");
        notes.note(&step("a"), true, Usage::default()).unwrap();
        assert_eq!(made_by(&notes), Code::unknown("begun and continued by different code"));
        notes.note(&step("a"), false, Usage::default()).unwrap();
        assert_eq!(made_by(&notes), other, "made anew");
    }

    #[test]
    fn a_continued_run_adds_its_time() {
        let folder = Folder::new("time");
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        let usage = Usage { seconds: 2.0, peak_mib: Some(64.0) };
        notes.note(&step("a"), false, Usage::default()).unwrap();
        notes.note(&step("a"), true, usage).unwrap();
        notes.note(&step("a"), true, usage).unwrap();
        let note = json::read(&folder.0.join("demo.json")).unwrap()["a step"].clone();
        assert_eq!((&note["seconds"], &note["peak_mib"]), (&json!(4.0), &json!(64.0)));
    }
}
