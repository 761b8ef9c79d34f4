//! The scene's triangles and materials in GPU memory, as every raster stage reads them.

use std::ops::Range;
use std::rc::Rc;

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::prelude::*;
use fathom_gpu::StageScope;
use fathom_scene::{Material, Object, Optics, Scene};

/// Host twin of `SceneVertex` in `shaders/shared/surface.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct SceneVertex {
    position_m: [f32; 3],
    normal: [f32; 3],
    material: u32,
}

const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Uint32];

shader_struct! {
    pub struct MaterialUniforms {
        pub albedo: Vec3,
        /// Side of a world-space tile with joints in the accent colour; 0: plain.
        pub tile_m: f32,
        pub accent: Vec3,
        /// Opacity.
        pub alpha: f32,
        /// Reflectance of the glossy lobe.
        pub specular: f32,
        /// As `fathom::optics` reads it.
        pub optics: f32,
    }
}

/// A choice among the scene's objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Objects {
    /// What one cannot see through.
    Opaque,
    /// What refracts light.
    Glass,
    /// What light meets: both.
    Solid,
}

impl Objects {
    pub fn holds(self, material: &Material) -> bool {
        let glass = material.optics == Optics::Glass;
        match self {
            Self::Opaque => material.is_opaque(),
            Self::Glass => glass,
            Self::Solid => glass || material.is_opaque(),
        }
    }
}

#[derive(Clone)]
pub struct Geometry {
    /// Seven 32-bit words a vertex: position (3 floats, metres), normal (3 floats), material (an integer). Shaders may read
    /// and rewrite it as storage.
    pub vertices: Buffer,
    /// Three a triangle.
    pub indices: Buffer,
    /// The same on the host.
    pub corners: Rc<[u32]>,
    /// Each object's part of the indices, in the scene's order.
    pub objects: Vec<Range<u32>>,
    /// Those of the objects that one cannot see through, neighbours joined: what depth and G-buffer show.
    opaque: Vec<Range<u32>>,
    glass: Vec<Range<u32>>,
    solid: Vec<Range<u32>>,
    pub materials: Buffer,
    /// Of each triangle.
    pub sizes: Vec<TriangleSize>,
}

/// The parts of the objects for which `wanted` holds, neighbours joined.
fn joined(parts: &[Range<u32>], wanted: impl Fn(usize) -> bool) -> Vec<Range<u32>> {
    let mut joined: Vec<Range<u32>> = Vec::new();
    for (_, part) in parts.iter().enumerate().filter(|(number, _)| wanted(*number)) {
        match joined.last_mut() {
            Some(last) if last.end == part.start => last.end = part.end,
            _ => joined.push(part.clone()),
        }
    }
    joined
}

/// All objects' vertices, one object after the other.
fn vertices(scene: &Scene) -> Vec<SceneVertex> {
    let of = |(object, material): (&Object, u32)| -> Vec<SceneVertex> {
        let corners = object.mesh.positions.iter().zip(&object.mesh.normals);
        let vertex = |(&position_m, &normal)| SceneVertex { position_m, normal, material };
        corners.map(vertex).collect()
    };
    scene.objects.iter().zip(0..).flat_map(of).collect()
}

/// All objects' indices into [`vertices`].
fn indices(scene: &Scene) -> Vec<u32> {
    let mut base = 0;
    let mut indices = Vec::new();
    for object in &scene.objects {
        indices.extend(object.mesh.indices.iter().map(|i| i + base));
        base += object.mesh.positions.len() as u32;
    }
    indices
}

/// How large a triangle is at rest.
#[derive(Clone, Copy, Debug)]
pub struct TriangleSize {
    /// The two longer sides of its box, metres.
    pub sides_m: [f32; 2],
    /// It has hardly an area, so that its normal may be none.
    pub is_line: bool,
}

/// Area over the square of the longest side, twice each, at which 32-bit floats may find none.
const LINE: f32 = 1e-5;

fn sizes(scene: &Scene) -> Vec<TriangleSize> {
    let of = |object: &Object| {
        let positions = &object.mesh.positions;
        let size = |corners: &[u32]| {
            let [a, b, c] = [0, 1, 2].map(|i| Vec3::from(positions[corners[i] as usize]));
            let sides = a.max(b).max(c) - a.min(b).min(c);
            let [long, min] = [sides.max_element(), sides.min_element()];
            let is_line = (b - a).cross(c - a).length() <= LINE * long * long;
            TriangleSize { sides_m: [long, sides.element_sum() - long - min], is_line }
        };
        object.mesh.indices.chunks_exact(3).map(size).collect::<Vec<_>>()
    };
    scene.objects.iter().flat_map(of).collect()
}

fn material(object: &Object) -> MaterialUniforms {
    let material = &object.material;
    MaterialUniforms {
        albedo: material.albedo.into(),
        tile_m: material.tile_m,
        accent: material.accent.into(),
        alpha: material.alpha,
        specular: material.specular,
        optics: optics(material),
    }
}

/// What becomes of light: as in `shaders/shared/optics.wgsl`, as is the number of glass.
const DIFFUSE: f32 = 1.0;
const RECEIVER: f32 = 1.5;
const MIRROR: f32 = -1.0;

fn optics(material: &Material) -> f32 {
    match material.optics {
        Optics::Diffuse if material.receiver => RECEIVER,
        Optics::Diffuse => DIFFUSE,
        Optics::Mirror => MIRROR,
        Optics::Glass => 1.0 + material.refractive_index,
    }
}

impl Geometry {
    pub fn new(resources: &Resources<'_>, scene: &Scene) -> Self {
        use wgpu::BufferUsages as Usage;
        let mut end = 0;
        let object = |object: &Object| {
            let start = end;
            end += object.mesh.indices.len() as u32;
            start..end
        };
        let objects: Vec<Range<u32>> = scene.objects.iter().map(object).collect();
        let usage = Usage::VERTEX | Usage::STORAGE | Usage::COPY_SRC;
        let vertices = resources
            .filled_by("scene vertices", vertex_bytes(scene), usage, || Self::vertex_bytes(scene));
        let corners: Rc<[u32]> = indices(scene).into();
        let usage = Usage::INDEX | Usage::STORAGE;
        let indices = resources.filled("scene indices", bytemuck::cast_slice(&corners), usage);
        let materials: Vec<_> = scene.objects.iter().map(material).collect();
        let materials = resources.structs("materials", &materials, Usage::STORAGE);
        let [opaque, glass, solid] = [Objects::Opaque, Objects::Glass, Objects::Solid]
            .map(|part| joined(&objects, |number| part.holds(&scene.objects[number].material)));
        let sizes = sizes(scene);
        Self { vertices, indices, corners, objects, opaque, glass, solid, materials, sizes }
    }

    /// The content of the vertex buffer as it is made.
    pub fn vertex_bytes(scene: &Scene) -> Vec<u8> {
        bytemuck::cast_slice(&vertices(scene)).to_vec()
    }

    /// Layout of the vertex buffer; depth-only stages take the position alone.
    pub fn layout(position_only: bool) -> wgpu::VertexBufferLayout<'static> {
        wgpu::VertexBufferLayout {
            array_stride: size_of::<SceneVertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &ATTRIBUTES[..if position_only { 1 } else { 3 }],
        }
    }

    fn ranges(&self, part: Objects) -> &[Range<u32>] {
        match part {
            Objects::Opaque => &self.opaque,
            Objects::Glass => &self.glass,
            Objects::Solid => &self.solid,
        }
    }

    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>, part: Objects) {
        for range in self.ranges(part) {
            self.draw_instances(pass, range.clone(), 0..1);
        }
    }

    /// Draws a part of the indices, such as one of [`Geometry::objects`], once for each instance.
    pub fn draw_instances(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        part: Range<u32>,
        instances: Range<u32>,
    ) {
        pass.set_vertex_buffer(0, self.vertices.slice(..));
        pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
        pass.draw_indexed(part, 0, instances);
    }

    pub fn vertices(&self) -> u64 {
        self.vertices.size() / size_of::<SceneVertex>() as u64
    }

    pub fn triangles(&self) -> u64 {
        self.objects.last().map_or(0, |object| u64::from(object.end)) / 3
    }

    /// Those that [`Self::draw`] draws.
    pub fn triangles_of(&self, part: Objects) -> u64 {
        self.ranges(part).iter().map(|range| range.len() as u64).sum::<u64>() / 3
    }

    /// Of vertices and indices.
    pub fn bytes(&self) -> u64 {
        self.vertices.size() + self.indices.size()
    }
}

/// Bytes of all objects' vertices.
fn vertex_bytes(scene: &Scene) -> u64 {
    let count: usize = scene.objects.iter().map(|o| o.mesh.positions.len()).sum();
    count as u64 * size_of::<SceneVertex>() as u64
}

/// A stage that draws all opaque geometry with a depth test: a colour target of `size_px` for each format, cleared to transparent black,
/// and a depth target. Without colours only positions are read. It leaves the colours and the depth. `texel_bytes` are those of a
/// pixel of all targets.
pub fn scene_stage(
    resources: &Resources<'_>,
    info: &'static StageInfo,
    groups: &[&Bindings],
    geometry: &Geometry,
    (formats, texel_bytes): (&[wgpu::TextureFormat], u64),
    size_px: [u32; 2],
) -> Result<Stage<(Vec<wgpu::Texture>, wgpu::Texture)>, GpuError> {
    let depth = resources.target(info.name, size_px, kit::DEPTH_FORMAT);
    let states: Vec<_> = formats.iter().map(|format| kit::opaque(*format)).collect();
    let spec = RenderSpec {
        fragment: (!formats.is_empty()).then_some("fragment"),
        buffers: &[Geometry::layout(formats.is_empty())],
        depth: Some(Depth::nearest(&depth)),
        ..RenderSpec::new(info.name, groups, &states)
    };
    let pass = DrawPass::new(resources, &spec, size_px, wgpu::Color::TRANSPARENT)?;
    let triangles = geometry.triangles_of(Objects::Opaque);
    let work = Work {
        triangles,
        // Where nothing is drawn, nothing is read.
        bytes_read: if triangles > 0 { geometry.bytes() } else { 0 },
        bytes_written: kit::pixels(&depth) * texel_bytes,
        ..Work::default()
    };
    // Other parts than the opaque one have some of the geometry's bytes.
    let min_work = Work { bytes_read: 0, ..work };
    let (colors, geometry) = (pass.textures().to_vec(), geometry.clone());
    let encode = move |scope: &mut StageScope<'_>| {
        pass.render(scope, |pass| geometry.draw(pass, Objects::Opaque));
    };
    Ok(Stage::new(info, work, encode).with_min_work(min_work).with_output((colors, depth)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn neighbours_are_drawn_together_and_the_rest_is_left_out() {
        let parts = [0..3, 3..9, 9..12, 12..15];
        assert_eq!(joined(&parts, |_| true).as_slice(), std::slice::from_ref(&(0..15)));
        assert_eq!(joined(&parts, |number| number != 2), [0..9, 12..15]);
        assert!(joined(&parts, |_| false).is_empty());
    }
}
