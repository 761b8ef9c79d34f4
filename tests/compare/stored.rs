//! A stored comparison under construction.

use std::collections::BTreeMap;
use std::path::Path;

use fathom::compare::store;
use fathom::harness::output::{FolderKind, LockedFolder};
use fathom::record::ErrorFigure;
use fathom::record::comparison::{
    CellId, ChangedStage, CheckFigure, Compared, ComparedBuild, ComparisonEnd, ComparisonHeader,
    ConfigurationFigures, Differs, ExactFigures, Fault, Gate, GateSettings, InstructionCounts,
    Launch, Pair, Side,
};
use fathom::record::protocol::CheckReading;
use fathom::record::{Adapter, Work};
use itertools::Itertools;

pub const LAUNCHES: u32 = 10;
pub const PAIRS: u32 = 2;
pub const BASE_NS: f64 = 2e6;
pub const BYTES: u64 = 1_000_000;
/// Cells of most of the comparisons.
pub const TRACE: &str = "tank caustics/trace";
pub const COMPOSE: &str = "tank compose";

pub fn cell(name: &str) -> CellId {
    let (configuration, stage) = name.split_once(' ').unwrap();
    CellId::new(configuration, stage)
}

pub fn build(label: &str) -> ComparedBuild {
    ComparedBuild {
        label: label.to_owned(),
        version: "0.1.0".to_owned(),
        protocol: 1,
        digest: format!("digest of {label}"),
        ..Default::default()
    }
}

pub fn pair(launch: u32, round: u32, name: &str, ratio: f64) -> Pair {
    Pair {
        launch,
        round,
        cell: cell(name),
        control: false,
        second: false,
        first: if round.is_multiple_of(2) { Side::Base } else { Side::Head },
        base_ns: BASE_NS,
        head_ns: BASE_NS * ratio,
        machine: Default::default(),
    }
}

/// A stored comparison under construction.
#[derive(Clone)]
pub struct Stored {
    pub header: ComparisonHeader,
    pub lines: Vec<Compared>,
    /// How measuring ended: interrupted or not; none if it was killed.
    pub interrupted: Option<bool>,
}

impl Stored {
    pub fn new(cells: &[&str]) -> Self {
        let header = ComparisonHeader {
            base: build("origin/main"),
            head: build("target/release/fathom"),
            adapter: Adapter {
                name: "llvmpipe (LLVM 15.0.6, 256 bits)".to_owned(),
                driver_info: "Mesa 22.3.6".to_owned(),
                software: true,
                ..Adapter::default()
            },
            settings: GateSettings { launches: LAUNCHES, pairs: PAIRS, ..GateSettings::default() },
            cells: cells.iter().map(|name| cell(name)).collect(),
            ..ComparisonHeader::default()
        };
        let launch = |launch| Launch { launch, wall_s: 3.5, core: Some(0), ..Launch::default() };
        let lines = (0..LAUNCHES).map(|number| Compared::Launch(launch(number))).collect();
        Self { header, lines, interrupted: Some(false) }
            .configuration(BYTES, 0.01)
            .times(cells[0], true, 1.0, 0.004)
    }

    pub fn both<T>(mut self, base: T, head: T, line: impl Fn(Side, T) -> Compared) -> Self {
        self.lines.extend([line(Side::Base, base), line(Side::Head, head)]);
        self
    }

    pub fn without(mut self, line: impl Fn(&Compared) -> bool) -> Self {
        self.lines.retain(|kept| !line(kept));
        self
    }

    pub fn configuration(self, head_bytes: u64, head_error: f64) -> Self {
        let rest = self.without(|line| matches!(line, Compared::Configuration(_)));
        rest.both((BYTES, 0.01), (head_bytes, head_error), |side, (allocated_bytes, error)| {
            let name = "caustics_photon_error_median_m";
            Compared::Configuration(ConfigurationFigures {
                side,
                configuration: "tank".to_owned(),
                allocated_bytes,
                errors: BTreeMap::from([(name.to_owned(), error)]),
                judged: vec![ErrorFigure::new(name, error, "m", "caustics/trace")],
                quantities: BTreeMap::new(),
                notes: Vec::new(),
            })
        })
    }

    /// Pairs whose ratio is `ratio` up to `spread` between launches, which lies evenly about it.
    pub fn times(mut self, name: &str, control: bool, ratio: f64, spread: f64) -> Self {
        self.lines.extend((0..LAUNCHES).cartesian_product(0..PAIRS).map(|(launch, round)| {
            let place = f64::from(launch) / f64::from(LAUNCHES - 1) - 0.5;
            let ratio = ratio * (1.0 + 2.0 * spread * place);
            Compared::Pair(Pair { control, ..pair(launch, round, name, ratio) })
        }));
        self
    }

    pub fn counts(self, name: &str, ratio: f64) -> Self {
        self.both(1.0, ratio, |side, ratio| {
            let counts = [10_000_000.0, 10_000_100.0, 10_000_200.0];
            let counts = counts.map(|count| (count * ratio) as u64).to_vec();
            Compared::Instructions(InstructionCounts {
                side,
                cell: cell(name),
                counts,
                second: false,
            })
        })
    }

    pub fn work(self, name: &str, base: u64, head: u64) -> Self {
        self.both(base, head, |side, photons| {
            Compared::Exact(ExactFigures {
                side,
                cell: cell(name),
                work: Work { photons, ..Work::default() },
                counters: BTreeMap::from([("compute_shader_invocations".to_owned(), 2 * photons)]),
            })
        })
    }

    pub fn check(self, (stage, what): (&str, &str), base: f64, head: f64) -> Self {
        self.both(base, head, |side, measured| {
            let check = CheckReading {
                stage: stage.to_owned(),
                what: what.to_owned(),
                unit: "1".to_owned(),
                measured,
                tolerance: 0.1,
                sound: measured <= 0.1,
            };
            Compared::Check(CheckFigure { side, check })
        })
    }

    /// A cell in which nothing is counted to change.
    pub fn counted(self, name: &str) -> Self {
        self.work(name, 100, 100).counts(name, 1.0)
    }

    /// What it asks of the GPU differs so.
    pub fn changed(mut self, name: &str, differs: Differs, diff: &str) -> Self {
        let (cell, diff) = (cell(name), diff.to_owned());
        self.lines.push(Compared::Changed(ChangedStage { cell, differs, diff }));
        self
    }

    pub fn same(self, name: &str) -> Self {
        self.counted(name).times(name, false, 1.001, 0.004)
    }

    pub fn fault(mut self, gate: Gate, side: Side, name: Option<&str>, absent: bool) -> Self {
        let reason =
            if absent { "unknown pipeline `new`" } else { "it ended with signal: 11 (SIGSEGV)" };
        let fault = Fault::new(gate, Some(side), name.map(cell), reason);
        let launch = (gate == Gate::Time).then_some(3);
        self.lines.push(Compared::Fault(Fault { launch, absent, ..fault }));
        self
    }

    pub fn time_fault(mut self, name: Option<&str>, launch: u32) -> Self {
        self = self.fault(Gate::Time, Side::Base, name, false);
        if let Some(Compared::Fault(fault)) = self.lines.last_mut() {
            (fault.control, fault.launch) = (name.is_some(), Some(launch));
        }
        self
    }

    pub fn gates(mut self, gates: &[Gate]) -> Self {
        self.header.settings.gates = gates.to_vec();
        self
    }

    pub fn lines(self) -> Vec<Compared> {
        let end = |interrupted| Compared::End(ComparisonEnd { wall_s: 61.5, interrupted });
        let header = Compared::Header(Box::new(self.header));
        std::iter::once(header).chain(self.lines).chain(self.interrupted.map(end)).collect()
    }

    pub fn write(self, folder: &Path) {
        let mut held =
            LockedFolder::lock_free(folder).unwrap().open(FolderKind::Comparison).unwrap();
        store::write(&mut held, self.lines()).unwrap();
    }
}
