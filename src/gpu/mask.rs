//! Features that are not used though the adapter has them.

use fathom_record::{Feature, Mask};

/// The features of an adapter that a mask leaves.
pub(super) fn without(mask: &Mask, mut features: wgpu::Features) -> wgpu::Features {
    features.remove(all_of(&mask.without));
    if !features.contains(wgpu::Features::TIMESTAMP_QUERY) {
        features.remove(wgpu::Features::TIMESTAMP_QUERY_INSIDE_ENCODERS);
    }
    features
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
