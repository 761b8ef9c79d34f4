//! Vulkan's rules as the Khronos validation layer checks them, with synchronization and best practices: over the checks of all
//! stages, one frame of every gate configuration, the audit and the limits. The table in
//! `validation.md` lists what the layer may report.

use std::collections::BTreeSet;

use fathom::Catalog;
use fathom::compare::cells::Gates;
use fathom::gpu::{audit, ceilings, measure_loop_turns};
use fathom::harness::render::frame;
use fathom::harness::subject::Subjects;
use fathom::harness::verify::{FinishedCase, verify};
use itertools::Itertools as _;
use wgpu::hal::api::Vulkan;

use super::common::variants::unplanned;
use super::common::{CommandOutput, Place};
use super::{gpu, this_program};

const LAYER: &str = "VK_LAYER_KHRONOS_validation";
/// Without a limit on repeated messages: it counts by kind, so that a listed message would hide others of its kind.
const SETTINGS: &str = "\
khronos_validation.enables = VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT,VK_VALIDATION_FEATURE_ENABLE_BEST_PRACTICES_EXT
khronos_validation.debug_action = VK_DBG_LAYER_ACTION_LOG_MSG
khronos_validation.report_flags = error,warn,perf
khronos_validation.enable_message_limit = false
khronos_validation.log_filename = stdout
";
/// How a line of the layer begins behind its own mark.
const SEVERITIES: [&str; 3] =
    ["Validation Error: [ ", "Validation Warning: [ ", "Validation Performance Warning: [ "];
/// How the line of a test begins that names the work whose messages stand before it.
const DONE: &str = "done: ";

/// What the layer reported.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Message {
    id: String,
    text: String,
    /// The work during which it came.
    place: String,
}

/// Of each row of the documented table the message's name and a part of its text.
fn listed() -> Vec<(&'static str, &'static str)> {
    let document = include_str!("validation.md");
    let rows = document.lines().filter_map(|line| line.strip_prefix("| `")?.split_once("` | `"));
    rows.filter_map(|(id, rest)| Some((id, rest.split_once("` | ")?.0))).collect()
}

fn messages(output: &str) -> Vec<Message> {
    let (mut placed, mut open) = (Vec::new(), Vec::new());
    for line in output.lines() {
        let begin = SEVERITIES.iter().find_map(|severity| line.split_once(severity));
        if let Some((id, text)) = begin.and_then(|(_, rest)| rest.split_once(" ]")) {
            open.push(Message { id: id.to_owned(), text: text.to_owned(), place: String::new() });
        } else if let Some(place) = line.strip_prefix(DONE) {
            open.iter_mut().for_each(|message| place.clone_into(&mut message.place));
            placed.append(&mut open);
        } else if let Some(message) = open.last_mut() {
            message.text += line;
        }
    }
    placed.extend(open);
    placed
}

/// Runs an ignored test of this program under the layer; it must end well.
#[track_caller]
fn under_layer(test: &str) -> Vec<Message> {
    let place = Place::new();
    place.write("vk_layer_settings.txt", SETTINGS);
    let mut child = this_program(test);
    child.env("VK_INSTANCE_LAYERS", LAYER).env("VK_LAYER_SETTINGS_PATH", place.path(""));
    messages(&CommandOutput::check(child.env("WGPU_BACKEND", "vulkan").output().unwrap(), 0).out)
}

/// Those that are not listed. Says how often each of the others came.
fn unlisted(messages: Vec<Message>) -> BTreeSet<Message> {
    let listed = listed();
    let is_listed = |message: &Message| {
        listed.iter().any(|(id, text)| *id == message.id && message.text.contains(text))
    };
    let (known, unlisted): (Vec<_>, Vec<_>) = messages.into_iter().partition(is_listed);
    println!("listed messages: {:?}", known.iter().counts_by(|message| &message.id));
    unlisted.into_iter().collect()
}

/// Runs these ignored tests of this program under the layer. It may report what is listed and nothing else.
#[track_caller]
fn keep_the_rules(tests: &[&str]) {
    let unlisted = unlisted(tests.iter().flat_map(|test| under_layer(test)).collect());
    let help = "mend it, or list it with its reason in tests/nightly/validation.md";
    assert!(unlisted.is_empty(), "{} messages: {help}: {unlisted:#?}", unlisted.len());
}

#[test]
fn gate_frames_audit_and_limits_keep_the_rules() {
    keep_the_rules(&["validation::child_gate_frames", "validation::child_audit_and_limits"]);
}

/// The layer reports what breaks a rule of Vulkan and what lacks a barrier, and neither is listed. Without the layer it would report nothing.
#[test]
fn misuse_is_reported_and_not_listed() {
    let found = unlisted(under_layer("validation::child_misuse"));
    let found: Vec<_> =
        found.iter().map(|message| (message.id.as_str(), message.place.as_str())).collect();
    let ids = ["SYNC-HAZARD-WRITE-AFTER-WRITE", "VUID-vkCmdFillBuffer-dstOffset-00025"];
    assert_eq!(found, ids.map(|id| (id, "misuse")));
}

/// All checks of `fathom verify`.
#[test]
fn checks_keep_the_rules() {
    keep_the_rules(&["validation::child_checks"]);
}

#[test]
#[ignore = "run under the layer by `checks_keep_the_rules`"]
fn child_checks() {
    println!();
    let done = |case: FinishedCase<'_>| println!("{DONE}{case}");
    verify(&gpu(), &Catalog::builtin().cases(), None, done).expect("all cases run");
}

#[test]
#[ignore = "run under the layer by `gate_frames_audit_and_limits_keep_the_rules`"]
fn child_audit_and_limits() {
    let gpu = gpu();
    println!();
    let plan = audit(&gpu).unwrap().plan;
    println!("{DONE}audit");
    measure_loop_turns(&gpu).unwrap();
    ceilings(&gpu, plan).unwrap();
    println!("{DONE}limits");
    let unlisted = &gpu.shader_variants() - &unplanned();
    assert!(unlisted.is_empty(), "add to common::variants, for Tint: {unlisted:?}");
}

#[test]
#[ignore = "run under the layer by `gate_frames_audit_and_limits_keep_the_rules`"]
fn child_gate_frames() {
    let (gpu, catalog) = (gpu(), Catalog::builtin());
    let mut subjects = Subjects::new(&catalog).silent();
    println!();
    for cell in Gates::load(None, catalog.gates).unwrap().configurations {
        let params: Vec<_> = cell.params.into_iter().collect();
        let subject = subjects.subject(&cell.pipeline, &cell.scene, &params).unwrap();
        frame(&gpu, &subject).unwrap();
        println!("{DONE}{}", cell.id);
    }
}

/// Fills a buffer at an odd offset, and twice without a barrier between.
#[test]
#[ignore = "run under the layer by `misuse_is_reported_and_not_listed`"]
fn child_misuse() {
    let gpu = gpu();
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 64,
        usage: wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    println!();
    // SAFETY: nothing of wgpu is destroyed. What is recorded breaks Vulkan's rules on purpose, and is never submitted.
    unsafe {
        let device = gpu.device.as_hal::<Vulkan>().unwrap();
        let raw = buffer.as_hal::<Vulkan>().unwrap().raw_handle();
        encoder.as_hal_mut::<Vulkan, _, _>(|encoder| {
            let commands = encoder.unwrap().raw_handle();
            device.raw_device().cmd_fill_buffer(commands, raw, 2, 4, 1);
            device.raw_device().cmd_fill_buffer(commands, raw, 32, 16, 1);
            device.raw_device().cmd_fill_buffer(commands, raw, 32, 16, 2);
        });
    }
    println!("{DONE}misuse");
}
