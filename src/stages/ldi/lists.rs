//! `ldi/lists`: every fragment into the list of its pixel, in one pass over the triangles.

use glam::UVec2;

use crate::frame::Shared;
use crate::geometry::{Geometry, Part};
use crate::kit::{self, Bind, Buffer, Group, Raster, RenderSpec, Resources};
use crate::screen_ray::FragmentLists;
use crate::shader_struct;
use crate::{Stage, StageInfo};
use fathom_gpu::{ColorTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "ldi/lists",
    about: "every fragment into the list of its pixel, in one pass over the triangles",
    source: "Yang et al. 2010, §3; SPT §6",
};

/// Format of the target that a render pass must have: nothing is written to it.
const DUMMY: wgpu::TextureFormat = wgpu::TextureFormat::R8Unorm;

shader_struct! {
    /// `Lists` in `shaders/ldi/lists.wgsl`.
    pub struct ListUniforms {
        pub width: u32,
        pub capacity: u32,
    }
}

shader_struct! {
    /// `Node` in `shaders/shared/fragment_list.wgsl`.
    pub struct Node {
        pub depth: f32,
        pub next: u32,
        pub surface: UVec2,
    }
}

pub struct Lists {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    geometry: Geometry,
    part: Part,
    dummy: wgpu::TextureView,
    pub lists: FragmentLists,
}

impl Lists {
    /// With room for so many fragments a pixel, on average.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        (geometry, part): (&Geometry, Part),
        size_px: [u32; 2],
        per_pixel: u32,
    ) -> Result<Self, GpuError> {
        let pixels = u64::from(size_px[0]) * u64::from(size_px[1]);
        let capacity = pixels * u64::from(per_pixel);
        resources.indexed(INFO.name, capacity);
        let heads: Buffer = resources.storage(INFO.name, (pixels + 1) * 4);
        let nodes = resources.room_for::<Node>(INFO.name, capacity);
        let settings = ListUniforms {
            width: size_px[0],
            capacity: u32::try_from(capacity).unwrap_or(u32::MAX),
        };
        let uniforms = resources.uniform(INFO.name, &settings);
        let binds = [
            Bind::Uniform(&uniforms),
            Bind::Write(&heads),
            Bind::Write(&nodes),
            Bind::Read(&geometry.materials),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let write_mask = wgpu::ColorWrites::empty();
        let targets = [wgpu::ColorTargetState { write_mask, ..kit::opaque(DUMMY) }];
        let spec = RenderSpec {
            buffers: &[Geometry::layout(false)],
            ..RenderSpec::new(INFO.name, INFO.name, &groups, &targets)
        };
        Ok(Self {
            raster: Raster::new(resources, &spec)?,
            groups: kit::bare(&groups),
            geometry: geometry.clone(),
            part,
            dummy: kit::view(&resources.target(INFO.name, size_px, DUMMY)),
            lists: FragmentLists { heads, nodes, size_px, capacity: settings.capacity },
        })
    }
}

impl Stage for Lists {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.copy(|encoder| encoder.clear_buffer(&self.lists.heads, 0, None));
        let color = [ColorTarget { view: &self.dummy, clear: None, slice: None }];
        scope.render(&Targets { color: &color, depth: None }, |pass| {
            self.raster.bind(pass);
            kit::bind_groups(pass, &self.groups);
            self.geometry.draw(pass, self.part);
        });
    }

    fn work(&self) -> Work {
        Work {
            triangles: self.geometry.triangles_of(self.part),
            bytes_read: self.geometry.bytes(),
            bytes_written: self.lists.heads.size() + self.lists.nodes.size(),
            ..Work::default()
        }
    }

    /// Heads are cleared; nodes are as many as fragments.
    fn least_work(&self) -> Work {
        Work { bytes_read: 0, bytes_written: self.lists.heads.size(), ..self.work() }
    }
}
