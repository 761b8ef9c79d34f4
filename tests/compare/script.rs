//! Builds that are shell scripts, so that each can fail in its own way.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// What a worker answers to `hello`: a command of the shell.
pub fn hello(protocol: u32, parts: &str) -> String {
    let adapter = serde_json::to_string(&fathom::record::Adapter {
        name: "toy".to_owned(),
        software: true,
        ..Default::default()
    });
    format!(
        r#"echo '{{"message":"hello","protocol":{protocol},"fathom_version":"0","adapter":{},"parts":[{parts}],"cores":null,"randomized":null,"notes":[]}}'"#,
        adapter.unwrap()
    )
}

pub fn refusal(reason: &str, absent: bool) -> String {
    format!(r#"echo '{{"message":"fault","reason":"{reason}","fatal":false,"absent":{absent}}}'"#)
}

/// Answers `sample`: each frame took so many nanoseconds, a number or a variable. Less than any request takes.
pub fn sample(ns: &str) -> String {
    format!(
        r#"n=${{line##*'"frames":'}}; n=${{n%%\}}*}}; all={ns}; while [ "$n" -gt 1 ]; do all=$all,{ns}; n=$((n - 1)); done; echo "{{\"message\":\"sample\",\"ns\":[$all]}}""#
    )
}

/// A build of two stages, `a` and `b`: what it answers to the messages that hold a pattern, the first that fits.
pub struct Script<'a> {
    pub hello: String,
    /// Shell commands by pattern, before the usual answers.
    pub instead: &'a [(&'a str, &'a str)],
    pub bytes: u64,
    /// As JSON.
    pub error: &'a str,
    pub ns: u64,
}

impl Default for Script<'_> {
    fn default() -> Self {
        Self {
            hello: hello(1, r#""exact","checks","time""#),
            instead: &[],
            bytes: 1000,
            error: "0.01",
            ns: 200,
        }
    }
}

impl Script<'_> {
    /// Writes it to a file that can be executed. Another process does so: a file that a process has open for writing, as one that
    /// another test has just forked from this one would, cannot be executed.
    pub fn write(&self, folder: &Path, name: &str) -> PathBuf {
        let path = folder.join(name);
        let mut shell = Command::new("sh");
        shell.args(["-c", "cat > \"$1\" && chmod +x \"$1\"", "sh"]).arg(&path);
        let mut shell = shell.stdin(Stdio::piped()).spawn().unwrap();
        shell.stdin.take().unwrap().write_all(self.text().as_bytes()).unwrap();
        assert!(shell.wait().unwrap().success());
        path
    }

    fn text(&self) -> String {
        let Self { hello, instead, bytes, error, ns } = self;
        let instead: String = instead
            .iter()
            .map(|(pattern, command)| format!("*'{pattern}'*) {command};;\n"))
            .collect();
        let each = |text: &str| ["a", "b"].map(|name| text.replace("NAME", name)).join(",");
        let sample = sample(&ns.to_string());
        let stages = each(r#"{"name":"NAME","kind":"compute"}"#);
        let exact = each(r#"{"name":"NAME","work":{"photons":7},"counters":{}}"#);
        format!(
            "#!/bin/sh\nwhile read -r line; do case \"$line\" in\n{instead}\
             *'\"hello\"'*) {hello};;\n\
             *'\"prepare\"'*) echo '{{\"message\":\"prepared\",\"stages\":[{stages}]}}';;\n\
             *'\"exact\"'*) echo '{{\"message\":\"exact\",\"stages\":[{exact}],\"allocated_bytes\":{bytes},\
             \"errors\":{{\"an_error\":{error}}},\"quantities\":{{}},\"notes\":[]}}';;\n\
             *'\"checks\"'*) echo '{{\"message\":\"checks\",\"checks\":[]}}';;\n\
             *'\"sample\"'*) {sample};;\n\
             *'\"quit\"'*) exit;;\nesac; done\n",
        )
    }
}
