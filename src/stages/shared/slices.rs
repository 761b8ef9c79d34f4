//! Long loops in several passes: an invocation makes at most [`MAX_ITERATIONS`] turns.

use fathom_gpu::{MAX_ITERATIONS, shader_struct};

shader_struct! {
    /// The turns of one pass.
    pub struct Slice {
        pub first: u32,
        /// Behind the last.
        pub end: u32,
    }
}

/// The slices of a loop of `count` turns, each of which takes so many turns with the loops within it.
pub fn slices(count: u32, of_each: u64) -> Vec<Slice> {
    let max = ((MAX_ITERATIONS - 1) / of_each.max(1)).max(1);
    let max = u32::try_from(max).unwrap_or(u32::MAX);
    let slice = |first: u32| Slice { first, end: count.min(first.saturating_add(max)) };
    (0..count.max(1)).step_by(max as usize).map(slice).collect()
}

/// Turns of an invocation in the longest of the slices.
pub fn loop_bound(slices: &[Slice], of_each: u64) -> u64 {
    let longest = slices.iter().map(|slice| u64::from(slice.end - slice.first)).max();
    longest.unwrap_or(0).saturating_mul(of_each).saturating_add(1)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use wgpu::naga::{Block, Statement};

    use super::*;
    use fathom_base::embedded::{Folders, SHADERS};
    use fathom_gpu::{default_defs, link, shader_paths};

    /// What keeps the turns of an invocation below [`MAX_ITERATIONS`], and the shaders with loops of which that is so.
    const HELD: &[(&str, &str)] = &[
        (
            "bound declared by the stage",
            "caustics/splat caustics/trace godrays/trace gtao/gather hsao/march",
        ),
        ("bound declared by the stage", "rays/march refraction/surface refraction/trace"),
        ("bound declared by the stage", "scalar/isosurface"),
        ("slices of rays or of steps", "ao/march ao/query scalar/direct scalar/positional"),
        ("layers of the dispatch", "voxel/alpha voxel/overlap"),
        (
            "1,024 taps, 17² texels",
            "ao/bilateral caustics/filter godrays/filter gtao/filter hsao/filter",
        ),
        ("1,024 waves, four pixels, 256 taps", "compose"),
        ("eight heights of 1,024 waves", "shadow/mask transfer/map"),
        ("64 layers", "rays/rasterize sprites/draw transfer/bounce"),
        ("two ways of at most 16,384 pixels", "refraction/compose"),
        ("three standard deviations of 64 texels, to either side", "shafts/blur"),
        ("32 bits, eight and four words", "voxel/combine voxel/slice voxel/unpack"),
        ("cells of a level", "voxel/mips"),
        ("pixels of a small triangle's box", "voxel/slicemap"),
        ("the cells of three edges, 12,288", "voxel/view"),
        ("`Kernel::max_iterations`", "ceilings/compute ceilings/raster"),
        ("more turns than some adapters make, on purpose", "audit/loops"),
        ("loops that are linked and not called", "godrays/lines planar/points rays/reduce"),
        ("loops that are linked and not called", "shadow/compose shafts/lines transfer/shadow"),
        ("loops that are linked and not called", "transfer/sight"),
    ];

    fn loops(block: &Block) -> bool {
        block.iter().any(|statement| match statement {
            Statement::Loop { .. } => true,
            Statement::Block(inner) => loops(inner),
            Statement::If { accept, reject, .. } => loops(accept) || loops(reject),
            Statement::Switch { cases, .. } => cases.iter().any(|case| loops(&case.body)),
            _ => false,
        })
    }

    /// With any value of the definitions that choose between steps of a stage or between waters.
    fn has_loops(folders: &Folders, path: &str) -> bool {
        let defs = default_defs(folders, path).expect("its defaults are read");
        let chosen = |name: &str| defs.iter().any(|(own, _)| own == name);
        let steps = if chosen("STEP") { 0..3 } else { 0..1 };
        let choices = steps.flat_map(|step| (0..3).map(move |water| (step, water)));
        let has = |(step, water): (i32, i32)| {
            let mut given = Vec::new();
            given.extend(chosen("STEP").then_some(("STEP", step)));
            given.extend(chosen("WATER").then_some(("WATER", water)));
            let module = link(folders, path, &given).expect("it links");
            let functions = module.functions.iter().map(|(_, function)| function);
            let entries = module.entry_points.iter().map(|entry| &entry.function);
            functions.chain(entries).any(|function| loops(&function.body))
        };
        choices.into_iter().any(has)
    }

    #[test]
    fn every_shader_with_loops_says_what_bounds_them() {
        let folders = Folders::new(SHADERS);
        let paths = shader_paths(&folders);
        let with: BTreeSet<&str> =
            paths.iter().map(String::as_str).filter(|path| has_loops(&folders, path)).collect();
        let held: BTreeSet<&str> = HELD.iter().flat_map(|(_, paths)| paths.split(' ')).collect();
        assert_eq!(with, held);
    }

    #[test]
    fn slices_cover_the_loop_and_none_is_too_long() {
        for (count, of_each) in [(1, 1), (50, 700), (16_384, 163), (1 << 20, 1), (4, 64_000)] {
            let slices = slices(count, of_each);
            let mut ends = slices.iter().map(|slice| slice.end);
            let firsts: Vec<u32> = slices.iter().map(|slice| slice.first).collect();
            assert_eq!(firsts[0], 0);
            assert!(ends.clone().zip(&firsts[1..]).all(|(end, first)| end == *first));
            assert_eq!(ends.next_back(), Some(count));
            assert!(loop_bound(&slices, of_each) <= MAX_ITERATIONS);
        }
    }

    #[test]
    fn a_turn_that_is_too_long_alone_is_told() {
        let slices = slices(3, 100_000);
        assert_eq!(slices.len(), 3);
        assert!(loop_bound(&slices, 100_000) > MAX_ITERATIONS);
    }
}
