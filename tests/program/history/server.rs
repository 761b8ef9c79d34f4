//! A PostgreSQL server of a test's own, in a temporary folder, on a socket of that folder.

use std::io::{ErrorKind, Read, Write};
use std::net::Shutdown;
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use postgres::{Client, NoTls};
use tempfile::TempDir;

/// Name of the socket in the folder that a URL gives as host, where the port is the usual one.
const SOCKET: &str = ".s.PGSQL.5432";
/// Ends a test whose server does not start, and decides nothing: it takes a second or two.
const PATIENCE: Duration = Duration::from_secs(600);

fn url(folder: &Path, database: &str) -> String {
    let socket = folder.to_str().unwrap().replace('/', "%2F");
    format!("postgres://postgres@{socket}/{database}")
}

pub struct Server {
    process: Child,
    folder: TempDir,
}

impl Server {
    /// None, with a sentence, where PostgreSQL is not installed.
    pub fn start() -> Option<Server> {
        let Some(programs) = programs() else {
            println!(
                "skipped: no PostgreSQL under /usr/lib/postgresql; scripts/setup.sh test installs it"
            );
            return None;
        };
        let folder = tempfile::tempdir().unwrap();
        if is_root() {
            let given = Command::new("chown").arg("postgres").arg(folder.path()).status().unwrap();
            assert!(given.success());
        }
        let data = folder.path().join("data");
        let mut make = as_postgres(&programs.join("initdb"));
        make.args(["--auth=trust", "--username=postgres", "--encoding=UTF8", "--no-sync", "-D"])
            .arg(&data);
        let made = make.current_dir(folder.path()).output().unwrap();
        assert!(made.status.success(), "{made:?}");
        let mut serve = as_postgres(&programs.join("postgres"));
        serve.arg("-D").arg(&data).arg("-k").arg(folder.path()).args(["-c", "listen_addresses="]);
        let process =
            serve.current_dir(folder.path()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
        let server = Server { process: process.unwrap(), folder };
        server.wait();
        Some(server)
    }

    fn wait(&self) {
        let start = Instant::now();
        while Client::connect(&self.url("postgres"), NoTls).is_err() {
            assert!(start.elapsed() < PATIENCE, "the server does not start");
            std::thread::sleep(Duration::from_millis(50));
        }
    }

    pub fn url(&self, database: &str) -> String {
        url(self.folder.path(), database)
    }

    /// The URL of a new, empty database.
    pub fn database(&self, name: &str) -> String {
        self.client("postgres").batch_execute(&format!("CREATE DATABASE {name}")).unwrap();
        self.url(name)
    }

    pub fn client(&self, database: &str) -> Client {
        Client::connect(&self.url(database), NoTls).unwrap()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // An immediate shutdown, the server's own processes included.
        let _ = kill(Pid::from_raw(self.process.id() as i32), Signal::SIGQUIT);
        let _ = self.process.wait();
    }
}

/// A socket before a server's. It hands on the bytes of a connection, up to some number, and then kills the client.
pub struct CutConnection {
    folder: TempDir,
    listener: UnixListener,
    server: PathBuf,
}

impl CutConnection {
    pub fn before(server: &Server) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let listener = UnixListener::bind(folder.path().join(SOCKET)).unwrap();
        listener.set_nonblocking(true).unwrap();
        Self { folder, listener, server: server.folder.path().join(SOCKET) }
    }

    pub fn url(&self, database: &str) -> String {
        url(self.folder.path(), database)
    }

    /// Runs a command whose connection is cut after so many bytes; its status, and how many it sent. The server has ended the
    /// connection by then, and with it any transaction.
    pub fn after(&self, bytes: u64, command: &mut Command) -> (ExitStatus, u64) {
        let mut child = command.spawn().unwrap();
        let client = self.accepted(&mut child);
        let server = UnixStream::connect(&self.server).unwrap();
        let (answers, mut back) = (server.try_clone().unwrap(), client.try_clone().unwrap());
        let answering = std::thread::spawn(move || {
            // A client that was killed takes no more answers. The server's end is waited for.
            handed_on(answers, |bytes| drop(back.write_all(bytes)));
            drop(back.shutdown(Shutdown::Both));
        });
        let sent = handed_on(client.take(bytes), |bytes| (&server).write_all(bytes).unwrap());
        if sent == bytes {
            child.kill().unwrap();
        }
        server.shutdown(Shutdown::Write).unwrap();
        answering.join().unwrap();
        (child.wait().unwrap(), sent)
    }

    fn accepted(&self, child: &mut Child) -> UnixStream {
        loop {
            match self.listener.accept() {
                Ok((client, _)) => {
                    client.set_nonblocking(false).unwrap();
                    return client;
                }
                Err(error) => assert_eq!(error.kind(), ErrorKind::WouldBlock, "{error}"),
            }
            assert_eq!(child.try_wait().unwrap(), None, "it ended without a connection");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Hands on all bytes until the end; how many.
fn handed_on(mut from: impl Read, mut to: impl FnMut(&[u8])) -> u64 {
    let (mut buffer, mut all) = ([0; 4096], 0);
    while let Ok(count) = from.read(&mut buffer)
        && count > 0
    {
        to(&buffer[..count]);
        all += count as u64;
    }
    all
}

fn is_root() -> bool {
    std::fs::metadata("/proc/self").unwrap().uid() == 0
}

/// The folder of the newest version's programs.
fn programs() -> Option<PathBuf> {
    let versions = std::fs::read_dir("/usr/lib/postgresql").ok()?.flatten();
    let programs = versions.map(|version| version.path().join("bin"));
    programs.filter(|folder| folder.join("initdb").exists()).max()
}

/// The server refuses to run as root.
fn as_postgres(program: &Path) -> Command {
    if !is_root() {
        return Command::new(program);
    }
    let mut command = Command::new("setpriv");
    command.args(["--reuid=postgres", "--regid=postgres", "--init-groups", "--"]).arg(program);
    command
}
