// defs: SIDE=0
// Refraction through two interfaces, approximated: Wyman, An Approximate Image-Space Approach for Interactive Refraction, 2005, as SPT
// §1.1 describes it. SIDE 0 draws the farthest surface, SIDE 1 the nearest. The length of a pixel's path through the object is a mean of two
// distances: along the line of sight, and along the normal, which is stored for each vertex.
#import fathom::uniforms::{frame, view_depth_m, world_at}
#import fathom::optics
#import fathom::refraction::{Exit}
#import fathom::screen::{to_pixels}
#import fathom::surface::{Material, SceneVertex}

@group(1) @binding(0) var<storage, read> materials: array<Material>;
#if SIDE == 1
@group(1) @binding(1) var back_depths: texture_depth_2d;
@group(1) @binding(2) var back_normals: texture_2d<f32>;
// Length of the object behind each vertex, against the vertex's normal.
@group(1) @binding(3) var<storage, read> thickness_m: array<f32>;
#endif

struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) position_m: vec3<f32>,
    @location(2) thickness_m: f32,
    @location(3) @interpolate(flat) material: u32,
}

@vertex
fn vertex(in: SceneVertex, @builtin(vertex_index) index: u32) -> Varying {
    let clip = frame.camera_view_projection * vec4(in.position_m, 1.0);
#if SIDE == 1
    return Varying(clip, in.normal, in.position_m, thickness_m[index], in.material);
#else
    return Varying(clip, in.normal, in.position_m, 0.0, in.material);
#endif
}

#if SIDE == 0
@fragment
fn fragment(in: Varying) -> @location(0) vec4<f32> {
    return vec4(normalize(in.normal), 1.0);
}
#else
// Normal of the far side where a place shows on the screen; beside the object one that is perpendicular to the line of sight.
fn far_normal(position_m: vec3<f32>, sight: vec3<f32>, near_normal: vec3<f32>) -> vec3<f32> {
    let size_px = vec2<f32>(textureDimensions(back_depths));
    let clip = frame.camera_view_projection * vec4(position_m, 1.0);
    let at_px = to_pixels(clip.xy / clip.w, size_px);
    let texel = vec2<i32>(clamp(floor(at_px), vec2(0.0), size_px - 1.0));
    if textureLoad(back_depths, texel, 0) > 0.0 {
        return textureLoad(back_normals, texel, 0).xyz;
    }
    return normalize(near_normal - dot(near_normal, sight) * sight);
}

@fragment
fn fragment(in: Varying) -> Exit {
    let normal = normalize(in.normal);
    let index = materials[in.material].optics - 1.0;
    let sight = normalize(in.position_m - frame.camera_position_m);
    let inside = optics::refracted(sight, normal, 1.0 / index);
    let uv = in.clip.xy / vec2<f32>(textureDimensions(back_depths));
    let behind_m = world_at(uv, textureLoad(back_depths, vec2<i32>(in.clip.xy), 0));
    let along_sight_m = distance(behind_m, in.position_m);
    // Angles of incidence and refraction: straight on, the share tends to 1 / index.
    let incident = acos(min(abs(dot(sight, normal)), 1.0));
    let share = select(acos(min(abs(dot(inside, normal)), 1.0)) / incident, 1.0 / index, incident < 1e-3);
    let path_m = share * along_sight_m + (1.0 - share) * in.thickness_m;
    let out_m = in.position_m + path_m * inside;
    let far = far_normal(out_m, sight, normal);
    let direction = optics::refracted(inside, far, index);
    let stays = dot(inside, far) * dot(direction, far) < 0.0;
    return Exit(vec4(out_m, distance(in.position_m, frame.camera_position_m)), vec4(direction, select(0.0, 1.0, stays)));
}
#endif
