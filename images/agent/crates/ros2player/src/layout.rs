//! The shared memory, field by field: the same definition as `player/layout.h`, which a test
//! compares with it. Nothing but atomics, since others may write it at any moment.

use std::sync::atomic::{AtomicU32, AtomicU64};

/// `BAGGPLY1`.
pub(crate) const MAGIC: u64 = 0x3159_4c50_4747_4142;
pub(crate) const VERSION: u32 = 2;
/// Publishers, and as many subscriptions.
pub(crate) const ENDPOINTS: usize = 1024;
/// Nodes whose state is asked for.
pub(crate) const STATES: usize = 64;
/// Of a record in its ring, in bytes.
pub(crate) const ALIGNMENT: u64 = 32;
/// Where the first ring begins.
pub(crate) const RINGS: usize = 65536;

pub(crate) const RECORD_MESSAGE: u16 = 0;
pub(crate) const RECORD_PAD: u16 = 1;
pub(crate) const RECORD_TOO_LARGE: u16 = 2;
pub(crate) const RECORD_FAILED: u16 = 3;

#[repr(C)]
pub(crate) struct Ring {
    pub(crate) head: AtomicU64,
    pub(crate) reader_sleeps: AtomicU32,
    pub(crate) reserved_head: [AtomicU32; 13],
    pub(crate) tail: AtomicU64,
    pub(crate) writer_sleeps: AtomicU32,
    pub(crate) reserved_tail: [AtomicU32; 13],
}

#[repr(C)]
pub(crate) struct Publisher {
    pub(crate) published: AtomicU64,
    pub(crate) refused: AtomicU64,
}

#[repr(C)]
pub(crate) struct Subscription {
    pub(crate) taken: AtomicU64,
    pub(crate) reserved: AtomicU64,
}

#[repr(C)]
pub(crate) struct Header {
    pub(crate) magic: AtomicU64,
    pub(crate) version: AtomicU32,
    pub(crate) endpoints: AtomicU32,
    pub(crate) room: AtomicU64,
    pub(crate) refused: AtomicU64,
    pub(crate) by_the_clock: AtomicU64,
    pub(crate) reserved: [AtomicU64; 11],
    pub(crate) out: Ring,
    pub(crate) in_: Ring,
    pub(crate) publisher: [Publisher; ENDPOINTS],
    pub(crate) subscription: [Subscription; ENDPOINTS],
}

/// What stands before each message, as four numbers of 64 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Record {
    /// Of the bytes that follow.
    pub(crate) length: u32,
    pub(crate) endpoint: u16,
    pub(crate) kind: u16,
    pub(crate) stamp: i64,
    /// The GID of who published it; 0s where that is not known, and of what is to be published.
    pub(crate) publisher: [u8; 16],
}

impl Record {
    pub(crate) fn from_words([first, stamp, gid, rest]: [u64; 4]) -> Record {
        Record {
            length: first as u32,
            endpoint: (first >> 32) as u16,
            kind: (first >> 48) as u16,
            stamp: stamp.cast_signed(),
            publisher: (u128::from(rest) << 64 | u128::from(gid)).to_le_bytes(),
        }
    }

    pub(crate) fn words(self) -> [u64; 4] {
        let upper = u64::from(self.kind) << 16 | u64::from(self.endpoint);
        let gid = u128::from_le_bytes(self.publisher);
        let (gid, rest) = (gid as u64, (gid >> 64) as u64);
        [upper << 32 | u64::from(self.length), self.stamp.cast_unsigned(), gid, rest]
    }
}

const _: () = assert!(size_of::<Ring>() == 128 && size_of::<Header>() <= RINGS);

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;
    use std::path::Path;
    use std::process::Command;

    use super::*;

    type Fields = Vec<(&'static str, usize, usize)>;

    /// The fields of a structure, with the name that C has for it: name, offset, size.
    macro_rules! fields {
        ($of:ty, $c:literal, $($field:ident $name:literal: $kind:ty),+) => {
            [$((concat!($c, ".", $name), std::mem::offset_of!($of, $field), size_of::<$kind>())),+]
        };
    }

    fn of_rust() -> Fields {
        let mut all = Fields::new();
        all.extend(
            fields!(Ring, "player_ring", head "head": u64, reader_sleeps "reader_sleeps": u32,
            reserved_head "reserved_head": [u32; 13], tail "tail": u64,
            writer_sleeps "writer_sleeps": u32, reserved_tail "reserved_tail": [u32; 13]),
        );
        all.extend(fields!(Publisher, "player_publisher", published "published": u64,
            refused "refused": u64));
        all.extend(fields!(Subscription, "player_subscription", taken "taken": u64,
            reserved "reserved": u64));
        all.extend(fields!(Header, "player_header", magic "magic": u64, version "version": u32,
            endpoints "endpoints": u32, room "room": u64, refused "refused": u64,
            by_the_clock "by_the_clock": u64, reserved "reserved": [u64; 11], out "out": Ring, in_ "in": Ring,
            publisher "publisher": [Publisher; ENDPOINTS],
            subscription "subscription": [Subscription; ENDPOINTS]));
        all
    }

    const CONSTANTS: [(&str, u64); 11] = [
        ("PLAYER_MAGIC", MAGIC),
        ("PLAYER_VERSION", VERSION as u64),
        ("PLAYER_ENDPOINTS", ENDPOINTS as u64),
        ("PLAYER_STATES", STATES as u64),
        ("PLAYER_ALIGNMENT", ALIGNMENT),
        ("PLAYER_RINGS", RINGS as u64),
        ("RECORD_MESSAGE", RECORD_MESSAGE as u64),
        ("RECORD_PAD", RECORD_PAD as u64),
        ("RECORD_TOO_LARGE", RECORD_TOO_LARGE as u64),
        ("RECORD_FAILED", RECORD_FAILED as u64),
        ("sizeof(struct player_record)", 32),
    ];

    /// A record as C has it, as the four numbers of Rust.
    const RECORD: &str = "
        int main(void) {
          struct player_record record = {0x01234567, 0x89ab, 0xcdef, -2, {1, 2, [9] = 3}};
          unsigned long long words[4];
          memcpy(words, &record, sizeof words);
          return words[0] != 0xcdef89ab01234567ull || words[1] != -2ull ||
                 words[2] != 0x0201ull || words[3] != 0x0300ull;
        }";

    #[test]
    fn the_header_in_c_has_the_same_fields_at_the_same_places() {
        let mut source =
            String::from("#include <stddef.h>\n#include <string.h>\n#include \"layout.h\"\n");
        for (name, at, size) in of_rust() {
            let (of, field) = name.split_once('.').unwrap();
            let offset = format!("offsetof(struct {of}, {field}) == {at}");
            let length = format!("sizeof(((struct {of} *)0)->{field}) == {size}");
            writeln!(source, "_Static_assert({offset} && {length}, \"{name}\");").unwrap();
        }
        for (name, value) in CONSTANTS {
            writeln!(source, "_Static_assert({name} == {value}ull, \"{name}\");").unwrap();
        }
        source += RECORD;
        let file = std::env::temp_dir().join(format!("player_layout_{}.c", std::process::id()));
        let program = file.with_extension("out");
        std::fs::write(&file, source).unwrap();
        let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("player");
        let compiled = Command::new("cc")
            .args(["-std=gnu11", "-I"])
            .args([&header, &file, Path::new("-o"), &program])
            .output()
            .unwrap();
        assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
        assert!(Command::new(&program).status().unwrap().success());
        std::fs::remove_file(&file).unwrap();
        std::fs::remove_file(&program).unwrap();
        let mut publisher = [0; 16];
        (publisher[0], publisher[1], publisher[9]) = (1, 2, 3);
        let (length, endpoint, kind) = (0x0123_4567, 0x89ab, 0xcdef);
        let record = Record { length, endpoint, kind, stamp: -2, publisher };
        assert_eq!(record.words(), [0xcdef_89ab_0123_4567, u64::MAX - 1, 0x0201, 0x0300]);
        assert_eq!(Record::from_words(record.words()), record);
    }
}
