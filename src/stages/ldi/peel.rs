//! `ldi/peel`: layers of depth and normals from the camera, one after the other. SPT §2.2.

use crate::frame::Shared;
use crate::geometry::{Geometry, Part};
use crate::kit::{self, Bind, Group, Raster, RenderSpec, Resources};
use crate::screen_ray::Layers;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "ldi/peel",
    about: "layered depth image by depth peeling: a pass over all triangles for each layer",
    source: "SPT §2.2",
};

/// A pass: the layer that it draws.
struct Peel {
    groups: Vec<wgpu::BindGroup>,
    depth: wgpu::TextureView,
    surface: wgpu::TextureView,
}

pub struct LayeredDepth {
    first: Raster,
    behind: Option<Raster>,
    peels: Vec<Peel>,
    geometry: Geometry,
    part: Part,
    tested: wgpu::TextureView,
    pub layers: Layers,
}

impl LayeredDepth {
    /// `layers` layers, one at least, of a part of the scene.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        (geometry, part): (&Geometry, Part),
        size_px: [u32; 2],
        layers: u32,
    ) -> Result<Self, GpuError> {
        let layers = Layers::drawn(resources, INFO.name, size_px, layers.max(1));
        let group = |before: Option<u32>| {
            let mut binds = vec![Bind::Read(&geometry.materials)];
            binds.extend(before.map(|layer| Bind::Layer(&layers.depths, layer)));
            Group::new(resources.gpu, INFO.name, &binds)
        };
        let nearest = group(None);
        let behind: Vec<Group> = (1..layers.count()).map(|layer| group(Some(layer - 1))).collect();
        let raster = |first: bool, groups: &[&Group]| {
            let defs = [("FIRST", i32::from(first))];
            let targets = Layers::FORMATS.map(kit::opaque);
            let spec = RenderSpec {
                buffers: &[Geometry::layout(false)],
                depth: Some(kit::depth_state(wgpu::CompareFunction::Less, true)),
                ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), groups, &targets)
            };
            Raster::new(resources, &spec)
        };
        let second = behind.first().map(|group| raster(false, &[&shared.group, group]));
        let peel = |layer: u32| {
            let own = layer.checked_sub(1).map_or(&nearest, |before| &behind[before as usize]);
            Peel {
                groups: kit::bare(&[&shared.group, own]),
                depth: kit::layer_view(&layers.depths, layer),
                surface: kit::layer_view(&layers.surfaces, layer),
            }
        };
        Ok(Self {
            first: raster(true, &[&shared.group, &nearest])?,
            behind: second.transpose()?,
            peels: (0..layers.count()).map(peel).collect(),
            geometry: geometry.clone(),
            part,
            tested: kit::view(&resources.target(INFO.name, size_px, kit::DEPTH_FORMAT)),
            layers,
        })
    }
}

impl Stage for LayeredDepth {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        for (number, peel) in self.peels.iter().enumerate() {
            let color = [
                ColorTarget { view: &peel.depth, clear: Some(wgpu::Color::WHITE), slice: None },
                ColorTarget {
                    view: &peel.surface,
                    clear: Some(wgpu::Color::TRANSPARENT),
                    slice: None,
                },
            ];
            let depth = DepthTarget { view: &self.tested, clear: Some(1.0), read_only: false };
            let raster = if number == 0 { Some(&self.first) } else { self.behind.as_ref() };
            scope.render(&Targets { color: &color, depth: Some(depth) }, |pass| {
                if let Some(raster) = raster {
                    raster.bind(pass);
                    kit::bind_groups(pass, &peel.groups);
                    self.geometry.draw(pass, self.part);
                }
            });
        }
    }

    fn work(&self) -> Work {
        let layers = u64::from(self.layers.count());
        Work {
            triangles: layers * self.geometry.triangles_of(self.part),
            bytes_read: layers * self.geometry.bytes(),
            bytes_written: layers * kit::pixels(&self.layers.depths) * (4 + 8 + 4),
            ..Work::default()
        }
    }

    /// Of the geometry only one part is drawn, and its bytes are read once for each layer.
    fn least_work(&self) -> Work {
        Work { bytes_read: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![self.layers.output()]
    }
}
