// The photons of a cell of a light's grid, SIDE² of them in a loop. SIDE = 0 takes the bound from the settings (UW §4.1, dynamic tessellation).
#define_import_path fathom::tracing

#import fathom::estimator::{Trace, photon_ndc, trace}
#import fathom::photon::{Photon}

@group(1) @binding(0) var<uniform> settings: Trace;
@group(1) @binding(1) var shadow_depth: texture_depth_2d;
@group(1) @binding(2) var shadow_mask: texture_2d<f32>;
@group(1) @binding(3) var<storage, read_write> photons: array<Photon>;
@group(1) @binding(4) var texels: sampler;

fn trace_cell(cell: vec2<u32>) {
    if any(cell >= vec2(settings.grid)) {
        return;
    }
#if SIDE == 0
    let side = settings.side;
#else
    let side = #{SIDE}u;
#endif
    let first = (cell.y * settings.grid + cell.x) * side * side;
    for (var y = 0u; y < side; y++) {
        for (var x = 0u; x < side; x++) {
            let ndc = photon_ndc(settings, cell, vec2(x, y), side);
            photons[first + y * side + x] = trace(settings, shadow_depth, texels, shadow_mask, ndc);
        }
    }
}
