//! Volumes from files: what is read, and that bad ones give one clear line. `tests/readers` looks for panics.

use std::path::Path;

use fathom::scene::{Scene, SceneFile, Volume};

use super::files::gzip;

/// A scene that is a volume file, with these further keys of `[volume]`.
fn scene(folder: &Path, name: &str, keys: &str) -> Result<Scene, String> {
    let text = format!(
        "name = \"test\"\ndescription = \"test\"\nfloor_depth_m = 2.0\n\
         [camera]\nposition_m = [0, -1, 3]\ntarget_m = [0, -1, 0]\nfov_y_deg = 60\nz_near_m = 0.1\nz_far_m = 9\n\
         [volume]\nfile = \"{name}\"\n{keys}\n"
    );
    let origin = folder.join("test.toml");
    let file = SceneFile::parse(&origin.to_string_lossy(), &text).map_err(|e| e.to_string())?;
    Scene::build(&file).map_err(|e| e.to_string())
}

fn read(name: &str, bytes: &[u8], keys: &str) -> Result<Volume, String> {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join(name), bytes).unwrap();
    let scene = scene(folder.path(), name, keys)?;
    assert!(scene.objects.is_empty());
    let volume = scene.volume.expect("a volume");
    assert_eq!(scene.bounds.union(volume.bounds()), scene.bounds);
    assert_eq!(volume.name, name);
    volume.validate()?;
    Ok(volume)
}

/// The error's one line, which names the file.
fn fault(name: &str, bytes: &[u8], keys: &str) -> String {
    let error = read(name, bytes, keys).expect_err("a fault");
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(error.contains(name), "{error}");
    error
}

/// Keys of a file of 2 × 3 × 2 bytes.
const BYTES: &str = "cells = [2, 3, 2]\nformat = \"u8\"\nspacing_m = [1e-3, 2e-3, 3e-3]\n";

fn bytes_0_to_11() -> Vec<u8> {
    (0..12).collect()
}

/// What each comes to is tested in `scene::volume`.
#[test]
fn windows_turning_and_reducing() {
    let read = |keys: &str| read("a.raw", &bytes_0_to_11(), &format!("{BYTES}{keys}")).unwrap();
    assert_eq!(read("window = [1, 2]").data[..4], [0.0, 0.0, 1.0, 1.0]);
    assert_eq!(read("up = \"z\"").cells, [2, 2, 3]);
    assert_eq!(read("reduce = 2").cells, [1, 2, 1]);
}

#[test]
fn truncated_files_are_told() {
    let packed = gzip(&bytes_0_to_11());
    for length in [3, 12, packed.len() - 9] {
        fault("a.raw.gz", &packed[..length], BYTES);
    }
    let missing = scene(Path::new("/no/such/folder"), "a.raw", BYTES).unwrap_err();
    assert!(missing.contains("cannot read the volume"), "{missing}");
}

#[test]
fn values_that_are_not_finite_are_counted_and_the_first_named() {
    let mut values: Vec<[u8; 4]> = (0..12).map(|i| (i as f32).to_le_bytes()).collect();
    values[7] = f32::NAN.to_le_bytes();
    values[9] = f32::NAN.to_le_bytes();
    let raw: Vec<u8> = values.into_iter().flatten().collect();
    let message = fault("a.raw", &raw, "cells = [2, 3, 2]\nformat = \"f32\"");
    let counted = "2 of 12 values are not finite: the first, NaN, lies in cell (1, 0, 1)";
    assert!(message.contains(counted), "{message}");
}

/// Formats with headers are not read: of those with values in them, these are.
#[test]
fn files_with_headers_are_told_how_to_be_read() {
    for name in ["a.nrrd", "a.mha", "a.mhd", "A.NHDR"] {
        let message = fault(name, b"ObjectType = Image\n", "");
        for key in ["cells", "format", "endian", "spacing_m", "skip_bytes"] {
            assert!(message.contains(&format!("`{key}`")), "{name}: {message}");
        }
    }
    let keys = "cells = [2, 1, 1]\nformat = \"i16\"\nendian = \"big\"\nwindow = [-1000, 3000]\nskip_bytes = 7";
    let read = read("a.nrrd", b"NRRD\n\n\n\xfc\x18\x03\xe8", keys).unwrap();
    assert_eq!(read.data, [0.0, 0.5]);
    assert!((read.bounds().size().max_element() - 1.0).abs() < 1e-12);
}

#[test]
fn raw_files_that_do_not_match_are_told() {
    let told = |keys: &str| read("a.raw", &[0; 12], keys).expect_err("a fault");
    let wrong = told("cells = [2, 3, 3]\nformat = \"u8\"");
    assert!(wrong.contains("12 bytes, but 2 × 3 × 3 cells of 1 bytes take 18"), "{wrong}");
    assert!(told("").contains("needs both"));
    assert!(told("cells = [2, 3, 2]").contains("needs both"));
    assert!(told("format = \"u8\"").contains("needs both"));
    let format = told("cells = [2, 3, 2]\nformat = \"u9\"");
    assert!(format.contains("there are: u8, i8, u16, i16, f32"), "{format}");
    assert!(
        told("cells = [2, 3, 2]\nformat = \"i16\"\nskip_bytes = 2")
            .contains("10 bytes after the 2 of")
    );
    assert!(told("window = [1, 1]").contains("volume.window"));
    assert!(told("reduce = 0").contains("volume.reduce"));
    assert!(told("spacing_m = [1, -1, 1]").contains("volume.spacing_m"));
}
