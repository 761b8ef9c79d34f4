// A scalar field in a box of the world. Host twin: src/stages/shared/scalar_field.rs.
#define_import_path fathom::scalar_field

struct Field {
    origin_m: vec3<f32>,
    // v_s: edge of the cube that has a cell's volume.
    voxel_m: f32,
    size_m: vec3<f32>,
    // Half a cell's diagonal, h of VAO Eq. 2.
    guard_m: f32,
    // Edges of a cell.
    spacing_m: vec3<f32>,
}

@group(1) @binding(0) var<uniform> field: Field;
// Values 0…1; levels above the first are averages.
@group(1) @binding(1) var volume: texture_3d<f32>;
@group(1) @binding(2) var linear_sampler: sampler;

// Look-ups of this invocation so far.
var<private> look_ups: u32;

// V(x), interpolated trilinearly; 0 outside the box.
fn value(position_m: vec3<f32>, level: f32) -> f32 {
    let uvw = (position_m - field.origin_m) / field.size_m;
    let inside = all(uvw >= vec3(0.0)) && all(uvw <= vec3(1.0));
    look_ups += u32(inside);
    return select(0.0, textureSampleLevel(volume, linear_sampler, uvw, level).x, inside);
}

// ∇V by central differences over two cells, 1/m.
fn gradient(position_m: vec3<f32>) -> vec3<f32> {
    let x = vec3(field.spacing_m.x, 0.0, 0.0);
    let y = vec3(0.0, field.spacing_m.y, 0.0);
    let z = vec3(0.0, 0.0, field.spacing_m.z);
    return vec3(
        value(position_m + x, 0.0) - value(position_m - x, 0.0),
        value(position_m + y, 0.0) - value(position_m - y, 0.0),
        value(position_m + z, 0.0) - value(position_m - z, 0.0),
    ) / (2.0 * field.spacing_m);
}

// Unit vector down the gradient; `otherwise` where the field is flat.
fn outward(position_m: vec3<f32>, otherwise: vec3<f32>) -> vec3<f32> {
    let slope = gradient(position_m);
    // A change of 1/4096 over a cell is below what 8 bits hold.
    if length(slope) * field.voxel_m < 1.0 / 4096.0 {
        return otherwise;
    }
    return -normalize(slope);
}

// Distances at which a ray enters and leaves the box.
fn through_box(origin_m: vec3<f32>, direction: vec3<f32>) -> vec2<f32> {
    // A component of 0 counts as one too small to matter.
    let inverse = 1.0 / select(direction, vec3(1e-12), abs(direction) < vec3(1e-12));
    let low = (field.origin_m - origin_m) * inverse;
    let high = (field.origin_m + field.size_m - origin_m) * inverse;
    let enter = min(low, high);
    let leave = max(low, high);
    return vec2(max(max(enter.x, enter.y), enter.z), min(min(leave.x, leave.y), leave.z));
}
