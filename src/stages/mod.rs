//! Stages: the units that are timed. Each has a file with the same stem as its shader; what stages of two families share
//! lies in `shared`.
//!
//! A stage is made from the typed resources of earlier stages. It encodes its passes through the
//! [`StageScope`](fathom_gpu::StageScope), which writes the timestamps, and declares its work.

pub mod compose;
pub mod prelude;
pub mod refraction;
mod shared;
pub mod uniforms;
pub mod voxel;

/// Volume ambient occlusion. VAO §5.1, §6.
pub mod ao {
    pub mod bilateral;
    pub mod compose;
    pub mod glass;
    pub mod march;
    pub mod query;
}
pub mod caustics {
    pub mod filter;
    pub mod splat;
    pub mod trace;
}
pub mod godrays {
    pub mod filter;
    pub mod lines;
    pub mod trace;
}
/// Ambient occlusion of horizons and of visibility bitmasks, as engines have it.
pub mod gtao {
    pub mod filter;
    pub mod gather;
}
/// Horizon-split ambient occlusion, the screen-space method that VAO §6 compares with.
pub mod hsao {
    pub mod filter;
    pub mod march;
}
pub mod ldi {
    pub mod peel;
}
pub mod planar {
    pub mod compose;
    pub mod points;
}
pub mod rays {
    pub mod march;
    pub mod rasterize;
    pub mod reduce;
}
/// Ambient occlusion in scalar fields. VAO §5.2.
pub mod scalar {
    pub mod direct;
    pub mod isosurface;
    pub mod positional;
}
pub mod scene {
    pub mod deform;
    pub mod gbuffer;
}
pub mod shadow {
    pub mod compose;
    pub mod depth;
    pub mod mask;
}
pub mod shafts {
    pub mod blur;
    pub mod lines;
}
pub mod sprites {
    pub mod compose;
    pub mod draw;
}
pub mod transfer {
    pub mod bounce;
    pub mod map;
    pub mod shadow;
    pub mod sight;
}

pub mod water {
    pub mod reflection;
    pub mod refraction;
}

pub use shared::*;

pub use fathom_gpu::{Column, OutputData, ReadRow, Stage, StageDump, StageInfo};

/// Every stage, in frame order. Adding a stage adds one line.
pub const REGISTRY: &[StageInfo] = &[
    uniforms::INFO,
    scene::deform::INFO,
    voxel::clear::INFO,
    voxel::slicemap::INFO_X,
    voxel::slicemap::INFO_Y,
    voxel::slicemap::INFO_Z,
    voxel::combine::INFO,
    voxel::slice::INFO,
    voxel::overlap::INFO,
    voxel::alpha::INFO,
    voxel::unpack::INFO,
    voxel::mips::INFO,
    voxel::view::INFO,
    shadow::depth::INFO,
    shadow::mask::INFO,
    scene::gbuffer::INFO,
    ao::march::INFO,
    ao::query::INFO,
    ao::bilateral::INFO,
    ao::compose::INFO,
    ao::glass::INFO,
    hsao::march::INFO,
    hsao::filter::INFO,
    gtao::gather::INFO,
    gtao::filter::INFO,
    water::reflection::INFO,
    water::refraction::INFO,
    caustics::trace::INFO,
    caustics::splat::INFO,
    caustics::filter::INFO,
    godrays::trace::INFO,
    godrays::lines::INFO,
    godrays::filter::INFO,
    compose::INFO,
    transfer::map::INFO,
    transfer::shadow::INFO,
    transfer::sight::INFO,
    ldi::peel::INFO,
    rays::rasterize::INFO,
    rays::reduce::INFO,
    rays::march::INFO,
    transfer::bounce::INFO,
    sprites::draw::INFO,
    shafts::lines::INFO,
    shafts::blur::INFO,
    sprites::compose::INFO,
    shadow::compose::INFO,
    refraction::surface::INFO,
    refraction::trace::INFO,
    refraction::two_interface::INFO,
    refraction::compose::INFO,
    planar::points::INFO,
    planar::compose::INFO,
    scalar::isosurface::INFO,
    scalar::direct::INFO,
    scalar::positional::INFO,
];

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::{Path, PathBuf};

    use fathom_base::embedded::{Folders, SHADERS};
    use fathom_gpu::{link, shader_paths};
    use itertools::Itertools;

    fn entries(folder: &Path) -> Vec<PathBuf> {
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).sorted().collect()
    }

    fn name(path: &Path) -> &str {
        path.file_stem().unwrap().to_str().unwrap()
    }

    #[test]
    fn every_shader_links_and_validates_with_its_defaults() {
        let folders = Folders::new(SHADERS);
        let paths = shader_paths(&folders);
        assert!(paths.contains(&"audit/loops".to_owned()), "{paths:?}");
        for path in paths {
            link(&folders, &path, &[]).unwrap_or_else(|error| panic!("{error}"));
        }
    }

    #[test]
    fn no_stage_imports_a_stage_of_another_family() {
        let source = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folders = entries(source).into_iter().filter(|path| path.is_dir());
        let families: Vec<PathBuf> = folders.filter(|path| name(path) != "shared").collect();
        assert!(families.len() >= 14, "{families:?}");
        for family in &families {
            let others = families.iter().filter(|other| *other != family).map(|path| name(path));
            let paths = others
                .flat_map(|other| ["crate", "super::super"].map(|of| format!("{of}::{other}::")));
            // Of a list this test would see no paths.
            let forbidden: Vec<String> = paths.chain(["crate::{".to_owned()]).collect();
            for file in entries(family) {
                let text = fs::read_to_string(&file).unwrap();
                let found = forbidden.iter().find(|path| text.contains(*path));
                assert_eq!(found, None, "{}", file.display());
            }
        }
    }
}
