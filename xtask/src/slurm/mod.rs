//! A walk through real Slurm on loopback: job arrays of shards, a task killed on the way, a merge that waits for all,
//! held against single runs without Slurm.

mod cluster;
mod conf;
mod job;

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::error::{Error, Result};
use crate::program;
use crate::workspace::Workspace;
use cluster::{Cluster, is_installed, wait_for};

/// Debian's packages of Slurm and of what vouches for its users.
const PACKAGES: [&str; 2] = ["slurm-wlm", "munge"];

/// What the walk runs of them, and of util-linux.
const PROGRAMS: [&str; 6] = ["slurmctld", "slurmd", "sbatch", "munged", "mungekey", "setsid"];

/// Tasks of each array; twice as many as run at once, so that some wait.
const N_TASKS: usize = 4;

/// Tasks that run at once, of one processor each.
const N_CPUS: usize = 2;

/// The task that is killed: one of those that run first.
const KILLED: &str = "2";

/// How long an array may take, s: twenty times what it took on two slow cores.
const PATIENCE: u64 = 600;

/// What an evaluation tells of the run, not of what was found: how long it took, on what, by which command.
const OF_THE_RUN: [&str; 3] = ["latency_ms", "n_threads", "command"];

/// A command that is run in shards and whole.
struct Case {
    name: &'static str,
    program: &'static str,
    /// Its arguments but for `--shard` and `--out`.
    args: Vec<String>,
    /// `--out` of a task, `%a` being its number.
    shards: &'static str,
    /// `--out` of the single run.
    single: &'static str,
    /// The line that joins the shards.
    merge: &'static str,
    /// What that line makes.
    merged: &'static str,
    /// What there is of the killed task when it is time to kill it; nothing waits for nothing.
    half_done: Option<&'static str>,
    /// Compares the merged result with the single run's: the lines that both have.
    same: fn(&Path, &Path) -> Result<String>,
}

/// Installs Slurm where it is missing and apt is at hand, builds the programs, starts a cluster of one node in the
/// build folder, walks through it and stops it again, also after a failure. Takes a few minutes.
pub fn slurm(workspace: &Workspace) -> Result<()> {
    if !cfg!(target_os = "linux") {
        return Err(Error::invalid("cargo xtask slurm", "Linux", std::env::consts::OS));
    }
    let missing = PROGRAMS.into_iter().find(|program| !is_installed(program));
    if let (Some(program), false) = (missing, is_installed("apt-get")) {
        return Err(Error::invalid(
            "cargo xtask slurm",
            "Slurm and munge, or apt-get to install them",
            format!("no {program}"),
        ));
    }
    if missing.is_some() {
        program::install(&PACKAGES, &workspace.root)?;
    }
    workspace.build()?;
    let folder = workspace.target.join("slurm");
    if folder.exists() {
        fs::remove_dir_all(&folder).map_err(Error::io(&folder))?;
    }
    let work = folder.join("work");
    fs::create_dir_all(&work).map_err(Error::io(&work))?;
    step("a cluster of one node", &folder.display().to_string());
    let cluster = Cluster::start(&folder.join("run"), N_CPUS)?;
    let walk = Walk { workspace, cluster: &cluster, work: &work };
    walk.through(&generation())?;
    walk.through(&walk.evaluation()?)?;
    drop(cluster);
    println!("slurm: passed; shards killed, taken up and merged are what single runs make");
    Ok(())
}

/// Where the walk goes.
struct Walk<'a> {
    workspace: &'a Workspace,
    cluster: &'a Cluster,
    work: &'a Path,
}

impl Walk<'_> {
    /// One case from the single run to the comparison.
    fn through(&self, case: &Case) -> Result<()> {
        self.run(case.program, &[&words(&case.args)[..], &["--out", case.single]].concat())?;

        let array = self.submit_array(case)?;
        let path = format!("{}:{}", self.programs(), std::env::var("PATH").unwrap_or_default());
        let (after, export) = (format!("--dependency=afterok:{array}"), format!("--export=ALL,PATH={path}"));
        let merge = self.submit(&["--output=slurm-%j.out", &after, &export, "--wrap", case.merge])?;
        step(case.name, &format!("array {array} of {N_TASKS} tasks; job {merge} waits for it: {}", case.merge));

        let task = format!("{array}_{KILLED}");
        if let Some(sign) = case.half_done {
            wait_for(sign, PATIENCE, || Ok(self.work.join(sign).exists().then_some(())))?;
        }
        self.cluster.kill(&task, case.program, PATIENCE)?;
        wait_for(&format!("the requeue of {task}"), PATIENCE, || {
            let jobs = self.cluster.jobs(&task)?;
            Ok(jobs.iter().all(|job| job.restarts == 1 && job.state == "PENDING").then_some(()))
        })?;
        // Slurm lets a job that comes back wait for two minutes.
        self.cluster.ask("scontrol", &["update", &format!("JobId={task}"), "StartTime=now"], self.work)?;
        step(case.name, &format!("{} of task {KILLED} killed, task {KILLED} back in the queue", case.program));

        let tasks = self.cluster.wait(&array, PATIENCE)?;
        job::verdict(&tasks, N_TASKS, Some(KILLED)).map_err(|error| self.with_output(error, &array))?;
        let merged = self.cluster.wait(&merge, PATIENCE)?;
        job::verdict(&merged, 1, None).map_err(|error| self.with_output(error, &merge))?;
        step(case.name, "all tasks done, the killed one after one restart; merged");

        let again = self.submit_array(case)?;
        job::verdict(&self.cluster.wait(&again, PATIENCE)?, N_TASKS, None).map_err(|e| self.with_output(e, &again))?;
        for task in 1..=N_TASKS {
            let path = self.work.join(format!("slurm-{again}_{task}.out"));
            let told = fs::read_to_string(&path).map_err(Error::io(&path))?;
            if !told.contains("already") {
                return Err(Error::invalid(path.display().to_string(), "a shard that is there already", told.trim()));
            }
        }
        step(case.name, &format!("array {again}, the same again: all shards were there already"));

        let same = (case.same)(&self.work.join(case.merged), &self.work.join(case.single))?;
        step(case.name, &format!("{} and {} agree", case.merged, case.single));
        println!("{same}");
        Ok(())
    }

    /// Submits the array of a case, as a user would; returns its number.
    fn submit_array(&self, case: &Case) -> Result<String> {
        let script = self.workspace.root.join("xtask").join("slurm").join("shards.sbatch").display().to_string();
        let (tasks, export) = (format!("--array=1-{N_TASKS}"), format!("--export=ALL,PROGRAMS={}", self.programs()));
        let end = ["--shard", "env", "--out", case.shards];
        self.submit(&[&[&tasks, &export, &script, case.program][..], &words(&case.args), &end].concat())
    }

    fn submit(&self, args: &[&str]) -> Result<String> {
        Ok(self.cluster.ask("sbatch", &[&["--parsable"], args].concat(), self.work)?.trim().to_owned())
    }

    /// The folder of our programs.
    fn programs(&self) -> String {
        self.workspace.target.join("release").display().to_string()
    }

    /// Runs one of our programs without Slurm.
    fn run(&self, name: &str, args: &[&str]) -> Result<()> {
        let (program, args) = (self.workspace.program(name), args.iter().map(OsStr::new).collect::<Vec<_>>());
        let line = program::command_line(&program, &args);
        step("without Slurm", &line);
        program::run(&line, &program, &args, self.work).map(|_| ())
    }

    /// An error with the place of what its tasks printed.
    fn with_output(&self, error: Error, id: &str) -> Error {
        let place = self.work.join(format!("slurm-{id}*.out"));
        Error::invalid(format!("job {id}, see {}", place.display()), "a good end", error.to_string())
    }

    /// Episodes of the small board with the shipped model, for which the pegs are touched and a bank is made first.
    fn evaluation(&self) -> Result<Case> {
        let model: PathBuf = ["infer", "models", "maze-small.safetensors"].iter().collect();
        let model = self.workspace.root.join(model).display().to_string();
        let (scene, sides) = (["--scene", "alphabet-small"], ["--sides", "peg"]);
        self.run("tactile-data", &[&["generate", "--out", "pegs"][..], &scene, &sides].concat())?;
        self.run("tactile-infer", &["bank", "--model", &model, "--data", "pegs", "--out", "pegs.bank"])?;
        let board = ["--model", &model, "--bank", "pegs.bank", "--episodes", "600", "--engines", "exact"];
        let args = [&["evaluate"], &board[..], &["--actions", "information"], &scene].concat();
        Ok(Case {
            name: "evaluate",
            program: "tactile-filter",
            args: args.into_iter().map(String::from).collect(),
            shards: "episodes",
            single: "evaluation-single",
            merge: "tactile-filter merge episodes --out evaluation",
            merged: "evaluation",
            half_done: None,
            same: same_evaluation,
        })
    }
}

/// MAZE touches: small pictures, many of them.
fn generation() -> Case {
    let args = "generate --scene maze --pairs 8000 --boards 8 --frame-px 80x60";
    Case {
        name: "generate",
        program: "tactile-data",
        args: args.split(' ').map(String::from).collect(),
        shards: "shards/maze-%a",
        single: "maze-single",
        merge: "tactile-data merge shards/maze-* --out maze",
        merged: "maze",
        half_done: Some("shards/maze-2.partial"),
        same: same_dataset,
    }
}

/// The checksums of two datasets' files, which must agree.
fn same_dataset(merged: &Path, single: &Path) -> Result<String> {
    let files = ["frames.npy", "index.jsonl", "meta.json", "no_contact.png"];
    let sums = |folder: &Path| program::output(OsStr::new("sha256sum"), &files, folder);
    let (got, expected) = (sums(merged)?, sums(single)?);
    if got != expected {
        return Err(Error::invalid(merged.display().to_string(), one_line(&expected), one_line(&got)));
    }
    Ok(got.trim_end().to_owned())
}

/// The checksum of two evaluations, which must agree in all but [`OF_THE_RUN`].
fn same_evaluation(merged: &Path, single: &Path) -> Result<String> {
    let read = |folder: &Path| {
        let path = folder.join("evaluation.json");
        let text = fs::read_to_string(&path).map_err(Error::io(&path))?;
        let json: Option<Value> = serde_json::from_str(&text).ok();
        json.ok_or_else(|| Error::invalid(path.display().to_string(), "JSON", one_line(&text)))
    };
    same_results(&merged.display().to_string(), read(merged)?, read(single)?)
}

fn same_results(what: &str, mut merged: Value, mut single: Value) -> Result<String> {
    for evaluation in [&mut merged, &mut single] {
        if let Some(fields) = evaluation.as_object_mut() {
            OF_THE_RUN.iter().for_each(|key| drop(fields.remove(*key)));
        }
    }
    let Some(checksum) = single["checksum"].as_str() else {
        return Err(Error::invalid("the single run's evaluation.json", "a checksum", "none"));
    };
    if merged["checksum"] != checksum {
        return Err(Error::invalid(what, format!("checksum {checksum}"), merged["checksum"].to_string()));
    }
    let mut fields = single.as_object().into_iter().flatten();
    if let Some((key, value)) = fields.find(|(key, value)| merged.get(key) != Some(value)) {
        return Err(Error::invalid(format!("{what}: {key}"), value.to_string(), merged[key].to_string()));
    }
    Ok(format!("{checksum}  evaluation.json"))
}

fn words(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
}

fn one_line(text: &str) -> String {
    text.trim_end().replace('\n', "; ")
}

fn step(name: &str, what: &str) {
    println!("slurm, {name}: {what}");
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn evaluations_may_differ_in_time_and_command_only() {
        let single = json!({ "checksum": "ab", "rows": [1, 2], "command": "x", "latency_ms": { "encode": 1.0 } });
        let with = |key: &str, value: Value| {
            let mut other = single.clone();
            other[key] = value;
            same_results("out", other, single.clone()).map_err(|error| error.to_string())
        };
        assert_eq!(with("latency_ms", json!({ "encode": 2.0 })).unwrap(), "ab  evaluation.json");
        assert_eq!(with("command", json!("x --shard env")).unwrap(), "ab  evaluation.json");
        assert_eq!(with("checksum", json!("cd")).unwrap_err(), "out: expected checksum ab, got \"cd\"");
        assert_eq!(with("rows", json!([1, 3])).unwrap_err(), "out: rows: expected [1,2], got [1,3]");
        assert!(same_results("out", json!({}), json!({})).is_err());
    }

    /// What the walk submits is in the file's own words: a task's number, and the shard that Slurm states.
    #[test]
    fn the_batch_file_numbers_shards_and_comes_back_when_killed() {
        let script = include_str!("../../slurm/shards.sbatch");
        for words in ["#SBATCH --requeue", "${@//%a/$SLURM_ARRAY_TASK_ID}", "scontrol requeue", "--dependency=afterok"]
        {
            assert!(script.contains(words), "{words}");
        }
        assert!(generation().shards.contains("%a"));
        assert_eq!(generation().half_done, Some(generation().shards.replace("%a", KILLED) + ".partial").as_deref());
    }
}
