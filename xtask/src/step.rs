//! One program of a longer job, run only where its product is missing, older than what it was made from, or
//! made by another command line.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde_json::{Map, Value, json};

use crate::error::{Error, Result};
use crate::program;

/// One program to run in the output folder; every path is relative to it or absolute.
pub struct Step {
    /// Name for people, and in the notes.
    pub name: String,
    /// The program.
    pub program: PathBuf,
    /// Its arguments.
    pub args: Vec<OsString>,
    /// Files that it is made from.
    pub inputs: Vec<PathBuf>,
    /// The file or folder that it makes, removed before it is made anew.
    pub product: PathBuf,
    /// The file of the product that is written last.
    pub proof: PathBuf,
    /// A file of the product from which a run cut short goes on with `--resume`.
    pub resume_from: Option<PathBuf>,
}

/// What is left to do of a step.
#[derive(Debug, PartialEq)]
enum Need {
    Nothing,
    Rest,
    All,
}

impl Step {
    /// Adds a file that it is made from.
    pub fn needs(mut self, input: impl Into<PathBuf>) -> Self {
        self.inputs.push(input.into());
        self
    }

    /// Says what it makes, and which file of that is written last.
    pub fn makes(self, product: impl Into<PathBuf>, proof: impl Into<PathBuf>) -> Self {
        Self { product: product.into(), proof: proof.into(), ..self }
    }

    /// Says that a run cut short can go on from this file.
    pub fn resumes_from(self, state: impl Into<PathBuf>) -> Self {
        Self { resume_from: Some(state.into()), ..self }
    }

    /// Runs what is left to do in the folder `out`; `title` names the step on the screen and in an error.
    pub fn run(&self, title: &str, out: &Path, notes: &mut Notes) -> Result<()> {
        let need = self.need(out, notes);
        if need == Need::Nothing {
            println!("== {title}: {} is there already", self.product.display());
            return Ok(());
        }
        let mut args: Vec<&OsStr> = self.args.iter().map(OsString::as_os_str).collect();
        if need == Need::Rest {
            args.push("--resume".as_ref());
        } else {
            remove(&out.join(&self.product))?;
            notes.begin(self)?;
        }
        println!("== {title}: {}", program::command_line(&self.program, &args));
        let usage = program::run(title, &self.program, &args, out)?;
        notes.finish(self, usage)
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

    fn command_line(&self) -> String {
        let args: Vec<&OsStr> = self.args.iter().map(OsString::as_os_str).collect();
        program::command_line(&self.program, &args)
    }
}

/// What each step was run with and what it took, kept in the output folder.
pub struct Notes {
    path: PathBuf,
    steps: Map<String, Value>,
}

impl Notes {
    /// Reads the notes of an earlier run of `chore`, kept in `chore.json`. A folder that holds something else is
    /// refused, because steps remove what they make anew.
    pub fn open(out: &Path, chore: &str) -> Result<Self> {
        let path = out.join(chore).with_extension("json");
        if path.exists() {
            let steps = read_json(&path)?.as_object().cloned();
            let steps =
                steps.ok_or_else(|| Error::invalid(path.display().to_string(), "an object", "something else"))?;
            return Ok(Self { path, steps });
        }
        let mut entries = fs::read_dir(out).map_err(Error::io(out))?;
        match entries.next() {
            None => Ok(Self { path, steps: Map::new() }),
            Some(_) => {
                let expected = format!("an empty folder or one that {chore} made");
                Err(Error::invalid(out.display().to_string(), expected, "another"))
            }
        }
    }

    /// The wall time and peak memory of each step, in one line.
    pub fn times(&self, steps: &[Step]) -> String {
        let time = |step: &Step| {
            self.steps.get(&step.name).map(|note| format!("{} {:.0} s", step.name, number(&note["seconds"])))
        };
        let times: Vec<_> = steps.iter().filter_map(time).collect();
        let peaks =
            steps.iter().filter_map(|step| Some((self.steps.get(&step.name)?["peak_mib"].as_f64()?, &step.name)));
        let peak = peaks.max_by(|a, b| a.0.total_cmp(&b.0));
        let peak = peak.map_or(String::new(), |(mib, name)| format!("; most memory {mib:.0} MiB, in {name}"));
        format!("times: {}{peak}", times.join(", "))
    }

    /// Whether a run with the step's command line came to its end; `None` where there was none.
    fn finished(&self, step: &Step) -> Option<bool> {
        let note = self.steps.get(&step.name).filter(|note| note["command"] == step.command_line())?;
        Some(note["finished"] == true)
    }

    fn begin(&mut self, step: &Step) -> Result<()> {
        self.note(step, json!({ "command": step.command_line(), "finished": false, "seconds": 0.0 }))
    }

    /// A step that went on from an earlier one adds to its time.
    fn finish(&mut self, step: &Step, usage: program::Usage) -> Result<()> {
        let earlier = self.steps.get(&step.name).map_or(0.0, |note| number(&note["seconds"]));
        self.note(
            step,
            json!({
                "command": step.command_line(), "finished": true,
                "seconds": earlier + usage.seconds, "peak_mib": usage.peak_mib,
            }),
        )
    }

    fn note(&mut self, step: &Step, note: Value) -> Result<()> {
        self.steps.insert(step.name.clone(), note);
        let text = format!("{:#}\n", Value::Object(self.steps.clone()));
        let beside = self.path.with_extension("json.tmp");
        fs::write(&beside, text).map_err(Error::io(&beside))?;
        fs::rename(&beside, &self.path).map_err(Error::io(&self.path))
    }
}

/// Reads a JSON file.
pub fn read_json(path: &Path) -> Result<Value> {
    let text = fs::read_to_string(path).map_err(Error::io(path))?;
    serde_json::from_str(&text).map_err(|error| Error::invalid(path.display().to_string(), "JSON", error.to_string()))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or(0.0)
}

fn modified(path: &Path) -> Option<SystemTime> {
    fs::metadata(path).and_then(|metadata| metadata.modified()).ok()
}

fn remove(path: &Path) -> Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path),
        Ok(_) => fs::remove_file(path),
        Err(_) => Ok(()),
    };
    removed.map_err(Error::io(path))
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
        let step = Step {
            name: "a step".into(),
            program: "program".into(),
            args: vec![arg.into()],
            inputs: Vec::new(),
            product: PathBuf::new(),
            proof: PathBuf::new(),
            resume_from: None,
        };
        step.needs("in").makes("out", "out").resumes_from("state")
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
        write(folder.0.join("out"), 20);
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "nobody noted how it was made");
        notes.begin(&step("a")).unwrap();
        notes.finish(&step("a"), program::Usage::default()).unwrap();
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        assert_eq!(step("a").need(&folder.0, &notes), Need::Nothing);
        assert_eq!(step("b").need(&folder.0, &notes), Need::All, "another command line");
        write(folder.0.join("in"), 10);
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "a newer input");
        write(folder.0.join("out"), 0);
        notes.begin(&step("a")).unwrap();
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "cut short with nothing to go on from");
        write(folder.0.join("state"), 5);
        assert_eq!(step("a").need(&folder.0, &notes), Need::Rest);
        write(folder.0.join("state"), 15);
        assert_eq!(step("a").need(&folder.0, &notes), Need::All, "a state older than the input");
    }

    #[test]
    fn a_folder_of_somebody_elses_is_left_alone() {
        let folder = Folder::new("other");
        write(folder.0.join("thesis.tex"), 0);
        assert!(Notes::open(&folder.0, "demo").is_err());
    }

    #[test]
    fn a_run_gone_on_with_adds_its_time() {
        let folder = Folder::new("time");
        let mut notes = Notes::open(&folder.0, "demo").unwrap();
        let usage = program::Usage { seconds: 2.0, peak_mib: Some(64.0) };
        notes.begin(&step("a")).unwrap();
        notes.finish(&step("a"), usage).unwrap();
        notes.finish(&step("a"), usage).unwrap();
        assert_eq!(notes.times(&[step("a")]), "times: a step 4 s; most memory 64 MiB, in a step");
    }
}
