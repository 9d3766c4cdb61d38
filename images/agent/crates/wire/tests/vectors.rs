//! The vectors of docs/reference/binpipe-vectors.json, which the Python side reads as well.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use bagpipe_wire::{Decoder, Encoder, FrameError, FrameType, from_map};
use serde::Deserialize;

#[derive(Deserialize)]
struct Vector {
    name: String,
    hex: String,
    #[serde(default)]
    frames: Vec<Expected>,
    error: Option<ExpectedError>,
    digest: Option<u32>,
}

#[derive(Deserialize, PartialEq, Debug)]
struct Expected {
    r#type: String,
    flags: u16,
    sequence: u32,
    payload_hex: String,
}

#[derive(Deserialize)]
struct ExpectedError {
    reason: String,
    offset: u64,
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn vectors() -> Vec<Vector> {
    // As cargo says it now: what was compiled may come from the cache of another checkout.
    let here = std::env::var("CARGO_MANIFEST_DIR").unwrap();
    let page = format!("{here}/../../../../docs/reference/binpipe-vectors.json");
    serde_json::from_str(&std::fs::read_to_string(page).unwrap()).unwrap()
}

/// Decodes a stream given in pieces of `step` bytes.
fn decode(stream: &[u8], step: usize) -> (Vec<Expected>, Option<FrameError>, u32) {
    let mut decoder = Decoder::new();
    let mut frames = Vec::new();
    for mut piece in stream.chunks(step.max(1)) {
        while !piece.is_empty() {
            match decoder.next_frame(&mut piece) {
                Ok(Some(frame)) => frames.push(Expected {
                    r#type: frame.kind.name().to_owned(),
                    flags: frame.flags,
                    sequence: frame.sequence,
                    payload_hex: hex(frame.payload),
                }),
                Ok(None) => {}
                Err(error) => return (frames, Some(error), 0),
            }
        }
    }
    (frames, decoder.finish().err(), decoder.digest())
}

#[test]
fn every_vector_decodes_as_it_says() {
    let all = vectors();
    assert_eq!(all.len(), 33);
    for vector in &all {
        for step in [1, 3, 20, usize::MAX] {
            let (frames, error, digest) = decode(&bytes(&vector.hex), step);
            assert_eq!(frames, vector.frames, "{}", vector.name);
            match (&vector.error, error) {
                (None, None) => {}
                (Some(expected), Some(found)) => {
                    assert_eq!(found.field, expected.reason, "{}", vector.name);
                    assert_eq!(found.offset, expected.offset, "{}", vector.name);
                }
                (_, found) => panic!("{}: {found:?}", vector.name),
            }
            if let Some(expected) = vector.digest {
                assert_eq!(digest, expected);
            }
        }
    }
}

#[test]
fn the_encoder_makes_the_good_vectors() {
    let kinds = (1..=9).filter_map(FrameType::from_number).collect::<Vec<_>>();
    for vector in vectors().iter().filter(|vector| vector.error.is_none()) {
        let mut encoder = Encoder::new();
        let mut stream = Vec::new();
        for frame in &vector.frames {
            let kind = *kinds.iter().find(|kind| kind.name() == frame.r#type).unwrap();
            let payload = bytes(&frame.payload_hex);
            if let (FrameType::End, Some(_)) = (kind, vector.digest) {
                assert_eq!(encoder.end(), from_map(&payload).unwrap());
            }
            stream.extend_from_slice(&encoder.header(kind, &payload).unwrap());
            stream.extend_from_slice(&payload);
        }
        assert_eq!(hex(&stream), vector.hex, "{}", vector.name);
    }
}

#[test]
fn a_message_says_where_and_what() {
    let vector = vectors().into_iter().find(|vector| vector.name == "second sequence skips");
    let (_, error, _) = decode(&bytes(&vector.unwrap().hex), 7);
    assert_eq!(
        error.unwrap().to_string(),
        "the frame at byte 23 of the stream has a wrong sequence: expected 1, found 2"
    );
}
