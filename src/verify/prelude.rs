//! What most families of cases name.

pub use std::f64::consts::{PI, TAU};

pub use crate::picture::*;
pub use crate::rig::{self, Fixture, Random, Rig, noise};
pub use crate::statistics::*;
pub use crate::{Case, Check, Checks, Result, VerifyError};
pub use fathom_gpu::{GpuError, Stage, StageInfo, TimedStage, read_volume};
pub use fathom_pipelines::BuiltPipeline;
pub use fathom_reference::image::{Image, pixels};
pub use fathom_reference::optics::*;
pub use fathom_reference::picture::PictureLight;
pub use fathom_reference::rays::{Hit, PixelRays, Projected, Tracer};
pub use fathom_reference::surface::enter;
pub use fathom_scene::{
    Bounds, Camera, Grid, LightKind, Mesh, Object, Optics, Scene, SceneFile, Volume, Water,
};
pub use fathom_stages::gbuffer::GBuffer;
pub use fathom_stages::geometry::{Geometry, Objects};
pub use fathom_stages::ldi::peel;
pub use fathom_stages::photon::{Photon, Photons};
pub use fathom_stages::screen_ray::*;
pub use fathom_stages::shadow;
pub use fathom_stages::splatting::PHOTONS_PER_INSTANCE;
pub use fathom_stages::transfer::map;
pub use fathom_stages::uniforms::{Shared, View};
pub use fathom_stages::voxels::Voxels;
pub use glam::{DVec2, DVec3, DVec4, UVec2, Vec2, Vec3};
