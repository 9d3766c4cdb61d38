//! What tests need that is no part of the project. Where it is missing they fail and say how to
//! get it: a test that returned instead would look as if it had shown something.
#![allow(dead_code)] // each test file uses its own part

use std::path::{Path, PathBuf};

const ROS: &str = "/usr/bin/rosmaster";

/// Where the real PR2 recording lies: 1,598 JointStates in 16 s, in chunks of bzip2.
pub fn pr2_recording() -> PathBuf {
    let cache = std::env::var_os("BAGPIPE_CACHE").map(PathBuf::from);
    let ours = || PathBuf::from(std::env::var_os("HOME").unwrap()).join(".cache/bagpipe");
    let path = cache.unwrap_or_else(ours).join("recordings/pr2_joint_states.bag");
    assert!(
        path.exists(),
        "the PR2 recording is not at {}: `make recording` fetches it",
        path.display()
    );
    path
}

/// True where BAGPIPE_WITHOUT_ROS=1 asks for leaving out the tests that run Debian's ROS.
pub fn without_ros() -> bool {
    if std::env::var_os("BAGPIPE_WITHOUT_ROS").is_some_and(|value| value == "1") {
        println!("left out, as BAGPIPE_WITHOUT_ROS=1 asks");
        return true;
    }
    assert!(
        Path::new(ROS).exists(),
        "{ROS} is not installed: `make preflight-all` installs Debian's ROS, and \
         BAGPIPE_WITHOUT_ROS=1 leaves out the tests that need it"
    );
    false
}
