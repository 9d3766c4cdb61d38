//! Publishers whose messages reach the recorder before their calls have returned, as on a busy
//! machine: their ledger counts them as published only then.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use bagpipe_replay::Mode;
use scene::{Ask, DEFAULT, Scene, recorded, recording};

#[test]
fn who_has_published_before_and_returns_late_lacks_nothing_of_the_recording() {
    let scene = Scene::new();
    let words = ["--name", "/relay", "--relay", "/in=/out", "--returns-late-us", "30000"];
    let (input, output) =
        ("/in:sensor_msgs/msg/Imu:10:reliable", "/out:std_msgs/msg/String:100:reliable");
    let ends = ["--sub", input, "--pub", output];
    let _relay = scene.start("standin_node", &[&words[..], &ends].concat());
    let ask = Ask { mode: Mode::Lockstep, ..DEFAULT };
    for _before in 0..2 {
        let replayed = scene.play(&recording(&["/in"], 30, 50), &ask).unwrap();
        assert_eq!(recorded(&replayed).len(), 30);
    }
}
