// Arithmetic of known amount, for the audit of the clock.
#define_import_path fathom::busy_work

// `iterations` dependent steps of the logistic map. Its chaos keeps a compiler from finding a
// closed form, and the result must be written somewhere, or the loop is dropped.
fn logistic(seed: f32, iterations: u32) -> f32 {
    var x = fract(seed * 0.61803399) * 0.9 + 0.05;
    for (var i = 0u; i < iterations; i++) {
        x = 3.99 * x * (1.0 - x);
    }
    return x;
}
