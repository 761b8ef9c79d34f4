//! What panels share: title, axes, charts of horizontal bars, legends.

use plotters::chart::{ChartContext, MeshStyle};
use plotters::coord::ranged1d::{Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;

use super::scale::{Scale, ScaleKind};
use super::{Area, Drawn, Fault, WIDTH_PX, style};

/// Title above and axis below the bars.
pub const FRAME_PX: u32 = 34 + 54;
/// A line of the legend of a chart of bars.
pub const LEGEND_ROW_PX: i32 = 18;
const LEGEND_PX: u32 = 230;

type Context<'a, 'b, Y> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Scale, Y>>;

/// Writes a panel's title and gives the places of its chart and its legend.
pub fn split<'b>(
    area: &Area<'b>,
    title: &str,
    legend_px: u32,
) -> Result<(Area<'b>, Area<'b>), Fault> {
    let (chart, legend) = area.split_horizontally(WIDTH_PX - legend_px);
    chart.draw_text(title, &style::heading(), (16, 8))?;
    Ok((chart, legend))
}

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

/// A chart of horizontal bars over an axis that starts at zero.
pub struct BarChart {
    pub title: String,
    pub x_title: String,
    pub scale: Scale,
    pub rows_px: u32,
    pub legend_px: u32,
    /// Labels at the left of the bars.
    pub labels_px: u32,
    pub right_px: u32,
}

impl BarChart {
    /// The axis of bars with these ends; none where no value can be shown.
    pub fn scale(ends: impl Iterator<Item = f64>) -> Option<Scale> {
        let mut scale = Scale::fit(ScaleKind::Linear, ends)?;
        scale.low = 0.0;
        Some(scale)
    }

    pub fn height_px(&self) -> u32 {
        FRAME_PX + 22 + self.rows_px.max(self.legend_px)
    }

    /// Draws everything but bars and legend. `rows`: the top of the chart's vertical coordinate, which starts at 0.
    pub fn draw<'b>(&self, area: &Area<'b>, rows: f64) -> Result<Canvas<'b>, Fault> {
        let (left, legend) = split(area, &self.title, LEGEND_PX)?;
        let free = self.height_px() - FRAME_PX - self.rows_px;
        let mut chart = ChartBuilder::on(&left)
            .margin_top(34)
            .margin_right(self.right_px)
            .margin_bottom(8 + free)
            .x_label_area_size(46)
            .y_label_area_size(self.labels_px)
            .build_cartesian_2d(self.scale.clone(), 0.0..rows)?;
        mesh(&mut chart)
            .disable_y_mesh()
            .y_labels(0)
            .x_label_formatter(&|at| self.scale.tick_label(*at))
            .x_desc(&self.x_title)
            .draw()?;
        Ok(Canvas { left: left.clone(), area: chart.plotting_area().clone(), legend })
    }
}

/// Where bars are drawn.
pub struct Canvas<'b> {
    /// Holds labels, in pixels.
    left: Area<'b>,
    pub area: DrawingArea<SVGBackend<'b>, Cartesian2d<Scale, RangedCoordf64>>,
    legend: Area<'b>,
}

impl<'b> Canvas<'b> {
    /// Text beside a place among the bars, `shift` pixels to the right of it.
    pub fn write(&self, line: &str, style: TextStyle<'_>, at: (f64, f64), shift: i32) -> Drawn {
        let (x, y) = self.area.map_coordinate(&at);
        let (x0, y0) = self.left.get_base_pixel();
        self.left.draw_text(
            line,
            &style,
            (x.saturating_sub(x0).saturating_add(shift), y.saturating_sub(y0)),
        )
    }

    /// A row's label at the left of the bars.
    pub fn label(&self, line: &str, row: f64) -> Drawn {
        self.write(line, style::ending(style::label()), (0.0, row), -8)
    }

    pub fn line(&self, ends: [(f64, f64); 2], width_px: u32) -> Drawn {
        self.area.draw(&PathElement::new(ends.to_vec(), style::INK.stroke_width(width_px)))
    }

    pub fn legend(&self) -> Legend<'_, 'b> {
        Legend { area: &self.legend, y: 42, row_px: LEGEND_ROW_PX }
    }
}

/// A legend that is written from top to bottom: marks, and lines of text beside them.
pub struct Legend<'a, 'b> {
    pub area: &'a Area<'b>,
    /// Middle of the next line.
    pub y: i32,
    pub row_px: i32,
}

impl Legend<'_, '_> {
    pub fn write(&mut self, line: &str, style: TextStyle<'static>) -> Drawn {
        self.area.draw_text(line, &style::starting(style), (26, self.y))?;
        self.y += self.row_px;
        Ok(())
    }

    pub fn square(&self, color: impl Color) -> Drawn {
        let corners = [(6, self.y - 6), (18, self.y + 6)];
        self.area.draw(&Rectangle::new(corners, color.filled()))
    }

    /// A filled outline, given from the middle of the mark.
    pub fn polygon(&self, outline: &[(i32, i32)], color: RGBColor) -> Drawn {
        self.area.draw(&Polygon::new(self.placed(outline), color.filled()))
    }

    pub fn line(&self, ends: &[(i32, i32)], width_px: u32) -> Drawn {
        self.area.draw(&PathElement::new(self.placed(ends), style::INK.stroke_width(width_px)))
    }

    fn placed(&self, outline: &[(i32, i32)]) -> Vec<(i32, i32)> {
        outline.iter().map(|(x, y)| (12 + x, self.y + y)).collect()
    }

    /// The line that marks published times, and what is said of them.
    pub fn published(&mut self, lines: &[String]) -> Drawn {
        if !lines.is_empty() {
            self.line(&[(0, -8), (0, 8)], 4)?;
        }
        lines.iter().try_for_each(|line| self.write(line, style::label()))
    }
}
