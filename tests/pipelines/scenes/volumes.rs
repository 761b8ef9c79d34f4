//! NIfTI-1 and raw volumes: what is read, and that bad ones give one clear line. `tests/readers` looks for panics.

use std::path::Path;

use fathom::scene::{Scene, SceneFile, Volume};
use glam::DVec3;

use super::files::{gzip, nifti};

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

fn bytes_0_to_11() -> Vec<u8> {
    let values: Vec<[u8; 1]> = (0..12).map(|i| [i]).collect();
    nifti(true, 2, &values)
}

fn with(at: usize, bytes: &[u8]) -> Vec<u8> {
    let mut file = bytes_0_to_11();
    file[at..at + bytes.len()].copy_from_slice(bytes);
    file
}

#[test]
fn every_number_type_is_read_in_both_byte_orders() {
    // 0, 1, … 11 become 0 … 1 by their least and largest value.
    let expected: Vec<f32> = (0..12).map(|i| (f64::from(i) / 11.0) as f32).collect();
    macro_rules! same {
        ($($datatype:literal $number:ty),*) => {$(
            for little in [true, false] {
                let values: Vec<_> = (0..12u8).map(|i| <$number>::from(i as i8 as $number).to_le_bytes()).collect();
                let volume = read("a.nii", &nifti(little, $datatype, &values), "").unwrap();
                assert_eq!(volume.data, expected, "{}", stringify!($number));
                assert_eq!(volume.cells, [2, 3, 2]);
            }
        )*};
    }
    same!(2 u8, 4 i16, 8 i32, 16 f32, 64 f64, 256 i8, 512 u16, 768 u32, 1024 i64, 1280 u64);
}

#[test]
fn a_nifti_volume_has_its_size_and_stands_on_the_floor() {
    let volume = read("a.nii", &bytes_0_to_11(), "").unwrap();
    let bounds = volume.bounds();
    assert!((bounds.size() - DVec3::new(0.002, 0.006, 0.006)).length() < 1e-9);
    assert!((bounds.min - DVec3::new(-0.001, -2.0, -0.003)).length() < 1e-9);
    let packed = read("a.nii.gz", &gzip(&bytes_0_to_11()), "fit_m = 3").unwrap();
    assert_eq!(packed.data, volume.data);
    assert!((packed.bounds().size().max_element() - 3.0).abs() < 1e-9);
    let metres = read("a.nii", &with(123, &[1]), "").unwrap();
    assert!((metres.bounds().size().y - 6.0).abs() < 1e-9);
}

#[test]
fn scaling_windows_turning_and_reducing() {
    // Twice the value and ten more, shown from 12 to 14: values 1 to 2.
    let mut scaled = with(112, &2f32.to_le_bytes());
    scaled[116..120].copy_from_slice(&10f32.to_le_bytes());
    let volume = read("a.nii", &scaled, "window = [12, 14]").unwrap();
    assert_eq!(volume.data[..4], [0.0, 0.0, 1.0, 1.0]);
    // The header's own window.
    let mut calibrated = with(124, &4f32.to_le_bytes());
    calibrated[128..132].copy_from_slice(&2f32.to_le_bytes());
    let volume = read("a.nii", &calibrated, "").unwrap();
    assert_eq!(volume.data[..5], [0.0, 0.0, 0.0, 0.5, 1.0]);
    let upright = read("a.nii", &bytes_0_to_11(), "up = \"z\"").unwrap();
    assert_eq!(upright.cells, [2, 2, 3]);
    assert!((upright.spacing_m - DVec3::new(1e-3, 3e-3, 2e-3)).length() < 1e-9);
    let reduced = read("a.nii", &bytes_0_to_11(), "reduce = 2\nwindow = [0, 255]").unwrap();
    assert_eq!(reduced.cells, [1, 2, 1]);
    assert!((f64::from(reduced.data[0]) * 255.0 - 4.5).abs() < 1e-5);
}

#[test]
fn a_volume_of_one_value_is_empty() {
    let volume = read("a.nii", &nifti(true, 2, &[[7]; 12]), "").unwrap();
    assert!(volume.data.iter().all(|v| *v == 0.0));
}

#[test]
fn faulty_headers_are_told_by_their_field() {
    let told = |at: usize, bytes: &[u8]| fault("a.nii", &with(at, bytes), "");
    assert!(told(0, &[1, 2, 3, 4]).contains("sizeof_hdr = 67305985 must be 348"));
    assert!(told(0, &540i32.to_le_bytes()).contains("NIfTI-2"));
    assert!(told(344, b"ni1\0").contains("two files"));
    assert!(told(344, b"\xffxyz").contains("magic \\xffxyz must be n+1"));
    assert!(told(40, &2i16.to_le_bytes()).contains("dim[0] = 2"));
    assert!(told(40, &(-1i16).to_le_bytes()).contains("dim[0] = -1"));
    assert!(told(44, &0i16.to_le_bytes()).contains("dim[2] = 0"));
    assert!(told(46, &(-3i16).to_le_bytes()).contains("dim[3] = -3"));
    let mut series = with(40, &4i16.to_le_bytes());
    series[48..50].copy_from_slice(&20i16.to_le_bytes());
    assert!(fault("a.nii", &series, "").contains("dim[4] = 20"));
    assert!(told(70, &128i16.to_le_bytes()).contains("datatype = 128"));
    assert!(told(72, &16i16.to_le_bytes()).contains("bitpix = 16 must be 8"));
    assert!(told(84, &0f32.to_le_bytes()).contains("pixdim[2] = 0"));
    assert!(told(88, &f32::NAN.to_le_bytes()).contains("pixdim[3] = NaN"));
    assert!(told(108, &100f32.to_le_bytes()).contains("vox_offset = 100"));
    assert!(told(108, &f32::INFINITY.to_le_bytes()).contains("vox_offset = inf"));
    assert!(told(112, &f32::NAN.to_le_bytes()).contains("scl_slope = NaN"));
    assert!(told(123, &[7]).contains("xyzt_units"));
}

#[test]
fn truncated_and_empty_files_are_told_in_numbers() {
    let whole = bytes_0_to_11();
    let cut = |length: usize| fault("a.nii", &whole[..length], "");
    assert!(cut(0).contains("empty"));
    assert!(cut(100).contains("100 bytes: a NIfTI-1 header alone has 348"));
    assert!(cut(348).contains("0 bytes of data"));
    assert!(cut(360).contains("8 bytes of data") && cut(360).contains("take 12"));
    let large = with(42, &[0xff, 0x7f, 0xff, 0x7f, 0xff, 0x7f]);
    assert!(fault("a.nii", &large, "").contains("32767 × 32767 × 32767 cells: at most"));
    let packed = gzip(&whole);
    for length in [3, 12, packed.len() - 9] {
        fault("a.nii.gz", &packed[..length], "");
    }
    let missing = scene(Path::new("/no/such/folder"), "a.nii", "").unwrap_err();
    assert!(missing.contains("cannot read the volume"), "{missing}");
}

#[test]
fn values_that_are_not_finite_are_counted_and_the_first_named() {
    let mut values: Vec<[u8; 4]> = (0..12).map(|i| (i as f32).to_le_bytes()).collect();
    values[7] = f32::NAN.to_le_bytes();
    values[9] = f32::NAN.to_le_bytes();
    let told = fault("a.nii", &nifti(true, 16, &values), "");
    let counted = "2 of 12 values are not finite: the first, NaN, lies in cell (1, 0, 1)";
    assert!(told.contains(counted), "{told}");
    let raw: Vec<u8> = values.into_iter().flatten().collect();
    let told = fault("a.raw", &raw, "cells = [2, 3, 2]\nformat = \"f32\"");
    assert!(told.contains("cell (1, 0, 1)"), "{told}");
}

#[test]
fn raw_files_are_read_plain_and_compressed() {
    let keys = "cells = [2, 3, 2]\nformat = \"u8\"\nspacing_m = [0.1, 0.2, 0.3]";
    let bytes: Vec<u8> = (0..12).map(|i| i * 20).collect();
    let volume = read("a.raw", &bytes, keys).unwrap();
    assert_eq!(volume.data[11], (220.0f64 / 255.0) as f32);
    assert_eq!(volume.spacing_m, DVec3::new(0.1, 0.2, 0.3));
    let packed = read("a.raw.gz", &gzip(&bytes), keys).unwrap();
    assert_eq!(packed.data, volume.data);
    let wide: Vec<u8> = (0..12u16).flat_map(|i| (i * 4000).to_le_bytes()).collect();
    let keys = "cells = [2, 3, 2]\nformat = \"u16\"\nwindow = [0, 44000]";
    let volume = read("a.raw", &wide, keys).unwrap();
    assert_eq!((volume.data[0], volume.data[11]), (0.0, 1.0));
    assert!((volume.bounds().size().max_element() - 1.0).abs() < 1e-12);
}

#[test]
fn raw_files_that_do_not_match_are_told() {
    let told = |keys: &str| read("a.raw", &[0; 12], keys).expect_err("a fault");
    let wrong = told("cells = [2, 3, 3]\nformat = \"u8\"");
    assert!(wrong.contains("12 bytes, but 2 × 3 × 3 cells of 1 bytes take 18"), "{wrong}");
    assert!(told("").contains("a raw file needs `cells` and `format`"));
    assert!(told("cells = [2, 3, 2]").contains("needs both"));
    assert!(told("format = \"u8\"").contains("needs both"));
    let format = told("cells = [2, 3, 2]\nformat = \"u9\"");
    assert!(format.contains("there are: u8, u16, f32"), "{format}");
    assert!(told("cells = [0, 3, 2]\nformat = \"u8\"").contains("volume.cells"));
    assert!(told("params = { seed = 1 }").contains("volume.params belongs to a `generator`"));
    assert!(told("window = [1, 1]").contains("volume.window"));
    assert!(told("reduce = 0").contains("volume.reduce"));
    assert!(told("spacing_m = [1, -1, 1]").contains("volume.spacing_m"));
    let told = fault("a.nii", &bytes_0_to_11(), "cells = [2, 3, 2]\nformat = \"u8\"");
    assert!(told.contains("leave them out"), "{told}");
}
