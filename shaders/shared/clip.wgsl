// Segments cut at planes in clip coordinates, in which a point's distance to a plane of the frustum is linear along the segment.
#define_import_path fathom::clip

// The part of a range of shares of a segment in which a distance that goes from `a` to `b` along the segment is not negative; (1, 0): none.
fn cut(range: vec2<f32>, a: f32, b: f32) -> vec2<f32> {
    if a < 0.0 && b < 0.0 {
        return vec2(1.0, 0.0);
    }
    if a < 0.0 {
        return vec2(max(range.x, a / (a - b)), range.y);
    }
    if b < 0.0 {
        return vec2(range.x, min(range.y, a / (a - b)));
    }
    return range;
}

// The part of the segment from `a` to `b` between the sides of the frustum and behind its near plane.
fn cut_to_sides(a: vec4<f32>, b: vec4<f32>) -> vec2<f32> {
    var range = cut(vec2(0.0, 1.0), a.w + a.x, b.w + b.x);
    range = cut(range, a.w - a.x, b.w - b.x);
    range = cut(range, a.w + a.y, b.w + b.y);
    range = cut(range, a.w - a.y, b.w - b.y);
    return cut(range, a.z, b.z);
}
