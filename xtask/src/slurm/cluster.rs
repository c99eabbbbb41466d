//! Munge and Slurm on loopback, with all that they keep in one folder; they end when the [`Cluster`] is dropped.

use std::fs::{self, File};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Child;
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::program::Program;
use crate::slurm::job::{self, Job};

/// How often a state is asked for.
const POLL: Duration = Duration::from_millis(100);

/// How long a daemon may take to answer or to end, s.
const PATIENCE: u64 = 30;

/// Longest path of a Unix socket on Linux, bytes, its last zero left out.
const MAX_SOCKET: usize = 107;

/// A cluster of one node; its jobs and daemons end when it is dropped, its daemons also when this program is killed.
pub struct Cluster {
    folder: PathBuf,
    /// In the order of their start.
    daemons: Vec<(&'static str, Child)>,
}

impl Cluster {
    /// Starts the daemons in a folder, which is made, and waits until the node takes jobs.
    pub fn start(folder: &Path, n_cpus: usize) -> Result<Self> {
        let socket = folder.join("munge.socket");
        if socket.as_os_str().len() > MAX_SOCKET || socket.to_string_lossy().contains(char::is_whitespace) {
            let expected = format!("a path of at most {MAX_SOCKET} bytes without blanks (CARGO_TARGET_DIR sets it)");
            return Err(Error::invalid("munge's socket", expected, socket.display().to_string()));
        }
        for inner in ["state", "spool"] {
            fs::create_dir_all(folder.join(inner)).map_err(Error::io(folder))?;
        }
        let user = Program::new("id").words("--user --name").output(folder)?;
        let text = configuration(folder, user.trim(), free_ports()?, n_cpus);
        fs::write(folder.join("slurm.conf"), text).map_err(Error::io(folder))?;
        // munged refuses a key that others may read and a folder that others may write to.
        Program::new("chmod").words("755 .").run(folder)?;
        Program::new("mungekey").words("--create --keyfile munge.key").run(folder)?;

        let mut cluster = Self { folder: folder.to_path_buf(), daemons: Vec::new() };
        cluster.start_daemons(&socket)?;
        Ok(cluster)
    }

    fn start_daemons(&mut self, socket: &Path) -> Result<()> {
        let folder = self.folder.display().to_string();
        let files = [("key-file", "key"), ("socket", "socket"), ("pid-file", "pid"), ("log-file", "log")];
        let option = |(option, end): (&str, &str)| format!("--{option}={folder}/munge.{end}");
        let munge = [files.map(option).join(" "), format!("--seed-file={folder}/munge.seed --foreground")].join(" ");
        self.daemon("munged", &munge, |_| Ok(socket.exists()))?;
        let conf = format!("{folder}/slurm.conf");
        let is_up =
            |cluster: &Self| Ok(cluster.program("scontrol", "ping").answer(&cluster.folder)?.contains(" is UP"));
        self.daemon("slurmctld", &format!("-D -f {conf}"), is_up)?;
        let is_idle = |cluster: &Self| {
            Ok(cluster.program("sinfo", "--noheader --format=%T").answer(&cluster.folder)?.trim() == "idle")
        };
        self.daemon("slurmd", &format!("-D -N localhost -f {conf}"), is_idle)
    }

    /// Starts a daemon, which ends when this program ends, and waits until it is ready.
    fn daemon(&mut self, name: &'static str, words: &str, is_ready: impl Fn(&Self) -> Result<bool>) -> Result<()> {
        let log = self.folder.join(format!("{name}.out"));
        let out = File::create(&log).map_err(Error::io(&log))?;
        let err = out.try_clone().map_err(Error::io(&log))?;
        let program = Program::new("setpriv").words("--pdeathsig TERM --").arg(name).words(words);
        let mut command = program.variable("PATH", path_with_sbin()).command(&self.folder);
        let mut child = command.stdout(out).stderr(err).spawn().map_err(Error::io("setpriv"))?;
        let what = format!("{name} (see {})", log.display());
        let ready = wait_for(&what, PATIENCE, || match child.try_wait().map_err(Error::io(name))? {
            Some(status) => Err(Error::Failed { command: what.clone(), status }),
            None => Ok(is_ready(self)?.then_some(())),
        });
        self.daemons.push((name, child));
        ready
    }

    /// Ends the jobs, then the daemons, the last first.
    fn stop(&mut self) -> Result<()> {
        if self.daemons.len() == 3 {
            self.program("scancel", "--partition=walk").run(&self.folder)?;
            let is_empty = || Ok(self.program("squeue", "--noheader").answer(&self.folder)?.is_empty().then_some(()));
            wait_for("the end of the jobs", PATIENCE, is_empty)?;
        }
        for (name, child) in self.daemons.iter_mut().rev() {
            Program::new("kill").words(child.id().to_string()).run(&self.folder)?;
            wait_for(name, PATIENCE, || child.try_wait().map_err(Error::io(*name)))?;
        }
        Ok(())
    }

    /// One of Slurm's programs, talking to this cluster.
    pub fn program(&self, name: &str, words: &str) -> Program {
        Program::new(name).words(words).variable("SLURM_CONF", self.folder.join("slurm.conf"))
    }

    /// A job, or the tasks of an array.
    pub fn jobs(&self, id: &str) -> Result<Vec<Job>> {
        job::parse(&self.program("scontrol", "--oneliner show job").arg(id).output(&self.folder)?)
    }

    /// Waits until nothing more is to come of a job or of any task of an array.
    pub fn wait(&self, id: &str, seconds: u64) -> Result<Vec<Job>> {
        let over = |jobs: Vec<Job>| jobs.iter().all(job::is_over).then_some(jobs);
        wait_for(&format!("job {id}"), seconds, || self.jobs(id).map(over))
    }

    /// Kills (signal 9) the process of a job that runs `name`, once there is one; the job must run still.
    pub fn kill(&self, id: &str, name: &str, seconds: u64) -> Result<()> {
        let own = |pid: &u32| fs::read_to_string(format!("/proc/{pid}/comm")).is_ok_and(|comm| comm.trim() == name);
        let pid = wait_for(&format!("{name} in job {id}"), seconds, || {
            let jobs = self.jobs(id)?;
            if let Some(job) = jobs.iter().find(|job| job::is_over(job)) {
                return Err(Error::invalid(format!("job {id}"), "to be killed while it runs", job.state.clone()));
            }
            let Some(job) = jobs.first().filter(|job| job.state == "RUNNING") else { return Ok(None) };
            // A job that has only just started is not known to its node yet.
            let listing = self.program("scontrol", "listpids").arg(&job.id).answer(&self.folder)?;
            Ok(job::processes(&listing, &job.id).into_iter().find(own))
        })?;
        Program::new("kill").words(format!("-KILL {pid}")).run(&self.folder).map(|_| ())
    }
}

impl Drop for Cluster {
    /// Nothing can be returned here: an error is printed, and what still runs ends with this program.
    fn drop(&mut self) {
        if let Err(error) = self.stop() {
            eprintln!("error: {error}");
        }
    }
}

/// The text of `slurm.conf`. The folder's path must have no blanks; the ports are slurmctld's and slurmd's.
fn configuration(folder: &Path, user: &str, [controller, node]: [u16; 2], n_cpus: usize) -> String {
    let template = include_str!("../../slurm/slurm.conf").lines().filter(|line| !line.starts_with('#'));
    let text = template.flat_map(|line| [line, "\n"]).collect::<String>();
    let text = text.replace("CONTROLLER_PORT", &controller.to_string()).replace("NODE_PORT", &node.to_string());
    let text = text.replace("N_CPUS", &n_cpus.to_string()).replace("=USER", &format!("={user}"));
    text.replace("FOLDER", &folder.display().to_string())
}

/// Asks until there is an answer.
pub fn wait_for<T>(what: &str, seconds: u64, mut ask: impl FnMut() -> Result<Option<T>>) -> Result<T> {
    let start = Instant::now();
    loop {
        if let Some(answer) = ask()? {
            return Ok(answer);
        }
        if start.elapsed() > Duration::from_secs(seconds) {
            return Err(Error::invalid(what, format!("an end within {seconds} s"), "none"));
        }
        sleep(POLL);
    }
}

/// Whether a program is on the search path or among the system's daemons.
pub fn is_installed(program: &str) -> bool {
    std::env::split_paths(&path_with_sbin()).any(|folder| folder.join(program).is_file())
}

/// The search path with the folder of the system's daemons.
fn path_with_sbin() -> String {
    format!("{}:/usr/local/sbin:/usr/sbin", std::env::var("PATH").unwrap_or_default())
}

/// Two ports that nobody uses just now.
fn free_ports() -> Result<[u16; 2]> {
    let bind = || TcpListener::bind("127.0.0.1:0").map_err(Error::io("127.0.0.1"));
    let port = |listener: &TcpListener| listener.local_addr().map(|it| it.port()).map_err(Error::io("127.0.0.1"));
    // Both are held until both are known, so that they differ.
    let (a, b) = (bind()?, bind()?);
    Ok([port(&a)?, port(&b)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values of a key.
    fn values<'a>(text: &'a str, key: &str) -> Vec<&'a str> {
        text.split_whitespace().filter_map(|pair| pair.strip_prefix(key)?.strip_prefix('=')).collect()
    }

    #[test]
    fn nothing_is_kept_outside_the_folder_and_nothing_listens_outside_the_machine() {
        let text = configuration(Path::new("/x/run"), "ann", [5001, 5002], 2);
        let paths = text.split_whitespace().filter_map(|pair| pair.split_once("=/")).map(|(_, path)| path);
        assert_eq!(paths.clone().count(), 7);
        assert!(paths.clone().all(|path| path.starts_with("x/run/")));
        assert_eq!(values(&text, "AuthInfo"), ["socket=/x/run/munge.socket"]);
        assert_eq!(values(&text, "SlurmctldHost"), ["localhost(127.0.0.1)"]);
        assert_eq!((values(&text, "SlurmctldPort"), values(&text, "SlurmdPort")), (vec!["5001"], vec!["5002"]));
        assert_eq!((values(&text, "SlurmUser"), values(&text, "SlurmdUser")), (vec!["ann"], vec!["ann"]));
        assert_eq!(values(&text, "CPUs"), ["2"]);
    }

    /// Slurm reads a line as far as its first word without `=`.
    #[test]
    fn each_word_is_a_key_and_a_value_and_each_line_begins_with_another_key() {
        let text = configuration(Path::new("/x"), "ann", [1, 2], 1);
        assert!(text.split_whitespace().all(|word| word.contains('=')));
        let mut keys: Vec<_> = text.lines().filter_map(|line| line.split('=').next()).collect();
        keys.sort_unstable();
        assert!(keys.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
