// The iterations of a loop that one pass makes, where an adapter does not allow an invocation all of them. Host twin: src/stages/shared/slices.rs.
#define_import_path fathom::slice

struct Slice {
    first: u32,
    // Behind the last.
    end: u32,
}
