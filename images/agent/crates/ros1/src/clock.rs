//! The topic /clock.

use bagpipe_graph::TopicInfo;

/// The type of /clock as ROS 1 ships it (rosgraph_msgs 1.11).
pub(crate) fn clock_topic() -> TopicInfo {
    TopicInfo {
        topic: "/clock".to_owned(),
        datatype: "rosgraph_msgs/Clock".to_owned(),
        md5sum: "a9c97c1d230cfc112e270351a944ee47".to_owned(),
        definition: "# roslib/Clock is used for publishing simulated time in ROS. \n\
                     # This message simply communicates the current time.\n\
                     # For more information, see http://www.ros.org/wiki/Clock\n\
                     time clock\n"
            .into(),
        latching: true,
        offered_qos: None,
    }
}

/// The TCPROS frame of a rosgraph_msgs/Clock: length 8, seconds, nanoseconds.
pub(crate) fn clock_frame(nanoseconds: u64) -> [u8; 12] {
    let seconds = u32::try_from(nanoseconds / 1_000_000_000).unwrap_or(u32::MAX);
    let rest = (nanoseconds % 1_000_000_000) as u32;
    let mut frame = [0; 12];
    frame[..4].copy_from_slice(&8u32.to_le_bytes());
    frame[4..8].copy_from_slice(&seconds.to_le_bytes());
    frame[8..].copy_from_slice(&rest.to_le_bytes());
    frame
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_frame_is_length_seconds_nanoseconds() {
        let frame = clock_frame(1_257_369_187_000_000_042);
        assert_eq!(frame[..4], [8, 0, 0, 0]);
        assert_eq!(frame[4..8], 1_257_369_187u32.to_le_bytes());
        assert_eq!(frame[8..], 42u32.to_le_bytes());
    }
}
