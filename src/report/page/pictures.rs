//! Pictures of the cells, inside the page: side by side, and two of an experiment under a slider.

mod embed;

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::Path;

use itertools::Itertools;
use maud::{Markup, html};

use self::embed::{Embedded, Embedder};
use super::{Fold, Page, PageRun, PageSection, SkippedInput};
use crate::charts::names;
use crate::document::{self, Block};
use crate::format::{count_noun, three};
use crate::{Report, Section};
use fathom_experiments::words;
use fathom_experiments::{Experiment, label_text};
use fathom_record::{Cell, ErrorSpan, Picture, PictureKind, PictureScale};

pub const SECTION: PageSection = PageSection {
    id: "pictures",
    title: "Pictures",
    question: "What does the result look like, and where is it wrong?",
    fold: Fold::Listed,
    write,
};

/// Experiments with more pictures are folded.
const OPEN_PICTURES: usize = 4;

/// Pictures that are not shown and are named.
const MAX_NAMED: usize = 50;

struct PagePicture<'p> {
    cell: &'p Cell,
    picture: &'p Picture,
    embedded: Embedded,
}

/// The pictures of an experiment of a run, in the order of its plan.
struct PictureGroup<'p> {
    run: &'p PageRun<'p>,
    section: &'p Section<'p>,
    shown: Vec<PagePicture<'p>>,
}

fn write(page: &Page<'_>) -> Option<Markup> {
    let mut embedder = Embedder::default();
    let mut left_out = Vec::new();
    let parts = page.runs.iter().flat_map(|run| run.view.sections.iter().map(move |s| (run, s)));
    let groups: Vec<PictureGroup<'_>> =
        parts.map(|(run, section)| group(run, section, &mut embedder, &mut left_out)).collect();
    let groups: Vec<&PictureGroup<'_>> =
        groups.iter().filter(|group| !group.shown.is_empty()).collect();
    if groups.is_empty() && left_out.is_empty() {
        return None;
    }
    Some(html! {
        p.lead {
            "The cells' last frames, compressed with loss if that is smaller. In a picture of errors white means no error. "
            @if groups.iter().any(|group| group.shown.len() > 1) {
                span.script-only { "The slider shows two pictures of an experiment at the same place." }
            }
        }
        @for group in groups { (group_pictures(page, group)) }
        @if !left_out.is_empty() { (missing(&left_out)) }
    })
}

/// Draws the pictures of cells where the run's folder has them, until there are enough.
pub fn drawing(view: &Report<'_>) -> impl Fn(&Cell, PictureKind) -> Option<Markup> {
    let embedder = RefCell::new(Embedder::default());
    move |cell, kind| {
        let mut pictures = cell.measured()?.pictures.iter();
        let picture = pictures.find(|picture| picture.shows == kind)?;
        let embedded = embedder.borrow_mut().embed(view.folder.as_ref()?, picture).ok()?;
        let Embedded { uri, shown_px: [width, height], .. } = embedded;
        let scale = scale(picture);
        let alt = format!("{}: {}", cell.cell, scale.as_deref().unwrap_or("picture"));
        Some(html! {
            img src=(uri) width=(width) height=(height) alt=(alt);
            @if kind == PictureKind::Error { div.faint { (scale?) } }
        })
    }
}

fn group<'p>(
    run: &'p PageRun<'p>,
    section: &'p Section<'p>,
    embedder: &mut Embedder,
    left_out: &mut Vec<SkippedInput>,
) -> PictureGroup<'p> {
    let mut shown = Vec::new();
    let Some(folder) = &run.view.folder else { return PictureGroup { run, section, shown } };
    // Records are often kept without the folder of their pictures.
    let is_kept = |of: &&Picture| folder.join(&of.path).parent().is_some_and(Path::is_dir);
    for (cell, measured) in section.measured() {
        for picture in measured.pictures.iter().filter(is_kept) {
            match embedder.embed(folder, picture) {
                Ok(embedded) => shown.push(PagePicture { cell, picture, embedded }),
                Err(reason) => left_out.push(SkippedInput { what: picture.path.clone(), reason }),
            }
        }
    }
    PictureGroup { run, section, shown }
}

fn group_pictures(page: &Page<'_>, group: &PictureGroup<'_>) -> Markup {
    let differing = differing(&group.shown);
    html! {
        details.pictures id=[(!page.is_overlay()).then(|| format!("pictures-{}", group.section.id))] open[group.shown.len() <= OPEN_PICTURES] {
            summary {
                b { (group.section.id) } ": " (group.section.title()) ", " (count_noun(group.shown.len(), "picture"))
                @if page.is_overlay() { " (" (group.run.label) ")" }
            }
            @if group.shown.len() > 1 { div.slider.script-only {} }
            div.grid {
                @for shown in &group.shown {
                    (figure(shown, &caption(group.section.experiment.as_ref(), shown, &differing)))
                }
            }
        }
    }
}

fn figure(shown: &PagePicture<'_>, caption: &str) -> Markup {
    let Embedded { uri, shown_px, .. } = &shown.embedded;
    html! {
        figure {
            img src=(uri) width=(shown_px[0]) height=(shown_px[1]) alt=(caption) decoding="async";
            figcaption {
                span.caption { (caption) }
                br;
                span.faint { (size(shown)) @if let Some(scale) = scale(shown.picture) { ". " (scale) } }
            }
        }
    }
}

/// Axes whose values differ among the pictures.
fn differing<'p>(shown: &[PagePicture<'p>]) -> BTreeSet<&'p str> {
    let names = shown.iter().flat_map(|one| one.cell.axes.keys().map(String::as_str));
    let values = |name: &str| shown.iter().map(|one| one.cell.axes.get(name)).collect::<Vec<_>>();
    let differs = |name: &&str| values(name).windows(2).any(|pair| pair[0] != pair[1]);
    names.collect::<BTreeSet<&str>>().into_iter().filter(differs).collect()
}

/// Values of the cell's axes in words; the cell's name where there are none.
fn caption(
    experiment: Option<&Experiment>,
    shown: &PagePicture<'_>,
    differing: &BTreeSet<&str>,
) -> String {
    let is_told = |name: &str| differing.is_empty() || differing.contains(name);
    let told = shown.cell.axes.iter().filter(|(name, _)| is_told(name));
    let title = |name: &str| match experiment {
        Some(experiment) => names::axis(name, experiment),
        None => words::parameter_label(name),
    };
    let axes =
        told.map(|(name, value)| format!("{} {}", title(name), label_text(value))).join(", ");
    let axes = if axes.is_empty() { shown.cell.cell.clone() } else { axes };
    match shown.picture.shows {
        PictureKind::Image => axes,
        PictureKind::Error => format!("Error, {axes}"),
    }
}

/// Size of the picture, and of what the page shows where that is smaller.
fn size(shown: &PagePicture<'_>) -> String {
    let px = |[width, height]: [u32; 2]| format!("{width} × {height} px");
    let Embedded { own_px, shown_px, .. } = &shown.embedded;
    match own_px == shown_px {
        true => px(*own_px),
        false => format!("{}, shown at {}", px(*own_px), px(*shown_px)),
    }
}

/// What the colours mean, and the largest error.
fn scale(picture: &Picture) -> Option<String> {
    Some(match picture.scale? {
        PictureScale::Visibility => {
            "Occlusion A as grey: black is A = 1, white is A = 0".to_owned()
        }
        PictureScale::OcclusionError(ErrorSpan { full_at, largest }) => format!(
            "Red is too dark, blue too light, in full colour from ±{} of occlusion on, grey not compared; largest error {}",
            three(full_at),
            three(largest)
        ),
        PictureScale::IrradianceError(ErrorSpan { full_at, largest }) => format!(
            "Red is too bright, blue too dark, in full colour from ±{} times the mean irradiance on; largest error {} times",
            three(full_at),
            three(largest)
        ),
    })
}

fn missing(left_out: &[SkippedInput]) -> Markup {
    let more = left_out.len().saturating_sub(MAX_NAMED);
    let named = left_out.iter().take(MAX_NAMED).map(SkippedInput::line);
    let list = Block::list(named.chain((more > 0).then(|| format!("and {more} more"))));
    let words = format!("not shown: {}", count_noun(left_out.len(), "picture"));
    document::html(&[Block::Fold(words.into(), vec![list])])
}

#[cfg(test)]
mod tests;
