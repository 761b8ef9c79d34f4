//! Counts of `ao/march` and `hsao/march`: at 4K with many samples a pixel they are greater than 32 bits hold.

use super::*;
use fathom_stages::ao::march as volume_march;
use fathom_stages::counters::Counters;
use fathom_stages::hsao::march as horizon_march;

const SIZE: [u32; 2] = [96, 72];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new(volume_march::INFO.name, "counters", |rig| carried(rig, 3, march_volume)),
        Case::new(horizon_march::INFO.name, "counters", |rig| carried(rig, 2, march_horizons)),
    ]
}

type Counting = fn(&Rig<'_>, (&Fixture, &GBuffer), &Counters) -> Result<()>;

fn march_volume(rig: &Rig<'_>, (seen, gbuffer): (&Fixture, &GBuffer), to: &Counters) -> Result<()> {
    let volume = pyramid(rig, 32, |p| p.z < -1.3)?;
    let marching = marching(|m| m.skipping = true);
    let camera = (gbuffer, seen.view.camera.view_projection(seen.view.aspect()));
    let volumes = std::slice::from_ref(&volume);
    let shared = &seen.shared;
    let stage = volume_march::new(rig, shared, volumes, camera, &marching, SIZE, Some(to))?;
    Ok(rig.run(&[&stage])?)
}

fn march_horizons(
    rig: &Rig<'_>,
    (seen, gbuffer): (&Fixture, &GBuffer),
    to: &Counters,
) -> Result<()> {
    let settings = Horizon::default().uniforms(SIZE, 1.0);
    let stage = horizon_march::new(rig, &seen.shared, gbuffer, &settings, false, Some(to))?;
    Ok(rig.run(&[&stage])?)
}

/// Partial sums that begin shortly before 2³² against those that begin at 0.
fn carried(rig: &Rig<'_>, counters: usize, count: Counting) -> Result<Check> {
    const BEGIN: u64 = (1 << 32) - 16;
    let (seen, _) = rig.two_walls(SIZE, [1.0, 1.2], [DVec3::Z; 2])?;
    let gbuffer = rig.gbuffer(&seen)?;
    let counted = |begin: u64| -> Result<[Vec<u64>; 2]> {
        let to = Counters::new(rig, "verify counters", counters);
        let slots = vec![begin; to.0.size() as usize / size_of::<u64>()];
        rig.gpu.queue.write_buffer(&to.0, 0, bytemuck::cast_slice(&slots));
        count(rig, (&seen, &gbuffer), &to)?;
        let begun = slots.chunks(slots.len() / counters).map(|slots| slots.iter().sum()).collect();
        Ok([to.sums(rig.gpu)?, begun])
    };
    let ([from_0, _], [found, begun]) = (counted(0)?, counted(BEGIN)?);
    let off = |bits: u32| {
        let sums = from_0.iter().zip(&begun).map(|(sum, begun)| (sum + begun) % (1 << bits));
        largest(found.iter().zip(sums).map(|(found, sum)| found.abs_diff(sum) as f64))
    };
    let check = Check::new(rig, "sums that begin below 2³²: largest difference of counts")
        .within((0.0, "1"), off(63))
        .control("sums of 32 bits", off(32));
    Ok(check.with("least_count", from_0.into_iter().min().unwrap_or(0) as f64))
}
