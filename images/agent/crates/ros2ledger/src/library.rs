//! The library as bytes, and the environment that makes the loader take it.

use std::ffi::{OsStr, OsString};
use std::path::Path;

/// The shared library to preload: an ELF file of 30 KiB for this processor and any glibc from 2.31 on.
///
/// It is C, which the compiler that links Rust builds as it is: the newest symbol that it asks for
/// is glibc 2.18's, since it has no call that newer ones gave a new version but `dlsym` and
/// `dlopen`, whose old ones are named. A library of the same kind in Rust asks for 2.34 on
/// Debian 12, and for `libgcc_s`, in 318 KiB: its standard library is bound to the C library of the
/// machine that builds, and another tool chain would be needed.
pub const LIBRARY: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/libbagpipe_ros2ledger.so"));

/// The variable that names the ledger's memory.
const LEDGER: &str = "BAGPIPE_LEDGER";
const PRELOAD: &str = "LD_PRELOAD";

/// The variables of a node, whose ledger is at `memory`; `preload` is the LD_PRELOAD that it has
/// anyway.
pub(crate) fn environment(
    memory: OsString,
    library: &Path,
    preload: Option<&OsStr>,
) -> [(&'static str, OsString); 2] {
    let mut libraries = OsString::from(library);
    if let Some(others) = preload.filter(|others| !others.is_empty()) {
        libraries.push(":");
        libraries.push(others);
    }
    [(LEDGER, memory), (PRELOAD, libraries)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preload_that_is_there_already_stays_behind_ours() {
        let with = |preload: Option<&str>| {
            let library = Path::new("/shared/ledger.so");
            environment("/proc/7/fd/3".into(), library, preload.map(OsStr::new))
        };
        let ours = OsString::from("/shared/ledger.so");
        assert_eq!(with(None), [(LEDGER, "/proc/7/fd/3".into()), (PRELOAD, ours.clone())]);
        assert_eq!(with(Some("")), with(None));
        assert_eq!(with(Some("a.so b.so"))[1].1, "/shared/ledger.so:a.so b.so");
    }
}
