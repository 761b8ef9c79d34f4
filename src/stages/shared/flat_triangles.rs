//! Triangles with a first vertex that no other triangle begins with. It carries the triangle's own normal: a flat varying takes its
//! value from the first vertex. There are at least as many vertices as triangles, where without an index buffer there are three times as many.

use bytemuck::{Pod, Zeroable, cast_slice};
use glam::Vec3;

use crate::geometry::Objects;
use fathom_gpu::kit::{Buffer, Resources};
use fathom_scene::{Mesh, Scene};

/// Host twin of `Corner` in `shaders/ldi/peel.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct FlatVertex {
    position_m: [f32; 3],
    shading_normal: [f32; 3],
    material: u32,
    geometric_normal: [f32; 3],
}

const ATTRIBUTES: [wgpu::VertexAttribute; 4] =
    wgpu::vertex_attr_array![0 => Float32x3, 1 => Float32x3, 2 => Uint32, 3 => Float32x3];

pub struct FlatTriangles {
    vertices: Buffer,
    indices: Buffer,
}

/// Unit normal of a triangle on the side of its vertices' normals; zero where it has no area.
fn geometric_normal(corners: [FlatVertex; 3]) -> Vec3 {
    let [a, b, c] = corners.map(|corner| Vec3::from(corner.position_m));
    let normal = (b - a).cross(c - a).normalize_or_zero();
    let outwards: Vec3 = corners.iter().map(|corner| Vec3::from(corner.shading_normal)).sum();
    if normal.dot(outwards) < 0.0 { -normal } else { normal }
}

fn append(vertices: &mut Vec<FlatVertex>, indices: &mut Vec<u32>, mesh: &Mesh, material: u32) {
    let base = vertices.len();
    let vertex = |(&position_m, &shading_normal)| FlatVertex {
        position_m,
        shading_normal,
        material,
        geometric_normal: [0.0; 3],
    };
    vertices.extend(mesh.positions.iter().zip(&mesh.normals).map(vertex));
    let mut is_first = vec![false; mesh.positions.len()];
    for corners in mesh.indices.chunks_exact(3) {
        let free = (0..3).find(|corner| !is_first[corners[*corner] as usize]);
        let turn = free.unwrap_or(0);
        let [mut a, b, c] = [0, 1, 2].map(|i| base + corners[(turn + i) % 3] as usize);
        if free.is_some() {
            is_first[a - base] = true;
        } else {
            vertices.push(vertices[a]);
            a = vertices.len() - 1;
        }
        vertices[a].geometric_normal = geometric_normal([a, b, c].map(|i| vertices[i])).into();
        indices.extend([a, b, c].map(|i| i as u32));
    }
}

fn flat_triangles(scene: &Scene, part: Objects) -> (Vec<FlatVertex>, Vec<u32>) {
    let (mut vertices, mut indices) = (Vec::new(), Vec::new());
    for (object, material) in scene.objects.iter().zip(0..) {
        if part.holds(&object.material) {
            append(&mut vertices, &mut indices, &object.mesh, material);
        }
    }
    (vertices, indices)
}

impl FlatTriangles {
    pub fn new(resources: &Resources<'_>, scene: &Scene, part: Objects) -> Self {
        let (vertices, indices) = flat_triangles(scene, part);
        let [of_vertices, of_indices] = [wgpu::BufferUsages::VERTEX, wgpu::BufferUsages::INDEX];
        Self {
            vertices: resources.filled("flat vertices", cast_slice(&vertices), of_vertices),
            indices: resources.filled("flat indices", cast_slice(&indices), of_indices),
        }
    }

    pub fn layout() -> wgpu::VertexBufferLayout<'static> {
        wgpu::VertexBufferLayout {
            array_stride: size_of::<FlatVertex>() as u64,
            step_mode: wgpu::VertexStepMode::Vertex,
            attributes: &ATTRIBUTES,
        }
    }

    pub fn draw(&self, pass: &mut wgpu::RenderPass<'_>) {
        if self.triangles() > 0 {
            pass.set_vertex_buffer(0, self.vertices.slice(..));
            pass.set_index_buffer(self.indices.slice(..), wgpu::IndexFormat::Uint32);
            pass.draw_indexed(0..3 * self.triangles() as u32, 0, 0..1);
        }
    }

    pub fn triangles(&self) -> u64 {
        self.indices.size() / 12
    }

    pub fn bytes(&self) -> u64 {
        self.vertices.size() + self.indices.size()
    }
}
