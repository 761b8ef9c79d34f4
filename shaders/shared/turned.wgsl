// An axis of the grid as the depth of a pass: what `voxel/slice` and `voxel/slicemap` share.
#define_import_path fathom::turned

// Column and row of the pass, and depth.
fn turned(v: vec3<f32>) -> vec3<f32> {
#if AXIS == 0
    return v.yzx;
#else if AXIS == 1
    return v.xzy;
#else
    return v.xyz;
#endif
}
