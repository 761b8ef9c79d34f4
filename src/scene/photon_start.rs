//! The part of the light's frustum in which photons start: the least rectangle through which light reaches the water in view.

use glam::{DMat4, DVec2, DVec3, DVec4, Vec3Swizzles};

use super::bounds::Bounds;
use super::camera::Camera;
use super::frustum::{Rectangle, clip, visible_points};
use super::light::{LightFrame, LightKind, WAVE_SPREAD, tangent};
use super::water::Water;

/// A rectangle across the light's axis, turned about it: metres across a directional light's rays, tangents of a point light's angles.
pub(super) struct PhotonStart {
    /// Unit vector along its first side.
    side: DVec2,
    /// Its extent along that side and across it.
    within: Rectangle,
}

impl PhotonStart {
    /// None where the camera sees nothing under water.
    pub(super) fn new(
        frame: &LightFrame,
        view: (&Camera, f64),
        bounds: &Bounds,
        water: &Water,
    ) -> Option<PhotonStart> {
        let crest_m = water.bound_m();
        let wet = Bounds { max: bounds.max.with_y(bounds.max.y.min(crest_m)), ..*bounds };
        let seen = visible_points(view.0, view.1, &wet);
        let entries = seen.iter().flat_map(|p| entries(frame, water, *p)).collect::<Vec<_>>();
        let level = |p: &DVec2| DVec3::new(p.x, 0.0, p.y);
        let lit = clip(hull(&entries).iter().map(level).collect(), &sides(water));
        let heights = [-crest_m, crest_m];
        let places = lit.iter().flat_map(|p| heights.map(|y| across(frame, p.with_y(y))));
        PhotonStart::around(&places.collect::<Vec<_>>())
    }

    /// The least rectangle around points has a side along one of their hull (Freeman and Shapira 1975).
    fn around(points: &[DVec2]) -> Option<PhotonStart> {
        let hull = hull(points);
        let next = hull.iter().cycle().skip(1);
        let sides = hull.iter().zip(next).filter_map(|(a, b)| (*b - *a).try_normalize());
        let turned = sides.map(|side| {
            let turn = |p: &DVec2| DVec2::new(side.dot(*p), side.perp().dot(*p));
            PhotonStart { side, within: Rectangle::around(hull.iter().map(turn)) }
        });
        let least = turned.min_by(|a, b| a.within.area().total_cmp(&b.within.area()))?;
        (least.within.area() > 0.0).then_some(least)
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

/// Where light that reaches a point enters the resting water, and how far the waves move that: x and z. A directional light's refracted ray
/// is known. That of a point light lies between the straight ray and the vertical.
fn entries(frame: &LightFrame, water: &Water, p: DVec3) -> impl Iterator<Item = DVec2> + use<> {
    let depth_m = (-p.y).max(0.0);
    let back = |direction: DVec3| p - direction * (depth_m / direction.y.abs().max(LEAST_FALL));
    let above = match frame.kind {
        LightKind::Directional => {
            let across = frame.forward.with_y(0.0) / water.refractive_index;
            let entry = back(across.with_y((1.0 - across.length_squared()).max(0.0).sqrt()));
            [Some(entry), None]
        }
        LightKind::Point => [Some(p), Some(back(p - frame.position))],
    };
    let spread = WAVE_SPREAD * depth_m;
    let corners = [DVec2::ONE, DVec2::new(1.0, -1.0), DVec2::new(-1.0, 1.0), DVec2::NEG_ONE];
    above.into_iter().flatten().flat_map(move |e| corners.map(|corner| e.xz() + corner * spread))
}

/// Components of a direction downwards below this count as this.
const LEAST_FALL: f64 = 1e-9;

/// The planes (n, d) beside the water's rectangle, n·p + d ≥ 0 inside.
fn sides(water: &Water) -> [DVec4; 4] {
    let ([x, z], [half_x, half_z]) = (water.center_m, water.half_size_m);
    [
        DVec4::new(1.0, 0.0, 0.0, half_x - x),
        DVec4::new(-1.0, 0.0, 0.0, half_x + x),
        DVec4::new(0.0, 0.0, 1.0, half_z - z),
        DVec4::new(0.0, 0.0, -1.0, half_z + z),
    ]
}

/// A point's place across the light's axis.
fn across(frame: &LightFrame, p: DVec3) -> DVec2 {
    let p = frame.view.transform_point3(p);
    match frame.kind {
        LightKind::Directional => p.truncate(),
        LightKind::Point => tangent(p),
    }
}

/// The convex hull, counter-clockwise (Andrew 1979).
fn hull(points: &[DVec2]) -> Vec<DVec2> {
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
    fn the_least_rectangle_lies_along_what_it_holds() {
        let side = DVec2::from_angle(0.5);
        let place = |x: f64, y: f64| DVec2::new(3.0, -1.0) + side * x + side.perp() * y;
        let mut points =
            vec![place(-2.0, -1.0), place(2.0, -1.0), place(2.0, 1.0), place(-2.0, 1.0)];
        // Within it.
        points.extend([place(0.3, 0.2), place(0.0, -1.0)]);
        let found = PhotonStart::around(&points).unwrap();
        assert!((found.rectangle().area() - 8.0).abs() < 1e-12);
        assert_eq!(hull(&points).len(), 4);
        assert!(PhotonStart::around(&points[..2]).is_none());
        assert!(PhotonStart::around(&[]).is_none());
    }
}
