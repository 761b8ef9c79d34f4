// Look-ups in layered depth images.
#define_import_path fathom::layers

#import fathom::screen::{to_pixels}
#import fathom::uniforms::{frame, view_depth_m}
#import fathom::surface_texel::{Surface, unpacked}

const NO_SURFACE: Surface = Surface(vec3<f32>(0.0), 0.0, vec3<f32>(0.0), 0.0);

fn surface_at(surfaces: texture_2d_array<u32>, texel: vec2<i32>, layer: u32) -> Surface {
    return unpacked(textureLoad(surfaces, texel, layer, 0));
}

// The surface of the layer that lies nearest to a view depth.
fn surface_near(
    depths: texture_2d_array<f32>, surfaces: texture_2d_array<u32>, layers: u32, texel: vec2<i32>, view_m: f32
) -> Surface {
    var nearest = 1e30;
    var surface = NO_SURFACE;
    for (var layer = 0u; layer < layers; layer++) {
        let z = textureLoad(depths, texel, layer, 0).x;
        if z >= 1.0 {
            break;
        }
        let away = abs(view_depth_m(z) - view_m);
        if away < nearest {
            nearest = away;
            surface = surface_at(surfaces, texel, layer);
        }
    }
    return surface;
}

// Texel that shows a place in view.
fn texel_of(ndc: vec2<f32>, size_px: vec2<f32>) -> vec2<i32> {
    return vec2<i32>(min(to_pixels(ndc, size_px), size_px - 1.0));
}
