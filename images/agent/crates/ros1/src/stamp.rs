//! The stamp of messages that begin with a std_msgs/Header.

use bagpipe_graph::ReadStamp;

/// How to read the stamps of messages of this definition; `None` if they have none.
pub(crate) fn reader(definition: &str) -> Option<ReadStamp> {
    has_header(definition).then_some(stamp as ReadStamp)
}

/// Whether messages of this definition begin with a header: its first field is one.
fn has_header(definition: &str) -> bool {
    let fields = definition.lines().map(|line| line.split('#').next().unwrap_or(line).trim());
    let first = fields.take_while(|line| !line.starts_with("===")).find(|line| {
        // A constant takes no byte of the message.
        !line.is_empty() && !line.contains('=')
    });
    let kind = first.and_then(|line| line.split_whitespace().next());
    matches!(kind, Some("Header" | "std_msgs/Header" | "roslib/Header"))
}

/// The stamp of a message that begins with a header, in nanoseconds. The header is `u32
/// seq`, `u32 seconds`, `u32 nanoseconds`, `string frame_id`.
fn stamp(data: &[u8]) -> Option<u64> {
    let number = |at: usize| {
        let bytes = data.get(at..)?.first_chunk::<4>()?;
        Some(u64::from(u32::from_le_bytes(*bytes)))
    };
    Some(number(4)? * 1_000_000_000 + number(8)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_counts_only_as_the_first_field() {
        assert!(has_header("# a comment\nint32 A=4\nHeader header # stamp\nfloat64 x\n"));
        assert!(has_header("std_msgs/Header header\n"));
        assert!(!has_header("float64 x\nHeader header\n"));
        assert!(!has_header("string data\n===\nMSG: std_msgs/Header\nHeader header\n"));
        assert!(!has_header(""));
    }

    #[test]
    fn the_stamp_lies_behind_the_sequence_number() {
        let message = [&9u32.to_le_bytes()[..], &3u32.to_le_bytes(), &7u32.to_le_bytes()].concat();
        assert_eq!(stamp(&message), Some(3_000_000_007));
        assert_eq!(stamp(&message[..11]), None);
    }
}
