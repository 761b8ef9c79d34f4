//! The textures of the G-buffer, as `scene/gbuffer` leaves them and later stages read them.

/// What the camera sees at each pixel.
#[derive(Clone)]
pub struct GBuffer {
    pub albedo: wgpu::Texture,
    /// The specular coefficient in its fourth channel.
    pub normal: wgpu::Texture,
    pub depth: wgpu::Texture,
}
