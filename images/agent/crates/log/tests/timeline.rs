//! A timeline's order, and what it borrows.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests

use std::collections::HashMap;

use bagpipe_log::{Place, Timeline};

/// Two frames of 2 bytes of data each.
const FIRST: &[u8] = b"\x02\0\0\0ab\x02\0\0\0cd";
const SECOND: &[u8] = b"\x02\0\0\0ef";

/// A frame of 6 bytes.
fn place(time: u64, chunk: u32, start: u32, connection: u32) -> Place {
    Place { time, chunk, start, end: start + 6, connection }
}

/// (time, connection, data) of all messages.
fn messages<'a>(timeline: &Timeline<'a>) -> Vec<(u64, u32, &'a [u8])> {
    let all = (0..timeline.len()).map(|index| timeline.get(index).unwrap());
    all.map(|message| (message.time, message.connection, message.data)).collect()
}

#[test]
fn messages_come_by_time_and_those_of_one_time_as_they_were_given() {
    let places = vec![place(20, 0, 0, 1), place(10, 0, 6, 2), place(10, 1, 0, 1)];
    let timeline = Timeline::new(vec![FIRST, SECOND], places);
    assert_eq!(messages(&timeline), [(10, 2, &b"cd"[..]), (10, 1, b"ef"), (20, 1, b"ab")]);
    assert_eq!(timeline.get(0).unwrap().frame, &FIRST[6..]);
    assert_eq!((timeline.time(2), timeline.time(3), timeline.get(3)), (Some(20), None, None));
}

#[test]
fn a_window_has_its_first_time_and_not_its_last() {
    let places = [10, 20, 20, 30].map(|time| place(time, 0, 0, 1)).to_vec();
    let timeline = Timeline::new(vec![SECOND], places);
    assert_eq!(timeline.between(20, 30), 1..3);
    assert_eq!((timeline.between(0, u64::MAX), timeline.between(31, 40)), (0..4, 4..4));
    // One that ends before it begins is empty.
    assert_eq!(timeline.between(30, 10), 3..3);
}

#[test]
fn joined_parts_keep_their_bytes_and_get_the_numbers_of_the_whole() {
    let front = Timeline::new(vec![FIRST], vec![place(10, 0, 0, 1), place(20, 0, 6, 7)]);
    let rear = Timeline::new(vec![&[], SECOND], vec![place(10, 1, 0, 1)]);
    // The front's 7 is not in the whole.
    let parts = vec![(front, HashMap::from([(1, 0)])), (rear, HashMap::from([(1, 1)]))];
    let whole = Timeline::join(parts);
    assert_eq!(messages(&whole), [(10, 0, &b"ab"[..]), (10, 1, b"ef")]);
    assert!(std::ptr::eq(whole.get(1).unwrap().frame, SECOND));
    let (chunks, places) = whole.into_parts();
    assert_eq!((chunks.len(), places[1]), (3, place(10, 2, 0, 1)));
    assert!(Timeline::join(Vec::new()).is_empty());
}
