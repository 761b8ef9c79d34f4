//! Ambient occlusion in scalar fields. VAO §5.2.

pub mod direct;
pub mod isosurface;
pub mod positional;
