//! How many turns of its loops an adapter lets an invocation make.

use crate::readback::read_buffer;
use crate::shader::compilation_options;
use crate::{Gpu, GpuError};
use fathom_record::LoopTurns;

/// Turns that all loops of an invocation make together at most, in any stage on any adapter: what needs more is cut into several
/// passes or refused. llvmpipe ends the loops of an invocation after 65,535 turns, and reports nothing: `LP_MAX_TGSI_LOOP_ITERATIONS` in
/// Mesa's `src/gallium/auxiliary/gallivm/lp_bld_limits.h`. Loops inside one another and loops one after the other share the count,
/// and it advances by the turns of the longest of the invocations that share a vector. A turn that only finds the loop's end counts too.
/// SwiftShader has no such limit. The difference to 65,535 is for loops that are not counted, of few turns.
pub const MAX_ITERATIONS: u64 = 65_000;
/// Turns that the audit asks for: beyond what any stage needs in one invocation.
const TRIED: u32 = 1 << 20;
/// Of the outer and the inner of two loops.
const SIDE: u32 = 1 << 10;

/// What an invocation does of `TRIED` turns, in one loop and in two of which one lies within the other.
///
/// # Errors
/// A fault of the device, turns whose work was not done, and a limit below [`MAX_ITERATIONS`].
pub fn measure_loop_turns(gpu: &Gpu) -> Result<LoopTurns, GpuError> {
    let single = made(gpu, [1, TRIED])?;
    let nested = made(gpu, [SIDE, TRIED / SIDE])?;
    if u64::from(single) < MAX_ITERATIONS {
        return Err(GpuError::Unusable(format!(
            "the adapter ends loops after {single} turns; stages may make {MAX_ITERATIONS} in one pass, so their results would be false"
        )));
    }
    Ok(LoopTurns { tried: TRIED, single, nested })
}

/// What the audit found, for people.
pub fn describe_loop_turns(found: LoopTurns) -> String {
    let LoopTurns { tried, single, nested } = found;
    if single.min(nested) == tried {
        return format!("loops: an invocation makes all of {tried} turns");
    }
    format!(
        "loops: of {tried} turns an invocation makes {single} in one loop and {nested} in nested ones; fathom's stages make at most \
         {MAX_ITERATIONS} in one pass"
    )
}

/// The invocation's own count.
fn made(gpu: &Gpu, [outer, inner]: [u32; 2]) -> Result<u32, GpuError> {
    let shader = gpu.shader("audit/loops", &[])?;
    let result = gpu.catch(|| {
        use wgpu::BufferUsages as Usage;
        let pipeline = gpu.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: Some("audit"),
            layout: None,
            module: &shader.module,
            entry_point: Some("main"),
            compilation_options: compilation_options(),
            cache: None,
        });
        let uniform = gpu.buffer("audit", 16, Usage::UNIFORM | Usage::COPY_DST);
        gpu.queue.write_buffer(&uniform, 0, [outer, inner].map(u32::to_le_bytes).as_flattened());
        let result = gpu.buffer("audit", 8, Usage::STORAGE | Usage::COPY_SRC);
        let layout = pipeline.get_bind_group_layout(0);
        let bindings = gpu.bind("audit", &layout, &[&uniform, &result]);
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        let mut pass = encoder.begin_compute_pass(&Default::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bindings, &[]);
        pass.dispatch_workgroups(1, 1, 1);
        drop(pass);
        gpu.queue.submit([encoder.finish()]);
        Ok(result)
    })?;
    let words: Vec<u32> = bytemuck::pod_collect_to_vec(&read_buffer(gpu, &result)?);
    let [turns, state] = [words[0], words[1]];
    if state == state_after(turns) {
        return Ok(turns);
    }
    Err(GpuError::Unusable(format!(
        "the adapter counts {turns} turns of a loop and has not done the work of so many"
    )))
}

/// What so many turns leave: `next_state` in `shaders/audit/loops.wgsl`.
fn state_after(turns: u32) -> u32 {
    (0..turns)
        .fold(0, |state: u32, _| (state ^ (state >> 15)).wrapping_mul(0x2c1b_3c6d).wrapping_add(1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Options;

    #[test]
    fn the_turns_of_this_adapter_are_found() {
        let gpu = Gpu::open(&Options::default()).expect("an adapter is there");
        let found = measure_loop_turns(&gpu).expect("it makes enough turns");
        if gpu.adapter.driver_info.contains("Mesa 22.3") {
            // 65,535 of all loops: each turn of the outer one counts, and the one that ends the inner one.
            assert_eq!((found.single, found.nested), (65_535, 65_409));
        } else {
            assert!(u64::from(found.single) >= MAX_ITERATIONS, "{found:?}");
        }
    }
}
