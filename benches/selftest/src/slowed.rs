//! A stage made slower by more work of its own: every entry point of its shader runs a loop before what it did.

use fathom::compare::store::Comparison;
use fathom::compare::verdict::Verdicts;

/// Iterations in the trial that measures how much slower they make each stage.
pub const TRIED: u32 = 64;

/// The file of a stage's shader, and the condition under which it is this stage's.
pub fn shader(stage: &str) -> (String, Option<String>) {
    let axis = stage.strip_prefix("voxel/slicemap-").and_then(|axis| "xyz".find(axis));
    let path = axis.map_or(stage, |_| "voxel/slicemap");
    (format!("shaders/{path}.wgsl"), axis.map(|axis| format!("AXIS == {axis}")))
}

/// The shader with a loop at the head of each entry point that has an argument; none where none has.
pub fn with_loop(source: &str, iterations: u32, condition: Option<&str>) -> Option<String> {
    let (mut text, mut signature, mut loops) = (String::new(), None, 0);
    for line in source.split_inclusive('\n') {
        if ["@vertex", "@fragment", "@compute"].iter().any(|stage| line.starts_with(stage)) {
            signature = Some(String::new());
        }
        let Some(begun) = &mut signature else {
            text += line;
            continue;
        };
        begun.push_str(line);
        if line.ends_with(" {\n") {
            let looped = entry_with_loop(begun, iterations, condition);
            loops += usize::from(looped.is_some());
            text += looped.as_ref().unwrap_or(begun);
            signature = None;
        }
    }
    (loops > 0).then_some(text)
}

/// The loop begins with the last argument and adds what comes of it, which is 0. No compiler can know that, so none leaves it out.
fn entry_with_loop(signature: &str, iterations: u32, condition: Option<&str>) -> Option<String> {
    let (arguments, _) = signature.split_once(") ->").or(signature.rsplit_once(") {"))?;
    let (named, kind) = arguments.trim_end_matches([',', '\n']).rsplit_once(": ")?;
    let name = named.rsplit([' ', '(']).next()?;
    let (value, first, nothing) = match kind {
        "u32" => (name.to_owned(), "", "u32(nothing)"),
        "vec3<u32>" => (name.to_owned(), ".x", "u32(nothing)"),
        "SceneVertex" | "Corner" => (format!("{name}.position_m"), ".x", "nothing"),
        _ if kind.starts_with("vec") => (name.to_owned(), ".x", "nothing"),
        _ => (format!("{name}.clip"), ".x", "nothing"),
    };
    let before = condition.map(|condition| format!("#if {condition}\n")).unwrap_or_default();
    let after = condition.map_or("", |_| "#endif\n");
    let rest = &signature[named.len()..];
    Some(format!(
        "{named}_given{rest}    var {name} = {name}_given;
{before}    {{
        var idle = f32({value}{first});
        let end = {iterations}u + u32(idle > 1e9);
        for (var i = 0u; i < end; i++) {{
            idle = fract(idle * 1.618 + 0.3);
        }}
        let nothing = select(0.0, 1.0, idle == -7.7e-31);
        {value} += {nothing};
    }}
{after}"
    ))
}

/// Iterations that make a stage slower by about a share, as a comparison shows in which all stages have [`TRIED`] of them.
pub fn iterations(tried: &Comparison, stage: &str, share: f64) -> Option<u32> {
    let cell = tried.header.cells.iter().find(|cell| cell.stage() == stage)?;
    let judged = Verdicts::judge(tried).cells.into_iter().find(|judged| judged.cell == *cell)?;
    let change = judged.time?.change.median;
    let iterations = (share * f64::from(TRIED) / change).round() as u32;
    (change > 0.0).then(|| iterations.max(1))
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use fathom::embedded::{Folder, Folders, SHADERS};
    use fathom::gpu::link;
    use itertools::Itertools;

    use crate::trials::{Variant, stages};
    use crate::workshop::changes;

    /// Each axis has a stage of its own.
    #[test]
    fn every_stage_of_the_gates_links_with_a_loop_in_its_shader() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folder = tempfile::tempdir().unwrap();
        let all = changes(&root, &Variant::Tried, None).unwrap();
        assert_eq!(all.len(), stages().len() - 2, "three stages have one shader");
        for (file, text) in &all {
            let to = folder.path().join(file);
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            std::fs::write(to, text).unwrap();
        }
        let loops = |folders: &Folders| {
            // Only slices have one for each axis.
            let each = all.keys().cartesian_product(0..3);
            let each = each.filter(|(file, axis)| *axis == 0 || file.contains("voxel/slice"));
            let each = each.map(|(file, axis)| {
                let path = &file["shaders/".len()..file.len() - ".wgsl".len()];
                let linked = link(folders, path, &[("AXIS", axis)]);
                let linked = linked.unwrap_or_else(|error| panic!("{path}: {error}"));
                format!("{linked:?}").matches("Loop {").count()
            });
            each.collect_vec()
        };
        let slowed = Folders::new(Folder::from_path(folder.path().join("shaders"))).with(SHADERS);
        let (before, after) = (loops(&Folders::new(SHADERS)), loops(&slowed));
        assert!(before.iter().zip(&after).all(|(before, after)| before < after), "{after:?}");
    }
}
