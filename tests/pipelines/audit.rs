//! The clock's audit on two software drivers, lavapipe and SwiftShader. What it finds depends on what else the machine does, so
//! what is tested here is that its verdicts follow from its figures and its plan from its verdicts. Which verdict a wrong or a
//! right clock gets is tested on modelled ones (`gpu::audit`).

use std::path::PathBuf;

use fathom::gpu::{Gpu, Options, audit, audit_table};
use fathom::record::{AuditRow, Clock, PassKind};

const RESULT: &str = "audit result: ";

/// What is found: the clocks are those of [`KINDS`].
type AuditResult = (Vec<AuditRow>, [Clock; 3]);

const KINDS: [PassKind; 3] = [PassKind::Compute, PassKind::Render, PassKind::Copy];

/// Audits the only adapter that the environment leaves, and prints what it found.
#[test]
#[ignore = "run by the other tests, in a process with the driver chosen"]
fn child() {
    let gpu = Gpu::open(&Options::default()).expect("the driver opens");
    let audit = audit(&gpu).expect("the audit runs");
    println!("{}", audit_table(&audit));
    let found: AuditResult = (audit.rows, KINDS.map(|kind| audit.plan.clock(kind)));
    println!("{RESULT}{}", serde_json::to_string(&found).expect("it is plain data"));
}

/// The driver manifest in `folder` whose name has this prefix.
fn manifest(folder: &str, prefix: &str) -> PathBuf {
    let mut paths = std::fs::read_dir(folder).unwrap().flatten().map(|file| file.path());
    let found = paths.find(|path| {
        path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix))
    });
    found.unwrap_or_else(|| panic!("no {prefix}*.json in {folder}"))
}

/// Far from 1, whatever the surrounding: the audit's tolerances are 1.15 and 1.25.
const WRONG: f64 = 1.3;

/// No clock is used that is far from the host's, and each that is sound in both surroundings is used.
#[track_caller]
fn agrees_with_itself(folder: &str, prefix: &str) {
    let text = super::child("audit::child", &manifest(folder, prefix));
    println!("{text}");
    let line = text.lines().find_map(|line| line.strip_prefix(RESULT)).unwrap();
    let (found, clocks): AuditResult = serde_json::from_str(line).unwrap();
    for (kind, clock) in KINDS.into_iter().zip(clocks) {
        let rows: Vec<&AuditRow> = found.iter().filter(|row| row.pass == kind).collect();
        let [a, b] = rows[..] else { panic!("{rows:?}") };
        assert_ne!(a.context, b.context);
        let sound = a.sound && b.sound;
        assert_eq!(clock, if sound { Clock::Timestamp } else { Clock::FencedHost }, "{rows:?}");
        for row in [a, b] {
            assert!(!row.reason.is_empty());
            assert!(!row.sound || row.ratio.max(row.ratio.recip()) < WRONG, "{row:?}");
            assert_eq!(row.sound, row.reason.starts_with("agrees with the host clock"), "{row:?}");
        }
    }
    assert_eq!(found.len(), 2 * KINDS.len());
}

#[test]
fn an_audit_of_lavapipe_agrees_with_itself() {
    agrees_with_itself("/usr/share/vulkan/icd.d", "lvp_icd");
}

#[test]
fn an_audit_of_swiftshader_agrees_with_itself() {
    agrees_with_itself("/usr/lib/chromium", "vk_swiftshader_icd");
}
