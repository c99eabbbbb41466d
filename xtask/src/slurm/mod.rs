//! Shards with real Slurm on loopback: job arrays, a task killed on the way, a merge that waits for all, compared
//! with single runs without Slurm.

mod cluster;
mod job;

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::error::{Error, Result};
use crate::json;
use crate::program::Program;
use crate::workspace::{Workspace, remove};
use cluster::{Cluster, is_installed, wait_for};

/// Debian's packages of Slurm and of what vouches for its users.
const PACKAGES: &str = "slurm-wlm munge";

/// What this runs of them, and of util-linux.
const PROGRAMS: [&str; 6] = ["slurmctld", "slurmd", "sbatch", "munged", "mungekey", "setpriv"];

/// Tasks of each array; twice as many as run at once, so that some wait.
const N_TASKS: usize = 4;

/// Tasks that run at once, of one processor each.
const N_CPUS: usize = 2;

/// The task that is killed: one of those that run first.
const KILLED: &str = "2";

/// How long an array may take, s: twenty times what it took on two slow cores.
const PATIENCE: u64 = 600;

/// What an evaluation says of the run, not of what was found: how long it took, on what, by which command.
const OF_THE_RUN: [&str; 3] = ["latency_ms", "n_threads", "command"];

/// A command that is run in shards and whole.
struct Case {
    /// The subcommand.
    name: &'static str,
    program: &'static str,
    /// Its arguments but for `--shard` and `--out`.
    args: String,
    /// `--out` of a task, `%a` being its number.
    shards: &'static str,
    /// `--out` of the single run.
    single: &'static str,
    /// The line that joins the shards.
    merge: &'static str,
    /// What that line makes.
    merged: &'static str,
    /// A file of the killed task that must be there before it is killed.
    half_done: Option<&'static str>,
    /// Compares the merged result with the single run's: the lines that both have.
    same: fn(&Path, &Path) -> Result<String>,
}

/// Builds the programs, starts a cluster of one node in the build folder, runs both cases through it and stops it
/// again, also after a failure. Takes a few minutes.
pub fn slurm(workspace: &Workspace) -> Result<()> {
    if !cfg!(target_os = "linux") {
        return Err(Error::invalid("cargo xtask slurm", "Linux", std::env::consts::OS));
    }
    if let Some(program) = PROGRAMS.into_iter().find(|program| !is_installed(program)) {
        return Err(Error::NotInstalled { what: program.into(), packages: PACKAGES });
    }
    workspace.build()?;
    let folder = workspace.target.join("slurm");
    remove(&folder)?;
    let work = workspace.folder(None, &folder.join("work"))?;
    report("a cluster of one node", &folder.display().to_string());
    let cluster = Cluster::start(&folder.join("run"), N_CPUS)?;
    let runner = Runner { workspace, cluster: &cluster, work: &work };
    runner.run_case(&generation())?;
    runner.run_case(&runner.evaluation()?)?;
    drop(cluster);
    println!("slurm: passed; shards killed, restarted and merged are what single runs make");
    Ok(())
}

/// Runs cases on a cluster.
struct Runner<'a> {
    workspace: &'a Workspace,
    cluster: &'a Cluster,
    work: &'a Path,
}

impl Runner<'_> {
    /// One case from the single run to the comparison.
    fn run_case(&self, case: &Case) -> Result<()> {
        self.run(case.program, &format!("{} --out {}", case.args, case.single))?;
        let array = self.submit_array(case)?;
        let path = format!("{}:{}", self.workspace.programs().display(), std::env::var("PATH").unwrap_or_default());
        let merge = self.sbatch(&format!("--output=slurm-%j.out --dependency=afterok:{array}"));
        let merge =
            self.submit(merge.arg(format!("--export=ALL,PATH={path}")).arg(format!("--wrap={}", case.merge)))?;
        report(case.name, &format!("array {array} of {N_TASKS} tasks; job {merge} waits for it: {}", case.merge));
        self.kill_one(case, &array)?;
        self.check_end(&array, N_TASKS, Some(KILLED))?;
        self.check_end(&merge, 1, None)?;
        report(case.name, "all tasks done, the killed one after one restart; merged");

        let again = self.submit_array(case)?;
        self.check_end(&again, N_TASKS, None)?;
        for task in 1..=N_TASKS {
            let path = self.work.join(format!("slurm-{again}_{task}.out"));
            let printed = fs::read_to_string(&path).map_err(Error::io(&path))?;
            if !printed.contains("already") {
                return Err(Error::invalid(
                    path.display().to_string(),
                    "a shard that is there already",
                    printed.trim(),
                ));
            }
        }
        report(case.name, &format!("array {again}, the same again: all shards were there already"));

        let same = (case.same)(&self.work.join(case.merged), &self.work.join(case.single))?;
        report(case.name, &format!("{} and {} agree", case.merged, case.single));
        println!("{same}");
        Ok(())
    }

    /// Kills a task of an array while it runs, and sees it back in the queue.
    fn kill_one(&self, case: &Case, array: &str) -> Result<()> {
        let task = format!("{array}_{KILLED}");
        if let Some(file) = case.half_done {
            wait_for(file, PATIENCE, || Ok(self.work.join(file).exists().then_some(())))?;
        }
        self.cluster.kill(&task, case.program, PATIENCE)?;
        wait_for(&format!("the requeue of {task}"), PATIENCE, || {
            let jobs = self.cluster.jobs(&task)?;
            Ok(jobs.iter().all(|job| job.restarts == 1 && job.state == "PENDING").then_some(()))
        })?;
        // Slurm lets a job that comes back wait for two minutes.
        self.cluster.program("scontrol", &format!("update JobId={task} StartTime=now")).output(self.work)?;
        report(case.name, &format!("{} of task {KILLED} killed, task {KILLED} back in the queue", case.program));
        Ok(())
    }

    /// Waits for a job or an array and checks how it ended; an error names what its tasks printed.
    fn check_end(&self, id: &str, count: usize, killed: Option<&str>) -> Result<()> {
        job::verdict(&self.cluster.wait(id, PATIENCE)?, count, killed).map_err(|error| {
            let output = self.work.join(format!("slurm-{id}*.out"));
            Error::invalid(format!("job {id}, see {}", output.display()), "a good end", error.to_string())
        })
    }

    /// Submits the array of a case, as a user would; returns its number.
    fn submit_array(&self, case: &Case) -> Result<String> {
        let script = self.workspace.root.join("xtask").join("slurm").join("shards.sbatch");
        let programs = self.workspace.programs();
        let options = format!("--array=1-{N_TASKS} --export=ALL,PROGRAMS={}", programs.display());
        let sbatch = self.sbatch(&options).arg(script).arg(case.program).words(&case.args);
        self.submit(sbatch.words("--shard env --out").arg(case.shards))
    }

    fn sbatch(&self, options: &str) -> Program {
        self.cluster.program("sbatch", "--parsable").words(options)
    }

    fn submit(&self, sbatch: Program) -> Result<String> {
        Ok(sbatch.output(self.work)?.trim().to_owned())
    }

    /// Runs one of our programs without Slurm.
    fn run(&self, name: &str, words: &str) -> Result<()> {
        let program = self.workspace.program(name).words(words);
        report("without Slurm", &program.to_string());
        program.run(self.work).map(|_| ())
    }

    /// Episodes of the small board with the shipped model, for which the pegs are touched and a bank is made first.
    fn evaluation(&self) -> Result<Case> {
        let model = self.work.join("model.safetensors");
        fs::copy(self.workspace.shipped_model(), &model).map_err(Error::io(&model))?;
        self.run("tactile-data", "generate --out pegs --scene alphabet-small --sides peg")?;
        self.run("tactile-infer", "bank --model model.safetensors --data pegs --out pegs.bank")?;
        let args = "evaluate --model model.safetensors --bank pegs.bank --episodes 600 --engines exact \
                    --actions information --scene alphabet-small";
        Ok(Case {
            name: "evaluate",
            program: "tactile-filter",
            args: args.into(),
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
    Case {
        name: "generate",
        program: "tactile-data",
        args: "generate --scene maze --pairs 8000 --boards 8 --frame-px 80x60".into(),
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
    let sums = Program::new("sha256sum").words("frames.npy index.jsonl meta.json no_contact.png");
    let (got, expected) = (sums.output(merged)?, sums.output(single)?);
    if got != expected {
        return Err(Error::invalid(merged.display().to_string(), expected, got));
    }
    Ok(got.trim_end().to_owned())
}

/// The checksum of two evaluations, which must agree in all but [`OF_THE_RUN`].
fn same_evaluation(merged: &Path, single: &Path) -> Result<String> {
    let read = |folder: &Path| json::read(&folder.join("evaluation.json"));
    same_results(&merged.display().to_string(), read(merged)?, read(single)?)
}

fn same_results(what: &str, mut merged: Value, mut single: Value) -> Result<String> {
    for evaluation in [&mut merged, &mut single].into_iter().filter_map(Value::as_object_mut) {
        OF_THE_RUN.iter().for_each(|key| drop(evaluation.remove(*key)));
    }
    let mut fields = single.as_object().into_iter().flatten();
    if let Some((key, value)) = fields.find(|(key, value)| merged.get(key) != Some(value)) {
        return Err(Error::invalid(format!("{what}: {key}"), value.to_string(), merged[key].to_string()));
    }
    let checksum = single["checksum"].as_str().ok_or_else(|| Error::invalid(what, "a checksum", "none"))?;
    Ok(format!("{checksum}  evaluation.json"))
}

fn report(name: &str, what: &str) {
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
        assert_eq!(with("checksum", json!("cd")).unwrap_err(), "out: checksum: expected \"ab\", got \"cd\"");
        assert_eq!(with("rows", json!([1, 3])).unwrap_err(), "out: rows: expected [1,2], got [1,3]");
        assert!(same_results("out", json!({}), json!({})).is_err());
    }

    /// What is submitted is in the file's own words: a task's number, and the shard that Slurm states.
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
