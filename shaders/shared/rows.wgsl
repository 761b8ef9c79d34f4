// Rows of bytes in a buffer, each aligned as a copy to a texture wants it. Host twin: src/stages/voxel/rows.rs.
#define_import_path fathom::rows

// Words from one row to the next: rows start at multiples of 256 bytes.
fn pitch_words(width: u32) -> u32 {
    return (width + 255u) / 256u * 64u;
}
