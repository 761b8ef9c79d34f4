//! A roofline per pipeline: what its stages attained, below the adapter's measured limits. Williams, Waterman & Patterson, *Roofline:
//! An Insightful Visual Performance Model for Multicore Architectures*, CACM 52 (2009).

use maud::{Markup, html};

use super::drawing::{Drawing, MARGIN_PX, WIDTH_PX};
use super::style;
use crate::axis::{Axis, ScaleKind, tenth};
use crate::ceilings::{Roofline, rooflines};
use crate::colors::StageColors;
use crate::svg::{Shape, text_px, x_axis, y_axis};
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

const TITLE_PX: f64 = 36.0;
/// Left and right end of the horizontal axis, bottom and top of the vertical one.
const X_PX: [f64; 2] = [80.0, WIDTH_PX - 24.0];
const Y_PX: [f64; 2] = [450.0, 30.0];
const AXIS_PX: f64 = 50.0;
/// Characters of 12-px type in a line.
const NOTE_CHARACTERS: usize = 130;
/// Height of a label.
const LABEL_PX: f64 = 16.0;

fn export(view: &ReportView<'_>) -> Vec<Artifact> {
    let adapter = view.run().map_or("", |run| run.adapter.name.as_str());
    let files = rooflines(view).into_iter().filter_map(|(pipeline, roofline)| {
        let svg = Chart::new(&roofline)?.svg(pipeline, adapter, &view.colors);
        Some(Artifact::of(format!("roofline-{}.svg", text::file_stem(pipeline)), svg))
    });
    files.collect()
}

struct Chart<'r> {
    roofline: &'r Roofline<'r>,
    x: Axis,
    y: Axis,
}

impl<'r> Chart<'r> {
    /// None where nothing can be shown on logarithmic axes.
    fn new(roofline: &'r Roofline<'r>) -> Option<Self> {
        let points = || roofline.points.iter();
        let rates = roofline.roofs.iter().map(|(_, ceiling)| ceiling.rate.median);
        // Room above the highest roof, and to the right of the last point, for what is written there.
        let room = rates.clone().map(|rate| 1.6 * rate);
        let attained = points().map(|point| point.per_second);
        let y = Axis::fit(ScaleKind::Log, attained.chain(rates).chain(room), Y_PX)?;
        // The ridge, where memory and the highest roof meet.
        let ridge = roofline.roofs.iter().flat_map(|(_, roof)| {
            roofline.memory.iter().map(|memory| roof.rate.median / memory.rate.median)
        });
        let intensity = points().flat_map(|point| [point.per_byte, 6.0 * point.per_byte]);
        let x = Axis::fit(ScaleKind::Log, intensity.chain(ridge), X_PX)?;
        Some(Self { roofline, x, y })
    }

    fn svg(&self, pipeline: &str, adapter: &str, colors: &StageColors) -> String {
        let title = html! { text.name x=(MARGIN_PX) y="27" { "Roofline of " (pipeline) } };
        let model = "roofs as measured on this adapter; model: Williams, Waterman & Patterson 2009";
        let content = html! {
            (x_axis(&self.x, [Y_PX[1], Y_PX[0]], "work items per byte read or written (at least, once each), logarithmic"))
            (Drawing::y_title(Y_PX[1], "work items per second, logarithmic"))
            (y_axis(&self.y, X_PX, ""))
            (self.plane(colors))
        };
        let parts = [
            Drawing::new(TITLE_PX, title),
            Drawing::lines(MARGIN_PX, &[[adapter, model].join(" · ")]),
            Drawing::new(Y_PX[0] + AXIS_PX, content),
            Drawing::lines(MARGIN_PX, &self.notes()),
            Drawing::space(10.0),
        ];
        Drawing::column(parts).svg()
    }

    fn plane(&self, colors: &StageColors) -> Markup {
        let points = || self.roofline.points.iter();
        let places = points()
            .map(|point| [self.x.px_within(point.per_byte), self.y.px_within(point.per_second)]);
        let places: Vec<[f64; 2]> = places.collect();
        let mut labels =
            Labels(places.iter().map(|[x, y]| [x - 6.0, y - 6.0, x + 6.0, y + 6.0]).collect());
        let roofs =
            self.roofline.roofs.iter().map(|(kind, roof)| self.flat(&mut labels, *kind, roof));
        let roofs: Vec<Markup> = roofs.collect();
        let memory =
            self.roofline.memory.iter().filter_map(|memory| self.slope(&mut labels, memory));
        let memory: Vec<Markup> = memory.collect();
        html! {
            @for line in roofs.iter().chain(&memory) { (line) }
            @for (point, at) in points().zip(places) {
                path d=(shape(point.items).path(at)) fill=(colors.of(point.stage).hex()) {}
                (labels.write(point.stage, at, Side::Right))
            }
        }
    }

    /// The highest rate of a kind of items, to the right of where memory bounds it.
    fn flat(&self, labels: &mut Labels, kind: Bounded, roof: &Ceiling) -> Markup {
        let y = self.y.px_within(roof.rate.median);
        let fastest = self.roofline.memory.iter().map(|memory| memory.rate.median);
        let start = self.x.px_within(roof.rate.median / fastest.fold(f64::NAN, f64::max));
        labels.0.push([start, y - 1.0, X_PX[1], y + 1.0]);
        let words = format!("{}: {}/s", kind.name(), format::si(roof.rate.median));
        html! {
            line.line x1=(start) x2=(X_PX[1]) y1=(y) y2=(y) {}
            (labels.write(&words, [X_PX[1], y], Side::AboveLeft))
        }
    }

    /// Bytes per second times items per byte; none where that lies outside.
    fn slope(&self, labels: &mut Labels, memory: &Ceiling) -> Option<Markup> {
        let rate = memory.rate.median.log10();
        let highest =
            self.roofline.roofs.iter().filter_map(|(_, roof)| self.y.at(roof.rate.median));
        let ([x_low, x_high], [y_low, _]) = (self.x.coordinates(), self.y.coordinates());
        let top = highest.fold(y_low, f64::max);
        let ends = [x_low.max(y_low - rate), x_high.min(top - rate)];
        let [from, to] = ends.map(|x| [self.x.px_at(x), self.y.px_at(x + rate)]);
        let name = format!("{}: {}B/s", memory.limit.name(), format::si(memory.rate.median));
        (ends[0] < ends[1]).then(|| {
            html! {
                line.line x1=(from[0]) y1=(from[1]) x2=(to[0]) y2=(to[1]) {}
                (labels.write(&name, from, Side::Right))
            }
        })
    }

    fn notes(&self) -> Vec<String> {
        let mut lines = vec![
            "Work items are texel fetches (circles), fragments (squares) or primitives (triangles): those whose ceiling binds the \
             stage. Each stage is shown in the cell where it took longest."
                .to_owned(),
        ];
        if !self.roofline.without.is_empty() {
            let names = self.roofline.without.join(", ");
            lines.push(format!("Not shown, as no bytes or no items are known: {names}"));
        }
        lines.iter().flat_map(|line| style::wrap(line, NOTE_CHARACTERS)).collect()
    }
}

/// Where a label lies beside its anchor.
#[derive(Clone, Copy)]
enum Side {
    Right,
    AboveLeft,
}

/// Left, top, right and bottom in pixels.
type Box = [f64; 4];

/// What labels must not cover.
struct Labels(Vec<Box>);

impl Labels {
    /// Writes a line beside its anchor: at the nearest place that covers nothing, else at the first.
    fn write(&mut self, line: &str, anchor: [f64; 2], side: Side) -> Markup {
        let places: Vec<Box> = places(anchor, text_px(line), side).collect();
        let free = |[left, top, right, bottom]: &Box| {
            let inside =
                *left >= X_PX[0] && *right <= X_PX[1] && *top >= Y_PX[1] && *bottom <= Y_PX[0];
            inside && self.0.iter().all(|other| !overlap(&[*left, *top, *right, *bottom], other))
        };
        let place = *places.iter().find(|place| free(place)).unwrap_or(&places[0]);
        self.0.push(place);
        html! { text x=(tenth(place[0])) y=(tenth(place[1] + 12.0)) { (line) } }
    }
}

/// Places of a label of this width, the nearest first.
fn places([x, y]: [f64; 2], width_px: f64, side: Side) -> impl Iterator<Item = Box> {
    const FARTHEST_ROW: u32 = 8;
    let (right, left) = (x + 10.0, x - 10.0 - width_px);
    let (columns, middle) = match side {
        Side::Right => ([right, left], y - LABEL_PX / 2.0),
        Side::AboveLeft => ([left, right], y - LABEL_PX - 2.0),
    };
    let rows = (0..FARTHEST_ROW).map(f64::from).flat_map(|row| [-row, row]);
    rows.flat_map(move |row| {
        let top = middle + row * LABEL_PX;
        columns.map(|left| [left, top, left + width_px, top + LABEL_PX])
    })
}

fn overlap(a: &Box, b: &Box) -> bool {
    a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3]
}

/// Shapes tell kinds of items apart.
fn shape(items: Bounded) -> Shape {
    match items {
        Bounded::Texels => Shape::Circle,
        Bounded::Fragments => Shape::Square,
        Bounded::Primitives | Bounded::Bytes => Shape::Triangle,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_find_a_free_place() {
        let mut labels = Labels(Vec::new());
        (0..6).for_each(|_| drop(labels.write("a label", [300.0, 200.0], Side::Right)));
        for (index, label) in labels.0.iter().enumerate() {
            assert!(overlap(label, label));
            assert!(labels.0[..index].iter().all(|other| !overlap(label, other)), "{index}");
        }
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
