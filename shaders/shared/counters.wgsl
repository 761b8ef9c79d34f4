// Counters for figures of a frame that is run once more to count: src/stages/shared/counters.rs. COUNTERS is the number of their group.
#define_import_path fathom::counters

// A sum of 64 bits for each counter and slot: the lower word, then what was carried out of it.
@group(#{COUNTERS}) @binding(3) var<storage, read_write> counters: array<atomic<u32>>;

fn count(counter: u32, slot: u32, n: u32) {
    let word = 2u * (64u * counter + slot);
    let before = atomicAdd(&counters[word], n);
    if before + n < before {
        atomicAdd(&counters[word + 1u], 1u);
    }
}
