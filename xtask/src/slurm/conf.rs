//! The configuration of a Slurm cluster of one node on this machine.

use std::path::Path;

/// What the configuration names.
pub struct Conf<'a> {
    /// Folder of the state, the spool, the logs and munge's socket; no blank in its path.
    pub folder: &'a Path,
    /// User that the daemons and the jobs run as.
    pub user: &'a str,
    /// Loopback ports of slurmctld and slurmd.
    pub ports: [u16; 2],
    /// Tasks of one processor that run at once.
    pub n_cpus: usize,
}

/// The text of `slurm.conf`: no accounting, no control groups, nothing outside `folder`.
pub fn text(conf: &Conf<'_>) -> String {
    let Conf { folder, user, ports: [controller, node], n_cpus } = conf;
    let folder = folder.display();
    format!(
        "ClusterName=walk\n\
         SlurmctldHost=localhost(127.0.0.1)\n\
         SlurmctldPort={controller}\n\
         SlurmdPort={node}\n\
         SlurmUser={user}\n\
         SlurmdUser={user}\n\
         AuthType=auth/munge\n\
         AuthInfo=socket={folder}/munge.socket\n\
         CredType=cred/munge\n\
         StateSaveLocation={folder}/state\n\
         SlurmdSpoolDir={folder}/spool\n\
         SlurmctldPidFile={folder}/slurmctld.pid\n\
         SlurmdPidFile={folder}/slurmd.pid\n\
         SlurmctldLogFile={folder}/slurmctld.log\n\
         SlurmdLogFile={folder}/slurmd.log\n\
         ProctrackType=proctrack/pgid\n\
         TaskPlugin=task/none\n\
         SwitchType=switch/none\n\
         MpiDefault=none\n\
         JobAcctGatherType=jobacct_gather/none\n\
         AccountingStorageType=accounting_storage/none\n\
         SelectType=select/cons_tres\n\
         SelectTypeParameters=CR_CPU\n\
         SlurmdParameters=config_overrides\n\
         ReturnToService=2\n\
         JobRequeue=1\n\
         NodeName=localhost NodeAddr=127.0.0.1 CPUs={n_cpus} State=UNKNOWN\n\
         PartitionName=walk Nodes=localhost Default=YES MaxTime=INFINITE State=UP\n"
    )
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
        let conf = Conf { folder: Path::new("/x/run"), user: "ann", ports: [5001, 5002], n_cpus: 2 };
        let text = text(&conf);
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
        let text = text(&Conf { folder: Path::new("/x"), user: "ann", ports: [1, 2], n_cpus: 1 });
        assert!(text.split_whitespace().all(|word| word.contains('=')));
        let mut keys: Vec<_> = text.lines().filter_map(|line| line.split('=').next()).collect();
        keys.sort_unstable();
        assert!(keys.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
