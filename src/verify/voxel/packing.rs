//! `voxel/clear`, `voxel/combine` and `voxel/unpack` bit by bit, on random bits and on sizes that are no powers of two.

use super::subjects::{cells, plain, random_voxels, voxels_of};
use crate::prelude::*;
use fathom_gpu::kit::Buffer;
use fathom_stages::voxel::clear::{self, Cleared};
use fathom_stages::voxel::combine;
use fathom_stages::voxel::slicemap::SliceAxis;
use fathom_stages::voxel::unpack::{self, Packed};

/// Multiples of 32 and not, rows longer than a copy's alignment, and a single voxel.
const SIZES: [[u32; 3]; 5] = [[64, 32, 96], [37, 20, 45], [5, 70, 33], [300, 3, 2], [1, 1, 1]];

pub fn cases() -> Vec<Case> {
    vec![
        Case::new("voxel/clear", "buffers full of bits", clear),
        Case::new("voxel/combine", "OR of random slicemaps", combine),
        Case::new("voxel/unpack", "bits and alphas as texels", unpack),
    ]
}

fn clear(rig: &Rig<'_>) -> Result<Check> {
    let full = vec![u32::MAX; 1000];
    let [all, head, kept] = [0, 1, 2].map(|_| rig.words(&full));
    let part = Cleared { buffer: head.clone(), bytes: 4 };
    rig.run(&[&clear::new(vec![Cleared::from(&all), part])])?;
    let cleared = vec![0u32; 1000];
    let expected = [&[0], &full[1..]].concat();
    let wrong = differing(&rig.read(&all)?, &cleared) + differing(&rig.read(&head)?, &expected);
    let control = differing(&rig.read(&kept)?, &cleared);
    Ok(Check::new(rig, "words that are not as they should be")
        .within((0.0, "1"), wrong)
        .control("a buffer that is not cleared", control))
}

/// Voxels as a slicemap's words.
fn slicemap(voxels: &[bool], grid: &Grid, axis: SliceAxis) -> Vec<u32> {
    let [columns, rows, _] = axis.turn(grid.cells);
    let mut words = vec![0u32; (axis.slicemap_bytes(grid) / 4) as usize];
    for (cell, _) in cells(grid).zip(voxels).filter(|(_, full)| **full) {
        let [column, row, slice] = axis.turn(cell);
        words[(column + columns * (row + rows * (slice / 32))) as usize] |= 1 << (slice % 32);
    }
    words
}

fn combine(rig: &Rig<'_>) -> Result<Check> {
    let mut random = Random::new(11);
    let (mut wrong, mut control) = (0.0, 0.0);
    let mut volumes = Vec::new();
    let mut expected = Vec::new();
    for size in SIZES {
        let grid = plain(size);
        let maps = SliceAxis::ALL.map(|_| random_voxels(&mut random, &grid, 0.2));
        let buffers = [0, 1, 2].map(|k| rig.words(&slicemap(&maps[k], &grid, SliceAxis::ALL[k])));
        let voxels = Voxels::new(rig, "verify voxels", &grid, false);
        volumes.push((voxels, buffers));
        expected.push(maps);
    }
    rig.run(&[&combine::new(rig, &volumes)?])?;
    for ((voxels, _), [x, y, z]) in volumes.iter().zip(&expected) {
        let found = voxels_of(&rig.read(&voxels.bits)?, &voxels.grid);
        let or = |maps: [&[bool]; 3]| -> Vec<bool> {
            (0..found.len()).map(|i| maps.iter().any(|map| map[i])).collect()
        };
        wrong += differing(&found, &or([x, y, z]));
        control += differing(&found, &or([x, y, y]));
    }
    Ok(Check::new(rig, "voxels that differ from the OR")
        .within((0.0, "1"), wrong)
        .control("z's slicemap left out", control))
}

fn unpack(rig: &Rig<'_>) -> Checks {
    let mut random = Random::new(5);
    let volumes: Vec<Voxels> =
        SIZES.iter().map(|size| Voxels::new(rig, "verify voxels", &plain(*size), false)).collect();
    let mut checks = Vec::new();
    for alpha in [false, true] {
        let mut expected: Vec<Vec<u8>> = Vec::new();
        let mut alphas = Vec::new();
        for voxels in &volumes {
            let full = random_voxels(&mut random, &voxels.grid, 0.3);
            let value = |full: &bool| match (full, alpha) {
                (false, _) => 0,
                (true, false) => 255,
                (true, true) => 1 + (random.number() * 254.0) as u8,
            };
            let values: Vec<u8> = full.iter().map(value).collect();
            voxels.write(rig, &vec![0; values.len()]);
            alphas.push(load(rig, voxels, &values, alpha));
            expected.push(values);
        }
        let packed = if alpha { Packed::Alphas(alphas) } else { Packed::Bits };
        rig.run(&[&unpack::new(rig, &volumes, &packed)?])?;
        let (mut wrong, mut control) = (0.0, 0.0);
        for (voxels, values) in volumes.iter().zip(&mut expected) {
            let texels = read_volume(rig.gpu, &voxels.texture, 0)?.data;
            let found: Vec<u8> = texels.iter().map(|v| (v * 255.0).round() as u8).collect();
            wrong += differing(&found, values);
            values.rotate_left(1);
            control += differing(&found, values);
        }
        let name = if alpha { "alphas" } else { "bits" };
        checks.push(
            Check::new(rig, format!("texels that differ from the {name}"))
                .within((0.0, "1"), wrong)
                .control("voxels moved by one", control),
        );
    }
    Ok(checks)
}

/// Puts values into a volume's bits, or into a buffer of a word each, which is returned.
fn load(rig: &Rig<'_>, voxels: &Voxels, values: &[u8], alpha: bool) -> Buffer {
    if alpha {
        return rig.words(&values.iter().map(|value| u32::from(*value)).collect::<Vec<_>>());
    }
    let mut words = vec![0u32; voxels.grid.words() as usize];
    for (index, _) in values.iter().enumerate().filter(|(_, value)| **value > 0) {
        words[index / 32] |= 1 << (index % 32);
    }
    rig.gpu.queue.write_buffer(&voxels.bits, 0, bytemuck::cast_slice(&words));
    voxels.bits.clone()
}
