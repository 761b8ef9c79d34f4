//! `fathom history` in databases of PostgreSQL: over a socket, over TLS, and where the server fails.

use std::os::unix::process::ExitStatusExt;
use std::process::{Command, Stdio};

use nix::sys::signal::Signal;

use super::made::{CELLS, records};
use super::server::{CutConnection, Server};
use super::{
    FIGURES, Target, add, history, keeps_runs_whole, names_the_commits_of_a_change, put,
    survives_kills, takes_hostile_names_as_text, tells_machines_apart,
};
use crate::common::{Ends, Place, names};

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
    let place = Place::new();
    keeps_runs_whole(&place, &server.database("whole"));
    tells_machines_apart(&place, &server.database("machines"));
    names_the_commits_of_a_change(&place, &server.database("change"));
    takes_hostile_names_as_text(&place, &server.database("names"));
    let killed = server.database(ServedDatabase::NAME);
    let cut = CutConnection::before(&server);
    let folder = &place.path("");
    survives_kills(folder, &killed, &mut ServedDatabase { server: &server, cut, sent: 0 });
    history(folder, &server.database("empty"), "list").refused("there is no history in");
    server.answer("whole", "UPDATE fathom_history SET format = 99");
    let newer = "has history format 99, but this build reads format 1";
    history(folder, &server.url("whole"), "list").refused(newer);
}

#[test]
fn a_server_that_is_not_there_or_says_nothing_is_told() {
    let place = Place::new();
    let folder = &place.path("");
    put(&place.path("run"), &records(1, CELLS, 5e6));
    for host in ["127.0.0.1:1", "no-such-host.invalid"] {
        let url = format!("postgres://user:secret@{host}/d");
        let mut add = history(folder, &url, add("run", "c"));
        let told = add.arg("--unencrypted").refused("cannot reach the PostgreSQL database `d`");
        assert!(!told.contains("secret"), "{told}");
    }
    let silent = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("postgres://user@127.0.0.1:{}/d", silent.local_addr().unwrap().port());
    history(folder, &url, "list").refused("no answer within");
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
    let url = format!("postgres://user@127.0.0.1:{port}/d?sslmode=disable");
    history(&Place::new().path(""), &url, "list").refused("no answer within");
    serve.join().unwrap();
}

/// Nor are they taken for files.
#[test]
fn what_may_hold_a_password_is_refused_and_not_shown() {
    let place = Place::new();
    for (db, reason) in [
        ("Postgres://user:secret@h/d", "not understood"),
        (" postgres://user:secret@h/d", "not understood"),
        ("jdbc:postgresql://h/d?password=secret", "not understood"),
        ("mysql://user:secret@h/d", "not understood"),
        ("postgres://user:pass@secret@localhost/d", "not understood"),
        ("postgres://user:secret@localhost:port/d", "not understood"),
        ("postgres://user:secret@example.org/d?sslmode=disable", "say --unencrypted"),
        ("postgres://user:secret@localhost,192.0.2.1/d?sslmode=disable", "say --unencrypted"),
        (
            "postgres://user:secret@localhost/d?hostaddr=192.0.2.1&sslmode=disable",
            "say --unencrypted",
        ),
    ] {
        let as_option = history(&place.path(""), db, "list");
        let mut by_variable = place.fathom("history list");
        by_variable.env("FATHOM_HISTORY", db);
        for mut command in [as_option, by_variable] {
            let told = command.ends(2);
            told.error(reason);
            assert!(!told.err.contains("secret") && !told.out.contains("secret"), "{db}");
        }
    }
    assert_eq!(names(&place.path("")), [""; 0]);
}

/// The server takes nothing over TCP but TLS. 0.0.0.0 leads to this host, and counts as another one.
#[test]
fn another_host_is_reached_over_tls_and_its_certificate_is_checked() {
    let Some((server, certificate)) = Server::start_with_tls("0.0.0.0") else { return };
    let place = Place::new();
    put(&place.path("run"), &records(1, CELLS, 5e6));
    let over_tcp = |host: &str, options: &str, words: &str| {
        let url = format!("postgres://postgres@{host}:{}/postgres{options}", server.port);
        let mut command = history(&place.path(""), &url, words);
        command.env_remove("SSL_CERT_DIR").env("SSL_CERT_FILE", &certificate);
        command
    };
    over_tcp("0.0.0.0", "", &add("run", "c")).ends(0);
    assert_eq!(over_tcp("0.0.0.0", "", "list").answer().lines().count(), 1 + 1);
    for (file, reason) in [
        (Server::other_certificate(&place.path("")), "invalid peer certificate"),
        (place.path("missing.pem"), "no certificate is trusted on this system"),
    ] {
        over_tcp("0.0.0.0", "", "list").env("SSL_CERT_FILE", file).refused(reason);
    }
    // The certificate is another host's.
    over_tcp("127.0.0.1", "?sslmode=require", "list").refused("invalid peer certificate");
    // Without TLS the server lets nobody in: on this host that is the default, to another it is said.
    over_tcp("127.0.0.1", "", "list").refused("no encryption");
    over_tcp("0.0.0.0", "", "list --unencrypted").refused("no encryption");
}
