//! The scene's triangles and materials in GPU memory, as every raster stage reads them.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};
use encase::{ShaderType, StorageBuffer};
use glam::Vec3;

use super::kit::Resources;
use crate::scene::{Object, Scene};

/// Host twin of `SceneVertex` in `shaders/shared/surface.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Vertex {
    position_m: [f32; 3],
    normal: [f32; 3],
    material: u32,
}

const ATTRIBUTES: [wgpu::VertexAttribute; 3] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Uint32];

/// Host twin of `Material` in `shaders/shared/surface.wgsl`.
#[derive(Clone, Debug, ShaderType)]
pub struct MaterialUniforms {
    pub albedo: Vec3,
    pub tile_m: f32,
    pub accent: Vec3,
    pub alpha: f32,
    pub specular: f32,
}

#[derive(Clone)]
pub struct Geometry {
    /// Seven 32-bit words a vertex: position (3 floats, metres), normal (3 floats), material (an integer). Shaders may read
    /// and rewrite it as storage.
    pub vertices: wgpu::Buffer,
    /// Three a triangle.
    pub indices: wgpu::Buffer,
    /// Each object's part of the indices, in the scene's order.
    pub objects: Vec<Range<u32>>,
    index_count: u32,
    vertex_count: u64,
    pub materials: wgpu::Buffer,
}

/// Bytes of GPU memory that a scene's vertices and indices take.
pub fn buffer_bytes(scene: &Scene) -> (u64, u64) {
    let vertices: u64 = scene.objects.iter().map(|o| o.mesh.positions.len() as u64).sum();
    let indices: u64 = scene.objects.iter().map(|o| o.mesh.indices.len() as u64).sum();
    (vertices * size_of::<Vertex>() as u64, indices * 4)
}

/// All objects' vertices, one object after the other.
fn vertices(scene: &Scene) -> Vec<Vertex> {
    let of = |(object, material): (&Object, u32)| -> Vec<Vertex> {
        let corners = object.mesh.positions.iter().zip(&object.mesh.normals);
        let vertex = |(&position_m, &normal)| Vertex { position_m, normal, material };
        corners.map(vertex).collect()
    };
    scene.objects.iter().zip(0..).flat_map(of).collect()
}

impl Geometry {
    pub fn new(resources: &Resources<'_>, scene: &Scene) -> Self {
        let vertices = vertices(scene);
        let mut base = 0;
        let mut indices = Vec::new();
        let mut materials = Vec::new();
        let mut objects = Vec::new();
        for object in &scene.objects {
            let first = indices.len() as u32;
            indices.extend(object.mesh.indices.iter().map(|i| i + base));
            base += object.mesh.positions.len() as u32;
            objects.push(first..indices.len() as u32);
            materials.push(MaterialUniforms {
                albedo: object.material.albedo.into(),
                tile_m: object.material.tile_m,
                accent: object.material.accent.into(),
                alpha: object.material.alpha,
                specular: object.material.specular,
            });
        }
        let mut material_bytes = StorageBuffer::new(Vec::new());
        material_bytes.write(&materials).expect("a Vec grows to whatever a shader type needs");
        Self {
            objects,
            index_count: indices.len() as u32,
            vertex_count: vertices.len() as u64,
            vertices: resources.filled(
                "vertices",
                bytemuck::cast_slice(&vertices),
                wgpu::BufferUsages::VERTEX
                    | wgpu::BufferUsages::STORAGE
                    | wgpu::BufferUsages::COPY_SRC,
            ),
            indices: resources.filled(
                "indices",
                bytemuck::cast_slice(&indices),
                wgpu::BufferUsages::INDEX | wgpu::BufferUsages::STORAGE,
            ),
            materials: resources.filled(
                "materials",
                &material_bytes.into_inner(),
                wgpu::BufferUsages::STORAGE,
            ),
        }
    }

    /// The content of the vertex buffer as it is made.
    pub fn vertex_bytes(scene: &Scene) -> Vec<u8> {
        bytemuck::cast_slice(&vertices(scene)).to_vec()
    }

    /// Layout of the vertex buffer; depth-only stages take the position alone.
    pub fn layout(position_only: bool) -> wgpu::VertexBufferLayout<'static> {
        wgpu::VertexBufferLayout {
            array_stride: size_of::<Vertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &ATTRIBUTES[..if position_only { 1 } else { 3 }],
        }
    }

    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        self.draw_part(pass, 0..self.index_count);
    }

    /// Draws a part of the indices, such as one of [`Geometry::objects`].
    pub fn draw_part(&self, pass: &mut wgpu::RenderPass<'_>, part: Range<u32>) {
        self.draw_instances(pass, part, 0..1);
    }

    /// Draws a part of the indices once for each instance.
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
        self.vertex_count
    }

    pub fn triangles(&self) -> u64 {
        u64::from(self.index_count) / 3
    }

    pub fn bytes(&self) -> u64 {
        self.vertex_count * size_of::<Vertex>() as u64 + u64::from(self.index_count) * 4
    }
}
