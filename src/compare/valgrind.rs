//! What a process can tell the valgrind that runs it.
//!
//! A client request is a sequence of instructions that does nothing on a real processor (`valgrind.h`, "Client request
//! mechanism"): rotations that add up to whole turns, and an exchange of a register with itself.

/// This build can start the counting itself.
pub const SUPPORTED: bool =
    cfg!(all(target_os = "linux", any(target_arch = "x86_64", target_arch = "aarch64")));

/// `callgrind.h`: the tool's base, the letters C and T, and the second and fifth of its requests.
const CALLGRIND_BASE: usize = (b'C' as usize) << 24 | (b'T' as usize) << 16;
const CALLGRIND_ZERO_STATS: usize = CALLGRIND_BASE + 1;
const CALLGRIND_START_INSTRUMENTATION: usize = CALLGRIND_BASE + 4;

/// Starts callgrind's counting where it was held back with `--instr-atstart=no`, which spares the slow counting of a
/// start-up. Does nothing outside valgrind.
pub fn start_counting() {
    request(CALLGRIND_START_INSTRUMENTATION);
}

/// Discards what was counted since the last cut. Does nothing outside valgrind.
pub fn forget_counts() {
    request(CALLGRIND_ZERO_STATS);
}

fn request(request: usize) {
    let _words = [request, 0, 0, 0, 0, 0];
    #[cfg(all(target_os = "linux", target_arch = "x86_64"))]
    // SAFETY: rdi ends as it began, after 3 + 13 + 61 + 51 = 128 bits of rotation, and the exchange changes nothing;
    // valgrind reads `_words` and writes rdx.
    unsafe {
        std::arch::asm!(
            "rol rdi, 3",
            "rol rdi, 13",
            "rol rdi, 61",
            "rol rdi, 51",
            "xchg rbx, rbx",
            in("rax") _words.as_ptr(),
            inout("rdx") 0usize => _,
            out("rdi") _,
            options(nostack),
        );
    }
    #[cfg(all(target_os = "linux", target_arch = "aarch64"))]
    // SAFETY: x12 ends as it began, after 3 + 13 + 51 + 61 = 128 bits of rotation, and the last instruction changes
    // nothing; valgrind reads `_words` and writes x3.
    unsafe {
        std::arch::asm!(
            "ror x12, x12, #3",
            "ror x12, x12, #13",
            "ror x12, x12, #51",
            "ror x12, x12, #61",
            "orr x10, x10, x10",
            in("x4") _words.as_ptr(),
            inout("x3") 0usize => _,
            out("x12") _,
            options(nostack),
        );
    }
}
