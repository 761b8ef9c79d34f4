//! Compressed files, and files of glTF and STL.

use std::io::Write;

use flate2::{Compression, write::GzEncoder};

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// A `.glb` file of this JSON and these bytes.
pub fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let chunk = |kind: &[u8], content: &[u8]| {
        let length = content.len().next_multiple_of(4);
        let padding = vec![b' '; length - content.len()];
        [&(length as u32).to_le_bytes(), kind, content, &padding].concat()
    };
    let chunks = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", binary)].concat();
    [b"glTF\x02\0\0\0", &(12 + chunks.len() as u32).to_le_bytes()[..], &chunks].concat()
}

/// A concave polygon of five corners as a fan in glTF, whose buffer is [`fan`].
pub const GLTF: &str = r#"{"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
"nodes":[{"mesh":0}],"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,0.125,1]}}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":6,"material":0}]}],
"accessors":[{"bufferView":0,"componentType":5126,"count":5,"type":"VEC3","min":[0,0,0],"max":[4,4,0]},
{"bufferView":1,"componentType":5123,"count":5,"type":"SCALAR"}],"bufferViews":[{"buffer":0,"byteLength":60},
{"buffer":0,"byteOffset":60,"byteLength":500}],"buffers":[{"byteLength":560}]}"#;

/// Positions, and indices of two bytes; the rest is empty.
pub fn fan() -> Vec<u8> {
    let positions = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0f32]];
    let positions = positions.iter().flat_map(|[x, y]| [*x, *y, 0.0]).flat_map(f32::to_le_bytes);
    let corners = [3u16, 4, 0, 1, 2].into_iter().flat_map(u16::to_le_bytes);
    positions.chain(corners).chain([0; 490]).collect()
}

/// A binary file of this header and these triangles.
pub fn stl(header: &[u8], triangles: &[[[f32; 3]; 3]], attribute: u16) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, 0);
    bytes.extend((triangles.len() as u32).to_le_bytes());
    for corners in triangles {
        let corners = corners.as_flattened().iter().flat_map(|c| c.to_le_bytes());
        bytes.extend([0; 12].into_iter().chain(corners).chain(attribute.to_le_bytes()));
    }
    bytes
}
