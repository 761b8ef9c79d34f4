//! The clock's audit on two software drivers: Mesa 22.3 lavapipe, whose compute timestamps are wrong beside
//! render passes, and SwiftShader, whose timestamps are right.
//!
//! The loader chooses a driver once per process, so each test runs `child` in a process of its own.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;

use fathom::gpu::{Audit, ClockPlan, Gpu, Options, audit, audit_table};
use fathom::record::{Adapter, AuditRow, Clock, PassKind, Surrounding};
use serde::{Deserialize, Serialize};

/// Two audits at once would disturb each other.
static ONE_AT_A_TIME: Mutex<()> = Mutex::new(());
const RESULT: &str = "audit result: ";

#[derive(Serialize, Deserialize)]
struct Found {
    adapter: Adapter,
    rows: Vec<AuditRow>,
    clocks: [Clock; 3],
}

/// Audits the only adapter that the environment leaves, and prints what it found.
#[test]
#[ignore = "run by the other tests, in a process with the driver chosen"]
fn child() {
    let gpu = Gpu::open(&Options::default()).expect("the driver opens");
    let Audit { rows, plan } = audit(&gpu).expect("the audit runs");
    println!("{}", audit_table(&Audit { rows: rows.clone(), plan }));
    let ClockPlan { compute, render, copy, .. } = plan;
    let found = Found { adapter: gpu.adapter, rows, clocks: [compute, render, copy] };
    println!("{RESULT}{}", serde_json::to_string(&found).expect("it is plain data"));
}

fn audit_on(manifest: &Path) -> Found {
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
    let output = Command::new(std::env::current_exe().expect("a test knows its path"))
        .args(["--exact", "child", "--ignored", "--nocapture"])
        .env("VK_DRIVER_FILES", manifest)
        .env("VK_ICD_FILENAMES", manifest)
        .env("WGPU_BACKEND", "vulkan")
        .env_remove("WGPU_ADAPTER_NAME")
        .output()
        .expect("the child runs");
    let text = String::from_utf8_lossy(&output.stdout);
    println!("{text}");
    let line = text.lines().find_map(|line| line.strip_prefix(RESULT));
    let line = line.unwrap_or_else(|| panic!("{}", String::from_utf8_lossy(&output.stderr)));
    serde_json::from_str(line).expect("the child prints its result")
}

/// The driver manifest in `folder` whose name has this prefix, or a printed reason to skip.
fn manifest(folder: &str, prefix: &str) -> Option<PathBuf> {
    let files = std::fs::read_dir(folder).ok().into_iter().flatten().flatten();
    let mut paths = files.map(|file| file.path());
    let found = paths.find(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix))
    });
    if found.is_none() {
        println!("skipped: no {prefix}*.json in {folder}");
    }
    found
}

fn row(found: &Found, pass: PassKind, context: Surrounding) -> &AuditRow {
    let mut rows = found.rows.iter();
    rows.find(|row| row.pass == pass && row.context == context).expect("every kind has its rows")
}

#[test]
fn lavapipe_compute_beside_render_passes_is_unusable() {
    let Some(manifest) = manifest("/usr/share/vulkan/icd.d", "lvp_icd") else { return };
    let found = audit_on(&manifest);
    assert_eq!(found.rows.len(), 6);
    if !found.adapter.driver_info.contains("Mesa 22.3") {
        println!("skipped: the fault is of Mesa 22.3, this is {}", found.adapter.driver_info);
        return;
    }
    // A busy machine can hide the fault in one surrounding.
    let rows = [Surrounding::Alone, Surrounding::Mixed]
        .map(|context| row(&found, PassKind::Compute, context));
    let caught = rows.iter().any(|row| !row.sound && row.ratio < 0.8);
    assert!(caught, "{rows:?}");
    assert_eq!(found.clocks[0], Clock::FencedHost, "{rows:?}");
}

/// A busy machine can make an audit doubt a good clock, and then nothing worse happens than the fenced host
/// clock; so the verdict may come with the second or third try.
#[test]
fn swiftshader_timestamps_are_sound() {
    let Some(manifest) = manifest("/usr/lib/chromium", "vk_swiftshader_icd") else { return };
    let tries = std::iter::repeat_with(|| audit_on(&manifest)).take(3);
    let believed = |found: &Found| {
        found.clocks[..2] == [Clock::Timestamp; 2]
            && row(found, PassKind::Compute, Surrounding::Alone).sound
            && row(found, PassKind::Compute, Surrounding::Mixed).sound
    };
    assert!(tries.into_iter().any(|found| believed(&found)), "no audit in three found it sound");
}
