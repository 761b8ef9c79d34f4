//! Ray casting in f64 over all triangles of a scene.

use bvh::aabb::{Aabb, Bounded};
use bvh::bounding_hierarchy::BHShape;
use bvh::bvh::{Bvh, BvhNode, rayon_executor};
use glam::{DMat4, DVec3, DVec4, Vec3Swizzles as _};

use fathom_scene::{Bounds, Camera, Object, clip_polygon};

/// Boxes grow by this share of the scene's size, so that rounding in the slab test loses no flat triangle.
const BOX_PADDING: f64 = 1e-9;
/// Half of a box's area over that of what it holds from which it is split, and how often a triangle's is at most.
const LOOSE: f64 = 4.0;
const MAX_SPLITS: u32 = 5;

/// The nearest triangle along a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub position: DVec3,
    /// Unit normal of the triangle's plane, facing the ray's origin.
    pub normal: DVec3,
    /// Unit interpolated vertex normal as the mesh has it (not turned to the ray).
    pub shading_normal: DVec3,
    pub distance_m: f64,
    /// Index of the object in the scene.
    pub object: usize,
    /// Index of the triangle in its object's mesh.
    pub triangle: usize,
}

struct Triangle {
    corners: [DVec3; 3],
    normals: [DVec3; 3],
    object: usize,
    index: usize,
}

/// Distance, index of the triangle and barycentric weights of a hit.
type NearestHit = (f64, usize, [f64; 3]);

/// All triangles of a scene in a bounding volume hierarchy.
pub struct Tracer {
    triangles: Vec<Triangle>,
    /// Of each of the hierarchy's leaves the triangle.
    leaves: Vec<usize>,
    hierarchy: Bvh<f64, 3>,
    /// Largest coordinate, metres: tolerances are shares of it.
    pub size_m: f64,
}

impl Tracer {
    /// Builds the hierarchy over valid meshes. Triangles without area are left out: no ray hits them.
    pub fn new(objects: &[Object]) -> Tracer {
        let triangles: Vec<Triangle> =
            objects.iter().enumerate().flat_map(|(number, object)| split(object, number)).collect();
        let corners = triangles.iter().flat_map(|t| t.corners);
        let size_m = corners.fold(0.0f64, |size, p| size.max(p.abs().max_element()));
        let padding = BOX_PADDING * size_m;
        let mut boxes = Vec::new();
        for (number, triangle) in triangles.iter().enumerate() {
            split_box(&triangle.corners, MAX_SPLITS, &mut |Bounds { min, max }| {
                let [min, max] = [min - padding, max + padding].map(|p| p.to_array().into());
                boxes.push(Leaf { bounds: Aabb::with_bounds(min, max), triangle: number, node: 0 });
            });
        }
        let hierarchy = Bvh::build_with_executor(&mut boxes, rayon_executor);
        let leaves = boxes.iter().map(|leaf| leaf.triangle).collect();
        Tracer { triangles, leaves, hierarchy, size_m }
    }

    /// Nearest hit at a distance in (`min_m`, `max_m`) from the origin. `direction` has unit length.
    pub fn cast(&self, origin: DVec3, direction: DVec3, min_m: f64, max_m: f64) -> Option<Hit> {
        let inverse = direction.recip();
        let axes = Axes::along(direction);
        let mut best: Option<NearestHit> = None;
        let mut open = Vec::with_capacity(64);
        if !self.hierarchy.nodes.is_empty() {
            open.push((0.0, 0));
        }
        while let Some((entry, node)) = open.pop() {
            let limit = best.map_or(max_m, |(distance, ..)| distance);
            if entry > limit {
                continue;
            }
            match &self.hierarchy.nodes[node] {
                BvhNode::Leaf { shape_index, .. } => {
                    let triangle = self.leaves[*shape_index];
                    let corners = &self.triangles[triangle].corners;
                    if let Some((distance, weights)) = axes.intersect(origin, corners)
                        && distance > min_m
                        && distance < limit
                    {
                        best = Some((distance, triangle, weights));
                    }
                }
                BvhNode::Node {
                    child_l_index, child_l_aabb, child_r_index, child_r_aabb, ..
                } => {
                    // Each by itself: a closure of `map` stays a call, here and in `intersect`.
                    let left = (entry_m(child_l_aabb, origin, inverse), *child_l_index);
                    let right = (entry_m(child_r_aabb, origin, inverse), *child_r_index);
                    // The nearer one last, so that it is opened first.
                    for child in if left.0 < right.0 { [right, left] } else { [left, right] } {
                        if child.0 <= limit {
                            open.push(child);
                        }
                    }
                }
            }
        }
        best.map(|found| self.hit(origin, direction, found))
    }

    /// What is at a distance, in a triangle, at these barycentric weights.
    fn hit(&self, origin: DVec3, direction: DVec3, (distance_m, shape, w): NearestHit) -> Hit {
        let t = &self.triangles[shape];
        let [a, b, c] = t.corners;
        let plane = (b - a).cross(c - a).normalize();
        let interpolated = t.normals[0] * w[0] + t.normals[1] * w[1] + t.normals[2] * w[2];
        Hit {
            position: origin + direction * distance_m,
            normal: if plane.dot(direction) > 0.0 { -plane } else { plane },
            shading_normal: interpolated.normalize_or_zero(),
            distance_m,
            object: t.object,
            triangle: t.index,
        }
    }
}

/// A box around a triangle or a part of it, and the number of its node in the hierarchy.
struct Leaf {
    bounds: Aabb<f64, 3>,
    triangle: usize,
    node: usize,
}

impl Bounded<f64, 3> for Leaf {
    fn aabb(&self) -> Aabb<f64, 3> {
        self.bounds
    }
}

impl BHShape<f64, 3> for Leaf {
    fn set_bh_node_index(&mut self, index: usize) {
        self.node = index;
    }

    fn bh_node_index(&self) -> usize {
        self.node
    }
}

/// Boxes around a polygon in halves, as long as one is far larger than what it holds: rays would enter those of slanted bars in vain (Ernst and Greiner,
/// *Early Split Clipping for Bounding Volume Hierarchies*, 2007).
fn split_box(polygon: &[DVec3], splits: u32, add: &mut impl FnMut(Bounds)) {
    let bounds = Bounds::from_points(polygon.iter().copied());
    let size = bounds.size();
    let fan = polygon[1..].windows(2).map(|edge| (edge[0] - polygon[0], edge[1] - polygon[0]));
    let area = 0.5 * fan.map(|(a, b)| a.cross(b).length()).sum::<f64>();
    if splits == 0 || size.dot(size.zxy()) <= LOOSE * area {
        return add(bounds);
    }
    let axis = size.max_position();
    let middle = bounds.center()[axis];
    for side in [1.0, -1.0] {
        let inside = (DVec3::AXES[axis] * -side).extend(side * middle);
        split_box(&clip_polygon(polygon.to_vec(), &[inside]), splits - 1, add);
    }
}

/// Distance at which a ray enters the box, 0 from inside, by one over its direction; NaN where it misses it.
#[inline(always)]
fn entry_m(bounds: &Aabb<f64, 3>, origin: DVec3, inverse: DVec3) -> f64 {
    let (min, max) = (bounds.min, bounds.max);
    let a = (DVec3::new(min.x, min.y, min.z) - origin) * inverse;
    let b = (DVec3::new(max.x, max.y, max.z) - origin) * inverse;
    let (mut near, mut far) = (0.0, f64::INFINITY);
    for (a, b) in [(a.x, b.x), (a.y, b.y), (a.z, b.z)] {
        // Neither where zero times infinity is not a number: the ray lies in the plane of a side, and so between the two of this axis.
        if a < b {
            near = if a > near { a } else { near };
            far = if b < far { b } else { far };
        } else if a >= b {
            near = if b > near { b } else { near };
            far = if a < far { a } else { far };
        }
    }
    if near <= far { near } else { f64::NAN }
}

/// The triangles of an object that have an area.
fn split(object: &Object, number: usize) -> impl Iterator<Item = Triangle> {
    let mesh = &object.mesh;
    mesh.indices.chunks_exact(3).enumerate().filter_map(move |(index, vertices)| {
        let corners = mesh.triangle(index);
        let [a, b, c] = corners;
        let normals = [0, 1, 2].map(|k| wide(mesh.normals[vertices[k] as usize]));
        let triangle = Triangle { corners, normals, object: number, index };
        ((b - a).cross(c - a).length_squared() > 0.0).then_some(triangle)
    })
}

/// Shear that turns a ray into the +z axis, so that neighbouring triangles compute the very same
/// edge functions and no ray slips between them (Woop, Benthin and Wald, JCGT 2(1), 2013).
struct Axes {
    x: usize,
    y: usize,
    z: usize,
    shear: DVec3,
}

impl Axes {
    fn along(direction: DVec3) -> Axes {
        let d = direction;
        let z = d.abs().max_position();
        let (mut x, mut y) = ((z + 1) % 3, (z + 2) % 3);
        if d[z] < 0.0 {
            std::mem::swap(&mut x, &mut y);
        }
        Axes { x, y, z, shear: DVec3::new(d[x] / d[z], d[y] / d[z], 1.0 / d[z]) }
    }

    /// Distance and barycentric weights where the ray meets a triangle of either orientation.
    fn intersect(&self, origin: DVec3, corners: &[DVec3; 3]) -> Option<(f64, [f64; 3])> {
        let sheared = |corner: DVec3| {
            let p = corner - origin;
            (
                p[self.x] - self.shear.x * p[self.z],
                p[self.y] - self.shear.y * p[self.z],
                self.shear.z * p[self.z],
            )
        };
        let (a, b, c) = (sheared(corners[0]), sheared(corners[1]), sheared(corners[2]));
        let u = c.0 * b.1 - c.1 * b.0;
        let v = a.0 * c.1 - a.1 * c.0;
        let w = b.0 * a.1 - b.1 * a.0;
        let mixed = (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0);
        let sum = u + v + w;
        if mixed || sum == 0.0 {
            return None;
        }
        let weights = [u / sum, v / sum, w / sum];
        Some((weights[0] * a.2 + weights[1] * b.2 + weights[2] * c.2, weights))
    }
}

/// Rays through the pixels of a camera's image, and the depth that its rasterizer would store.
pub struct PixelRays {
    forward: DMat4,
    inverse: DMat4,
    width: u32,
    height: u32,
}

impl PixelRays {
    /// `width` × `height` pixels; the camera's aspect ratio is that of the image.
    pub fn new(camera: &Camera, width: u32, height: u32) -> PixelRays {
        let aspect = f64::from(width) / f64::from(height);
        PixelRays::of_matrix(camera.view_projection(aspect), width, height)
    }

    /// The same for any view-projection matrix, such as a light's.
    pub fn of_matrix(view_projection: DMat4, width: u32, height: u32) -> PixelRays {
        PixelRays { forward: view_projection, inverse: view_projection.inverse(), width, height }
    }

    /// Origin on the near plane, unit direction and length up to the far plane, at the centre of
    /// pixel (x, y), row 0 on top.
    pub fn ray(&self, x: u32, y: u32) -> (DVec3, DVec3, f64) {
        self.ray_at(f64::from(x) + 0.5, f64::from(y) + 0.5)
    }

    /// The same through any point of the image, in pixels.
    pub fn ray_at(&self, x_px: f64, y_px: f64) -> (DVec3, DVec3, f64) {
        let near = self.unproject(x_px, y_px, 0.0);
        let along = self.unproject(x_px, y_px, 1.0) - near;
        (near, along.normalize(), along.length())
    }

    /// World point at a place in pixels and a depth 0…1.
    pub fn unproject(&self, x_px: f64, y_px: f64, depth: f64) -> DVec3 {
        let ndc_x = 2.0 * x_px / f64::from(self.width) - 1.0;
        let ndc_y = 1.0 - 2.0 * y_px / f64::from(self.height);
        self.inverse.project_point3(DVec3::new(ndc_x, ndc_y, depth))
    }

    /// A world point in clip space.
    pub(super) fn clip(&self, point: DVec3) -> DVec4 {
        self.forward * point.extend(1.0)
    }

    /// Where a world point appears; `None` behind the eye.
    pub fn project(&self, point: DVec3) -> Option<Projected> {
        let clip = self.clip(point);
        if clip.w <= 0.0 {
            return None;
        }
        let ndc = clip.truncate() / clip.w;
        Some(Projected {
            x_px: (ndc.x * 0.5 + 0.5) * f64::from(self.width),
            y_px: (0.5 - ndc.y * 0.5) * f64::from(self.height),
            depth: ndc.z,
            w: clip.w,
        })
    }

    /// Nearest hit at the centre of pixel (x, y), with the depth that a rasterizer stores there.
    pub fn cast(&self, tracer: &Tracer, x: u32, y: u32) -> Option<(Hit, f64)> {
        let (origin, direction, length) = self.ray(x, y);
        let hit = tracer.cast(origin, direction, 0.0, length)?;
        Some((hit, self.project(hit.position)?.depth))
    }
}

/// A world point on an image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projected {
    pub x_px: f64,
    pub y_px: f64,
    /// 0 on the near plane, 1 on the far plane.
    pub depth: f64,
    /// Clip-space w: distance along the view direction for a perspective view, 1 for a parallel one.
    pub w: f64,
}

fn wide(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

#[cfg(test)]
mod tests {
    use itertools::iproduct;
    use proptest::prelude::*;

    use super::*;
    use fathom_scene::{Mesh, pcg};

    fn object(positions: Vec<[f32; 3]>, indices: Vec<u32>) -> Object {
        let normals = vec![[0.0, 1.0, 0.0]; positions.len()];
        Object::new("test", Mesh { positions, normals, indices })
    }

    /// Bumpy floor of side × side quads over [0, side]².
    fn floor(side: u32) -> Object {
        let row = side + 1;
        let positions = (0..row * row)
            .map(|i| {
                let bump = (f64::from(pcg(i)) / 4_294_967_296.0) as f32;
                [(i % row) as f32, bump - 2.0, (i / row) as f32]
            })
            .collect();
        let quad = |i: u32| {
            let at = (i / side) * row + i % side;
            [at, at + 1, at + row, at + 1, at + row + 1, at + row]
        };
        object(positions, (0..side * side).flat_map(quad).collect())
    }

    /// Nearest hit by plane equation and inside test of every triangle, no hierarchy.
    fn brute_force(object: &Object, origin: DVec3, direction: DVec3) -> Option<f64> {
        let mesh = &object.mesh;
        let corner = |i: &u32| wide(mesh.positions[*i as usize]);
        mesh.indices
            .chunks(3)
            .filter_map(|t| {
                let (a, b, c) = (corner(&t[0]), corner(&t[1]), corner(&t[2]));
                let n = (b - a).cross(c - a);
                let distance = (a - origin).dot(n) / direction.dot(n);
                let p = origin + direction * distance;
                let inside = [(a, b), (b, c), (c, a)]
                    .iter()
                    .all(|(s, e)| (*e - *s).cross(p - *s).dot(n) >= 0.0);
                (distance > 0.0 && inside).then_some(distance)
            })
            .min_by(f64::total_cmp)
    }

    /// Slanted bars over the floor, whose boxes are split.
    fn bars() -> Object {
        let random = |i: u32| (8.0 * f64::from(pcg(i)) / 4_294_967_296.0) as f32;
        let end = |i: u32| [random(i), 0.2 * random(i + 1) - 1.0, random(i + 2)];
        let bar = |i: u32| {
            let ([x, y, z], far) = (end(i), end(i + 3));
            [[x, y, z], [x + 0.1, y, z - 0.1], far]
        };
        object((0..60).flat_map(|i| bar(1_000 + 6 * i)).collect(), (0..180).collect())
    }

    proptest! {
        #[test]
        fn the_hierarchy_agrees_with_brute_force(
            x in 0.5..7.5f64, z in 0.5..7.5f64, dx in -2.0..2.0f64, dz in -2.0..2.0f64,
        ) {
            let objects = [floor(8), bars()];
            let origin = DVec3::new(x, 1.0, z);
            let direction = DVec3::new(dx, -1.0, dz).normalize();
            let tracer = Tracer::new(&objects);
            prop_assert!(tracer.leaves.len() > 2 * tracer.triangles.len());
            let hit = tracer.cast(origin, direction, 0.0, f64::MAX);
            let each = objects.iter().filter_map(|object| brute_force(object, origin, direction));
            let expected = each.min_by(f64::total_cmp);
            prop_assert_eq!(hit.is_some(), expected.is_some());
            if let (Some(hit), Some(expected)) = (hit, expected) {
                prop_assert!((hit.distance_m - expected).abs() < 1e-9);
                prop_assert!(hit.normal.dot(direction) < 0.0);
                prop_assert!((hit.position - (origin + direction * expected)).length() < 1e-9);
            }
        }
    }

    #[test]
    fn a_ray_enters_a_box_where_it_meets_it() {
        let bounds = Aabb::with_bounds([-1.0; 3].into(), [1.0; 3].into());
        let entry = |origin: DVec3, along: DVec3| {
            Some(entry_m(&bounds, origin, along.recip())).filter(|entry| !entry.is_nan())
        };
        assert_eq!(entry(DVec3::new(-3.0, 0.5, 0.0), DVec3::X), Some(2.0));
        assert_eq!(entry(DVec3::ZERO, DVec3::Y), Some(0.0));
        assert_eq!(entry(DVec3::new(-3.0, 0.5, 0.0), DVec3::NEG_X), None);
        assert_eq!(entry(DVec3::new(-3.0, 1.5, 0.0), DVec3::X), None);
        // Along sides and an edge.
        assert_eq!(entry(DVec3::new(-3.0, 1.0, 0.0), DVec3::X), Some(2.0));
        assert_eq!(entry(DVec3::new(-3.0, -1.0, 1.0), DVec3::X), Some(2.0));
    }

    #[test]
    fn no_ray_slips_through_shared_edges_and_vertices() {
        let tracer = Tracer::new(&[floor(8)]);
        for (i, j) in iproduct!(0..=28, 0..=28) {
            // Quarter steps run along edges, diagonals and through vertices.
            let origin = DVec3::new(0.5 + f64::from(i) * 0.25, 3.0, 0.5 + f64::from(j) * 0.25);
            assert!(tracer.cast(origin, DVec3::NEG_Y, 0.0, 10.0).is_some());
        }
    }

    #[test]
    fn ranges_are_respected_and_both_sides_hit() {
        let corners = vec![[-1.0, 0.0, -1.0], [1.0, 0.0, -1.0], [0.0, 0.0, 2.0]];
        let tracer = Tracer::new(&[object(corners, vec![0, 1, 2])]);
        let up = DVec3::new(0.0, 2.0, 0.0);
        assert!(tracer.cast(up, DVec3::NEG_Y, 0.0, 10.0).is_some());
        assert!(tracer.cast(up, DVec3::NEG_Y, 0.0, 1.9).is_none());
        assert!(tracer.cast(up, DVec3::NEG_Y, 2.1, 10.0).is_none());
        let below = tracer.cast(-up, DVec3::Y, 0.0, 10.0).unwrap();
        assert_eq!(below.normal, DVec3::NEG_Y);
        assert_eq!(below.object, 0);
    }

    #[test]
    fn nothing_and_flat_triangles_are_not_hit() {
        let none = Tracer::new(&[]);
        assert!(none.cast(DVec3::Y, DVec3::NEG_Y, 0.0, 10.0).is_none());
        let line = Tracer::new(&[object(vec![[0.0; 3], [1.0; 3], [2.0; 3]], vec![0, 1, 2])]);
        assert!(line.cast(DVec3::new(1.0, 2.0, 1.0), DVec3::NEG_Y, 0.0, 10.0).is_none());
    }

    #[test]
    fn pixel_rays_and_projection_are_inverse() {
        let camera = Camera::new([1.0, 2.0, 5.0], [0.0, -1.0, 0.0], 60.0, [0.1, 20.0]);
        let rays = PixelRays::new(&camera, 64, 36);
        for (x, y) in [(0, 0), (63, 35), (20, 7)] {
            let (origin, direction, length) = rays.ray(x, y);
            let p = rays.project(origin + direction * length * 0.3).unwrap();
            assert!((p.x_px - f64::from(x) - 0.5).abs() < 1e-9);
            assert!((p.y_px - f64::from(y) - 0.5).abs() < 1e-9);
            assert!(p.depth > 0.0 && p.depth < 1.0);
        }
        let behind = DVec3::from(camera.position_m) - camera.direction();
        assert!(rays.project(behind).is_none());
    }
}
