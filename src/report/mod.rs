//! Reports: pure functions from records to bytes. The same records give the same bytes.
//!
//! A [`RunExporter`] turns a [`ReportView`] of a run's records into files.

pub mod bencher;
pub mod ceilings;
mod cells_csv;
mod chosen_frame;
mod chrome_trace;
pub mod colors;
pub mod facts;
pub mod format;
pub mod github_benchmark;
pub mod junit;
pub mod page;
mod plots;
mod summary;
mod timed;
mod trust;
mod view;

#[cfg(test)]
pub mod fixtures;

pub use bencher::EXPORTER as BENCHER;
pub use cells_csv::EXPORTER as CELLS_CSV;
pub use chosen_frame::{ChosenFrame, FrameChoice};
pub use chrome_trace::EXPORTER as CHROME_TRACE;
pub use github_benchmark::EXPORTER as GITHUB_BENCHMARK;
pub use junit::EXPORTER as JUNIT;
pub use page::EXPORTER as PAGE;
pub use plots::{EXPORTER as PLOTS, ROOFLINES};
pub use summary::{EXPORTER as SUMMARY, in_short};
pub use view::{Entry, LeftOut, ReportView, Section};

use crate::text;

#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    #[error("cannot draw the plot of `{experiment}`: {message}")]
    Plot { experiment: String, message: String },
    #[error("there is no cell with timed frames")]
    NoFrames,
    #[error("no timed cell `{}`{}", text::line(.name), text::did_you_mean(.nearest))]
    UnknownCell { name: String, nearest: Option<String> },
    #[error("cell `{cell}` has frames 0 to {last}, and no frame {frame}")]
    UnknownFrame { cell: String, frame: usize, last: usize },
}

/// A file of the report: its name within the output folder, and its bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    pub name: String,
    pub bytes: Vec<u8>,
}

/// A format of reports.
pub struct Exporter<F> {
    /// Its identifier on the command line, such as `csv`.
    pub name: &'static str,
    /// What the format is, in one line.
    pub about: &'static str,
    /// The name of its file. Where there are several, a word in capitals stands for the experiment or the pipeline.
    pub file: &'static str,
    pub written: Written,
    /// Makes what the files hold.
    pub export: F,
}

/// When a format is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, strum::Display)]
pub enum Written {
    #[strum(to_string = "with every report")]
    WithEveryReport,
    #[strum(to_string = "on request")]
    OnRequest,
}

/// A format of a run.
pub type RunExporter = Exporter<OfRun>;

/// What is made of a run.
pub enum OfRun {
    /// The text of one file.
    One(fn(&ReportView<'_>) -> Result<String, ReportError>),
    /// A file for each experiment or pipeline.
    Several(fn(&ReportView<'_>) -> Result<Vec<Artifact>, ReportError>),
    /// The text of one file about one frame.
    Frame(fn(&ChosenFrame<'_>) -> String),
}

/// What an exporter made.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Exported {
    One(Artifact),
    /// A file for each experiment or pipeline. however many there are.
    Several(Vec<Artifact>),
}

impl Exported {
    pub fn files(self) -> Vec<Artifact> {
        match self {
            Self::One(file) => vec![file],
            Self::Several(files) => files,
        }
    }
}

impl<F> Exporter<F> {
    /// Its only file with this text.
    pub fn one(&self, text: String) -> Exported {
        Exported::One(Artifact { name: self.file.to_owned(), bytes: text.into_bytes() })
    }
}

impl RunExporter {
    /// Its files. Only a format of one frame looks at `choice`.
    pub fn run(
        &self,
        view: &ReportView<'_>,
        choice: &FrameChoice,
    ) -> Result<Exported, ReportError> {
        Ok(match self.export {
            OfRun::One(export) => self.one(export(view)?),
            OfRun::Several(export) => Exported::Several(export(view)?),
            OfRun::Frame(export) => self.one(export(&view.frame(choice)?)),
        })
    }
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use std::time::Duration;

    use nix::time::{ClockId, clock_gettime};
    use serde_json::{Map, json};

    use crate::exporters::of_run as artifacts;
    use crate::record::{Cell, Definition, Outcome, Params, Record};

    /// Quadratic work grows 16-fold from n to 4 n, linear work 4-fold.
    const MOST_GROWTH: f64 = 8.0;
    const CELLS: usize = 8_000;

    const ALONG: &str = r#"
        id = "own"
        title = "Own"
        source = "none"
        pipeline = "underwater"
        scene = "tank"
        [[sweep]]
        [[sweep.axis]]
        name = "caustics.grid"
        values = VALUES
        [[plot]]
        title = "Frames"
        kind = "bars"
        over = "caustics.grid"
        y = ["frame"]
        [[claim]]
        id = "rising"
        text = "It rises"
        test.monotone = { y = "frame", x = "axis:caustics.grid", over = "caustics.grid", direction = "rising" }
    "#;

    fn cell(experiment: &str, number: usize) -> Record {
        let mut axes = Map::new();
        axes.insert("caustics.grid".to_owned(), json!(number));
        Record::Cell(Box::new(Cell {
            experiment: experiment.to_owned(),
            cell: format!("caustics.grid={number}"),
            axes,
            pipeline: "underwater".to_owned(),
            scene: "tank".to_owned(),
            stand_ins: vec![format!("note {number}")],
            params: Params::default(),
            outcome: Outcome::Skipped { reason: "too large".to_owned() },
        }))
    }

    /// Cells of one experiment that the records do not define, from the last to the first.
    fn undefined(count: usize) -> Vec<Record> {
        (0..count).rev().map(|number| cell("own", number)).collect()
    }

    /// The same with the definition.
    fn defined(count: usize) -> Vec<Record> {
        let values: Vec<usize> = (0..count).collect();
        let toml = ALONG.replace("VALUES", &format!("{values:?}"));
        let id = "own".to_owned();
        let definition = Record::Experiment(Definition { id, toml });
        std::iter::once(definition).chain(undefined(count)).collect()
    }

    /// A cell for each of many experiments.
    fn scattered(count: usize) -> Vec<Record> {
        let cells = 0..count;
        cells.map(|number| cell(&format!("own-{number}"), number)).collect()
    }

    fn cpu_time() -> Duration {
        Duration::from(clock_gettime(ClockId::CLOCK_THREAD_CPUTIME_ID).unwrap())
    }

    /// The least of three, seconds.
    fn time_of(records: &[Record]) -> f64 {
        let times = (0..3).map(|_| {
            let start = cpu_time();
            artifacts(records, None).unwrap();
            (cpu_time() - start).as_secs_f64()
        });
        times.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn the_definition_is_one() {
        let files = artifacts(&defined(3), None).unwrap();
        let summary = files.last().unwrap();
        let text = String::from_utf8(summary.bytes.clone()).unwrap();
        assert!(text.contains("| It rises |"), "{text}");
    }

    #[test]
    fn the_time_of_a_report_grows_with_its_cells() {
        type Shape = fn(usize) -> Vec<Record>;
        let shapes: [(&str, Shape); 3] =
            [("undefined", undefined), ("defined", defined), ("scattered", scattered)];
        for (name, shape) in shapes {
            let [few, many] = [CELLS, 4 * CELLS].map(|count| time_of(&shape(count)));
            assert!(many < MOST_GROWTH * few, "{name}: {few} s, then {many} s");
        }
    }
}
