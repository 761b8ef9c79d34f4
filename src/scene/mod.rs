#![allow(dead_code)]
mod bounds;
pub mod camera;
mod check;
mod frustum;
mod light;
mod mesh;
mod noise;
pub mod water;
pub use camera::Camera;
pub use bounds::Bounds;
pub use light::*;
pub use water::{Water, WaterModel};
pub use mesh::Mesh;
pub struct Material{pub albedo:[f32;3],pub accent:[f32;3],pub tile_m:f32}
pub struct Object { pub name: String, pub mesh: Mesh, pub material: Material }
