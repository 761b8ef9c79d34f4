//! What the stages of family `scalar` are: a view ray through the field for each pixel.

use glam::{UVec2, Vec2, Vec3};

use crate::prelude::*;
use crate::scalar_field::ScalarField;
use crate::slices::{Slice, loop_bound, slices};
use fathom_gpu::kit::{Canvas, Raster};

shader_struct! {
    pub struct CastUniforms {
        pub size_px: UVec2,
        /// Values at which opacity begins and is full.
        pub window: Vec2,
        pub low_color: Vec3,
        /// Share of the light that comes evenly from all sides.
        pub ambient: f32,
        pub high_color: Vec3,
        /// Step along view rays.
        pub view_step_m: f32,
        pub iso: f32,
        pub tolerance: f32,
        /// V_thres: of the value on isosurfaces, of the windowed value in media.
        pub threshold: f32,
        pub rays: u32,
        pub samples: u32,
        pub r_max_m: f32,
        /// r_max / N_samples.
        pub stratum_m: f32,
        /// Level of the average pyramid whose cells are as long as a stratum.
        pub level: f32,
        /// Of one voxel at the window's end.
        pub opacity: f32,
        /// σ at the window's end, 1/m.
        pub density_per_m: f32,
    }
}

/// What a pixel's steps have left so far: `State` in `shaders/shared/media.wgsl`.
const STATE_BYTES: u64 = 32;
/// Halvings of the step that holds an isosurface, as in `shaders/scalar/isosurface.wgsl`.
const HALVINGS: u64 = 6;

impl CastUniforms {
    /// Steps along a view ray at most.
    fn steps(&self, field: &ScalarField) -> u32 {
        // The last step may be a short one, and rounding may add another.
        (field.diagonal_m / f64::from(self.view_step_m)).ceil() as u32 + 1
    }

    /// Turns of loops of a point's occlusion at most.
    fn point_iterations(&self) -> u64 {
        u64::from(self.rays) * (u64::from(self.samples) + 3) + 1
    }
}

const IMAGE_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;
const RESULT_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba32Float;
const NORMAL_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// What a cast leaves.
pub struct Cast {
    /// The look, for display.
    pub image: wgpu::Texture,
    /// Visibility 1 − A, opacity, distance in metres, and the number of look-ups in the field, for each pixel.
    pub result: wgpu::Texture,
    /// Of the surface, where the stage finds one.
    pub normal: Option<wgpu::Texture>,
}

/// The stage `info` casts each pixel's ray through a field. `defs` are the shader's; `normals`: the shader writes them.
pub fn new(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    shared: &Shared,
    field: &ScalarField,
    defs: &[(&str, bool)],
    normals: bool,
    settings: &CastUniforms,
) -> Result<Stage<Cast>, GpuError> {
    let slices = passes(resources, settings, field, normals);
    let sliced = slices.len() > 1;
    if sliced {
        resources.fragment_writes(info.name);
    }
    let mut defs: Vec<_> = defs.iter().map(|(n, on)| (*n, i32::from(*on))).collect();
    if !normals {
        defs.push(("SLICED", i32::from(sliced)));
    }
    let size_px = settings.size_px.to_array();
    let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
    let uniforms = resources.uniform(info.name, settings);
    let states = sliced.then(|| resources.storage("steps so far", pixels * STATE_BYTES));
    let formats = [IMAGE_FORMAT, RESULT_FORMAT, NORMAL_FORMAT].map(kit::opaque);
    let spec =
        RenderSpec::new((info.name, &defs[..]), &[], &formats[..if normals { 3 } else { 2 }]);
    let raster = |slice: &Slice| {
        let slice = sliced.then(|| resources.loop_settings(info.name, slice));
        let own = Bindings::new(&[&field.uniforms, &field.texture, &field.sampler, &uniforms]);
        let groups = [&shared.group, &own.and(&slice).and(&states)];
        Raster::new(resources, &RenderSpec { groups: &groups, ..spec.clone() })
    };
    let rasters = slices.iter().map(raster).collect::<Result<Vec<_>, _>>()?;
    let canvas = Canvas::new(resources, &spec, size_px, wgpu::Color::TRANSPARENT);
    let textures = &canvas.textures;
    let (image, result) = (textures[0].clone(), textures[1].clone());
    let cast = Cast { image, result, normal: textures.get(2).cloned() };
    // Look-ups depend on the field and are counted by the shader: see the last channel of the result.
    let bytes_written = pixels * (4 + 16 + if normals { 8 } else { 0 });
    let work = Work { fragments: pixels, bytes_written, ..Work::default() };
    let stage = Stage::new(info, work, move |scope| {
        canvas.series(scope, rasters.len(), |number, pass| {
            rasters[number].bind(pass);
            kit::draw_fullscreen(pass);
        });
    });
    Ok(stage.dumps(outputs(&cast)).with_output(cast))
}

/// The passes over the steps of view rays: one for an isosurface, where the rays of one point follow the steps. In a medium each
/// step may take the rays of a point.
fn passes(
    resources: &Resources<'_>,
    settings: &CastUniforms,
    field: &ScalarField,
    isosurface: bool,
) -> Vec<Slice> {
    let (steps, of_point) = (settings.steps(field), settings.point_iterations());
    let label = "scalar.rays × scalar.samples";
    if isosurface {
        // Each ray may end in a surface that is halved towards too.
        let halved = (u64::from(settings.rays) + 1) * (HALVINGS + 2);
        resources.iterations(label, of_point + u64::from(steps) + halved);
        return vec![Slice { first: 0, end: steps }];
    }
    let slices = slices(steps, of_point + 1);
    resources.iterations(label, loop_bound(&slices, of_point + 1));
    slices
}

fn outputs(cast: &Cast) -> Vec<StageDump> {
    let result = vec![
        Column::new("visibility", "1", "1 − A, weighted by contribution"),
        Column::new("opacity", "1", "share of the view that the field hides"),
        Column::new("distance", "m", "from the viewer, weighted by contribution"),
        Column::new("look_ups", "1", "look-ups in the field"),
    ];
    let normal = cast.normal.as_ref().map(|texture| {
        let mut columns = Column::many(["nx", "ny", "nz"], "1", "normal");
        columns.push(Column::new("covered", "1", "1 where there is a surface"));
        let meaning = "unit normal of the isosurface in the world's axes";
        StageDump::texture("normal", meaning, columns, texture)
    });
    let met = "what each pixel's view ray met";
    let result = StageDump::texture("result", met, result, &cast.result);
    [StageDump::image(&cast.image), result].into_iter().chain(normal).collect()
}
