//! Whose a node is, by its name.

/// Our own node in the graph.
const PLAYER: &str = "/bagpipe_player_";

/// Whether a node is neither ours nor of the command line.
pub fn is_of_stack(name: &str) -> bool {
    !is_ours(name) && !is_of_command_line(name)
}

/// Whether a node is the player.
fn is_ours(name: &str) -> bool {
    name.starts_with(PLAYER)
}

/// Whether a node is one of rostopic's or rosservice's, which a script may start, and end as it likes: it is called after
/// its process and the time, as rospy's anonymous nodes are.
fn is_of_command_line(name: &str) -> bool {
    let own = name.rsplit('/').next().unwrap_or(name);
    let is_number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let mut parts = own.split('_');
    matches!(parts.next(), Some("rostopic" | "rosservice"))
        && parts.next().is_some_and(is_number)
        && parts.next().is_some_and(is_number)
        && parts.next().is_none()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stacks_own_node_is_none_of_the_command_lines() {
        for own in ["/rostopic_relay", "/rosservice_7", "/rostopic_7_8_9", "/rostopic_7_", "/a/b"] {
            assert!(!is_of_command_line(own), "{own}");
        }
        assert!(is_of_command_line("/robot/rosservice_4711_1700000000000"));
        assert!(!is_of_stack("/robot/rosservice_4711_1700000000000"));
        assert!(is_of_stack("/planner") && !is_of_stack("/bagpipe_player_7"));
    }
}
