//! Meshes as people and programs write them are the same meshes as written plainly.

use fathom::scene::Mesh;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::files::gzip;
use super::meshes::read;
use crate::promises::draws;

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
fn of(name: &str, text: &str) -> Result<Vec<[Corner; 3]>, String> {
    let mesh = read(name, text.as_bytes())?;
    assert_eq!(read(&format!("{name}.gz"), &gzip(text.as_bytes())).as_ref(), Ok(&mesh));
    Ok(triangles(&mesh))
}

const VERTICES: &str = "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 2 1 0\nv 0 4 0\n";
const PLY: &str = "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
    property list uchar int vertex_index\nend_header\n0 0 0\n4 0 0\n4 4 0\n2 1 0\n0 4 0\n5 0 1 2 3 4\n";

#[test]
fn files_of_every_style_are_the_plain_mesh() {
    let plain = of("a.obj", &format!("{VERTICES}f 1 2 3 4 5\n")).unwrap();
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
    ];
    let of_kind = |name: &'static str, rows: &[(&'static str, String)]| -> Vec<_> {
        rows.iter().map(|(what, text)| (name, *what, of(name, text))).collect()
    };
    for (name, what, read) in [of_kind("a.obj", &objs), of_kind("a.ply", &plys)].concat() {
        assert_eq!(read.as_ref(), Ok(&plain), "{name}: {what}");
    }
}

/// Corners, and the area. They turn to the left.
type Polygon = (&'static str, Vec<[f32; 2]>, f64);

fn polygons() -> Vec<Polygon> {
    let comb = (0..100).rev().map(|i| [i as f32, if i % 2 == 0 { 1.0 } else { 5.0 }]);
    let comb = [[0.0, 0.0], [99.0, 0.0]].into_iter().chain(comb).collect();
    vec![
        ("square", vec![[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]], 4.0),
        ("notched square", vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [2.0, 1.0], [0.0, 4.0]], 10.0),
        ("arrow", vec![[0.0, 0.0], [3.0, -2.0], [1.0, 0.0], [3.0, 2.0]], 2.0),
        (
            "triangle with corners on its edges",
            vec![[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 1.0]],
            2.0,
        ),
        (
            "spiral",
            vec![
                [0.0, 0.0],
                [5.0, 0.0],
                [5.0, 5.0],
                [1.0, 5.0],
                [1.0, 2.0],
                [3.0, 2.0],
                [3.0, 3.0],
                [2.0, 3.0],
                [2.0, 4.0],
                [4.0, 4.0],
                [4.0, 1.0],
                [0.0, 1.0],
            ],
            15.0,
        ),
        ("comb", comb, 297.0),
    ]
}

/// A file of one polygon in the plane of `u` and `v`, whose face begins at this corner.
fn file(name: &str, polygon: &[[f32; 2]], plane: [[f32; 3]; 3], first: usize) -> String {
    let [origin, u, v] = plane;
    let at = |[a, b]: &[f32; 2]| {
        (0..3).map(|i| (origin[i] + a * u[i] + b * v[i]).to_string()).collect::<Vec<_>>().join(" ")
    };
    let count = polygon.len();
    let is_ply = name.ends_with("ply");
    let corners = (0..count).map(|k| format!(" {}", (first + k) % count + usize::from(!is_ply)));
    let corners: String = corners.collect();
    let points = polygon.iter().map(at);
    if is_ply {
        let header =
            PLY.split_once("0 0 0").unwrap().0.replace("vertex 5", &format!("vertex {count}"));
        return format!(
            "{header}{}{count}{corners}\n",
            points.map(|point| point + "\n").collect::<String>()
        );
    }
    format!("{}f{corners}\n", points.map(|point| format!("v {point}\n")).collect::<String>())
}

/// Whichever corner comes first, whatever the size, and far from the origin.
#[test]
fn polygons_are_filled_once() {
    let far = [65_536.0, -32_768.0, 4096.0];
    let planes = [
        ("small", [[0.0; 3], [0.01, 0.0, 0.0], [0.0, 0.01, 0.0]], 1e-4),
        ("level", [[0.0; 3], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]], 1.0),
        ("large", [[0.0; 3], [0.0, 100.0, 0.0], [0.0, 0.0, 100.0]], 1e4),
        ("slanted and far", [far, [0.5, 0.0, 0.25], [0.0, 0.5, 0.0]], 0.5 * 0.3125f64.sqrt()),
    ];
    for (shape, polygon, area) in polygons() {
        let mut cut = Vec::new();
        for (plane, axes, times) in planes {
            for name in ["a.obj", "a.ply"] {
                let meshes: Vec<Mesh> = (0..polygon.len())
                    .map(|first| read(name, file(name, &polygon, axes, first).as_bytes()).unwrap())
                    .collect();
                let row = format!("{shape}, {plane}, {name}");
                for mesh in &meshes {
                    assert_eq!(triangles(mesh), triangles(&meshes[0]), "{row}");
                }
                let doubled = |triangle: usize| {
                    let [a, b, c] = meshes[0].triangle(triangle);
                    (b - a).cross(c - a)
                };
                let doubled: Vec<_> = (0..meshes[0].triangle_count()).map(doubled).collect();
                let filled: f64 = doubled.iter().map(|area| area.length() / 2.0).sum();
                assert!((filled / (area * times) - 1.0).abs() < 1e-5, "{row}: {filled}");
                assert!(doubled.iter().all(|area| area.dot(doubled[0]) >= 0.0), "{row}");
                cut.push(meshes[0].indices.clone());
            }
        }
        assert!(cut.iter().all(|indices| *indices == cut[0]), "{shape}: {cut:?}");
    }
}

/// A mesh of random faces. Of half of the draws some corners have normals, and not all of these can be used.
struct Draw {
    random: Pcg64,
    positions: Vec<[f32; 3]>,
    normals: Vec<[f32; 3]>,
    /// Corners, each a position and perhaps a normal.
    faces: Vec<Vec<(usize, Option<usize>)>>,
}

impl Draw {
    fn new(seed: u64) -> Self {
        let mut random = Pcg64::seed_from_u64(seed);
        let scale = 10f32.powi(random.random_range(-3..5));
        let mut points = |count: usize| -> Vec<[f32; 3]> {
            (0..count)
                .map(|_| [(); 3].map(|()| scale * random.random_range(-1.0f32..1.0)))
                .collect()
        };
        let (positions, mut normals) = (points(12), points(5));
        (normals[0], normals[1][1]) = ([0.0; 3], f32::NAN);
        let has_normals = if seed % 2 == 0 { 0.8 } else { 0.0 };
        let face = |_| {
            let corners: Vec<usize> = (0..positions.len()).collect();
            let count = random.random_range(3..8);
            let corners: Vec<usize> = corners.sample(&mut random, count).copied().collect();
            let mut normal =
                || random.random_bool(has_normals).then(|| random.random_range(0..normals.len()));
            corners.into_iter().map(|corner| (corner, normal())).collect()
        };
        let faces = (0..10).map(face).collect();
        Self { random, positions, normals, faces }
    }

    fn one<'a>(&mut self, of: &[&'a str]) -> &'a str {
        of.choose(&mut self.random).unwrap()
    }

    fn plain(&self) -> String {
        let line = |keyword: &str, words: Vec<String>| format!("{keyword} {}\n", words.join(" "));
        let points = |keyword, points: &[[f32; 3]]| -> String {
            points
                .iter()
                .map(|point| line(keyword, point.map(|value| value.to_string()).into()))
                .collect()
        };
        let corner = |(position, normal): &(usize, Option<usize>)| match normal {
            Some(normal) => format!("{}//{}", position + 1, normal + 1),
            None => (position + 1).to_string(),
        };
        let faces = self.faces.iter().map(|face| line("f", face.iter().map(corner).collect()));
        points("v", &self.positions) + &points("vn", &self.normals) + &faces.collect::<String>()
    }

    fn number(&mut self, value: f32) -> String {
        match self.random.random_range(0..3) {
            0 => format!("{value:e}"),
            1 if value >= 0.0 => format!("+{value}"),
            _ => value.to_string(),
        }
    }

    fn index(&mut self, place: usize, count: usize) -> String {
        if self.random.random_bool(0.5) {
            (place + 1).to_string()
        } else {
            format!("-{}", count - place)
        }
    }

    fn corner(&mut self, position: usize, normal: Option<usize>) -> String {
        let (positions, normals) = (self.positions.len(), self.normals.len());
        let position = self.index(position, positions);
        let normal = normal.map_or(String::new(), |normal| self.index(normal, normals));
        match self.random.random_range(0..3) {
            0 if normal.is_empty() => position,
            1 => format!("{position}/1/{normal}"),
            _ => format!("{position}//{normal}"),
        }
    }

    /// The same in a random style, as OBJ or PLY.
    fn styled(&mut self, is_ply: bool) -> String {
        let mut lines: Vec<Vec<String>> = Vec::new();
        let of = |keyword: &str| if is_ply { Vec::new() } else { vec![keyword.to_owned()] };
        let points = self.positions.iter().map(|point| ("v", *point));
        let points: Vec<_> =
            points.chain(self.normals.iter().map(|point| ("vn", *point))).collect();
        for (keyword, point) in points.into_iter().filter(|(keyword, _)| *keyword == "v" || !is_ply)
        {
            let colour = ["1", "0.5", "0"].map(str::to_owned);
            let has_colour = keyword == "v" && !is_ply && self.random.random_bool(0.3);
            let numbers = point.map(|value| self.number(value));
            lines.push(
                [of(keyword), numbers.into(), if has_colour { colour.into() } else { Vec::new() }]
                    .concat(),
            );
        }
        for mut face in self.faces.clone() {
            let count = face.len();
            face.rotate_left(self.random.random_range(0..count));
            lines.push(if is_ply {
                std::iter::once(count)
                    .chain(face.iter().map(|corner| corner.0))
                    .map(|word| word.to_string())
                    .collect()
            } else {
                [
                    of("f"),
                    face.into_iter()
                        .map(|(position, normal)| self.corner(position, normal))
                        .collect(),
                ]
                .concat()
            });
        }
        let mut text = match is_ply {
            true => PLY
                .split_once("0 0 0")
                .unwrap()
                .0
                .replace("vertex 5", "vertex 12")
                .replace("face 1", "face 10"),
            false => String::new(),
        };
        let joints = [" ", "  ", "\t", " \\\n ", "\\\n ", "\\\n"];
        let ends = [
            "\n",
            "\n\n",
            "\t\n",
            " # \\\n",
            "#f 1 2 3\n",
            "\nvt 0 0\n",
            "\ns off\n",
            "\n# \\\n",

        ];
        let (joints, ends) =
            if is_ply { (&joints[..3], &ends[..3]) } else { (&joints[..], &ends[..]) };
        for word in lines.into_iter().flat_map(|words| [words, vec!["\n".to_owned()]].concat()) {
            text += if word == "\n" { self.one(ends) } else { &word };
            text += if word == "\n" { self.one(&["", "  "]) } else { self.one(joints) };
        }
        let end = self.one(&["\n", "\r\n", "\r"]);
        format!("{}{}", self.one(&["", "\u{feff}"]), text.replace('\n', end))
    }
}

/// Ten times `FATHOM_DRAWS` random meshes, each in a random style.
#[test]
fn random_meshes_in_random_styles_are_the_plain_ones() {
    for seed in 0..10 * draws() {
        let mut draw = Draw::new(seed);
        let plain = of("a.obj", &draw.plain()).unwrap();
        for (name, is_ply) in
            [("a.obj", false), ("a.ply", true)].into_iter().take(1 + seed as usize % 2)
        {
            let styled = draw.styled(is_ply);
            assert!(of(name, &styled).as_ref() == Ok(&plain), "{seed}, {name}: {styled:?}");
        }
    }
}
