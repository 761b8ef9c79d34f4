//! No length is absolute: a scene whose lengths are a power of two times as long gives the same picture. Such a factor changes no digit
//! of a 32-bit float, so that code which computes with shares and ratios computes the same.

use std::fmt::Write as _;
use std::path::Path;

use fathom::gpu::{Gpu, read_texture};
use fathom::parameter;
use fathom::pipelines::{KINDS, PipelineKind, staged};
use fathom::scene::{LightKind, Mesh, ObjectFile, Scene, SceneFile, Stand, Transform};
use serde_json::Value;

use crate::common::{Place, sets};
use crate::gpu;

const FACTORS: [f64; 4] = [0.125, 8.0, 1.0 / 128.0, 128.0];
/// Share of the pixels that may differ, by rounding.
const ROUNDED: f64 = 1e-3;

/// A pipeline, scenes of its kind, the first of few triangles, settings that make it cheap, and others that a draw takes or not.
struct Case(&'static str, &'static [&'static str], &'static str, &'static [&'static str]);

const CASES: [Case; 9] = [
    Case(
        "underwater",
        &["pool", "plane", "tank", "dolphin", "bunny", "port"],
        "shadow.size=192 surface.cells=24 caustics.grid=24 caustics.buffer=[48,36] godrays.grid=12 godrays.buffer=[24,18]",
        &[
            "compose.occlusion_taps=8",
            "caustics.method=mesh",
            "caustics.intensity=conserving godrays.intensity=conserving",
            "caustics.coverage=square",
            "caustics.estimator=paper godrays.estimator=paper",
            "water.fresnel=true",
        ],
    ),
    Case(
        "photon_tracing",
        &["pool", "specular", "cornell", "tank", "port"],
        "shadow.size=128 surface.cells=24 transfer.grid=[32,32] ldi.layers=4",
        &[
            "rays.test=tolerance",
            "rays.method=march",
            "specular.follow=true",
            "sprites.plane=screen",
            "surface.draw=false",
            "rays.test=in_out",
        ],
    ),
    Case(
        "planar",
        &["planar_pool"],
        "shadow.size=128 surface.cells=24 planar.texels=32 transfer.grid=[64,64]",
        &[],
    ),
    Case(
        "shadow_rays",
        &["crates", "tree_shadow", "bunny_shadow", "cornell", "corner"],
        "ldi.layers=4",
        &["rays.test=tolerance", "rays.method=march", "rays.test=in_out", "ldi.method=lists"],
    ),
    Case(
        "refraction",
        &["glass_teapot_small", "glass", "glass_bunny"],
        "",
        &["refraction.method=two_interface", "refraction.surface=depth"],
    ),
    Case(
        "volume_ao",
        &["crates", "room", "corner", "glass", "level"],
        "voxel.resolution=32 ao.rays=8 shadow.size=128",
        &[
            "voxel.method=slicemap",
            "voxel.method=max_alpha ao.occluder=opacity",
            "ao.skipping=true",
            "animation.deform=wave animation.time_s=0.4",
        ],
    ),
    Case(
        "hsao",
        &["crates", "room", "corner", "slab"],
        "hsao.directions=6 hsao.steps=6 shadow.size=128",
        &["hsao.scale=0.5", "animation.deform=twist animation.time_s=0.4"],
    ),
    Case(
        "scalar_ao",
        &["smoke", "engine", "bonsai"],
        "volume.cells=[24,16,24] scalar.rays=6",
        &[
            "scalar.mode=direct",
            "scalar.mode=positional",
            "scalar.law=beer",
            "scalar.gather=opacity",
        ],
    ),
    Case(
        "voxelize",
        &["crates", "room", "bricks"],
        "voxel.resolution=32",
        &[
            "voxel.method=slice",
            "voxel.method=overlap_thin",
            "animation.deform=spin animation.time_s=0.3",
        ],
    ),
];

/// A scene file with lengths `by` times as long, intensities and coefficients so that radiances stay, and its meshes in `folder`.
fn scaled(scene: &str, by: f64, folder: &Path) -> SceneFile {
    let mut file = SceneFile::load(scene).unwrap();
    let built = Scene::build(&SceneFile { volume: None, ..file.clone() });
    let objects = built.map_or(Vec::new(), |scene| scene.objects);
    let lengths = |lengths: &mut [f64]| lengths.iter_mut().for_each(|m| *m *= by);
    file.objects = objects
        .iter()
        .enumerate()
        .map(|(index, object)| {
            let name = format!("{index}.obj");
            std::fs::write(folder.join(&name), obj(&object.mesh, by as f32)).unwrap();
            let mut material = object.material.clone();
            material.tile_m *= by as f32;
            ObjectFile {
                name: object.name.clone(),
                generator: None,
                asset: None,
                file: Some(name.into()),
                params: [].into(),
                transform: Transform { on: Stand::Surface, ..Transform::default() },
                material,
            }
        })
        .collect();
    file.folder = folder.into();
    if let Some(volume) = &mut file.volume {
        volume.fit_m = by * if volume.fit_m == 0.0 { 1.0 } else { volume.fit_m };
        lengths(&mut volume.translate_m);
    }
    file.floor_depth_m *= by;
    let camera = &mut file.camera;
    lengths(&mut camera.position_m);
    lengths(&mut camera.target_m);
    lengths(&mut [&mut camera.z_near_m, &mut camera.z_far_m].map(|m| {
        *m *= by;
        *m
    }));
    let light = &mut file.light;
    lengths(&mut light.position_m);
    light.distance_m *= by;
    light.half_extent_m *= by;
    if light.kind == LightKind::Point {
        light.intensity_w_sr *= by * by;
    }
    let water = &mut file.water;
    for m in [&mut water.amplitude_m, &mut water.wavelength_m, &mut water.noise_tile_m] {
        *m *= by;
    }
    water.attenuation_per_m /= by;
    lengths(&mut water.center_m);
    lengths(&mut water.half_size_m);
    for wave in &mut water.waves {
        wave.amplitude_m *= by;
        wave.wavelength_m.iter_mut().for_each(|m| *m *= by);
        wave.vector_rad_m.iter_mut().flatten().for_each(|k| *k /= by);
    }
    file
}

fn obj(mesh: &Mesh, by: f32) -> String {
    let mut text = String::new();
    for ([x, y, z], [i, j, k]) in
        mesh.positions.iter().map(|p| p.map(|x| x * by)).zip(&mesh.normals)
    {
        writeln!(text, "v {x} {y} {z}\nvn {i} {j} {k}").unwrap();
    }
    for corners in mesh.indices.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|k| corners[k] + 1);
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}").unwrap();
    }
    text
}

/// The picture of a scene at a scale; none where the pipeline refuses the settings.
fn picture(gpu: &Gpu, kind: &PipelineKind, scene: &str, set: &str, by: f64) -> Option<Vec<f32>> {
    let place = Place::new();
    let file = scaled(scene, by, &place.path(""));
    let mut tree = (kind.defaults)(&file);
    for (path, value) in sets(set) {
        parameter::set(&mut tree, &path, value).unwrap();
    }
    let tree: Value = (kind.checked)(&tree).ok()?;
    let scene = Scene::build(&staged(&tree, &file).unwrap()).unwrap();
    let built = gpu.scoped(|| (kind.build)(&tree, gpu, &scene)).ok()?;
    let mut frame = built.stages();
    frame.extend(built.presenting());
    gpu.run(&frame).unwrap();
    Some(read_texture(gpu, built.image()).unwrap().data)
}

/// Share of the pixels that differ between two scales.
fn differing(gpu: &Gpu, kind: &PipelineKind, scene: &str, set: &str, by: f64) -> Option<f64> {
    let [one, other] = [1.0, by].map(|by| picture(gpu, kind, scene, set, by));
    let (one, other) = (one?, other?);
    let differing = one.chunks(4).zip(other.chunks(4)).filter(|(a, b)| a != b).count();
    Some(differing as f64 * 4.0 / one.len() as f64)
}

fn kind(name: &str) -> &'static PipelineKind {
    KINDS.iter().find(|kind| kind.name == name).unwrap()
}

#[test]
fn scenes_of_all_sizes_give_the_same_picture() {
    let gpu = gpu();
    let mut found = Vec::new();
    for draw in 0..super::draws() {
        let Case(name, scenes, cheap, others) = &CASES[draw as usize % CASES.len()];
        let round = draw as usize / CASES.len();
        let scene = scenes[round % scenes.len()];
        let by = FACTORS[(draw as usize + round) % FACTORS.len()];
        let mut set = format!("view.width=64 view.height=48 {cheap}");
        if round > 0 && !others.is_empty() {
            write!(set, " {}", others[round % others.len()]).unwrap();
        }
        let share = differing(&gpu, kind(name), scene, &set, by);
        println!("{draw}: {name} of {scene} × {by}: {share:?} {set}");
        if share.is_some_and(|share| share > ROUNDED) {
            found.push(format!(
                "{draw}: {share:?} of the pixels of {name}, scene {scene} × {by}: {set}"
            ));
        }
    }
    assert!(found.is_empty(), "{found:#?}");
}
