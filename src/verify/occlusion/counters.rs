//! Counts of `ao/march` and `hsao/march`: at 4K with many samples a pixel they are greater than 32 bits hold.

use super::*;
use fathom_stages::ao::march as volume_march;
use fathom_stages::counters::Counters;
use fathom_stages::hsao::march as horizon_march;

const SIZE: [u32; 2] = [96, 72];

pub fn cases() -> Vec<Case> {
    let stages = [(volume_march::INFO.name, 3), (horizon_march::INFO.name, 2)];
    stages.map(|(stage, count)| Case::new(stage, "counters", move |rig| carried(rig, count))).into()
}

/// Partial sums that begin shortly before 2³² against those that begin at 0.
fn carried(rig: &Rig<'_>, counters: usize) -> Result<Check> {
    const BEGIN: u64 = (1 << 32) - 16;
    let (seen, _) = rig.two_walls(SIZE, [1.0, 1.2], [DVec3::Z; 2])?;
    let (gbuffer, shared) = (rig.gbuffer(&seen)?, &seen.shared);
    let volumes = [pyramid(rig, 32, |p| p.z < -1.3)?];
    let marching = marching(|m| m.skipping = true);
    let camera = (&gbuffer, seen.view.camera.view_projection(seen.view.aspect()));
    let counted = |begin: u64| -> Result<[Vec<u64>; 2]> {
        let to = Counters::new(rig, "verify counters", counters);
        let slots = vec![begin; to.0.size() as usize / size_of::<u64>()];
        rig.gpu.queue.write_buffer(&to.0, 0, bytemuck::cast_slice(&slots));
        let stage = if rig.stage == volume_march::INFO.name {
            volume_march::new(rig, shared, &volumes, camera, &marching, SIZE, Some(&to))?
        } else {
            let settings = Horizon::default().uniforms(SIZE, 1.0);
            horizon_march::new(rig, shared, &gbuffer, &settings, false, Some(&to))?
        };
        rig.run(&[&stage])?;
        let begun = slots.chunks(slots.len() / counters).map(|slots| slots.iter().sum()).collect();
        Ok([to.sums(rig.gpu)?, begun])
    };
    let ([from_0, _], [found, begun]) = (counted(0)?, counted(BEGIN)?);
    let sum = |i: usize, bits: u32| (from_0[i] + begun[i]) % (1 << bits);
    let off = |bits| largest((0..counters).map(|i| found[i].abs_diff(sum(i, bits)) as f64));
    Ok(Check::new(rig, "sums that begin below 2³²: largest difference of counts")
        .within((0.0, "1"), off(63))
        .control("sums of 32 bits", off(32)))
}
