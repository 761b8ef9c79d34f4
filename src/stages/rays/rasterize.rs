//! `rays/rasterize`: a line for each photon into its own row; each fragment is held against all layers. SPT §2.1.

use crate::frame::Shared;
use crate::kit::{self, Raster, RenderSpec, Resources};
use crate::screen_ray::Rays;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "rays/rasterize",
    about: "photon rays as lines, a row of pixels each, every pixel held against all layers",
    source: "SPT §2.1",
};

/// Distance of a pixel that hits nothing: `NO_HIT` in `shaders/shared/screen_ray.wgsl`.
pub const NO_HIT: f32 = 1e30;

pub struct Rasterize {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    view: wgpu::TextureView,
    /// Distance along the ray where a pixel hits, metres: a photon a row, a step a column.
    pub hits: wgpu::Texture,
    photons: u32,
    tiles: u32,
    ways: u32,
    work: Work,
}

impl Rasterize {
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        rays: &Rays<'_>,
    ) -> Result<Self, GpuError> {
        let own = rays.group(resources, INFO.name, None);
        let groups = [&shared.group, &own];
        let defs = rays.defs();
        let format = wgpu::TextureFormat::R32Float;
        let targets = [kit::opaque(format)];
        let spec = RenderSpec {
            topology: wgpu::PrimitiveTopology::LineList,
            ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets)
        };
        let raster = Raster::new(resources, &spec)?;
        let hits = resources.target(INFO.name, [rays.most(), rays.rows()], format);
        Ok(Self {
            raster,
            groups: kit::bare(&groups),
            view: kit::view(&hits),
            hits,
            photons: rays.transfers.count,
            tiles: rays.tiles(),
            ways: rays.walking.ways,
            work: rays.work(),
        })
    }
}

impl Stage for Rasterize {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let first = scope.turn() % self.tiles * self.hits.height();
        let last = (first + self.hits.height()).min(self.photons);
        let clear = Some(wgpu::Color { r: f64::from(NO_HIT), ..wgpu::Color::BLACK });
        let color = [ColorTarget { view: &self.view, clear, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.draw(0..2, first..last);
        });
    }

    /// A turn for each tile of rows and each way.
    fn turns(&self) -> u32 {
        self.tiles * self.ways
    }

    fn work(&self) -> Work {
        let steps = self.work.photons * u64::from(self.hits.width());
        Work {
            primitives: self.work.photons,
            fragments: steps,
            bytes_written: steps * 4,
            ..self.work
        }
    }

    /// Rays end early, and all turns write to the same target.
    fn least_work(&self) -> Work {
        let pixels = u64::from(self.hits.width()) * u64::from(self.hits.height());
        Work { primitives: self.work.photons, bytes_written: pixels * 4, ..Work::default() }
    }

    fn outputs(&self) -> Vec<Output> {
        let column =
            Column::new("distance_m", "m", "from the start of the ray; 1e30 where nothing is hit");
        let meaning = "hits of the last tile of photons: a photon a row, a step a column";
        vec![Output::texture("hits", meaning, vec![column], &self.hits)]
    }
}
