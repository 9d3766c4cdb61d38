//! The decoder and the encoder against each other, over random streams and damage.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use bagpipe_wire::{Decoder, Encoder, FrameType, MAX_PAYLOAD, OwnedFrame};
use proptest::prelude::*;

fn stream(frames: &[(FrameType, Vec<u8>)]) -> Vec<u8> {
    let mut encoder = Encoder::new();
    let mut bytes = Vec::new();
    for (kind, payload) in frames {
        bytes.extend_from_slice(&encoder.header(*kind, payload).unwrap());
        bytes.extend_from_slice(payload);
    }
    bytes
}

fn decode(pieces: &[&[u8]]) -> Result<Vec<OwnedFrame>, bagpipe_wire::FrameError> {
    let mut decoder = Decoder::new();
    let mut frames = Vec::new();
    for piece in pieces {
        let mut piece = *piece;
        while !piece.is_empty() {
            frames.extend(decoder.next_frame(&mut piece)?.map(bagpipe_wire::Frame::to_owned));
        }
    }
    decoder.finish().map(|()| frames)
}

fn frames() -> impl Strategy<Value = Vec<(FrameType, Vec<u8>)>> {
    let kind = (1u8..=7).prop_map(|number| FrameType::from_number(number).unwrap());
    prop::collection::vec((kind, prop::collection::vec(any::<u8>(), 1..200)), 0..12)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 3000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_split_gives_the_same_frames(
        sent in frames(),
        cuts in prop::collection::vec(any::<prop::sample::Index>(), 0..20),
    ) {
        let bytes = stream(&sent);
        let mut cuts: Vec<usize> = cuts.iter().map(|cut| cut.index(bytes.len() + 1)).collect();
        cuts.extend([0, bytes.len()]);
        cuts.sort_unstable();
        let pieces: Vec<&[u8]> = cuts.windows(2).map(|pair| &bytes[pair[0]..pair[1]]).collect();
        let received = decode(&pieces).unwrap();
        prop_assert_eq!(received.len(), sent.len());
        for (number, (frame, (kind, payload))) in received.iter().zip(&sent).enumerate() {
            prop_assert_eq!(frame.kind, *kind);
            prop_assert_eq!(frame.sequence, number as u32);
            prop_assert_eq!(&frame.payload, payload);
        }
    }

    #[test]
    fn any_damage_is_an_error_that_names_the_frame(
        sent in frames(),
        at in any::<prop::sample::Index>(),
        flip in 1u8..,
    ) {
        let mut bytes = stream(&sent);
        prop_assume!(!bytes.is_empty());
        let at = at.index(bytes.len());
        bytes[at] ^= flip;
        let error = decode(&[&bytes]).unwrap_err();
        prop_assert!(error.offset <= at as u64, "{} at {}", error, at);
        prop_assert!(at as u64 - error.offset < 20 + 200, "{} at {}", error, at);
    }

    #[test]
    fn noise_is_an_error(noise in prop::collection::vec(any::<u8>(), 1..400)) {
        prop_assert_eq!(decode(&[&noise]).unwrap_err().offset, 0);
    }
}

#[test]
fn payloads_end_at_one_mebibyte() {
    let whole = vec![7; MAX_PAYLOAD + 1];
    assert!(Encoder::new().header(FrameType::Data, &whole).is_none());
    assert!(Encoder::new().header(FrameType::Data, &[]).is_none());
    let bytes = stream(&[(FrameType::Data, whole[..MAX_PAYLOAD].to_vec())]);
    assert_eq!(bytes.len(), MAX_PAYLOAD + 20);
    assert_eq!(decode(&[&bytes]).unwrap()[0].payload.len(), MAX_PAYLOAD);
}
