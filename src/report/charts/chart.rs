//! What panels share: grids and axes, charts of horizontal bars, legends.

use plotters::chart::{ChartContext, MeshStyle};
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::prelude::*;

use super::style::{self, Marker};
use super::{Area, DrawResult, Panel, WIDTH_PX};
use crate::axis::{Scale, ScaleKind};

/// Axis below the bars, with its title.
const AXIS_PX: u32 = 48;
const MARGIN_PX: u32 = 16;
/// Most pixels for the labels of rows.
pub const MAX_LABELS_PX: u32 = 400;

/// Grid and axes of every chart.
pub fn mesh<'a, 'b, 'm, Y: Ranged<ValueType = f64> + ValueFormatter<f64>>(
    chart: &'m mut ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Y>>,
) -> MeshStyle<'a, 'm, Scale, Y, SVGBackend<'b>> {
    let mut mesh = chart.configure_mesh();
    mesh.bold_line_style(style::GRID)
        .light_line_style(TRANSPARENT)
        .axis_style(style::FAINT)
        .label_style(style::label())
        .axis_desc_style(style::label())
        .x_labels(20);
    mesh
}

/// Gives the shape that was drawn last a title, which a reader sees under the pointer.
pub fn tip(area: &Area<'_>, words: &str) -> DrawResult {
    area.draw_text(&format!("{}{words}", style::TIP), &style::small(), (0, 0))
}

/// A chart of horizontal rows, such as bars.
pub struct BarChart {
    pub x_title: String,
    pub scale: Scale,
    pub rows_px: u32,
    /// The top of the vertical coordinate, which starts at 0.
    pub rows: f64,
    /// Room for figures at the right.
    pub right_px: u32,
    pub legend: Legend,
    /// From back to front.
    pub items: Vec<Item>,
}

/// What a chart of rows shows, by its coordinates.
pub enum Item {
    Bar([(f64, f64); 2], RGBColor),
    /// What the item before it shows.
    Tip(String),
    /// With its width in pixels.
    Line([(f64, f64); 2], u32),
    /// The untimed frame.
    Diamond((f64, f64)),
    /// A row's label at the left of the chart.
    Label(String, f64),
    /// Words so many pixels to the right of a place.
    Words(String, (f64, f64), i32),
}

impl BarChart {
    /// The axis of bars with these ends, from zero; none where no value can be shown.
    pub fn scale(ends: impl Iterator<Item = f64>) -> Option<Scale> {
        let mut scale = Scale::fit(ScaleKind::Linear, ends)?;
        scale.low = 0.0;
        Some(scale)
    }

    /// Pixels that its labels need at the left.
    fn labels_px(&self) -> u32 {
        let widths = self.items.iter().filter_map(|item| match item {
            Item::Label(label, _) => Some(style::width_px(label, style::LABEL_PX) + 20),
            _ => None,
        });
        widths.max().unwrap_or_default().clamp(60, MAX_LABELS_PX)
    }
}

impl Panel for BarChart {
    fn height_px(&self) -> u32 {
        self.legend.height_px() + self.rows_px + AXIS_PX + 8
    }

    fn draw(&self, area: &Area<'_>) -> DrawResult {
        let (legend, area) = area.split_vertically(self.legend.height_px());
        self.legend.draw(&legend)?;
        let labels_px = self.labels_px();
        let mut chart = ChartBuilder::on(&area)
            .margin_right(self.right_px)
            .margin_bottom(4)
            .margin_left(MARGIN_PX)
            .x_label_area_size(AXIS_PX)
            .y_label_area_size(labels_px)
            .build_cartesian_2d(self.scale.clone(), 0.0..self.rows)?;
        mesh(&mut chart)
            .disable_y_mesh()
            .y_labels(0)
            .x_label_formatter(&|at| self.scale.tick_label(*at))
            .x_desc(format!("{}, {} scale", self.x_title, self.scale.kind.name()))
            .draw()?;
        let plot = chart.plotting_area();
        let write = |line: &str, style: TextStyle<'_>, at: (f64, f64), shift: i32| {
            let (x, y) = plot.map_coordinate(&at);
            let (x0, y0) = area.get_base_pixel();
            let at = (x.saturating_sub(x0).saturating_add(shift), y.saturating_sub(y0));
            area.draw_text(line, &style, at)
        };
        self.items.iter().try_for_each(|item| match item {
            Item::Bar(corners, color) => plot.draw(&Rectangle::new(*corners, color.filled())),
            Item::Tip(words) => tip(&area, words),
            Item::Line(ends, width_px) => {
                plot.draw(&PathElement::new(ends.to_vec(), style::INK.stroke_width(*width_px)))
            }
            Item::Diamond(at) => {
                plot.draw(&(EmptyElement::at(*at) + Polygon::new(DIAMOND, style::INK.filled())))
            }
            Item::Label(line, row) => {
                let line = style::truncate(line, style::max_characters(labels_px - 8));
                write(&line, style::ending(style::label()), (self.scale.low, *row), -8)
            }
            Item::Words(line, at, shift_px) => {
                write(line, style::starting(style::small()), *at, *shift_px)
            }
        })
    }
}

/// A mark beside a legend's words.
#[derive(Clone, Debug)]
pub enum Mark {
    Square(RGBColor),
    Series(Marker, RGBColor),
    /// The untimed frame.
    Diamond,
    /// Published times.
    Published,
}

/// Marks and words in rows from left to right.
#[derive(Clone, Debug, Default)]
pub struct Legend(pub Vec<(Mark, String)>);

const LEGEND_ROW_PX: u32 = 20;
/// The mark before an entry's words and the space behind them.
const MARK_PX: u32 = 20;
const SPACE_PX: u32 = 18;

impl Legend {
    /// Left edge and row of each entry.
    fn places(&self) -> Vec<(u32, u32)> {
        let (mut x, mut row) = (MARGIN_PX, 0);
        let mut places = Vec::new();
        for (_, words) in &self.0 {
            let width = MARK_PX + style::width_px(words, style::LABEL_PX) + SPACE_PX;
            if x > MARGIN_PX && x + width > WIDTH_PX {
                (x, row) = (MARGIN_PX, row + 1);
            }
            places.push((x, row));
            x += width;
        }
        places
    }

    pub fn height_px(&self) -> u32 {
        self.places().last().map_or(0, |(_, row)| (row + 1) * LEGEND_ROW_PX + 6)
    }

    pub fn draw(&self, area: &Area<'_>) -> DrawResult {
        for ((mark, words), (x, row)) in self.0.iter().zip(self.places()) {
            let (x, y) = (x as i32, (row * LEGEND_ROW_PX + LEGEND_ROW_PX / 2) as i32);
            mark.draw(area, x + 7, y)?;
            let at = (x + MARK_PX as i32, y);
            area.draw_text(words, &style::starting(style::label()), at)?;
        }
        Ok(())
    }
}

/// The mark of the untimed frame.
const DIAMOND: [(i32, i32); 4] = [(0, -6), (6, 0), (0, 6), (-6, 0)];

impl Mark {
    pub fn draw(&self, area: &Area<'_>, x: i32, y: i32) -> DrawResult {
        let placed = |outline: &[(i32, i32)]| -> Vec<(i32, i32)> {
            outline.iter().map(|(dx, dy)| (x + dx, y + dy)).collect()
        };
        match self {
            Mark::Square(color) => {
                area.draw(&Rectangle::new([(x - 6, y - 6), (x + 6, y + 6)], color.filled()))
            }
            Mark::Series(marker, color) => {
                let outline = placed(&style::marker(marker.shape));
                if !marker.hollow {
                    return area.draw(&Polygon::new(outline, color.filled()));
                }
                let closed = [outline.as_slice(), &outline[..1]].concat();
                area.draw(&PathElement::new(closed, color.stroke_width(2)))
            }
            Mark::Diamond => area.draw(&Polygon::new(placed(&DIAMOND), style::INK.filled())),
            Mark::Published => {
                let line = placed(&[(0, -8), (0, 8)]);
                area.draw(&PathElement::new(line, style::INK.stroke_width(4)))
            }
        }
    }
}
