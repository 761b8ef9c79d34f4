//! A roofline per pipeline: what its stages attained, below the adapter's measured limits. Williams, Waterman & Patterson, *Roofline:
//! An Insightful Visual Performance Model for Multicore Architectures*, CACM 52 (2009).

use itertools::Itertools;
use plotters::prelude::*;

use super::chart::mesh;
use super::{Area, Drawn, drawing, style};
use crate::axis::{Scale, ScaleKind};
use crate::ceilings::{RoofPoint, Roofline, rooflines};
use crate::colors::StageColors;
use crate::{Artifact, Exporter, OfRun, ReportView, RunExporter, Written, format};
use fathom_base::text;
use fathom_record::ceilings::{Bounded, Ceiling};

pub const EXPORTER: RunExporter = Exporter {
    name: "rooflines",
    about: "what stages attain below the adapter's limits, SVG",
    file: "roofline-PIPELINE.svg",
    written: Written::WithEveryReport,
    export: OfRun::Several(export),
};

const HEIGHT_PX: u32 = 620;
const TITLE_PX: u32 = 64;
const NOTES_PX: u32 = 76;
/// Characters of 12-px type in a line.
const NOTE_CHARACTERS: usize = 130;
const LINE_PX: i32 = 17;
/// Boxes of labels: room beside a line, and its height.
const LABEL_PX: (i32, i32) = (6, 16);
/// Between the places of a line that labels must not cover.
const LINE_STEP_PX: i32 = 4;

/// Name of the roofline's file.
pub fn file_name(pipeline: &str) -> String {
    format!("roofline-{}.svg", text::file_stem(pipeline))
}

pub fn export(view: &ReportView<'_>) -> Vec<Artifact> {
    let adapter = view.run().map_or_else(String::new, |run| run.adapter.title());
    let files = rooflines(view).into_iter().filter_map(|(pipeline, roofline)| {
        let svg = Chart::new(&roofline)?.svg(pipeline, &adapter, &view.colors);
        Some(Artifact::of(file_name(pipeline), svg))
    });
    files.collect()
}

struct Chart<'r> {
    roofline: &'r Roofline<'r>,
    x: Scale,
    y: Scale,
}

impl<'r> Chart<'r> {
    /// None where nothing can be shown on logarithmic axes.
    fn new(roofline: &'r Roofline<'r>) -> Option<Self> {
        let points = || roofline.points.iter();
        let rates = roofline.roofs.iter().map(|(_, ceiling)| ceiling.rate.median);
        // Room above the highest roof, and to the right of the last point, for what is written there.
        let room = rates.clone().map(|rate| 1.6 * rate);
        let attained = points().map(|point| point.per_second);
        let y = Scale::fit(ScaleKind::Log, attained.chain(rates).chain(room))?;
        // The ridge, where memory and the highest roof meet.
        let ridge = roofline.roofs.iter().flat_map(|(_, roof)| {
            roofline.memory.iter().map(|memory| roof.rate.median / memory.rate.median)
        });
        let intensity = points().flat_map(|point| [point.per_byte, 6.0 * point.per_byte]);
        let x = Scale::fit(ScaleKind::Log, intensity.chain(ridge))?;
        Some(Self { roofline, x, y })
    }

    fn svg(&self, pipeline: &str, adapter: &str, colors: &StageColors) -> String {
        drawing(HEIGHT_PX, &format!("Roofline of {pipeline}"), |root| {
            let model =
                "roofs as measured on this adapter; model: Williams, Waterman & Patterson 2009";
            root.draw_text(&[adapter, model].join(" · "), &style::small(), (16, 40))?;
            let (_, below) = root.split_vertically(TITLE_PX);
            let (chart, notes) = below.split_vertically(HEIGHT_PX - TITLE_PX - NOTES_PX);
            self.draw(&chart, colors)?;
            self.notes(&notes)
        })
    }

    fn draw(&self, area: &Area<'_>, colors: &StageColors) -> Drawn {
        let mut chart = ChartBuilder::on(area)
            .margin_right(24)
            .margin_left(16)
            .x_label_area_size(46)
            .y_label_area_size(74)
            .build_cartesian_2d(self.x.clone(), self.y.clone())?;
        mesh(&mut chart)
            .y_labels(20)
            .x_label_formatter(&|at| self.x.tick_label(*at))
            .y_label_formatter(&|at| self.y.tick_label(*at))
            .x_desc("work items per byte read or written (at least, once each), logarithmic")
            .y_desc("work items per second, logarithmic")
            .draw()?;
        let mut canvas = Canvas { area: chart.plotting_area(), labels: Vec::new() };
        for point in &self.roofline.points {
            canvas.keep_free(self.at(point));
        }
        // The highest first, whose name goes above the others' lines.
        let roofs = self.roofline.roofs.iter();
        let roofs = roofs.sorted_by(|a, b| b.1.rate.median.total_cmp(&a.1.rate.median));
        let flat = roofs.filter_map(|(kind, roof)| self.flat(*kind, roof));
        let slopes = self.roofline.memory.iter().filter_map(|memory| self.slope(memory));
        let roofs: Vec<Roof> = flat.chain(slopes).collect();
        for roof in &roofs {
            canvas.line(roof.ends)?;
        }
        for roof in roofs {
            canvas.write(&roof.name, roof.named_at, roof.side)?;
        }
        for point in &self.roofline.points {
            canvas.point(self.at(point), point, style::of_stage(colors.of(point.stage)))?;
        }
        Ok(())
    }

    fn at(&self, point: &RoofPoint<'_>) -> (f64, f64) {
        let at = |scale: &Scale, value| scale.at(value).unwrap_or(scale.low);
        (at(&self.x, point.per_byte), at(&self.y, point.per_second))
    }

    /// The highest rate of a kind of items, to the right of where memory bounds it.
    fn flat(&self, kind: Bounded, roof: &Ceiling) -> Option<Roof> {
        let y = self.y.at(roof.rate.median)?;
        let fastest = self.roofline.memory.iter().map(|memory| memory.rate.median);
        let ridge = self.x.at(roof.rate.median / fastest.fold(f64::NAN, f64::max));
        let start = ridge.map_or(self.x.low, |x| x.max(self.x.low));
        let ends = [(start, y), (self.x.high, y)];
        let name = format!("{}: {}/s", kind.name(), format::si(roof.rate.median));
        Some(Roof { ends, name, named_at: ends[1], side: Side::AboveLeft })
    }

    /// Bytes per second times items per byte.
    fn slope(&self, memory: &Ceiling) -> Option<Roof> {
        let rate = memory.rate.median.log10();
        let highest =
            self.roofline.roofs.iter().filter_map(|(_, roof)| self.y.at(roof.rate.median));
        let top = highest.fold(self.y.low, f64::max);
        let start = self.x.low.max(self.y.low - rate);
        let end = self.x.high.min(top - rate);
        let ends = [start, end].map(|x| (x, x + rate));
        let name = format!("{}: {}B/s", memory.limit.name(), format::si(memory.rate.median));
        (end > start).then_some(Roof { ends, name, named_at: ends[0], side: Side::Right })
    }

    fn notes(&self, area: &Area<'_>) -> Drawn {
        let mut lines = vec![
            "Work items are texel fetches (circles), fragments (squares) or primitives (triangles): those whose ceiling binds the \
             stage. Each stage is shown in the cell where it took longest."
                .to_owned(),
        ];
        if !self.roofline.without.is_empty() {
            let names = self.roofline.without.join(", ");
            lines.push(format!("Not shown, as no bytes or no items are known: {names}"));
        }
        let pieces = lines.iter().flat_map(|line| style::wrap(line, NOTE_CHARACTERS));
        for (row, piece) in pieces.enumerate() {
            area.draw_text(&piece, &style::small(), (16, 4 + LINE_PX * row as i32))?;
        }
        Ok(())
    }
}

/// A limit as it is drawn.
struct Roof {
    ends: [(f64, f64); 2],
    name: String,
    named_at: (f64, f64),
    side: Side,
}

/// Where a label lies beside its anchor.
#[derive(Clone, Copy)]
enum Side {
    Right,
    AboveLeft,
}

/// Left, top, right and bottom in pixels.
type Box = [i32; 4];

struct Canvas<'a, 'b> {
    area: &'a DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, Scale>>,
    /// What labels must not cover.
    labels: Vec<Box>,
}

impl Canvas<'_, '_> {
    /// A roof, which no label may cover.
    fn line(&mut self, ends: [(f64, f64); 2]) -> Drawn {
        let [(left, from), (right, to)] = ends.map(|end| self.area.map_coordinate(&end));
        let steps = (right - left).abs().max((to - from).abs()) / LINE_STEP_PX + 1;
        let along = |from: i32, to: i32, step: i32| from + (to - from) * step / steps;
        let places = (0..=steps).map(|step| [along(left, right, step), along(from, to, step)]);
        self.labels.extend(places.map(|[x, y]| [x - 3, y - 2, x + 3, y + 2]));
        self.area.draw(&PathElement::new(ends.to_vec(), style::INK.stroke_width(2)))
    }

    fn keep_free(&mut self, at: (f64, f64)) {
        let (x, y) = self.area.map_coordinate(&at);
        self.labels.push([x - 6, y - 6, x + 6, y + 6]);
    }

    fn point(&mut self, at: (f64, f64), point: &RoofPoint<'_>, color: RGBColor) -> Drawn {
        let outline = marker(point.items);
        self.area.draw(&(EmptyElement::at(at) + Polygon::new(outline, color.filled())))?;
        self.write(point.stage, at, Side::Right)
    }

    /// Writes a line beside its anchor: at the nearest place that covers nothing, else at the first.
    fn write(&mut self, line: &str, at: (f64, f64), side: Side) -> Drawn {
        let anchor = self.area.map_coordinate(&at);
        let size = (style::width_px(line, style::LABEL_PX) as i32 + LABEL_PX.0, LABEL_PX.1);
        let places: Vec<Box> = places(anchor, size, side).collect();
        let (xs, ys) = self.area.get_pixel_range();
        let free = |place: &&Box| {
            let inside = place[0] >= xs.start
                && place[2] <= xs.end
                && place[1] >= ys.start
                && place[3] <= ys.end;
            inside && self.labels.iter().all(|other| !overlap(place, other))
        };
        let Some(place) = places.iter().find(free).or(places.first()).copied() else {
            return Ok(());
        };
        self.labels.push(place);
        let shift = (place[0] - anchor.0, place[1] + size.1 / 2 - anchor.1);
        let text = Text::new(line.to_owned(), shift, style::starting(style::label()));
        self.area.draw(&(EmptyElement::at(at) + text))?;
        let [left, _, right, _] = place.map(|edge| edge - anchor.0);
        // A label that is far from its point is joined to it.
        let leader = vec![(0, 0), (if left >= 0 { left - 2 } else { right + 2 }, shift.1)];
        let is_far = shift.1.abs() > size.1;
        let leader = PathElement::new(leader, style::FAINT.stroke_width(1));
        if is_far { self.area.draw(&(EmptyElement::at(at) + leader)) } else { Ok(()) }
    }
}

/// Places of a label of this size, the nearest first.
fn places(anchor: (i32, i32), size: (i32, i32), side: Side) -> impl Iterator<Item = Box> {
    const FARTHEST_ROW: i32 = 24;
    let (x, y) = anchor;
    let (right, left) = (x + 10, x - 10 - size.0);
    let columns = match side {
        Side::Right => [right, left],
        Side::AboveLeft => [left, right],
    };
    let middle = match side {
        Side::Right => y - size.1 / 2,
        Side::AboveLeft => y - size.1 - 2,
    };
    let rows = (0..FARTHEST_ROW).flat_map(|row| [-row, row]);
    rows.flat_map(move |row| {
        let top = middle + row * size.1;
        columns.map(|left| [left, top, left + size.0, top + size.1])
    })
}

fn overlap(a: &Box, b: &Box) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Shapes tell kinds of items apart.
fn marker(items: Bounded) -> Vec<(i32, i32)> {
    match items {
        Bounded::Texels => {
            vec![(5, 2), (2, 5), (-2, 5), (-5, 2), (-5, -2), (-2, -5), (2, -5), (5, -2)]
        }
        Bounded::Fragments => vec![(-5, -5), (5, -5), (5, 5), (-5, 5)],
        Bounded::Primitives | Bounded::Bytes => vec![(0, -6), (6, 5), (-6, 5)],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_find_a_free_place() {
        let size = (60, 16);
        let taken: Vec<Box> = places((100, 100), size, Side::Right).take(3).collect();
        let free = places((100, 100), size, Side::Right)
            .find(|place| taken.iter().all(|other| !overlap(place, other)));
        assert!(free.is_some());
        assert!(overlap(&taken[0], &taken[0]));
    }

    #[test]
    fn a_figure_names_every_stage_and_roof() {
        let records = crate::ceilings::tests::run();
        let view = ReportView::new(&records, None);
        let files = export(&view);
        let file = files.iter().find(|file| file.name == "roofline-underwater.svg").unwrap();
        let svg = std::str::from_utf8(&file.bytes).unwrap();
        for name in ["caustics/trace", "texel fetches: 1 G/s", "copy, 64 KiB: 8 GB/s", "per byte"] {
            assert!(svg.contains(name), "{name}");
        }
    }
}
