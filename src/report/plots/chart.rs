//! What panels share: grids and axes, charts of horizontal bars, legends.

use plotters::chart::{ChartContext, MeshStyle};
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::{Area, Drawn, Fault, WIDTH_PX, style};
use crate::axis::{Scale, ScaleKind};

/// Axis below the bars, with its title.
const AXIS_PX: u32 = 48;
const MARGIN_PX: u32 = 16;
/// Most pixels for the labels of rows.
const MOST_LABELS_PX: u32 = 400;

type Context<'a, 'b, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Y>>;

/// Grid and axes of every chart.
pub fn mesh<'a, 'b, 'm, Y: Ranged<ValueType = f64> + ValueFormatter<f64>>(
    chart: &'m mut Context<'a, 'b, Y>,
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

/// A chart of horizontal rows, such as bars.
pub struct BarChart {
    pub x_title: String,
    pub scale: Scale,
    pub rows_px: u32,
    /// Labels at the left of the rows; as wide as the longest.
    pub labels_px: u32,
    /// Room for figures at the right.
    pub right_px: u32,
    pub legend: Legend,
}

impl BarChart {
    /// The axis of bars with these ends, from zero; none where no value can be shown.
    pub fn scale(ends: impl Iterator<Item = f64>) -> Option<Scale> {
        let mut scale = Scale::fit(ScaleKind::Linear, ends)?;
        scale.low = 0.0;
        Some(scale)
    }

    /// Pixels that these labels need at the left of a chart.
    pub fn labels_px<'l>(labels: impl Iterator<Item = &'l str>) -> u32 {
        let widths = labels.map(|label| style::width_px(label, style::LABEL_PX) + 20);
        widths.max().unwrap_or_default().clamp(60, MOST_LABELS_PX)
    }

    pub fn height_px(&self) -> u32 {
        self.legend.height_px() + self.rows_px + AXIS_PX + 8
    }

    /// Draws legend, grid and axis. `rows`: the top of the chart's vertical coordinate, which starts at 0.
    pub fn draw<'b>(&self, area: &Area<'b>, rows: f64) -> Result<Canvas<'b>, Fault> {
        let (legend, rest) = area.split_vertically(self.legend.height_px());
        self.legend.draw(&legend)?;
        let mut chart = ChartBuilder::on(&rest)
            .margin_right(self.right_px)
            .margin_bottom(4)
            .margin_left(MARGIN_PX)
            .x_label_area_size(AXIS_PX)
            .y_label_area_size(self.labels_px)
            .build_cartesian_2d(self.scale.clone(), 0.0..rows)?;
        mesh(&mut chart)
            .disable_y_mesh()
            .y_labels(0)
            .x_label_formatter(&|at| self.scale.tick_label(*at))
            .x_desc(format!("{}, {} scale", self.x_title, self.scale.kind.short()))
            .draw()?;
        let labels_px = self.labels_px;
        Ok(Canvas { left: rest.clone(), area: chart.plotting_area().clone(), labels_px })
    }
}

/// Where rows are drawn.
pub struct Canvas<'b> {
    /// Holds labels, in pixels.
    left: Area<'b>,
    pub area: DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, RangedCoordf64>>,
    labels_px: u32,
}

impl Canvas<'_> {
    /// Text beside a place among the rows, `shift` pixels to the right of it.
    pub fn write(&self, line: &str, style: TextStyle<'_>, at: (f64, f64), shift: i32) -> Drawn {
        let (x, y) = self.area.map_coordinate(&at);
        let (x0, y0) = self.left.get_base_pixel();
        self.left.draw_text(
            line,
            &style,
            (x.saturating_sub(x0).saturating_add(shift), y.saturating_sub(y0)),
        )
    }

    /// A row's label at the left of the chart.
    pub fn label(&self, line: &str, low: f64, row: f64) -> Drawn {
        let line = style::cut(line, style::fitting(self.labels_px - 8));
        self.write(&line, style::ending(style::label()), (low, row), -8)
    }

    pub fn line(&self, ends: [(f64, f64); 2], width_px: u32) -> Drawn {
        self.area.draw(&PathElement::new(ends.to_vec(), style::INK.stroke_width(width_px)))
    }
}

/// A mark beside a legend's words.
#[derive(Clone, Debug)]
pub enum Mark {
    Square(RGBColor),
    /// The marker of a series by its number.
    Series(usize, RGBColor),
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

    pub fn draw(&self, area: &Area<'_>) -> Drawn {
        for ((mark, words), (x, row)) in self.0.iter().zip(self.places()) {
            let (x, y) = (x as i32, (row * LEGEND_ROW_PX + LEGEND_ROW_PX / 2) as i32);
            mark.draw(area, (x + 7, y))?;
            let at = (x + MARK_PX as i32, y);
            area.draw_text(words, &style::starting(style::label()), at)?;
        }
        Ok(())
    }
}

/// The mark of the untimed frame.
pub const DIAMOND: [(i32, i32); 4] = [(0, -6), (6, 0), (0, 6), (-6, 0)];

impl Mark {
    pub fn draw(&self, area: &Area<'_>, (x, y): (i32, i32)) -> Drawn {
        let placed = |outline: &[(i32, i32)]| -> Vec<(i32, i32)> {
            outline.iter().map(|(dx, dy)| (x + dx, y + dy)).collect()
        };
        match self {
            Mark::Square(color) => {
                area.draw(&Rectangle::new([(x - 6, y - 6), (x + 6, y + 6)], color.filled()))
            }
            Mark::Series(index, color) => {
                area.draw(&Polygon::new(placed(&style::marker(*index)), color.filled()))
            }
            Mark::Diamond => area.draw(&Polygon::new(placed(&DIAMOND), style::INK.filled())),
            Mark::Published => {
                let line = placed(&[(0, -8), (0, 8)]);
                area.draw(&PathElement::new(line, style::INK.stroke_width(4)))
            }
        }
    }
}
