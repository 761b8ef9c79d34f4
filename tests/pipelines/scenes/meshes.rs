//! Mesh files: what is read, and that bad ones give one clear line. `tests/readers` looks for panics.

use std::path::Path;

use fathom::scene::{Mesh, Scene};

use super::files::{GLTF, fan, glb, gzip, stl};
use super::mesh_styles::changed;

const PLY: &str = "ply\nformat ascii 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty float confidence\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0 1\n1 0 0 1\n1 1 0 1\n0 1 0 1\n4 0 1 2 3\n";

pub fn read(name: &str, bytes: &[u8]) -> Result<Mesh, String> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    Mesh::read(&path)
}

/// The error's one line, which names the file.
fn fault(name: &str, bytes: &[u8]) -> String {
    let error = read(name, bytes).expect_err("a fault");
    assert!(error.contains(name) && error.lines().count() == 1, "{error}");
    error
}

#[test]
fn missing_and_empty_files_are_told() {
    for name in ["a.obj", "a.ply", "a.ply.gz"] {
        let error = Mesh::read(&Path::new("/no/such").join(name)).unwrap_err();
        assert!(error.contains(name), "{error}");
        fault(name, b"");
    }
    assert!(fault("a.obj", b"# nothing\n").contains("no triangles"));
    assert!(fault("a.off", b"OFF").contains(".obj, .ply, .stl, .gltf or .glb"));
}

#[test]
fn faults_of_compressed_files_are_told() {
    let packed = gzip(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    fault("a.obj.gz", &packed[..packed.len() - 9]);
    assert!(fault("a.obj.gz", &gzip(b"v 1 x 2\n")).contains("line 1"));
}

/// Triangles without area are natural in scans: neither a point nor a line nor a repeated corner is a fault.
#[test]
fn triangles_without_area_are_read() {
    let obj = "v 0 0 0\nv 1 0 0\nv 2 0 0\nv 0 0 0\nf 1 2 3\nf 1 4 1\nf 2 2 2\n";
    let mesh = read("a.obj", obj.as_bytes()).unwrap();
    assert_eq!(mesh.triangle_count(), 3);
    let ply = PLY.replace("1 0 0 1", "0 0 0 1").replace("4 0 1 2 3", "4 0 1 1 0");
    let flat = read("a.ply", ply.as_bytes()).unwrap();
    assert_eq!(flat.triangle_count(), 2);
    for mesh in [mesh, flat] {
        assert!(mesh.normals.iter().all(|n| n.iter().all(|c| c.is_finite())));
    }
}

#[test]
fn obj_faults_are_told() {
    let with = |line: &str| format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 1\n{line}\nf 1 2 3\n");
    for (line, expected) in [
        ("v 1 x 2", "line 5"),
        ("v nan 0 0\nf 4 1 2", "finite"),
        ("v 1e30 0 0\nf 4 1 2", "finite"),
        ("f 1 2 9", "out of bounds"),
        ("f -4 2 3", "out of bounds"),
        ("f 0 2 3", "out of bounds"),
        ("f 1//-9 2//1 3//1", "out of bounds"),
        ("f 1//0 2//1 3//1", "out of bounds"),
        ("f 1//2000000 2//1 3//1", "out of bounds"),
        // `tobj` multiplies such an index by three before it compares it.
        ("f 6148914691236517206 2 3", "out of bounds"),
        ("f 1//6148914691236517206 2//1 3//1", "out of bounds"),
        ("f 1//9223372036854775807 2//1 3//1", "out of bounds"),
    ] {
        let message = fault("a.obj", with(line).as_bytes());
        assert!(message.contains(expected), "{line}: {message}");
    }
    assert!(fault("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1").contains("line 3"));
    assert!(fault("a.obj", b"v 0 0 0\n\xff\xfe\xfd\n").contains("line 2"));
    // Texture coordinates are not read.
    let obj = with("vt 0 0\nf 1/6148914691236517206 2/1 3/1");
    assert_eq!(read("a.obj", obj.as_bytes()).unwrap().triangle_count(), 2);
}

#[test]
fn ply_faults_are_told() {
    let with = |from: &str, to: &str| fault("a.ply", PLY.replace(from, to).as_bytes());
    assert!(with("ply\n", "plaything\n").contains("starts with the line `ply`"));
    assert!(with("ascii", "binary_little_endian").contains("vertex 2 of 4: the file ends within"));
    assert!(with("ascii", "base64").contains("Line 2: Couldn't parse line. `format base64 1.0`"));
    assert!(with("element vertex 4", "element vertex 4000000000").contains("at most"));
    assert!(with("element vertex 4", "element vertex -4").contains("element vertex -4"));
    assert!(with("float z", "float y\nproperty float z").contains("declares an element or a prop"));
    assert!(with("element face", "element vertex").contains("declares an element or a property"));
    assert!(with("float z", "float w").contains("x, y, z"));
    assert!(with("end_header", "the_end").contains("the file ends within its header"));
    assert!(with("1 1 0 1", "1 nan 0 1").contains("vertex 2 is [1.0, NaN, 0.0]"));
    assert!(with("1 1 0 1", "1 -nan(ind) 0 1").contains("`-nan(ind)` is not a valid number"));
    assert!(with("1 1 0 1", "1 1").contains("line 14: the line has too few numbers"));
    assert!(with("4 0 1 2 3", "4 0 1 2 7").contains("uses vertex 7"));
    assert!(with("4 0 1 2 3", "4 0 1 2").contains("too few"));
    assert!(with("4 0 1 2 3", "2 0 1").contains("face of 2 corners"));
    assert!(with("4 0 1 2 3", "4 0 1 2 -3").contains("no list of indices"));
    assert!(with("4 0 1 2 3", "18446744073709551615 0 1 2 3").contains("too few"));
    assert!(with("4 0 1 2 3\n", "").contains("face 0 of 1: line 15: the file ends before it"));
    let long = "x".repeat(70_000);
    assert!(with("made", &long).contains("longer than"));
    let binary = |count: u32, corners: &[u32]| {
        let head = PLY.split_once("0 0 0 1").unwrap().0.replace("ascii", "binary_little_endian");
        let head = head.replace("list uchar", "list uint");
        let numbers =
            std::iter::once(&count).chain(corners).flat_map(|number| number.to_le_bytes());
        fault("a.ply", &[head.into_bytes(), vec![0; 64], numbers.collect()].concat())
    };
    assert!(binary(3, &[0, 1, 4]).contains("uses vertex 4, but there are 4"));
    assert!(binary(3, &[0, 1, u32::MAX]).contains("no list of indices"));
    assert!(binary(u32::MAX, &[0, 1, 2]).contains("face 0 of 1: the file ends within it"));
    assert!(binary(u32::MAX, &[0; 1 << 15]).contains("face 0 of 1: longer than 65536 bytes"));
}

#[test]
fn stl_faults_are_told() {
    let text = |text: &str| format!("solid\nfacet\n{text}").into_bytes();
    let binary = stl(b"", &[[[0.0; 3], [1.0; 3], [0.0, 1.0, 0.0]]], 0);
    for (bytes, expected) in [
        (text("vertex 0 0"), "line 3: a vertex has three coordinates"),
        (text("vertex 0 0 x"), "line 3: a vertex has three coordinates"),
        (text("vertex 0 0 0\nendloop\n"), "line 4: a facet has three corners"),
        (text("vertex 0 0 0\n"), "the file ends within a facet"),
        (text("tetrahedron"), "begins no line of an STL file"),
        (binary[..100].to_vec(), "reading triangle 0 of 1"),
        (b"short".to_vec(), "reading the header"),
        ([&binary[..80], &[0xff; 4], &binary[84..]].concat(), "reading triangle 1 of 4294967295"),
    ] {
        let message = fault("a.stl", &bytes);
        assert!(message.contains(expected), "{expected}: {message}");
    }
}

/// Two sparse indices, both of which are 0.
const SPARSE: &str = r#"4,0]}|4,0],"sparse":{"count":2,"indices":{"bufferView":1,"byteOffset":99,"componentType":5121},"values":{"bufferView":1}}}"#;

#[test]
fn gltf_faults_are_told() {
    for (changes, expected) in [
        (r#"5,"type":"VEC3"|48,"type":"VEC3""#, "an accessor reaches beyond its buffer"),
        (r#"5,"type":"VEC3"|9999999,"type":"VEC3""#, "at most 3600000 are read"),
        (r#"5,"type":"VEC3"|0,"type":"VEC3""#, "accessor 0 has no elements"),
        (r#"Offset":60|Offset":18446744073709551615"#, "accessor 1 reaches beyond its buffer"),
        (r#"Length":60|Length":60,"byteStride":8"#, "its elements beyond each other"),
        ("5126|5123", "accessor 0 is of another type"),
        ("5123|5126", "accessor 1 is of another type"),
        ("SCALAR|VEC2", "accessor 1 is of another type"),
        (r#"indices":1|indices":7"#, "Index out of bounds"),
        (r#"POSITION":0|POSITION":7"#, "accessor 7 is out of bounds"),
        (r#"mode":6|mode":4"#, "5 indices are not a whole number of triangles"),
        (r#"mode":6|mode":0"#, "it has no triangles"),
        (r#"{"mesh":0}|{"mesh":0,"children":[0]}"#, "node 0 stands below two nodes"),
        (r#""scene":0,"scenes":[{"nodes":[0]}],|"#, "it has no scene"),
        (r#"560}|561}"#, "buffer 0 has 560 bytes and claims 561"),
        (r#"560}|560,"uri":"a.bin"}"#, "buffer 0 is `a.bin`: "),
        (r#""2.0"|"1.0"|"nodes":[{"mesh":0}]|"nodes":{"a":{}}"#, "it is glTF 1.0: only version 2"),
        (r#""version":"2.0"|"v":1|"meshes":[|"meshes":{"a":{}},"m":["#, "it is glTF 1.0: only"),
        (r#"560}|560,"uri":"data:;base64,?"}"#, "buffer 0 is no base64"),
        (
            r#"{"asset"|{"extensionsRequired":["KHR_draco_mesh_compression"],"asset""#,
            "export it without",
        ),
        (r#"{"asset"|{"extensionsRequired":["KHR_mesh_quantization"],"asset""#, "KHR_mesh_qu"),
        (SPARSE, "has sparse indices that do not rise"),
        (r#"{"asset"|{,"asset""#, "line 1"),
    ] {
        let message = fault("a.glb", &glb(&changed(changes), &fan()));
        assert!(message.contains(expected), "{changes}: {message}");
    }
    let mut beyond = fan();
    beyond[60] = 9;
    assert!(fault("a.glb", &glb(GLTF, &beyond)).contains("uses vertex 9, but there are 5"));
    assert!(fault("a.glb", &glb(GLTF, &[])[..200]).contains("it ends within a chunk"));
    assert!(fault("a.glb", b"glTF\x01\0\0\0").contains("it is glTF 1: only version 2.0"));
}

/// A changed buffer is a changed scene.
#[test]
fn buffers_beside_a_gltf_file_are_read_and_those_elsewhere_are_not() {
    let place = tempfile::tempdir().unwrap();
    let path = |name: &str| place.path().join(name);
    std::fs::create_dir_all(path("own/below")).unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(path(name), bytes).unwrap();
    for name in ["a.bin", "own/a.bin", "own/below/ü b.bin"] {
        write(name, &fan());
    }
    write("own/short.bin", &fan()[..559]);
    #[cfg(unix)]
    for (link, to) in [("own/a.gltf.bin", "a.bin"), ("own/out.bin", "../a.bin")] {
        std::os::unix::fs::symlink(to, path(link)).unwrap();
    }
    let load = |uri: &str| {
        let json = changed(&format!(r#"560}}|560,"uri":"{uri}"}}"#));
        write("own/a.gltf", json.as_bytes());
        Mesh::read(&path("own/a.gltf"))
    };
    let plain = read("a.glb", &glb(GLTF, &fan()));
    let inside = ["a.bin", "./a.bin", "below/ü b.bin", "below/%C3%BC%20b.bin", "a.gltf.bin"];
    for uri in &inside[..if cfg!(unix) { 5 } else { 4 }] {
        assert_eq!(load(uri), plain, "{uri}");
    }
    let whole = path("own/a.bin").display().to_string().replace('\\', "/");
    for uri in ["../a.bin", "%2e%2E/a.bin", "below/../../a.bin", "http://a.b/a.bin", &whole] {
        let error = load(uri).unwrap_err();
        assert!(error.contains("only files in the folder of the glTF file are read"), "{error}");
    }
    for (uri, reason) in [("short.bin", "has 559 bytes"), ("", "is ``: "), ("below", "a folder")] {
        let error = load(uri).unwrap_err();
        assert!(error.contains(reason) && error.lines().count() == 1, "{error}");
    }
    #[cfg(unix)]
    assert!(load("out.bin").unwrap_err().contains("only files in the folder"));
    load("a.bin").unwrap();
    let digests = || Scene::load(path("own/a.gltf").to_str().unwrap()).unwrap().digests;
    let before = digests();
    write("own/a.bin", &[&fan()[..559], &[1]].concat());
    let changed: Vec<_> = digests().into_iter().filter(|(k, v)| before[k] != *v).collect();
    assert_eq!(changed.len(), 1, "{changed:?}");
    assert_eq!(changed[0].0, "a.bin");
}

/// An object for each base colour, unless the scene file has a colour of its own.
#[test]
fn base_colours_are_those_of_objects() {
    let place = tempfile::tempdir().unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(place.path().join(name), bytes).unwrap();
    let scene = |name: &str| Scene::load(&place.path().join(name).display().to_string()).unwrap();
    let two = r#"[0]|[0,1]|{"mesh":0}|{"mesh":0},{"mesh":1,"translation":[9,0,0]}|"material":0}]}|"material":0}]},{"primitives":[{"attributes":{"POSITION":0},"indices":1,"mode":6}]}|0.125,1|0.125,0.75"#;
    write("a.glb", &glb(&changed(two), &fan()));
    let bare = scene("a.glb");
    let colours: Vec<_> = bare.objects.iter().map(|o| (&*o.name, o.material.albedo)).collect();
    assert_eq!(colours.len(), 3, "{colours:?}");
    assert!(
        colours.contains(&("mesh", [0.5, 0.25, 0.125])) && colours.contains(&("mesh", [0.7; 3]))
    );
    let alphas = |scene: &Scene| scene.objects.iter().map(|o| o.material.alpha).sum::<f32>();
    let blended = format!(r#"{two}|[{{"pbr|[{{"alphaMode":"BLEND","pbr"#);
    write("blended.glb", &glb(&changed(&blended), &fan()));
    assert_eq!([alphas(&bare), alphas(&scene("blended.glb"))], [3.0, 2.75]);
    let bounds = bare.objects[1].mesh.bounds().union(bare.objects[2].mesh.bounds());
    assert!((bounds.size().max_element() - 2.0).abs() < 1e-6, "{bounds:?}");
    assert!((bounds.min.y + bare.floor_depth_m).abs() < 1e-6, "{bounds:?}");
    let own =
        "[[object]]\nname = \"a\"\nfile = \"a.glb\"\nmaterial = { albedo = [0.1, 0.2, 0.3] }\n";
    write("own.toml", format!("base = \"ball\"\nname = \"own\"\n{own}").as_bytes());
    let own = scene("own.toml");
    let own: Vec<_> = own.objects.iter().filter(|object| object.name == "a").collect();
    assert!(own.len() == 2 && own.iter().all(|o| o.material.albedo == [0.1, 0.2, 0.3]));
}

#[test]
fn faces_without_normals_get_their_own_beside_faces_that_have_some() {
    let obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1//1 2//1 3//1\nf 1 2 4\nf -4/7/-1 2//1 3//1\n";
    let mesh = read("a.obj", obj.as_bytes()).unwrap();
    assert_eq!(mesh.triangle_count(), 3);
    let normals = |corners: std::ops::Range<usize>| {
        let corner = |i: usize| mesh.normals[mesh.indices[i] as usize];
        corners.map(corner).collect::<Vec<_>>()
    };
    assert_eq!(normals(0..3), [[0.0, 0.0, 1.0]; 3]);
    assert_eq!(normals(3..6), [[0.0, -1.0, 0.0]; 3]);
    assert_eq!(normals(6..9), [[0.0, 0.0, 1.0]; 3]);
}

#[test]
fn names_and_remarks_may_be_in_any_encoding() {
    let obj =
        b"# Gr\xfc\xdfe\no S\xe4ule\nv 0 0 0 # \xfc\nv 1 0 0\nv 0 1 0\nf 1\nf 1 2\nf 1 2 3\r\n";
    assert_eq!(read("a.obj", obj).unwrap().triangle_count(), 1);
    let (start, rest) = PLY.split_once("made").unwrap();
    let ply = [start.as_bytes(), b"\xfc", rest.as_bytes()].concat();
    assert_eq!(read("a.ply", &ply).unwrap().triangle_count(), 2);
    let stl =
        b"solid S\xe4ule\nfacet\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nend solid S\xe4ule\n";
    assert_eq!(read("a.stl", stl).unwrap().triangle_count(), 1);
}
