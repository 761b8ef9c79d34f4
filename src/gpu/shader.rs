//! Shaders: read from `shaders/`, linked by naga_oil, checked by naga, handed to wgpu as naga IR.
//!
//! `shaders/shared/NAME.wgsl` begins with `#define_import_path fathom::NAME` and is imported by that
//! path. The module `fathom::host` holds the structs that the host declares (`shader_struct!`). A shader may name values of the host as `#{NAME}` or test them with `#if NAME == 1`; a line
//! `// defs: NAME=4, OTHER=0` among its first lines gives their defaults.

use std::borrow::Cow;
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use naga_oil::compose::{
    ComposableModuleDescriptor, Composer, ComposerError, NagaModuleDescriptor, ShaderDefValue,
    ShaderType, get_preprocessor_data,
};
use wgpu::naga;

use super::kit::host_module;
use super::layout::{Binding, bindings};
use super::pipelines::CodeKey;
use super::{Gpu, GpuError};
use fathom_base::embedded::{Folders, SHADERS};

/// A linked shader of a device.
#[derive(Clone)]
pub struct Shader {
    pub path: String,
    pub module: wgpu::ShaderModule,
    pub bindings: Arc<[Binding]>,
}

/// Shaders by path and values of the host: pipelines share most of theirs. A planner knows which they would be and links none.
pub(super) type ShaderCache = Mutex<BTreeMap<CodeKey, Option<Shader>>>;

/// How shaders' files end.
const ENDING: &str = ".wgsl";

/// Where the modules lie that other shaders import.
const SHARED: &str = "shared/";

/// Lines at a shader's head among which `// defs:` is looked for.
const HEAD_LINES: usize = 5;

/// Paths of all stage shaders of these folders, such as `caustics/trace`, in alphabetical order.
pub fn shader_paths(folders: &Folders) -> Vec<String> {
    let paths = folders.texts(ENDING).into_iter().map(|(path, _)| path);
    paths.filter(|path| !path.starts_with(SHARED)).collect()
}

/// The vertex stage of a shader that has a fragment stage alone: a triangle that covers the target.
const FULL_SCREEN: &str = "
@vertex
fn vertex(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    return vec4(f32(index & 1u) * 4.0 - 1.0, f32(index >> 1u) * 4.0 - 1.0, 0.0, 1.0);
}
";

fn source(folders: &Folders, path: &str) -> Result<String, GpuError> {
    let file = folders.text(&format!("{path}{ENDING}")).map(|(_, text)| text);
    let mut text = file.ok_or_else(|| GpuError::UnknownShader(path.to_owned()))?;
    if text.contains("@fragment") && !text.contains("@vertex") {
        text.push_str(FULL_SCREEN);
    }
    Ok(text)
}

/// The source of a shader and of all that it imports, by file.
pub fn sources(folders: &Folders, path: &str) -> BTreeMap<String, String> {
    let mut modules = modules(folders);
    let mut wanted: Vec<_> =
        source(folders, path).map(|text| (path.to_owned(), text)).into_iter().collect();
    let mut sources = BTreeMap::new();
    while let Some((path, text)) = wanted.pop() {
        let imports = get_preprocessor_data(&text).1;
        wanted.extend(imports.iter().filter_map(|of| modules.remove(&of.import)));
        sources.insert(path + ENDING, text);
    }
    sources
}

/// The defaults in the shader's `// defs:` line.
pub fn default_defs(folders: &Folders, path: &str) -> Result<Vec<(String, i32)>, GpuError> {
    parse_defs(&source(folders, path)?)
        .map_err(|message| GpuError::Shader { path: path.to_owned(), message })
}

fn parse_defs(source: &str) -> Result<Vec<(String, i32)>, String> {
    let head = source.lines().take(HEAD_LINES);
    let Some(line) = head.filter_map(|line| line.trim().strip_prefix("// defs:")).next() else {
        return Ok(Vec::new());
    };
    let pairs = line.split(',').map(str::trim).filter(|pair| !pair.is_empty());
    pairs
        .map(|pair| {
            let (name, value) =
                pair.split_once('=').ok_or(format!("`{pair}` is not NAME=INTEGER"))?;
            let value = value.trim().parse().map_err(|e| format!("`{pair}`: {e}"))?;
            Ok((name.trim().to_owned(), value))
        })
        .collect()
}

/// Links one shader with the modules it imports: a validated naga module. `defs` go before the
/// shader's own defaults.
pub fn link(folders: &Folders, path: &str, defs: &[(&str, i32)]) -> Result<naga::Module, GpuError> {
    let mut values: BTreeMap<String, i32> = default_defs(folders, path)?.into_iter().collect();
    values.extend(defs.iter().map(|(name, value)| ((*name).to_owned(), *value)));
    let shader_defs: HashMap<String, ShaderDefValue> =
        values.into_iter().map(|(name, value)| (name, ShaderDefValue::Int(value))).collect();
    let source = source(folders, path)?;
    let cached = LINKER.take().filter(|linker| linker.of == folders.names());
    let mut linker = cached.unwrap_or_else(|| Linker::new(folders));
    linker.add_imports(&source)?;
    let descriptor = NagaModuleDescriptor {
        source: &source,
        file_path: &format!("shaders/{path}.wgsl"),
        shader_type: ShaderType::Wgsl,
        shader_defs,
        additional_imports: &[],
    };
    let linked = linker
        .composer
        .make_naga_module(descriptor)
        .map_err(|error| annotated(path, &error, &linker.composer))?;
    LINKER.set(Some(linker));
    Ok(linked)
}

thread_local! {
    /// Kept from shader to shader, as to add a module takes longer than to link with it. A failed link leaves none.
    static LINKER: Cell<Option<Linker>> = const { Cell::new(None) };
}

/// Path and source of the modules that shaders of these folders can import, by the names by which they do.
fn modules(folders: &Folders) -> BTreeMap<String, (String, String)> {
    let mut modules = folders.texts(ENDING);
    modules.retain(|(path, _)| path.starts_with(SHARED));
    modules.push(("host".to_owned(), host_module()));
    let named = modules.into_iter().filter_map(|(path, source)| {
        let name = source.lines().find_map(|line| line.strip_prefix("#define_import_path "))?;
        Some((name.trim().to_owned(), (path, source)))
    });
    named.collect()
}

/// Links shaders with those modules that they import: it takes a quarter of a second to add all.
struct Linker {
    /// The folders that it knows.
    of: Vec<Cow<'static, str>>,
    composer: Composer,
    /// Modules that no shader has imported so far.
    waiting: BTreeMap<String, (String, String)>,
}

impl Linker {
    fn new(folders: &Folders) -> Self {
        let composer = Composer::default().with_capabilities(naga::valid::Capabilities::all());
        Self { of: folders.names(), composer, waiting: modules(folders) }
    }

    /// Adds what a source imports, each module after those that it imports. What is unknown or circular is named by naga_oil.
    fn add_imports(&mut self, source: &str) -> Result<(), GpuError> {
        for import in get_preprocessor_data(source).1 {
            let Some((path, source)) = self.waiting.remove(&import.import) else { continue };
            self.add_imports(&source)?;
            let file_path = format!("shaders/{path}.wgsl");
            let descriptor = ComposableModuleDescriptor {
                source: &source,
                file_path: &file_path,
                ..Default::default()
            };
            if let Err(error) = self.composer.add_composable_module(descriptor) {
                return Err(annotated(&path, &error, &self.composer));
            }
        }
        Ok(())
    }
}

/// naga_oil's message with the lines of source it speaks of.
fn annotated(path: &str, error: &ComposerError, composer: &Composer) -> GpuError {
    GpuError::Shader { path: path.to_owned(), message: error.emit_to_string(composer) }
}

/// A linked shader as WGSL, for other implementations of WebGPU.
pub fn text(path: &str, module: &naga::Module) -> Result<String, GpuError> {
    use naga::back::wgsl::{WriterFlags, write_string};
    use naga::valid::{Capabilities, ValidationFlags, Validator};
    let failed = |message: String| GpuError::Shader { path: path.to_owned(), message };
    let validated = Validator::new(ValidationFlags::all(), Capabilities::all()).validate(module);
    let validated = validated.map_err(|error| failed(error.to_string()))?;
    write_string(module, &validated, WriterFlags::empty())
        .map_err(|error| failed(error.to_string()))
}

/// Whether fathom's own folder alone gives this module: then no folder of a user's has a part in it.
fn is_own(path: &str, defs: &[(&str, i32)], module: &naga::Module) -> bool {
    let own = link(&Folders::new(SHADERS), path, defs).and_then(|own| text(path, &own));
    own.is_ok_and(|own| text(path, module).is_ok_and(|text| text == own))
}

/// Options for every pipeline: workgroup memory is not cleared, as kernels write it before reading.
pub fn compilation_options() -> wgpu::PipelineCompilationOptions<'static> {
    wgpu::PipelineCompilationOptions {
        zero_initialize_workgroup_memory: false,
        ..Default::default()
    }
}

impl Gpu {
    /// The shader `shaders/PATH.wgsl`, such as `caustics/trace`, linked with what it imports.
    pub fn shader(&self, path: &str, defs: &[(&str, i32)]) -> Result<Shader, GpuError> {
        let key = CodeKey::new(path, defs);
        let cached = self.shader_cache().get(&key).cloned().flatten();
        if let Some(shader) = cached {
            // A device that is lost has none.
            return self.catch(|| Ok(shader));
        }
        let shader = self.make_shader(path, defs)?;
        self.shader_cache().insert(key, Some(shader.clone()));
        Ok(shader)
    }

    /// On a planner: a pipeline would link this shader.
    pub fn plan_shader(&self, key: CodeKey) {
        self.shader_cache().entry(key).or_default();
    }

    /// Every shader that pipelines have linked or planned here.
    pub fn shader_variants(&self) -> BTreeSet<CodeKey> {
        self.shader_cache().keys().cloned().collect()
    }

    fn shader_cache(&self) -> MutexGuard<'_, BTreeMap<CodeKey, Option<Shader>>> {
        self.shaders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn make_shader(&self, path: &str, defs: &[(&str, i32)]) -> Result<Shader, GpuError> {
        let mut module = link(&self.folders, path, defs)?;
        let unchecked = self.unchecked && is_own(path, defs, &module);
        let bindings = bindings(&mut module).into();
        let source = wgpu::ShaderSource::Naga(Cow::Owned(module));
        let descriptor = wgpu::ShaderModuleDescriptor { label: Some(path), source };
        self.catch(|| {
            if !unchecked {
                let module = self.device.create_shader_module(descriptor);
                return Ok(Shader { path: path.to_owned(), module, bindings });
            }
            let checks = wgpu::ShaderRuntimeChecks::unchecked();
            // SAFETY: only fathom's own shaders come here. They index within their bindings and have no
            // endless loops, which running the same shaders with the checks on shows.
            let module = unsafe { self.device.create_shader_module_trusted(descriptor, checks) };
            Ok(Shader { path: path.to_owned(), module, bindings })
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folders() -> Folders {
        Folders::new(SHADERS)
    }

    #[test]
    fn defs_go_before_the_shaders_own_defaults() {
        let group_size = |defs: &[(&str, i32)]| {
            link(&folders(), "ceilings/compute", defs).unwrap().entry_points[0].workgroup_size[0]
        };
        assert_eq!(group_size(&[]), 64);
        assert_eq!(group_size(&[("GROUP_SIZE", 32)]), 32);
    }

    #[test]
    fn a_malformed_default_is_an_error() {
        assert_eq!(parse_defs("// defs: A=1, B=-2\n"), Ok(vec![("A".into(), 1), ("B".into(), -2)]));
        assert_eq!(parse_defs("fn main() {}"), Ok(vec![]));
        assert!(parse_defs("// defs: A\n").is_err());
        assert!(parse_defs("// defs: A=x\n").is_err());
    }

    #[test]
    fn a_link_error_shows_the_source() {
        let error =
            link(&folders(), "ceilings/compute", &[("GROUP_SIZE", -1)]).unwrap_err().to_string();
        assert!(error.contains("shaders/ceilings/compute.wgsl"), "{error}");
        assert!(error.contains("length / groups.x, -1u)"), "{error}");
        assert!(matches!(link(&folders(), "audit/none", &[]), Err(GpuError::UnknownShader(_))));
    }
}
