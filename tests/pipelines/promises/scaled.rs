//! No length is absolute: a scene whose lengths are a power of two times as long gives the same picture. Such a factor changes no digit
//! of a 32-bit float, so code that computes with shares and ratios finds the very same pixels.

use std::fmt::Write as _;
use std::path::Path;

use fathom::gpu::{Gpu, read_texture};
use fathom::parameter;
use fathom::pipelines::{KINDS, apply};
use fathom::scene::{LightKind, Mesh, Scene, SceneFile, Water};
use serde_json::{Value, json};

use crate::common::{Place, sets};
use crate::gpu;

const FACTORS: [f64; 4] = [0.125, 8.0, 1.0 / 128.0, 128.0];
/// Share of the pixels that may differ, by rounding.
const ROUNDED: f64 = 1e-3;

/// A line for each pipeline: its name; scenes; settings that make it cheap; and others, of which each round of draws takes the next.
const CASES: &str = "\
underwater;pool plane tank dolphin bunny port;shadow.size=192 surface.cells=24 caustics.grid=24 godrays.grid=12;\
compose.occlusion_taps=8|compose.add_caustics=true photons_fitted=false|caustics.intensity=conserving godrays.intensity=conserving|\
caustics.coverage=square light.kind=point|caustics.estimator=paper godrays.estimator=paper|water.fresnel=true
photon_tracing;pool specular cornell tank port;shadow.size=128 surface.cells=24 transfer.grid=[32,32] ldi.layers=4;\
light.kind=point|rays.method=march|rays.test=tolerance|specular.follow=true|sprites.plane=screen|rays.test=in_out
planar;planar_pool;surface.cells=24 planar.texels=32 transfer.grid=[64,64];shadow.size=128
shadow_rays;crates tree_shadow bunny_shadow cornell;ldi.layers=4;\
rays.method=march|rays.test=tolerance receivers_only=true|rays.test=in_out
refraction;glass_teapot_small specular glass_bunny;ldi.layers=2;\
refraction.method=trace|refraction.method=two_interface|refraction.surface=depth|refraction.surface=all_depths
volume_ao;crates room corner glass level;voxel.resolution=32 ao.rays=8 shadow.size=128;\
ao.attenuation=hard|voxel.method=slicemap|voxel.method=max_alpha ao.occluder=opacity|ao.skipping=true|\
animation.deform=wave animation.time_s=0.4
hsao;crates room corner slab;hsao.directions=6 hsao.steps=6 shadow.size=128;\
hsao.attenuation=hard|hsao.scale=0.5|animation.deform=twist animation.time_s=0.4
gtao;crates room corner slab;gtao.steps=5 shadow.size=128;\
gtao.occluders=horizons gtao.fall=0.2|gtao.sectors=uniform|gtao.scale=0.5 gtao.window=square
scalar_ao;smoke engine bonsai;volume.reduce=8 scalar.rays=6;\
scalar.mode=isosurface|scalar.mode=direct|scalar.mode=positional scalar.law=beer|scalar.gather=opacity
voxelize;crates room bricks;voxel.resolution=32;\
voxel.method=slice|voxel.method=overlap|animation.deform=spin animation.time_s=0.3";

/// The scene with lengths `by` times as long and coefficients per metre as many times smaller; its meshes are written into `folder`.
fn scaled(scene: &str, set: &str, by: f64, folder: &Path) -> SceneFile {
    let file = SceneFile::load(scene).unwrap();
    let built = Scene::build(&SceneFile { volume: None, ..file.clone() });
    let objects = built.iter().flat_map(|scene| &scene.objects).map(|object| {
        let name = format!("{}.obj", object.name);
        std::fs::write(folder.join(&name), obj(&object.mesh, by as f32)).unwrap();
        json!({ "name": object.name, "file": name, "material": object.material, "transform": { "on": "surface" } })
    });
    let mut tree = serde_json::to_value(&file).unwrap();
    tree["object"] = objects.collect();
    scale("", &mut tree, by);
    let mut scaled = SceneFile { folder: folder.into(), ..serde_json::from_value(tree).unwrap() };
    // What the file does not say stays: no frame may depend on it.
    scaled.light.distance_m = file.light.distance_m;
    if file.water == Water::default() {
        scaled.water = file.water;
    }
    if scaled.light.kind == LightKind::Point || set.contains("light.kind=point") {
        scaled.light.intensity_w_sr *= by * by;
    }
    scaled
}

/// Multiplies what is named as a length, and divides what is per metre.
fn scale(name: &str, value: &mut Value, by: f64) {
    match value {
        Value::Object(map) => map.iter_mut().for_each(|(name, value)| scale(name, value, by)),
        Value::Array(items) => items.iter_mut().for_each(|item| scale(name, item, by)),
        Value::Number(number) if name.ends_with("_per_m") || name.ends_with("_rad_m") => {
            *value = (number.as_f64().unwrap() / by).into();
        }
        Value::Number(number) if name.ends_with("_m") => {
            *value = (number.as_f64().unwrap() * by).into();
        }
        _ => {}
    }
}

fn obj(mesh: &Mesh, by: f32) -> String {
    let mut text = String::new();
    for (p, [i, j, k]) in mesh.positions.iter().zip(&mesh.normals) {
        let [x, y, z] = p.map(|x| x * by);
        writeln!(text, "v {x} {y} {z}\nvn {i} {j} {k}").unwrap();
    }
    for corners in mesh.indices.chunks(3) {
        let [a, b, c] = [0, 1, 2].map(|k| corners[k] + 1);
        writeln!(text, "f {a}//{a} {b}//{b} {c}//{c}").unwrap();
    }
    text
}

fn picture(gpu: &Gpu, pipeline: &str, scene: &str, set: &str, by: f64) -> Vec<f32> {
    let place = Place::new();
    let file = scaled(scene, set, by, &place.path(""));
    let kind = KINDS.iter().find(|kind| kind.name == pipeline).unwrap();
    let mut tree = (kind.defaults)(&file);
    for (path, value) in sets(set) {
        parameter::set(&mut tree, &path, value).unwrap();
    }
    let tree = (kind.checked)(&tree).unwrap();
    let scene = Scene::build(&apply(&tree, &file).unwrap()).unwrap();
    let built = gpu.catch(|| (kind.build)(&tree, gpu, &scene)).unwrap();
    let mut frame = built.stages();
    frame.extend(built.presenting());
    gpu.run(&frame).unwrap();
    read_texture(gpu, built.image()).unwrap().data
}

/// Share of the pixels that differ between a scene and the same `by` times as large.
fn differing(gpu: &Gpu, pipeline: &str, scene: &str, set: &str, by: f64) -> f64 {
    let set = format!("view.width=64 view.height=48 {set}");
    let [one, other] = [1.0, by].map(|by| picture(gpu, pipeline, scene, &set, by));
    let differing = one.chunks(4).zip(other.chunks(4)).filter(|(a, b)| a != b).count();
    4.0 * differing as f64 / one.len() as f64
}

#[test]
fn scenes_of_all_sizes_give_the_same_picture() {
    let gpu = gpu();
    let mut found = String::new();
    for draw in 0..super::draws() as usize {
        let (case, round) = (CASES.lines().nth(draw % 9).unwrap(), draw / 9);
        let parts: Vec<&str> = case.split(';').collect();
        let next = |part: usize, by: char| parts[part].split(by).cycle().nth(round).unwrap();
        let (pipeline, scene) = (parts[0], next(1, ' '));
        let set = format!("{} {}", parts[2], next(3, '|'));
        let by = FACTORS[(draw + round) % FACTORS.len()];
        let share = differing(&gpu, pipeline, scene, &set, by);
        if share > ROUNDED {
            writeln!(found, "{draw}: {share} of {pipeline}, scene {scene} × {by}: {set}").unwrap();
        }
    }
    assert!(found.is_empty(), "pixels differ by the size of the scene:\n{found}");
    // A control: sprites of 10 cm whatever the scene.
    let absolute = "shadow.size=128 transfer.grid=[32,32] sprites.radius_m=0.1";
    assert!(differing(&gpu, "photon_tracing", "pool", absolute, 8.0) > 10.0 * ROUNDED);
}

/// Lengths were tuned in scene tank, the density of media in scene smoke: there they are what they were.
#[test]
fn tuned_lengths_stay() {
    let times = ["tank", "pool", "smoke"].map(|scene| SceneFile::load(scene).unwrap().tank_scale());
    assert_eq!(times, [1.0, 1.0, 0.177_734_375]);
}
