"""The codec against the shared vectors, and against streams cut and damaged anywhere."""

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe.wire.frames import Decoder, Encoder, FrameType, ProtocolError, payloads

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
        # A length that grew waits for bytes that never come: the end of the stream shows it.
        assert decoder.pending > 0
        assert len(frames) < len(payloads)


@pytest.mark.parametrize("length", [0, 1, 2**20 - 1, 2**20, 2**20 + 1, 3 * 2**20, 3 * 2**20 + 7])
@pytest.mark.parametrize("kind", [bytes, memoryview])
def test_data_goes_out_in_as_few_payloads_as_hold_it(kind: type, length: int) -> None:
    data = bytes(range(251)) * (length // 251 + 1)
    found = list(payloads(kind(data[:length])))
    whole, rest = divmod(length, 2**20)
    assert [len(each) for each in found] == [2**20] * whole + ([rest] if rest else [])
    assert b"".join(found) == data[:length]


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


LARGE = 300_000


def received(stream: bytes, reads: list[int]) -> tuple[list[tuple[FrameType, bytes]], Decoder]:
    """The frames of a stream as a worker reads it: what is missing of a large one as it is."""
    decoder, found, at, number = Decoder(), [], 0, 0
    while at < len(stream):
        most = reads[number % len(reads)]
        number += 1
        if missing := decoder.missing:
            piece = stream[at : at + min(most, missing)]
            at += len(piece)
            if pieces := decoder.rest(piece):
                assert all(pieces)
                found.append((FrameType.DATA, b"".join(pieces)))
            continue
        space = decoder.space()
        count = min(len(space), most, len(stream) - at)
        space[:count] = stream[at : at + count]
        at += count
        found += [(frame.type, frame.payload) for frame in decoder.received(count)]
    return found, decoder


LARGE_ONES = st.sampled_from([1, 20, 4_000, 262_143, 262_144, 262_145, LARGE, 1 << 20])


@settings(deadline=None)
@given(
    lengths=st.lists(st.tuples(LARGE_ONES, st.booleans()), max_size=5),
    reads=st.lists(
        st.sampled_from([7, 3_000, 65_536, 200_000, 1 << 20]), min_size=1, max_size=4
    ).filter(lambda reads: max(reads) > 7),
)
def test_large_frames_come_without_a_copy_and_are_the_same(
    lengths: list[tuple[int, bool]], reads: list[int]
) -> None:
    payloads = [
        (FrameType.DATA if data else FrameType.FILE, bytes([n + 1]) * length)
        for n, (length, data) in enumerate(lengths)
    ]
    encoder = Encoder()
    stream = b"".join(b"".join(encoder.encode(*payload)) for payload in payloads)
    digest = encoder.digest
    stream += encoder.encode_fields(FrameType.END, {"digest": digest})
    found, decoder = received(stream, reads)
    assert found[:-1] == payloads
    assert (decoder.pending, decoder.missing) == (0, 0)
    assert decoder.digest_before_last == digest


@pytest.mark.parametrize("at", [16, 20, 70_000, LARGE + 19])
def test_a_large_frame_that_is_damaged_gives_none_of_its_pieces(at: int) -> None:
    whole = encoded([(FrameType.DATA, b"a"), (FrameType.DATA, bytes(LARGE))])
    stream = bytearray(whole)
    stream[21 + at] ^= 1
    with pytest.raises(ProtocolError, match="crc32c") as refused:
        received(bytes(stream), [65_536])
    assert refused.value.offset == 21
    cut, decoder = received(whole[:-1], [65_536])
    assert cut == [(FrameType.DATA, b"a")]
    assert (decoder.pending, decoder.missing) == (LARGE + 19, 1)


def test_a_large_frame_in_tiny_parts_takes_no_object_for_each() -> None:
    stream = encoded([(FrameType.DATA, bytes(LARGE))])
    decoder = Decoder()
    decoder.space()[:30] = stream[:30]
    assert list(decoder.received(30)) == []
    assert decoder.missing == len(stream) - 30
    assert decoder.rest(stream[30:-20_000]) == []
    for at in range(len(stream) - 20_000, len(stream) - 1):
        assert decoder.rest(stream[at : at + 1]) == []
    pieces = decoder.rest(stream[-1:])
    assert [len(piece) for piece in pieces] == [10, LARGE - 20_010, 20_000]
