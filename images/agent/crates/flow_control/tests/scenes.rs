//! A sender is held back by who reads, and by nobody else.
#![allow(clippy::unwrap_used)]

#[path = "../../ros2player/tests/scenes/mod.rs"]
mod scenes;

use std::collections::BTreeMap;
use std::ffi::OsStr;

use scenes::{own, printed};

/// The scenes of `scenes.c`, each with its figures.
fn scenes() -> BTreeMap<String, Vec<i64>> {
    let (flow, scene) = (own("flow"), own("tests/scenes.c"));
    let strict = ["-Wall", "-Wextra", "-Werror", "-I"].map(OsStr::new);
    let text = printed("flow-control", &[&strict[..], &[flow.as_ref(), scene.as_ref()]].concat());
    let words = |line: &str| {
        let (scene, figures) = line.split_once(' ').unwrap();
        (scene.to_owned(), figures.split(' ').map(|word| word.parse().unwrap()).collect())
    };
    text.lines().map(words).collect()
}

/// What a scene shows: datagrams that went out, those that came, microseconds that were waited, and
/// questions to the kernel.
#[test]
fn a_sender_is_held_back_by_who_reads_and_by_nobody_else() {
    let scenes = scenes();
    let of = |scene: &str| <[i64; 4]>::try_from(scenes[scene].as_slice()).unwrap();
    // Its socket holds one of these datagrams: before each but the first it is waited for once.
    assert_eq!(of("slow"), [200, 200, 199 * 50, 200 + 199]);
    // By which of this machine's addresses it is reached is the middleware's choice.
    assert_eq!(of("interface"), [200, 200, 199 * 50, 200 + 199]);
    assert_eq!(of("elsewhere")[2..], [0, 0]);
    // Who keeps up costs a question for each five small datagrams, of a socket of 100 KB.
    let [sent, came, waited, asked] = of("quick");
    assert_eq!((sent, came, waited), (20_000, 20_000, 0));
    assert!(asked <= 20_000 / 5, "{asked}");
    // Who has stopped is waited for once, and again only after it has read.
    for scene in ["stopped", "stopped-again"] {
        assert_eq!(of(scene)[2], 1_000_000, "{scene}");
    }
    assert_eq!(of("goes-on")[..2], [400, 400]);
    assert_eq!(of("crawls")[..2], [200, 200]);
    // What waits all the time, as in kernels of 2019, holds up no datagram that needs more than half.
    assert_eq!(of("alternates")[..3], [200, 200, 0]);
    // What is due is no later than 20 ms, and a fourth of the time that it was waited.
    let waited = of("by-the-clock")[2];
    assert!((20_000..=26_700).contains(&waited), "{waited}");
    // From who never goes on the lock is taken after 10 ms, and in a child at once.
    assert_eq!(of("interrupted"), [1, 1, 200 * 50, 1]);
    assert_eq!(of("child"), [1, 1, 0, 1]);
    // Into a file of the program's nothing is written, and nothing is read of it.
    assert_eq!(of("replaced"), [40, 40, -1, 6]);
    assert_eq!(of("many")[..2], [200, 200]);
    // By the clock who has stopped costs the others nothing once it is known.
    assert_eq!(of("neighbour")[..2], [100, 100]);
    // Nobody, for whom is asked again after a megabyte, and where the kernel does not answer: as if there were no flow control.
    assert_eq!(of("nobody")[2..], [0, 7]);
    assert_eq!((of("unanswered")[2..].to_vec(), of("unanswered")[1] < 40), (vec![0, 0], true));
    assert!(scenes["charges"][0] <= 0, "the kernel counts more: {:?}", scenes["charges"]);
}
