//! `refraction/two_interface`: refraction through two interfaces, approximated. Wyman 2005, the method that SPT §4 compares with.

use super::{Exits, FORMAT};
use crate::frame::Shared;
use crate::geometry::{Geometry, Part};
use crate::kit::{self, Bind, Buffer, Group, Raster, RenderSpec, Resources};
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{ColorTarget, DepthTarget, GpuError, StageScope, Targets};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/two_interface",
    about: "lines of sight through the nearest and the farthest surface of glass, approximated",
    source: "Wyman 2005",
};

/// Normals of the far side.
const NORMALS: wgpu::TextureFormat = wgpu::TextureFormat::Rgba16Float;

/// A pass over the glass: how it is drawn, and into what.
struct Side {
    raster: Raster,
    groups: Vec<wgpu::BindGroup>,
    colors: Vec<wgpu::TextureView>,
    depth: wgpu::TextureView,
}

pub struct TwoInterface {
    far: Side,
    near: Side,
    geometry: Geometry,
    pixels: u64,
    pub exits: Exits,
}

impl TwoInterface {
    /// `thickness_m` holds the way through the object against the normal, for each vertex.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        geometry: &Geometry,
        size_px: [u32; 2],
        thickness_m: &Buffer,
    ) -> Result<Self, GpuError> {
        let target = |format| resources.target(INFO.name, size_px, format);
        let (back_depths, back_normals) = (target(kit::DEPTH_FORMAT), target(NORMALS));
        let side = |near: bool, binds: &[Bind<'_>], colors: &[&wgpu::Texture], depth| {
            let group = Group::new(resources.gpu, INFO.name, binds);
            let groups = [&shared.group, &group];
            let defs = [("SIDE", i32::from(near))];
            let states: Vec<_> = colors.iter().map(|color| kit::opaque(color.format())).collect();
            let nearer = wgpu::CompareFunction::Less;
            let compare = if near { nearer } else { wgpu::CompareFunction::Greater };
            let spec = RenderSpec {
                buffers: &[Geometry::layout(false)],
                depth: Some(kit::depth_state(compare, true)),
                ..RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &states)
            };
            Ok::<_, GpuError>(Side {
                raster: Raster::new(resources, &spec)?,
                groups: kit::bare(&groups),
                colors: colors.iter().map(|color| kit::view(color)).collect(),
                depth: kit::view(depth),
            })
        };
        let materials = Bind::Read(&geometry.materials);
        let far = side(false, &[materials], &[&back_normals], &back_depths)?;
        let exits = Exits { positions: target(FORMAT), directions: target(FORMAT) };
        let binds = [
            Bind::Read(&geometry.materials),
            Bind::Depth(&back_depths),
            Bind::Texels(&back_normals),
            Bind::Read(thickness_m),
        ];
        let nearest = target(kit::DEPTH_FORMAT);
        let near = side(true, &binds, &[&exits.positions, &exits.directions], &nearest)?;
        let pixels = kit::pixels(&nearest);
        Ok(Self { far, near, geometry: geometry.clone(), pixels, exits })
    }

    fn draw(&self, scope: &mut StageScope<'_>, side: &Side, cleared: f32) {
        let clear = Some(wgpu::Color::TRANSPARENT);
        let colors: Vec<_> =
            side.colors.iter().map(|view| ColorTarget { view, clear, slice: None }).collect();
        let depth = DepthTarget { view: &side.depth, clear: Some(cleared), read_only: false };
        scope.render(&Targets { color: &colors, depth: Some(depth) }, |pass| {
            side.raster.bind(pass);
            kit::bind_groups(pass, &side.groups);
            self.geometry.draw(pass, Part::Glass);
        });
    }
}

impl Stage for TwoInterface {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.draw(scope, &self.far, 0.0);
        self.draw(scope, &self.near, 1.0);
    }

    fn work(&self) -> Work {
        Work {
            triangles: 2 * self.geometry.triangles_of(Part::Glass),
            bytes_read: 2 * self.geometry.bytes(),
            bytes_written: self.pixels * (4 + 8 + 4 + 32),
            ..Work::default()
        }
    }

    /// Of the geometry only one part is drawn, and its bytes are read twice.
    fn least_work(&self) -> Work {
        Work { bytes_read: 0, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        self.exits.outputs()
    }
}
