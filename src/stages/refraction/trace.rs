//! `refraction/trace`: lines of sight through glass, refracted several times, through layers of depth. SPT §4.

use super::{Exits, FORMAT};
use crate::frame::Shared;
use crate::kit::{self, Bind, Group, RenderSpec, Resources, ScreenPass};
use crate::screen_ray::{Layers, WalkUniforms, walk_turns};
use crate::shader_struct;
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "refraction/trace",
    about: "lines of sight through glass, refracted several times, through layers of depth",
    source: "SPT §4",
};

shader_struct! {
    /// `Trace` in `shaders/refraction/trace.wgsl`.
    pub struct TraceUniforms {
        pub refractions: u32,
    }
}

/// What a ray inside is held against.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Surface {
    /// The depths of the texels behind which it is: SPT §4.
    Depth,
    /// The tangent planes of the surfaces in these texels.
    Plane,
}

fathom_base::choices!(Surface);

pub struct Trace {
    pass: ScreenPass,
    pub exits: Exits,
    work: Work,
}

impl Trace {
    /// Through `layers` of what refracts, at most `refractions` times.
    pub fn new(
        resources: &Resources<'_>,
        shared: &Shared,
        layers: &Layers,
        walk: &WalkUniforms,
        (refractions, surface): (u32, Surface),
    ) -> Result<Self, GpuError> {
        resources.turns(
            "refractions × view",
            u64::from(refractions) * (walk_turns(walk.most, 0) + 2) + 1,
        );
        let walk_uniforms = resources.uniform(INFO.name, walk);
        let settings = TraceUniforms { refractions };
        let settings = resources.uniform(INFO.name, &settings);
        let binds = [
            Bind::Uniform(&walk_uniforms),
            Bind::Uniform(&settings),
            Bind::Layers(&layers.depths),
            Bind::Layers(&layers.surfaces),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let groups = [&shared.group, &group];
        let defs = [("SURFACE", i32::from(surface == Surface::Plane))];
        let targets = [FORMAT; 2].map(kit::opaque);
        let spec = RenderSpec::new(INFO.name, (INFO.name, &defs[..]), &groups, &targets);
        let pass = ScreenPass::new(resources, &spec, layers.size_px(), wgpu::Color::TRANSPARENT)?;
        let exits =
            Exits { positions: pass.targets[0].clone(), directions: pass.targets[1].clone() };
        let pixels = pass.pixels();
        let steps = pixels * u64::from(refractions.saturating_sub(1)) * u64::from(walk.most);
        let work = Work {
            fragments: pixels,
            texel_fetches: 4 * steps + 2 * pixels,
            bytes_written: pixels * 32,
            ..Work::default()
        };
        Ok(Self { pass, exits, work })
    }
}

impl Stage for Trace {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        self.pass.encode(scope);
    }

    /// At most: each ray as long as the picture.
    fn work(&self) -> Work {
        self.work
    }

    /// A ray may end at its first texel.
    fn least_work(&self) -> Work {
        Work { texel_fetches: self.work.fragments, ..self.work() }
    }

    fn outputs(&self) -> Vec<Output> {
        self.exits.outputs()
    }
}
