//! What clap knows of the command line, for people and shells: suggestions, completions, manual pages.

use std::process::ExitCode;

use clap::CommandFactory;
use clap::error::{ContextKind, ContextValue, ErrorKind};

use super::Cli;
use super::commands::Outcome;
use crate::harness::catalog::Catalog;
use crate::tell::Answer;
use crate::text;

pub fn completions(catalog: &Catalog, shell: clap_complete::Shell) -> Outcome {
    clap_complete::generate(shell, &mut Cli::command(), catalog.program.binary, &mut Answer);
    Ok(ExitCode::SUCCESS)
}

pub fn man(catalog: &Catalog, name: Option<&str>) -> Outcome {
    let mut program = Cli::command().name(catalog.program.binary);
    // Gives each command its whole name.
    program.build();
    let page = match name {
        None => &program,
        Some(name) => program.find_subcommand(name).ok_or_else(|| {
            let meant = text::did_you_mean(&text::nearest(name, names(&program)));
            anyhow::anyhow!("there is no command `{}`{meant}", text::line(name))
        })?,
    };
    clap_mangen::Man::new(page.clone()).render(&mut Answer)?;
    Ok(ExitCode::SUCCESS)
}

fn names(command: &clap::Command) -> impl Iterator<Item = &str> {
    let shown = command.get_subcommands().filter(|command| !command.is_hide_set());
    shown.map(clap::Command::get_name)
}

/// Adds what was probably meant by a command or a value where clap finds nothing alike: it does not in short names.
pub fn suggesting(mut error: clap::Error) -> clap::Error {
    let (wrong, suggested) = match error.kind() {
        ErrorKind::InvalidSubcommand => {
            (ContextKind::InvalidSubcommand, ContextKind::SuggestedSubcommand)
        }
        ErrorKind::InvalidValue => (ContextKind::InvalidValue, ContextKind::SuggestedValue),
        _ => return error,
    };
    let Some(ContextValue::String(given)) = error.get(wrong) else { return error };
    let known = match error.get(ContextKind::ValidValue) {
        Some(ContextValue::Strings(known)) => known.clone(),
        _ => commands_beside(given),
    };
    let nearest = text::nearest(given, known.iter().map(String::as_str));
    if let Some(nearest) = nearest.filter(|_| error.get(suggested).is_none()) {
        let value = match suggested {
            ContextKind::SuggestedSubcommand => ContextValue::Strings(vec![nearest]),
            _ => ContextValue::String(nearest),
        };
        error.insert(suggested, value);
    }
    error
}

/// The commands that may stand where `given` does on this command line: those of `history` behind it, else all.
fn commands_beside(given: &str) -> Vec<String> {
    let words: Vec<String> = std::env::args().collect();
    let before = words.iter().take_while(|word| *word != given).skip(1);
    let program = Cli::command();
    let parent = before.filter_map(|word| program.find_subcommand(word)).last();
    names(parent.unwrap_or(&program)).map(str::to_owned).collect()
}
