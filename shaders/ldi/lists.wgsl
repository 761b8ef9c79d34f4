// Every fragment into the list of its pixel, in any order: one pass over the triangles. Yang et al., Real-Time Concurrent Linked List
// Construction on the GPU, 2010, §3. The alternative to peeling that SPT §6 hopes for.
#import fathom::uniforms::{frame}
#import fathom::fragment_list::{Node}
#import fathom::surface::{Material, SceneVertex}
#import fathom::surface_texel::{packed}

struct Lists {
    width: u32,
    // Room for so many fragments.
    capacity: u32,
}

@group(1) @binding(0) var<uniform> lists: Lists;
// How many fragments there are; then, for each pixel, the number of its latest, from 1 on.
@group(1) @binding(1) var<storage, read_write> heads: array<atomic<u32>>;
@group(1) @binding(2) var<storage, read_write> nodes: array<Node>;
@group(1) @binding(3) var<storage, read> materials: array<Material>;

struct Varying {
    @builtin(position) @invariant clip: vec4<f32>,
    @location(0) normal: vec3<f32>,
    @location(1) @interpolate(flat) material: u32,
}

@vertex
fn vertex(in: SceneVertex) -> Varying {
    return Varying(frame.camera_view_projection * vec4(in.position_m, 1.0), in.normal, in.material);
}

@fragment
fn fragment(in: Varying) {
    let own = atomicAdd(&heads[0], 1u);
    if own >= lists.capacity {
        return;
    }
    let pixel = vec2<u32>(in.clip.xy);
    let before = atomicExchange(&heads[1u + pixel.x + pixel.y * lists.width], own + 1u);
    nodes[own] = Node(in.clip.z, before, packed(in.normal, materials[in.material].optics));
}
