"""`bagpipe open`: one file of what a case was given, what came of it, and what was found in it."""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit
from xml.etree import ElementTree as ET

import pytest
import yaml
from click.testing import CliRunner
from mcap.reader import make_reader

from bagpipe.cli.__main__ import main
from bagpipe.moments import Moment, moments
from bagpipe.view.layouts import foxglove, plotjuggler, rviz
from bagpipe.view.recording import Topic
from bagpipe.view.server import foxglove_link
from tests.mcap_of_bag import mcap_of
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

SECOND = 1_000_000_000
TENTH = SECOND // 10
# The window begins two seconds into the recording of ten and lasts six.
WINDOW = [2 * SECOND, 3 * SECOND, 9 * SECOND]


def finding(name: str, points: list[list[float]], **changed: Any) -> dict[str, Any]:
    course = {"label": "x", "unit": "m", "low": None, "high": 1.0, "points": points}
    found = {"name": name, "kind": "bounds", "outcome": "failed", "message": f"why {name}"}
    return found | {"course": course} | changed


LANE = finding("in the lane", [[0.0, 0.1], [3.0, 0.5], [4.5, 1.5], [5.0, 0.2]])


@pytest.fixture
def results(tmp_path: Path) -> Path:
    """A case that failed 4.5 s into its window, with /lane both recorded and published."""
    given = steady("/scan", 100, TENTH, SECOND) + steady("/lane", 100, TENTH, SECOND)
    given.append(Recorded("/map", SECOND, "the map", latching=True))
    given.sort(key=lambda message: message.time)
    write_bag(tmp_path / "a.bag", given, chunk_bytes=1024)
    rows = [
        make_row(
            "a-0000", "failed", "CriteriaFailed", recorded="cases/a-0000.bag",
            window=WINDOW, criteria=[LANE], result=None,
        ),
        make_row("a-0001", "errored", "BagCut", recorded=None),
    ]  # fmt: skip
    folder = publish(tmp_path, rows)
    (folder / "cases").mkdir(exist_ok=True)
    published = steady("/lane", 60, TENTH, 3 * SECOND) + steady("/out", 6, SECOND, 3 * SECOND)
    published.sort(key=lambda message: message.time)
    write_bag(folder / "cases/a-0000.bag", published)
    return folder


def opened(results: Path, *more: str, case: str = "a-0000") -> tuple[int, str]:
    volume = f"recordings={_top(results)}"
    arguments = ["open", case, "--results", str(results), "--volume", volume, *more]
    ended = CliRunner().invoke(main, arguments)
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


def _top(results: Path) -> Path:
    return next(folder for folder in results.parents if (folder / "a.bag").exists())


def messages(file: Path) -> Iterator[tuple[str, int, Any]]:
    """Topic, time and decoded JSON or bytes, by MCAP's own library."""
    with file.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            is_json = channel.message_encoding == "json"
            data = json.loads(message.data) if is_json else message.data
            yield channel.topic, message.log_time, data


def test_a_file_begins_before_the_moment_and_has_all_side_by_side(
    results: Path, tmp_path: Path
) -> None:
    status, text = opened(results, "--to", str(tmp_path / "shown"))
    assert status == 0, text
    found = list(messages(tmp_path / "shown/a-0000.mcap"))
    times = [time for _, time, _ in found]
    # Two seconds before 4.5 s of the window, up to its end.
    assert times == sorted(times)
    assert (times[0], times[-1]) == (int(5.5 * SECOND), 9 * SECOND - TENTH)
    assert Counter(topic for topic, _, _ in found) == {
        "/map": 1,
        "/scan": 35,
        "/recorded/lane": 35,
        "/lane": 35,
        "/out": 3,
        "/bagpipe/criteria/in_the_lane": 3,
        "/bagpipe/log": 1,
    }
    course = [(time, data) for topic, time, data in found if topic.startswith("/bagpipe/criteria")]
    assert course == [
        (6 * SECOND, {"value": 0.5, "high": 1.0}),
        (int(7.5 * SECOND), {"value": 1.5, "high": 1.0}),
        (8 * SECOND, {"value": 0.2, "high": 1.0}),
    ]
    (log,) = [(time, data) for topic, time, data in found if topic == "/bagpipe/log"]
    assert log[0] == int(7.5 * SECOND)
    assert log[1]["message"] == "in the lane: why in the lane"
    assert log[1]["timestamp"] == {"sec": 7, "nsec": SECOND // 2}
    assert "at 4.500 s: in the lane: why in the lane" in text
    assert "3.500 s, 113 messages" in text


@pytest.mark.parametrize(
    ("more", "begin"),
    [
        (["--at", "0"], 3.0),
        (["--at", "1.5"], 4.5),
        (["--last", "2"], 7.0),
        (["--last", "99"], 3.0),
    ],
)
def test_a_part_is_what_was_asked_for(
    results: Path, tmp_path: Path, more: list[str], begin: float
) -> None:
    status, text = opened(results, "--to", str(tmp_path), "--output", "json", *more)
    assert status == 0, text
    found = json.loads(text)
    assert (found["start"], found["end"]) == (int(begin * SECOND), 9 * SECOND)
    # The latched map is at the begin of each part.
    first = next(iter(messages(tmp_path / "a-0000.mcap")))
    assert first[:2] == ("/map", int(begin * SECOND))
    assert found["moment"] == 4.5
    listed = {row["topic"]: row["messages"] for row in found["topics"]}
    assert found["messages"] == sum(listed.values())
    assert listed["/scan"] == round((9 - begin) * 10)


def test_of_mcap_the_same_is_shown(results: Path, tmp_path: Path) -> None:
    assert opened(results, "--to", str(tmp_path / "of_bags"))[0] == 0
    top, published = _top(results), results / "cases/a-0000.bag"
    given = mcap_of(top / "a.bag", tmp_path / "given", "zstd", chunk_bytes=1024)
    given.replace(top / "a.bag")
    mcap_of(published, tmp_path / "published", "none").replace(published)
    status, text = opened(results, "--to", str(tmp_path / "of_mcap"))
    assert status == 0, text
    shown = [list(messages(tmp_path / kind / "a-0000.mcap")) for kind in ("of_bags", "of_mcap")]
    assert len(shown[0]) == 113
    assert shown[0] == shown[1]


def test_topics_are_chosen_of_the_recording_alone(results: Path, tmp_path: Path) -> None:
    status, text = opened(results, "--to", str(tmp_path), "--topic", "/scan", "--at", "0")
    assert status == 0, text
    topics = {topic for topic, _, _ in messages(tmp_path / "a-0000.mcap")}
    assert topics == {"/scan", "/lane", "/out", "/bagpipe/criteria/in_the_lane", "/bagpipe/log"}


@pytest.mark.parametrize(
    ("case", "more", "sentence"),
    [
        ("a-0001", [], "a-0001 has no window that could be shown: why a-0001"),
        ("a-0002", [], "has no case a-0002"),
        ("..", [], ".. is no case's name"),
        ("a-0000", ["--at", "6"], "--at 6 is not in the window, which lasts 6 s"),
        ("a-0000", ["--at", "-1"], "--at -1 is not in the window"),
        ("a-0000", ["--at", "1", "--last", "1"], "exclude each other"),
        ("a-0000", ["--topic", "/none"], "has no topic /none"),
    ],
)
def test_what_cannot_be_shown_is_refused_and_leaves_nothing(
    results: Path, tmp_path: Path, case: str, more: list[str], sentence: str
) -> None:
    status, text = opened(results, "--to", str(tmp_path / "shown"), *more, case=case)
    assert (status, sentence in text) == (2, True), text
    assert not (tmp_path / "shown").exists()


def test_a_recording_that_is_gone_is_named(results: Path, tmp_path: Path) -> None:
    (_top(results) / "a.bag").unlink()
    volume = f"recordings={tmp_path}"
    ended = CliRunner().invoke(
        main, ["open", "a-0000", "--results", str(results), "--volume", volume]
    )
    assert ended.exit_code == 2
    assert "pvc://recordings/a.bag" in ended.output


def test_moments_are_the_first_outside_of_bounds_of_what_failed() -> None:
    low = finding("low", [[1.0, 0.9], [2.0, -2.0]])
    low["course"] |= {"low": -1.0, "high": None}
    row = {
        "criteria": [
            LANE,
            low,
            finding("passed", [[0.0, 5.0]], outcome="passed"),
            finding("inside", [[0.0, 1.0]]),
            {"name": "count", "outcome": "failed", "message": "none"},
        ]
    }
    assert moments(row) == [
        Moment(2.0, "low: why low"),
        Moment(4.5, "in the lane: why in the lane"),
    ]
    assert moments({"criteria": None}) == []


TOPICS = [
    Topic("/bagpipe/criteria/lane", "bagpipe.Criterion", "json", 3),
    Topic("/bagpipe/log", "foxglove.Log", "json", 1),
    Topic("/camera", "sensor_msgs/Image", "ros1", 30),
    Topic("/points", "sensor_msgs/PointCloud2", "ros1", 30),
    Topic("/speed", "std_msgs/Float64", "ros1", 30),
]


def test_foxgloves_layout_has_a_panel_for_each_thing_to_look_at() -> None:
    layout = json.loads(foxglove(TOPICS))
    panels = layout["configById"]
    assert list(panels) == ["3D!scene", "Image!0", "Plot!0", "RosOut!found"]
    assert panels["3D!scene"]["topics"] == {
        "/camera": {"visible": True},
        "/points": {"visible": True},
    }
    assert panels["Image!0"] == {"imageMode": {"imageTopic": "/camera"}}
    assert [path["value"] for path in panels["Plot!0"]["paths"]] == [
        f"/bagpipe/criteria/lane.{field}" for field in ("value", "low", "high")
    ]

    def named(of: Any) -> list[str]:
        return [of] if isinstance(of, str) else named(of["first"]) + named(of["second"])

    assert named(layout["layout"]) == list(panels)
    assert layout["layout"]["first"] == "3D!scene"
    assert json.loads(foxglove([]))["layout"] == "3D!scene"


def test_plotjugglers_layout_has_the_curves_by_its_names() -> None:
    root = ET.fromstring(plotjuggler(TOPICS))  # noqa: S314  our own
    assert [tab.get("tab_name") for tab in root.iter("Tab")] == ["lane"]
    assert [curve.get("name") for curve in root.iter("curve")] == [
        f"/bagpipe/criteria/lane/{field}" for field in ("value", "low", "high")
    ]


@pytest.mark.parametrize(
    ("encoding", "package", "cloud"),
    [("ros1", "rviz", "/points"), ("cdr", "rviz_default_plugins", {"Value": "/points"})],
)
def test_rvizs_displays_are_those_of_its_ros(encoding: str, package: str, cloud: Any) -> None:
    topics = [Topic(each.name, each.type, encoding, each.messages) for each in TOPICS]
    manager = yaml.safe_load(rviz(topics, "odom"))["Visualization Manager"]
    assert manager["Global Options"]["Fixed Frame"] == "odom"
    shown = {each["Name"]: each for each in manager["Displays"]}
    assert list(shown) == ["Grid", "TF", "/camera", "/points"]
    assert shown["/points"]["Class"] == f"{package}/PointCloud2"
    assert shown["/points"]["Topic"] == cloud


def test_the_link_has_the_file_and_the_moment() -> None:
    link = foxglove_link("http://127.0.0.1:8000/a.mcap", 1_700_000_000_250_000_000)
    assert parse_qs(urlsplit(link).query) == {
        "ds": ["remote-file"],
        "ds.url": ["http://127.0.0.1:8000/a.mcap"],
        "time": ["2023-11-14T22:13:20.250000000Z"],
    }
