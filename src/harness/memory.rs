//! The process's own memory.

/// The most memory this process has held at any time, in bytes; known on Linux only. On a software
/// driver it includes all GPU memory.
pub fn peak_bytes() -> Option<u64> {
    parse_peak(&std::fs::read_to_string("/proc/self/status").ok()?)
}

/// The `VmHWM` line, in KiB.
fn parse_peak(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    kibibytes.checked_mul(1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peak_is_read_from_its_line() {
        let status = "Name:\tfathom\nVmPeak:\t  900 kB\nVmHWM:\t   1234 kB\nVmRSS:\t 12 kB\n";
        assert_eq!(parse_peak(status), Some(1234 * 1024));
        assert_eq!(parse_peak("Name:\tfathom\n"), None);
    }
}
