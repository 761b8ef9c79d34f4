//! `uniforms`: the light follows the camera, and the shared uniforms are written. UW §3.1.

use encase::ShaderType;
use glam::{DMat4, DVec2, DVec3, Mat4, UVec2, Vec2, Vec3};

use super::entry::{EntrySearch, water_iterations};
use crate::prelude::*;
use fathom_gpu::kit::host_bytes;
use fathom_scene::{Bounds, Camera, Light, LightFrame, LightKind, Water, WaterModel, wave_texels};

pub const INFO: StageInfo = StageInfo {
    name: "uniforms",
    about: "CPU: fits the light's frustum to the camera's and writes the shared uniforms",
    source: "UW §3.1",
};

/// Texels per side of the noise texture: 16 to 32 texels a noise cell.
const NOISE_SIZE: u32 = 256;

shader_struct! {
    pub struct FrameUniforms {
        pub camera_view_projection: Mat4,
        pub camera_inverse: Mat4,
        /// The camera mirrored about the resting water y = 0.
        pub mirror_view_projection: Mat4,
        pub light_view_projection: Mat4,
        pub light_inverse: Mat4,
        /// From places of the photon grid, −1 … 1 along each side, and a depth to the world.
        pub photon_grid: Mat4,
        pub camera_position_m: Vec3,
        pub z_near_m: f32,
        /// Direction of travel at the middle of the light frustum.
        pub light_forward: Vec3,
        pub z_far_m: f32,
        pub light_position_m: Vec3,
        /// 1 for a point light, 0 for a directional one.
        pub light_is_point: u32,
        /// Irradiance at normal incidence in the middle of the view, W/m².
        pub light_irradiance: f32,
        /// Depth difference, in the light's depth range 0…1, that counts as an edge.
        pub light_depth_jump: f32,
        pub refractive_index: f32,
        pub attenuation_per_m: f32,
        pub water_center_m: Vec2,
        pub water_half_size_m: Vec2,
        pub water_amplitude_m: f32,
        /// 2π / wavelength, 1/m.
        pub wavenumber_per_m: f32,
        /// ω t, radians.
        pub phase: f32,
        pub noise_share: f32,
        pub noise_tile_m: f32,
        /// Scroll of the noise along x, in tiles.
        pub noise_scroll: f32,
        /// 0 circular, 1 directional; given water is compiled in.
        pub water_model: u32,
        /// 1 where the camera is below the resting water.
        pub camera_under_water: u32,
        /// How far the surface is from y = 0 at most.
        pub water_bound_m: f32,
        /// Horizontal length of a step of the search for a ray's entry, and most steps.
        pub water_step_m: f32,
        pub water_steps: f32,
        /// Tangent of the angle to the vertical up to which Newton's method finds a ray's entry.
        pub water_newton_slant: f32,
    }
}

/// What the frame is seen from, lit by and looks through.
#[derive(Clone, Debug)]
pub struct View {
    pub camera: Camera,
    pub light: Light,
    pub water: Water,
    pub bounds: Bounds,
    /// Pixels of the main viewport.
    pub size_px: UVec2,
    /// Difference of depth along the light that counts as an edge of the shadow map, metres.
    pub edge_m: f64,
    /// Share of the picture, to the right and upwards, from beyond which photons still reach into it: what is drawn of each is that large.
    pub photon_reach: DVec2,
    /// Whether photons start only where they can land in view; else in all of the light's frustum.
    pub photons_fitted: bool,
}

impl View {
    pub fn aspect(&self) -> f64 {
        f64::from(self.size_px.x) / f64::from(self.size_px.y)
    }

    pub fn light_frame(&self) -> LightFrame {
        let wider = 1.0 + self.photon_reach;
        let mut camera = self.camera.clone();
        camera.fov_y_deg = 2.0 * (self.half_height() * wider.y).atan().to_degrees();
        let aspect = self.aspect() * wider.x / wider.y;
        self.light.frame(&camera, aspect, &self.bounds, &self.water, self.photons_fitted)
    }

    /// Half the height of the picture at unit distance.
    fn half_height(&self) -> f64 {
        (self.camera.fov_y_deg.to_radians() / 2.0).tan()
    }

    /// Side of the square, in metres, that has the area of a buffer's pixel at 1 m from the camera.
    pub fn pixel_tangent(&self, [width_px, height_px]: [u32; 2]) -> f64 {
        let pixels = f64::from(width_px) * f64::from(height_px);
        2.0 * self.half_height() * (self.aspect() / pixels).sqrt()
    }

    /// Sides of a buffer in squares of its pixels' area.
    pub fn square_px(&self, [width_px, height_px]: [u32; 2]) -> DVec2 {
        let pixels = f64::from(width_px) * f64::from(height_px);
        DVec2::new((pixels * self.aspect()).sqrt(), (pixels / self.aspect()).sqrt())
    }

    /// Irradiance at normal incidence in the middle of the view, W/m²: the intensity itself for a directional
    /// light, whose distance is nominal, and intensity / distance² for a point light.
    pub fn irradiance(&self) -> f64 {
        match self.light.kind {
            LightKind::Directional => self.light.intensity_w_sr,
            LightKind::Point => {
                let to_middle = DVec3::from(self.light.position_m) - self.camera.middle();
                self.light.intensity_w_sr / to_middle.length_squared()
            }
        }
    }

    /// Flux that the photons of a grid share if each is weighted by its solid angle (`angular_weight` in `shaders/shared/photon.wgsl`), W:
    /// a point light's intensity times the area of the grid at unit distance, as the weight is 1 in the middle of the frustum.
    pub fn weighted_flux_w(&self) -> f64 {
        self.light.intensity_w_sr * self.light_frame().grid_area
    }

    pub fn uniforms(&self) -> FrameUniforms {
        let light = self.light_frame();
        let camera = self.camera.view_projection(self.aspect());
        let water = &self.water;
        let search = EntrySearch::new(water);
        let mirror = DMat4::from_scale(DVec3::new(1.0, -1.0, 1.0));
        FrameUniforms {
            camera_view_projection: camera.as_mat4(),
            camera_inverse: camera.inverse().as_mat4(),
            mirror_view_projection: (camera * mirror).as_mat4(),
            light_view_projection: light.view_projection.as_mat4(),
            light_inverse: light.inverse.as_mat4(),
            photon_grid: light.photon_grid.as_mat4(),
            camera_position_m: DVec3::from(self.camera.position_m).as_vec3(),
            z_near_m: self.camera.z_near_m as f32,
            light_forward: light.forward.as_vec3(),
            z_far_m: self.camera.z_far_m as f32,
            light_position_m: light.position.as_vec3(),
            light_is_point: u32::from(self.light.kind == LightKind::Point),
            light_irradiance: self.irradiance() as f32,
            light_depth_jump: self.depth_jump(&light) as f32,
            refractive_index: water.refractive_index as f32,
            attenuation_per_m: water.attenuation_per_m as f32,
            water_center_m: Vec2::new(water.center_m[0] as f32, water.center_m[1] as f32),
            water_half_size_m: Vec2::new(water.half_size_m[0] as f32, water.half_size_m[1] as f32),
            water_amplitude_m: water.amplitude_m as f32,
            wavenumber_per_m: water.wavenumber_per_m() as f32,
            phase: water.turned_rad() as f32,
            noise_share: water.noise as f32,
            noise_tile_m: water.noise_tile_m as f32,
            noise_scroll: water.noise_drift_tiles() as f32,
            water_model: match water.model {
                WaterModel::Directional => 1,
                _ => 0,
            },
            camera_under_water: u32::from(self.camera.position_m[1] < 0.0),
            water_bound_m: search.bound_m as f32,
            water_step_m: search.step_m as f32,
            water_steps: search.steps as f32,
            water_newton_slant: search.newton_slant as f32,
        }
    }

    /// The edge threshold in the light's depth range, at the middle of the view.
    fn depth_jump(&self, light: &LightFrame) -> f64 {
        let middle = self.camera.middle();
        let depth = |p: DVec3| light.view_projection.project_point3(p).z;
        depth(middle + light.forward * self.edge_m) - depth(middle)
    }
}

/// Bind group 0 of every stage: the frame's uniforms and what the water's surface is made from.
pub struct Shared {
    pub group: Bindings,
    uniforms: Buffer,
    pub view: View,
    /// Turns of loops that a height of the water takes.
    pub water_iterations: u64,
    /// Turns of loops in which a photon of the light finds its entry into the water, at most.
    pub entry_iterations: u64,
}

impl Shared {
    pub fn new(resources: &Resources<'_>, view: &View) -> Self {
        let uniforms = resources.uniform("uniforms", &view.uniforms());
        let texels = water_texels(resources, &view.water);
        Self {
            group: Bindings::new(&[&uniforms, &texels]),
            uniforms,
            view: view.clone(),
            water_iterations: water_iterations(&view.water),
            entry_iterations: EntrySearch::new(&view.water)
                .loop_bound(&view.water, &view.light_frame()),
        }
    }

    /// What shaders that import `fathom::water` are compiled with.
    pub fn water_def(&self) -> (&'static str, i32) {
        ("WATER", i32::from(self.view.water.model == WaterModel::Waves))
    }

    /// What shaders that weigh photons are compiled with.
    pub fn fresnel_def(&self) -> (&'static str, i32) {
        ("FRESNEL", i32::from(self.view.water.fresnel))
    }
}

/// The texture that `shaders/shared/water.wgsl` reads.
fn water_texels(resources: &Resources<'_>, water: &Water) -> wgpu::Texture {
    let floats = |texels: &[[f32; 4]]| texels.iter().flatten().copied().collect();
    let format = wgpu::TextureFormat::Rgba32Float;
    match water.model {
        WaterModel::Waves => {
            let waves = wave_texels(&water.waves);
            let size = [waves.len().max(1) as u32, 1];
            resources.fixed_texture("waves", size, format, || floats(&waves))
        }
        _ => resources.fixed_texture("noise", [NOISE_SIZE; 2], format, || {
            floats(&water.noise_texels(NOISE_SIZE))
        }),
    }
}

pub fn new(view: View, shared: &Shared) -> Stage {
    let uniforms = shared.uniforms.clone();
    let work = Work { bytes_written: FrameUniforms::min_size().get(), ..Work::default() };
    Stage::new(&INFO, work, move |scope| {
        scope.host(|queue| queue.write_buffer(&uniforms, 0, &host_bytes(&view.uniforms())));
    })
}
