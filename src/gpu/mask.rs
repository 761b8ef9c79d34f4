//! Features that are not used though the adapter has them.

use fathom_record::{Feature, Mask};

/// The features of an adapter that a mask leaves.
pub(super) fn apply(mask: &Mask, mut features: wgpu::Features) -> wgpu::Features {
    features.remove(all_to_wgpu(&mask.without));
    if !features.contains(wgpu::Features::TIMESTAMP_QUERY) {
        features.remove(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);
    }
    features
}

pub(super) fn all_to_wgpu(features: &[Feature]) -> wgpu::Features {
    features.iter().fold(wgpu::Features::empty(), |all, feature| all | to_wgpu(*feature))
}

pub(super) fn to_wgpu(feature: Feature) -> wgpu::Features {
    match feature {
        Feature::TimestampQuery => wgpu::Features::TIMESTAMP_QUERY,
        Feature::TimestampQueryInsideEncoders => wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS,
        Feature::PipelineStatisticsQuery => wgpu::Features::PIPELINE_STATISTICS_QUERY,
        Feature::Float32Blendable => wgpu::Features::FLOAT32_BLENDABLE,
        Feature::Float32Filterable => wgpu::Features::FLOAT32_FILTERABLE,
    }
}
