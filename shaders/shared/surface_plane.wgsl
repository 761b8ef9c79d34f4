// The surface behind a pixel as a plane in device depth, to tell light on one surface from light on another.
// Device depth is linear on planes: its slope predicts the whole plane exactly.
#define_import_path fathom::surface_plane

#import fathom::uniforms::{view_depth_m}
#import fathom::screen::{texel_behind}

struct SurfacePlane {
    // Texel of the camera's depth.
    texel: vec2<i32>,
    z: f32,
    // Change of device depth per texel, to the right and downwards.
    slope: vec2<f32>,
}

fn device_depth(depth: texture_depth_2d, texel: vec2<i32>) -> f32 {
    return textureLoad(depth, clamp(texel, vec2(0), vec2<i32>(textureDimensions(depth)) - 1), 0);
}

// Change of device depth from a texel to the next one along an axis: the smaller of the two one-sided differences, which
// is that of the surface the texel lies on where the other crosses an edge.
fn slope_along(depth: texture_depth_2d, texel: vec2<i32>, z: f32, axis: vec2<i32>) -> f32 {
    let ahead = texel + axis;
    let behind = texel - axis;
    let forward = device_depth(depth, ahead) - z;
    let backward = z - device_depth(depth, behind);
    if any(behind < vec2(0)) {
        return forward;
    }
    if any(ahead >= vec2<i32>(textureDimensions(depth))) {
        return backward;
    }
    return select(backward, forward, abs(forward) < abs(backward));
}

fn plane_at(depth: texture_depth_2d, texel: vec2<i32>) -> SurfacePlane {
    let z = textureLoad(depth, texel, 0);
    let slope = vec2(
        slope_along(depth, texel, z, vec2(1, 0)), slope_along(depth, texel, z, vec2(0, 1)));
    return SurfacePlane(texel, z, slope);
}

// Texel of the camera's depth behind a pixel of a buffer of `own_px` pixels.
fn depth_texel(depth: texture_depth_2d, pixel: vec2<f32>, own_px: vec2<f32>) -> vec2<i32> {
    return texel_behind(pixel, own_px, vec2<f32>(textureDimensions(depth)));
}

// View depth of the plane at another texel.
fn plane_depth_m(plane: SurfacePlane, texel: vec2<i32>) -> f32 {
    return view_depth_m(clamp(plane.z + dot(plane.slope, vec2<f32>(texel - plane.texel)), 0.0, 1.0));
}

// Metres along the view from the plane to what is seen at another texel; negative before the plane.
fn beyond_plane_m(plane: SurfacePlane, depth: texture_depth_2d, texel: vec2<i32>) -> f32 {
    let plane_m = plane_depth_m(plane, texel);
    return view_depth_m(textureLoad(depth, texel, 0)) - plane_m;
}
