//! Traced effects, by `effects.toml`: a small frame of a pipeline, judged as in a run, by the pipeline's own `judge`.

use std::collections::BTreeMap;
use std::sync::Arc;

use serde::Deserialize;
use serde_json::Value;

use crate::prelude::*;
use fathom_pipelines::{AnyPipeline, Judge, KINDS, PipelineKind, ReferenceCache, draw};
use fathom_stages::REGISTRY;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Effects {
    /// What is set in all cases of a pipeline.
    common: BTreeMap<String, String>,
    /// The last stage of a frame that is run to check a stage; else it is the stage itself.
    last: BTreeMap<String, String>,
    /// Texts of scene files.
    scene: BTreeMap<String, String>,
    case: Vec<Effect>,
}

/// Settings are `path=value` and separated by spaces. A path leads into the scene file or else into the pipeline's parameters.
#[derive(Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Effect {
    /// Stage, pipeline and scene.
    of: String,
    what: String,
    set: String,
    /// Error or quantity of the frame, or its distance from a value as `name=value`; what it is at most; and what is set in the control: in the
    /// reference's scene alone, or, where that has no such value, in the frame alone.
    checks: Vec<(String, f64, String)>,
    /// How often what is set is drawn, from [`SEED`] on: see [`draw::text`].
    #[serde(default)]
    draws: u32,
}

const SEED: u32 = 65;

type CaseSettings = Vec<(String, Value)>;

pub fn cases() -> Vec<Case> {
    let effects: Effects = toml::from_str(include_str!("effects.toml")).expect("a table of cases");
    let Effects { common, last, scene, case: all } = effects;
    let case = |effect: Effect| {
        let names: Vec<&str> = effect.of.split(' ').collect();
        let stage = REGISTRY.iter().find(|info| info.name == names[0]).expect("a stage");
        let kind = *KINDS.iter().find(|kind| kind.name == names[1]).expect("a pipeline");
        let scene = scene.get(names[2]).cloned().unwrap_or(format!("base = \"{}\"", names[2]));
        let common = common.get(names[1]).cloned().unwrap_or_default();
        let last = last.get(names[0]).cloned().unwrap_or(names[0].to_owned());
        let (what, judged) =
            (effect.what.clone(), EffectCase { kind, scene, common, last, effect });
        Case::new(stage.name, what, move |rig| judged.checks(rig))
    };
    all.into_iter().map(case).collect()
}

struct EffectCase {
    kind: PipelineKind,
    scene: String,
    common: String,
    last: String,
    effect: Effect,
}

impl EffectCase {
    /// Of each check the draw that measured most, and the control that differs least: all draws must be sound.
    fn checks(&self, rig: &Rig<'_>) -> Checks {
        let mut random = Random::new(SEED);
        let mut draw = || self.drawn(rig, &draw::text(&self.effect.set, &mut random));
        let mut all = draw()?;
        for _ in 1..self.effect.draws {
            for (worst, other) in all.iter_mut().zip(draw()?) {
                worst.passed &= other.passed;
                worst.control.has_failed &= other.control.has_failed;
                worst.measured = worst.measured.max(other.measured);
                worst.control.measured = worst.control.measured.min(other.control.measured);
            }
        }
        Ok(all)
    }

    fn drawn(&self, rig: &Rig<'_>, set: &str) -> Checks {
        let Effect { what, checks, draws, .. } = &self.effect;
        let (file, settings) = self.file(rig, set)?;
        let scene = Arc::new(Scene::build(&file)?);
        let frame = self.frame(rig, (&file, &scene), &settings)?;
        let mut known = BTreeMap::from([("", figures(rig, &frame, &scene)?)]);
        for (.., control) in checks {
            let (other, with_control) = self.file(rig, &format!("{set} {control}"))?;
            let figures = if known.contains_key(control.as_str()) {
                continue;
            } else if with_control.len() == settings.len() {
                figures(rig, &frame, &Arc::new(Scene::build(&other)?))?
            } else {
                figures(rig, &self.frame(rig, (&file, &scene), &with_control)?, &scene)?
            };
            known.insert(control, figures);
        }
        let check = |(error, max, control): &(String, f64, String)| {
            let (name, stored) = error.split_once('=').unwrap_or((error, ""));
            let of = |set: &str| {
                let found = known[set].get(name).copied().unwrap_or(f64::NAN);
                stored.parse().map_or(found, |stored: f64| (found - stored).abs())
            };
            let unit = ["m", "deg"].into_iter().find(|unit| name.ends_with(&format!("_{unit}")));
            let seed = if *draws > 0 { format!(", seed {SEED}") } else { String::new() };
            Check::new(rig, format!("{what}{seed}: {error}"))
                .within((*max, unit.unwrap_or("1")), of(""))
                .control(control, of(control))
        };
        Ok(checks.iter().map(check).collect())
    }

    /// The scene's file with what is set in it, and what is set elsewhere.
    fn file(&self, rig: &Rig<'_>, set: &str) -> Result<(SceneFile, CaseSettings)> {
        let base = SceneFile::parse("effects", &self.scene)?;
        let mut tree = serde_json::to_value(&base).map_err(|error| rig.invalid(&error))?;
        let words = self.common.split(' ').chain(set.split(' '));
        let settings = words.filter_map(|setting| setting.split_once('=')).map(|(path, value)| {
            (path.to_owned(), serde_json::from_str(value).unwrap_or_else(|_| value.into()))
        });
        let rest = settings.filter(|(path, value)| !set_value(&mut tree, path, value)).collect();
        let file = SceneFile::deserialize(&tree).map_err(|error| rig.invalid(&error))?;
        Ok((SceneFile { folder: base.folder, ..file }, rest))
    }

    /// A frame that has run twice.
    fn frame(
        &self,
        rig: &Rig<'_>,
        (file, scene): (&SceneFile, &Scene),
        settings: &CaseSettings,
    ) -> Result<Box<AnyPipeline>> {
        let mut tree = (self.kind.defaults)(file);
        for (path, value) in settings {
            if !set_value(&mut tree, path, value) {
                let unknown = format!("neither scene nor pipeline has `{path}`");
                return Err(rig.invalid(&unknown));
            }
        }
        let tree = (self.kind.checked)(&tree).map_err(|error| rig.invalid(&error))?;
        let frame = (self.kind.build)(&tree, rig.gpu, scene)?;
        // Twice: a frame must not add to the one before.
        rig.run_until(&frame, &self.last)?;
        rig.run_until(&frame, &self.last)?;
        Ok(frame)
    }
}

/// Sets a value of a tree, or multiplies it where `*` ends the path; false where it has none there.
fn set_value(tree: &mut Value, path: &str, value: &Value) -> bool {
    let pointer = format!("/{}", path.trim_end_matches('*').replace('.', "/"));
    let Some(there) = tree.pointer_mut(&pointer) else { return false };
    let product = there.as_f64().zip(value.as_f64()).map(|(there, factor)| there * factor);
    *there = product.filter(|_| path.ends_with('*')).map_or(value.clone(), Value::from);
    true
}

/// Errors and quantities of a frame, judged by a scene.
fn figures(
    rig: &Rig<'_>,
    frame: &AnyPipeline,
    scene: &Arc<Scene>,
) -> Result<BTreeMap<String, f64>> {
    let known = ReferenceCache::default();
    let judge = frame.judge(rig.gpu, &[])?;
    let judged = judge(&Judge::new(scene, &known)).map_err(|error| rig.invalid(&error))?;
    let errors = judged.errors.into_iter().map(|error| (error.name, error.value));
    Ok(errors.chain(judged.quantities).chain(frame.all_quantities(rig.gpu)?).collect())
}
