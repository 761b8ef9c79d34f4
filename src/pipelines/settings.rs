//! Settings that several pipelines share.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::gpu::GpuError;
use crate::scene::{Bounds, Camera, Grid, Scene, SceneFile};
use crate::stages::geometry::Geometry;
use crate::stages::kit::Resources;
use crate::stages::scene::deform::{self, Motion};

/// Checks a setting's range; the error names it.
pub fn within(group: &str, name: &str, value: f64, low: f64, high: f64) -> Result<(), String> {
    if (low..=high).contains(&value) {
        Ok(())
    } else {
        Err(format!(
            "{group}.{name} is {value}: it must lie within {low} … {high}"
        ))
    }
}

/// Leaves only the first objects of a scene file; 0 leaves all.
pub fn keep_first(file: &mut SceneFile, objects: u32) {
    if objects > 0 {
        file.objects.truncate(objects as usize);
    }
}

/// Pixels of the main viewport. VAO Fig. 8: 600 × 600.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct View {
    pub width: u32,
    pub height: u32,
}

impl Default for View {
    fn default() -> Self {
        Self {
            width: 600,
            height: 600,
        }
    }
}

impl View {
    pub fn validate(&self) -> Result<(), String> {
        within("view", "width", f64::from(self.width), 1.0, 1e6)?;
        within("view", "height", f64::from(self.height), 1.0, 1e6)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Method {
    /// One pass per axis, bits of slices set by atomics. VAO §4.2.
    Slicemap,
    /// One pass per slice and axis. VAO §4.1.
    Slice,
    /// Triangle-parallel compute, separating-axis test, every voxel that a triangle touches.
    Overlap,
    /// The same with the thin test: 6-separating surfaces.
    OverlapThin,
    /// Triangle-parallel compute that stores the largest alpha of the touching triangles. VAO Fig. 6.
    MaxAlpha,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Update {
    /// Voxelization is part of every frame.
    EveryFrame,
    /// The volume is made when the pipeline is built, and no frame pays for it.
    Once,
}

/// The volume and how it is filled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Voxel {
    pub method: Method,
    pub update: Update,
    /// Voxels along the longest side of the scene. VAO §6.4: 128 to 256.
    pub resolution: u32,
    /// A volume for each object, on a grid of its own, in place of one for the scene. VAO §3.
    pub per_object: bool,
    /// Edge of a cube around the viewer that is voxelized in place of the whole scene, metres; 0: the whole scene. VAO §4.2.
    pub around_viewer_m: f64,
    /// Voxels, origin and edge of a voxel, set by hand; [0, 0, 0] fits the grid to the scene.
    pub cells: [u32; 3],
    pub origin_m: [f64; 3],
    pub voxel_m: f64,
}

impl Default for Voxel {
    fn default() -> Self {
        Self {
            method: Method::Slicemap,
            update: Update::EveryFrame,
            resolution: 128,
            per_object: false,
            around_viewer_m: 0.0,
            cells: [0; 3],
            origin_m: [0.0; 3],
            voxel_m: 0.0,
        }
    }
}

impl Voxel {
    pub fn validate(&self) -> Result<(), String> {
        within(
            "voxel",
            "resolution",
            f64::from(self.resolution),
            4.0,
            4096.0,
        )?;
        within("voxel", "around_viewer_m", self.around_viewer_m, 0.0, 1e5)?;
        if self.cells == [0; 3] {
            return Ok(());
        }
        for n in self.cells {
            within("voxel", "cells", f64::from(n), 1.0, 4096.0)?;
        }
        for x in self.origin_m {
            within("voxel", "origin_m", x, -1e5, 1e5)?;
        }
        within("voxel", "voxel_m", self.voxel_m, 1e-6, 1e5)
    }

    /// The parameter that sets the size of the volume, for messages.
    pub fn size_name(&self) -> &'static str {
        if self.cells == [0; 3] {
            "voxel.resolution"
        } else {
            "voxel.cells"
        }
    }

    /// The grid of the whole scene, or one for each object in the scene's order, with room for the geometry's motion.
    ///
    /// # Errors
    /// Voxels by the object where the grid is set by hand or lies around the viewer; a scene without geometry.
    pub fn grids(
        &self,
        scene: &Scene,
        camera: &Camera,
        animation: &Animation,
    ) -> Result<Vec<Grid>, String> {
        let by_hand = self.cells != [0; 3];
        if self.per_object && (by_hand || self.around_viewer_m > 0.0) {
            return Err("voxel.per_object fits a grid to each object: \
                voxel.cells and voxel.around_viewer_m must be 0"
                .into());
        }
        if self.per_object {
            let fit = |object: &crate::scene::Object| {
                Grid::fit(&animation.room(&object.mesh.bounds()), self.resolution)
                    .map_err(|fault| format!("object `{}`: {fault}", object.name))
            };
            return scene.objects.iter().map(fit).collect();
        }
        let grid = if by_hand {
            Grid {
                cells: self.cells,
                origin_m: DVec3::from(self.origin_m),
                voxel_m: self.voxel_m,
            }
        } else if self.around_viewer_m > 0.0 {
            let viewer = DVec3::from(camera.position_m);
            Grid::around(viewer, self.around_viewer_m, self.resolution)?
        } else {
            let moving = scene
                .objects
                .iter()
                .map(|o| animation.room(&o.mesh.bounds()));
            Grid::fit(
                &moving.fold(scene.solid_bounds(), Bounds::union),
                self.resolution,
            )?
        };
        Ok(vec![grid])
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Deform {
    /// Geometry rests.
    None,
    /// Each object turns about its vertical axis.
    Spin,
    /// Each object swings about its vertical axis, the further the higher.
    Twist,
    /// Vertices move along their normals in a travelling wave.
    Wave,
}

/// Motion of the geometry, a function of time: each frame is the same work, and time is an axis like any other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Animation {
    pub deform: Deform,
    pub time_s: f64,
    /// Turns of `spin`, swings of `twist` and waves of `wave` per second.
    pub rate_hz: f64,
    /// Amplitude of `wave` as a share of the object's height; how far `twist` turns the top, in turns.
    pub amplitude: f64,
}

impl Default for Animation {
    fn default() -> Self {
        Self {
            deform: Deform::None,
            time_s: 0.0,
            rate_hz: 0.25,
            amplitude: 0.1,
        }
    }
}

impl Animation {
    pub fn validate(&self) -> Result<(), String> {
        within("animation", "time_s", self.time_s, -1e6, 1e6)?;
        within("animation", "rate_hz", self.rate_hz, 0.0, 1e3)?;
        within("animation", "amplitude", self.amplitude, 0.0, 10.0)
    }

    /// What moves the geometry; none where it rests.
    pub fn motion(&self) -> Option<Motion> {
        match self.deform {
            Deform::None => None,
            Deform::Spin => Some(Motion::Spin),
            Deform::Twist => Some(Motion::Twist),
            Deform::Wave => Some(Motion::Wave),
        }
    }

    /// Cycles since time 0.
    pub fn cycles(&self) -> f64 {
        self.rate_hz * self.time_s
    }

    /// The box that an object stays in at all times, from its box at rest.
    pub fn room(&self, rest: &Bounds) -> Bounds {
        let half = rest.size() / 2.0;
        let reach = match self.deform {
            Deform::None => half,
            Deform::Spin | Deform::Twist => {
                let radius = half.x.hypot(half.z);
                DVec3::new(radius, half.y, radius)
            }
            Deform::Wave => half + self.amplitude * rest.size().y,
        };
        Bounds {
            min: rest.center() - reach,
            max: rest.center() + reach,
        }
    }
}

/// The stage that moves the geometry; none where it rests.
///
/// # Errors
/// Shaders that do not link.
pub fn deform(
    resources: &Resources<'_>,
    geometry: &Geometry,
    scene: &Scene,
    animation: &Animation,
) -> Result<Option<deform::Deform>, GpuError> {
    let amount = (animation.cycles(), animation.amplitude);
    animation
        .motion()
        .map(|motion| deform::Deform::new(resources, geometry, scene, motion, amount))
        .transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scene() -> Scene {
        Scene::load("bunny_dry").unwrap()
    }

    fn grids(voxel: &Voxel, deform: Deform) -> Result<Vec<Grid>, String> {
        let scene = scene();
        let animation = Animation {
            deform,
            ..Animation::default()
        };
        voxel.grids(&scene, &scene.camera, &animation)
    }

    #[test]
    fn grids_are_of_the_scene_of_its_objects_around_the_viewer_or_set_by_hand() {
        let mut voxel = Voxel::default();
        let [whole] = grids(&voxel, Deform::None).unwrap()[..] else {
            panic!("a scene has one grid");
        };
        assert_eq!(whole.cells.into_iter().max(), Some(128));
        voxel.per_object = true;
        let objects = grids(&voxel, Deform::None).unwrap();
        assert_eq!(objects.len(), scene().objects.len());
        assert!(objects[1].voxel_m < whole.voxel_m);
        voxel.around_viewer_m = 3.0;
        assert!(
            grids(&voxel, Deform::None)
                .unwrap_err()
                .contains("voxel.per_object")
        );
        voxel.per_object = false;
        let around = grids(&voxel, Deform::None).unwrap()[0];
        assert_eq!((around.cells, around.size_m().x), ([128; 3], 3.0));
        voxel.cells = [3, 2, 1];
        voxel.voxel_m = 0.5;
        assert_eq!(grids(&voxel, Deform::None).unwrap()[0].cells, [3, 2, 1]);
    }

    #[test]
    fn moving_objects_have_room_at_all_times() {
        let rest = Bounds {
            min: DVec3::new(-1.0, 0.0, 2.0),
            max: DVec3::new(3.0, 4.0, 5.0),
        };
        for deform in [Deform::None, Deform::Spin, Deform::Twist, Deform::Wave] {
            let animation = Animation {
                deform,
                ..Animation::default()
            };
            let room = animation.room(&rest);
            assert!(room.min.cmple(rest.min).all() && room.max.cmpge(rest.max).all());
            assert_eq!(room == rest, deform == Deform::None);
        }
        let spin = Animation {
            deform: Deform::Spin,
            ..Animation::default()
        };
        // Half the diagonal of the foot, 4 m × 3 m, to each side of its middle.
        let room = spin.room(&rest);
        assert_eq!((room.min.x, room.max.z), (1.0 - 2.5, 3.5 + 2.5));
        assert_eq!((room.min.y, room.max.y), (0.0, 4.0));
    }
}
