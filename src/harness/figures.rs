//! Published figures as data: `benches/figures/*.toml`. Each lists the panels that are rendered for it, which `sheet`
//! shows with their captions.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Result, anyhow, bail};
use image::{RgbImage, imageops};
use serde::Deserialize;
use serde_json::{Map, Value};

use super::render::RenderedFrame;
use super::subject::{Subject, Subjects};
use fathom_base::embedded::Folders;
use fathom_base::text::{check_id, did_you_mean};
use fathom_experiments::flatten;
use fathom_experiments::schema::one_line;
use fathom_gpu::Gpu;

/// The name that stands for every figure.
pub const ALL: &str = "all";
/// Samples of a pixel where a panel and the command line say nothing.
const SAMPLES: u32 = 4;

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaperFigure {
    /// The file's stem.
    pub id: String,
    pub title: String,
    /// Paper and number.
    pub source: String,
    /// What it shows, and where it departs from the publication.
    pub about: String,
    /// Panels side by side.
    #[serde(default = "two")]
    pub columns: u32,
    /// Of all panels, where they name none of their own.
    pub pipeline: Option<String>,
    pub scene: Option<String>,
    #[serde(default)]
    pub params: Map<String, Value>,
    pub panel: Vec<FigurePanel>,
    /// Words by their names. The panels are there once for each of these tables, with its words in place of their names in braces in
    /// captions, scenes and parameters.
    #[serde(default)]
    each: Vec<BTreeMap<String, String>>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FigureContent {
    /// Its picture.
    #[default]
    Image,
    /// Exact answers in its place.
    Reference,
    /// Where it differs from them.
    Error,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FigurePanel {
    pub caption: String,
    pub pipeline: Option<String>,
    pub scene: Option<String>,
    /// Over those of the figure.
    #[serde(default)]
    pub params: Map<String, Value>,
    /// Samples of a pixel, a square number.
    pub samples: Option<u32>,
    #[serde(default)]
    pub shows: FigureContent,
    /// The part that is shown, shares of width and height: left, top, right, bottom.
    pub crop: Option<[f64; 4]>,
}

impl FigurePanel {
    fn with(&self, words: &BTreeMap<String, String>) -> Self {
        let filled = |text: &str| {
            let word = |text: String, (name, word): (&String, &String)| {
                text.replace(&format!("{{{name}}}"), word)
            };
            words.iter().fold(text.to_owned(), word)
        };
        let (caption, scene) = (filled(&self.caption), self.scene.as_deref().map(filled));
        let params = flatten(&self.params).into_iter().map(|(path, value)| {
            let text = value.as_str().map(|text| filled(text).into());
            (path, text.unwrap_or(value))
        });
        Self { caption, scene, params: params.collect(), ..self.clone() }
    }
}

fn paper_of(id: &str) -> &str {
    id.rsplit_once('-').map_or(id, |(paper, _)| paper)
}

fn two() -> u32 {
    2
}

#[derive(Clone)]
pub struct RenderedPanel {
    pub picture: RgbImage,
    /// Its greys are 1 − A.
    pub shows_visibility: bool,
    pub caption: String,
}

impl PaperFigure {
    /// Ids of the figures in these folders, by paper and number.
    pub fn ids(folders: &Folders) -> Vec<String> {
        let mut ids: Vec<String> = folders.stems(".toml").collect();
        ids.sort_by_key(|id| match id.rsplit_once('-').map(|(of, n)| (of, n.parse::<u32>())) {
            Some((of, Ok(number))) => (of.to_owned(), number),
            _ => (id.clone(), 0),
        });
        ids
    }

    /// The figure of this id. The error of an unknown one names the nearest.
    pub fn load(folders: &Folders, id: &str) -> Result<Self> {
        let Some((_, text)) = folders.text(&format!("{id}.toml")) else {
            let meant = did_you_mean(id, Self::ids(folders).iter().map(String::as_str));
            bail!("unknown figure `{id}`{meant}");
        };
        Self::parse(id, &text).map_err(|message| anyhow!("figure `{id}`: {message}"))
    }

    /// The figure of this id, those of a paper (`uw`), or all of them; and whether the name stands for several.
    pub fn find(folders: &Folders, name: &str) -> Result<(Vec<Self>, bool)> {
        let mut ids = Self::ids(folders);
        let several = name == ALL || ids.iter().any(|id| paper_of(id) == name);
        ids.retain(|id| name == ALL || paper_of(id) == name);
        let ids = if several { ids } else { vec![name.to_owned()] };
        let figures: Result<Vec<_>> = ids.iter().map(|id| Self::load(folders, id)).collect();
        Ok((figures?, several))
    }

    fn parse(name: &str, text: &str) -> Result<Self, String> {
        let mut figure: Self = toml::from_str(text).map_err(|error| one_line(&error, text))?;
        if !figure.each.is_empty() {
            let filled = figure.each.iter();
            figure.panel = filled
                .flat_map(|words| figure.panel.iter().map(|panel| panel.with(words)))
                .collect();
        }
        figure.check(name)?;
        Ok(figure)
    }

    fn check(&self, name: &str) -> Result<(), String> {
        check_id(&self.id)?;
        if self.id != name {
            return Err(format!("its id is `{}`: it must be that of the file", self.id));
        }
        if self.panel.is_empty() || self.columns == 0 {
            return Err("it needs a panel and a column at least".to_owned());
        }
        for panel in &self.panel {
            let fault = |what| Err(format!("panel `{}`: {what}", panel.caption));
            if panel.samples.is_some_and(|n| n == 0 || n.isqrt().pow(2) != n) {
                return fault("samples must be a square number");
            }
            let sound = |low: f64, high: f64| 0.0 <= low && low < high && high <= 1.0;
            if panel.crop.is_some_and(|[l, t, r, b]| !sound(l, r) || !sound(t, b)) {
                return fault("crop must be left, top, right, bottom within 0 … 1");
            }
            let (pipeline, scene, _) = self.setting(panel, &[]);
            if pipeline.is_empty() || scene.is_empty() {
                return fault("neither it nor the figure names pipeline and scene");
            }
        }
        Ok(())
    }

    /// Pipeline, scene and parameters of a panel, those of `more` last.
    pub fn setting<'f>(
        &'f self,
        panel: &'f FigurePanel,
        more: &[(String, Value)],
    ) -> (&'f str, &'f str, Vec<(String, Value)>) {
        let named = |own: &'f Option<String>, of_all: &'f Option<String>| {
            own.as_deref().or(of_all.as_deref()).unwrap_or_default()
        };
        let params = [flatten(&self.params), flatten(&panel.params), more.to_vec()].concat();
        let pipeline = named(&panel.pipeline, &self.pipeline);
        (pipeline, named(&panel.scene, &self.scene), params)
    }

    /// Renders every panel. `more` parameters hold for all of them. An error names the panel.
    pub fn render(
        &self,
        gpu: &Gpu,
        subjects: &mut Subjects,
        more: &[(String, Value)],
        samples: Option<u32>,
    ) -> Result<Vec<RenderedPanel>> {
        let is_one_frame = |a: &FigurePanel, b: &FigurePanel| {
            a.samples == b.samples && self.setting(a, more) == self.setting(b, more)
        };
        let frames = self.panel.chunk_by(is_one_frame).map(|panels| {
            let (pipeline, scene, params) = self.setting(&panels[0], more);
            let samples = samples.or(panels[0].samples).unwrap_or(SAMPLES);
            let subject = subjects.subject(pipeline, scene, &params).map_err(anyhow::Error::from);
            let rendered = subject.and_then(|subject| {
                let frame = RenderedFrame::new(gpu, &subject, samples)?;
                render_panels(gpu, panels, &subject, &frame)
            });
            rendered.map_err(|error| {
                anyhow!("figure `{}`, panel `{}`: {error}", self.id, panels[0].caption)
            })
        });
        Ok(frames.collect::<Result<Vec<_>>>()?.concat())
    }
}

/// The panels that show one frame.
fn render_panels(
    gpu: &Gpu,
    panels: &[FigurePanel],
    subject: &Subject,
    frame: &RenderedFrame,
) -> Result<Vec<RenderedPanel>> {
    let is_compared = panels.iter().any(|panel| panel.shows != FigureContent::Image);
    let compared = is_compared.then(|| frame.compare_pixels(gpu, subject)).transpose()?;
    let render = |panel: &FigurePanel| {
        let picture = match (panel.shows, &compared) {
            (FigureContent::Reference, Some(compared)) => compared.exact.clone(),
            (FigureContent::Error, Some(compared)) => compared.error.clone(),
            _ => frame.image(gpu)?,
        };
        Ok(RenderedPanel {
            picture: panel.crop.map_or(picture.clone(), |crop| cropped(&picture, crop)),
            shows_visibility: panel.shows != FigureContent::Error
                && frame.pipeline.shows_visibility(),
            caption: caption(panel, subject),
        })
    };
    panels.iter().map(render).collect()
}

/// A panel's caption, which tells where a stand-in takes a mesh's place.
fn caption(panel: &FigurePanel, subject: &Subject) -> String {
    let stand_in = if subject.scene.stand_ins.is_empty() { "" } else { " [stand-in]" };
    format!("{}{stand_in}", panel.caption)
}

fn cropped(picture: &RgbImage, [left, top, right, bottom]: [f64; 4]) -> RgbImage {
    let (width, height) = (f64::from(picture.width()), f64::from(picture.height()));
    let (x, y) = ((left * width) as u32, (top * height) as u32);
    let size = (((right - left) * width) as u32, ((bottom - top) * height) as u32);
    imageops::crop_imm(picture, x, y, size.0.max(1), size.1.max(1)).to_image()
}

/// Name of a panel's file: `uw-5-a.png`. Where the panels are there once for each of several words: `vao-8-a1.png`, `vao-8-a2.png`,
/// `vao-8-b1.png`, a letter for each of these words.
pub fn panel_file(folder: &Path, figure: &PaperFigure, number: usize) -> PathBuf {
    let of_each = figure.panel.len() / figure.each.len().max(1);
    let letter = |place: usize| char::from(b'a' + (place % 26) as u8);
    let panel = match figure.each.len() {
        0 => letter(number).to_string(),
        _ => format!("{}{}", letter(number / of_each), number % of_each + 1),
    };
    folder.join(format!("{}-{panel}.png", figure.id))
}

#[cfg(test)]
mod tests {
    use itertools::Itertools;

    use super::*;
    use crate::catalog::Catalog;
    use fathom_base::embedded::FIGURES;
    use fathom_base::parameter;
    use fathom_gpu::Capacity;
    use fathom_scene::{Scene, SceneFile};

    #[test]
    fn a_name_stands_for_a_figure_a_paper_or_all() {
        let folders = Folders::new(FIGURES);
        let named = |name| PaperFigure::find(&folders, name).unwrap();
        let (all, several) = named("all");
        assert!(several && all.len() == PaperFigure::ids(&folders).len());
        let (of_paper, several) = named("uw");
        assert!(several && of_paper.len() > 1 && of_paper.len() < all.len());
        assert!(of_paper.iter().all(|figure| paper_of(&figure.id) == "uw"));
        let (one, several) = named("uw-5");
        assert!(!several && one.len() == 1 && one[0].id == "uw-5");
        assert!(PaperFigure::find(&folders, "u").is_err());
    }

    #[test]
    fn every_figure_parses_its_parameters_exist_and_a_software_adapter_draws_it() {
        let (folders, catalog) = (Folders::new(FIGURES), Catalog::builtin());
        let ground = Scene::load("plane").unwrap();
        let software = Capacity { frame_s: Some(30.0), threads: 2, ..Capacity::default() };
        let two_threads = software.for_figures();
        let ids = PaperFigure::ids(&folders);
        for id in ["uw-5", "uw-6", "uw-9", "uw-10", "vao-3", "vao-7", "vao-8", "vao-14"] {
            assert!(ids.iter().any(|known| known == id), "{id} is missing");
        }
        for id in ids {
            let figure = PaperFigure::load(&folders, &id).unwrap_or_else(|error| panic!("{error}"));
            let files = (0..figure.panel.len()).map(|n| panel_file(Path::new(""), &figure, n));
            assert!(files.clone().all_unique(), "{id}: {:?}", files.collect::<Vec<_>>());
            for panel in &figure.panel {
                let (pipeline, scene, params) = figure.setting(panel, &[]);
                let place = format!("{id}, {}", panel.caption);
                let kind = catalog.kind(pipeline).unwrap();
                let file = SceneFile::load_from(&catalog.scenes, scene).unwrap();
                let mut tree = (kind.defaults)(&file);
                for (path, value) in params {
                    parameter::set(&mut tree, &path, value)
                        .unwrap_or_else(|error| panic!("{place}: {error}"));
                }
                let read = (kind.checked)(&tree);
                let read = read.unwrap_or_else(|error| panic!("{place}: {error}"));
                // Only these take more than seconds, for their pixels.
                if ["photon_tracing", "shadow_rays"].contains(&pipeline) {
                    let demand = (kind.plan)(&read, &ground).unwrap().demand;
                    two_threads.check(&demand).unwrap_or_else(|error| panic!("{place}: {error}"));
                }
            }
        }
    }

    #[test]
    fn figures_are_listed_by_number() {
        let ids = PaperFigure::ids(&Folders::new(FIGURES));
        let place = |id: &str| ids.iter().position(|known| known == id).unwrap();
        assert!(place("uw-9") < place("uw-10") && place("uw-10") < place("vao-1"), "{ids:?}");
    }

    fn parse(panel: &str) -> Result<PaperFigure, String> {
        let head = "id = \"f\"\ntitle = \"\"\nsource = \"\"\nabout = \"\"\n";
        PaperFigure::parse("f", &format!("{head}{panel}"))
    }

    #[test]
    fn faults_of_a_file_are_told() {
        let sound = "[[panel]]\ncaption = \"c\"\npipeline = \"p\"\nscene = \"s\"\n";
        assert!(parse(sound).is_ok());
        for (more, told) in [
            ("samples = 3", "square number"),
            ("crop = [0.5, 0.0, 0.5, 1.0]", "crop must be"),
            ("sample = 4", "unknown field `sample`"),
        ] {
            let error = parse(&format!("{sound}{more}")).unwrap_err();
            assert!(error.contains(told), "{error}");
        }
        let error = parse("[[panel]]\ncaption = \"c\"\n").unwrap_err();
        assert!(error.contains("names pipeline and scene"), "{error}");
        assert!(parse("panel = []\n").is_err());
    }

    #[test]
    fn a_part_of_a_picture_is_cut_out() {
        let picture = RgbImage::from_fn(8, 4, |x, y| image::Rgb([x as u8, y as u8, 0]));
        let part = cropped(&picture, [0.25, 0.5, 0.75, 1.0]);
        assert_eq!(part.dimensions(), (4, 2));
        assert_eq!(part.get_pixel(0, 0).0, [2, 2, 0]);
    }
}
