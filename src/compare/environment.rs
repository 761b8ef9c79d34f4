//! Variables that the processes of one side are given and those of the other are not.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use sha2::{Digest, Sha256};
use tempfile::TempDir;

use fathom_base::quiet;
use fathom_record::comparison::{Side, SideEnvironment};

/// Values by name.
pub type Environment = BTreeMap<String, String>;

/// Variables with the folder in which a driver keeps compiled shaders: Mesa's (Mesa, *Environment Variables*), NVIDIA's (driver README,
/// "Specifying OpenGL Environment Variable Settings") and AMDVLK's. What was compiled in one environment may be wrong in another: Mesa
/// 22.3's lavapipe takes shaders from there that were compiled for another LP_NATIVE_VECTOR_WIDTH, and crashes.
const SHADER_CACHES: [&str; 3] =
    ["MESA_SHADER_CACHE_DIR", "__GL_SHADER_DISK_CACHE_PATH", "AMD_SHADER_DISK_CACHE_PATH"];

/// Bytes of [`SideEnvironment::values_digest`].
const DIGEST_BYTES: usize = 2;

/// A side's environment from what the command line says of it.
///
/// # Errors
/// A variable that cannot be set or that fathom sets itself.
pub fn parse(side: Side, variables: &[String]) -> Result<Environment> {
    let mut known = BTreeMap::new();
    for text in variables {
        let the = format!("the {side}'s variable");
        let Some((name, value)) = text.split_once('=') else {
            bail!("{the} {text:?} has no value: give NAME=VALUE");
        };
        ensure!(!name.is_empty(), "{the} has no name");
        ensure!(
            !quiet::is_own(name),
            "{the} {name} is fathom's own: it sets the conditions of every worker"
        );
        let first = known.insert(name.to_owned(), value.to_owned()).is_none();
        ensure!(first, "{the} {name} is given twice");
    }
    Ok(known)
}

/// What records say of it. Values may be secret: they stand there only where the user asks for them.
pub fn recorded(environment: &Environment, values: bool) -> SideEnvironment {
    let mut sum = Sha256::new();
    for (name, value) in environment {
        sum.update(format!("{name}={value}\0"));
    }
    let digest = hex::encode(&sum.finalize()[..DIGEST_BYTES]);
    let shown = |(name, value): (&String, &String)| (name.clone(), values.then(|| value.clone()));
    SideEnvironment {
        variables: environment.iter().map(shown).collect(),
        values_digest: (!environment.is_empty()).then_some(digest),
    }
}

/// An empty folder for the compiled shaders of a side that is given anything; it goes when this is dropped.
pub fn shader_cache(environment: &Environment) -> Result<Option<TempDir>> {
    let folder = || tempfile::Builder::new().prefix("fathom-shaders-").tempdir();
    let made = (!environment.is_empty()).then(folder).transpose();
    made.context("cannot make a folder for compiled shaders")
}

/// The variables that send a side's driver to a folder for compiled shaders, those apart that the user has set.
pub fn cache_variables<'a>(
    environment: &'a Environment,
    folder: Option<&'a Path>,
) -> impl Iterator<Item = (&'static str, &'a Path)> {
    let names = SHADER_CACHES.into_iter().filter(|name| !environment.contains_key(*name));
    folder.into_iter().flat_map(move |folder| names.clone().map(move |name| (name, folder)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variables_are_split_at_the_first_sign_and_checked() {
        let known = parse(Side::Base, &["A=1=2".to_owned(), "EMPTY=".to_owned()]).unwrap();
        assert_eq!(
            known,
            [("A", "1=2"), ("EMPTY", "")].map(|(a, b)| (a.to_owned(), b.to_owned())).into()
        );
        for (variables, reason) in [
            (&["A"][..], "the head's variable \"A\" has no value"),
            (&["=1"], "the head's variable has no name"),
            (&["A=1", "A=2"], "A is given twice"),
            (&["LP_NUM_THREADS=4"], "LP_NUM_THREADS is fathom's own"),
            (&["GLIBC_TUNABLES=x"], "GLIBC_TUNABLES is fathom's own"),
            (&["FATHOM_PADDING=x"], "FATHOM_PADDING is fathom's own"),
        ] {
            let variables: Vec<String> = variables.iter().map(|text| (*text).to_owned()).collect();
            let error = parse(Side::Head, &variables).unwrap_err().to_string();
            assert!(error.contains(reason) && error.lines().count() == 1, "{error}");
        }
    }

    #[test]
    fn values_are_recorded_only_on_request_and_others_are_told_apart_without_them() {
        let [mine, other] = ["TOKEN=secret", "TOKEN=another"]
            .map(|text| parse(Side::Base, &[text.to_owned()]).unwrap());
        let [hidden, shown] = [false, true].map(|values| recorded(&mine, values));
        assert!(!serde_json::to_string(&hidden).unwrap().contains("secret"));
        assert_eq!(shown.variables["TOKEN"].as_deref(), Some("secret"));
        assert_eq!(hidden.values_digest, shown.values_digest);
        assert_ne!(hidden.values_digest, recorded(&other, false).values_digest);
        assert_eq!(hidden.values_digest.as_ref().map(String::len), Some(2 * DIGEST_BYTES));
        assert!(recorded(&Environment::new(), true).is_empty());
    }

    #[test]
    fn a_side_that_is_given_anything_has_compiled_shaders_of_its_own() {
        assert!(shader_cache(&Environment::new()).unwrap().is_none());
        let given = parse(Side::Base, &["MESA_SHADER_CACHE_DIR=/mine".into()]).unwrap();
        let [own, other] = [&given, &given].map(|given| shader_cache(given).unwrap().unwrap());
        assert_ne!(own.path(), other.path());
        let set: Vec<_> = cache_variables(&given, Some(own.path())).collect();
        let expected = ["__GL_SHADER_DISK_CACHE_PATH", "AMD_SHADER_DISK_CACHE_PATH"];
        assert_eq!(set, expected.map(|name| (name, own.path())), "the user's own value holds");
    }
}
