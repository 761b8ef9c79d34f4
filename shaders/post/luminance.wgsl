// Log-average luminance of a picture, by sums in workgroup memory. Reinhard, Stark, Shirley and Ferwerda 2002, Eq. 1.
// Step 0 sums GROUP × TEXELS texels a workgroup, step 1 the sums of all workgroups.
// defs: STEP=0

const GROUP: u32 = 256u;
const TEXELS: u32 = 4u;
// What is added to each luminance, so that black has a logarithm.
const LEAST: f32 = 1e-4;

@group(0) @binding(0) var picture: texture_2d<f32>;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;
@group(0) @binding(2) var<storage, read_write> average: array<f32>;

var<workgroup> partial: array<f32, GROUP>;

// Of what the picture shows, in linear light: its values are display values of gamma 2.2.
fn log_luminance(texel: u32) -> f32 {
    let size = textureDimensions(picture);
    if texel >= size.x * size.y {
        return 0.0;
    }
    let shown = textureLoad(picture, vec2(texel % size.x, texel / size.x), 0).rgb;
    let linear = pow(shown, vec3(2.2));
    return log(LEAST + dot(linear, vec3(0.2126, 0.7152, 0.0722)));
}

fn gathered(group: u32, lane: u32) -> f32 {
    var sum = 0.0;
#if STEP == 0
    for (var i = 0u; i < TEXELS; i++) {
        sum += log_luminance((group * TEXELS + i) * GROUP + lane);
    }
#else
    for (var i = lane; i < arrayLength(&sums); i += GROUP) {
        sum += sums[i];
    }
#endif
    return sum;
}

@compute @workgroup_size(256)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let number = group.y * groups.x + group.x;
    partial[lane] = gathered(number, lane);
    workgroupBarrier();
    for (var half = GROUP / 2u; half > 0u; half /= 2u) {
        if lane < half {
            partial[lane] += partial[lane + half];
        }
        workgroupBarrier();
    }
    if lane > 0u {
        return;
    }
#if STEP == 0
    if number < arrayLength(&sums) {
        sums[number] = partial[0];
    }
#else
    let size = textureDimensions(picture);
    average[0] = exp(partial[0] / f32(size.x * size.y));
#endif
}
