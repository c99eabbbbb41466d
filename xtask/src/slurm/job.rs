//! Jobs as `scontrol --oneliner show job` lists them, and whether they ended well.

use crate::error::{Error, Result};

/// A job, or a task of a job array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    /// Its own number.
    pub id: String,
    /// Number in its array; several in one line, `3-4`, while they wait.
    pub task: Option<String>,
    /// PENDING, RUNNING, COMPLETED, FAILED, ...
    pub state: String,
    /// Times it went back into the queue.
    pub restarts: usize,
    /// Exit code and signal, `0:0`.
    pub exit: String,
}

impl Job {
    /// Its name for people.
    fn name(&self) -> String {
        self.task.as_ref().map_or_else(|| format!("job {}", self.id), |task| format!("task {task}"))
    }
}

/// The jobs of a listing, one a line.
pub fn parse(listing: &str) -> Result<Vec<Job>> {
    let job = |line: &str| {
        let value = |key: &str| {
            let mut pairs = line.split_whitespace().filter_map(|pair| pair.split_once('='));
            pairs.find(|(name, _)| *name == key).map(|(_, value)| value.to_owned())
        };
        let job = || {
            let restarts = value("Restarts")?.parse().ok()?;
            let (id, task) = (value("JobId")?, value("ArrayTaskId"));
            Some(Job { id, task, state: value("JobState")?, restarts, exit: value("ExitCode")? })
        };
        job().ok_or_else(|| Error::invalid("scontrol show job", "JobId, JobState, Restarts and ExitCode", line))
    };
    listing.lines().filter(|line| !line.trim().is_empty()).map(job).collect()
}

/// Whether no more is to come of a job.
pub fn is_over(job: &Job) -> bool {
    !["PENDING", "CONFIGURING", "RUNNING", "COMPLETING", "SUSPENDED", "REQUEUED"].contains(&job.state.as_str())
}

/// Whether an array of `count` tasks came to a good end, `killed` of them after one restart and all others at once.
pub fn verdict(jobs: &[Job], count: usize, killed: Option<&str>) -> Result<()> {
    if jobs.len() != count {
        return Err(Error::invalid("the job array", format!("{count} tasks"), jobs.len().to_string()));
    }
    for job in jobs {
        let restarts = usize::from(killed.is_some() && job.task.as_deref() == killed);
        if job.state != "COMPLETED" || job.restarts != restarts {
            let expected = format!("COMPLETED after {restarts} restarts");
            let got = format!("{} after {} with exit code {}", job.state, job.restarts, job.exit);
            return Err(Error::invalid(job.name(), expected, got));
        }
    }
    Ok(())
}

/// The processes of a job in the listing of `scontrol listpids`: a title, then PID JOBID STEPID ... a line.
pub fn processes(listing: &str, job: &str) -> Vec<u32> {
    let of_job = |line: &str| {
        let mut words = line.split_whitespace();
        let pid = words.next()?.parse().ok()?;
        (words.next() == Some(job)).then_some(pid)
    };
    listing.lines().filter_map(of_job).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LISTING: &str = "\
        JobId=6 ArrayJobId=5 ArrayTaskId=1 JobName=tactile-shards UserId=ann(1) JobState=COMPLETED Reason=None \
        Requeue=1 Restarts=0 BatchFlag=1 ExitCode=0:0 Command=/a=b/c\n\
        JobId=5 ArrayJobId=5 ArrayTaskId=2 JobState=COMPLETED Restarts=1 ExitCode=0:0\n\n";

    fn task(task: &str, state: &str, restarts: usize) -> Job {
        Job { id: "5".into(), task: Some(task.into()), state: state.into(), restarts, exit: "1:0".into() }
    }

    #[test]
    fn a_listing_is_read_line_by_line() {
        let jobs = parse(LISTING).unwrap();
        let found: Vec<_> = jobs.iter().map(|job| (job.id.as_str(), job.task.as_deref(), job.restarts)).collect();
        assert_eq!(found, [("6", Some("1"), 0), ("5", Some("2"), 1)]);
        assert!(jobs.iter().all(is_over));
        let single = parse("JobId=7 JobState=PENDING Restarts=0 ExitCode=0:0").unwrap();
        assert!(single[0].task.is_none() && !is_over(&single[0]));
        assert!(parse("slurm_load_jobs error: Invalid job id").unwrap_err().to_string().contains("Invalid job id"));
    }

    #[test]
    fn only_the_killed_task_has_come_back_and_all_are_done() {
        let jobs = parse(LISTING).unwrap();
        assert!(verdict(&jobs, 2, Some("2")).is_ok());
        let refused = |jobs: &[Job], count, killed| verdict(jobs, count, killed).unwrap_err().to_string();
        assert_eq!(refused(&jobs, 4, Some("2")), "the job array: expected 4 tasks, got 2");
        assert!(refused(&jobs, 2, Some("1")).starts_with("task 1: expected COMPLETED after 1 restarts"));
        assert!(refused(&jobs, 2, None).starts_with("task 2: expected COMPLETED after 0 restarts"));
        assert_eq!(
            refused(&[task("3", "FAILED", 0)], 1, None),
            "task 3: expected COMPLETED after 0 restarts, got FAILED after 0 with exit code 1:0"
        );
    }

    #[test]
    fn a_jobs_processes_are_separated_from_anothers() {
        let listing = "PID      JOBID    STEPID   LOCALID GLOBALID\n70 5 batch 0 0\n71 5 batch - -\n72 6 batch 0 0\n";
        assert_eq!(processes(listing, "5"), [70, 71]);
        assert_eq!(processes("No job steps exist on this node.\n", "5"), [0; 0]);
    }
}
