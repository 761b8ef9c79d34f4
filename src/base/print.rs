//! Everything that is printed: answers and messages on standard output, notes and errors on standard error.
//!
//! Printing neither panics nor ends a command. A note that cannot be written is lost. An answer is what a command was
//! asked for and writes to no file; [`write_failure`] says why one could not be written, and the exit status follows from it.
//! A pipe that its reader has closed (`| head`) is no failure: the reader has what it wanted. A standard stream that is
//! closed when the program starts is opened by the standard library on `/dev/null`, so that no file takes its number.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write, stderr, stdout};
use std::sync::OnceLock;

use crate::text;

/// Neither notes nor progress are printed. Answers and errors are in any case.
static QUIET: OnceLock<()> = OnceLock::new();

/// From now on this process prints answers and errors alone.
pub fn set_quiet() {
    let _ = QUIET.set(());
}

/// The first failure to write an answer. Nothing is written to standard output after it.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Prints what was asked for: a text of whole lines.
pub fn answer(answer: impl Display) {
    let mut text = text::block(answer.to_string());
    if !text.ends_with('\n') {
        text.push('\n');
    }
    // It never fails.
    let _ = AnswerWriter.write_all(text.as_bytes());
}

/// Prints one line on standard output about what was done, such as the path of a file that was written.
pub fn status(message: impl Display) {
    if FAILURE.get().is_none() {
        let _ = write_message(&mut stdout(), &message);
    }
}

/// Prints one line on standard error.
pub fn note(message: impl Display) {
    if QUIET.get().is_none() {
        let _ = write_message(&mut stderr(), &message);
    }
}

/// Prints an error on one line of standard error.
pub fn error(message: impl Display) {
    let message = message.to_string();
    let lines: Vec<&str> = message.lines().map(str::trim).collect();
    let _ = write_message(&mut stderr(), &format!("error: {}", lines.join(" ")));
}

fn write_message(stream: &mut impl Write, message: &impl Display) -> io::Result<()> {
    let line = text::message(message.to_string().trim_end()) + "\n";
    stream.write_all(line.as_bytes())
}

/// Standard output as a writer of an answer's bytes. It takes everything; [`write_failure`] says what went wrong.
#[derive(Clone, Copy, Debug)]
pub struct AnswerWriter;

impl Write for AnswerWriter {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if FAILURE.get().is_none() {
            failed_if(stdout().write_all(bytes));
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if FAILURE.get().is_none() {
            failed_if(stdout().flush());
        }
        Ok(())
    }
}

/// Remembers the failure of what printed an answer by itself.
pub fn failed_if(printed: io::Result<()>) {
    if let Err(error) = printed {
        // The first failure is the one to report.
        let _ = FAILURE.set(error);
    }
}

/// Why an answer could not be written; none where its reader closed the pipe.
pub fn write_failure() -> Option<&'static io::Error> {
    let _ = AnswerWriter.flush();
    FAILURE.get().filter(|error| error.kind() != ErrorKind::BrokenPipe)
}
