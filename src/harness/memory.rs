//! The process's own memory.

/// The most memory this process has held at any time, in bytes; known on Linux only. On a software
/// driver it includes all GPU memory.
#[cfg(target_os = "linux")]
pub fn peak_bytes() -> Option<u64> {
    let status = procfs::process::Process::myself().and_then(|process| process.status());
    status.ok()?.vmhwm?.checked_mul(1024)
}

#[cfg(not(target_os = "linux"))]
pub fn peak_bytes() -> Option<u64> {
    None
}

#[cfg(target_os = "linux")]
#[test]
fn what_was_held_counts_after_it_is_given_back() {
    let before = peak_bytes().unwrap();
    drop(std::hint::black_box(vec![1u8; 64 << 20]));
    assert!(peak_bytes().unwrap() >= before.max(64 << 20));
}
