//! The Utah teapot, tessellated from its 32 bicubic Bézier patches.
//!
//! Control points: M. E. Newell, *The Utilization of Procedure Models in Digital Image Synthesis*, University of Utah, 1975; the four
//! patches of the bottom were added later. Both are listed in F. Crow, *The Origins of the Teapot*, IEEE Computer Graphics and
//! Applications 7(1), 1987. Most points follow from others by symmetry; here each stands once, in the units of the data, +z up.

use fathom_base::settings;
use glam::{DMat4, DVec3};
use itertools::iproduct;

use crate::Mesh;
use crate::shapes::{merged, sheet};

settings! {
    pub struct Teapot {
        /// Quads along each side of a patch: 6 make 2,256 triangles, SPT Table 1 has 2,257. With 1 the lip of the spout has no area.
        divisions: u32 = 6 => 2 ..= 40, "1";
    }
}

/// Height of the data.
const HEIGHT: f64 = 3.15;

/// Control points of a quarter turn about the z axis: r, t and z stand for (r, 0, z), (r, t, z), (t, r, z) and (0, r, z).
type Ring = [f64; 3];

/// The turned parts, four patches each, from the rim or the knob outwards and down.
const TURNED: [[Ring; 4]; 6] = [
    // Rim.
    [[1.4, 0.784, 2.4], [1.3375, 0.749, 2.53125], [1.4375, 0.805, 2.53125], [1.5, 0.84, 2.4]],
    // Upper and lower body.
    [[1.5, 0.84, 2.4], [1.75, 0.98, 1.875], [2.0, 1.12, 1.35], [2.0, 1.12, 0.9]],
    [[2.0, 1.12, 0.9], [2.0, 1.12, 0.45], [1.5, 0.84, 0.225], [1.5, 0.84, 0.15]],
    // Knob and lid.
    [[0.0, 0.0, 3.15], [0.8, 0.45, 3.15], [0.0, 0.0, 2.85], [0.2, 0.112, 2.7]],
    [[0.2, 0.112, 2.7], [0.4, 0.224, 2.55], [1.3, 0.728, 2.55], [1.3, 0.728, 2.4]],
    // Bottom.
    [[1.5, 0.84, 0.15], [1.5, 0.84, 0.075], [1.425, 0.798, 0.0], [0.0, 0.0, 0.0]],
];

/// Control points across a half of handle or spout: (x, z) of the first two, (x, z) of the last two, and the width w: y is 0, −w, −w, 0.
type CrossSection = [f64; 5];

/// The parts with a mirror image at y > 0, from the body outwards.
const MIRRORED: [[CrossSection; 4]; 4] = [
    // Upper and lower handle.
    [
        [-1.6, 2.025, -1.5, 2.25, 0.3],
        [-2.3, 2.025, -2.5, 2.25, 0.3],
        [-2.7, 2.025, -3.0, 2.25, 0.3],
        [-2.7, 1.8, -3.0, 1.8, 0.3],
    ],
    [
        [-2.7, 1.8, -3.0, 1.8, 0.3],
        [-2.7, 1.575, -3.0, 1.35, 0.3],
        [-2.5, 1.125, -2.65, 0.9375, 0.3],
        [-2.0, 0.9, -1.9, 0.6, 0.3],
    ],
    // Spout and its lip.
    [
        [1.7, 1.425, 1.7, 0.6, 0.66],
        [2.6, 1.425, 3.1, 0.825, 0.66],
        [2.3, 2.1, 2.4, 2.025, 0.25],
        [2.7, 2.4, 3.3, 2.4, 0.25],
    ],
    [
        [2.7, 2.4, 3.3, 2.4, 0.25],
        [2.8, 2.475, 3.525, 2.49375, 0.25],
        [2.9, 2.475, 3.45, 2.5125, 0.15],
        [2.8, 2.4, 3.2, 2.4, 0.15],
    ],
];

/// A bicubic Bézier patch: rows along v, in each the points along u. ∂u × ∂v points outward.
struct BezierPatch([[DVec3; 4]; 4]);

pub fn teapot(a: &Teapot) -> Mesh {
    let n = a.divisions as usize;
    let upright = DMat4::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let size = DMat4::from_scale(DVec3::splat(1.0 / HEIGHT));
    merged(patches().map(|patch| patch.mesh(n))).transformed(&(size * upright))
}

fn patches() -> impl Iterator<Item = BezierPatch> {
    let quarters = iproduct!(TURNED, 0..4).map(|(rings, k)| BezierPatch::quarter(&rings, k));
    let halves =
        iproduct!(MIRRORED, [false, true]).map(|(part, image)| BezierPatch::half(&part, image));
    quarters.chain(halves)
}

impl BezierPatch {
    /// The `k`-th quarter turn.
    fn quarter(rings: &[Ring; 4], k: usize) -> BezierPatch {
        let axes = [DVec3::X, DVec3::Y, DVec3::NEG_X, DVec3::NEG_Y];
        let (x, y) = (axes[k], axes[(k + 1) % 4]);
        BezierPatch(rings.map(|[r, t, z]| {
            [r * y, t * x + r * y, r * x + t * y, r * x].map(|p| p + z * DVec3::Z)
        }))
    }

    /// The half at y < 0, or its mirror image.
    fn half(sections: &[CrossSection; 4], mirrored: bool) -> BezierPatch {
        BezierPatch(sections.map(|[x0, z0, x1, z1, width]| {
            let row = [(x0, 0.0, z0), (x0, -width, z0), (x1, -width, z1), (x1, 0.0, z1)];
            if mirrored {
                let [a, b, c, d] = row.map(|(x, y, z)| DVec3::new(x, -y, z));
                [d, c, b, a]
            } else {
                row.map(DVec3::from)
            }
        }))
    }

    /// `n` × `n` quads, without the triangles that a pole draws together.
    fn mesh(&self, n: usize) -> Mesh {
        let mut mesh = sheet((n, n), |u, v| self.weighted(weights(u), weights(v)));
        let places =
            iproduct!(0..=n, 0..=n).map(|(j, i)| (i as f64 / n as f64, j as f64 / n as f64));
        mesh.normals = places.map(|(u, v)| self.normal(u, v).as_vec3().to_array()).collect();
        mesh
    }

    /// The sum of the control points with these weights along u and v.
    fn weighted(&self, along_u: [f64; 4], along_v: [f64; 4]) -> DVec3 {
        iproduct!(0..4, 0..4).map(|(j, i)| self.0[j][i] * (along_u[i] * along_v[j])).sum()
    }

    /// The unit normal. At a pole, v = 0 or 1, ∂u is 0: its direction is the limit, that of ∓∂u∂v.
    fn normal(&self, u: f64, v: f64) -> DVec3 {
        let du = self.weighted(slopes(u), weights(v));
        let along_u = if du.length() < 1e-9 {
            (1.0 - 2.0 * v) * self.weighted(slopes(u), slopes(v))
        } else {
            du
        };
        along_u.cross(self.weighted(weights(u), slopes(v))).normalize()
    }
}

/// The cubic Bernstein polynomials.
fn weights(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [s * s * s, 3.0 * s * s * t, 3.0 * s * t * t, t * t * t]
}

/// Their derivatives.
fn slopes(t: f64) -> [f64; 4] {
    let s = 1.0 - t;
    [-3.0 * s * s, 3.0 * s * (s - 2.0 * t), 3.0 * t * (2.0 * s - t), 3.0 * t * t]
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn position(mesh: &Mesh, i: u32) -> DVec3 {
        Vec3::from(mesh.positions[i as usize]).as_dvec3()
    }

    fn normal(mesh: &Mesh, i: u32) -> DVec3 {
        Vec3::from(mesh.normals[i as usize]).as_dvec3()
    }

    #[test]
    fn vertices_of_a_patch_are_shared_and_no_triangle_is_degenerate() {
        for divisions in [2, 6, 7, 40] {
            let mesh = teapot(&Teapot { divisions });
            let n = divisions as usize;
            assert_eq!(mesh.positions.len(), 32 * (n + 1) * (n + 1));
            // Eight patches end in a pole.
            assert_eq!(mesh.triangle_count(), 64 * n * n - 8 * n);
            let sides = (0..mesh.triangle_count()).map(|t| mesh.triangle(t));
            let areas = sides.map(|[a, b, c]| (b - a).cross(c - a).length());
            assert!(areas.fold(f64::INFINITY, f64::min) > 1e-8, "{divisions}");
        }
        // The default, with the triangles of the paper.
        assert!(teapot(&Teapot::default()).triangle_count().abs_diff(2257) <= 10);
    }

    /// Normals of the patches' derivatives against those of ever smaller triangles around the vertex.
    #[test]
    fn normals_are_those_of_the_surface_at_the_poles_too() {
        let mesh = teapot(&Teapot { divisions: 40 });
        for (pole, expected) in [(1.0, DVec3::Y), (0.0, DVec3::NEG_Y)] {
            let at_pole: Vec<u32> = (0..mesh.positions.len() as u32)
                .filter(|i| position(&mesh, *i).distance(DVec3::Y * pole) < 1e-6)
                .collect();
            assert_eq!(at_pole.len(), 4 * 41);
            for i in at_pole {
                assert!(normal(&mesh, i).distance(expected) < 1e-5, "{pole} {}", normal(&mesh, i));
            }
        }
        let around = Mesh::smooth(mesh.positions.clone(), mesh.indices.clone());
        let far = (0..mesh.indices.len())
            .filter(|k| {
                normal(&mesh, mesh.indices[*k]).dot(normal(&around, mesh.indices[*k])) < 0.98
            })
            .count();
        assert!(far * 100 < mesh.indices.len(), "{far} of {}", mesh.indices.len());
    }
}
