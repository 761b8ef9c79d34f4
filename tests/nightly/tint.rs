//! A second compiler: Tint, Chromium's, takes every shader that fathom can link.

use std::collections::{BTreeMap, BTreeSet};

use fathom::Catalog;
use fathom::embedded::{Folders, SHADERS};
use fathom::gpu::{CodeKey, link, text};
use fathom::harness::verify::verify;
use serde_json::{Value, json};

use crate::common::Place;
use crate::common::variants::planned;
use crate::gpu;
use crate::page::browser::{Browser, WIDE};

/// Shaders that are given to the browser in one script.
const BATCH: usize = 64;
/// What Tint must refuse and naga does not: an error of its grammar, and a derivative where control flow is not uniform.
const REFUSED: [&str; 2] = [
    "fn main( {}",
    "@group(0) @binding(0) var image: texture_2d<f32>; @group(0) @binding(1) var filtering: sampler;
     @fragment fn main(@location(0) at: vec2f) -> @location(0) vec4f {
       if at.x > 0.5 { return textureSample(image, filtering, at); }
       return vec4f();
     }",
];

#[test]
fn tint_takes_every_shader() {
    let browser = Browser::open();
    let place = Place::new();
    browser.show(&place.write("page.html", "<!doctype html><title>shaders</title>"), WIDE);
    let mut texts = BTreeMap::<String, BTreeSet<CodeKey>>::new();
    // What only checks link is known once they have run.
    let gpu = gpu();
    verify(&gpu, &Catalog::builtin().cases(), None, |_| ()).unwrap();
    for key in planned().into_iter().chain(gpu.shader_variants()) {
        texts.entry(linked(&key)).or_default().insert(key);
    }
    println!("{} shaders", texts.len());
    let (codes, keys): (Vec<_>, Vec<_>) = texts.into_iter().unzip();
    let found = codes.chunks(BATCH).flat_map(|batch| errors(&browser, batch));
    let refused: Vec<_> = keys.iter().zip(found).filter(|(_, errors)| !errors.is_empty()).collect();
    assert!(refused.is_empty(), "{} shaders are refused: {refused:#?}", refused.len());
    let refused = errors(&browser, &REFUSED.map(str::to_owned));
    assert!(refused.iter().all(|errors| !errors.is_empty()), "{refused:?}");
    browser.close();
}

/// The text of what naga_oil links, which fathom hands to wgpu.
fn linked(key: &CodeKey) -> String {
    let defs: Vec<(&str, i32)> =
        key.defs.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    let module = link(&Folders::new(SHADERS), &key.path, &defs).unwrap();
    text(&key.path, &module).unwrap()
}

/// Errors of each shader by Tint, on a device with all that its adapter has.
fn errors(browser: &Browser, shaders: &[String]) -> Vec<Vec<String>> {
    let script = format!(
        "const done = arguments[arguments.length - 1];
         const errors = async (device, code) => {{
           const {{ messages }} = await device.createShaderModule({{ code }}).getCompilationInfo();
           return messages.filter(({{ type }}) => type === 'error')
             .map((error) => `${{error.message}}: ${{code.split('\\n')[error.lineNum - 1]}}`);
         }};
         const all = async () => {{
           const adapter = await navigator.gpu.requestAdapter();
           const device = await adapter.requestDevice({{ requiredFeatures: [...adapter.features] }});
           return Promise.all({}.map((code) => errors(device, code)));
         }};
         all().then(done, (error) => done(String(error)));",
        json!(shaders)
    );
    let answer: Value = browser.eval_later(&script);
    serde_json::from_value(answer.clone()).unwrap_or_else(|_| panic!("{answer}"))
}
