//! Plots as PNG files, for slides and papers that take no SVG.

use anyhow::Context as _;
use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};

use super::{Artifact, Report};

/// The first that the system has is the `sans-serif` of all plots. The first of all is the widest, and has the marks of verdicts.
const FAMILIES: [&str; 5] = ["DejaVu Sans", "Liberation Sans", "Noto Sans", "Arial", "Helvetica"];

/// Draws plots with the fonts of the system.
pub struct Rasterizer(pub(super) Options<'static>);

impl Rasterizer {
    pub fn new() -> anyhow::Result<Rasterizer> {
        let mut options = Options::default();
        let fonts = options.fontdb_mut();
        fonts.load_system_fonts();
        let has = |name: &&str| fonts.faces().any(|face| face.families[0].0 == *name);
        let family = FAMILIES.into_iter().find(has);
        let missing = "no font for PNG files: install DejaVu Sans (package fonts-dejavu-core)";
        fonts.set_sans_serif_family(family.context(missing)?);
        Ok(Rasterizer(options))
    }

    /// Of each plot's file the PNG beside it, of twice its size so that type is sharp.
    pub fn pictures(&self, view: &Report<'_>) -> anyhow::Result<Vec<Artifact>> {
        super::export(view).into_iter().map(|svg| self.draw(svg)).collect()
    }

    fn draw(&self, Artifact { name, bytes }: Artifact) -> anyhow::Result<Artifact> {
        let tree = Tree::from_data(&bytes, &self.0)?;
        let pixmap = Pixmap::new(2 * tree.size().width() as u32, 2 * tree.size().height() as u32);
        let mut pixmap = pixmap.with_context(|| format!("{name} is too large for a PNG"))?;
        resvg::render(&tree, Transform::from_scale(2.0, 2.0), &mut pixmap.as_mut());
        let name = format!("{}png", name.trim_end_matches("svg"));
        Ok(Artifact { name, bytes: pixmap.encode_png()? })
    }
}
