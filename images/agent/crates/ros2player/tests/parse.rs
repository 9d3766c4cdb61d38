//! What others announce of their nodes is parsed without a step beyond its end, whatever it is.
#![allow(clippy::unwrap_used)]

mod scenes;

use scenes::{own, printed};

#[test]
fn announcements_are_parsed_or_refused_within_their_bytes() {
    let (player, scene) = (own("player/dds"), own("tests/scenes/parse.c"));
    let source = player.join("parse.c");
    let text = printed("parse", &["-I".as_ref(), player.as_ref(), source.as_ref(), scene.as_ref()]);
    let numbers: Vec<u64> = text.split_whitespace().map(|number| number.parse().unwrap()).collect();
    // A prefix of a long GUID and its zeros is a short one with no nodes: with none to three bytes
    // behind it, in both orders. No other is whole.
    assert_eq!(numbers[0], 8);
    // Of those with changed bytes some differ in a name or a GUID alone.
    assert!(numbers[1] > 10_000 && numbers[2] > 10_000, "{text}");
}
