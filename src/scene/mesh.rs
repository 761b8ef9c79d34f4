//! Triangle meshes.

use glam::{DMat4, DVec3, Vec3};

use super::bounds::Bounds;

/// Indexed triangles, counter-clockwise seen from outside, with unit vertex normals.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Metres.
    pub positions: Vec<[f32; 3]>,
    /// One unit vector per position.
    pub normals: Vec<[f32; 3]>,
    /// Three per triangle.
    pub indices: Vec<u32>,
}

impl Mesh {
    /// Two triangles around `middle`, with half the sides `a` and `b`; the normal is that of `a` × `b`.
    pub fn parallelogram(middle: DVec3, a: DVec3, b: DVec3) -> Mesh {
        let corners = [-a - b, a - b, a + b, b - a];
        let positions = corners.map(|d| (middle + d).as_vec3().to_array());
        Mesh::smooth(positions.to_vec(), vec![0, 1, 2, 0, 2, 3])
    }

    /// The mesh with normals from [`Mesh::recompute_normals`].
    pub fn smooth(positions: Vec<[f32; 3]>, indices: Vec<u32>) -> Mesh {
        let mut mesh = Mesh { positions, normals: Vec::new(), indices };
        mesh.recompute_normals();
        mesh
    }

    pub fn triangle_count(&self) -> usize {
        self.indices.len() / 3
    }

    pub fn bounds(&self) -> Bounds {
        Bounds::from_points(self.positions.iter().map(|p| Vec3::from(*p).as_dvec3()))
    }

    /// The corners of triangle `index`.
    pub fn triangle(&self, index: usize) -> [DVec3; 3] {
        std::array::from_fn(|k| {
            let vertex = self.indices[3 * index + k] as usize;
            Vec3::from(self.positions[vertex]).as_dvec3()
        })
    }

    /// Moves the mesh; a mirroring transform also turns the triangles over: they stay counter-clockwise.
    #[must_use]
    pub fn transformed(mut self, transform: &DMat4) -> Mesh {
        let normal_matrix = glam::DMat3::from_mat4(*transform).inverse().transpose();
        for p in &mut self.positions {
            let moved = transform.transform_point3(Vec3::from(*p).as_dvec3());
            *p = moved.as_vec3().to_array();
        }
        for n in &mut self.normals {
            let normal = normal_matrix * Vec3::from(*n).as_dvec3();
            *n = normal.normalize_or(DVec3::Y).as_vec3().to_array();
        }
        if transform.determinant() < 0.0 {
            self.flip();
        }
        self
    }

    /// The mesh inside out: walls that are seen from within.
    #[must_use]
    pub fn inverted(mut self) -> Mesh {
        self.flip();
        for n in &mut self.normals {
            *n = n.map(|c| -c);
        }
        self
    }

    pub fn append(&mut self, other: &Mesh) {
        let first = self.positions.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.normals.extend_from_slice(&other.normals);
        self.indices.extend(other.indices.iter().map(|i| i + first));
    }

    /// Vertex normals from the triangles around each vertex, weighted by area; +y without area.
    pub fn recompute_normals(&mut self) {
        self.normals = vec![[0.0; 3]; self.positions.len()];
        self.complete_normals();
    }

    /// The same of those that are 0.
    pub(super) fn complete_normals(&mut self) {
        let mut sums = vec![DVec3::ZERO; self.positions.len()];
        for t in 0..self.triangle_count() {
            let [a, b, c] = self.triangle(t);
            let doubled_area = (b - a).cross(c - a);
            for k in 0..3 {
                sums[self.indices[3 * t + k] as usize] += doubled_area;
            }
        }
        let normals = self.normals.iter_mut().zip(sums);
        for (normal, sum) in normals.filter(|(normal, _)| **normal == [0.0; 3]) {
            *normal = sum.normalize_or(DVec3::Y).as_vec3().to_array();
        }
    }

    /// Whether the arrays agree and hold usable numbers; the error says what is wrong and where.
    pub fn validate(&self) -> Result<(), String> {
        let [indices, normals, count] =
            [self.indices.len(), self.normals.len(), self.positions.len()];
        if indices == 0 {
            return Err("it has no triangles".into());
        }
        if !indices.is_multiple_of(3) {
            return Err(format!("{indices} indices are not a whole number of triangles"));
        }
        if normals != count {
            return Err(format!("{normals} normals for {count} vertices"));
        }
        let finite = |v: &[f32; 3]| v.iter().all(|c| c.is_finite());
        if let Some(i) = self.positions.iter().position(|p| !finite(p)) {
            return Err(format!("vertex {i} is not finite"));
        }
        if let Some(i) = self.normals.iter().position(|n| !finite(n)) {
            return Err(format!("the normal of vertex {i} is not finite"));
        }
        if let Some(i) = self.indices.iter().position(|&i| i as usize >= count) {
            let (triangle, vertex) = (i / 3, self.indices[i]);
            return Err(format!("triangle {triangle} uses vertex {vertex}, but there are {count}"));
        }
        Ok(())
    }

    /// Signed volume of closed meshes: positive where triangles face outward.
    #[cfg(test)]
    pub fn volume(&self) -> f64 {
        let corners = (0..self.triangle_count()).map(|t| self.triangle(t));
        corners.map(|[a, b, c]| a.dot(b.cross(c)) / 6.0).sum()
    }

    fn flip(&mut self) {
        for triangle in self.indices.chunks_exact_mut(3) {
            triangle.swap(1, 2);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::check::{InvalidCase, assert_refused};
    use super::*;

    fn triangle() -> Mesh {
        let corners = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        Mesh::smooth(corners.to_vec(), vec![0, 1, 2])
    }

    fn face_normal(mesh: &Mesh) -> DVec3 {
        let [a, b, c] = mesh.triangle(0);
        (b - a).cross(c - a).normalize()
    }

    #[test]
    fn counter_clockwise_triangles_face_their_viewer() {
        assert_eq!(triangle().normals, vec![[0.0, 0.0, 1.0]; 3]);
    }

    #[test]
    fn mirroring_keeps_winding_and_normals_together() {
        let mirror = DMat4::from_scale(DVec3::new(-2.0, 1.0, 1.0));
        for mesh in [triangle().transformed(&mirror), triangle().inverted()] {
            let n = Vec3::from(mesh.normals[0]).as_dvec3();
            assert!(face_normal(&mesh).dot(n) > 0.999);
        }
    }

    #[test]
    fn faults_are_found() {
        let cases: &[InvalidCase<Mesh>] = &[
            (|m| m.indices[2] = 7, "uses vertex 7"),
            (|m| m.positions[1][0] = f32::NAN, "vertex 1"),
            (|m| m.indices.clear(), "no triangles"),
            (|m| m.indices.truncate(2), "whole number"),
            (|m| m.normals.clear(), "0 normals"),
        ];
        assert_refused(&triangle(), Mesh::validate, cases);
    }
}
