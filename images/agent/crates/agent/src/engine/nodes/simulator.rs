//! The worker's simulator, turn by turn over the pipe: ANSWER to it, STEP from it, and before a
//! STEP the DATA of messages that don't fit into it.

use std::cell::RefCell;
use std::time::Instant;

use bagpipe_graph::TopicInfo;
use bagpipe_replay::{Cancellation, LatestMessage, Moment, ReplayError, World};
use bagpipe_wire::{Duplex, End, FrameType, MAX_PAYLOAD, PipeError, from_map, to_map};
use rmpv::Value;
use serde::{Deserialize, Serialize};

use crate::case::Simulator;

/// DATA before one STEP, in bytes.
const MOST_DATA: usize = 1 << 30;

/// The world at the worker's end of the pipe.
pub struct PipeWorld<'a> {
    pub link: &'a RefCell<Duplex>,
    pub deadline: Instant,
    /// Topics that stay out of the recording.
    pub unrecorded: Vec<String>,
}

/// The topics whose messages the recording does not get.
pub fn unrecorded(simulator: &Simulator) -> Vec<String> {
    let hidden = simulator.publications.iter().filter(|advertised| !advertised.recorded);
    hidden.map(|advertised| advertised.topic.clone()).collect()
}

/// The topics that it speaks on.
pub fn topics(simulator: &Simulator) -> Vec<TopicInfo> {
    let topics = simulator.publications.iter().map(|advertised| TopicInfo {
        topic: advertised.topic.clone(),
        datatype: advertised.datatype.clone(),
        md5sum: advertised.md5sum.clone(),
        definition: advertised.definition.as_str().into(),
        latching: advertised.latching,
        offered_qos: None,
    });
    topics.collect()
}

impl World for PipeWorld<'_> {
    fn next(
        &mut self,
        latest: Vec<LatestMessage>,
        stop: &dyn Fn() -> bool,
    ) -> Result<Option<Moment>, ReplayError> {
        let answer = encoded(latest)?;
        let mut link = self.link.borrow_mut();
        link.send(FrameType::Answer, &answer, self.deadline, stop).map_err(failed)?;
        let mut data = Vec::new();
        loop {
            let frame = link.receive(self.deadline, stop).map_err(failed)?;
            match frame.kind {
                FrameType::Data if data.len() + frame.payload.len() > MOST_DATA => {
                    return Err(wrong(format!("a STEP has more than {MOST_DATA} bytes of DATA")));
                }
                FrameType::Data => data.extend_from_slice(&frame.payload),
                FrameType::Step => return decoded(&frame.payload, &data).map(Some),
                FrameType::End if data.is_empty() => {
                    return check_end(&link, &frame.payload).map(|()| None);
                }
                FrameType::Abort => return Err(ReplayError::Cancelled(Cancellation::PeerGone)),
                kind => {
                    return Err(wrong(format!("expected STEP or END, and {} came", kind.name())));
                }
            }
        }
    }

    fn unrecorded(&self) -> &[String] {
        &self.unrecorded
    }
}

/// The map of ANSWER: topic, type and data of each message. bagpipe/wire/maps/turns.py, with
/// which tests compare it.
#[derive(Debug, Serialize, Deserialize)]
pub struct Answered {
    messages: Vec<(String, String, Value)>,
}

/// The payload of ANSWER.
fn encoded(latest: Vec<LatestMessage>) -> Result<Vec<u8>, ReplayError> {
    let sizes = latest.iter().map(|message| (message.data.len(), message.topic.clone()));
    let largest = sizes.max();
    let messages = latest.into_iter().map(|message| {
        let LatestMessage { topic, datatype, data } = message;
        (topic, datatype, Value::Binary(data))
    });
    let payload = to_map(&Answered { messages: messages.collect() })
        .map_err(|error| ReplayError::Internal(error.to_string()))?;
    match largest {
        Some((bytes, topic)) if payload.len() > MAX_PAYLOAD => Err(wrong(format!(
            "the answers of one step take {} bytes, {bytes} of them on {topic}, and {MAX_PAYLOAD} \
             fit: name a smaller topic as the steps' answer",
            payload.len()
        ))),
        _ => Ok(payload),
    }
}

/// STEP's map as it was read, for the tests that compare both ends of the pipe.
pub fn step_as_read(payload: &[u8]) -> Result<Vec<u8>, String> {
    #[derive(Serialize)]
    struct Step {
        time: u64,
        messages: Vec<(usize, Value)>,
    }
    let Moment { time, messages } = decoded(payload, b"").map_err(|error| error.to_string())?;
    let messages = messages.into_iter().map(|(place, mut frame)| {
        // Behind the length that goes before it on a connection.
        (place, Value::Binary(frame.split_off(4)))
    });
    to_map(&Step { time, messages: messages.collect() }).map_err(|error| error.to_string())
}

/// The moment in a STEP: `{time: u64, messages: [[place, bytes], ...]}`. In place of its bytes a
/// message may have their number: they are the next of `data`, of which nothing may be left.
fn decoded(payload: &[u8], data: &[u8]) -> Result<Moment, ReplayError> {
    let value = rmpv::decode::read_value(&mut &payload[..])
        .map_err(|error| wrong(format!("STEP is not MessagePack: {error}")))?;
    let field = |name: &str| {
        let fields = value.as_map()?;
        fields.iter().find(|(key, _)| key.as_str() == Some(name)).map(|(_, value)| value)
    };
    let (Some(time), Some(listed)) =
        (field("time").and_then(Value::as_u64), field("messages").and_then(Value::as_array))
    else {
        return Err(wrong("STEP needs a time and messages".to_owned()));
    };
    let mut messages = Vec::with_capacity(listed.len());
    let mut rest = data;
    for message in listed {
        let pair = message.as_array().map(Vec::as_slice);
        let Some([place, bytes]) = pair else {
            return Err(wrong("a message in STEP is a place and bytes".to_owned()));
        };
        let Some(place) = place.as_u64() else {
            return Err(wrong(format!("{place} in STEP is no place of a topic")));
        };
        let bytes = match bytes {
            Value::Binary(bytes) => bytes.as_slice(),
            other => taken(&mut rest, other)?,
        };
        // What may come before one STEP is below 4 GiB, so the lengths fit.
        let frame = [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
        messages.push((place as usize, frame));
    }
    if !rest.is_empty() {
        return Err(wrong(format!("{} bytes of DATA belong to no message of STEP", rest.len())));
    }
    Ok(Moment { time, messages })
}

/// The first bytes of the DATA that is left, as many as `length` says.
fn taken<'a>(rest: &mut &'a [u8], length: &Value) -> Result<&'a [u8], ReplayError> {
    let Some(length) = length.as_u64() else {
        return Err(wrong("a message in STEP is a place and bytes".to_owned()));
    };
    let split = usize::try_from(length).ok().and_then(|length| rest.split_at_checked(length));
    let Some((bytes, after)) = split else {
        let left = rest.len();
        return Err(wrong(format!(
            "a message of STEP has {length} bytes, and {left} of DATA came"
        )));
    };
    *rest = after;
    Ok(bytes)
}

fn check_end(link: &Duplex, payload: &[u8]) -> Result<(), ReplayError> {
    let claimed: End =
        from_map(payload).map_err(|error| wrong(format!("END cannot be understood: {error}")))?;
    link.decoder().check_end(claimed).map_err(wrong)
}

fn wrong(message: String) -> ReplayError {
    ReplayError::BadRequest(message)
}

fn failed(error: PipeError) -> ReplayError {
    match error {
        PipeError::PeerGone(_) | PipeError::Cancelled => {
            ReplayError::Cancelled(Cancellation::PeerGone)
        }
        PipeError::Deadline(_) => {
            ReplayError::CaseDeadlineExceeded { during: "while the simulator's turn was awaited" }
        }
        PipeError::Frame(_) | PipeError::Payload(..) => wrong(error.to_string()),
        PipeError::Io(_) => ReplayError::Internal(error.to_string()),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn step(entries: Vec<(Value, Value)>) -> Vec<u8> {
        let mut payload = Vec::new();
        rmpv::encode::write_value(&mut payload, &Value::Map(entries)).unwrap();
        payload
    }

    #[test]
    fn a_step_is_a_time_and_frames_by_place() {
        let message = Value::Array(vec![2.into(), Value::Binary(vec![7, 8])]);
        let payload =
            step(vec![("time".into(), 5.into()), ("messages".into(), vec![message].into())]);
        let expected = Moment { time: 5, messages: vec![(2, vec![2, 0, 0, 0, 7, 8])] };
        assert_eq!(decoded(&payload, b"").unwrap(), expected);
    }

    fn with_lengths(lengths: &[u64]) -> Vec<u8> {
        let messages = lengths.iter().map(|length| Value::Array(vec![1.into(), (*length).into()]));
        step(vec![("time".into(), 5.into()), ("messages".into(), Value::Array(messages.collect()))])
    }

    #[test]
    fn what_does_not_fit_a_step_lies_before_it() {
        let moment = decoded(&with_lengths(&[3, 0, 1]), b"abcd").unwrap();
        let frames: Vec<_> = moment.messages.iter().map(|(_, frame)| &frame[4..]).collect();
        assert_eq!(frames, [&b"abc"[..], b"", b"d"]);
        assert_eq!(moment.messages[0].1[..4], [3, 0, 0, 0]);
        for (lengths, data, words) in [
            (&[5][..], &b"abcd"[..], "has 5 bytes, and 4 of DATA came"),
            (&[3], b"abcd", "1 bytes of DATA belong to no message"),
            (&[u64::MAX], b"", "and 0 of DATA came"),
        ] {
            let error = decoded(&with_lengths(lengths), data).unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
    }

    #[test]
    fn what_is_no_step_is_refused_with_a_sentence() {
        for (entries, words) in [
            (vec![("time".into(), 5.into())], "a time and messages"),
            (
                vec![("time".into(), 5.into()), ("messages".into(), vec![Value::Nil].into())],
                "a place and bytes",
            ),
        ] {
            let error = decoded(&step(entries), b"").unwrap_err().to_string();
            assert!(error.contains(words), "{error}");
        }
        assert!(decoded(b"\xa5ab", b"").unwrap_err().to_string().contains("not MessagePack"));
    }

    #[test]
    fn an_answer_that_fits_no_frame_names_its_topic() {
        let message = |bytes: usize| LatestMessage {
            topic: "/cloud".to_owned(),
            datatype: "sensor_msgs/PointCloud2".to_owned(),
            data: vec![0; bytes],
        };
        assert!(encoded(vec![message(1000)]).unwrap().len() < 1100);
        let error = encoded(vec![message(MAX_PAYLOAD)]).unwrap_err().to_string();
        assert!(error.contains("1048576 of them on /cloud"), "{error}");
    }
}
