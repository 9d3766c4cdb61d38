"""Images of the failing moment: what of a camera's message is shown; damage is a sentence."""

import base64
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bagpipe.definitions import full_name
from bagpipe.evaluate.cameras import first_moment, is_camera, seen
from bagpipe.evaluate.thumbnails import of_compressed, of_image
from bagpipe.pictures import MOST_BYTES, MOST_OF_A_CASE, PictureError, kind_of
from tests.unit.evaluate.recordings import SECOND, STORE, Entry, evidence, header, text

RED, GREEN, BLUE = (255, 0, 0), (0, 255, 0), (0, 0, 255)


def image(
    encoding: str, width: int, height: int, data: bytes, step: int = 0, big: bool = False
) -> Any:
    made = STORE.types["sensor_msgs/msg/Image"]
    array = np.frombuffer(data, np.uint8)
    whole = step or len(data) // max(1, height)
    return made(header(1.0), height, width, encoding, int(big), whole, array)


def compressed(data: bytes, says: str = "jpeg") -> Any:
    made = STORE.types["sensor_msgs/msg/CompressedImage"]
    return made(header(1.0), says, np.frombuffer(data, np.uint8))


def unpacked(data: bytes) -> Any:
    """Rows of pixels of a PNG of ours, by its chunks: colours, or greys."""
    at, chunks = 8, {}
    while at < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        name, body = data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        assert zlib.crc32(name + body) == struct.unpack_from(">I", data, at + 8 + length)[0]
        chunks[name], at = body, at + 12 + length
    width, height, bits, kind = struct.unpack_from(">IIBB", chunks[b"IHDR"])
    depth = {0: 1, 2: 3, 3: 1}[kind]
    rows = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), np.uint8).reshape(height, -1)
    assert (bits, set(rows[:, 0])) == (8, {0 if kind == 3 else 1})
    pixels = rows[:, 1:].reshape(height, width, depth)
    if kind == 3:
        return np.frombuffer(chunks[b"PLTE"], np.uint8).reshape(-1, 3)[pixels[:, :, 0]]
    return np.cumsum(pixels, axis=1, dtype=np.uint8)


def one(kind: str, *pixels: tuple[int, ...], width: int = 2) -> list[list[int]]:
    data = bytes(byte for pixel in pixels for byte in pixel)
    made = of_image(image(kind, width, len(pixels) // width, data))
    assert (made.kind, made.width) == ("image/png", width)
    return [list(map(int, pixel)) for row in unpacked(made.data) for pixel in row]


def test_colours_and_greys_are_what_the_encoding_says() -> None:
    assert one("rgb8", RED, BLUE) == [list(RED), list(BLUE)]
    assert one("bgr8", RED, GREEN) == [list(BLUE), list(GREEN)]
    assert one("rgba8", (*RED, 9), (*BLUE, 9)) == [list(RED), list(BLUE)]
    assert one("bgra8", (*RED, 9), (*BLUE, 9)) == [list(BLUE), list(RED)]
    assert one("mono8", (7,), (200,)) == [[7], [200]]


@pytest.mark.parametrize(
    ("kind", "cell"),
    [
        ("bayer_rggb8", (200, 10, 30, 90)),
        ("bayer_bggr8", (90, 10, 30, 200)),
        ("bayer_gbrg8", (10, 90, 200, 30)),
        ("bayer_grbg8", (10, 200, 90, 30)),
    ],
)
def test_a_cell_of_four_sensors_is_one_pixel(kind: str, cell: tuple[int, ...]) -> None:
    made = of_image(image(kind, 2, 2, bytes(cell)))
    assert unpacked(made.data).tolist() == [[[200, 20, 90]]]


@pytest.mark.parametrize("big", [False, True])
def test_sixteen_bits_go_from_the_least_to_the_greatest_and_nought_is_black(big: bool) -> None:
    data = struct.pack(f"{'>' if big else '<'}4H", 0, 1000, 2000, 3000)
    made = of_image(image("16UC1", 2, 2, data, big=big))
    assert unpacked(made.data)[:, :, 0].tolist() == [[0, 1], [128, 255]]


def test_rows_may_be_longer_than_their_pixels() -> None:
    made = of_image(image("mono8", 1, 2, bytes([5, 99, 99, 6, 99, 99]), step=3))
    assert unpacked(made.data)[:, :, 0].tolist() == [[5], [6]]


@pytest.mark.parametrize("kind", ["rgb8", "mono8"])
def test_noise_is_made_so_small_that_it_fits(kind: str) -> None:
    """Nothing packs worse than noise: so whatever a camera sends fits."""
    size = 3 if kind == "rgb8" else 1
    noise = np.random.default_rng(1).integers(0, 256, 1920 * 1080 * size, np.uint8)
    made = of_image(image(kind, 1920, 1080, noise.tobytes()))
    assert len(made.data) <= MOST_BYTES
    assert (made.width, made.height) == (1920, 1080)
    height, width, _ = unpacked(made.data).shape
    assert width >= 96
    assert abs(width / height - 16 / 9) < 0.03


def test_a_plain_scene_is_as_wide_as_may_be_in_all_its_colours() -> None:
    scene = np.zeros((480, 640, 3), np.uint8)
    scene[:240] = (13, 57, 201)
    found = unpacked(of_image(image("rgb8", 640, 480, scene.tobytes())).data)
    assert found.shape == (240, 320, 3)
    assert found[0, 0].tolist() == [13, 57, 201]
    assert found[239, 319].tolist() == [0, 0, 0]


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (image("yuv422", 2, 1, bytes(4)), "encoded as 'yuv422'"),
        (image("x" * 4000, 2, 1, bytes(4)), "encoded as '" + "x" * 40 + "'"),
        (image("rgb8", 0, 4, bytes(4)), "0 x 4 pixels"),
        (image("rgb8", 1 << 20, 1, bytes(4)), "1048576 x 1 pixels"),
        (image("rgb8", 2, 1, bytes(6), step=5), "rows have 5 bytes, and 2 pixels take 6"),
        (image("rgb8", 2, 2, bytes(11), step=6), "it has 11 bytes of 12"),
        (image("mono8", 60_000, 60_000, bytes(4), step=60_000), "it has 4 bytes of 3,600,000,000"),
        (image("bayer_rggb8", 1, 1, bytes(1)), "no cell of four"),
    ],
)
def test_what_is_no_image_is_a_sentence(message: Any, sentence: str) -> None:
    with pytest.raises(PictureError, match=sentence):
        of_image(message)


PNG = of_image(image("rgb8", 2, 1, bytes(6))).data
JPEG = bytes.fromhex("ffd8ffe000040000ffc0000b080030004001011100ffda0000") + bytes(40)


def test_a_small_compressed_image_passes_as_what_it_is() -> None:
    made = of_compressed(compressed(JPEG, says="image/svg+xml"))
    assert (made.kind, made.data, made.width, made.height) == ("image/jpeg", JPEG, 64, 48)
    assert of_compressed(compressed(PNG)).kind == "image/png"


@pytest.mark.parametrize(
    "data",
    [
        b"<svg xmlns='http://www.w3.org/2000/svg' onload='alert(1)'/>",
        b"GIF89a" + bytes(40), b"\x00" * 12 + PNG, PNG[:20], JPEG[:14], b"",
        # Pixels that would fill a browser: 65,535 by 65,535 of them.
        PNG[:16] + b"\x00\x00\xff\xff" * 2 + PNG[24:],
        JPEG.replace(b"\x00\x30\x00\x40", b"\xff\xff\xff\xff"),
        # A marker without a length, which a decoder passes over by two bytes.
        JPEG[:2] + b"\xff\x01" + JPEG[2:],
        JPEG[:21] + b"\x00" + JPEG[21:],
        # A second frame, by which a decoder may go.
        JPEG[:8] + JPEG[8:21] + JPEG[8:],
    ],
)  # fmt: skip
def test_nothing_else_is_shown_by_whatever_name(data: bytes) -> None:
    assert kind_of(data) is None
    with pytest.raises(PictureError, match="no PNG and no JPEG"):
        of_compressed(compressed(data, says="png"))


def test_a_large_compressed_image_that_can_t_be_unpacked_is_a_sentence() -> None:
    with pytest.raises(PictureError, match=r"its JPEG is damaged: .*SOS"):
        of_compressed(compressed(JPEG + bytes(MOST_BYTES + 1 - len(JPEG))))


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["rgb8", "bgra8", "mono8", "mono16", "16UC1", "bayer_gbrg8", "8UC3", "?"]),
    st.integers(0, 40), st.integers(0, 40), st.integers(0, 200), st.booleans(),
    st.binary(max_size=600),
)  # fmt: skip
def test_of_any_numbers_comes_a_picture_or_a_sentence(
    kind: str, width: int, height: int, step: int, big: bool, data: bytes
) -> None:
    message = image(kind, width, height, data)
    message.step, message.is_bigendian = step, int(big)
    try:
        made = of_image(message)
    except PictureError:
        return
    found = kind_of(made.data)
    assert found is not None
    assert found.kind == "image/png"
    assert len(made.data) <= MOST_BYTES
    assert unpacked(made.data).size > 0


@settings(max_examples=300, deadline=None)
@given(st.sampled_from([PNG, JPEG]), st.lists(st.tuples(st.integers(0, 200), st.integers(0, 255))))
def test_of_any_bytes_comes_what_is_small_or_nothing(data: bytes, hits: list[Any]) -> None:
    damaged = bytearray(data)
    for place, byte in hits:
        damaged[place % len(damaged)] = byte
    found = kind_of(bytes(damaged))
    assert found is None or found.width * found.height <= 4_000_000


def shown(entries: list[Entry], at: float, played: list[Entry] | None = None) -> Any:
    made = evidence(entries, played or [])
    outputs = {topic: lambda: made.recorded for topic, _, _ in entries}
    inputs = {topic: lambda: made.source for topic, _, _ in played or []}
    return seen(outputs, inputs, made.start, round(at * SECOND))


def grey(value: int) -> Any:
    return image("mono8", 1, 1, bytes([value]))


def value_of(found: dict[str, Any]) -> int:
    return int(unpacked(base64.b64decode(found["data"]))[0, 0, 0])


def test_the_last_image_until_the_moment_is_shown_of_output_and_input() -> None:
    outputs = [("/seen", 11.0, grey(1)), ("/seen", 12.0, grey(2)), ("/seen", 13.0, grey(3))]
    inputs = [("/cam", 11.9, grey(4)), ("/cam", 12.1, grey(5))]
    found = shown(outputs, 12.0, inputs)
    assert [(f["topic"], f["of"], f["at"], value_of(f)) for f in found] == [
        ("/seen", "output", 2.0, 2),
        ("/cam", "input", 1.9, 4),
    ]
    assert [(f["width"], f["height"], f["type"]) for f in found] == [(1, 1, "image/png")] * 2


def test_of_many_cameras_two_are_shown() -> None:
    many = [(f"/{name}", 11.0, grey(1)) for name in "abcd"]
    assert [f["topic"] for f in shown(many, 12.0)] == ["/a", "/b"]
    both = shown(many, 12.0, [("/in", 11.0, grey(1)), ("/on", 11.0, grey(1))])
    assert [f["topic"] for f in both] == ["/a", "/in"]
    assert len(both) == MOST_OF_A_CASE


def test_what_can_t_be_shown_is_a_sentence_in_the_row() -> None:
    broken = image("rgb8", 9, 9, bytes(3), step=27)
    (late, damaged) = shown([("/a", 13.0, grey(1)), ("/b", 11.0, broken)], 12.0)
    assert late["fault"] == "there is no image until the failing moment"
    assert damaged["fault"] == "it has 3 bytes of 243"
    (other,) = shown([("/c", 11.0, text("no image"))], 12.0)
    assert other["fault"] == "its definition is not that of a camera's images"


def test_a_moment_is_the_first_of_what_failed() -> None:
    course = {"low": None, "high": 1.0, "points": [[0.5, 0.0], [1.5, 2.0], [2.5, 3.0]]}
    finding = {"name": "n", "kind": "bounds", "outcome": "failed", "message": "m"}
    assert first_moment([finding | {"course": course}], SECOND) == round(2.5 * SECOND) + 50_000
    assert first_moment([finding | {"outcome": "passed", "course": course}], SECOND) is None


def test_cameras_are_known_by_their_type() -> None:
    assert is_camera("sensor_msgs/Image")
    assert is_camera("sensor_msgs/msg/CompressedImage")
    assert not is_camera("stereo_msgs/DisparityImage")
    assert full_name("sensor_msgs/Image") == "sensor_msgs/msg/Image"
