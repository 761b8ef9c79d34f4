//! What a side's processes are given besides their program: variables that the user names, and a Vulkan driver by its manifest.

use std::collections::BTreeMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde::Deserialize;
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use super::launch::{Waiting, WorkerFault, WorkerProcess, WorkerStart};
use fathom_base::input;
use fathom_base::quiet;
use fathom_record::Adapter;
use fathom_record::comparison::{NamedDriver, Side, SideEnvironment};

/// Variables in which the Vulkan loader finds the manifests of the only drivers to use, the second one for loaders before 1.3.207
/// (Khronos, *Vulkan Loader*, LoaderInterfaceArchitecture.md, "Table of Debug Environment Variables").
const DRIVER_VARIABLES: [&str; 2] = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"];
/// Adds drivers to those that the system has.
const MORE_DRIVERS: &str = "VK_ADD_DRIVER_FILES";
/// Variables with the folder in which a driver keeps compiled shaders: Mesa's (Mesa, *Environment Variables*), NVIDIA's (driver README,
/// "Specifying OpenGL Environment Variable Settings") and AMDVLK's. What was compiled in one environment may be wrong in another: Mesa
/// 22.3's lavapipe takes shaders from there that were compiled for another LP_NATIVE_VECTOR_WIDTH, and crashes.
const SHADER_CACHES: [&str; 3] =
    ["MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH", "AMD_SHADER_DISK_CACHE_PATH"];
/// Largest library of a driver, bytes: ten times LLVM with every target.
const MAX_LIBRARY: u64 = 2 << 30;
/// The interface whose drivers have manifests, as [`Adapter::backend`] names it.
const VULKAN: &str = "vulkan";
/// What parts the paths of a list of manifests.
const SEPARATOR: char = if cfg!(windows) { ';' } else { ':' };

/// Bytes of [`SideEnvironment::values_digest`].
const DIGEST_BYTES: usize = 2;

/// What the processes of one side are given that those of the other are not.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GivenEnvironment {
    pub driver: Option<NamedDriver>,
    /// By name.
    pub variables: BTreeMap<String, String>,
}

impl GivenEnvironment {
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// What records say of it. Values may be secret: they stand there only where the user asks for them.
    pub fn recorded(&self, values: bool) -> SideEnvironment {
        let mut sum = Sha256::new();
        for (name, value) in &self.variables {
            sum.update(format!("{name}={value}\0"));
        }
        let digest = hex::encode(&sum.finalize()[..DIGEST_BYTES]);
        let shown =
            |(name, value): (&String, &String)| (name.clone(), values.then(|| value.clone()));
        SideEnvironment {
            driver: self.driver.clone(),
            variables: self.variables.iter().map(shown).collect(),
            values_digest: (!self.variables.is_empty()).then_some(digest),
        }
    }
}

/// A side's environment from what the command line says of it.
///
/// # Errors
/// A variable that cannot be set or that fathom sets itself, and a driver whose manifest or library is not there.
pub fn environment(
    side: Side,
    variables: &[String],
    manifest: Option<&Path>,
) -> Result<GivenEnvironment> {
    let mut known = BTreeMap::new();
    for text in variables {
        let (name, value) = variable(side, text)?;
        let first = known.insert(name.to_owned(), value.to_owned()).is_none();
        ensure!(first, "the {side}'s variable {name} is given twice");
    }
    let driver = manifest.map(|path| {
        named(path).map_err(|reason| anyhow!("--{side}-driver {}: {reason}", path.display()))
    });
    Ok(GivenEnvironment { driver: driver.transpose()?, variables: known })
}

/// Name and value, unless it cannot be set or fathom sets it itself.
fn variable(side: Side, text: &str) -> Result<(&str, &str)> {
    let the = format!("the {side}'s variable");
    let Some((name, value)) = text.split_once('=') else {
        bail!("{the} {text:?} has no value: give NAME=VALUE");
    };
    if name.is_empty() || name.contains(|c: char| c.is_whitespace() || c.is_control()) {
        let rule = "a name is not empty and has no space or control character";
        bail!("{the} has the name {name:?}: {rule}");
    }
    ensure!(!value.contains('\0'), "the value of {the} {name} holds a NUL character");
    if quiet::is_own(name) {
        bail!("{the} {name} is fathom's own: it sets the conditions of every worker");
    }
    if DRIVER_VARIABLES.contains(&name) || name == MORE_DRIVERS {
        bail!("{the} {name} chooses a driver: give --{side}-driver");
    }
    Ok((name, value))
}

/// What fathom reads of a driver's manifest (Khronos, *Vulkan Loader*, LoaderDriverInterface.md, "Driver Manifest File Format").
#[derive(Deserialize)]
struct Manifest {
    #[serde(rename = "ICD")]
    icd: Icd,
}

#[derive(Deserialize)]
struct Icd {
    library_path: String,
}

/// The driver of a manifest, or why there is none.
fn named(path: &Path) -> Result<NamedDriver> {
    let text = input::text(path, input::MAX_TEXT)?;
    let manifest: Manifest = serde_json::from_str(&text)
        .map_err(|error| anyhow!("it is no manifest of a Vulkan driver: {error}"))?;
    let absolute = std::path::absolute(path)?;
    let shown = absolute.to_str().context("its path is not UTF-8")?;
    if shown.contains(SEPARATOR) {
        bail!("the Vulkan loader takes `{SEPARATOR}` in a path for the end of it");
    }
    let library = &manifest.icd.library_path;
    let found = library_of(&absolute, library);
    let sum = found.as_deref().map(|file| {
        let sum = input::plain(file, MAX_LIBRARY).and_then(input::sha256);
        sum.map_err(|error| anyhow!("its library {}: {error}", file.display()))
    });
    Ok(NamedDriver {
        manifest: shown.to_owned(),
        library: found.map_or_else(|| library.clone(), |file| file.display().to_string()),
        digest: sum.transpose()?,
    })
}

/// Where a manifest's library lies. A name without a folder is the linker's to find; a relative path begins at the manifest.
fn library_of(manifest: &Path, library: &str) -> Option<PathBuf> {
    let is_path = library.contains('/') || cfg!(windows) && library.contains('\\');
    is_path.then(|| manifest.parent().unwrap_or(Path::new("")).join(library))
}

/// The variables of a side's processes.
pub fn variables(environment: &GivenEnvironment) -> impl Iterator<Item = (&str, &str)> {
    let manifest = environment.driver.as_ref().map(|driver| driver.manifest.as_str());
    let of_driver = manifest.into_iter().flat_map(|path| DRIVER_VARIABLES.map(|name| (name, path)));
    let own = environment.variables.iter().map(|(name, value)| (name.as_str(), value.as_str()));
    own.chain(of_driver)
}

/// An empty folder for the compiled shaders of a side that is given anything; it goes when this is dropped.
pub fn shader_cache(environment: &GivenEnvironment) -> Result<Option<TempDir>> {
    let folder = || tempfile::Builder::new().prefix("fathom-shaders-").tempdir();
    let made = (!environment.is_empty()).then(folder).transpose();
    made.context("cannot make a folder for compiled shaders")
}

/// The variables that send a side's driver to a folder for compiled shaders, those apart that the user has set.
pub fn cache_variables<'a>(
    environment: &'a GivenEnvironment,
    folder: Option<&'a Path>,
) -> impl Iterator<Item = (&'static str, &'a Path)> {
    let names = SHADER_CACHES.into_iter();
    let names = names.filter(|name| !environment.variables.contains_key(*name));
    folder.into_iter().flat_map(move |folder| names.clone().map(move |name| (name, folder)))
}

/// Whether a side's adapter is one of the driver that was named for it. Its processes find no other Vulkan driver, but perhaps an
/// adapter of another interface.
pub fn check(side: Side, environment: &GivenEnvironment, adapter: &Adapter) -> Result<()> {
    match &environment.driver {
        Some(driver) if adapter.backend != VULKAN => {
            let Adapter { name, backend, .. } = adapter;
            Err(unusable(side, driver, format!("its processes would run on {name} ({backend})")))
        }
        _ => Ok(()),
    }
}

fn unusable(side: Side, driver: &NamedDriver, seen: impl Display) -> anyhow::Error {
    let NamedDriver { manifest, library, .. } = driver;
    anyhow!(
        "--{side}-driver {manifest}: it gives no Vulkan adapter here, as {library} cannot be loaded or finds no device of its own: \
         {seen}"
    )
}

/// Opens the driver that was named for a side once, before anything is built: an unusable one is told at once.
pub fn try_driver(side: Side, start: &WorkerStart, waiting: &Waiting<'_>) -> Result<()> {
    let Some(driver) = &start.environment.driver else { return Ok(()) };
    match WorkerProcess::open(start, waiting) {
        Ok((worker, greeting)) => {
            worker.quit();
            check(side, &start.environment, &greeting.adapter)
        }
        // Whoever interrupts needs no reason.
        Err(WorkerFault::Interrupted) => Ok(()),
        Err(fault) => Err(unusable(side, driver, fault)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(variables: &[&str]) -> String {
        let variables: Vec<String> = variables.iter().map(|text| (*text).to_owned()).collect();
        environment(Side::Head, &variables, None).unwrap_err().to_string()
    }

    #[test]
    fn variables_are_split_at_the_first_sign_and_checked() {
        let given = ["A=1=2".to_owned(), "EMPTY=".to_owned()];
        let known = environment(Side::Base, &given, None).unwrap();
        let expected = [("A", "1=2"), ("EMPTY", "")];
        assert_eq!(variables(&known).collect::<Vec<_>>(), expected);
        for (variables, reason) in [
            (&["A"][..], "the head's variable \"A\" has no value"),
            (&["=1"], "has the name \"\""),
            (&["A B=1"], "has the name \"A B\""),
            (&["A\n=1"], "has the name \"A\\n\""),
            (&["A=\0"], "holds a NUL"),
            (&["A=1", "A=2"], "A is given twice"),
            (&["LP_NUM_THREADS=4"], "LP_NUM_THREADS is fathom's own"),
            (&["GLIBC_TUNABLES=x"], "GLIBC_TUNABLES is fathom's own"),
            (&["FATHOM_PADDING=x"], "FATHOM_PADDING is fathom's own"),
            (&["VK_DRIVER_FILES=x"], "give --head-driver"),
            (&["VK_ADD_DRIVER_FILES=x"], "give --head-driver"),
        ] {
            let error = refused(variables);
            assert!(error.contains(reason) && error.lines().count() == 1, "{error}");
        }
    }

    #[test]
    fn values_are_recorded_only_on_request_and_others_are_told_apart_without_them() {
        let of = |text: &str| environment(Side::Base, &[text.to_owned()], None).unwrap();
        let [mine, other] = ["TOKEN=secret", "TOKEN=another"].map(of);
        let [hidden, shown] = [false, true].map(|values| mine.recorded(values));
        assert!(!serde_json::to_string(&hidden).unwrap().contains("secret"));
        assert_eq!(hidden.variables["TOKEN"], None);
        assert_eq!(shown.variables["TOKEN"].as_deref(), Some("secret"));
        assert!(hidden.is_same(&shown) && !hidden.is_same(&other.recorded(false)));
        assert_eq!(hidden.values_digest.as_ref().map(String::len), Some(2 * DIGEST_BYTES));
        assert!(GivenEnvironment::default().recorded(true).is_empty());
    }

    #[test]
    fn a_side_that_is_given_anything_has_compiled_shaders_of_its_own() {
        let plain = GivenEnvironment::default();
        assert!(shader_cache(&plain).unwrap().is_none());
        assert_eq!(cache_variables(&plain, None).count(), 0);
        let given = environment(Side::Base, &["MESA_SHADER_CACHE_DIR=/mine".into()], None).unwrap();
        let [own, other] = [&given, &given].map(|given| shader_cache(given).unwrap().unwrap());
        assert_ne!(own.path(), other.path());
        let set: Vec<_> = cache_variables(&given, Some(own.path())).collect();
        let expected = ["__GL_SHADER_DISK_CACHE_PATH", "AMD_SHADER_DISK_CACHE_PATH"];
        assert_eq!(set, expected.map(|name| (name, own.path())), "the user's own value holds");
    }

    #[test]
    fn a_manifest_names_its_library_as_the_loader_reads_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("icd.json");
        let library = folder.path().join("libdriver.so");
        std::fs::write(&library, "driver").unwrap();
        let write = |library: &str| {
            let text = format!(
                r#"{{"file_format_version": "1.0.0", "ICD": {{"library_path": {library:?}, "api_version": "1.3"}}}}"#
            );
            std::fs::write(&path, text).unwrap();
        };
        for written in ["./libdriver.so", library.to_str().unwrap()] {
            write(written);
            let driver = named(&path).unwrap();
            assert!(Path::new(&driver.library).is_absolute());
            assert_eq!(driver.digest, std::fs::File::open(&library).and_then(input::sha256).ok());
            assert_eq!(std::fs::read(&driver.library).unwrap(), b"driver");
        }
        write("libdriver.so");
        let linked = named(&path).unwrap();
        assert_eq!((linked.library.as_str(), linked.digest), ("libdriver.so", None));
        let given = GivenEnvironment { driver: Some(named(&path).unwrap()), ..Default::default() };
        let set: Vec<_> = variables(&given).collect();
        assert_eq!(set, DRIVER_VARIABLES.map(|name| (name, path.to_str().unwrap())));
    }

    #[test]
    fn what_is_no_manifest_or_lacks_its_library_is_refused_in_one_line() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            let path = folder.path().join(name);
            std::fs::write(&path, text).unwrap();
            path
        };
        for (path, reason) in [
            (folder.path().join("absent.json"), "No such file"),
            (folder.path().to_owned(), "it is a folder"),
            (write("text.json", "driver"), "no manifest of a Vulkan driver"),
            (write("layer.json", r#"{"layer": {"library_path": "x"}}"#), "missing field `ICD`"),
            (write("gone.json", r#"{"ICD": {"library_path": "./gone.so"}}"#), "gone.so"),
            (write("zero.json", r#"{"ICD": {"library_path": "/dev/zero"}}"#), "or a device"),
            (write("a:b.json", r#"{"ICD": {"library_path": "x.so"}}"#), "takes `:` in a path"),
        ] {
            let error = environment(Side::Base, &[], Some(&path)).unwrap_err().to_string();
            assert!(error.starts_with("--base-driver ") && error.contains(reason), "{error}");
            assert_eq!(error.lines().count(), 1, "{error}");
        }
    }

    #[test]
    fn an_adapter_of_another_interface_is_not_the_drivers() {
        let driver = NamedDriver { manifest: "/m.json".into(), ..NamedDriver::default() };
        let given = GivenEnvironment { driver: Some(driver), ..GivenEnvironment::default() };
        let on = |backend: &str| Adapter { backend: backend.to_owned(), ..Adapter::default() };
        assert!(check(Side::Head, &given, &on("vulkan")).is_ok());
        let error = check(Side::Head, &given, &on("gl")).unwrap_err().to_string();
        assert!(error.starts_with("--head-driver /m.json: it gives no Vulkan adapter"), "{error}");
        assert!(check(Side::Head, &GivenEnvironment::default(), &on("gl")).is_ok());
    }
}
