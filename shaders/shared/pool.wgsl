// A rectangular pool: a floor and four walls around the water's rectangle, and their illumination map. SPT §1.1.
// The map is an atlas: the faces stand side by side, the floor first, then the walls at −x, +x, −z and +z. Row 0 of the floor lies
// at −z, row 0 of a wall at its upper border. Host twin: src/stages/shared/pool.rs.
#define_import_path fathom::pool

#import fathom::uniforms::{frame}

struct Pool {
    // Depth of the floor under the resting water, metres.
    floor_depth_m: f32,
    // Height of the walls' upper border above the resting water, metres.
    top_m: f32,
    // Texels per side of a face.
    texels: u32,
}

const FACES: u32 = 5u;
// No face.
const NONE: u32 = 5u;
// Distance to a plane that a ray never meets, metres.
const NEVER_M: f32 = 1e30;
// A component of a unit direction below this never meets its planes.
const MIN_COMPONENT: f32 = 1e-12;
// What is seen this near to a plane lies on it, as a share of half the water's longer side: 1 cm in scene planar_pool.
const NEAR: f32 = 0.005;

struct Met {
    face: u32,
    // Distance along the ray.
    at_m: f32,
}

// Distance along a ray to the side of a slab that it runs towards, metres.
fn distance_to_side(from_middle: f32, half: f32, direction: f32) -> f32 {
    let side = select(half, -half, direction < 0.0);
    return select(NEVER_M, (side - from_middle) / direction, abs(direction) > MIN_COMPONENT);
}

// The first face along a ray that starts in the pool.
fn meet(pool: Pool, origin_m: vec3<f32>, direction: vec3<f32>) -> Met {
    let from_middle = origin_m.xz - frame.water_center_m;
    let half = frame.water_half_size_m;
    var met = Met(0u, NEVER_M);
    if direction.y < -MIN_COMPONENT {
        met.at_m = (-pool.floor_depth_m - origin_m.y) / direction.y;
    }
    let to_x = distance_to_side(from_middle.x, half.x, direction.x);
    if to_x < met.at_m {
        met = Met(select(2u, 1u, direction.x < 0.0), to_x);
    }
    let to_z = distance_to_side(from_middle.y, half.y, direction.z);
    if to_z < met.at_m {
        met = Met(select(4u, 3u, direction.z < 0.0), to_z);
    }
    if met.at_m >= NEVER_M || origin_m.y + met.at_m * direction.y > pool.top_m {
        met.face = NONE;
    }
    return met;
}

// Texture coordinates of a point of a face, 0…1 to the right and downwards.
fn face_uv(pool: Pool, face: u32, p_m: vec3<f32>) -> vec2<f32> {
    let across = (p_m.xz - frame.water_center_m) / frame.water_half_size_m * 0.5 + 0.5;
    let down = (pool.top_m - p_m.y) / (pool.top_m + pool.floor_depth_m);
    if face == 0u {
        return across;
    }
    return vec2(select(across.x, across.y, face < 3u), down);
}

// Area of a texel, m².
fn texel_area_m2(pool: Pool, face: u32) -> f32 {
    let sides = 2.0 * frame.water_half_size_m;
    let height = pool.top_m + pool.floor_depth_m;
    var area = sides.x * sides.y;
    if face > 0u {
        area = height * select(sides.x, sides.y, face < 3u);
    }
    return area / (f32(pool.texels) * f32(pool.texels));
}

// The face that a visible place lies on, by its normal.
fn face_at(pool: Pool, p_m: vec3<f32>, normal: vec3<f32>) -> u32 {
    let from_middle = p_m.xz - frame.water_center_m;
    let half = frame.water_half_size_m;
    let near_m = NEAR * max(half.x, half.y);
    if p_m.y > pool.top_m || any(abs(from_middle) > half + near_m) {
        return NONE;
    }
    if normal.y > 0.5 && abs(p_m.y + pool.floor_depth_m) < near_m {
        return 0u;
    }
    if abs(normal.x) > 0.5 && abs(from_middle.x + sign(normal.x) * half.x) < near_m {
        return select(2u, 1u, normal.x > 0.0);
    }
    if abs(normal.z) > 0.5 && abs(from_middle.y + sign(normal.z) * half.y) < near_m {
        return select(4u, 3u, normal.z > 0.0);
    }
    return NONE;
}
