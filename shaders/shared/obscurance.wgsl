// Obscurance γ along rays through a scalar field, in strata of equal length, jittered alike (Pauly et al. 2000): VAO Eq. 5 and 7, §5.2.3.
//
// BEER 1: windowed values are densities (Eq. 5); 0: opacities (Eq. 7). REJECTION 1: samples of falling value do not count (Eq. 4).
// ISOSURFACE 0: windowed values above V_thres end a ray; 1: values from V_thres, or with AT_ISOSURFACE 1 near the isosurface's.
#define_import_path fathom::obscurance

#import fathom::ray_cast::{OPAQUE, march, windowed}
#import fathom::scalar_field::{field, through_box, value}

// Whether a sample of this value ends a ray.
fn is_occluder(v: f32) -> bool {
#if ISOSURFACE == 0
    return windowed(v) > march.threshold;
#else if AT_ISOSURFACE == 1
    return abs(v - march.iso) < march.tolerance;
#else
    return v >= march.threshold;
#endif
}

// `first` is the windowed value where the ray begins, `level` that of the pyramid. The box bounds the medium. Marching ends at an occluder,
// or where the obscurance is near 1 (VAO §5.2.2).
fn obscurance(origin_m: vec3<f32>, direction: vec3<f32>, jitter: f32, first: f32, level: f32) -> f32 {
    let reach = min(march.r_max_m, through_box(origin_m, direction).y);
    var before = first;
#if BEER == 1
    var density = 0.0;
#else
    var clear = 1.0;
    let stratum = march.stratum_m / field.voxel_m;
    let min_clear = pow(OPAQUE, 1.0 / stratum);
#endif
    for (var k = 0u; k < march.samples; k++) {
        let d = (f32(k) + jitter) * march.stratum_m;
        if d >= reach {
            break;
        }
        let raw = value(origin_m + d * direction, level);
        let v = windowed(raw);
#if REJECTION == 1
        let is_falling = v < before;
        before = v;
        if is_falling {
            continue;
        }
#endif
#if BEER == 1
        density += v;
        if is_occluder(raw) || density * march.density_per_m * march.stratum_m > -log(OPAQUE) {
            break;
        }
#else
        clear *= 1.0 - march.opacity * v;
        if is_occluder(raw) || clear < min_clear {
            break;
        }
#endif
    }
#if BEER == 1
    return 1.0 - exp(-density * march.density_per_m * march.stratum_m);
#else
    return 1.0 - pow(max(clear, 1e-30), stratum);
#endif
}
