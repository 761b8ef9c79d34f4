//! Adapters that are not at hand: their limits and features, as the most of what the one at hand may give.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use fathom_base::text::{did_you_mean, nearest};
use fathom_record::{Feature, Mask};
use serde::Deserialize;

use super::GpuError;

/// What an adapter of some kind has.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    pub about: String,
    base: Option<Base>,
    #[serde(default)]
    limits: StatedLimits,
    /// All if it is not there.
    features: Option<Vec<Feature>>,
}

/// A set of limits of wgpu.
#[derive(Clone, Copy, Debug, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Base {
    Webgpu,
    Downlevel,
    Webgl2,
}

impl Base {
    fn limits(self) -> wgpu::Limits {
        match self {
            Self::Webgpu => wgpu::Limits::defaults(),
            Self::Downlevel => wgpu::Limits::downlevel_defaults(),
            Self::Webgl2 => wgpu::Limits::downlevel_webgl2_defaults(),
        }
    }
}

/// Limits that a profile may state, under wgpu's names. Of all of them more is better.
macro_rules! stated_limits {
    ($($name:ident: $number:ty),* $(,)?) => {
        #[derive(Debug, Default, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        struct StatedLimits { $($name: Option<$number>,)* }

        impl StatedLimits {
            fn lower(&self, limits: &mut wgpu::Limits) {
                $(limits.$name = limits.$name.min(self.$name.unwrap_or(limits.$name));)*
            }
        }
    };
}

stated_limits! {
    max_texture_dimension_1d: u32,
    max_texture_dimension_2d: u32,
    max_texture_dimension_3d: u32,
    max_texture_array_layers: u32,
    max_samplers_per_shader_stage: u32,
    max_sampled_textures_per_shader_stage: u32,
    max_storage_textures_per_shader_stage: u32,
    max_storage_buffers_per_shader_stage: u32,
    max_uniform_buffers_per_shader_stage: u32,
    max_buffers_and_acceleration_structures_per_shader_stage: u32,
    max_uniform_buffer_binding_size: u64,
    max_buffer_size: u64,
    max_vertex_buffers: u32,
    max_vertex_attributes: u32,
    max_vertex_buffer_array_stride: u32,
    max_inter_stage_shader_variables: u32,
    max_color_attachments: u32,
    max_color_attachment_bytes_per_sample: u32,
    max_compute_workgroup_storage_size: u32,
    max_compute_invocations_per_workgroup: u32,
    max_compute_workgroup_size_x: u32,
    max_compute_workgroup_size_y: u32,
    max_compute_workgroup_size_z: u32,
    max_compute_workgroups_per_dimension: u32,
}

/// The kinds of adapters that can be asked for, by name.
pub fn profiles() -> &'static BTreeMap<String, Profile> {
    static PROFILES: LazyLock<BTreeMap<String, Profile>> = LazyLock::new(|| {
        toml::from_str(include_str!("adapters.toml")).expect("a test reads the table")
    });
    &PROFILES
}

/// The profile of this name.
///
/// # Errors
/// One line that names all that there are.
pub fn profile(name: &str) -> Result<&'static Profile, GpuError> {
    let all = profiles();
    all.get(name).ok_or_else(|| {
        let names: Vec<&str> = all.keys().map(String::as_str).collect();
        let meant = did_you_mean(&nearest(name, names.iter().copied()));
        let message = format!("no kind of adapter `{name}`{meant}: there are {}", names.join(", "));
        GpuError::Unusable(message)
    })
}

/// The limits and features of an adapter that a mask leaves.
///
/// # Errors
/// A profile that there is none of.
pub(super) fn masked(
    mask: &Mask,
    mut limits: wgpu::Limits,
    mut features: wgpu::Features,
) -> Result<(wgpu::Limits, wgpu::Features), GpuError> {
    if let Some(name) = &mask.like {
        let profile = profile(name)?;
        if let Some(base) = profile.base {
            limits = limits.or_worse_values_from(&base.limits());
        }
        profile.limits.lower(&mut limits);
        if let Some(known) = &profile.features {
            features &= all_of(known);
        }
    }
    features.remove(all_of(&mask.without));
    if !features.contains(wgpu::Features::TIMESTAMP_QUERY) {
        features.remove(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);
    }
    Ok((limits, features))
}

/// These features under wgpu's names.
pub(super) fn all_of(features: &[Feature]) -> wgpu::Features {
    features.iter().fold(wgpu::Features::empty(), |all, feature| all | of(*feature))
}

/// wgpu's name of a feature.
pub(super) fn of(feature: Feature) -> wgpu::Features {
    match feature {
        Feature::TimestampQuery => wgpu::Features::TIMESTAMP_QUERY,
        Feature::TimestampQueryInsideEncoders => wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS,
        Feature::PipelineStatisticsQuery => wgpu::Features::PIPELINE_STATISTICS_QUERY,
        Feature::Float32Blendable => wgpu::Features::FLOAT32_BLENDABLE,
        Feature::Float32Filterable => wgpu::Features::FLOAT32_FILTERABLE,
    }
}
