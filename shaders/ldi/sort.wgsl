// defs: LAYERS=8
// The nearest fragments of each pixel's list, in order, as layers.
#import fathom::fragment_list::{Node}
#import fathom::surface_texel::{channels}

@group(0) @binding(0) var<storage, read> heads: array<u32>;
@group(0) @binding(1) var<storage, read> nodes: array<Node>;
@group(0) @binding(2) var depths: texture_storage_2d_array<r32float, write>;
@group(0) @binding(3) var surfaces: texture_storage_2d_array<rgba16uint, write>;

@compute @workgroup_size(8, 8)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = textureDimensions(depths);
    if any(id.xy >= size) {
        return;
    }
    var nearest: array<f32, #{LAYERS}>;
    var chosen: array<u32, #{LAYERS}>;
    for (var layer = 0u; layer < #{LAYERS}u; layer++) {
        nearest[layer] = 1.0;
        chosen[layer] = 0u;
    }
    var number = heads[1u + id.x + id.y * size.x];
    while number != 0u {
        let node = nodes[number - 1u];
        // What is carried on is the fragment itself, then what it has taken the place of.
        var depth = node.depth;
        var carried = number;
        for (var layer = 0u; layer < #{LAYERS}u; layer++) {
            // Surfaces in the same place are one, as in peeling.
            if depth == nearest[layer] {
                break;
            }
            if depth < nearest[layer] {
                let depth_before = nearest[layer];
                let carried_before = chosen[layer];
                nearest[layer] = depth;
                chosen[layer] = carried;
                depth = depth_before;
                carried = carried_before;
            }
        }
        number = node.next;
    }
    for (var layer = 0u; layer < #{LAYERS}u; layer++) {
        var surface = vec2(0u);
        if chosen[layer] != 0u {
            surface = nodes[chosen[layer] - 1u].surface;
        }
        textureStore(depths, id.xy, layer, vec4(nearest[layer]));
        textureStore(surfaces, id.xy, layer, channels(surface));
    }
}
