//! Voxelization. VAO §4.
//!
//! Every stage fills several volumes in one encode: one for the scene, or one for each object.

pub mod alpha;
pub mod clear;
pub mod combine;
pub mod mips;
pub mod overlap;
mod rows;
pub mod slice;
pub mod slicemap;
pub mod triangles;
pub mod unpack;
pub mod view;

use std::ops::Range;

use glam::DVec3;

use crate::prelude::*;
use crate::voxels::Voxels;
use fathom_gpu::OutputData;

/// A volume, and the part of the scene's indices that is voxelized into it.
#[derive(Clone)]
pub struct VoxelPart {
    pub voxels: Voxels,
    pub indices: Range<u32>,
}

impl VoxelPart {
    fn triangles(&self) -> u64 {
        self.indices.len() as u64 / 3
    }
}

fn triangles(parts: &[VoxelPart]) -> u64 {
    parts.iter().map(VoxelPart::triangles).sum()
}

/// Words of bits as an output: 32 bits a word, as two integers that a float holds exactly.
fn words(name: &str, meaning: &str, buffer: &Buffer) -> StageDump {
    let columns = vec![
        Column::new("low", "1", "bits 0 to 15 as an integer"),
        Column::new("high", "1", "bits 16 to 31 as an integer"),
    ];
    StageDump::rows(name, meaning, columns, (buffer, 1, (buffer.size() / 4) as u32), |word| {
        let bits = word[0].to_bits();
        vec![(bits & 0xffff) as f32, (bits >> 16) as f32]
    })
}

/// The bit volumes as outputs.
fn bit_volumes<'a>(volumes: impl IntoIterator<Item = &'a Voxels>) -> Vec<StageDump> {
    let output = |(number, voxels): (usize, &Voxels)| {
        let meaning = "a bit for each voxel, x fastest, then y, then z";
        words(&format!("bits-{number}"), meaning, &voxels.bits)
    };
    volumes.into_iter().enumerate().map(output).collect()
}

/// A level of the volumes' textures as outputs.
fn textures<'a>(volumes: impl IntoIterator<Item = &'a Voxels>, level: u32) -> Vec<StageDump> {
    let output = |(number, voxels): (usize, &Voxels)| StageDump {
        name: format!("volume-{number}-level-{level}"),
        meaning: "the volume's texture, 0 empty to 1 full".into(),
        columns: vec![Column::new("occupancy", "1", "1 where a surface is, or its opacity")],
        data: OutputData::Volume {
            texture: voxels.texture.clone(),
            level,
            origin_m: voxels.grid.origin_m,
            spacing_m: DVec3::splat(voxels.grid.voxel_m * f64::from(1u32 << level)),
        },
    };
    volumes.into_iter().enumerate().map(output).collect()
}
