//! A PostgreSQL server of a test's own, in a temporary folder, on a socket of that folder.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, TcpListener};
use std::os::unix::fs::MetadataExt;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tempfile::TempDir;

use crate::common::wait_until;

/// The usual port, by which the socket is named in the folder that a URL gives as host.
const PORT: u16 = 5432;
const SOCKET: &str = ".s.PGSQL.5432";

fn url(folder: &Path, database: &str) -> String {
    let socket = folder.to_str().unwrap().replace('/', "%2F");
    format!("postgres://postgres@{socket}/{database}")
}

pub struct Server {
    process: Child,
    folder: TempDir,
    programs: PathBuf,
    pub port: u16,
}

impl Server {
    /// None, with a sentence, where PostgreSQL is not installed.
    pub fn start() -> Option<Server> {
        let (programs, folder) = initialized()?;
        let server = Server::run(programs, folder, PORT, &["-c", "listen_addresses="]);
        Some(server.expect("the server starts"))
    }

    /// The same on a port of this host, where it takes TLS alone; and the file of its certificate, which is for this address.
    pub fn start_with_tls(address: &str) -> Option<(Server, PathBuf)> {
        loop {
            let (programs, folder) = initialized()?;
            let data = folder.path().join("data");
            let certificate = certificate(&data, address);
            let allowed = "local all all trust\nhostssl all all all trust\n";
            std::fs::write(data.join("pg_hba.conf"), allowed).unwrap();
            // Another program may take the port before the server does.
            let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
            let settings = ["-c", "listen_addresses=127.0.0.1", "-c", "ssl=on"];
            if let Some(server) = Server::run(programs, folder, port, &settings) {
                return Some((server, certificate));
            }
        }
    }

    /// None if the server ends.
    fn run(programs: PathBuf, folder: TempDir, port: u16, settings: &[&str]) -> Option<Server> {
        let mut serve = as_postgres(&programs.join("postgres"));
        serve.arg("-D").arg(folder.path().join("data")).arg("-k").arg(folder.path());
        serve.args(["-p", &port.to_string()]).args(settings).current_dir(folder.path());
        let process = serve.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        let mut server = Server { process, folder, programs, port };
        wait_until("the server", || {
            !server.is_running() || server.ask("postgres", "SELECT 1").is_ok()
        });
        server.is_running().then_some(server)
    }

    fn is_running(&mut self) -> bool {
        self.process.try_wait().unwrap().is_none()
    }

    pub fn url(&self, database: &str) -> String {
        url(self.folder.path(), database)
    }

    /// The URL of a new, empty database.
    pub fn database(&self, name: &str) -> String {
        self.answer("postgres", &format!("CREATE DATABASE {name}"));
        self.url(name)
    }

    /// Rows that a statement gives, their values parted by `|`.
    pub fn answer(&self, database: &str, statement: &str) -> String {
        self.ask(database, statement).unwrap_or_else(|output| panic!("{output:?}"))
    }

    fn ask(&self, database: &str, statement: &str) -> Result<String, Output> {
        let mut psql = Command::new(self.programs.join("psql"));
        psql.args(["-XqAt", "-U", "postgres", "-d", database, "-p", &self.port.to_string()]);
        let answer = psql.arg("-h").arg(self.folder.path()).args(["-c", statement]).output();
        let answer = answer.unwrap();
        if !answer.status.success() {
            return Err(answer);
        }
        Ok(String::from_utf8(answer.stdout).unwrap())
    }

    /// A certificate that no server here has.
    pub fn other_certificate(folder: &Path) -> PathBuf {
        let folder = folder.join("other");
        std::fs::create_dir(&folder).unwrap();
        certificate_by(Command::new("openssl"), &folder, "0.0.0.0")
    }
}

/// The server's programs and a folder that holds its data; none, with a sentence, where PostgreSQL is not installed.
fn initialized() -> Option<(PathBuf, TempDir)> {
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
    let mut make = as_postgres(&programs.join("initdb"));
    make.args(["--auth=trust", "--username=postgres", "--encoding=UTF8", "--no-sync", "-D"])
        .arg(folder.path().join("data"));
    let made = make.current_dir(folder.path()).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    Some((programs, folder))
}

/// Makes the key and the certificate that a server finds in its folder of data. They are the server's user's.
fn certificate(folder: &Path, address: &str) -> PathBuf {
    certificate_by(as_postgres(Path::new("openssl")), folder, address);
    // Where every user may read it.
    let copy = folder.with_file_name("server.crt");
    std::fs::copy(folder.join("server.crt"), &copy).unwrap();
    copy
}

fn certificate_by(mut openssl: Command, folder: &Path, address: &str) -> PathBuf {
    openssl.args(["req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]);
    openssl.args(["-nodes", "-days", "2", "-subj", "/CN=fathom-test", "-keyout", "server.key"]);
    openssl.args(["-out", "server.crt", "-addext", "basicConstraints=critical,CA:FALSE"]);
    openssl.args(["-addext", &format!("subjectAltName=IP:{address}")]);
    let made = openssl.current_dir(folder).output().unwrap();
    assert!(made.status.success(), "{made:?}");
    folder.join("server.crt")
}

impl Drop for Server {
    fn drop(&mut self) {
        if self.is_running() {
            // An immediate shutdown, the server's own processes included.
            let _ = kill(Pid::from_raw(self.process.id() as i32), Signal::SIGQUIT);
            let _ = self.process.wait();
        }
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
