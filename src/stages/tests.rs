use encase::{ShaderType, internal::WriteInto};
use glam::{Mat4, UVec3, Vec2, Vec3};

use super::ao;
use super::ao::march::TargetUniforms;
use super::ao::query::Point;
use super::bilateral::BilateralUniforms;
use super::caustics::splat::SplatUniforms;
use super::compose::ComposeUniforms;
use super::frame::FrameUniforms;
use super::geometry::MaterialUniforms;
use super::godrays::lines::LinesUniforms;
use super::hsao::march::MarchUniforms as HorizonUniforms;
use super::low_pass::FilterUniforms;
use super::marching::MarchUniforms;
use super::photon::{Photon, TraceUniforms};
use super::photons::query::{Answer, Start};
use super::ray_cast::MarchUniforms as CastUniforms;
use super::scalar_field::FieldUniforms;
use super::scene::deform::{DeformUniforms, PivotUniforms};
use super::shadow::mask::MaskUniforms;
use super::voxel::mips::LevelUniforms;
use super::voxel::triangles::BatchUniforms;
use super::voxels::GridUniforms;
use super::{REGISTRY, kit};
use crate::gpu::{shader_paths, wgsl_layout};

/// Holds a host struct, whose n-th field starts with the number n (counted from 1), against the WGSL struct:
/// names in order, offsets and size.
fn same_layout<T: ShaderType + WriteInto>(shader: &str, name: &str, fields: &[&str], value: &T) {
    let layout = wgsl_layout(shader, name).unwrap();
    let names: Vec<&str> = layout.members.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, fields, "{shader}: {name}");
    let bytes = kit::host_bytes(value);
    assert_eq!(bytes.len() as u32, layout.span, "{shader}: size of {name}");
    for ((field, offset), number) in layout.members.iter().zip(1u32..) {
        let word = &bytes[*offset as usize..][..4];
        let word = u32::from_le_bytes([word[0], word[1], word[2], word[3]]);
        assert!(
            word == number || f32::from_bits(word) == number as f32,
            "{shader}: {name}.{field} is not at byte {offset} on the host"
        );
    }
}

fn vec2(first: f32) -> Vec2 {
    Vec2::new(first, 0.0)
}

fn vec3(first: f32) -> Vec3 {
    Vec3::new(first, 0.0, 0.0)
}

/// A struct whose n-th field starts with n, and its fields' names.
macro_rules! numbered {
    ($type:ident { $($field:ident: $value:expr),* $(,)? }) => {
        ([$(stringify!($field)),*], $type { $($field: $value),* })
    };
}

#[test]
fn frame_uniforms_equal_their_wgsl_twin() {
    let mat = |first: f32| Mat4::from_diagonal(glam::Vec4::splat(first));
    let (fields, value) = numbered!(FrameUniforms {
        camera_view_projection: mat(1.0),
        camera_inverse: mat(2.0),
        mirror_view_projection: mat(3.0),
        light_view_projection: mat(4.0),
        light_inverse: mat(5.0),
        camera_position_m: vec3(6.0),
        z_near_m: 7.0,
        light_forward: vec3(8.0),
        z_far_m: 9.0,
        light_position_m: vec3(10.0),
        light_is_point: 11,
        light_irradiance: 12.0,
        light_depth_jump: 13.0,
        refractive_index: 14.0,
        attenuation_per_m: 15.0,
        water_center_m: vec2(16.0),
        water_half_size_m: vec2(17.0),
        water_amplitude_m: 18.0,
        wavenumber_per_m: 19.0,
        phase: 20.0,
        noise_share: 21.0,
        noise_tile_m: 22.0,
        noise_scroll: 23.0,
        water_model: 24,
        camera_under_water: 25,
        height_tile_m: vec2(26.0),
        height_origin_m: vec2(27.0),
    });
    same_layout("shadow/depth", "Frame", &fields, &value);
}

#[test]
fn photons_and_their_settings_equal_their_wgsl_twins() {
    let (fields, value) = numbered!(Photon {
        entry_m: vec3(1.0),
        residual_m: 2.0,
        hit_m: vec3(3.0),
        distance_m: 4.0,
    });
    let (trace_fields, trace) = numbered!(TraceUniforms {
        grid: 1,
        side: 2,
        iterations: 3,
        masked: 4,
        offset: vec2(5.0),
        start_m: 6.0,
        tolerance_m: 7.0,
    });
    for shader in ["caustics/trace", "godrays/trace"] {
        same_layout(shader, "Photon", &fields, &value);
        same_layout(shader, "Trace", &trace_fields, &trace);
    }
    assert_eq!(size_of::<Photon>() as u64, Photon::min_size().get());
    let (start_fields, start) =
        numbered!(Start { position_m: vec3(1.0), aimed: 2, direction: vec3(3.0) });
    same_layout("photons/query", "Start", &start_fields, &start);
    let (answer_fields, answer) =
        numbered!(Answer { photon: value, direction: vec3(2.0), weight: 3.0 });
    same_layout("photons/query", "Answer", &answer_fields, &answer);
    assert_eq!(size_of::<Answer>() as u64, Answer::min_size().get());
}

#[test]
fn settings_of_raster_stages_equal_their_wgsl_twins() {
    let (fields, value) = numbered!(SplatUniforms {
        size_px: vec2(1.0),
        size_a_px: 2.0,
        size_b_px_m: 3.0,
        photon_w: 4.0,
        depth_bias_m: 5.0,
        photons_per_instance: 6,
        photons: 7,
    });
    same_layout("caustics/splat", "Splat", &fields, &value);
    let (fields, value) = numbered!(LinesUniforms {
        size_px: vec2(1.0),
        width_px: 2.0,
        phase_k: 3.0,
        photon_w: 4.0,
        photons_per_instance: 5,
        photons: 6,
    });
    same_layout("godrays/lines", "Lines", &fields, &value);
    let (fields, value) = numbered!(ComposeUniforms {
        size_px: vec2(1.0),
        caustics_scale: 2.0,
        godrays_scale: 3.0,
        exposure: 4.0,
        occlusion_taps: 5,
        occlusion_radius_m: 6.0,
        water_cells: 7,
    });
    same_layout("compose", "Compose", &fields, &value);
    let (fields, value) = numbered!(MaterialUniforms {
        albedo: vec3(1.0),
        tile_m: 2.0,
        accent: vec3(3.0),
        alpha: 4.0,
        specular: 5.0,
    });
    same_layout("scene/gbuffer", "Material", &fields, &value);
    let (fields, value) = numbered!(FilterUniforms { taps: 1, radius_px: 2.0 });
    same_layout("caustics/filter", "Filter", &fields, &value);
    same_layout("godrays/filter", "Filter", &fields, &value);
    let (fields, value) = numbered!(MaskUniforms { cells: 1 });
    same_layout("shadow/mask", "Mask", &fields, &value);
}

#[test]
fn settings_of_volume_occlusion_equal_their_wgsl_twins() {
    let (fields, march) = numbered!(MarchUniforms {
        r_max: 1.0,
        step: 2.0,
        guard: 3.0,
        offset: 4.0,
        threshold: 5.0,
        rays: 6,
    });
    let (grid_fields, grid) = numbered!(GridUniforms {
        origin_m: vec3(1.0),
        voxel_m: 2.0,
        cells: UVec3::new(3, 0, 0),
        words: 4,
    });
    for shader in ["ao/march", "ao/query"] {
        same_layout(shader, "March", &fields, &march);
        same_layout(shader, "Grid", &grid_fields, &grid);
    }
    let (fields, value) = numbered!(TargetUniforms { size_px: vec2(1.0) });
    same_layout("ao/march", "Target", &fields, &value);
    let (fields, value) = numbered!(Point { position_m: vec3(1.0), normal: vec3(2.0) });
    same_layout("ao/query", "Point", &fields, &value);
}

#[test]
fn scalar_fields_and_their_settings_equal_their_wgsl_twins() {
    let (field_names, field) = numbered!(FieldUniforms {
        origin_m: vec3(1.0),
        voxel_m: 2.0,
        size_m: vec3(3.0),
        guard_m: 4.0,
        spacing_m: vec3(5.0),
    });
    let (march_names, march) = numbered!(CastUniforms {
        size_px: vec2(1.0),
        window: vec2(2.0),
        low_color: vec3(3.0),
        ambient: 4.0,
        high_color: vec3(5.0),
        view_step_m: 6.0,
        iso: 7.0,
        tolerance: 8.0,
        threshold: 9.0,
        rays: 10,
        samples: 11,
        r_max_m: 12.0,
        stratum_m: 13.0,
        level: 14.0,
        opacity: 15.0,
        density_per_m: 16.0,
    });
    for shader in ["scalar/isosurface", "scalar/direct", "scalar/positional"] {
        same_layout(shader, "Field", &field_names, &field);
        same_layout(shader, "March", &march_names, &march);
    }
}

#[test]
fn settings_of_occlusion_stages_equal_their_wgsl_twins() {
    let (fields, value) = numbered!(BilateralUniforms {
        size_px: vec2(1.0),
        source_px: vec2(2.0),
        pixel_tangent: 3.0,
        taps: 4,
        radius_px: 5.0,
        sigma_px: 6.0,
        depth_sigma: 7.0,
    });
    for shader in ["ao/bilateral", "hsao/filter"] {
        same_layout(shader, "Filter", &fields, &value);
    }
    let (fields, value) = numbered!(HorizonUniforms {
        size_px: vec2(1.0),
        r_max_m: 2.0,
        layer_m: 3.0,
        directions: 4,
        steps: 5,
        rays: 6,
        ray_steps: 7,
    });
    same_layout("hsao/march", "March", &fields, &value);
    use ao::compose::ComposeUniforms;
    let (fields, value) =
        numbered!(ComposeUniforms { size_px: vec2(1.0), exposure: 2.0, ambient: 3.0 });
    same_layout("ao/compose", "Compose", &fields, &value);
}

#[test]
fn settings_of_voxel_stages_equal_their_wgsl_twins() {
    let (fields, value) = numbered!(GridUniforms {
        origin_m: vec3(1.0),
        voxel_m: 2.0,
        cells: UVec3::new(3, 0, 0),
        words: 4,
    });
    for shader in ["voxel/slicemap", "voxel/combine", "voxel/overlap"] {
        same_layout(shader, "Grid", &fields, &value);
    }
    let (fields, value) = numbered!(BatchUniforms {
        first_index: 1,
        triangles: 2,
        small_columns: 3,
        large_columns: 4,
    });
    same_layout("voxel/overlap", "Batch", &fields, &value);
    same_layout("voxel/alpha", "Batch", &fields, &value);
    let (fields, value) = numbered!(LevelUniforms {
        below: UVec3::new(1, 0, 0),
        below_word: 2,
        size: UVec3::new(3, 0, 0),
        size_word: 4,
    });
    same_layout("voxel/mips", "Level", &fields, &value);
    let (fields, value) = numbered!(DeformUniforms { vertices: 1, cycles: 2.0, amplitude: 3.0 });
    same_layout("scene/deform", "Deform", &fields, &value);
    let (fields, value) = numbered!(PivotUniforms { foot_m: vec3(1.0), height_m: 2.0 });
    same_layout("scene/deform", "Pivot", &fields, &value);
}

#[test]
fn every_stage_with_a_shader_bears_its_stem() {
    for path in shader_paths() {
        let own = path.starts_with("audit/") || path.starts_with("shared/");
        // Stages that differ in a suffix share a shader.
        let bears = |name: &str| {
            let rest = name.strip_prefix(path.as_str());
            rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
        };
        let named = REGISTRY.iter().any(|stage| bears(stage.name));
        assert!(own || named, "no stage is named after shaders/{path}.wgsl");
    }
}
