// Fragments of a pixel as a linked list. Host twin: src/stages/ldi/lists.rs.
#define_import_path fathom::fragment_list

struct Node {
    // Device depth.
    depth: f32,
    // Number of the next fragment, from 1 on; 0: none.
    next: u32,
    // Normal and optics: `fathom::surface_texel`.
    surface: vec2<u32>,
}
