//! `ldi/sort`: the nearest fragments of each pixel's list, in order, as layers.

use crate::kit::{self, Bind, Dispatch, Group, Kernel, Resources};
use crate::ldi::lists::Node;
use crate::screen_ray::{FragmentLists, Layers};
use crate::{Output, Stage, StageInfo};
use fathom_gpu::{GpuError, StageScope};
use fathom_record::Work;

pub const INFO: StageInfo = StageInfo {
    name: "ldi/sort",
    about: "layered depth image from the fragments' lists, sorted pixel by pixel",
    source: "Yang et al. 2010, §3",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;

pub struct Sort {
    kernel: Kernel,
    dispatch: Dispatch,
    pub layers: Layers,
}

impl Sort {
    /// The nearest `layers` of each pixel, one at least.
    pub fn new(
        resources: &Resources<'_>,
        lists: &FragmentLists,
        layers: u32,
    ) -> Result<Self, GpuError> {
        let layers = Layers::stored(resources, INFO.name, lists.size_px, layers.max(1));
        let binds = [
            Bind::Read(&lists.heads),
            Bind::Read(&lists.nodes),
            Bind::StoreLayers(&layers.depths),
            Bind::StoreLayers(&layers.surfaces),
        ];
        let group = Group::new(resources.gpu, INFO.name, &binds);
        let defs = [("LAYERS", layers.count() as i32)];
        let [x, y] = lists.size_px.map(|side| side.div_ceil(WORKGROUP));
        Ok(Self {
            kernel: Kernel::new(resources, INFO.name, (INFO.name, &defs[..]), &[&group])?,
            dispatch: Dispatch::new(resources, INFO.name, &[&group], [x, y, 1]),
            layers,
        })
    }
}

impl Stage for Sort {
    fn info(&self) -> &'static StageInfo {
        &INFO
    }

    fn encode(&self, scope: &mut StageScope<'_>) {
        scope.compute(|pass| self.kernel.run(pass, &self.dispatch));
    }

    fn work(&self) -> Work {
        let texels = kit::pixels(&self.layers.depths) * u64::from(self.layers.count());
        Work {
            bytes_read: texels * size_of::<Node>() as u64,
            bytes_written: texels * (4 + 8),
            ..Work::default()
        }
    }

    /// Lists may be empty.
    fn least_work(&self) -> Work {
        Work { bytes_read: kit::pixels(&self.layers.depths) * 4, ..Work::default() }
    }

    fn outputs(&self) -> Vec<Output> {
        vec![self.layers.output()]
    }
}
