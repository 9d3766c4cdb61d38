//! What is in force of latched messages.
#![allow(clippy::unwrap_used)]

use bagpipe_log::{
    Connection, LatchedState, Late, MOST_IN_FORCE, TRANSFORMS_IN_FORCE, latched_depths, latchers,
};

#[test]
fn profiles_are_read_in_all_of_rosbag2_s_forms() {
    for (profiles, depths) in [
        ("- history: 3\n  depth: 0\n  durability: 1\n  deadline:\n    sec: 1", &[1][..]),
        ("- history: 1\n  durability: 2\n- history: 1\n  durability: 1", &[1]),
        ("- history: keep_last\n  durability: transient_local\n  depth: 7\n", &[7]),
        ("- durability: \"transient_local\"", &[1]),
        ("- depth: 2\n  durability: 1\n- depth: 3\n  durability: 1", &[2, 3]),
        ("- history: keep_all\n  durability: 1", &[MOST_IN_FORCE]),
        ("- history: 2\n  depth: 4\n  durability: 1", &[MOST_IN_FORCE]),
        ("durability: 1\ndepth: 5", &[5]),
        ("- history: 1\n  durability: 2\n  depth: 1", &[]),
        ("- history: keep_last\n  durability: volatile\n  depth: 1", &[]),
        ("- durability: 1\n  depth: 99999999999999", &[1]),
        ("", &[]),
        ("[]", &[]),
        ("durability: 10", &[]),
    ] {
        assert_eq!(latched_depths(profiles), depths, "{profiles:?}");
    }
}

fn channel(profiles: &str) -> Connection {
    Connection {
        latching: true,
        offered_qos: Some(profiles.to_owned()),
        datatype: "nav_msgs/msg/OccupancyGrid".to_owned(),
        ..Connection::default()
    }
}

#[test]
fn as_many_are_in_force_as_the_recording_shows() {
    let plain = Connection { latching: true, ..Connection::default() };
    assert_eq!(plain.in_force(), 1);
    assert_eq!(Connection { latching: false, ..plain.clone() }.in_force(), 0);
    let two = channel("- depth: 2\n  durability: 1\n- depth: 3\n  durability: 1");
    assert_eq!(two.in_force(), 5);
    // One of those publishers, whichever it is.
    assert_eq!(Connection { caller_id: Some("/a".to_owned()), ..two.clone() }.in_force(), 3);
    let deep = channel(&"- depth: 900\n  durability: 1\n".repeat(3));
    assert_eq!(deep.in_force(), MOST_IN_FORCE);
    for datatype in ["tf2_msgs/TFMessage", "tf2_msgs/msg/TFMessage"] {
        let transforms = Connection { datatype: datatype.to_owned(), ..plain.clone() };
        assert_eq!(transforms.in_force(), TRANSFORMS_IN_FORCE);
        let named = Connection { caller_id: Some("/a".to_owned()), ..transforms };
        assert_eq!(named.in_force(), 1);
        let deep = Connection { datatype: datatype.to_owned(), ..deep.clone() };
        assert_eq!(deep.in_force(), MOST_IN_FORCE);
    }
}

#[test]
fn a_job_has_the_last_word() {
    let late = |latching, depth| Late { latching, depth };
    for (wanted, recorded, expected) in [
        (late(None, None), 0, 0),
        (late(None, None), 3, 3),
        (late(None, Some(7)), 3, 7),
        (late(None, Some(7)), 0, 0),
        (late(Some(false), Some(7)), 3, 0),
        (late(Some(true), None), 0, 1),
        (late(Some(true), None), 3, 3),
        (late(Some(true), Some(2)), 3, 2),
    ] {
        assert_eq!(wanted.in_force(recorded), expected, "{wanted:?} {recorded}");
    }
}

#[test]
fn the_last_of_each_publisher_are_kept_by_time() {
    let named = |id, name: &str| Connection {
        id,
        topic: "/map".to_owned(),
        caller_id: Some(name.to_owned()),
        ..Connection::default()
    };
    // Of /a there are two connections, of those without a name each is one.
    let unnamed = |id| Connection { id, caller_id: None, ..named(id, "") };
    let all = [named(0, "/a"), named(1, "/b"), named(2, "/a"), unnamed(3), unnamed(4)];
    let whose = latchers(&all);
    assert_eq!(whose[&0], whose[&2]);
    assert_eq!(whose.values().collect::<std::collections::HashSet<_>>().len(), 4);
    // The next recording declares them in another order.
    let again = latchers(&[unnamed(8), unnamed(9), named(1, "/a"), named(2, "/b")]);
    assert_eq!([&again[&8], &again[&9], &again[&1]], [&whose[&3], &whose[&4], &whose[&0]]);
    let mut in_force = LatchedState::default();
    for time in 0..1000u64 {
        in_force.take(&whose[&((time % 3) as u32)], 2, time, time);
        in_force.take(&whose[&3], 0, time, 5000 + time);
    }
    // What comes behind may be of before, or of the same time.
    in_force.take(&whose[&1], 2, 10, 2000);
    in_force.take(&whose[&4], 1, 10, 2001);
    in_force.take(&whose[&4], 1, 10, 2002);
    let found: Vec<u64> = in_force.into_messages().into_iter().map(|(_, each)| each).collect();
    assert_eq!(found, [2002, 994, 997, 998, 999]);
}
