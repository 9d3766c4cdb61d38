//! The library as bytes, and the environment that makes the loader take it.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
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

/// The variables of a process that is to count nothing, from those of one that may count by the `library`:
/// whatever else is preloaded stays.
pub fn uncounted(
    variables: Vec<(OsString, OsString)>,
    library: &Path,
) -> Vec<(OsString, OsString)> {
    let kept = |(name, value): (OsString, OsString)| match name.to_str() {
        Some(LEDGER) => None,
        Some(PRELOAD) => others(&value, library).map(|value| (name, value)),
        _ => Some((name, value)),
    };
    variables.into_iter().filter_map(kept).collect()
}

/// What a preload has beside the library, if anything.
fn others(preload: &OsStr, library: &Path) -> Option<OsString> {
    let all = preload.as_bytes().split(|byte| b": ".contains(byte));
    let others = all.filter(|one| !one.is_empty() && *one != library.as_os_str().as_bytes());
    let others: Vec<&[u8]> = others.collect();
    (!others.is_empty()).then(|| OsString::from_vec(others.join(&b':')))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_counts_nothing_has_every_other_library_and_variable() {
        let after = |preload: &str| {
            let all =
                [("A", "b"), (PRELOAD, preload), (LEDGER, "/proc/7/fd/3"), ("LD_PRELOADS", "c")];
            let all = all.map(|(name, value)| (OsString::from(name), OsString::from(value)));
            let left = uncounted(all.to_vec(), Path::new("/shared/ledger.so"));
            let text = |one: OsString| one.into_string().unwrap();
            left.into_iter().map(|(name, value)| (text(name), text(value))).collect::<Vec<_>>()
        };
        let pair = |name: &str, value: &str| (name.to_owned(), value.to_owned());
        let [a, c] = [pair("A", "b"), pair("LD_PRELOADS", "c")];
        for none in ["/shared/ledger.so", "", " : /shared/ledger.so:"] {
            assert_eq!(after(none), [a.clone(), c.clone()], "{none:?}");
        }
        let some = "/shared/ledger.so:a.so b.so:/other/ledger.so";
        let preload = pair(PRELOAD, "a.so:b.so:/other/ledger.so");
        assert_eq!(after(some), [a, preload, c]);
    }

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
