//! `shafts/lines`: a line from start to hit for each photon, fading with its way, added up. SPT §3.2.

use crate::frame::Shared;
use crate::kit::{self, Bind, Buffer, Group, Raster, RenderSpec, Resources};
use crate::photon::Photons;
use crate::shader_struct;
use crate::{Column, Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "shafts/lines",
    about: "a line from start to hit for each photon, fading with its way through the medium",
    source: "SPT §3.2",
};

shader_struct! {
    /// `Shafts` in `shaders/shafts/lines.wgsl`.
    pub struct ShaftUniforms {
        pub photon_w: f32,
        pub photons: u32,
    }
}

pub struct Lines {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    view: wgpu::TextureView,
    /// W in each pixel that lines cross.
    pub target: wgpu::Texture,
    photons: u32,
    length_px: f64,
}

impl Lines {
    /// Over the camera's `depth`. `length_px` is that of a line in the middle of the view, for the declared work.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        (photons, weights): (&Photons, &Buffer),
        depth: &wgpu::Texture,
        (photon_w, length_px): (f64, f64),
    ) -> Result<Self, GpuError> {
        let settings = ShaftUniforms { photon_w: photon_w as f32, photons: photons.count };
        let settings = resources.uniform(INFO.name, &settings);
        let binds = [
            Bind::Uniform(&settings),
            Bind::Read(&photons.buffer),
            Bind::Depth(depth),
            Bind::Read(weights),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let format = kit::accumulation_format(resources.gpu);
        let targets = [kit::additive(format)];
        let spec = RenderSpec {
            topology: wgpu::PrimitiveTopology::LineList,
            ..RenderSpec::new(INFO.name, INFO.name, &groups, &targets)
        };
        let target = resources.target(INFO.name, [depth.width(), depth.height()], format);
        Ok(Self {
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            view: kit::view(&target),
            target,
            photons: photons.count,
            length_px,
        })
    }

    /// What the texels hold.
    pub fn column() -> Column {
        Column::new(
            "flux",
            "W",
            "flux of the photons whose lines cross the pixel, less what the medium took",
        )
    }
}

impl Stage for Lines {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        let clear = Some(wgpu::Color::BLACK);
        let color = [ColorTarget { view: &self.view, clear, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            pass.draw(0..2, 0..self.photons);
        });
    }

    fn work(&self) -> Work {
        let photons = u64::from(self.photons);
        let fragments = (f64::from(self.photons) * self.length_px) as u64;
        Work {
            photons,
            primitives: photons,
            fragments,
            bytes_read: Photons::bytes(photons),
            bytes_written: fragments * 4,
            ..Work::default()
        }
    }

    /// Lines may lie outside the picture.
    fn least_work(&self) -> Work {
        Work { fragments: 0, bytes_written: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![Output::texture("lines", "lines before the blur", vec![Self::column()], &self.target)]
    }
}
