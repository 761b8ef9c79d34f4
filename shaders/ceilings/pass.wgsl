// Counts its passes.
@group(0) @binding(0) var<storage, read_write> passes: u32;

@compute @workgroup_size(1)
fn main() {
    passes += 1u;
}
