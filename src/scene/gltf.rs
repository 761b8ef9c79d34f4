//! glTF 2.0: `.glb`, and `.gltf` with its buffers embedded or in files beside it. The crate `gltf` checks indices, but not that accessors lie within their
//! buffers and hold what is read from them: that is done here.

use std::collections::{BTreeSet, HashMap};
use std::fs;
use std::io::Read;
use std::path::{Component, Path, PathBuf};

use ::gltf::accessor::sparse::Sparse;
use ::gltf::accessor::{DataType, Dimensions};
use ::gltf::json::{Index, Root, Value, deserialize};
use ::gltf::material::AlphaMode;
use ::gltf::mesh::Mode;
use ::gltf::{Accessor, Document, Primitive, Semantic};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use glam::{DMat4, Mat4, Vec3};
use percent_encoding::percent_decode_str;

use super::Mesh;
use super::mesh_file::MeshPart;
use super::read::{self, MAX_VERTICES};
use fathom_base::input::{self, BYTE_ORDER_MARK, Limited};
use fathom_base::text::{excerpt, fault};

/// Largest file, and largest sum of its buffers, bytes: they stand in memory more than once.
const MAX_FILE: u64 = 192 << 20;
/// Most objects, lists and commas of the JSON: an empty object of the file becomes up to 400 bytes (gltf-json 1.4).
const MAX_MARKS: usize = 2_000_000;
/// How the URI of a buffer begins that is embedded in the JSON.
const EMBEDDED: &str = "data:";
/// Beginnings of names of extensions that change no triangle.
const OF_LOOKS: [&str; 4] = ["KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_"];

/// Reads all triangles of the file's scene, at most `triangles`, one part for each base colour.
pub fn read(
    file: &mut dyn Read,
    path: &Path,
    triangles: usize,
    notes: &mut Vec<String>,
) -> Result<Vec<MeshPart>, String> {
    let bytes = Limited::new(file, MAX_FILE).bytes().map_err(|error| error.to_string())?;
    let (root, chunk) = parse(&bytes)?;
    let document = checked(root)?;
    notes.extend(unread(&document));
    let mut left = MAX_FILE;
    let buffers = document.as_json().buffers.iter().enumerate().map(|(number, of)| {
        let chunk = chunk.filter(|_| number == 0);
        let bytes = buffer(of.uri.as_deref(), chunk, path, left);
        let bytes = bytes.map_err(|what| format!("buffer {number} {what}"))?;
        let (length, claimed) = (bytes.len() as u64, of.byte_length.0);
        left = left.saturating_sub(length);
        let fault = || format!("buffer {number} has {length} bytes and claims {claimed}");
        (length >= claimed).then_some(bytes).ok_or_else(fault)
    });
    let buffers = buffers.collect::<Result<_, _>>()?;
    Reader { buffers, left: triangles, max: triangles, vertices: 0 }.parts(&document)
}

/// The files with the buffers of a file, each once.
pub fn buffer_files(path: &Path) -> Result<BTreeSet<PathBuf>, String> {
    let bytes = read::open(path).and_then(|file| Limited::new(file, MAX_FILE).bytes());
    let bytes = bytes.map_err(|error| error.to_string())?;
    let buffers = parse(&bytes)?.0.buffers;
    let uris = buffers.iter().filter_map(|buffer| buffer.uri.as_deref());
    uris.filter(|uri| !uri.starts_with(EMBEDDED)).map(|uri| file_beside(path, uri)).collect()
}

/// The JSON of a file, and its binary chunk.
fn parse(bytes: &[u8]) -> Result<(Root, Option<&[u8]>), String> {
    let is_binary = bytes.starts_with(b"glTF");
    let (text, chunk) = if is_binary { chunks(bytes)? } else { (bytes, None) };
    let text = text.strip_prefix(BYTE_ORDER_MARK.as_bytes()).unwrap_or(text);
    check_size(text)?;
    let root = deserialize::from_slice(text).map_err(|error| {
        let json: Value = deserialize::from_slice(text).unwrap_or_default();
        let told = &json["asset"]["version"];
        match told.as_str().map_or_else(|| told.to_string(), str::to_owned) {
            version if version.starts_with("2.") => fault(error),
            // Version 1.0 need not say so: its meshes have names for keys.
            version if version == "null" && json["meshes"].is_object() => other_version("1.0"),
            version if version == "null" => fault(error),
            version => other_version(&version),
        }
    });
    root.map(|root| (root, chunk))
}

fn other_version(version: &str) -> String {
    format!("it is glTF {}: only version 2.0 is read", excerpt(version))
}

/// The JSON and the binary chunk of a `.glb` file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), String> {
    let number = |at: usize| bytes.get(at..at + 4)?.try_into().ok().map(u32::from_le_bytes);
    if let Some(version) = number(4).filter(|version| *version != 2) {
        return Err(other_version(&version.to_string()));
    }
    let (mut at, mut text, mut binary) = (12, None, None);
    while let Some(length) = number(at) {
        let end = at + 8 + length as usize;
        let content = bytes.get(at + 8..end).ok_or("it ends within a chunk")?;
        match &bytes[at + 4..at + 8] {
            b"JSON" if text.is_none() => text = Some(content),
            b"BIN\0" if binary.is_none() => binary = Some(content),
            _ => {}
        }
        at = end;
    }
    Ok((text.ok_or("it has no JSON")?, binary))
}

/// Refuses a JSON that would take far more memory than it has bytes.
fn check_size(text: &[u8]) -> Result<(), String> {
    let (mut marks, mut in_string, mut bytes) = (0, false, text.iter());
    while let Some(byte) = bytes.next() {
        match byte {
            b'"' => in_string = !in_string,
            b'\\' if in_string => drop(bytes.next()),
            b'{' | b'[' | b',' if !in_string => marks += 1,
            _ => {}
        }
    }
    let error = || format!("more than {MAX_MARKS} values in its JSON; at most that is read");
    (marks <= MAX_MARKS).then_some(()).ok_or_else(error)
}

/// Whether all its indices lie within what there is, and nothing is required that is not read.
fn checked(mut root: Root) -> Result<Document, String> {
    let is_of_looks = |name: &String| OF_LOOKS.iter().any(|start| name.starts_with(start));
    root.extensions_required.retain(|name| !is_of_looks(name));
    if let Some(name) = root.extensions_required.first() {
        let name = excerpt(name);
        return Err(format!("it requires the extension {name}: export it without"));
    }
    // The crate uses these before it checks them.
    let primitives = root.meshes.iter().flat_map(|mesh| &mesh.primitives);
    let mut accessors = primitives.flat_map(|of| of.attributes.values()).map(Index::value);
    if let Some(bad) = accessors.find(|accessor| *accessor >= root.accessors.len()) {
        return Err(format!("accessor {bad} is out of bounds"));
    }
    Document::from_json(root).map_err(|error| match error {
        ::gltf::Error::Validation(faults) => {
            faults.first().map_or_else(String::new, |(path, fault)| format!("{path}: {fault}"))
        }
        other => other.to_string(),
    })
}

/// What of the file is not read.
fn unread(document: &Document) -> Vec<String> {
    let primitives = || document.meshes().flat_map(|mesh| mesh.primitives());
    let kinds = [
        (document.images().len() > 0, "textures are not read: surfaces have their base colour"),
        (document.skins().len() > 0, "skins are not read: the mesh stands as it was modelled"),
        (primitives().any(|of| of.morph_targets().len() > 0), "morph targets are not read"),
        (document.animations().len() > 0, "animations are not read"),
        (!primitives().all(|of| is_of_triangles(&of)), "points and lines are not read"),
    ];
    let kinds = kinds.into_iter().filter(|(is_there, _)| *is_there);
    let extensions = document.extensions_used().map(excerpt);
    let extensions = extensions.map(|name| format!("the extension {name} is not read"));
    kinds.map(|(_, what)| what.to_owned()).chain(extensions).collect()
}

fn is_of_triangles(primitive: &Primitive<'_>) -> bool {
    let of_triangles = [Mode::Triangles, Mode::TriangleStrip, Mode::TriangleFan];
    of_triangles.contains(&primitive.mode()) && primitive.get(&Semantic::Positions).is_some()
}

/// The bytes of a buffer of the file at this path, of at most so many.
fn buffer(
    uri: Option<&str>,
    chunk: Option<&[u8]>,
    path: &Path,
    max: u64,
) -> Result<Vec<u8>, String> {
    let Some(uri) = uri else {
        return chunk.map(<[u8]>::to_vec).ok_or_else(|| "is not in the file".to_owned());
    };
    if uri.starts_with(EMBEDDED) {
        let (_, code) = uri.split_once(";base64,").ok_or("is not in base64")?;
        return BASE64.decode(code).map_err(|error| format!("is no base64: {error}"));
    }
    // As it stands: a buffer may begin as gzip does.
    let file = input::open(&file_beside(path, uri)?).and_then(|file| input::limited(file, max));
    let bytes = file.and_then(Limited::bytes);
    bytes.map_err(|error| format!("is `{}`: {error}", excerpt(uri)))
}

/// The file that the one at `path` names. It may lie in the same folder or below it, and nowhere else: who opens a mesh does not mean to read
/// any other file.
fn file_beside(path: &Path, uri: &str) -> Result<PathBuf, String> {
    let shown = excerpt(uri);
    let outside = || format!("is `{shown}`: only files in the folder of the glTF file are read");
    let name = percent_decode_str(uri).decode_utf8().map_err(|_| outside())?;
    let is_below = |part| matches!(part, Component::Normal(_) | Component::CurDir);
    // With a scheme it is a URL.
    if uri.contains(':') || !Path::new(&*name).components().all(is_below) {
        return Err(outside());
    }
    let whole = |path| fs::canonicalize(path).map_err(|error| format!("is `{shown}`: {error}"));
    let folder = whole(path.with_file_name("."))?;
    let file = whole(path.with_file_name(&*name))?;
    if file.starts_with(folder) { Ok(file) } else { Err(outside()) }
}

struct Reader {
    buffers: Vec<Vec<u8>>,
    /// Triangles that may still be read, of so many.
    left: usize,
    max: usize,
    vertices: usize,
}

impl Reader {
    /// Every node of the scene once, with the transforms of those above it.
    fn parts(mut self, document: &Document) -> Result<Vec<MeshPart>, String> {
        let scene = document.default_scene().or_else(|| document.scenes().next());
        let nodes = scene.ok_or("it has no scene")?.nodes();
        let mut open: Vec<_> = nodes.map(|node| (node, DMat4::IDENTITY)).collect();
        let mut is_seen = vec![false; document.nodes().len()];
        let (mut parts, mut places) = (Vec::<MeshPart>::new(), HashMap::new());
        while let Some((node, above)) = open.pop() {
            if std::mem::replace(&mut is_seen[node.index()], true) {
                return Err(format!("node {} stands below two nodes", node.index()));
            }
            let matrix = above * Mat4::from_cols_array_2d(&node.transform().matrix()).as_dmat4();
            let primitives = node.mesh().into_iter().flat_map(|mesh| mesh.primitives());
            for primitive in primitives.filter(is_of_triangles) {
                let mesh = self.mesh(&primitive)?.transformed(&matrix);
                let (albedo, alpha) = look(&primitive);
                let bits = (albedo.map(|rgb| rgb.map(f32::to_bits)), alpha.to_bits());
                let place = *places.entry(bits).or_insert_with(|| {
                    parts.push(MeshPart { mesh: Mesh::default(), albedo, alpha });
                    parts.len() - 1
                });
                parts[place].mesh.append(&mesh);
            }
            open.extend(node.children().map(|child| (child, matrix)));
        }
        Ok(parts)
    }

    fn mesh(&mut self, primitive: &Primitive<'_>) -> Result<Mesh, String> {
        for (semantic, accessor) in primitive.attributes() {
            if let Semantic::Positions | Semantic::Normals = semantic {
                self.check(&accessor, Dimensions::Vec3, &[DataType::F32], MAX_VERTICES)?;
            }
        }
        let of_indices = [DataType::U8, DataType::U16, DataType::U32];
        if let Some(accessor) = primitive.indices() {
            self.check(&accessor, Dimensions::Scalar, &of_indices, self.max.saturating_mul(3))?;
        }
        let reader = primitive.reader(|buffer| self.buffers.get(buffer.index()).map(Vec::as_slice));
        let beyond = || "an accessor reaches beyond its buffer".to_owned();
        let positions: Vec<[f32; 3]> = reader.read_positions().ok_or_else(beyond)?.collect();
        let count = positions.len();
        self.vertices += count;
        if self.vertices > MAX_VERTICES {
            return Err(format!("more than {MAX_VERTICES} vertices; at most that is read"));
        }
        let unit = |normal| Vec3::from_array(normal).as_dvec3().try_normalize();
        let unit = |normal| unit(normal).unwrap_or_default().as_vec3().to_array();
        let normals = match primitive.get(&Semantic::Normals) {
            Some(_) => reader.read_normals().ok_or_else(beyond)?.map(unit).collect(),
            None => vec![[0.0; 3]; count],
        };
        let corners: Vec<u32> = match primitive.indices() {
            Some(_) => reader.read_indices().ok_or_else(beyond)?.into_u32().collect(),
            None => (0..count as u32).collect(),
        };
        if let Some(bad) = corners.iter().find(|corner| **corner as usize >= count) {
            return Err(format!("a triangle uses vertex {bad}, but there are {count}"));
        }
        let indices = triangles(primitive.mode(), &corners);
        let left = self.left.checked_sub(indices.len() / 3);
        self.left = left.ok_or_else(|| read::too_many_triangles(self.max))?;
        let mut mesh = Mesh { positions, normals, indices };
        if !mesh.indices.is_empty() {
            mesh.validate()?;
        }
        mesh.complete_normals();
        Ok(mesh)
    }

    /// What the crate takes for granted when it reads an accessor; whether it lies within its buffer it checks itself.
    fn check(
        &self,
        accessor: &Accessor<'_>,
        dimensions: Dimensions,
        types: &[DataType],
        max: usize,
    ) -> Result<(), String> {
        let fault = |what: &str| Err(format!("accessor {} {what}", accessor.index()));
        if accessor.dimensions() != dimensions || !types.contains(&accessor.data_type()) {
            return fault("is of another type than is read there");
        }
        let parts = accessor.sparse().map(|sparse| (sparse.values(), sparse.indices()));
        let parts = parts.map(|(v, i)| [(v.view(), v.offset()), (i.view(), i.offset())]);
        let base = accessor.view().map(|view| (view, accessor.offset()));
        for (view, offset) in parts.into_iter().flatten().chain(base) {
            let mut places = [offset, view.offset(), view.length()].into_iter();
            let is_far = places.any(|place| place as u64 > MAX_FILE);
            if is_far || view.stride().is_some_and(|stride| stride < accessor.size()) {
                return fault("reaches beyond its buffer, or its elements beyond each other");
            }
        }
        match accessor.count() {
            0 => fault("has no elements"),
            count if count > max => fault(&format!("has {count} elements; at most {max} are read")),
            count if !accessor.sparse().is_none_or(|sparse| self.rises(&sparse, count)) => {
                fault("has sparse indices that do not rise within its elements")
            }
            _ => Ok(()),
        }
    }

    /// Whether each index is above the one before it: the crate passes over the values of others.
    fn rises(&self, sparse: &Sparse<'_>, elements: usize) -> bool {
        let (indices, view) = (sparse.indices(), sparse.indices().view());
        let (size, buffer) = (indices.index_type().size(), &self.buffers[view.buffer().index()]);
        let bytes =
            buffer.get(view.offset() + indices.offset()..).unwrap_or_default().chunks_exact(size);
        let index = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum, b| sum << 8 | usize::from(*b));
        let all: Vec<usize> = bytes.take(sparse.count()).map(index).collect();
        let is_whole = all.len() == sparse.count() && view.stride().is_none();
        is_whole && all.is_sorted_by(|a, b| a < b) && all.last().is_some_and(|n| *n < elements)
    }
}

/// The indices of triangles, strips and fans as those of triangles.
fn triangles(mode: Mode, corners: &[u32]) -> Vec<u32> {
    let joined = 0..corners.len().saturating_sub(2);
    let places: Vec<[usize; 3]> = match mode {
        Mode::TriangleFan => joined.map(|n| [0, n + 1, n + 2]).collect(),
        // Every second triangle of a strip is turned over.
        Mode::TriangleStrip => joined.map(|n| [n, n + 1 + n % 2, n + 2 - n % 2]).collect(),
        _ => return corners.to_vec(),
    };
    places.as_flattened().iter().map(|place| corners[*place]).collect()
}

/// Linear RGB, none of a primitive without a material; and opacity, which counts where the material is blended: glTF 2.0, §3.9.4.
fn look(primitive: &Primitive<'_>) -> (Option<[f32; 3]>, f32) {
    let material = primitive.material();
    let [r, g, b, a] = material.pbr_metallic_roughness().base_color_factor();
    let [r, g, b, a] = [r, g, b, a].map(|c| if c.is_finite() { c.clamp(0.0, 1.0) } else { 0.0 });
    let alpha = if material.alpha_mode() == AlphaMode::Blend { a } else { 1.0 };
    (material.index().map(|_| [r, g, b]), alpha)
}
