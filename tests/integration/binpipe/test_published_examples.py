"""The published design's own examples of user logic, on real photographs and real LiDAR."""

import io
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pyspark import SparkContext

import bagpipe
from bagpipe.binpiped.record import Fields
from tests.integration.binpipe.conftest import EXAMPLES, ROOT, python
from tests.photographs import STREET, fetch

LIDAR = ROOT.parent / "shared/data/luminar_lz4.bag"
# (left, top, width, height) in pixels of the two who walk in the foreground, measured by eye. A
# third one walks close behind the first: two bodies in one window are more than HOG can part.
WALKING = [(50, 400, 195, 505), (670, 395, 140, 485)]
SCANS, SCAN_SECONDS = 5, 0.1


Box = tuple[int, int, int, int]


def box(fields: Fields) -> Box:
    left, top, width, height = (int(fields[key]) for key in ("left", "top", "width", "height"))
    return left, top, width, height


def overlap(one: Box, other: Box) -> float:
    """What both cover, as a share of what either covers."""
    width = min(one[0] + one[2], other[0] + other[2]) - max(one[0], other[0])
    height = min(one[1] + one[3], other[1] + other[3]) - max(one[1], other[1])
    shared = max(0, width) * max(0, height)
    return shared / (one[2] * one[3] + other[2] * other[3] - shared)


def uris() -> list[str]:
    return [f"file://{path}" for path in fetch().values()]


def test_jpegs_are_rotated_by_90_degrees(context: SparkContext, tmp_path: Path) -> None:
    piped = bagpipe.bin_piped(context, uris(), command=python(EXAMPLES / "rotate.py"))
    saved = piped.save_as_binary_files(str(tmp_path / "out"))
    assert len(saved.records) == 2
    for record in saved.records:
        original = Path(record.name.removeprefix("file://").removesuffix(".png"))
        with Image.open(original) as image, Image.open(tmp_path / "out" / record.file) as rotated:
            # Pillow says what a right angle is; both libraries decode JPEG by the same rules.
            expected = np.asarray(image.convert("RGB").transpose(Image.Transpose.ROTATE_270))
            got = np.asarray(rotated.convert("RGB"))
        assert got.shape == expected.shape == (image.width, image.height, 3)
        assert record.fields == {"width": image.height, "height": image.width}
        difference = np.abs(got.astype(int) - expected.astype(int))
        assert (difference.max(), difference.mean()) <= (4, 0.1)


def test_pedestrians_are_found_where_people_walk(context: SparkContext) -> None:
    piped = bagpipe.bin_piped(context, uris(), command=python(EXAMPLES / "pedestrians.py"))
    found = piped.collect_records()
    assert [Path(record.name).name for record in found] == [STREET, STREET]
    boxes = sorted(box(record.fields) for record in found)
    assert [overlap(got, real) > 0.5 for got, real in zip(boxes, WALKING, strict=True)] == [
        True
    ] * 2
    for record in found:
        with Image.open(io.BytesIO(record.data)) as cut:
            assert cut.width == min(record.fields["width"], 810 - record.fields["left"])


@pytest.mark.skipif(
    not LIDAR.exists(), reason="the recording luminar_lz4.bag is not beside this checkout"
)
def test_obstacles_are_clustered_in_real_lidar(context: SparkContext) -> None:
    piped = bagpipe.bin_piped(context, str(LIDAR), command=python(EXAMPLES / "obstacles.py"))
    scans = defaultdict(list)
    for record in piped.collect_records():
        points = np.frombuffer(record.data, "<f4").reshape(-1, 3)
        assert len(points) == record.fields["points"] >= 30
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        assert [record.fields[axis] for axis in "xyz"] == pytest.approx(middle * 1000, abs=1)
        scans[record.fields["time"]].append(record.fields)
    assert len(scans) == SCANS
    assert all(20 <= len(obstacles) <= 40 for obstacles in scans.values())
    # The largest stands still beside the road: the sensor drives past it at about 22 m/s.
    largest = [scans[time][0] for time in sorted(scans)]
    assert all(abs(obstacle["x"] - 14_300) < 500 for obstacle in largest)
    speeds = np.diff([obstacle["y"] for obstacle in largest]) / 1000 / SCAN_SECONDS
    assert all(-27 < speed < -15 for speed in speeds)
    # One ahead on the left is a car: so large, there in every scan, and it pulls away.
    car = [
        next(o for o in scans[time] if abs(o["x"] + 4_530) < 150 and 20_000 < o["y"] < 30_000)
        for time in sorted(scans)
    ]
    assert all(1_400 < o["length"] < 2_100 and 2_000 < o["width"] < 3_600 for o in car)
    assert [o["y"] for o in car] == sorted(o["y"] for o in car)
