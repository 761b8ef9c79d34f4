//! What pipelines of ambient occlusion draw before and after their occlusion buffer: shadow map and G-buffer, then filter and
//! composition. VAO §6.

use super::settings::{Compose, Filter, Shadow, VIEWPORT};
use fathom_gpu::kit::{self, Resources};
use fathom_gpu::{GpuError, StageInfo};
use fathom_scene::Scene;
use fathom_stages::bilateral::{self, Window};
use fathom_stages::gbuffer::GBuffer;
use fathom_stages::geometry::Geometry;
use fathom_stages::picture::Picture;
use fathom_stages::uniforms::{Shared, View};
use fathom_stages::{ao, scene, shadow};

pub struct VisibleScene {
    view: View,
    pub shared: Shared,
    shadow: wgpu::Texture,
    pub gbuffer: GBuffer,
}

impl VisibleScene {
    /// The geometry from the light and from the camera.
    pub fn draw(
        resources: &Resources<'_>,
        view: View,
        shared: Shared,
        geometry: &Geometry,
        shadow: &Shadow,
    ) -> Result<Self, GpuError> {
        let of_light = resources.with_size_hint("shadow.size");
        let depth = shadow::depth::new(&of_light, &shared, geometry, shadow.size)?;
        let shadow = of_light.push(depth);
        let of_view = resources.with_size_hint(VIEWPORT);
        let size_px = view.size_px.to_array();
        let gbuffer = scene::gbuffer::new(&of_view, &shared, geometry, size_px)?;
        Ok(Self { gbuffer: of_view.push(gbuffer), view, shared, shadow })
    }
}

/// What the stages after the occlusion buffer leave.
pub struct LitImage {
    /// The stage that filters, and what it leaves.
    pub filtered: Option<(&'static str, wgpu::Texture)>,
    pub image: wgpu::Texture,
    /// The image is visibility.
    pub shows_occlusion: bool,
}

impl LitImage {
    /// Filters `visibility` by the stage of `filter`, if there is one, and lights the picture.
    pub fn new(
        resources: &Resources<'_>,
        seen: &VisibleScene,
        scene: &Scene,
        geometry: &Geometry,
        visibility: &wgpu::Texture,
        filter: Option<(&'static StageInfo, &Filter, Window)>,
        compose: &Compose,
    ) -> Result<Self, GpuError> {
        let resources = &resources.with_size_hint(VIEWPORT);
        let gbuffer = &seen.gbuffer;
        let filtered = |(info, settings, window): (&'static StageInfo, &Filter, Window)| {
            let settings = settings.uniforms(&seen.view, kit::size_px(visibility));
            let (shared, depth, normal) = (&seen.shared, &gbuffer.depth, &gbuffer.normal);
            let made = bilateral::new(
                resources,
                info,
                shared,
                visibility,
                depth,
                normal,
                (&settings, window),
            )?;
            Ok::<_, GpuError>((info.name, resources.push(made)))
        };
        let filtered = filter.map(filtered).transpose()?;
        let lit = ao::compose::LitInputs {
            picture: Picture::new(gbuffer, compose.exposure, compose.ambient),
            visibility: filtered.as_ref().map_or(visibility, |(_, texture)| texture),
            shadow: &seen.shadow,
        };
        let shows_occlusion = compose.shows_occlusion();
        let made = ao::compose::new(resources, &seen.shared, &lit, shows_occlusion)?;
        let image = resources.push(made);
        // Visibility is shown without what one sees through: VAO Fig. 6.
        if !shows_occlusion {
            let (of_frame, of_scene) = ((&seen.shared, &seen.view), (scene, geometry));
            let (drawn, settings) = ((&image, &gbuffer.depth), compose.glass());
            let glass = ao::glass::new(resources, of_frame, of_scene, drawn, &settings)?;
            if let Some(glass) = glass {
                resources.push(glass);
            }
        }
        Ok(Self { filtered, image, shows_occlusion })
    }
}
