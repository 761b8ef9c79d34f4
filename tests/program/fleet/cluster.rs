//! A Slurm of one's own: a controller and two nodes on this machine, with ports, keys and state in a temporary folder.

use std::fs::{self, File};
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

use crate::common::{Place, names, wait_until};

pub const NODES: [&str; 2] = ["n1", "n2"];
/// Where Debian puts daemons.
const PATH: &str = "/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin";
pub struct Cluster {
    pub place: Place,
    daemons: Vec<Child>,
    pub nodes: Vec<Child>,
}

/// Whether Slurm and munge are installed.
pub fn is_installed() -> bool {
    let found =
        |program: &str| PATH.split(':').any(|folder| Path::new(folder).join(program).exists());
    ["slurmctld", "slurmd", "sbatch", "munged"].into_iter().all(found)
}

impl Cluster {
    pub fn start() -> Self {
        let mut cluster = Self { place: Place::new(), daemons: Vec::new(), nodes: Vec::new() };
        cluster.configure();
        let munged = cluster.munged();
        cluster.daemons.push(munged);
        wait_until("munged", || cluster.place.path("munge.socket").exists());
        let controller = cluster.daemon("slurmctld", &[]);
        cluster.daemons.push(controller);
        cluster.nodes = NODES.map(|node| cluster.node(node)).into();
        wait_until("the nodes", || {
            cluster.told("sinfo", &["-h", "-N", "-o", "%T"]) == "idle\nidle\nidle\nidle\n"
        });
        cluster
    }

    fn configure(&self) {
        let name = |option: &str| {
            let output = Command::new("id").arg(option).output().unwrap();
            String::from_utf8(output.stdout).unwrap().trim().to_owned()
        };
        let host = fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
        let (user, host, folder) = (name("-un"), host.trim(), self.place.path(""));
        let folder = folder.display();
        let listeners = [0; 3].map(|_| TcpListener::bind("127.0.0.1:0").unwrap());
        let [controller, ports @ ..] =
            listeners.map(|listener| listener.local_addr().unwrap().port());
        let mut text = format!(
            "ClusterName=fathom\nSlurmctldHost={host}(127.0.0.1)\nSlurmctldPort={controller}\nSlurmUser={user}\nSlurmdUser={user}\n\
             AuthType=auth/munge\nAuthInfo=socket={folder}/munge.socket\nCredType=cred/munge\n\
             StateSaveLocation={folder}/state\nSlurmdSpoolDir={folder}/%n\nSlurmctldPidFile={folder}/slurmctld.pid\nSlurmdPidFile={folder}/%n.pid\n\
             ProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nMpiDefault=none\nReturnToService=2\nSlurmdTimeout=6\n\
             SchedulerParameters=batch_sched_delay=0,sched_min_interval=200000,bf_interval=1\nKillWait=3\nMinJobAge=5\n\
             PreemptType=preempt/partition_prio\nPreemptMode=CANCEL\n"
        );
        for (node, port) in NODES.iter().zip(ports) {
            text += &format!(
                "NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs=1 State=UNKNOWN\n"
            );
        }
        text += "PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP PriorityTier=1\n\
                 PartitionName=urgent Nodes=ALL MaxTime=INFINITE State=UP PriorityTier=9 PreemptMode=OFF\n";
        fs::create_dir_all(self.place.path("state")).unwrap();
        self.place.write("slurm.conf", text);
        let key = self.place.write("munge.key", [42; 1024]);
        fs::set_permissions(key, fs::Permissions::from_mode(0o400)).unwrap();
    }

    fn munged(&self) -> Child {
        let mut munged = self.command("munged");
        munged.args(["--foreground", "--force"]);
        for (option, name) in [
            ("--key-file", "munge.key"),
            ("--socket", "munge.socket"),
            ("--pid-file", "munge.pid"),
            ("--log-file", "munge.log"),
            ("--seed-file", "munge.seed"),
        ] {
            munged.arg(format!("{option}={}", self.place.path(name).display()));
        }
        self.spawn(munged, "munged")
    }

    fn daemon(&self, program: &str, arguments: &[&str]) -> Child {
        let mut daemon = self.command(program);
        daemon.arg("-D").args(arguments);
        self.spawn(daemon, &format!("{program}{}", arguments.concat()))
    }

    pub fn node(&self, name: &str) -> Child {
        self.daemon("slurmd", &["-N", name])
    }

    fn spawn(&self, mut command: Command, log: &str) -> Child {
        let log = File::create(self.place.path(format!("{log}.log"))).unwrap();
        command.stdin(Stdio::null()).stdout(log.try_clone().unwrap()).stderr(log).spawn().unwrap()
    }

    /// A command that finds this Slurm.
    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.env("SLURM_CONF", self.place.path("slurm.conf")).env("PATH", PATH);
        command
    }

    pub fn told(&self, program: &str, arguments: &[&str]) -> String {
        let output = self.command(program).args(arguments).output().unwrap();
        String::from_utf8_lossy(&output.stdout).into_owned()
    }
}

impl Drop for Cluster {
    fn drop(&mut self) {
        if std::thread::panicking() {
            let logs =
                names(&self.place.path("")).into_iter().filter(|name| name.ends_with(".log"));
            logs.for_each(|log| eprintln!("{log}:\n{}", self.place.read(&log)));
        }
        self.told("scancel", &["--quiet", "--state=PENDING", "--me"]);
        self.told("scancel", &["--quiet", "--me"]);
        std::thread::sleep(Duration::from_secs(1));
        for daemon in self.nodes.iter_mut().chain(self.daemons.iter_mut().rev()) {
            daemon.kill().ok();
            daemon.wait().ok();
        }
    }
}
