//! `fathom history` in databases of PostgreSQL: over a socket, over TLS, and where the server fails.

use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Output, Stdio};

use nix::sys::signal::Signal;

use super::made::{self, CELLS};
use super::server::{CutConnection, Server};
use super::{
    FIGURES, Target, add, done, history, keeps_runs_whole, names_the_commits_of_a_change,
    refused_and_not_shown, survives_kills, takes_hostile_names_as_text, tells_machines_apart,
};
use crate::common::refused;

/// A database of a server, and how much a command sent to it, bytes.
struct ServedDatabase<'a> {
    server: &'a Server,
    cut: CutConnection,
    sent: u64,
}

impl ServedDatabase<'_> {
    const NAME: &'static str = "killed";
}

impl Target for ServedDatabase<'_> {
    fn place(&self) -> String {
        self.cut.url(Self::NAME)
    }

    fn add_whole(&mut self, mut command: Command) {
        let (status, sent) = self.cut.after(u64::MAX, command.stdout(Stdio::null()));
        assert!(status.success());
        self.sent = sent;
    }

    fn add_and_kill(&mut self, mut command: Command, share: f64) {
        let (status, _) = self.cut.after((share * self.sent as f64) as u64, &mut command);
        assert_eq!(status.signal(), Some(Signal::SIGKILL as i32), "{share}");
    }

    fn figures(&mut self) -> Vec<(i64, i64)> {
        let rows = self.server.answer(Self::NAME, FIGURES);
        let number = |text: &str| text.parse().unwrap();
        rows.lines()
            .map(|row| row.split_once('|').unwrap())
            .map(|(stored, found)| (number(stored), number(found)))
            .collect()
    }
}

#[test]
fn a_database_of_postgresql_is_a_history() {
    let Some(server) = Server::start() else { return };
    let folder = tempfile::tempdir().unwrap();
    keeps_runs_whole(folder.path(), &server.database("whole"));
    tells_machines_apart(folder.path(), &server.database("machines"));
    names_the_commits_of_a_change(folder.path(), &server.database("change"));
    takes_hostile_names_as_text(folder.path(), &server.database("names"));
    let killed = server.database(ServedDatabase::NAME);
    let cut = CutConnection::before(&server);
    survives_kills(folder.path(), &killed, &mut ServedDatabase { server: &server, cut, sent: 0 });
    let empty = server.database("empty");
    refused(&history(folder.path(), &empty, &["list"]).output().unwrap(), "there is no history in");
    server.answer("whole", "UPDATE fathom_history SET format = 99");
    let newer = history(folder.path(), &server.url("whole"), &["list"]).output().unwrap();
    refused(&newer, "has history format 99, but this build reads format 1");
}

#[test]
fn a_server_that_is_not_there_or_says_nothing_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let run = made::folder(folder.path(), "run", &made::records(1, CELLS, 5e6));
    for url in
        ["postgres://user:secret@127.0.0.1:1/d", "postgres://user:secret@no-such-host.invalid/d"]
    {
        let mut add = history(folder.path(), url, &add(run.to_str().unwrap(), "c"));
        let output: Output = add.arg("--unencrypted").output().unwrap();
        let told = refused(&output, "cannot reach the PostgreSQL database `d`");
        assert!(!told.contains("secret"), "{told}");
    }
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("postgres://user@127.0.0.1:{}/d", silent.local_addr().unwrap().port());
    refused(&history(folder.path(), &url, &["list"]).output().unwrap(), "no answer within");
}

/// It greets, and answers no statement: the socket stays open.
#[test]
fn a_server_that_falls_silent_is_not_waited_for_without_end() {
    use std::io::{Read, Write};
    let server = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = server.local_addr().unwrap().port();
    let serve = std::thread::spawn(move || {
        let (mut client, _) = server.accept().unwrap();
        // The request for TLS is not made; the start-up message is answered by `AuthenticationOk` and `ReadyForQuery`.
        let mut message = [0; 1024];
        let _ = client.read(&mut message).unwrap();
        client.write_all(b"R\0\0\0\x08\0\0\0\0Z\0\0\0\x05I").unwrap();
        // Until the client goes.
        while client.read(&mut message).is_ok_and(|read| read > 0) {}
    });
    let folder = tempfile::tempdir().unwrap();
    let url = format!("postgres://user@127.0.0.1:{port}/d?sslmode=disable");
    refused(&history(folder.path(), &url, &["list"]).output().unwrap(), "no answer within");
    serve.join().unwrap();
}

#[test]
fn urls_that_are_refused_are_not_shown() {
    let folder = tempfile::tempdir().unwrap();
    for (place, reason) in [
        ("postgres://user:pass@secret@localhost/d", "not understood"),
        ("postgres://user:secret@localhost:port/d", "not understood"),
        ("postgres://user:secret@example.org/d?sslmode=disable", "say --unencrypted"),
        ("postgres://user:secret@localhost,192.0.2.1/d?sslmode=disable", "say --unencrypted"),
        (
            "postgres://user:secret@localhost/d?hostaddr=192.0.2.1&sslmode=disable",
            "say --unencrypted",
        ),
    ] {
        refused_and_not_shown(folder.path(), place, reason);
    }
}

/// The server takes nothing over TCP but TLS. 0.0.0.0 leads to this host, and counts as another one.
#[test]
fn another_host_is_reached_over_tls_and_its_certificate_is_checked() {
    let Some((server, certificate)) = Server::start_with_tls("0.0.0.0") else { return };
    let folder = tempfile::tempdir().unwrap();
    let run = made::folder(folder.path(), "run", &made::records(1, CELLS, 5e6));
    let over_tcp = |host: &str, options: &str, arguments: &[&str]| {
        let url = format!("postgres://postgres@{host}:{}/postgres{options}", server.port());
        let mut command = history(folder.path(), &url, arguments);
        command.env_remove("SSL_CERT_DIR").env("SSL_CERT_FILE", &certificate);
        command
    };
    done(over_tcp("0.0.0.0", "", &add(run.to_str().unwrap(), "c")));
    assert_eq!(done(over_tcp("0.0.0.0", "", &["list"])).lines().count(), 1 + 1);
    let refusal = |mut command: Command, reason: &str| refused(&command.output().unwrap(), reason);
    let mut unknown = over_tcp("0.0.0.0", "", &["list"]);
    unknown.env("SSL_CERT_FILE", Server::other_certificate(folder.path()));
    refusal(unknown, "invalid peer certificate");
    let mut none = over_tcp("0.0.0.0", "", &["list"]);
    none.env("SSL_CERT_FILE", folder.path().join("missing.pem"));
    refusal(none, "no certificate is trusted on this system");
    // The certificate is another host's.
    refusal(over_tcp("127.0.0.1", "?sslmode=require", &["list"]), "invalid peer certificate");
    // Without TLS the server lets nobody in: on this host that is the default, to another it is said.
    refusal(over_tcp("127.0.0.1", "", &["list"]), "no encryption");
    refusal(over_tcp("0.0.0.0", "", &["list", "--unencrypted"]), "no encryption");
}
