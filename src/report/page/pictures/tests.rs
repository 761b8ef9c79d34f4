use super::*;
use crate::Report;
use crate::testing::page;
use fathom_experiments::fixtures;
use fathom_record::Record;

fn picture(path: &str, scale: Option<PictureScale>) -> Picture {
    Picture { path: path.to_owned(), shows: PictureKind::Image, scale }
}

/// A run whose first cells of `uw-photons` have these pictures.
fn run(pictures: &[Picture]) -> Vec<Record> {
    let mut records = fixtures::run();
    let cells = fixtures::cells(&mut records).filter(|cell| cell.experiment == "uw-photons");
    let cells = cells.filter_map(Cell::measured_mut);
    cells.zip(pictures).for_each(|(measured, picture)| measured.pictures.push(picture.clone()));
    records
}

fn written(records: &[Record], folder: Option<&Path>) -> String {
    let view = Report::new(records, folder);
    write(&page(&[&view])).map_or_else(String::new, Markup::into_string)
}

fn save(folder: &Path, name: &str, [width, height]: [u32; 2]) {
    let noise = |x: u32, y: u32| image::Rgb([x as u8, y as u8, (x * 31 + y * 17) as u8]);
    image::RgbImage::from_fn(width, height, noise).save(folder.join(name)).unwrap();
}

#[test]
fn pictures_lie_in_the_page_with_their_parameters_and_sizes() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path(), "a.png", [40, 30]);
    save(folder.path(), "b.png", [960, 480]);
    let text =
        written(&run(&[picture("a.png", None), picture("b.png", None)]), Some(folder.path()));
    assert_eq!(text.matches("src=\"data:image/").count(), 2);
    assert!(text.contains("40 × 30 px<"), "{text}");
    assert!(text.contains("960 × 480 px") && text.contains("shown at 280 × 140 px"));
    assert!(text.contains("class=\"slider"));
}

#[test]
fn what_is_no_picture_of_the_run_is_left_out_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("text.png"), "no picture").unwrap();
    save(folder.path(), "whole.png", [40, 30]);
    let whole = std::fs::read(folder.path().join("whole.png")).unwrap();
    std::fs::write(folder.path().join("torn.png"), &whole[..whole.len() / 2]).unwrap();
    save(folder.path(), "wide.png", [9000, 1]);
    std::fs::create_dir(folder.path().join("folder.png")).unwrap();
    let paths = [
        "text.png",
        "torn.png",
        "wide.png",
        "folder.png",
        "missing.png",
        "../x.png",
        "/etc/hosts",
        "",
    ];
    let text = written(&run(&paths.map(|path| picture(path, None))), Some(folder.path()));
    assert!(!text.contains("data:image"), "{text}");
    assert!(text.contains(&format!("not shown: {} pictures", paths.len())), "{text}");
    assert_eq!(text.matches("is no path within").count(), 3);
}

#[test]
fn colours_are_explained_by_the_scale_of_the_record() {
    let folder = tempfile::tempdir().unwrap();
    save(folder.path(), "a.png", [8, 8]);
    let span = ErrorSpan::new(0.25, [0.1, -0.6, f64::NAN]);
    let scales = [
        PictureScale::Visibility,
        PictureScale::OcclusionError(span),
        PictureScale::IrradianceError(span),
    ];
    let text =
        written(&run(&scales.map(|scale| picture("a.png", Some(scale)))), Some(folder.path()));
    for expected in
        ["white is A = 0", "Red is too dark", "Red is too bright", "±0.250", "largest error 0.600"]
    {
        assert!(text.contains(expected), "{expected}: {text}");
    }
}

#[test]
fn only_parameters_that_differ_are_told() {
    let records = run(&[picture("a", None), picture("b", None)]);
    let view = Report::new(&records, None);
    let section = view.sections.iter().find(|section| section.id == "uw-photons").unwrap();
    let embedded = || Embedded { uri: String::new(), own_px: [1; 2], shown_px: [1; 2] };
    let cells = section
        .measured()
        .flat_map(|(cell, measured)| measured.pictures.iter().map(move |p| (cell, p)));
    let shown: Vec<PagePicture<'_>> =
        cells.map(|(cell, picture)| PagePicture { cell, picture, embedded: embedded() }).collect();
    let differing = differing(&shown);
    assert_eq!(differing.len(), 1, "{differing:?}");
    let captions: Vec<String> =
        shown.iter().map(|one| caption(section.experiment.as_ref(), one, &differing)).collect();
    assert_ne!(captions[0], captions[1]);
}

#[test]
fn without_a_folder_of_pictures_there_is_no_section() {
    assert_eq!(written(&run(&[picture("a.png", None)]), None), "");
    let folder = tempfile::tempdir().unwrap();
    assert_eq!(written(&run(&[picture("renders/a.png", None)]), Some(folder.path())), "");
}
