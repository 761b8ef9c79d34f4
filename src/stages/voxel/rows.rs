//! Rows of bytes in a buffer, aligned for copies to a texture. `R8Unorm` cannot be written as
//! storage: what fills such a texture writes rows and copies them.

/// Bytes from one row to the next.
pub(super) fn pitch(width: u32) -> u32 {
    width.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT)
}

/// Bytes that the rows of a grid take.
pub(super) fn bytes(cells: [u32; 3]) -> u64 {
    u64::from(pitch(cells[0])) * u64::from(cells[1]) * u64::from(cells[2])
}

/// Copies rows, from `offset` on in the buffer, to one level of a volume.
pub(super) fn copy(
    encoder: &mut wgpu::CommandEncoder,
    (rows, offset): (&wgpu::Buffer, u64),
    texture: &wgpu::Texture,
    (level, cells): (u32, [u32; 3]),
) {
    let layout = wgpu::TexelCopyBufferLayout {
        offset,
        bytes_per_row: Some(pitch(cells[0])),
        rows_per_image: Some(cells[1]),
    };
    let source = wgpu::TexelCopyBufferInfo { buffer: rows, layout };
    let target = wgpu::TexelCopyTextureInfo { mip_level: level, ..texture.as_image_copy() };
    let size =
        wgpu::Extent3d { width: cells[0], height: cells[1], depth_or_array_layers: cells[2] };
    encoder.copy_buffer_to_texture(source, target, size);
}
