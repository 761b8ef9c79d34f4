// Fragments of a pixel as a linked list. Host twin: src/stages/ldi/lists.rs.
#define_import_path fathom::fragment_list

struct Node {
    // Device depth.
    depth: f32,
    // Number of the next fragment, from 1 on; 0: none.
    next: u32,
    normal: vec3<f32>,
    // As `fathom::optics` reads it.
    optics: f32,
}
