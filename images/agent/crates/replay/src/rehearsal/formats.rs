//! Recordings of formats that nobody else knows: the player and the recorder ask for nothing more
//! than `bagpipe_log`'s traits.

use std::fs::File;
use std::sync::Arc;

use bagpipe_log::{
    Connection, MessageEncoding, Place, Recording, RecordingError, RecordingFormat,
    RecordingWriter, Timeline,
};

use super::bags::words;
use super::realtime::bag_of_times;
use super::{ByHand, MS, Rehearsal, ms, request, say, window};
use crate::ReplayError;
use crate::plan::Plan;

/// A recording of "one" and, a second later, "two" on /b, whose frames lie the other way round.
struct Strip {
    connections: [Connection; 1],
}

const FRAMES: &[u8] = b"\x07\0\0\0\x03\0\0\0two\x07\0\0\0\x03\0\0\0one";

impl Strip {
    fn new() -> Strip {
        Strip { connections: [Connection { id: 70_000, ..words("/b", "/t", false) }] }
    }
}

impl Recording for Strip {
    fn connections(&self) -> &[Connection] {
        &self.connections
    }

    fn timeline(
        &self,
        wanted: &dyn Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, RecordingError> {
        let place =
            |time, start| Place { time, chunk: 0, start, end: start + 11, connection: 70_000 };
        let places = vec![place(2_000 * MS, 0), place(1_000 * MS, 11)];
        let wanted = self.connections.iter().any(wanted);
        Ok(Timeline::new(vec![FRAMES], if wanted { places } else { Vec::new() }))
    }
}

/// A recording whose beginning alone can be read.
struct Torn(Strip);

impl Recording for Torn {
    fn connections(&self) -> &[Connection] {
        self.0.connections()
    }

    fn timeline(&self, _: &dyn Fn(&Connection) -> bool) -> Result<Timeline<'_>, RecordingError> {
        Err(RecordingError::Unreadable("the strip is torn after 7 frames".into()))
    }
}

/// Makes an error of a sentence.
type Failure = fn(&'static str) -> RecordingError;

/// A format that takes so many messages, and fails with the next one, or where it ends.
#[derive(Clone, Copy, Debug)]
struct Short {
    messages: u64,
    failure: Failure,
}

impl RecordingFormat for Short {
    fn writer(&self, _: Option<u64>) -> Box<dyn RecordingWriter> {
        Box::new(*self)
    }
}

impl RecordingWriter for Short {
    fn add_connection(&mut self, _: &Connection) -> u32 {
        0
    }

    fn write(&mut self, _: u32, _: u64, _: &[u8]) -> Result<(), RecordingError> {
        self.messages = self.messages.checked_sub(1).ok_or((self.failure)("no room for it"))?;
        Ok(())
    }

    fn spill(&mut self, _: &mut File) -> Result<(), RecordingError> {
        Ok(())
    }

    fn messages(&self) -> u64 {
        0
    }

    fn high_water(&self) -> u64 {
        0
    }

    fn finish(self: Box<Self>) -> Result<Vec<u8>, RecordingError> {
        Err((self.failure)("no room for its end"))
    }

    fn finish_spilled(self: Box<Self>, _: &mut File) -> Result<u64, RecordingError> {
        Err((self.failure)("no room for its end"))
    }
}

#[test]
fn what_has_connections_and_a_timeline_is_played() {
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(1_000, 2_001)));
    rehearsal.play_window(&Strip::new());
    let expected = [(ms(0), "one"), (ms(1_000), "two")];
    assert_eq!(rehearsal.log.words(), expected.map(|(at, word)| (at, word.to_owned())));
}

#[test]
fn recordings_of_several_formats_are_one_timeline() {
    let by_hand = ByHand::new();
    let (bag, strip) = (bag_of_times(&[1_000, 1_500]), Strip::new());
    let plan = Plan::new(&[&strip, &bag], &request(&by_hand, window(0, 9_000))).unwrap();
    let texts = plan.counted.clone().map(|place| {
        let (message, route) = plan.message(place).unwrap();
        (&message.data[4..], plan.topics[route.topics[0]].topic.as_str())
    });
    let expected: [(&[u8], _); 4] =
        [(b"one", "/b"), (b"1000", "/a"), (b"1500", "/a"), (b"two", "/b")];
    assert!(texts.eq(expected));
}

#[test]
fn messages_that_its_nodes_cant_read_are_an_error_and_others_beside_them_are_played() {
    let by_hand = ByHand::new();
    let mut strip = Strip::new();
    strip.connections[0].message_encoding = MessageEncoding::Cdr;
    let mut request = request(&by_hand, window(0, 9_000));
    let Err(error) = Plan::new(&[&strip], &request) else { panic!("it was taken") };
    assert_eq!(error.reason(), "BagUnreadable");
    let sentence = "the topic /b holds messages in cdr, and its nodes would read them as ros1; name \
                    the topics to be played without it";
    assert_eq!(error.to_string(), sentence);
    request.topics = vec!["/a".to_owned()];
    assert!(Plan::new(&[&strip, &bag_of_times(&[1_000])], &request).is_ok());
}

#[test]
fn one_that_cant_be_read_is_an_error_with_its_place_and_its_own_sentence() {
    let by_hand = ByHand::new();
    let (strip, torn) = (Strip::new(), Torn(Strip::new()));
    let planned = Plan::new(&[&strip, &torn], &request(&by_hand, window(0, 9_000)));
    let Err(error) = planned else { panic!("it was read") };
    assert_eq!(error.reason(), "BagUnreadable");
    assert_eq!(error.to_string(), "the strip is torn after 7 frames");
    assert!(matches!(error, ReplayError::BagUnreadable { bag: 1, .. }), "{error:?}");
}

#[test]
fn a_budget_that_is_used_up_is_kept_apart_from_what_else_may_fail() {
    let over_budget = |why: &'static str| RecordingError::OverBudget(why.into());
    let unwritten = |why: &'static str| RecordingError::Unwritten(why.into());
    let advice = "; record fewer topics, cut shorter fragments or raise the budget";
    let failures: [(Failure, _, _); 2] =
        [(over_budget, "RecorderBudgetExceeded", advice), (unwritten, "Internal", "")];
    for (failure, reason, advice) in failures {
        for (messages, why) in [(1, "no room for it"), (2, "no room for its end")] {
            let by_hand = ByHand::new();
            let mut request = request(&by_hand, window(0, 1_000));
            request.record_as = Arc::new(Short { messages, failure });
            let recorder = Rehearsal::new(&by_hand, request).recorder;
            recorder.count_from(0);
            (0..2).for_each(|_| say(&recorder, "/out"));
            assert_eq!(
                (recorder.messages(), recorder.failure().is_some()),
                (messages, messages < 2)
            );
            let error = recorder.finish().unwrap_err();
            assert_eq!((error.reason(), error.to_string()), (reason, format!("{why}{advice}")));
        }
    }
}
