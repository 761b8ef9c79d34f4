// defs: ADDED=0, CONSERVING=0, OCCLUSION=0, WATER=0
// The final image: scene lit by caustics, water colour, godrays, and the water surface drawn over it. UW §3.5.
// ADDED 1: caustics are added as they are in their buffer, as a white surface next to the camera would show them. UW §3.3 counts no
// attenuation to the viewer, which it finds "intrinsically handled via the point size regulation".
#import fathom::uniforms::{focal_lengths, frame, view_depth_m, world_at}
#import fathom::disc::{GOLDEN_ANGLE}
#import fathom::math::{TAU}
#import fathom::picture::{background, depths, display, lambert, normal_at, picture, seen_at}
#import fathom::screen
#import fathom::shading
#import fathom::water

struct Compose {
    // Irradiance for a unit of the caustics buffer, 1/m² (paper intensity), or the side at 1 m of a square with
    // the area of that buffer's pixel (conserving intensity).
    caustics_scale: f32,
    // Radiance for a unit of the godray buffer, 1/m², for lines across the sight at the distance of the camera's target.
    godrays_scale: f32,
    // Taps of the ambient occlusion; 0: none.
    occlusion_taps: u32,
    occlusion_radius_m: f32,
    // Cells per side of the water grid.
    water_cells: u32,
    // Share of a pixel's view depth within which a texel of caustics or godrays lies on the pixel's surface.
    depth_share: f32,
}

@group(1) @binding(4) var<storage, read> settings: Compose;
@group(1) @binding(5) var caustics: texture_2d<f32>;
@group(1) @binding(6) var godrays: texture_2d<f32>;
@group(1) @binding(7) var reflection: texture_2d<f32>;
@group(1) @binding(8) var refraction: texture_2d<f32>;
@group(1) @binding(9) var linear_sampler: sampler;

// Screen shift of reflection and refraction for a unit of surface slope; tuned on scene port.
const DISTORTION: f32 = 0.08;
// Below this sum of weights no texel lies on the pixel's surface.
const MIN_WEIGHT: f32 = 1e-3;
// Cosine to the normal below which a tap does not block: depth in texels makes a slanted plane uneven.
const MIN_COSINE: f32 = 0.1;

// Bilinear by hand: 32-bit float textures cannot be filtered everywhere.
fn bilinear(source: texture_2d<f32>, uv: vec2<f32>) -> f32 {
    let last = vec2<i32>(textureDimensions(source)) - 1;
    let texel_px = uv * vec2<f32>(last + 1) - 0.5;
    let base = floor(texel_px);
    let f = texel_px - base;
    let low = clamp(vec2<i32>(base), vec2(0), last);
    let high = clamp(vec2<i32>(base) + 1, vec2(0), last);
    let a = textureLoad(source, low, 0).x;
    let b = textureLoad(source, vec2(high.x, low.y), 0).x;
    let c = textureLoad(source, vec2(low.x, high.y), 0).x;
    let d = textureLoad(source, high, 0).x;
    return mix(mix(a, b, f.x), mix(c, d, f.x), f.y);
}

// A buffer at uv from those of the four nearest texels that lie on the surface seen there; from all where none does. Light of
// what is in front then does not spread over what is behind, and the other way.
fn on_surface(source: texture_2d<f32>, uv: vec2<f32>) -> f32 {
    let size = vec2<f32>(textureDimensions(source));
    let texel_px = uv * size - 0.5;
    let base = floor(texel_px);
    let f = texel_px - base;
    let view_m = view_depth_m(screen::depth_at(depths, uv * picture.size_px, picture.size_px));
    var sum = 0.0;
    var weights = 0.0;
    for (var k = 0; k < 4; k++) {
        let corner = vec2(f32(k & 1), f32(k >> 1u));
        let texel = clamp(base + corner, vec2(0.0), size - 1.0);
        let seen_m = view_depth_m(screen::depth_at(depths, texel + 0.5, size));
        if abs(seen_m - view_m) <= settings.depth_share * view_m {
            let near = 1.0 - abs(texel_px - base - corner);
            sum += near.x * near.y * textureLoad(source, vec2<i32>(texel), 0).x;
            weights += near.x * near.y;
        }
    }
    if weights < MIN_WEIGHT {
        return bilinear(source, uv);
    }
    return sum / weights;
}

// Irradiance that the photons bring to a surface point seen at uv, W/m².
fn caustic_irradiance(uv: vec2<f32>, position_m: vec3<f32>, normal: vec3<f32>) -> f32 {
    let flux = on_surface(caustics, uv);
#if CONSERVING == 1
    // Flux of a pixel over the area of the surface behind it: that of its side² at the depth z across the view, times the cosine between
    // line of sight and view, z / d, over that between line of sight and normal.
    let to_viewer = frame.camera_position_m - position_m;
    let d = length(to_viewer);
    let z = (frame.camera_view_projection * vec4(position_m, 1.0)).w;
    let side = settings.caustics_scale * z;
    let facing = max(abs(dot(normal, to_viewer)) / d, 0.1);
    return flux * facing * d / (z * side * side);
#else
    return flux * settings.caustics_scale;
#endif
}

#if OCCLUSION == 1
// Share of the sky that nearby geometry leaves open, from screen-space depth (UW §3 step 7b, Fig. 10; UW gives no method): what lies
// over the tangent plane within the radius blocks, the less the farther it is. The disc of taps is rotated in every pixel by interleaved
// gradient noise (Jimenez, Next Generation Post Processing in Call of Duty: Advanced Warfare, 2014).
fn openness(uv: vec2<f32>, position_m: vec3<f32>, normal: vec3<f32>) -> f32 {
    let last = vec2<i32>(picture.size_px) - 1;
    let view_m = dot(transpose(frame.camera_view_projection)[3], vec4(position_m, 1.0));
    let radius = 0.5 * focal_lengths() * settings.occlusion_radius_m / view_m;
    let rotation = TAU * fract(52.9829189 * fract(dot(floor(uv * picture.size_px), vec2(0.06711056, 0.00583715))));
    var blocked = 0.0;
    for (var i = 0u; i < settings.occlusion_taps; i++) {
        let angle = f32(i) * GOLDEN_ANGLE + rotation;
        let r = sqrt((f32(i) + 0.5) / f32(settings.occlusion_taps));
        let tap_uv = uv + r * radius * vec2(cos(angle), sin(angle));
        let texel = vec2<i32>(floor(tap_uv * picture.size_px));
        if any(texel < vec2(0)) || any(texel > last) {
            continue;
        }
        // The middle of the texel, where its depth was taken.
        let middle = (vec2<f32>(texel) + 0.5) / picture.size_px;
        let tap = world_at(middle, textureLoad(depths, texel, 0)) - position_m;
        let d = length(tap);
        let range = saturate(1.0 - d / settings.occlusion_radius_m);
        blocked += range * saturate(dot(tap / max(d, 1e-4 * settings.occlusion_radius_m), normal) - MIN_COSINE);
    }
    return 1.0 - blocked / f32(settings.occlusion_taps);
}
#else
// Without the loop: on lavapipe (Mesa 22.3) a loop that is never entered has the shader compiled again for every draw.
fn openness(uv: vec2<f32>, position_m: vec3<f32>, normal: vec3<f32>) -> f32 {
    return 1.0;
}
#endif

// Radiance of the scene at uv without the water between it and the camera.
fn scene_radiance(uv: vec2<f32>, texel: vec2<i32>, position_m: vec3<f32>) -> vec3<f32> {
    let normal = normal_at(texel);
    let ambient = shading::ambient(-position_m.y, normal) * openness(uv, position_m, normal);
#if ADDED == 1
    let caustic = vec3(0.0);
#else
    let caustic = caustic_irradiance(uv, position_m, normal) * shading::WATER_TINT;
#endif
    return lambert(texel, caustic + ambient + shading::direct(position_m, normal));
}

// What caustics add to the picture's radiance.
fn added_caustics(uv: vec2<f32>, position_m: vec3<f32>, normal: vec3<f32>) -> vec3<f32> {
    return shading::lambert(vec3(1.0), caustic_irradiance(uv, position_m, normal) * shading::WATER_TINT);
}

fn shafts(uv: vec2<f32>) -> vec3<f32> {
    return shading::shafts(on_surface(godrays, uv), settings.godrays_scale);
}

@vertex
fn screen_vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return screen::corner(index);
}

@fragment
fn screen_fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let uv = pixel.xy / picture.size_px;
    let seen = seen_at(pixel.xy);
    let p = seen.position_m;
    if seen.z >= 1.0 {
        if frame.camera_under_water != 0u {
            return display(background(p) + shafts(uv));
        }
        return display(background(p));
    }
    var radiance = shading::fog(scene_radiance(uv, seen.texel, p), shading::water_path_m(p));
#if ADDED == 1
    radiance += added_caustics(uv, p, normal_at(seen.texel));
#endif
    return display(radiance + shafts(uv));
}

struct Surface {
    @builtin(position) clip: vec4<f32>,
    @location(0) position_m: vec3<f32>,
}

@vertex
fn water_vertex(@builtin(vertex_index) index: u32) -> Surface {
    let p = water::grid_vertex(index, settings.water_cells);
    let clip = frame.camera_view_projection * vec4(p, 1.0);
    // Within the clip volume wherever it is before the camera: a camera just under the water sees all of the surface above it, whatever its
    // near plane.
    return Surface(vec4(clip.xy, 0.0, clip.w), p);
}

// What the camera sees mirrored in the water.
fn mirrored(uv: vec2<f32>, direction: vec3<f32>, position_m: vec3<f32>) -> vec3<f32> {
    let seen = textureSampleLevel(reflection, linear_sampler, uv, 0.0);
    var behind = shading::sky(vec3(direction.x, abs(direction.y), direction.z));
    if frame.camera_under_water != 0u {
        behind = shading::fog(vec3(0.0), frame.z_far_m);
    }
    return mix(behind, seen.xyz, seen.w);
}

// What the camera sees through the water.
fn refracted(uv: vec2<f32>, direction: vec3<f32>) -> vec3<f32> {
    let seen = textureSampleLevel(refraction, linear_sampler, uv, 0.0);
    if frame.camera_under_water != 0u {
        return mix(shading::sky(direction), seen.xyz, seen.w);
    }
    let last = vec2<i32>(picture.size_px) - 1;
    let texel = clamp(vec2<i32>(uv * picture.size_px), vec2(0), last);
    let p = world_at(uv, textureLoad(depths, texel, 0));
    let normal = normal_at(texel);
    let behind = shading::fog(vec3(0.0), frame.z_far_m);
#if ADDED == 1
    return mix(behind, seen.xyz, seen.w) + added_caustics(uv, p, normal);
#else
    let caustic = caustic_irradiance(uv, p, normal) * shading::WATER_TINT;
    let lit = lambert(texel, caustic);
    let through = exp(-frame.attenuation_per_m * shading::water_path_m(p));
    return mix(behind, seen.xyz, seen.w) + lit * through;
#endif
}

@fragment
fn water_fragment(in: Surface) -> @location(0) vec4<f32> {
    let view_m = (frame.camera_view_projection * vec4(in.position_m, 1.0)).w;
    if view_depth_m(textureLoad(depths, vec2<i32>(in.clip.xy), 0)) <= view_m {
        discard;
    }
    let uv = in.clip.xy / picture.size_px;
    let under = frame.camera_under_water != 0u;
    let to_viewer = normalize(frame.camera_position_m - in.position_m);
    let up = water::normal(water::surface(in.position_m.xz).yz);
    let normal = select(up, -up, under);
    let eta = select(1.0 / frame.refractive_index, frame.refractive_index, under);
    let cosine = max(dot(normal, to_viewer), 1e-3);

    let shift = uv + DISTORTION * vec2(up.x, up.z);
    let through = refract(-to_viewer, normal, eta);
    let mirror = mirrored(shift, reflect(-to_viewer, normal), in.position_m);
    var radiance = mix(refracted(shift, through), mirror, shading::fresnel(cosine, eta));
    if under {
        radiance = shading::fog(radiance, distance(in.position_m, frame.camera_position_m));
    }
    return display(radiance + shafts(uv));
}
