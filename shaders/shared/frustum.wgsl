// The part of a line that lies within a frustum.
#define_import_path fathom::frustum

// The part of (first, last), shares of the way from a to b, on which a clip plane's distance is not negative.
fn cut(part: vec2<f32>, a: f32, b: f32) -> vec2<f32> {
    if a < 0.0 && b < 0.0 {
        return vec2(1.0, 0.0);
    }
    let crossing = a / (a - b);
    return vec2(select(part.x, max(part.x, crossing), a < 0.0), select(part.y, min(part.y, crossing), b < 0.0));
}

// Shares of the way from a to b, clip coordinates, between which it lies within the frustum; the first is above the last where it lies
// outside.
fn part_within(a: vec4<f32>, b: vec4<f32>) -> vec2<f32> {
    var part = cut(vec2(0.0, 1.0), a.w + a.x, b.w + b.x);
    part = cut(part, a.w - a.x, b.w - b.x);
    part = cut(part, a.w + a.y, b.w + b.y);
    part = cut(part, a.w - a.y, b.w - b.y);
    part = cut(part, a.z, b.z);
    return cut(part, a.w - a.z, b.w - b.z);
}
