// Constants, and the division of homogeneous coordinates.
#define_import_path fathom::math

const PI: f32 = 3.14159265358979324;
const TAU: f32 = 6.28318530717958648;

fn perspective_divide(v: vec4<f32>) -> vec3<f32> {
    return v.xyz / v.w;
}
