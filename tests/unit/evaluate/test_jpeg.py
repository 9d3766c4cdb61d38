"""JPEGs of cameras as small pictures, beside Pillow's; what is damaged is a sentence."""

import io
import random
import subprocess
import sys
from typing import Any

import numpy as np
import pytest
from bagpipe_bag import jpeg_pixels
from PIL import Image

from bagpipe.evaluate.thumbnails import of_compressed
from bagpipe.pictures import MOST_BYTES, PictureError
from tests.unit.evaluate.test_cameras import compressed, unpacked

WIDTH, HEIGHT = 640, 480
# Of 255: other decoders round the inverse transform and the colours otherwise.
APART = 4


def scene(width: int = WIDTH, height: int = HEIGHT) -> Any:
    """A smooth picture whose four quarters have colours of their own."""
    rows, columns = np.mgrid[:height, :width]
    right, low = columns >= width // 2, rows >= height // 2
    return np.stack(
        [
            np.where(right, 220, 30), np.where(low, 200, 60),
            100 + 50 * rows // max(1, height) + 50 * columns // max(1, width),
        ],
        axis=2,
    ).astype(np.uint8)  # fmt: skip


def jpeg(pixels: Any, mode: str = "RGB", **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(pixels).convert(mode).save(file, "JPEG", **({"quality": 92} | options))
    return file.getvalue()


def grainy(**options: Any) -> bytes:
    """Of more bytes than are shown as they are."""
    noise = np.random.default_rng(7).integers(0, 40, (HEIGHT, WIDTH, 3), np.uint8)
    made = jpeg(scene() // 2 + noise, **options)
    assert len(made) > MOST_BYTES
    return made


def pixels_of(data: bytes, side: int = 1 << 16) -> Any:
    width, height, rows, columns, channels, found = jpeg_pixels(data, side)
    assert (width, height) == Image.open(io.BytesIO(data)).size
    return np.frombuffer(found, np.uint8).reshape(rows, columns, channels)


@pytest.mark.parametrize(
    "options",
    [
        {"subsampling": "4:4:4"}, {"subsampling": "4:2:2"}, {"subsampling": "4:2:0"},
        {"progressive": True}, {"progressive": True, "subsampling": "4:4:4"},
        {"optimize": True}, {"restart_marker_rows": 1}, {"restart_marker_blocks": 3},
        {"progressive": True, "restart_marker_rows": 1},
        {"progressive": True, "restart_marker_blocks": 3, "subsampling": "4:2:0"},
        {"quality": 30},
    ],
    ids=str,
)  # fmt: skip
@pytest.mark.parametrize("size", [(640, 480), (33, 17), (8, 8), (1, 1)], ids=str)
def test_the_pixels_are_those_of_another_decoder(
    options: dict[str, Any], size: tuple[int, int]
) -> None:
    data = jpeg(scene(*size), **options)
    theirs = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)
    ours = pixels_of(data).astype(int)
    assert ours.shape == theirs.shape
    # Where colours are halved both decoders guess what lies between.
    whole = options.get("subsampling") == "4:4:4"
    apart = np.abs(ours - theirs)
    assert apart.mean() < 1
    assert np.percentile(apart, 99 if not whole else 100) <= APART


def test_grey_has_one_channel() -> None:
    data = jpeg(scene(), "L")
    theirs = np.asarray(Image.open(io.BytesIO(data))).astype(int)
    ours = pixels_of(data).astype(int)
    assert ours.shape == (HEIGHT, WIDTH, 1)
    assert np.abs(ours[:, :, 0] - theirs).max() <= APART


def test_few_pixels_are_spread_evenly() -> None:
    data = jpeg(scene(), subsampling="4:4:4")
    few, all_of_it = pixels_of(data, 320), pixels_of(data)
    assert few.shape == (240, 320, 3)
    assert (few == all_of_it[::2, ::2]).all()
    tall = pixels_of(jpeg(scene(30, 1000)), 100)
    assert tall.shape == (100, 3, 3)


@pytest.mark.parametrize("progressive", [False, True])
def test_a_large_one_becomes_a_small_png_of_the_same_colours(progressive: bool) -> None:
    data = grainy(progressive=progressive)
    made = of_compressed(compressed(data, says="bgr8; jpeg compressed bgr8"))
    assert (made.kind, made.width, made.height) == ("image/png", WIDTH, HEIGHT)
    assert len(made.data) <= MOST_BYTES
    theirs = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(float)
    ours = unpacked(made.data).astype(float)
    for down in (0, 1):
        for across in (0, 1):
            quarter = [
                half(half(each, 0, down), 1, across).mean(axis=(0, 1)) for each in (ours, theirs)
            ]
            # A step of the few colours that a file of grain gets.
            assert np.abs(quarter[0] - quarter[1]).max() < 51


def half(pixels: Any, axis: int, which: int) -> Any:
    return np.array_split(pixels, 2, axis=axis)[which]


def test_a_small_one_is_taken_as_it_is() -> None:
    data = jpeg(scene(64, 48))
    assert of_compressed(compressed(data)).data == data


def test_a_large_file_of_another_kind_is_not_shown() -> None:
    file = io.BytesIO()
    Image.fromarray(np.random.default_rng(1).integers(0, 255, (99, 99, 3), np.uint8)).save(
        file, "PNG"
    )
    with pytest.raises(PictureError, match="bytes and is no JPEG: of others no more than 16,384"):
        of_compressed(compressed(file.getvalue()))


def frame(data: bytes) -> int:
    """Where the frame's marker is."""
    return max(data.find(b"\xff\xc0"), data.find(b"\xff\xc2"))


def with_size(data: bytes, width: int, height: int) -> bytes:
    at = frame(data) + 5
    return data[:at] + height.to_bytes(2, "big") + width.to_bytes(2, "big") + data[at + 4 :]


def with_bits(data: bytes, bits: int) -> bytes:
    at = frame(data) + 4
    return data[:at] + bytes([bits]) + data[at + 1 :]


def taken(data: bytes) -> float:
    """MiB by which a process of its own grows while it unpacks."""
    program = (
        "import re, sys\n"
        "from pathlib import Path\n"
        "from bagpipe_bag import jpeg_pixels\n"
        "def most():\n"
        "    status = Path('/proc/self/status').read_text()\n"
        "    return int(re.search(r'VmHWM:\\s+(\\d+)', status)[1])\n"
        "data = sys.stdin.buffer.read()\n"
        "before = most()\n"
        "try:\n    jpeg_pixels(data, 320)\nexcept ValueError:\n    pass\n"
        "print(most() - before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], input=data, capture_output=True, timeout=60, check=True
    )
    return int(done.stdout) / 1024


@pytest.mark.parametrize(
    ("size", "options"),
    [
        ((4096, 4096), {"subsampling": "4:4:4"}),
        ((3840, 2160), {"subsampling": "4:4:4", "progressive": True}),
    ],
    ids=["baseline", "progressive"],
)
def test_the_largest_pictures_take_150_mib_at_most(
    size: tuple[int, int], options: dict[str, Any]
) -> None:
    data = jpeg(scene(*size), **options)
    assert pixels_of(data, 320).shape[1] == 320
    assert 20 < taken(data) < 150


@pytest.mark.parametrize("progressive", [False, True])
def test_a_head_that_claims_a_wall_of_pixels_costs_no_memory(progressive: bool) -> None:
    data = with_size(grainy(progressive=progressive), 65_535, 65_535)
    with pytest.raises(PictureError, match=r"65535 x 65535 pixels in \d+ scans: more than is"):
        of_compressed(compressed(data))
    # Of the 12 GiB that it would take.
    assert taken(data) < 8


def test_more_scans_than_a_picture_has_are_not_gone_through() -> None:
    data = grainy(progressive=True)
    scan = data.index(b"\xff\xda")
    end = data.index(b"\xff\xda", scan + 2)
    bomb = with_size(data[:scan] + data[scan:end] * 2000 + data[end:], 2048, 2048)
    with pytest.raises(PictureError, match=r"2048 x 2048 pixels in 20\d\d scans: more than"):
        of_compressed(compressed(bomb))


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        (jpeg(scene(), "CMYK", quality=100), "not of 8 bits, in grey or in three colours"),
        (grainy().replace(b"\xff\xc0", b"\xff\xc3", 1), "is lossless or has arithmetic codes"),
        (with_bits(grainy(), 12), "not of 8 bits, in grey or in three colours"),
        (with_size(grainy(), 0, 480), "it has no pixels"),
        (with_size(grainy(), 640, 0), "it has no pixels"),
        (grainy()[: frame(grainy())] + bytes(MOST_BYTES), "it has no frame, or no scan"),
        (grainy()[:-2] + grainy()[2:], "it has several frames"),
    ],
    ids=["cmyk", "lossless", "12 bits", "no width", "no height", "no frame", "twice"],
)
def test_what_is_not_unpacked_is_a_sentence(data: bytes, sentence: str) -> None:
    with pytest.raises(PictureError, match=sentence):
        of_compressed(compressed(data + bytes(MOST_BYTES)))


def shown_or_refused(data: bytes) -> bool:
    """Whether it is shown; any error but a sentence fails the test."""
    try:
        width, height, rows, columns, channels, pixels = jpeg_pixels(data, 320)
    except ValueError as error:
        assert str(error)
        return False
    assert len(pixels) == rows * columns * channels
    assert max(rows, columns) <= 320
    assert width * height <= 1 << 24
    return True


@pytest.mark.parametrize("progressive", [False, True])
def test_a_file_that_is_cut_anywhere_is_shown_in_part_or_refused(progressive: bool) -> None:
    data = jpeg(scene(48, 32), progressive=progressive)
    shown = [shown_or_refused(data[:end]) for end in range(len(data))]
    assert not any(shown[: frame(data)])
    assert shown_or_refused(data)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"progressive": True},
        {"restart_marker_rows": 1},
        {"progressive": True, "restart_marker_blocks": 2},
    ],
    ids=str,
)
def test_damaged_files_are_shown_or_refused(options: dict[str, Any]) -> None:
    chance = random.Random(11)  # noqa: S311  damage of the same bytes each time
    data = jpeg(scene(64, 48), **options)
    outcomes = []
    for _ in range(1500):
        bytes_ = bytearray(data)
        for _ in range(chance.randint(1, 6)):
            bytes_[chance.randrange(2, len(bytes_))] = chance.randrange(256)
        outcomes.append(shown_or_refused(bytes(bytes_)))
    assert any(outcomes)
    assert not all(outcomes)


@pytest.mark.parametrize("marker", [0xD8, 0x01, 0xDC, 0xF7])
def test_a_head_that_hides_another_one_does_not_make_a_larger_picture(marker: int) -> None:
    """Whether a marker has a length is read in two ways: what lies in its segment is not ours."""
    data = grainy()
    hidden = with_size(data, 4000, 4000)[frame(data) : frame(data) + 19]
    segment = bytes([0xFF, marker]) + (2 + len(hidden)).to_bytes(2, "big") + hidden
    whole = data[:20] + segment + data[20:]
    try:
        made = of_compressed(compressed(whole))
        assert (made.width, made.height) == (WIDTH, HEIGHT)
    except PictureError as error:
        assert str(error)
    # 4,000 by 4,000 pixels would take 46.
    assert taken(whole) < 20
