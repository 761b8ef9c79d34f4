//! The part of the light's frustum in which photons start: the least rectangle through which light reaches the water in view.

use std::f64::consts::TAU;

use glam::{DMat4, DVec2, DVec3, DVec4, Vec3Swizzles};
use itertools::{Itertools, iproduct};

use super::bounds::Bounds;
use super::camera::Camera;
use super::frustum::{Rectangle, clip_polygon, frustum_planes, planes, visible_points};
use super::light_frame::{LightFrame, LightKind, tangent};
use super::water::Water;

/// A rectangle across the light's axis, turned about it: metres across a directional light's rays, tangents of a point light's angles.
pub(super) struct PhotonStart {
    /// Unit vector along its first side.
    side: DVec2,
    /// Its extent along that side and across it.
    within: Rectangle,
}

impl PhotonStart {
    /// None where no light that lands in view enters the water.
    pub(super) fn new(frame: &LightFrame, entries: &[DVec3], water: &Water) -> Option<PhotonStart> {
        let level = |p: &DVec2| DVec3::new(p.x, 0.0, p.y);
        let hull = hull(&entries.iter().map(|p| p.xz()).collect::<Vec<_>>());
        let lit = clip_polygon(hull.iter().map(level).collect(), &planes(&water.bounds()));
        // Of a point light's frustum only what lies within has a place across the axis.
        let frustum = &frustum_planes(&frame.view_projection)[..4];
        // Faces of the waves' prism: trough, crest and sides.
        let heights = [-water.bound_m(), water.bound_m()];
        let mut faces = heights.map(|y| lit.iter().map(|p| p.with_y(y)).collect()).to_vec();
        faces.extend(lit.iter().circular_tuple_windows().map(|(a, b)| {
            let [low, high] = heights;
            vec![a.with_y(low), b.with_y(low), b.with_y(high), a.with_y(high)]
        }));
        let places = faces.into_iter().flat_map(|face| clip_polygon(face, frustum));
        let places = places.map(|p| across(frame, p));
        PhotonStart::from_points(&places.collect::<Vec<_>>())
    }

    /// The smallest rectangle around points has a side along one of their hull (Freeman and Shapira 1975).
    fn from_points(points: &[DVec2]) -> Option<PhotonStart> {
        let hull = hull(points);
        let edges = hull.iter().circular_tuple_windows();
        let sides = edges.filter_map(|(a, b)| (*b - *a).try_normalize());
        let rotated = sides.map(|side| {
            let rotate = |p: &DVec2| DVec2::new(side.dot(*p), side.perp().dot(*p));
            PhotonStart { side, within: Rectangle::from_points(hull.iter().map(rotate)) }
        });
        let smallest = rotated.min_by(|a, b| a.within.area().total_cmp(&b.within.area()))?;
        (smallest.within.area() > 0.0).then_some(smallest)
    }

    pub(super) fn rectangle(&self) -> &Rectangle {
        &self.within
    }

    /// From places of the rectangle, −1 … 1 along each side, to normalized device coordinates of the light's frustum.
    pub(super) fn placement(&self, projection: &DMat4) -> DMat4 {
        // Both kinds of projection map a point at unit distance by its two coordinates alone.
        let ndc = |along: DVec2| {
            let at = self.side * along.x + self.side.perp() * along.y;
            projection.project_point3(at.extend(-1.0)).truncate()
        };
        let Rectangle { min, max } = self.within;
        let (middle, half) = (0.5 * (min + max), 0.5 * (max - min));
        let axis = |half: DVec2| (ndc(middle + half) - ndc(middle)).extend(0.0).extend(0.0);
        DMat4::from_cols(
            axis(half.with_y(0.0)),
            axis(half.with_x(0.0)),
            DVec4::Z,
            ndc(middle).extend(0.0).extend(1.0),
        )
    }
}

/// A light, and the water that refracts it.
pub(super) struct Refraction<'a> {
    pub kind: LightKind,
    pub position: DVec3,
    /// The way a directional light travels.
    pub forward: DVec3,
    pub water: &'a Water,
    /// [`Water::steepest`].
    pub steepest: f64,
}

/// Sides of the polygon around the places where light enters that reaches a point.
const SIDES: u32 = 16;
/// Halvings that find level water's place, and a corner of the polygon.
const HALVINGS: [u32; 2] = [40, 12];
/// Light that enters farther away than this many depths is not looked for.
const FARTHEST: f64 = 1e4;

impl Refraction<'_> {
    /// Places around all where light that lands in view enters the water.
    pub(super) fn entries(&self, view: (&Camera, f64), bounds: &Bounds) -> Vec<DVec3> {
        let crest_m = self.water.bound_m();
        let wet = Bounds { max: bounds.max.with_y(bounds.max.y.min(crest_m)), ..*bounds };
        let mut seen: Vec<DVec3> = Vec::new();
        for p in visible_points(view.0, view.1, &wet) {
            if seen.iter().all(|other| other.distance(p) > 1e-9 * p.length()) {
                seen.push(p);
            }
        }
        // Parallel light enters at the same places around all points.
        let directional = self.kind == LightKind::Directional;
        let alike = directional.then(|| self.around(DVec3::NEG_Y, 0.0));
        let mut entries = Vec::new();
        for (p, height_m) in iproduct!(seen, [-crest_m, crest_m]) {
            match &alike {
                Some(around) => {
                    let depth_m = (height_m - p.y).max(0.0);
                    entries.extend(around.iter().map(|e| p + depth_m * (*e + DVec3::Y)));
                }
                None => entries.extend(self.around(p, height_m)),
            }
        }
        entries
    }

    /// Around all places where light enters at this height that reaches a point below. It enters about where it would through level water,
    /// as far from there as the steepest wave sends it. For a point light that place changes between points, and the straight ray's and
    /// that above the point stand in: it lies between them.
    fn around(&self, p: DVec3, height_m: f64) -> Vec<DVec3> {
        let (across, height_m) = match self.kind {
            LightKind::Directional => (self.forward / -self.forward.y, height_m),
            LightKind::Point => {
                let to_light = self.position - p;
                (-to_light / to_light.y.max(MIN_FALL), height_m.min(0.999 * self.position.y))
            }
        };
        let (across, depth_m) = (across.with_y(0.0), (height_m - p.y).max(0.0));
        let above = p + DVec3::Y * depth_m;
        let straight = above - across * depth_m;
        let mut level = [straight, above];
        for _ in 0..HALVINGS[0] {
            let middle = level[0].midpoint(level[1]);
            level[usize::from(self.normal(middle, p).0.dot(across) > 0.0)] = middle;
        }
        let corner = |side: u32| {
            let side = DVec2::from_angle(TAU * f64::from(side) / f64::from(SIDES));
            let place = |reach_m: f64| level[0] + DVec3::new(side.x, 0.0, side.y) * reach_m;
            let mut reach_m = [0.0, depth_m / 16.0];
            while self.reaches(place(reach_m[1]), p) && reach_m[1] < FARTHEST * depth_m {
                reach_m = [reach_m[1], 2.0 * reach_m[1]];
            }
            for _ in 0..HALVINGS[1] {
                let middle = 0.5 * (reach_m[0] + reach_m[1]);
                reach_m[usize::from(!self.reaches(place(middle), p))] = middle;
            }
            // A polygon around a circle.
            (place(reach_m[1]) - level[0]) / (0.5 * TAU / f64::from(SIDES)).cos()
        };
        let bases = match self.kind {
            LightKind::Directional => [level[0]; 2],
            LightKind::Point => [straight, above],
        };
        (0..SIDES).map(corner).flat_map(|offset| bases.map(|base| base + offset)).collect()
    }

    /// Of the surface that sends light from an entry to a point, of no unit length: by Snell's law it lies along incident − n · refracted.
    /// With it n times the cosine of the bend.
    fn normal(&self, entry: DVec3, p: DVec3) -> (DVec3, f64) {
        let n = self.water.refractive_index;
        let incident = match self.kind {
            LightKind::Directional => self.forward,
            LightKind::Point => (entry - self.position).normalize_or(DVec3::NEG_Y),
        };
        let refracted = (p - entry).normalize_or(DVec3::NEG_Y);
        (incident - n * refracted, n * incident.dot(refracted))
    }

    /// Whether some wave sends light from an entry to a point. Light that grazes a surface bends most.
    fn reaches(&self, entry: DVec3, p: DVec3) -> bool {
        let (normal, bend) = self.normal(entry, p);
        bend >= 1.0 && normal.y > 0.0 && normal.xz().length() <= self.steepest * normal.y
    }
}

/// A light less than this above a point counts as this far above it, metres.
const MIN_FALL: f64 = 1e-9;

/// A point's place across the light's axis.
fn across(frame: &LightFrame, p: DVec3) -> DVec2 {
    let p = frame.view.transform_point3(p);
    match frame.kind {
        LightKind::Directional => p.truncate(),
        LightKind::Point => tangent(p),
    }
}

/// The convex hull, counter-clockwise (Andrew 1979).
pub(super) fn hull(points: &[DVec2]) -> Vec<DVec2> {
    let mut sorted = points.to_vec();
    sorted.sort_by(|a, b| a.x.total_cmp(&b.x).then(a.y.total_cmp(&b.y)));
    sorted.dedup();
    let chain = |points: &mut dyn Iterator<Item = DVec2>| {
        let mut chain: Vec<DVec2> = Vec::new();
        for p in points {
            while let [.., a, b] = chain[..] {
                if (b - a).perp_dot(p - b) > 0.0 {
                    break;
                }
                chain.pop();
            }
            chain.push(p);
        }
        chain.pop();
        chain
    };
    let mut whole = chain(&mut sorted.iter().copied());
    whole.extend(chain(&mut sorted.iter().rev().copied()));
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_rectangle_lies_along_what_it_holds() {
        let side = DVec2::from_angle(0.5);
        let place = |x: f64, y: f64| DVec2::new(3.0, -1.0) + side * x + side.perp() * y;
        let mut points =
            vec![place(-2.0, -1.0), place(2.0, -1.0), place(2.0, 1.0), place(-2.0, 1.0)];
        // Within it.
        points.extend([place(0.3, 0.2), place(0.0, -1.0)]);
        let found = PhotonStart::from_points(&points).unwrap();
        assert!((found.rectangle().area() - 8.0).abs() < 1e-12);
        assert_eq!(hull(&points).len(), 4);
        assert!(PhotonStart::from_points(&points[..2]).is_none());
        assert!(PhotonStart::from_points(&[]).is_none());
    }
}
