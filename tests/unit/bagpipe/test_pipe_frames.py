"""The codec against the shared vectors, and against streams cut and damaged anywhere."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bagpipe.pipe.frames import Decoder, Encoder, FrameType, ProtocolError

VECTORS = json.loads(
    (Path(__file__).parents[3] / "docs/reference/binpipe-vectors.json").read_text()
)


def by_name(vectors: list[dict[str, Any]]) -> dict[str, Any]:
    return {"argvalues": vectors, "ids": [vector["name"] for vector in vectors]}


@pytest.mark.parametrize("vector", **by_name([v for v in VECTORS if "error" not in v]))
def test_good_vectors_decode_and_encode_to_the_same_bytes(vector: dict[str, Any]) -> None:
    data = bytes.fromhex(vector["hex"])
    frames = list(Decoder().feed(data))
    assert [
        {
            "type": f.type.name,
            "flags": f.flags,
            "sequence": f.sequence,
            "payload_hex": f.payload.hex(),
        }
        for f in frames
    ] == vector["frames"]
    encoder = Encoder()
    assert b"".join(b"".join(encoder.encode(f.type, f.payload)) for f in frames) == data


@pytest.mark.parametrize("vector", **by_name([v for v in VECTORS if "error" in v]))
def test_bad_vectors_are_refused_at_their_offset(vector: dict[str, Any]) -> None:
    decoder = Decoder()
    if vector["error"]["reason"] == "truncated":
        list(decoder.feed(bytes.fromhex(vector["hex"])))
        assert decoder.pending > 0
        return
    with pytest.raises(ProtocolError) as refused:
        list(decoder.feed(bytes.fromhex(vector["hex"])))
    assert refused.value.offset == vector["error"]["offset"]


FRAMES = st.tuples(st.sampled_from(FrameType), st.binary(max_size=300))
PAYLOADS = st.lists(
    FRAMES.filter(lambda frame: frame[0] is not FrameType.DATA or len(frame[1]) > 0), max_size=8
)


def encoded(payloads: list[tuple[FrameType, bytes]]) -> bytes:
    encoder = Encoder()
    return b"".join(b"".join(encoder.encode(kind, payload)) for kind, payload in payloads)


@given(payloads=PAYLOADS, step=st.integers(1, 97))
def test_frames_survive_any_split_of_the_stream(
    payloads: list[tuple[FrameType, bytes]], step: int
) -> None:
    stream = encoded(payloads)
    decoder = Decoder()
    frames = [f for at in range(0, len(stream), step) for f in decoder.feed(stream[at : at + step])]
    assert [(f.type, f.payload) for f in frames] == payloads
    assert decoder.pending == 0


@given(payloads=PAYLOADS.filter(bool), data=st.data())
def test_any_changed_byte_is_noticed(
    payloads: list[tuple[FrameType, bytes]], data: st.DataObject
) -> None:
    stream = bytearray(encoded(payloads))
    at = data.draw(st.integers(0, len(stream) - 1))
    stream[at] ^= data.draw(st.integers(1, 255))
    decoder = Decoder()
    try:
        frames = list(decoder.feed(bytes(stream)))
    except ProtocolError as error:
        assert 0 <= error.offset <= at
    else:
        # A length that grew waits for bytes that never come: the end of the stream tells.
        assert decoder.pending > 0
        assert len(frames) < len(payloads)


def test_a_payload_above_one_mebibyte_is_not_encoded() -> None:
    with pytest.raises(ValueError, match="above 1 MiB"):
        Encoder().encode(FrameType.DATA, bytes((1 << 20) + 1))


def test_a_map_that_is_not_messagepack_is_a_protocol_error() -> None:
    (frame,) = Decoder().feed(encoded([(FrameType.RESULT, b"\xc1")]))
    with pytest.raises(ProtocolError, match="not MessagePack"):
        frame.fields()
    (frame,) = Decoder().feed(encoded([(FrameType.RESULT, b"\x01")]))
    with pytest.raises(ProtocolError, match="expected a map"):
        frame.fields()
