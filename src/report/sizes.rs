//! A sweep over sizes: the time of each stage at each value, with the error of its result; how it grows; and where it becomes costly.
//! For experiments that set `knee_share`. The terminal, the summary and the page write these parts.

use itertools::Itertools;
use maud::Markup;

use super::charts::{self, names};
use super::document::{Block, ColumnKind, Field, Line, Span, Table};
use super::facts::grown_exponent;
use super::format::{self, percent, si, three};
use super::{Report, Section};
use fathom_experiments::words;
use fathom_experiments::{Experiment, Measure, Quantity, groups, label_text, scaling};
use fathom_judge::knees::{Knee, KneeBracket, ShareAt, change_of_exponent, crossing};
use fathom_record::{Cell, ErrorFigure, Measured, PictureKind, StageRecord};

/// Stages that stay below this share of the frame at every size stand in one row, and in no plot.
pub const SMALL_SHARE: f64 = 0.05;
/// Sizes that an exponent takes.
const MIN_SIZES: usize = 3;

/// A cell's picture of this kind as a page shows it.
pub type DrawPicture<'d> = &'d dyn Fn(&Cell, PictureKind) -> Option<Markup>;

/// What each sweep of a run says; empty where it has none. Pictures are of a page alone.
pub fn parts(view: &Report<'_>, picture: DrawPicture<'_>) -> Vec<Block> {
    let mut parts = Vec::new();
    for section in &view.sections {
        let Some(experiment) = &section.experiment else { continue };
        let Some(share) = experiment.knee_share else { continue };
        let first = parts.len();
        for (place, axis) in experiment.axis_names().into_iter().enumerate() {
            for (group, cells) in groups(&section.cells(), axis) {
                let sizes = Sizes { section, experiment, axis, group, share, cells };
                if sizes.columns().next().is_some() {
                    parts.extend((place == 0).then(|| sizes.times(picture)).into_iter().flatten());
                    let is_grown = place == 0 || sizes.columns().count() >= MIN_SIZES;
                    parts.extend(is_grown.then(|| sizes.growth()).into_iter().flatten());
                }
            }
        }
        if parts.len() > first {
            let about = experiment.about.trim_end_matches('.');
            let common = charts::common(section);
            let words = [section.title(), about, &common].into_iter();
            let words = words.filter(|part| !part.is_empty()).join(" · ");
            let chart = section.figure().svg.clone().map(Block::Chart);
            parts.splice(first..first, [Block::paragraph(words)].into_iter().chain(chart));
        }
    }
    parts
}

/// The cells along one axis that have the same values on the other.
struct Sizes<'v> {
    section: &'v Section<'v>,
    experiment: &'v Experiment,
    axis: &'v str,
    /// What the cells have in common; empty where there is one axis.
    group: String,
    share: f64,
    cells: Vec<&'v Cell>,
}

impl<'v> Sizes<'v> {
    fn columns(&self) -> impl Iterator<Item = (&'v Cell, &'v Measured)> + use<'v, '_> {
        let measured = self.cells.iter().filter_map(|cell| Some((*cell, cell.measured()?)));
        measured.filter(|(_, measured)| measured.is_timed())
    }

    fn title(&self, what: &str) -> Block {
        let axis = names::axis(self.axis, self.experiment);
        let group = if self.group.is_empty() { String::new() } else { format!(", {}", self.group) };
        Block::Heading(format!("{}: {what} over {axis}{group}", self.section.id).into())
    }

    /// In frame order, of all sizes.
    fn stages(&self) -> Vec<&'v str> {
        let stages = self.columns().flat_map(|(_, measured)| &measured.stages);
        stages.map(|stage| stage.stage.as_str()).unique().collect()
    }

    fn is_small(&self, stage: &str) -> bool {
        self.columns().all(|(_, measured)| is_small(measured, stage))
    }

    /// Stages by sizes, each with its interval, below a stage the errors of its result, and what the frame takes and shows.
    fn times(&self, picture: DrawPicture<'_>) -> Vec<Block> {
        let values =
            self.columns().map(|(cell, _)| label_text(&cell.axes[self.axis])).collect_vec();
        let titles = std::iter::once("Stage (ms)".to_owned()).chain(values.iter().cloned());
        let (small, large): (Vec<&str>, Vec<&str>) =
            self.stages().into_iter().partition(|stage| self.is_small(stage));
        let mut rows: Vec<Vec<String>> = Vec::new();
        for stage in large {
            rows.push(
                self.row(stage, |measured| Some(format::stage_ms(find_stage(measured, stage)?))),
            );
            rows.extend(self.errors(stage));
        }
        if !small.is_empty() {
            rows.push(self.row(&format!("{} other stages", small.len()), |measured| {
                let times =
                    small.iter().filter_map(|stage| Some(find_stage(measured, stage)?.time.median));
                Some(three(times.sum::<f64>() / format::NS_PER_MS))
            }));
            rows.extend(small.iter().flat_map(|stage| self.errors(stage)));
        }
        rows.push(self.row("whole frame", |measured| Some(format::ms(&measured.frame.untimed))));
        rows.push(self.row("GPU memory", |of| Some(format::mebibytes(of.allocated_bytes))));
        let numbers = values.iter().map(String::as_str).collect_vec();
        let table = Table::new("Stage times", titles).with(ColumnKind::Numbers, &numbers);
        let pictures = [("picture", PictureKind::Image), ("its error", PictureKind::Error)];
        let pictures = pictures.map(|(name, kind)| {
            let drawn = self
                .columns()
                .map(|(cell, _)| Line(picture(cell, kind).map(Span::Drawn).into_iter().collect()));
            let row = std::iter::once(Line::from(name)).chain(drawn).collect_vec();
            row.iter()
                .any(|of| of.0.iter().any(|span| matches!(span, Span::Drawn(_))))
                .then_some(row)
        });
        let left = self.cells.iter().filter(|cell| cell.measured().is_none());
        let left = left.map(|cell| format!("{}: {}", cell.cell, cell.outcome.words().join(": ")));
        let left = left.map(Block::paragraph).collect_vec();
        let table = table.with_rows(rows).with_rows(pictures.into_iter().flatten());
        [self.title("times"), Block::Table(table)].into_iter().chain(left).collect()
    }

    fn row(&self, name: &str, figure: impl Fn(&Measured) -> Option<String>) -> Vec<String> {
        let fields = self.columns().map(|(_, measured)| figure(measured));
        let fields = fields.map(|field| field.unwrap_or_else(|| "–".to_owned()));
        std::iter::once(name.to_owned()).chain(fields).collect()
    }

    fn errors(&self, stage: &str) -> Vec<Vec<String>> {
        let errors = self.columns().flat_map(|(_, measured)| &measured.errors);
        let names = errors.filter(|error| error.stage == stage).map(|error| error.name.as_str());
        let row = |name: &str| {
            let label = words::figure(name);
            let value = |error: &ErrorFigure| three(error.value * label.unit.factor());
            let named = |error: &&ErrorFigure| error.name == name;
            self.row(&format!("↳ {}", label.text()), |measured| {
                measured.errors.iter().find(named).map(value)
            })
        };
        names.unique().map(row).collect()
    }

    /// Of each stage that is not small: its exponent, and where it becomes costly and changes its growth.
    fn growth(&self) -> Vec<Block> {
        let title = self.title("growth");
        if self.experiment.is_category(self.axis) {
            let words = "Its values are names: no exponents and no knees.";
            return vec![title, Block::paragraph(words)];
        }
        let share = percent(self.share).replace(".0 %", " %");
        let costly = format!("More than {share} of the frame");
        let columns = ["Stage", "Exponent (interval)", &costly, "Exponent changes"];
        let stages = self.stages().into_iter().filter(|stage| !self.is_small(stage));
        let mut rows = stages.map(|stage| self.stage_growth(stage)).collect_vec();
        let frame = Measure::frame();
        let [exponent, change] = self.exponent_and_change(&frame);
        rows.push(["whole frame".into(), exponent, "–".into(), change]);
        let rows = rows.into_iter().map(|row| row.map(Field::from));
        vec![title, Block::Table(Table::new("Growth", columns).with_rows(rows))]
    }

    fn stage_growth(&self, stage: &str) -> [Line; 4] {
        let points = self.columns().filter_map(|(cell, measured)| {
            let [min, max] = shares(measured, find_stage(measured, stage)?);
            Some(ShareAt { size: self.size(cell, measured)?, min, max })
        });
        let points = points.sorted_by(|a, b| a.size.total_cmp(&b.size)).collect_vec();
        let knee = crossing(&points, self.share);
        let costly = match &knee {
            Knee::Seen(seen) if seen.before > seen.after => format!("up to {}", place(seen)),
            Knee::Seen(seen) => format!("from {}", place(seen)),
            Knee::NotSeen => {
                let first = points.first().map_or(0.0, |point| point.min.median());
                let side = if first > self.share { "more" } else { "less" };
                format!("not seen in this range: {side} at every size")
            }
            Knee::NotSettled(reason) => format!("not settled: {reason}"),
        };
        let measure = format!("stage:{stage}").parse::<Measure>();
        let grown = measure.map(|measure| self.exponent_and_change(&measure));
        let [exponent, change] = grown.unwrap_or_else(|reason| [reason.into(), "–".into()]);
        [stage.into(), exponent, costly.into(), change]
    }

    fn exponent_and_change(&self, y: &Measure) -> [Line; 2] {
        let points = self.columns().filter_map(|(cell, measured)| {
            Some((self.size(cell, measured)?, y.read(cell, measured)?))
        });
        let points = points.sorted_by(|a, b| a.0.total_cmp(&b.0)).collect_vec();
        let (sizes, below) = (self.columns().count(), self.columns().count() - points.len());
        let x = format!("axis:{}", self.axis).parse::<Measure>();
        let min_time = points.iter().map(|(_, y)| y.median()).fold(f64::INFINITY, f64::min);
        // Over all sizes: claims leave those out of which the fixed part is much.
        let fitted = match x.and_then(|x| scaling(y, &x, &self.cells, f64::INFINITY)) {
            Ok(fit) => grown_exponent(&fit, min_time),
            Err(_) if below > 0 => {
                format!("– below the clock's resolution at {below} of {sizes} sizes")
            }
            Err(reason) => format!("– {reason}"),
        };
        let change = match change_of_exponent(points) {
            Knee::Seen(seen) => {
                format!("at {}: {:.1} to {:.1}", place(&seen), seen.before, seen.after)
            }
            Knee::NotSeen => "not seen in this range".to_owned(),
            Knee::NotSettled(reason) => format!("not settled: {reason}"),
        };
        [fitted.into(), change.into()]
    }

    fn size(&self, cell: &Cell, measured: &Measured) -> Option<f64> {
        let x = format!("axis:{}", self.axis).parse::<Measure>().ok()?;
        Some(x.read(cell, measured)?.median()).filter(|x| *x > 0.0)
    }
}

fn find_stage<'m>(measured: &'m Measured, stage: &str) -> Option<&'m StageRecord> {
    measured.stages.iter().find(|one| one.stage == stage)
}

/// A stage has less than [`SMALL_SHARE`] of this frame, or does not run in it.
pub fn is_small(measured: &Measured, stage: &str) -> bool {
    let stage = find_stage(measured, stage);
    stage.is_none_or(|stage| shares(measured, stage)[1].median() < SMALL_SHARE)
}

/// A stage's share of the sum of all, frame by frame, at least and at most.
fn shares(measured: &Measured, stage: &StageRecord) -> [Quantity; 2] {
    let frames = measured.stages.iter().map(|of| of.samples_ns.len()).min().unwrap_or(0);
    let share = |frame: usize| {
        let sum = |are_bounds_counted: bool| {
            let stages = measured.stages.iter();
            let stages = stages.filter(|of| are_bounds_counted || of.is_resolved());
            stages.map(|of| of.samples_ns[frame]).sum::<f64>()
        };
        let own = stage.samples_ns[frame];
        let is_bound = !stage.is_resolved();
        let max = own / (sum(false) + if is_bound { own } else { 0.0 });
        (if is_bound { 0.0 } else { own / sum(true) }, max)
    };
    let (min, max): (Vec<f64>, Vec<f64>) = (0..frames).map(share).unzip();
    [min, max].map(|shares| Quantity::from_frames(&measured.frame, &shares))
}

/// `181 (128 – 256)`
fn place(knee: &KneeBracket) -> String {
    let KneeBracket { at, between, .. } = knee;
    format!("{} ({} – {})", si(*at), si(between.low), si(between.high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::document::terminal;
    use fathom_experiments::fixtures;
    use fathom_record::Record;

    /// The terminal and the page have the same rows; what cannot be fitted says why.
    #[test]
    fn a_sweep_has_times_errors_and_growth() {
        let mut records = fixtures::run();
        for record in &mut records {
            if let Record::Experiment(of) = record {
                of.toml = format!("knee_share = 0.1\n{}", of.toml);
            }
        }
        let text = terminal(&parts(&Report::new(&records, None), &|_, _| None));
        let page = crate::PAGE.run(&Report::new(&records, None)).files().remove(0);
        let page = String::from_utf8(page.bytes).unwrap();
        for words in [
            "uw-photons: times over ",
            "uw-photons: growth over ",
            "More than 10 % of the frame",
            " ms fixed",
            "too few sizes with a time: 2 of 3",
            "Its values are names",
        ] {
            assert!(text.contains(words) && page.contains(words), "{words}: {text}");
        }
        assert!(!text.contains("NaN"), "{text}");
        assert!(parts(&crate::testing::view(), &|_, _| None).is_empty());
    }
}
