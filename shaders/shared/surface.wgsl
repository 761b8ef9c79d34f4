// Materials of the scene, and the scene's vertex as every raster stage reads it. Host twin: src/stages/shared/geometry.rs.
#define_import_path fathom::surface

struct Material {
    albedo: vec3<f32>,
    // Side of a world-space tile with joints in the accent colour; 0: plain.
    tile_m: f32,
    accent: vec3<f32>,
    // Opacity.
    alpha: f32,
    // Reflectance of the glossy lobe.
    specular: f32,
    // As `fathom::optics` reads it.
    optics: f32,
}

struct SceneVertex {
    @location(0) position_m: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) material: u32,
}

// A vertex of the scene as a camera sees it.
struct Varying {
    @builtin(position) clip: vec4<f32>,
    @location(0) position_m: vec3<f32>,
    @location(1) normal: vec3<f32>,
    @location(2) @interpolate(flat) material: u32,
}

fn projected(in: SceneVertex, view_projection: mat4x4<f32>) -> Varying {
    return Varying(view_projection * vec4(in.position_m, 1.0), in.position_m, in.normal, in.material);
}

// Share of a tile's side taken by its joint.
const JOINT: f32 = 0.06;

fn hash(p: vec3<i32>) -> f32 {
    var v = u32(p.x) * 1597334677u ^ u32(p.y) * 3812015801u ^ u32(p.z) * 2798796415u;
    v = (v ^ (v >> 15u)) * 2246822519u;
    return f32(v >> 8u) / 16777216.0;
}

fn albedo(material: Material, position_m: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    if material.tile_m <= 0.0 {
        return material.albedo;
    }
    let n = abs(normal);
    var uv = position_m.xy;
    if n.y >= n.x && n.y >= n.z {
        uv = position_m.xz;
    } else if n.x > n.z {
        uv = position_m.zy;
    }
    let tiles = uv / material.tile_m;
    let tile = floor(tiles);
    let inside = abs(tiles - tile - 0.5);
    if max(inside.x, inside.y) > 0.5 - 0.5 * JOINT {
        return material.accent;
    }
    return material.albedo * (0.85 + 0.3 * hash(vec3<i32>(vec2<i32>(tile), i32(n.y > n.x) + 2 * i32(n.x > n.z))));
}
