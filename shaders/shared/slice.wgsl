// The part of a loop that a pass makes, where an invocation may not make all of it. Host twin: src/stages/shared/slices.rs.
#define_import_path fathom::slice

struct Slice {
    first: u32,
    // Behind the last.
    end: u32,
}
