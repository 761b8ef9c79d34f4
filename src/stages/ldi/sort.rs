//! `ldi/sort`: the nearest fragments of each pixel's list, in order, as layers.

use crate::ldi::lists::Node;
use crate::prelude::*;
use crate::screen_ray::{FragmentLists, Layers};

pub const INFO: StageInfo = StageInfo {
    name: "ldi/sort",
    about: "layered depth image from the fragments' lists, sorted pixel by pixel",
    source: "Yang et al. 2010, §3",
};

/// Sides of a workgroup, as in the shader.
const WORKGROUP: u32 = 8;

/// The nearest `count` of each pixel, one at least.
pub fn new(
    resources: &Resources<'_>,
    lists: &FragmentLists,
    count: u32,
) -> Result<Stage<Layers>, GpuError> {
    let layers = Layers::stored(resources, INFO.name, lists.size_px, count.max(1));
    let group = Group::new(&[&lists.heads, &lists.nodes, &layers.depths, &layers.surfaces]);
    let defs = [("LAYERS", layers.count() as i32)];
    let workgroups = kit::square_workgroups(lists.size_px, WORKGROUP);
    let dispatch = Dispatch::new(resources, (INFO.name, &defs), &[&group], workgroups)?;
    let pixels = kit::pixels(&layers.depths);
    let texels = pixels * u64::from(layers.count());
    let work = Work {
        bytes_read: texels * size_of::<Node>() as u64,
        bytes_written: texels * (4 + 8),
        ..Work::default()
    };
    // Lists may be empty.
    let least = Work { bytes_read: pixels * 4, ..Work::default() };
    let stage = Dispatch::stage([dispatch], &INFO, work).at_least(least);
    Ok(stage.output(layers.output()).leaving(layers))
}
