//! What a history holds: runs in their order, and series of figures over them.

use std::collections::HashMap;

use anyhow::{Context, bail};
use itertools::Itertools;
use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use rusqlite::Row;

use super::History;
use super::origin::{DIRTY, places};
use super::run::{FigureKey, NANOSECONDS, Name, shorten};
use super::store::{RUN_COLUMNS, SERIES_COLUMNS};
use fathom_base::text::{line, sort_key};
use fathom_record::{Estimate, Interval};
use fathom_report::format::NS_PER_MS;

/// A run without its records.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredRun {
    /// In the database.
    id: i64,
    pub digest: String,
    pub commit: String,
    /// Of the commit, seconds of Unix time.
    pub committed_at: i64,
    /// Of the commit among those that the repository here has.
    pub place: Option<(i64, usize)>,
    pub branch: String,
    pub machine: String,
    pub adapter: String,
    pub driver: String,
    /// RFC 3339, UTC.
    pub started_at: String,
    pub cells: i64,
    pub figures: i64,
}

impl StoredRun {
    /// Beginning of its commit's name, and whether files differed from it.
    pub fn short_commit(&self) -> String {
        shorten(&self.commit) + if self.commit.ends_with(DIRTY) { DIRTY } else { "" }
    }

    fn order(&self) -> (i64, usize) {
        self.place.unwrap_or((self.committed_at, 0))
    }

    pub fn short_digest(&self) -> String {
        shorten(&self.digest)
    }

    /// Day of the commit, UTC.
    pub fn day(&self) -> String {
        let moment = Timestamp::from_second(self.committed_at).unwrap_or_default();
        moment.to_zoned(TimeZone::UTC).date().to_string()
    }
}

/// What makes values comparable.
#[derive(Clone, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SeriesKey {
    pub branch: String,
    pub machine: Name,
    pub figure: FigureKey,
}

impl Selection {
    /// The figure is asked for as a control.
    fn is_control(&self, figure: &FigureKey) -> bool {
        match &self.control {
            None => figure.is_limit(),
            Some(part) => &*figure.unit == NANOSECONDS && figure.name().contains(part),
        }
    }

    fn is_searched(&self, figure: &FigureKey) -> bool {
        let filter = self.filter.as_deref().unwrap_or_default();
        !self.is_control(figure) && !figure.is_limit() && figure.name().contains(filter)
    }
}

impl SeriesKey {
    /// Branch, machine, adapter, driver and profile in words.
    pub fn place(&self) -> String {
        let Self { branch, machine, figure } = self;
        let FigureKey { adapter, driver, profile, .. } = figure;
        line(&format!("{branch} on {machine}: {adapter}, {driver}; {profile}"))
    }

    pub fn is_time(&self) -> bool {
        *self.figure.unit == *NANOSECONDS
    }

    /// What turns a value into the unit that people read.
    pub fn display_scale(&self) -> f64 {
        if self.is_time() { 1.0 / NS_PER_MS } else { 1.0 }
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct FigureSeries {
    pub key: SeriesKey,
    /// In the order of the runs.
    pub points: Vec<RunValue>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunValue {
    /// Place of its run in [`StoredRuns::runs`].
    pub run: usize,
    pub value: Estimate,
}

/// Runs in the order of their commits, those of one commit as they started; and series over them.
#[derive(Clone, Debug, Default)]
pub struct StoredRuns {
    pub runs: Vec<StoredRun>,
    /// Sorted by key, sizes in names of cells as numbers; none is empty.
    pub series: Vec<FigureSeries>,
    /// Figures that no commit changes.
    pub controls: Vec<FigureSeries>,
}

/// Which part of a history.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Selection {
    /// Only runs of this branch [default: all, each as series of its own]
    #[arg(long, value_name = "NAME")]
    pub branch: Option<String>,
    /// Only runs of commits from here on: a date such as 2026-01-31, or a commit of the history
    #[arg(long, value_name = "DATE|COMMIT")]
    pub since: Option<String>,
    /// Times whose names contain this are controls: no commit changes them, and what they do is the machine's drift [default: the
    /// adapter's limits]
    #[arg(long, value_name = "FILTER")]
    pub control: Option<String>,
    /// Part of `CELL FIGURE`.
    #[arg(skip)]
    pub filter: Option<String>,
}

impl History {
    /// The runs that a selection leaves, in their order.
    pub fn runs(&self, selection: &Selection) -> anyhow::Result<Vec<StoredRun>> {
        let statement =
            format!("SELECT {RUN_COLUMNS} FROM fathom_run ORDER BY committed_at, started_at, id");
        let mut statement = self.connection.prepare(&statement)?;
        let mut runs: Vec<StoredRun> = statement.query_map([], from_row)?.try_collect()?;
        let commit = |run: &StoredRun| run.commit.trim_end_matches(DIRTY).to_owned();
        let places = places(runs.iter().map(commit).unique().collect());
        runs.iter_mut().for_each(|run| run.place = places.get(&commit(run)).copied());
        runs.sort_by_key(StoredRun::order);
        if let Some(since) = &selection.since {
            let since = first(since, &runs)?;
            runs.retain(|run| run.order() >= since);
        }
        if let Some(branch) = &selection.branch {
            runs.retain(|run| run.branch == *branch);
        }
        Ok(runs)
    }

    /// Runs and series that a selection leaves.
    ///
    /// # Errors
    /// Where nothing is left.
    pub fn load(&self, selection: &Selection) -> anyhow::Result<StoredRuns> {
        let runs = self.runs(selection)?;
        let places: HashMap<i64, usize> =
            runs.iter().enumerate().map(|(at, run)| (run.id, at)).collect();
        let mut all = Vec::new();
        for (id, machine, figure) in self.keys(selection)? {
            let values = self.values(id)?.into_iter();
            let points =
                values.filter_map(|(run, value)| Some(RunValue { run: *places.get(&run)?, value }));
            let branches = points
                .sorted_unstable_by_key(|point| point.run)
                .into_group_map_by(|point| runs[point.run].branch.clone());
            all.extend(branches.into_iter().map(|(branch, points)| {
                let (machine, figure) = (machine.clone(), figure.clone());
                FigureSeries { key: SeriesKey { branch, machine, figure }, points }
            }));
        }
        all.sort_by_cached_key(|series| {
            let mut key = series.key.clone();
            key.figure.cell = sort_key(&key.figure.cell).into();
            key
        });
        let (controls, series): (Vec<FigureSeries>, Vec<FigureSeries>) =
            all.into_iter().partition(|series| selection.is_control(&series.key.figure));
        if let Some(control) = selection.control.as_ref().filter(|_| controls.is_empty()) {
            bail!("no time in this history is a control `{}`", line(control));
        }
        if series.is_empty() {
            let filter = selection.filter.iter().map(|filter| format!(" `{filter}`"));
            let branch = selection.branch.iter().map(|branch| format!(" on branch `{branch}`"));
            let since = selection.since.iter().map(|since| format!(" since {since}"));
            let what: String = filter.chain(branch).chain(since).collect();
            bail!("nothing in this history fits{}", line(&what));
        }
        Ok(StoredRuns { runs, series, controls })
    }

    /// Ids of series, with their machines and figures.
    fn keys(&self, selection: &Selection) -> anyhow::Result<Vec<(i64, Name, FigureKey)>> {
        let statement = format!("SELECT id, {SERIES_COLUMNS} FROM fathom_series");
        let mut statement = self.connection.prepare(&statement)?;
        let of_row = |row: &Row<'_>| {
            let name = |column: usize| Ok(Name::from(row.get::<_, String>(column)?));
            let names: Vec<Name> = (1..=9).map(name).collect::<rusqlite::Result<_>>()?;
            let names: [Name; 9] = names.try_into().map_err(|_| rusqlite::Error::InvalidQuery)?;
            let [machine, key @ ..] = names;
            Ok((row.get(0)?, machine, FigureKey::from_names(key)))
        };
        let keys = statement
            .query_map([], of_row)?
            .filter_ok(|(.., key)| selection.is_searched(key) || selection.is_control(key));
        Ok(keys.try_collect()?)
    }

    /// Ids of runs with their values in a series.
    fn values(&self, series: i64) -> anyhow::Result<Vec<(i64, Estimate)>> {
        let statement = "SELECT run, median, low, high, n FROM fathom_figure WHERE series = ?";
        let mut statement = self.connection.prepare_cached(statement)?;
        let of_row = |row: &Row<'_>| {
            let ends: (Option<f64>, Option<f64>) = (row.get(2)?, row.get(3)?);
            let interval = ends.0.zip(ends.1).map(|(low, high)| Interval { low, high });
            let n = row.get::<_, u32>(4)? as usize;
            Ok((row.get(0)?, Estimate { median: row.get(1)?, interval, n }))
        };
        Ok(statement.query_map([series], of_row)?.try_collect()?)
    }
}

/// Of the columns [`RUN_COLUMNS`].
fn from_row(row: &Row<'_>) -> rusqlite::Result<StoredRun> {
    Ok(StoredRun {
        id: row.get(0)?,
        digest: row.get(1)?,
        commit: row.get(2)?,
        committed_at: row.get(3)?,
        place: None,
        branch: row.get(4)?,
        machine: row.get(5)?,
        adapter: row.get(6)?,
        driver: row.get(7)?,
        started_at: row.get(8)?,
        cells: row.get(9)?,
        figures: row.get(10)?,
    })
}

/// Where a date (its beginning, UTC), a moment, or a commit of these runs stands.
fn first(since: &str, runs: &[StoredRun]) -> anyhow::Result<(i64, usize)> {
    let date = since.parse::<Date>().ok().filter(|_| !since.contains('T'));
    let date = date.and_then(|date| date.to_zoned(TimeZone::UTC).ok()).map(|day| day.timestamp());
    let moment = date.or_else(|| since.parse().ok()).map(|moment| (moment.as_second(), 0));
    let commit = || runs.iter().find(|run| run.commit.starts_with(since));
    moment.or_else(|| commit().map(StoredRun::order)).with_context(|| {
        let since = line(since);
        format!("`{since}` is neither a date such as 2026-01-31 nor a commit of this history")
    })
}
