//! The shared memory, field by field: the same definition as `preload/layout.h`, which a test
//! compares with it. Nothing but atomics, since the user's nodes write it at any moment.

use std::sync::atomic::{AtomicI64, AtomicU8, AtomicU32, AtomicU64};

/// `BAGPLDR1`.
pub(crate) const MAGIC: u64 = 0x3152_444c_5047_4142;
pub(crate) const VERSION: u32 = 10;
pub(crate) const PROCESSES: usize = 512;
pub(crate) const ENDPOINTS: usize = 4096;
pub(crate) const NAME_BYTES: usize = 256;
/// Beside the 8 bits that a parent is given of a status.
pub(crate) const EXITED: u32 = 256;
pub(crate) const OWN: usize = 4096;
pub(crate) const EVENTS: usize = 6;

pub(crate) const PHASE_FREE: u32 = 0;
pub(crate) const PHASE_CLAIMED: u32 = 1;
pub(crate) const PHASE_LIVE: u32 = 2;
pub(crate) const PHASE_DESTROYED: u32 = 3;
/// An endpoint's state has its phase in the low byte and the process that owns it above.
pub(crate) const OWNER_SHIFT: u32 = 8;

/// The phase in an endpoint's state.
pub(crate) fn phase(state: u32) -> u32 {
    state & ((1 << OWNER_SHIFT) - 1)
}

pub(crate) const PROCESS_FREE: u32 = 0;
pub(crate) const PROCESS_LIVE: u32 = 1;
pub(crate) const PROCESS_REPLACED: u32 = 2;

pub(crate) const KIND_SUBSCRIPTION: u32 = 1;
pub(crate) const KIND_PUBLISHER: u32 = 2;

pub(crate) const FLAG_CALLS: u32 = 1;
pub(crate) const FLAG_INTRA: u32 = 2;
pub(crate) const FLAG_LATE: u32 = 4;
pub(crate) const FLAG_REPLACED: u32 = 8;
pub(crate) const FLAG_MANUAL: u32 = 16;

#[repr(C)]
pub(crate) struct Header {
    pub(crate) magic: AtomicU64,
    pub(crate) version: AtomicU32,
    pub(crate) processes: AtomicU32,
    pub(crate) endpoints: AtomicU32,
    pub(crate) unlisted_processes: AtomicU32,
    pub(crate) unlisted_endpoints: AtomicU32,
    pub(crate) endpoints_used: AtomicU32,
    pub(crate) reserved: [AtomicU64; 4],
    pub(crate) changes: AtomicU32,
    pub(crate) wanted: [AtomicU32; EVENTS],
    pub(crate) watch_matches: AtomicU32,
    pub(crate) listings: AtomicU32,
    pub(crate) own_published: AtomicU32,
    pub(crate) flow: AtomicU32,
    pub(crate) reserved_wanted: [AtomicU32; 5],
}

#[repr(C)]
pub(crate) struct ProcessEntry {
    pub(crate) pid: AtomicU32,
    pub(crate) state: AtomicU32,
    pub(crate) start: AtomicU64,
    pub(crate) unlisted_endpoints: AtomicU32,
    pub(crate) spinners: AtomicU32,
    pub(crate) others_started: AtomicU64,
    pub(crate) others_ended: AtomicU64,
    pub(crate) stack: AtomicU64,
    pub(crate) machine_timers: AtomicU64,
    pub(crate) exit_status: AtomicU32,
    pub(crate) reserved_word: AtomicU32,
}

#[repr(C)]
pub(crate) struct EndpointSlot {
    pub(crate) state: AtomicU32,
    pub(crate) generation: AtomicU32,
    pub(crate) kind: AtomicU32,
    pub(crate) flags: AtomicU32,
    pub(crate) history: AtomicU32,
    pub(crate) reliability: AtomicU32,
    pub(crate) durability: AtomicU32,
    pub(crate) thread: AtomicU32,
    pub(crate) depth: AtomicU64,
    pub(crate) matched: AtomicU64,
    pub(crate) wake_from: AtomicU64,
    pub(crate) offered: AtomicU64,
    pub(crate) taken: AtomicU64,
    pub(crate) rested: AtomicU64,
    pub(crate) started: AtomicU64,
    pub(crate) ended: AtomicU64,
    pub(crate) intra_started: AtomicU64,
    pub(crate) intra_ended: AtomicU64,
    pub(crate) returned: AtomicU64,
    pub(crate) published: AtomicU64,
    pub(crate) topic: [AtomicU8; NAME_BYTES],
    pub(crate) node: [AtomicU8; NAME_BYTES],
    pub(crate) seen_at: AtomicU64,
    pub(crate) taken_own: AtomicU64,
    pub(crate) taken_unknown: AtomicU64,
    pub(crate) own_latest: AtomicI64,
    pub(crate) own_after: AtomicI64,
    pub(crate) destroyed: AtomicU64,
    pub(crate) deadline: AtomicU64,
    pub(crate) lease: AtomicU64,
    pub(crate) gid: [AtomicU64; 2],
    pub(crate) reserved: [AtomicU64; 6],
}

#[repr(C)]
pub(crate) struct Layout {
    pub(crate) header: Header,
    pub(crate) process: [ProcessEntry; PROCESSES],
    pub(crate) endpoint: [EndpointSlot; ENDPOINTS],
    pub(crate) own: [AtomicU64; OWN],
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::mem::{offset_of, size_of};
    use std::path::Path;
    use std::process::Command;

    use super::*;

    /// Name, offset and size of each of these fields, which have no gap between them.
    macro_rules! fields {
        ($type:ty, $name:literal, $($field:ident: $of:ty),+) => {{
            let mut lines = Vec::new();
            let mut end = 0;
            $(
                let (at, size) = (offset_of!($type, $field), size_of::<$of>());
                assert_eq!(at, end, "{}.{}", $name, stringify!($field));
                end = at + size;
                lines.push((format!("{}.{}", $name, stringify!($field)), at, size));
            )+
            assert_eq!(end, size_of::<$type>(), "{} has other fields", $name);
            lines
        }};
    }

    fn of_rust() -> Vec<(String, usize, usize)> {
        let mut all = fields!(Header, "ledger_header", magic: u64, version: u32, processes: u32,
            endpoints: u32, unlisted_processes: u32, unlisted_endpoints: u32, endpoints_used: u32,
            reserved: [u64; 4], changes: u32, wanted: [u32; 6], watch_matches: u32,
            listings: u32, own_published: u32, flow: u32, reserved_wanted: [u32; 5]);
        all.extend(fields!(ProcessEntry, "ledger_process", pid: u32, state: u32, start: u64,
            unlisted_endpoints: u32, spinners: u32, others_started: u64, others_ended: u64,
            stack: u64, machine_timers: u64, exit_status: u32, reserved_word: u32));
        all.extend(
            fields!(EndpointSlot, "ledger_endpoint", state: u32, generation: u32, kind: u32,
            flags: u32, history: u32, reliability: u32, durability: u32, thread: u32, depth: u64,
            matched: u64, wake_from: u64, offered: u64, taken: u64, rested: u64, started: u64, ended: u64,
            intra_started: u64, intra_ended: u64, returned: u64, published: u64,
            topic: [u8; 256],
            node: [u8; 256], seen_at: u64, taken_own: u64, taken_unknown: u64,
            own_latest: i64, own_after: i64, destroyed: u64, deadline: u64, lease: u64,
            gid: [u64; 2], reserved: [u64; 6]),
        );
        all.extend(fields!(Layout, "ledger", header: Header, process: [ProcessEntry; 512],
            endpoint: [EndpointSlot; 4096], own: [u64; 4096]));
        all
    }

    fn constants() -> Vec<(&'static str, u64)> {
        vec![
            ("LEDGER_MAGIC", MAGIC),
            ("LEDGER_VERSION", VERSION.into()),
            ("LEDGER_PROCESSES", PROCESSES as u64),
            ("LEDGER_ENDPOINTS", ENDPOINTS as u64),
            ("LEDGER_NAME_BYTES", NAME_BYTES as u64),
            ("LEDGER_EXITED", EXITED.into()),
            ("LEDGER_OWN", OWN as u64),
            ("EVENTS", EVENTS as u64),
            ("PHASE_FREE", PHASE_FREE.into()),
            ("PHASE_CLAIMED", PHASE_CLAIMED.into()),
            ("PHASE_LIVE", PHASE_LIVE.into()),
            ("PHASE_DESTROYED", PHASE_DESTROYED.into()),
            ("LEDGER_OWNER_SHIFT", OWNER_SHIFT.into()),
            ("PROCESS_FREE", PROCESS_FREE.into()),
            ("PROCESS_LIVE", PROCESS_LIVE.into()),
            ("PROCESS_REPLACED", PROCESS_REPLACED.into()),
            ("KIND_SUBSCRIPTION", KIND_SUBSCRIPTION.into()),
            ("KIND_PUBLISHER", KIND_PUBLISHER.into()),
            ("FLAG_CALLS", FLAG_CALLS.into()),
            ("FLAG_INTRA", FLAG_INTRA.into()),
            ("FLAG_LATE", FLAG_LATE.into()),
            ("FLAG_REPLACED", FLAG_REPLACED.into()),
            ("FLAG_MANUAL", FLAG_MANUAL.into()),
            ("FLOW_FREE", crate::Flow::Free as u64),
            ("FLOW_CONTROLLED", crate::Flow::Controlled as u64),
            ("FLOW_BY_THE_CLOCK", crate::Flow::ByTheClock as u64),
            ("EVENT_TAKEN", crate::Event::Taken as u64),
            ("EVENT_STARTED", crate::Event::Started as u64),
            ("EVENT_ENDED", crate::Event::Ended as u64),
            ("EVENT_PUBLISHED", crate::Event::Published as u64),
            ("EVENT_LISTED", crate::Event::Listed as u64),
            ("EVENT_MATCHED", crate::Event::Matched as u64),
        ]
    }

    #[test]
    fn the_header_in_c_has_the_same_fields_at_the_same_places() {
        let mut source = String::from("#include <stddef.h>\n#include \"layout.h\"\n");
        for (name, at, size) in of_rust() {
            let (of, field) = name.split_once('.').unwrap();
            writeln!(source, "_Static_assert(offsetof(struct {of}, {field}) == {at}, \"{name}\");")
                .unwrap();
            writeln!(
                source,
                "_Static_assert(sizeof(((struct {of} *)0)->{field}) == {size}, \"{name}\");"
            )
            .unwrap();
        }
        for (name, value) in constants() {
            writeln!(source, "_Static_assert({name} == {value}ull, \"{name}\");").unwrap();
        }
        let file = std::env::temp_dir().join(format!("ledger_layout_{}.c", std::process::id()));
        std::fs::write(&file, source).unwrap();
        let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("preload");
        let compiled = Command::new("cc")
            .args(["-std=gnu11", "-fsyntax-only", "-I"])
            .args([&header, &file])
            .output()
            .unwrap();
        std::fs::remove_file(&file).unwrap();
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    }
}
