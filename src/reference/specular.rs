//! Light that mirrors and glass pass on: exact ray casting against triangles, and Snell's law at the meshes' interpolated normals, which stand
//! for the smooth surface (SPT §2.3, §4).

use glam::DVec3;

use super::optics::refract;
use super::rays::{Hit, Tracer};
use fathom_scene::{Object, Optics};

/// A ray that starts on a surface ignores hits nearer than this share of the scene: meshes hold 32-bit floats.
const SELF_HIT: f64 = 1e-7;

/// Light on its way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    pub origin: DVec3,
    /// Unit.
    pub direction: DVec3,
    /// Refractive index around it, that of glass inside glass.
    pub index: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PathEnd {
    /// On a surface that is neither mirror nor glass, after so many metres beside glass.
    Diffuse(Hit, f64),
    /// It meets nothing more.
    Leaves(Ray),
    /// It has met mirrors and glass as often as it may, and is on one of them.
    StillBouncing,
}

/// Surfaces that light meets.
pub struct Surfaces<'a> {
    pub tracer: &'a Tracer,
    /// Those of the tracer.
    pub objects: &'a [Object],
    /// Refractive index around the objects.
    pub outside: f64,
    /// Light ends at this height, metres: the water's surface for light under water.
    pub top_m: f64,
}

impl Surfaces<'_> {
    pub fn ray(&self, origin: DVec3, direction: DVec3) -> Ray {
        Ray { origin, direction, index: self.outside }
    }

    /// A line of sight: it begins in glass where the first surface that it meets shows its inner side.
    pub fn sight(&self, origin: DVec3, direction: DVec3) -> Ray {
        let ray = self.ray(origin, direction);
        let first = self.meet(&ray).filter(|hit| hit.normal.dot(hit.shading_normal) < 0.0);
        let inside = first.map(|hit| &self.objects[hit.object].material);
        let inside = inside.filter(|material| material.optics == Optics::Glass);
        Ray { index: inside.map_or(self.outside, |glass| glass.refractive_index.into()), ..ray }
    }

    /// What a ray meets first.
    pub fn meet(&self, ray: &Ray) -> Option<Hit> {
        let rise = ray.direction.y;
        let max_m = if rise > 0.0 { (self.top_m - ray.origin.y) / rise } else { f64::MAX };
        self.tracer.cast(ray.origin, ray.direction, SELF_HIT * self.tracer.size_m, max_m)
    }

    /// The ray behind a hit on a mirror or on glass; none on other surfaces. Totally reflected light stays before the surface.
    pub fn continue_ray(&self, ray: &Ray, hit: &Hit) -> Option<Ray> {
        let material = &self.objects[hit.object].material;
        let normal = hit.shading_normal;
        let mirrored = ray.direction - 2.0 * ray.direction.dot(normal) * normal;
        let (direction, index) = match material.optics {
            Optics::Diffuse => return None,
            Optics::Mirror => (mirrored, ray.index),
            Optics::Glass => {
                let inside = ray.index != self.outside;
                let behind =
                    if inside { self.outside } else { f64::from(material.refractive_index) };
                let refracted = refract(ray.direction, normal, ray.index, behind);
                refracted.map_or((mirrored, ray.index), |direction| (direction, behind))
            }
        };
        Some(Ray { origin: hit.position, direction: direction.normalize(), index })
    }

    /// Follows a ray past at most so many mirrors and surfaces of glass.
    pub fn trace(&self, ray: Ray, bounces: u32) -> PathEnd {
        let (mut ray, mut outside_m) = (ray, 0.0);
        for _ in 0..=bounces {
            let Some(hit) = self.meet(&ray) else { return PathEnd::Leaves(ray) };
            outside_m += if ray.index == self.outside { hit.distance_m } else { 0.0 };
            let Some(behind) = self.continue_ray(&ray, &hit) else {
                return PathEnd::Diffuse(hit, outside_m);
            };
            ray = behind;
        }
        PathEnd::StillBouncing
    }

    /// The ray behind its first so many mirrors and surfaces of glass; none where it meets fewer.
    pub fn ray_behind(&self, ray: Ray, surfaces: u32) -> Option<Ray> {
        (0..surfaces).try_fold(ray, |ray, _| self.continue_ray(&ray, &self.meet(&ray)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fathom_scene::{Material, Mesh};

    const GLASS: f64 = 1.5;

    /// A level square of a material at a height.
    fn level(y: f64, optics: Optics) -> Object {
        let mesh = Mesh::parallelogram(DVec3::Y * y, DVec3::Z * 50.0, DVec3::X * 50.0);
        let refractive_index = GLASS as f32;
        let material = Material { optics, refractive_index, ..Material::default() };
        Object { material, ..Object::new("square", mesh) }
    }

    fn surfaces<'a>(tracer: &'a Tracer, objects: &'a [Object]) -> Surfaces<'a> {
        Surfaces { tracer, objects, outside: 1.0, top_m: 10.0 }
    }

    #[test]
    fn a_slab_shifts_a_ray_by_its_closed_form_and_keeps_its_direction() {
        let objects = [level(1.0, Optics::Glass), level(0.0, Optics::Glass)];
        let tracer = Tracer::new(&objects);
        for degrees in [10.0f64, 45.0, 80.0] {
            let (sin_i, cos_i) = degrees.to_radians().sin_cos();
            let direction = DVec3::new(sin_i, -cos_i, 0.0);
            let surfaces = surfaces(&tracer, &objects);
            let start = surfaces.ray(DVec3::new(0.0, 1.0, 0.0) - direction, direction);
            let out = surfaces.ray_behind(start, 2).unwrap();
            let sin_t = sin_i / GLASS;
            let expected = DVec3::new(sin_t / (1.0 - sin_t * sin_t).sqrt(), 0.0, 0.0);
            assert!(out.origin.distance(expected) < 1e-9, "{degrees}");
            assert!(out.direction.distance(direction) < 1e-9 && out.index == 1.0);
            assert!(matches!(surfaces.trace(start, 2), PathEnd::Leaves(ray) if ray == out));
            assert_eq!(surfaces.trace(start, 1), PathEnd::StillBouncing);
        }
    }

    #[test]
    fn mirrors_reflect_and_light_stays_under_the_top() {
        let objects = [level(0.0, Optics::Mirror), level(4.0, Optics::Diffuse)];
        let tracer = Tracer::new(&objects);
        let ray = |surfaces: &Surfaces<'_>| {
            surfaces.ray(DVec3::new(0.0, 3.0, 0.0), DVec3::new(0.6, -0.8, 0.0))
        };
        let open = surfaces(&tracer, &objects);
        let PathEnd::Diffuse(hit, _) = open.trace(ray(&open), 1) else {
            panic!("it meets the ceiling")
        };
        assert!(hit.position.distance(DVec3::new(2.25 + 3.0, 4.0, 0.0)) < 1e-9);
        let low = Surfaces { top_m: 3.5, ..open };
        assert!(matches!(low.trace(ray(&low), 1), PathEnd::Leaves(_)));
    }

    #[test]
    fn light_is_totally_reflected_inside_beyond_the_critical_angle() {
        let objects = [level(1.0, Optics::Glass), level(0.0, Optics::Glass)];
        let tracer = Tracer::new(&objects);
        let surfaces = surfaces(&tracer, &objects);
        for (degrees, leaves) in [(41.0f64, true), (42.5, false)] {
            let (sin_i, cos_i) = degrees.to_radians().sin_cos();
            let direction = DVec3::new(sin_i, -cos_i, 0.0);
            let ray = Ray { index: GLASS, ..surfaces.ray(DVec3::new(0.0, 0.5, 0.0), direction) };
            let behind = surfaces.ray_behind(ray, 1).unwrap();
            assert_eq!(behind.index == 1.0, leaves);
            assert_eq!(behind.direction.y < 0.0, leaves);
        }
    }
}
