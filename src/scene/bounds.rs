//! Axis-aligned boxes.

use glam::DVec3;

/// Diagonal of the box of scene tank's objects, metres.
const TANK_M: f64 = 17.4218;

/// An axis-aligned box, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

impl Bounds {
    /// The box that holds nothing: growing it by a point gives that point.
    pub const EMPTY: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    pub fn from_points(points: impl IntoIterator<Item = DVec3>) -> Bounds {
        let boxes = points.into_iter().map(|point| Bounds { min: point, max: point });
        boxes.fold(Bounds::EMPTY, Bounds::union)
    }

    /// Grown to hold `other`.
    #[inline]
    #[must_use]
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Extent along each axis, metres.
    #[inline]
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// How many times as large as scene tank, by the diagonal: lengths that were tuned there are multiplied by it. It is rounded, so that
    /// they keep their digits, and powers of two times a scene stay such.
    pub fn tank_scale(&self) -> f64 {
        let times = self.size().length() / TANK_M;
        let step = (times.log2().floor() - 7.0).exp2();
        if times.is_finite() && times > 0.0 { (times / step).round() * step } else { 1.0 }
    }

    pub fn center(&self) -> DVec3 {
        0.5 * (self.min + self.max)
    }

    /// Whether the two have a point in common.
    pub fn meets(&self, other: &Bounds) -> bool {
        self.min.cmple(other.max).all() && other.min.cmple(self.max).all()
    }

    /// Whether `p` lies inside or on the border.
    pub fn contains(&self, p: DVec3) -> bool {
        p.cmpge(self.min).all() && p.cmple(self.max).all()
    }

    /// Corner `i` takes its x, y, z from the maximum where bit 0, 1, 2 of `i` is set.
    pub fn corners(&self) -> [DVec3; 8] {
        let ends = [self.min, self.max];
        std::array::from_fn(|i| DVec3::new(ends[i & 1].x, ends[i >> 1 & 1].y, ends[i >> 2].z))
    }
}
