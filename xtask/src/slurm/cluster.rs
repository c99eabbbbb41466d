//! Munge and Slurm on loopback, with all that they keep in one folder; they end with the value that stands for them.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::Write;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::program;
use crate::slurm::conf::{self, Conf};
use crate::slurm::job::{self, Job};

/// How often a state is asked for.
const POLL: Duration = Duration::from_millis(100);

/// How long a daemon may take to answer or to end, s.
const PATIENCE: u64 = 30;

/// Longest path of a Unix socket on Linux, bytes, its last zero left out.
const MAX_SOCKET: usize = 107;

/// What outlives this program: reads the daemons' numbers, and when the pipe is closed, by whatever end this program
/// comes to, ends the jobs and then the daemons.
const KEEPER: &str = "
while read -r pid; do pids=\"$pid $pids\"; done
if [ \"$(echo $pids | wc -w)\" = 3 ]; then
    scancel --partition=walk
    for _ in $(seq 100); do [ -z \"$(squeue --noheader)\" ] && break; sleep 0.2; done
fi
kill -TERM $pids
";

/// A cluster of one node; its jobs and daemons end when it is dropped, and also when this program is killed.
pub struct Cluster {
    folder: PathBuf,
    keeper: Child,
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
        let user = program::output(OsStr::new("id"), &["--user", "--name"], folder)?;
        let conf = Conf { folder, user: user.trim(), ports: free_ports()?, n_cpus };
        fs::write(folder.join("slurm.conf"), conf::text(&conf)).map_err(Error::io(folder))?;
        // munged refuses a key that others may read and a folder that others may write to.
        program::output(OsStr::new("chmod"), &["755", "."], folder)?;
        program::output(OsStr::new("mungekey"), &["--create", "--keyfile", "munge.key"], folder)?;

        let mut keeper = Command::new("setsid");
        keeper.args(["sh", "-c", KEEPER]).env("SLURM_CONF", folder.join("slurm.conf"));
        keeper.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let keeper = keeper.spawn().map_err(Error::io("setsid"))?;
        let mut cluster = Self { folder: folder.to_path_buf(), keeper, daemons: Vec::new() };
        let file = |option: &str, name: &str| format!("--{option}={}", folder.join(name).display());
        let names = [("key-file", "key"), ("socket", "socket"), ("pid-file", "pid"), ("log-file", "log")];
        let mut munge: Vec<_> = names.iter().map(|(option, end)| file(option, &format!("munge.{end}"))).collect();
        munge.extend([file("seed-file", "munge.seed"), "--foreground".into()]);
        cluster.daemon("munged", &munge, || Ok(socket.exists()))?;
        let conf = cluster.conf();
        let controller = ["-D", "-f", &conf].map(String::from);
        cluster.daemon("slurmctld", &controller, || Ok(quiet(&conf, "scontrol", &["ping"])?.contains(" is UP")))?;
        let node = ["-D", "-N", "localhost", "-f", &conf].map(String::from);
        cluster
            .daemon("slurmd", &node, || Ok(quiet(&conf, "sinfo", &["--noheader", "--format=%T"])?.trim() == "idle"))?;
        Ok(cluster)
    }

    /// Starts a daemon, tells the keeper, and waits until it is ready. It has a session of its own, so that ctrl-C
    /// leaves its end to the keeper.
    fn daemon(&mut self, name: &'static str, args: &[String], ready: impl Fn() -> Result<bool>) -> Result<()> {
        let log = self.folder.join(format!("{name}.out"));
        let out = File::create(&log).map_err(Error::io(&log))?;
        let err = out.try_clone().map_err(Error::io(&log))?;
        let mut command = Command::new("setsid");
        command.arg(name).args(args).env("PATH", path_with_sbin());
        command.stdin(Stdio::null()).stdout(out).stderr(err);
        let child = command.spawn().map_err(Error::io("setsid"))?;
        let pid = child.id();
        self.daemons.push((name, child));
        self.keeper.stdin.as_ref().map_or(Ok(()), |mut pipe| writeln!(pipe, "{pid}")).map_err(Error::io("keeper"))?;
        let place = format!("{name} (see {})", log.display());
        let Some((_, child)) = self.daemons.last_mut() else { return Ok(()) };
        wait_for(&place, PATIENCE, || match child.try_wait().map_err(Error::io(name))? {
            Some(status) => Err(Error::Failed { step: place.clone(), status }),
            None => Ok(ready()?.then_some(())),
        })
    }

    fn conf(&self) -> String {
        self.folder.join("slurm.conf").display().to_string()
    }

    /// Runs one of Slurm's programs in a folder and returns what it printed.
    pub fn ask(&self, program: &str, args: &[&str], folder: &Path) -> Result<String> {
        let mut command = Command::new(program);
        command.args(args).current_dir(folder).env("SLURM_CONF", self.conf());
        let output = command.stdin(Stdio::null()).output().map_err(Error::io(program))?;
        if !output.status.success() {
            let got = String::from_utf8_lossy(&output.stderr).trim().replace('\n', "; ");
            return Err(Error::invalid(format!("{program} {}", args.join(" ")), "success", got));
        }
        Ok(String::from_utf8_lossy(&output.stdout).into_owned())
    }

    /// A job, or the tasks of an array.
    pub fn jobs(&self, id: &str) -> Result<Vec<Job>> {
        job::parse(&self.ask("scontrol", &["--oneliner", "show", "job", id], &self.folder)?)
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
            let listing = quiet(&self.conf(), "scontrol", &["listpids", &job.id])?;
            Ok(job::processes(&listing, &job.id).into_iter().find(own))
        })?;
        self.ask("kill", &["-KILL", &pid.to_string()], &self.folder).map(|_| ())
    }
}

impl Drop for Cluster {
    /// Lets the keeper end all, and sees to it that it has.
    fn drop(&mut self) {
        drop(self.keeper.stdin.take());
        let daemons = self.daemons.iter_mut().map(|(name, child)| (*name, child));
        for (name, child) in std::iter::once(("the keeper", &mut self.keeper)).chain(daemons) {
            if wait_for(name, PATIENCE, || child.try_wait().map_err(Error::io(name))).is_err() {
                report(child.kill().and_then(|()| child.wait()).map(|_| ()).map_err(Error::io(name)));
            }
        }
    }
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

/// What a program prints, whether it succeeds or not: daemons that are just starting do not answer.
fn quiet(conf: &str, program: &str, args: &[&str]) -> Result<String> {
    let mut command = Command::new(program);
    command.args(args).env("SLURM_CONF", conf).stdin(Stdio::null());
    let output = command.output().map_err(Error::io(program))?;
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// Where nothing can be returned any more, an error is printed.
fn report(result: Result<()>) {
    if let Err(error) = result {
        eprintln!("error: {error}");
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
    let listeners = [bind()?, bind()?];
    let [a, b] = listeners.each_ref().map(|listener| listener.local_addr().map(|address| address.port()));
    Ok([a.map_err(Error::io("127.0.0.1"))?, b.map_err(Error::io("127.0.0.1"))?])
}
