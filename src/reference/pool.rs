//! The five inner faces of a rectangular pool, and light that is counted on them texel by texel (SPT §1.1).
//!
//! Where the GPU takes the nearer of the slabs' far sides, here each rectangle is met by itself.

use glam::DVec3;
use itertools::iproduct;

use super::optics::transmittance;
use super::photons::entering_share;
use fathom_scene::{Light, LightFrame, LightKind, Water};

/// Rounding at the border of a rectangle, as a share of its side.
const BORDER: f64 = 1e-9;

/// A face, in the order of the illumination map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Face {
    Floor,
    /// The wall at −x.
    West,
    East,
    /// The wall at −z.
    North,
    South,
}

impl Face {
    pub const ALL: [Face; 5] = [Face::Floor, Face::West, Face::East, Face::North, Face::South];

    pub fn number(self) -> usize {
        self as usize
    }

    /// Unit normal, into the pool.
    pub fn normal(self) -> DVec3 {
        match self {
            Face::Floor => DVec3::Y,
            Face::West => DVec3::X,
            Face::East => DVec3::NEG_X,
            Face::North => DVec3::Z,
            Face::South => DVec3::NEG_Z,
        }
    }
}

/// A rectangle: its corner of the map's first texel, and its sides to the right and downwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceRect {
    pub corner: DVec3,
    pub right: DVec3,
    pub down: DVec3,
}

impl FaceRect {
    pub fn area_m2(&self) -> f64 {
        self.right.cross(self.down).length()
    }

    /// Place of a point, 0…1 along both sides.
    pub fn place(&self, point: DVec3) -> [f64; 2] {
        [self.right, self.down].map(|side| (point - self.corner).dot(side) / side.length_squared())
    }

    pub fn point(&self, [u, v]: [f64; 2]) -> DVec3 {
        self.corner + u * self.right + v * self.down
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceHit {
    pub face: Face,
    pub position: DVec3,
    pub distance_m: f64,
}

/// A rectangular pool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Basin {
    /// Middle, x and z.
    pub center_m: [f64; 2],
    /// Half of the inner extent along x and z.
    pub half_size_m: [f64; 2],
    /// Depth of the floor below y = 0.
    pub floor_depth_m: f64,
    /// Height of the walls above y = 0.
    pub top_m: f64,
}

impl Basin {
    /// The pool below the water's rectangle; its walls reach up to the highest wave.
    pub fn from_water(water: &Water, floor_depth_m: f64) -> Basin {
        Basin {
            center_m: water.center_m,
            half_size_m: water.half_size_m,
            floor_depth_m,
            top_m: water.bound_m(),
        }
    }

    pub fn rectangle(&self, face: Face) -> FaceRect {
        let [x, z] = [0, 1].map(|axis| {
            let (center, half) = (self.center_m[axis], self.half_size_m[axis]);
            [center - half, center + half]
        });
        let (along_x, along_z) = (DVec3::X * (x[1] - x[0]), DVec3::Z * (z[1] - z[0]));
        let wall = |x: f64, z: f64, right: DVec3| FaceRect {
            corner: DVec3::new(x, self.top_m, z),
            right,
            down: DVec3::NEG_Y * (self.top_m + self.floor_depth_m),
        };
        match face {
            Face::Floor => FaceRect {
                corner: DVec3::new(x[0], -self.floor_depth_m, z[0]),
                right: along_x,
                down: along_z,
            },
            Face::West => wall(x[0], z[0], along_z),
            Face::East => wall(x[1], z[0], along_z),
            Face::North => wall(x[0], z[0], along_x),
            Face::South => wall(x[0], z[1], along_x),
        }
    }

    /// The first face that a ray from within meets.
    pub fn meet(&self, origin: DVec3, direction: DVec3) -> Option<FaceHit> {
        let met = Face::ALL.into_iter().filter_map(|face| self.meet_face(face, origin, direction));
        met.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
    }

    fn meet_face(&self, face: Face, origin: DVec3, direction: DVec3) -> Option<FaceHit> {
        let rectangle = self.rectangle(face);
        let towards = -direction.dot(face.normal());
        let distance_m = (origin - rectangle.corner).dot(face.normal()) / towards;
        let position = origin + distance_m * direction;
        let inside = |share: f64| (-BORDER..=1.0 + BORDER).contains(&share);
        let hit = towards > 0.0
            && distance_m >= -BORDER
            && rectangle.place(position).into_iter().all(inside);
        hit.then_some(FaceHit { face, position, distance_m })
    }

    /// Number of the texel of the map that a point of a face lies in, face by face, row by row.
    pub fn texel(&self, met: &FaceHit, texels: u32) -> usize {
        let last = f64::from(texels - 1);
        let [column, row] = self
            .rectangle(met.face)
            .place(met.position)
            .map(|share| (share * f64::from(texels)).floor().clamp(0.0, last) as usize);
        let side = texels as usize;
        (met.face.number() * side + row) * side + column
    }

    pub fn texel_area_m2(&self, face: Face, texels: u32) -> f64 {
        self.rectangle(face).area_m2() / f64::from(texels).powi(2)
    }
}

/// Flux of a photon in the middle of the light's frustum, W, of so many that are even in the grid: a point light's intensity times
/// the solid angle of the photon's share of the grid.
pub fn middle_photon_w(light: &Light, frame: &LightFrame, photons: u32) -> f64 {
    light.intensity_w_sr * frame.grid_area / f64::from(photons)
}

/// What a photon that enters the water at `entry` has of that, after `path_m` of water.
pub fn flux_share(frame: &LightFrame, water: &Water, entry: DVec3, path_m: f64) -> f64 {
    let (incident, spread) = match frame.kind {
        LightKind::Directional => (frame.forward, 1.0),
        LightKind::Point => {
            let incident = (entry - frame.position).normalize();
            (incident, incident.dot(frame.forward).powi(3))
        }
    };
    let entering = entering_share(water, water.normal(entry.x, entry.z), incident);
    spread * entering * transmittance(water.attenuation_per_m, path_m)
}

/// Irradiance counted texel by texel, W/m². Photons that rounding may send to one of several texels are kept apart.
#[derive(Clone, Debug, PartialEq)]
pub struct FluxCounts {
    pub certain: Vec<f64>,
    /// All of these that may lie in the texel.
    pub uncertain: Vec<f64>,
    /// Flux of all, W.
    pub flux_w: f64,
}

impl FluxCounts {
    pub fn new(texels: u32) -> FluxCounts {
        let none = vec![0.0; Face::ALL.len() * (texels as usize).pow(2)];
        FluxCounts { certain: none.clone(), uncertain: none, flux_w: 0.0 }
    }

    /// Adds a photon by its ray. `flux_w` gives its flux after a way in metres. Its start is known up to `rounding_m`.
    pub fn add(
        &mut self,
        (basin, texels): (&Basin, u32),
        (origin, direction): (DVec3, DVec3),
        rounding_m: f64,
        flux_w: impl Fn(f64) -> f64,
    ) {
        let Some(met) = basin.meet(origin, direction) else { return };
        let flux_w = flux_w(met.distance_m);
        let irradiance = |face: Face, flux_w: f64| flux_w / basin.texel_area_m2(face, texels);
        let middle = basin.texel(&met, texels);
        let mut others: Vec<(usize, Face)> = shifts(rounding_m)
            .filter_map(|shift| basin.meet(origin + shift, direction))
            .map(|met| (basin.texel(&met, texels), met.face))
            .filter(|(texel, _)| *texel != middle)
            .collect();
        others.sort_unstable_by_key(|(texel, _)| *texel);
        others.dedup();
        self.flux_w += flux_w;
        if others.is_empty() {
            self.certain[middle] += irradiance(met.face, flux_w);
            return;
        }
        for (texel, face) in others.into_iter().chain([(middle, met.face)]) {
            self.uncertain[texel] += irradiance(face, flux_w);
        }
    }

    /// How far a texel's value lies outside of what the photons allow.
    pub fn deviation(&self, texel: usize, value: f64) -> f64 {
        let (low, high) = (self.certain[texel], self.certain[texel] + self.uncertain[texel]);
        (low - value).max(value - high).max(0.0)
    }
}

/// The texels of an atlas of the faces side by side, face by face, row by row.
pub fn face_by_face(atlas: &[f64], texels: u32) -> Vec<f64> {
    let (faces, side) = (Face::ALL.len(), texels as usize);
    let at = |(face, row, column)| atlas[(row * faces + face) * side + column];
    iproduct!(0..faces, 0..side, 0..side).map(at).collect()
}

/// The corners of a cube.
fn shifts(half_m: f64) -> impl Iterator<Item = DVec3> {
    let ends = [-half_m, half_m];
    iproduct!(ends, ends, ends).map(|(x, y, z)| DVec3::new(x, y, z))
}
