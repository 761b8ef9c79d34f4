//! What a history holds: runs in their order, and series of figures over them.

use std::collections::HashMap;

use anyhow::{Context, bail};
use itertools::Itertools;
use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;

use super::History;
use super::database::{Value, integer, other_type, stored_name, text};
use super::run::{FigureKey, NANOSECONDS, Name};
use super::store::{FIGURE_COLUMNS, RUN_COLUMNS, SERIES_COLUMNS};
use fathom_base::text::line;
use fathom_record::{Estimate, Interval};
use fathom_report::format::NS_PER_MS;

/// Digits of a commit or a run that people read.
const SHORT: usize = 10;
/// Up to so many series are asked for by their ids. More are sorted out here.
const MOST_ASKED: usize = 500;

/// A run without its records.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct StoredRun {
    /// In the database.
    id: i64,
    pub digest: String,
    pub commit: String,
    /// Of the commit, seconds of Unix time.
    pub committed_at: i64,
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
    /// Beginning of its commit's name.
    pub fn short_commit(&self) -> String {
        shortened(&self.commit)
    }

    pub fn short_digest(&self) -> String {
        shortened(&self.digest)
    }

    /// Day of the commit, UTC.
    pub fn day(&self) -> String {
        let moment = Timestamp::from_second(self.committed_at).unwrap_or_default();
        moment.to_zoned(TimeZone::UTC).date().to_string()
    }
}

fn shortened(name: &str) -> String {
    line(name).chars().take(SHORT).collect()
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

    /// The figure is searched for changes.
    fn is_asked(&self, figure: &FigureKey) -> bool {
        let filter = self.filter.as_deref().unwrap_or_default();
        !self.is_control(figure) && !figure.is_limit() && figure.name().contains(filter)
    }
}

impl SeriesKey {
    /// `CELL FIGURE`.
    pub fn name(&self) -> String {
        line(&self.figure.name())
    }

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
    pub fn shown(&self) -> f64 {
        if self.is_time() { 1.0 / NS_PER_MS } else { 1.0 }
    }
}

/// A figure over runs.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    pub key: SeriesKey,
    /// In the order of the runs.
    pub points: Vec<Point>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Place of its run in [`StoredRuns::runs`].
    pub run: usize,
    pub value: Estimate,
}

/// Runs in the order of their commits' dates, those of one commit as they started; and series over them.
#[derive(Clone, Debug, Default)]
pub struct StoredRuns {
    pub runs: Vec<StoredRun>,
    /// Sorted by key; none is empty.
    pub series: Vec<Series>,
    /// Figures that no commit changes.
    pub controls: Vec<Series>,
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

/// Machines and figures by the ids of their series.
type Keys = HashMap<i64, (Name, FigureKey)>;

impl History {
    /// The runs that a selection leaves, in their order.
    pub fn runs(&mut self, selection: &Selection) -> anyhow::Result<Vec<StoredRun>> {
        let statement =
            format!("SELECT {RUN_COLUMNS} FROM fathom_run ORDER BY committed_at, started_at, id");
        let rows = self.database.rows(&statement, Vec::new())?;
        let mut runs: Vec<StoredRun> = rows.iter().map(|row| of_row(row)).try_collect()?;
        if let Some(since) = &selection.since {
            let since = moment(since, &runs)?;
            runs.retain(|run| run.committed_at >= since);
        }
        if let Some(branch) = selection.branch.as_deref().map(stored_name) {
            runs.retain(|run| run.branch == branch);
        }
        Ok(runs)
    }

    /// Runs and series that a selection leaves.
    ///
    /// # Errors
    /// Where nothing is left.
    pub fn stored(&mut self, selection: &Selection) -> anyhow::Result<StoredRuns> {
        let runs = self.runs(selection)?;
        let keys = self.keys(selection)?;
        let values = self.values(&keys, &runs)?;
        let mut series = grouped(keys, values, &runs);
        series.sort_unstable_by(|a, b| a.key.cmp(&b.key));
        let (controls, series): (Vec<Series>, Vec<Series>) =
            series.into_iter().partition(|series| selection.is_control(&series.key.figure));
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

    /// Machines and figures by the ids of their series.
    fn keys(&mut self, selection: &Selection) -> anyhow::Result<Keys> {
        let statement = format!("SELECT id, {SERIES_COLUMNS} FROM fathom_series");
        let mut keys = HashMap::new();
        self.database.each(&statement, Vec::new(), &mut |row| {
            let names: Vec<Name> =
                row[1..].iter().map(|name| text(name).map(Name::from)).try_collect()?;
            let names: [Name; 9] = names.try_into().map_err(|_| other_type())?;
            let [machine, key @ ..] = names;
            let key = FigureKey::of_names(key);
            if selection.is_asked(&key) || selection.is_control(&key) {
                keys.insert(integer(&row[0])?, (machine, key));
            }
            Ok(())
        })?;
        Ok(keys)
    }

    /// Places of runs with their values, by series.
    fn values(
        &mut self,
        keys: &Keys,
        runs: &[StoredRun],
    ) -> anyhow::Result<HashMap<i64, Vec<Point>>> {
        let places: HashMap<i64, usize> =
            runs.iter().enumerate().map(|(at, run)| (run.id, at)).collect();
        let mut values: HashMap<i64, Vec<Point>> =
            keys.keys().map(|id| (*id, Vec::new())).collect();
        let mut statement = format!("SELECT {FIGURE_COLUMNS} FROM fathom_figure");
        let mut asked = Vec::new();
        if keys.len() <= MOST_ASKED && !keys.is_empty() {
            asked = keys.keys().map(|id| Value::Integer(*id)).collect_vec();
            let places = (1..=asked.len()).map(|place| format!("${place}")).join(", ");
            statement = format!("{statement} WHERE series IN ({places})");
        }
        self.database.each(&statement, asked, &mut |row| {
            let [Value::Integer(series), Value::Integer(run), value @ ..] = row.as_slice() else {
                return Err(other_type());
            };
            if let (Some(points), Some(run)) = (values.get_mut(series), places.get(run)) {
                points.push(Point { run: *run, value: estimate(value)? });
            }
            Ok(())
        })?;
        Ok(values)
    }
}

fn of_row(row: &[Value]) -> anyhow::Result<StoredRun> {
    let name = |column: usize| text(&row[column]).map(str::to_owned);
    Ok(StoredRun {
        id: integer(&row[0])?,
        digest: name(1)?,
        commit: name(2)?,
        committed_at: integer(&row[3])?,
        branch: name(4)?,
        machine: name(5)?,
        adapter: name(6)?,
        driver: name(7)?,
        started_at: name(8)?,
        cells: integer(&row[9])?,
        figures: integer(&row[10])?,
    })
}

fn estimate(row: &[Value]) -> anyhow::Result<Estimate> {
    let [Value::Real(median), low, high, Value::Integer(n)] = row else {
        return Err(other_type());
    };
    let interval = match (low, high) {
        (Value::Real(low), Value::Real(high)) => Some(Interval { low: *low, high: *high }),
        _ => None,
    };
    Ok(Estimate { median: *median, interval, n: (*n).try_into().unwrap_or(0) })
}

/// A series for each branch that has values of it.
fn grouped(keys: Keys, mut values: HashMap<i64, Vec<Point>>, runs: &[StoredRun]) -> Vec<Series> {
    let of_key = |(id, (machine, figure)): (i64, (Name, FigureKey))| {
        let mut points = values.remove(&id).unwrap_or_default();
        points.sort_unstable_by_key(|point| point.run);
        let branches =
            points.into_iter().into_group_map_by(|point| runs[point.run].branch.as_str());
        let series = branches.into_iter().map(move |(branch, points)| {
            let (branch, machine, figure) = (branch.to_owned(), machine.clone(), figure.clone());
            Series { key: SeriesKey { branch, machine, figure }, points }
        });
        series.collect_vec()
    };
    keys.into_iter().flat_map(of_key).collect()
}

/// Seconds of Unix time of a date (its beginning, UTC), a moment, or a commit of these runs.
fn moment(since: &str, runs: &[StoredRun]) -> anyhow::Result<i64> {
    let date = since.parse::<Date>().ok().filter(|_| !since.contains('T'));
    let date = date.and_then(|date| date.to_zoned(TimeZone::UTC).ok()).map(|day| day.timestamp());
    let moment = date.or_else(|| since.parse().ok()).map(Timestamp::as_second);
    let commit = || runs.iter().find(|run| run.commit.starts_with(since));
    let found = moment.or_else(|| commit().map(|run| run.committed_at));
    found.with_context(|| {
        let since = line(since);
        format!("`{since}` is neither a date such as 2026-01-31 nor a commit of this history")
    })
}
