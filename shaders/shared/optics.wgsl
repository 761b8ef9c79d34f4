// What becomes of light at a surface: a number beside each normal of the layers. Host twin: `optics` in src/stages/shared/geometry.rs.
// It ends there (1), the same on a RECEIVER of shadows, it is reflected (−1), or, from GLASS on, the number is glass's refractive index and 1.
#define_import_path fathom::optics

const RECEIVER: f32 = 1.5;
const GLASS: f32 = 2.0;

// Whether light goes on from there.
fn passes(optics: f32) -> bool {
    return is_mirror(optics) || is_glass(optics);
}

fn is_mirror(optics: f32) -> bool {
    return optics < 0.0;
}

fn is_glass(optics: f32) -> bool {
    return optics >= GLASS;
}

fn is_receiver(optics: f32) -> bool {
    return optics == RECEIVER;
}

fn refractive_index(optics: f32) -> f32 {
    return optics - 1.0;
}

// Direction behind a surface, `eta` the index before it over that behind it. Totally reflected light stays before it.
fn refracted(direction: vec3<f32>, normal: vec3<f32>, eta: f32) -> vec3<f32> {
    let facing = faceForward(normal, direction, normal);
    let behind = refract(direction, facing, eta);
    if dot(behind, behind) == 0.0 {
        return reflect(direction, facing);
    }
    return normalize(behind);
}
