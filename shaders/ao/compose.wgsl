// defs: SHOW_OCCLUSION=0
// Deferred direct light with shadows, and ambient light times visibility: VAO §6.
#import fathom::uniforms::{frame}
#import fathom::math::{PI, perspective_divide}
#import fathom::picture::{albedo_texels, display, normal_texels, seen_at, picture}
#import fathom::screen
#import fathom::shading

@group(1) @binding(4) var visibility: texture_2d<f32>;
@group(1) @binding(5) var shadow: texture_depth_2d;

// Exponent of the glossy lobe; tuned on scene bunny.
const GLOSS: f32 = 32.0;
// Greys of the background below and above.
const BACK_LOW: f32 = 0.30;
const BACK_HIGH: f32 = 0.75;
// How far along the normal a point is moved before it is compared with the shadow map, in texels of the map. Among the four
// texels around a place the farthest lies √2 off, so that a plane never shades itself.
const SHADOW_OFFSET: f32 = 1.5;

// 1 where the shadow map holds nothing nearer to the light than `z`.
fn open_at(texel: vec2<i32>, z: f32) -> f32 {
    let last = vec2<i32>(textureDimensions(shadow)) - 1;
    return select(0.0, 1.0, textureLoad(shadow, clamp(texel, vec2(0), last), 0) >= z);
}

// Share of the direct light that reaches a point: four comparisons, weighted bilinearly.
fn lit_share(position_m: vec3<f32>, normal: vec3<f32>) -> f32 {
    let size = vec2<f32>(textureDimensions(shadow));
    let straight = perspective_divide(frame.light_view_projection * vec4(position_m, 1.0));
    let right = perspective_divide(frame.light_inverse * vec4(straight.x + 2.0 / size.x, straight.yz, 1.0));
    let up = perspective_divide(frame.light_inverse * vec4(straight.x, straight.y + 2.0 / size.y, straight.z, 1.0));
    let texel_m = max(distance(right, position_m), distance(up, position_m));
    let moved = position_m + SHADOW_OFFSET * texel_m * normal;
    let ndc = perspective_divide(frame.light_view_projection * vec4(moved, 1.0));
    if any(abs(ndc.xy) > vec2(1.0)) {
        return 1.0;
    }
    let texel_px = screen::to_pixels(ndc.xy, size) - 0.5;
    let base = floor(texel_px);
    let f = texel_px - base;
    let low = vec2<i32>(base);
    let upper = mix(open_at(low, ndc.z), open_at(low + vec2(1, 0), ndc.z), f.x);
    let lower = mix(open_at(low + vec2(0, 1), ndc.z), open_at(low + vec2(1, 1), ndc.z), f.x);
    return mix(upper, lower, f.y);
}

// Radiance for a unit of irradiance at normal incidence: Lambert, and Blinn-Phong with the factor (s + 8) / 8π that keeps
// its energy (Akenine-Möller, Haines and Hoffman, Real-Time Rendering, 3rd edition, chapter 7).
fn reflected(
    color: vec3<f32>, specular: f32, normal: vec3<f32>, to_light: vec3<f32>, to_viewer: vec3<f32>
) -> vec3<f32> {
    let half_vector = normalize(to_light + to_viewer);
    let lobe = (GLOSS + 8.0) / (8.0 * PI) * pow(saturate(dot(normal, half_vector)), GLOSS);
    return (color / PI + specular * lobe) * saturate(dot(normal, to_light));
}

@fragment
fn fragment(@builtin(position) pixel: vec4<f32>) -> @location(0) vec4<f32> {
    let own = vec2<f32>(textureDimensions(visibility));
    let open = textureLoad(visibility, screen::texel_behind(pixel.xy, picture.size_px, own), 0).x;
    let seen = seen_at(pixel.xy);
    let p = seen.position_m;
    let to_viewer = normalize(frame.camera_position_m - p);
    // Grey, so that white surfaces that nothing occludes stand out.
    if seen.z >= 1.0 {
        return vec4(vec3(mix(BACK_LOW, BACK_HIGH, 0.5 - 0.5 * to_viewer.y)), 1.0);
    }
#if SHOW_OCCLUSION == 1
    return vec4(vec3(open), 1.0);
#else
    let surface = textureLoad(normal_texels, seen.texel, 0);
    let color = textureLoad(albedo_texels, seen.texel, 0).xyz;
    let to_light = shading::to_light(p);
    // The scale: irradiance of the ambient light over that of the direct light.
    var radiance = color / PI * picture.scale * open;
    if dot(surface.xyz, to_light) > 0.0 {
        radiance += reflected(color, surface.w, surface.xyz, to_light, to_viewer) * lit_share(p, surface.xyz);
    }
    return display(radiance * frame.light_irradiance);
#endif
}
