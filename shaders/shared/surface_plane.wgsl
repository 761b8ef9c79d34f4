// The surface behind a pixel as a plane in device depth, so that light of one surface is told from that of another.
// Device depth is linear on planes: its slope predicts the whole plane exactly.
#define_import_path fathom::surface_plane

#import fathom::bilateral::{slope_along}
#import fathom::uniforms::{view_depth_m}
#import fathom::screen::{texel_behind}

struct SurfacePlane {
    // Texel of the camera's depth.
    texel: vec2<i32>,
    z: f32,
    // Change of device depth per texel, to the right and downwards.
    slope: vec2<f32>,
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

// Metres along the view from the plane to what is seen at another texel; negative before the plane.
fn beyond_plane_m(plane: SurfacePlane, depth: texture_depth_2d, texel: vec2<i32>) -> f32 {
    let plane_z = clamp(plane.z + dot(plane.slope, vec2<f32>(texel - plane.texel)), 0.0, 1.0);
    return view_depth_m(textureLoad(depth, texel, 0)) - view_depth_m(plane_z);
}
