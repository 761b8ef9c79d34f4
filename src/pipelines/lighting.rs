//! What pipelines of ambient occlusion draw before and after their occlusion buffer: shadow map and G-buffer, then filter and
//! composition. VAO §6.

use std::rc::Rc;

use super::settings::{Compose, Filter, Shadow, VIEWPORT};
use fathom_gpu::{GpuError, StageInfo};
use fathom_scene::Scene;
use fathom_stages::bilateral::Bilateral;
use fathom_stages::frame::{Frame, Shared, View};
use fathom_stages::geometry::Geometry;
use fathom_stages::kit::Resources;
use fathom_stages::{ao, post, scene, shadow};

/// The stages before the occlusion buffer.
pub struct Seen {
    view: View,
    pub shared: Shared,
    shadow: Rc<shadow::depth::Depth>,
    pub gbuffer: Rc<scene::gbuffer::Gbuffer>,
}

impl Seen {
    /// Writes the shared uniforms: the first stage of a frame.
    pub fn frame(resources: &Resources<'_>, view: &View) -> Shared {
        let shared = Shared::new(resources, view);
        resources.push(Frame::new(view.clone(), &shared));
        shared
    }

    /// The geometry from the light and from the camera.
    ///
    /// # Errors
    /// What the GPU reports.
    pub fn draw(
        resources: &Resources<'_>,
        (view, shared): (View, Shared),
        geometry: &Geometry,
        shadow: &Shadow,
    ) -> Result<Self, GpuError> {
        let of_light = resources.sized_by("shadow.size");
        let depth = shadow::depth::Depth::new(&of_light, &shared, geometry, shadow.size)?;
        let shadow = of_light.push(depth);
        let of_view = resources.sized_by(VIEWPORT);
        let size_px = view.size_px.to_array();
        let gbuffer = scene::gbuffer::Gbuffer::new(&of_view, &shared, geometry, size_px)?;
        Ok(Self { gbuffer: of_view.push(gbuffer), view, shared, shadow })
    }
}

/// The stages after the occlusion buffer.
pub struct Composed {
    pub filter: Option<Rc<Bilateral>>,
    pub compose: Rc<ao::compose::Compose>,
}

impl Composed {
    /// Filters `visibility` by the stage of `filter`, if there is one, and lights the picture.
    ///
    /// # Errors
    /// What the GPU reports.
    pub fn new(
        resources: &Resources<'_>,
        seen: &Seen,
        (scene, geometry): (&Scene, &Geometry),
        visibility: &wgpu::Texture,
        filter: Option<(&'static StageInfo, &Filter)>,
        compose: &Compose,
    ) -> Result<Self, GpuError> {
        let resources = &resources.sized_by(VIEWPORT);
        let gbuffer = &seen.gbuffer.textures;
        let filtered = |(info, settings): (&'static StageInfo, &Filter)| {
            let source_px = [visibility.width(), visibility.height()];
            let settings = settings.uniforms(&seen.view, source_px);
            let textures = (visibility, &gbuffer.depth, &gbuffer.normal);
            let made = Bilateral::new(resources, info, &seen.shared, textures, &settings)?;
            Ok::<_, GpuError>(resources.push(made))
        };
        let filter = filter.map(filtered).transpose()?;
        let lit = ao::compose::Lit {
            gbuffer,
            visibility: filter.as_ref().map_or(visibility, |filter| filter.texture()),
            shadow: seen.shadow.texture(),
        };
        let settings = compose.uniforms(&seen.view);
        let shows_occlusion = compose.shows_occlusion();
        let made =
            ao::compose::Compose::new(resources, &seen.shared, &lit, &settings, shows_occlusion)?;
        let lighted = resources.push(made);
        // Visibility is shown without what one sees through: VAO Fig. 6.
        if !shows_occlusion {
            let drawn = (lighted.texture(), &gbuffer.depth);
            let (of_frame, of_scene) = ((&seen.shared, &seen.view), (scene, geometry));
            let settings = compose.glass();
            let glass = ao::glass::Glass::new(resources, of_frame, of_scene, drawn, &settings)?;
            if let Some(glass) = glass {
                resources.push(glass);
            }
        }
        if compose.meter {
            resources.push(post::luminance::Luminance::new(resources, lighted.texture())?);
        }
        Ok(Self { compose: lighted, filter })
    }
}
