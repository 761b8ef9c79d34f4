//! Meshes as people and programs write them are the same meshes as written plainly.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use fathom::scene::Mesh;
use itertools::Itertools as _;

use super::files::{GLTF, fan, glb, gzip, stl};
use super::meshes::read;

type Corner = [u32; 6];

/// Positions and normals of the corners of all triangles, in an order that does not depend on the file's.
fn triangles(mesh: &Mesh) -> Vec<[Corner; 3]> {
    let corner = |index: &u32| -> Corner {
        let vertex = *index as usize;
        let values = [mesh.positions[vertex], mesh.normals[vertex]].concat();
        // Of −0 too.
        std::array::from_fn(|i| (values[i] + 0.0).to_bits())
    };
    let mut all: Vec<[Corner; 3]> =
        mesh.indices.chunks(3).map(|triangle| [0, 1, 2].map(|k| corner(&triangle[k]))).collect();
    for triangle in &mut all {
        let first = (0..3).min_by_key(|k| triangle[*k]).unwrap();
        triangle.rotate_left(first);
    }
    all.sort_unstable();
    all
}

/// The triangles of a file, which are the same when it is compressed.
fn load(name: &str, content: impl AsRef<[u8]>) -> Result<Vec<[Corner; 3]>, String> {
    let mesh = read(name, content.as_ref())?;
    assert_eq!(read(&format!("{name}.gz"), &gzip(content.as_ref())).as_ref(), Ok(&mesh));
    Ok(triangles(&mesh))
}

const VERTICES: &str = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
    property list uchar int vertex_index\nend_header\n0 0 0\n4 0 0\n4 4 0\n2 1 0\n0 4 0\n5 0 1 2 3 4\n";

/// [`PLY`] as a binary file, whose faces have flags.
fn binary_ply(format: &str, line_end: &str) -> Vec<u8> {
    let head = PLY.split_once("0 0 0").unwrap().0.replace("ascii", format);
    let head = head.replace("property list", "property uchar flags\nproperty list");
    let head = head.replace('\n', line_end).into_bytes();
    let in_order = |mut bytes: [u8; 4]| {
        if format == "binary_big_endian" {
            bytes.reverse();
        }
        bytes
    };
    let positions = fan()[..60].as_chunks::<4>().0.iter().copied().flat_map(in_order).collect();
    let corners = (0..5u32).map(u32::to_le_bytes).flat_map(in_order).collect();
    [head, positions, vec![10, 5], corners].concat()
}

/// STL files of this mesh.
fn stls(plain: &Mesh) -> Vec<(&'static str, Vec<u8>)> {
    let facets: Vec<_> = (0..plain.triangle_count())
        .map(|n| plain.triangle(n).map(|c| c.as_vec3().to_array()))
        .collect();
    let facet = |corners: &[[f32; 3]; 3]| {
        let vertex = |[x, y, z]: &[f32; 3]| format!("vertex {x} {y} {z}\n");
        let corners: String = corners.iter().map(vertex).collect();
        format!("facet normal 0 0 1\nouter loop\n{corners}endloop\nendfacet\n")
    };
    let text = format!("solid a\n{}endsolid a\n", facets.iter().map(facet).collect::<String>());
    let texts = [
        ("mark of byte order", format!("\u{feff}{text}")),
        ("CR LF", text.replace('\n', "\r\n")),
        ("CR", text.replace('\n', "\r")),
        ("no last line end", text.trim_end().to_owned()),
        ("blanks", text.replace(' ', " \t ").replace('\n', "\t\n\n  ")),
        ("capitals", text.to_ascii_uppercase()),
        ("solids without facets", format!("solid\nendsolid\n{text}solid b\nendsolid b\n")),
        ("normals of length 0", text.replace("0 0 1", "0 0 0")),
        ("normals that are no numbers", text.replace("normal 0 0 1", "normal -nan(ind) inf x")),
        ("names of several words", text.replace("solid a", "solid a b")),
        ("end solid", text.replace("endsolid", "end solid")),
        ("zeros with a sign", text.replace("vertex 0 0 0", "vertex -0 -0 -0")),
    ];
    let texts = texts.into_iter().map(|(what, text)| (what, text.into_bytes()));
    let binaries = [
        ("binary", stl(b"", &facets, 0)),
        ("binary that begins as text does", stl(b"solid made by hand", &facets, 0)),
        ("binary with colours, and more behind it", [stl(b"", &facets, 0x7fff), vec![1]].concat()),
    ];
    texts.chain(binaries).collect()
}

/// Ways to write [`GLTF`]: what is replaced, separated by bars, and the buffer.
fn gltfs() -> Vec<(&'static str, &'static str, Vec<u8>)> {
    const MESH: &str = r#"{"mesh":0}"#;
    assert!(GLTF.contains(MESH));
    let (fan, positions) = (fan(), fan()[..60].to_vec());
    let indices = |size: usize, corners: &[u8]| {
        let corners = corners.iter().flat_map(|corner| [*corner, 0, 0, 0].into_iter().take(size));
        positions.iter().copied().chain(corners).chain([0; 500]).take(560).collect::<Vec<u8>>()
    };
    let moved = |by: [f32; 3], times: [f32; 3]| {
        let numbers = positions.chunks(4).map(|c| f32::from_le_bytes(c.try_into().unwrap()));
        let numbers = numbers.enumerate().map(|(i, c)| (c - by[i % 3]) * times[i % 3]);
        [numbers.flat_map(f32::to_le_bytes).collect(), fan[60..].to_vec()].concat()
    };
    let strided: Vec<u8> =
        positions.chunks(12).flat_map(|place| [place, &[9; 4]].concat()).collect();
    let strided = [strided, fan[60..540].to_vec()].concat();
    let normals = |normal: [f32; 3]| {
        let normals = [normal; 5].into_iter().flatten().flat_map(f32::to_le_bytes);
        fan[..500].iter().copied().chain(normals).collect::<Vec<u8>>()
    };
    const NORMALS: &str = r#"N":0}|N":0,"NORMAL":2}|AR"}|AR"},{"bufferView":1,"byteOffset":440,"componentType":5126,"count":5,"type":"VEC3"}"#;
    vec![
        ("plain", "", fan.clone()),
        ("CR LF", "\n|\r\n", fan.clone()),
        (
            "triangles",
            r#"mode":6|mode":4|5123,"count":5|5123,"count":9"#,
            indices(2, &[3, 4, 0, 3, 0, 1, 3, 1, 2]),
        ),
        ("strip", r#"mode":6|mode":5"#, indices(2, &[4, 0, 3, 1, 2])),
        ("indices of four bytes", "5123|5125", indices(4, &[3, 4, 0, 1, 2])),
        ("indices of one byte", "5123|5121", indices(1, &[3, 4, 0, 1, 2])),
        (
            "interleaved",
            r#""byteLength":60|"byteLength":80,"byteStride":16|Offset":60|Offset":80|500|480"#,
            strided,
        ),
        (
            "sparse positions",
            r#"4,0]}|4,0],"sparse":{"count":1,"indices":{"bufferView":1,"byteOffset":24,"componentType":5121},"values":{"bufferView":1,"byteOffset":28}}}"#,
            [&fan[..12], &[9; 12], &fan[24..84], &[1, 0, 0, 0], &fan[12..24], &fan[100..]].concat(),
        ),
        (
            "sparse positions alone",
            r#"[{"bufferView":0,"c|[{"c|4,0]}|4,0],"sparse":{"count":4,"indices":{"bufferView":1,"byteOffset":24,"componentType":5121},"values":{"bufferView":0,"byteOffset":12}}}"#,
            [&fan[..84], &[1, 2, 3, 4], &fan[88..]].concat(),
        ),
        ("nodes without meshes", r#"{"mesh":0}|{"children":[1,2]},{},{"mesh":0}"#, fan.clone()),
        ("no default scene", r#""scene":0,|"#, fan.clone()),
        ("colours of vertices", r#"N":0}|N":0,"COLOR_0":0}"#, fan.clone()),
        (
            "far from the origin",
            r#"{"mesh":0}|{"mesh":0,"translation":[65536,-32768,4096]}"#,
            moved([65_536.0, -32_768.0, 4096.0], [1.0; 3]),
        ),
        (
            "mirrored and scaled",
            r#"{"mesh":0}|{"mesh":0,"scale":[-4,2,1]}"#,
            // Whose front faces are those that run the other way.
            [&moved([0.0; 3], [-0.25, 0.5, 1.0])[..60], &indices(2, &[3, 2, 1, 0, 4])[60..]]
                .concat(),
        ),
        (
            "turned",
            r#"{"mesh":0}|{"mesh":0,"rotation":[0,0,1,0]}"#,
            moved([0.0; 3], [-1.0, -1.0, 1.0]),
        ),
        (
            "matrix below a translation",
            r#"{"mesh":0}|{"children":[1],"translation":[8,0,0]},{"mesh":0,"matrix":[2,0,0,0,0,2,0,0,0,0,2,0,0,0,0,1]}"#,
            moved([8.0, 0.0, 0.0], [0.5; 3]),
        ),
        ("normals of length 0", NORMALS, normals([0.0; 3])),
        ("normals that are no numbers", NORMALS, normals([f32::NAN, 0.0, 1.0])),
        ("long normals", NORMALS, normals([0.0, 0.0, 7.0])),
        (
            "extras that are no objects",
            r#"{"asset"|{"extras":"a","asset"|{"mesh":0}|{"extras":7.5,"mesh":0}|N":0}|N":0},"extras":[1,{},null]|"type":"VEC3"|"type":"VEC3","extras":null"#,
            fan.clone(),
        ),
        (
            "an extension of looks",
            r#"{"asset"|{"extensionsRequired":["KHR_materials_unlit"],"asset""#,
            fan.clone(),
        ),
    ]
}

/// [`GLTF`] with each second part of `changes` in the place of the one before it.
pub fn changed(changes: &str) -> String {
    let parts: Vec<&str> = changes.split('|').collect();
    parts.chunks_exact(2).fold(GLTF.to_owned(), |json, pair| {
        assert!(json.contains(pair[0]), "{}", pair[0]);
        json.replace(pair[0], pair[1])
    })
}

#[test]
fn files_of_every_style_are_the_plain_mesh() {
    let plain_mesh = read("a.obj", format!("{VERTICES}f 1 2 3 4 5\n").as_bytes()).unwrap();
    let plain = triangles(&plain_mesh);
    assert_eq!(plain.len(), 3);
    let face = |lines: &str| format!("{VERTICES}{lines}");
    let plainly = face("f 1 2 3 4 5\n");
    let vertex = |line: &str| plainly.replace("v 4 4 0", line);
    let objs = [
        ("mark of byte order", format!("\u{feff}{plainly}")),
        ("mark of byte order before a comment", format!("\u{feff}# made by hand\n{plainly}")),
        ("CR LF", plainly.replace('\n', "\r\n")),
        ("CR", format!("\u{feff}{}", plainly.replace('\n', "\r"))),
        ("no last line end", plainly.trim_end().to_owned()),
        ("blanks", plainly.replace(' ', " \t ").replace('\n', "\t\n\n  ")),
        ("continued before blanks", face("f 1 2 3\\\n 4 5")),
        ("continued without blanks", face("f 1 2\\\n3 4\\\n5")),
        ("continued twice with CR LF", face("f 1 2 \\\r\n\\\r\n  3 4 5\r\n")),
        ("continued with CR", face("f 1 2 \\\r 3 4 5\r")),
        ("continued vertex", vertex("v 4 \\\n  4 0")),
        ("continued to the end", face("f 1 2 3 4 5 \\")),
        ("comment that ends in a backslash", format!("# C:\\meshes\\\n{plainly}")),
        ("comments at ends", vertex("v 4 4 0 # corner \\").replace("4 5\n", "4 5#last\n")),
        ("comment in place of a corner", face("f 1 2 3 4 5 # 4 3\n")),
        ("negative indices", face("f -5 -4 -3 -2 -1\n")),
        ("texture coordinates", face("vt 0 0\nf 1/1 2/1 3/ 4// 5/-1/\n")),
        ("other first corner", face("f 4 5 1 2 3\n")),
        ("faces first", format!("f 1 2 3 4 5\n{VERTICES}")),
        (
            "groups without faces",
            format!("o\ng\ng a b\n{VERTICES}o c\ns 1\ng\nusemtl\nf 1 2 3 4 5\no\ng d\n"),
        ),
        ("colours", vertex("v 4 4 0 0.1 0.2 0.3").replace("v 0 4 0", "v 0 4 0 1 1 1 0.5")),
        ("weight", vertex("v 8 8 0 2")),
        ("other numbers", vertex("v +4e0 .4E1 -0.")),
        ("unknown keywords", plainly.replace('\n', "\nsurf 1 2\n#\n")),
        ("normals of length 0", face("vn 0 0 0\nf 1//1 2//1 3//1 4//1 5//1\n")),
        (
            "normals that are no numbers",
            face("vn nan 0 0\nvn 0 inf 0\nf 1//1 2//2 3//1 4//2 5//2\n"),
        ),
        ("short and long normals", face("vn 0 0 1e-30\nvn 0 0 1e30\nf 1//1 2//2 3//1 4//2 5//1\n")),
        ("normals of some corners", face("vn 0 0 2\nvn 0 0 0\nf 1//1 2 3//2 4 5//1\n")),
    ];
    let plys = [
        ("plain", PLY.to_owned()),
        ("mark of byte order", format!("\u{feff}{PLY}")),
        ("CR LF", PLY.replace('\n', "\r\n")),
        ("CR", format!("\u{feff}{}", PLY.replace('\n', "\r"))),
        ("no last line end", PLY.trim_end().to_owned()),
        ("blanks", PLY.replace(' ', " \t ").replace('\n', "\t\n\n  ")),
        ("other first corner", PLY.replace("5 0 1 2 3 4", "5 3 4 0 1 2")),
        (
            "colours",
            PLY.replace("float z\n", "float z\nproperty uchar red\n").replace(" 0\n", " 0 255\n"),
        ),
        ("other numbers", PLY.replace("4 4 0", "4. .4E1 -0.")),
        (
            "numbers that are none, of no use",
            PLY.replace("float z\n", "float z\nproperty float q\n")
                .replace(" 0\n", " 0 -nan(ind)\n"),
        ),
    ];
    let of_kind = |name: &'static str, rows: &[(&'static str, String)]| -> Vec<_> {
        rows.iter().map(|(what, text)| (name, *what, load(name, text))).collect()
    };
    let binaries = ["binary_little_endian", "binary_big_endian"].into_iter();
    let binaries = binaries.cartesian_product(["\n", "\r\n", "\r"]);
    let binaries =
        binaries.map(|(format, end)| ("a.ply", format, load("a.ply", binary_ply(format, end))));
    let stls =
        stls(&plain_mesh).into_iter().map(|(what, bytes)| ("a.stl", what, load("a.stl", bytes)));
    let of_gltf = |(what, changes, binary): (&'static str, &str, Vec<u8>)| {
        let json = changed(changes);
        let uri = format!("\"uri\":\"data:;base64,{}\",", BASE64.encode(&binary));
        let embedded = json.replace("\"buffers\":[{", &format!("\"buffers\":[{{{uri}"));
        [("a.glb", glb(&json, &binary)), ("a.gltf", format!("\u{feff}{embedded}").into_bytes())]
            .map(|(name, bytes)| (name, what, load(name, bytes)))
    };
    let others = binaries.chain(stls).chain(gltfs().into_iter().flat_map(of_gltf));
    let texts = [of_kind("a.obj", &objs), of_kind("a.ply", &plys)].concat();
    for (name, what, read) in texts.into_iter().chain(others) {
        assert_eq!(read.as_ref(), Ok(&plain), "{name}: {what}");
    }
}

/// Coordinates of corners that turn to the left, and the area.
const POLYGONS: [(&str, &str, f32); 7] = [
    ("square", "0 0 2 0 2 2 0 2", 4.0),
    ("notched square", "0 0 4 0 4 4 2 1 0 4", 10.0),
    ("arrow", "0 0 3 -2 1 0 3 2", 2.0),
    ("triangle with corners on its edges", "0 0 1 0 2 0 2 2 1 1", 2.0),
    ("triangle with a corner on an edge", "2 0 2 2 0 0 1 0", 2.0),
    ("square with a hole", "0 0 4 0 4 4 0 4 0 0 1 1 1 3 3 3 3 1 1 1", 12.0),
    ("spiral", "0 0 5 0 5 5 1 5 1 2 3 2 3 3 2 3 2 4 4 4 4 1 0 1", 15.0),
];

/// A file of one face.
fn polygon(positions: &[[f32; 3]], face: &[usize], name: &str) -> String {
    let count = face.len();
    let vertices = positions.iter().map(|[x, y, z]| format!("{x} {y} {z}\n"));
    if name == "a.obj" {
        let vertices: String = vertices.map(|vertex| format!("v {vertex}")).collect();
        let corners: String = face.iter().map(|corner| format!(" {}", corner + 1)).collect();
        return format!("{vertices}f{corners}\n");
    }
    let (header, _) = PLY.split_once("0 0 0").unwrap();
    let header = header.replace("vertex 5", &format!("vertex {count}"));
    let corners: String = face.iter().map(|corner| format!(" {corner}")).collect();
    format!("{header}{}{count}{corners}\n", vertices.collect::<String>())
}

/// Whichever corner comes first, whatever the size, and far from the origin.
#[test]
fn polygons_are_filled_once() {
    let far = [65_536.0, -32_768.0, 4096.0];
    let planes = [
        ("small", [[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]], 1e-4),
        ("level", [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], 1.0),
        ("large", [[0.0; 3], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]], 1e4),
        ("slanted and far", [far, [0.5, 0.0, 0.25], [0.0, 0.5, 0.0]], 0.5 * 0.3125f32.sqrt()),
    ];
    let comb: String = (0..100).rev().map(|x| format!(" {x} {}", 1 + x % 2 * 4)).collect();
    let comb = format!("0 0 99 0{comb}");
    for (shape, corners, area) in POLYGONS.into_iter().chain([("comb", &*comb, 297.0)]) {
        let numbers: Vec<f32> = corners.split(' ').map(|number| number.parse().unwrap()).collect();
        let mut cut = Vec::new();
        for (plane, [origin, u, v], times) in planes {
            let at = |ab: &[f32]| [0, 1, 2].map(|i| origin[i] + ab[0] * u[i] + ab[1] * v[i]);
            let positions: Vec<[f32; 3]> = numbers.chunks(2).map(at).collect();
            for name in ["a.obj", "a.ply"] {
                let begun = |first: usize| {
                    let mut face: Vec<usize> = (0..positions.len()).collect();
                    face.rotate_left(first);
                    read(name, polygon(&positions, &face, name).as_bytes()).unwrap()
                };
                let (mesh, row) = (begun(0), format!("{shape}, {plane}, {name}"));
                for first in 1..positions.len() {
                    assert_eq!(triangles(&begun(first)), triangles(&mesh), "{row}");
                }
                let doubled = |triangle: usize| {
                    let [a, b, c] = mesh.triangle(triangle);
                    (b - a).cross(c - a)
                };
                let doubled: Vec<_> = (0..mesh.triangle_count()).map(doubled).collect();
                let filled: f64 = doubled.iter().map(|area| area.length() / 2.0).sum();
                assert!((filled / f64::from(area * times) - 1.0).abs() < 1e-5, "{row}: {filled}");
                assert!(doubled.iter().all(|area| area.dot(doubled[0]) > 0.0), "{row}");
                cut.push(mesh.indices);
            }
        }
        assert!(cut.iter().all(|indices| *indices == cut[0]), "{shape}: {cut:?}");
    }
}
