//! The topic /clock, and the clock that sources stamp their messages by.

use std::time::SystemTime;

use bagpipe_graph::TopicInfo;

/// Where simulated time is shown.
pub(crate) const CLOCK: &str = "/clock";

/// The topic as ROS 2 has it: who waits for time reads the last one alone.
pub(crate) fn clock_topic() -> TopicInfo {
    TopicInfo {
        topic: CLOCK.to_owned(),
        datatype: "rosgraph_msgs/msg/Clock".to_owned(),
        definition: "builtin_interfaces/Time clock\n\
                     ================================================================================\n\
                     MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
            .into(),
        ..TopicInfo::default()
    }
}

/// The frame of a rosgraph_msgs/msg/Clock: length 12, the head of little-endian CDR, seconds and
/// nanoseconds. Times beyond what 32 bits hold are the last one.
pub(crate) fn clock_frame(nanoseconds: u64) -> Vec<u8> {
    let seconds = i32::try_from(nanoseconds / 1_000_000_000).unwrap_or(i32::MAX);
    let rest = (nanoseconds % 1_000_000_000) as u32;
    [12u32.to_le_bytes(), [0, 1, 0, 0], seconds.to_le_bytes(), rest.to_le_bytes()].concat()
}

/// This moment in ns since 1970, as sources stamp their messages.
pub(crate) fn source_now() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_frame_is_length_head_seconds_nanoseconds() {
        let frame = clock_frame(1_763_900_000_000_000_042);
        assert_eq!(frame[..8], [12, 0, 0, 0, 0, 1, 0, 0]);
        assert_eq!(frame[8..12], 1_763_900_000i32.to_le_bytes());
        assert_eq!(frame[12..], 42u32.to_le_bytes());
        assert_eq!(clock_frame(u64::MAX)[8..12], i32::MAX.to_le_bytes());
    }
}
