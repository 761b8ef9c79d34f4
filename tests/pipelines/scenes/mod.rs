//! The built-in scenes, and the files that users bring: scenes, meshes and volumes. Bad ones give one clear line.

mod built_in;
#[path = "../../common/files.rs"]
mod files;
mod mesh_styles;
mod meshes;
mod volumes;
