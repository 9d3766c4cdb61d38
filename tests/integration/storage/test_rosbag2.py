"""Folders of rosbag2 on every kind of storage: found, planned by ranges, read as one recording."""

import random
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlparse

import pytest

from bagpipe.plan.case import Case
from bagpipe.plan.conditions import Conditions, Crossing
from bagpipe.source.bags.expanding import recordings
from bagpipe.source.bags.folder_stream import folder_file
from bagpipe.source.bags.planning import fragments
from bagpipe.storage import Storage
from tests.integration.storage.conftest import QUICK, Place
from tests.integration.storage.faulty_proxy import FaultyProxy
from tests.integration.storage.test_web import WebServer, web_server
from tests.rosbag2_folders import FORMS, MS, START, Form, Message, drive, folder, read_mcap
from tests.unit.bagpipe.jobs import make_spec


def put(at: Path, place: Place) -> str:
    """The folder's files to storage; the folder's URI."""
    for path in sorted(at.iterdir()):
        with place.storage.create(f"{place.uri}/{at.name}/{path.name}") as file:
            file.write(path.read_bytes())
    return f"{place.uri}/{at.name}"


def planned(uri: str, storage: Storage) -> list[Case]:
    source = make_spec(source={"bags": ["pvc://none/a"], "fragment": {"length": "2s"}}).source
    conditions = Crossing([("", Conditions())])
    made = fragments([uri], source, "cdr", conditions, storage, {})
    assert made.unplanned == []
    return made.cases


def counted(cases: list[Case], storage: Storage, to: Path) -> list[Message]:
    """The messages of the cases' windows, by MCAP's own library."""
    found = []
    for case in cases:
        to.write_bytes(b"".join(folder_file(case, storage, {}).pieces()))
        start, end = case.window.start, case.window.end
        found += [each for each in read_mcap(to) if start <= each.time < end]
    return found


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_folder_is_one_recording_wherever_it_lies(
    place: Place, form: Form, tmp_path: Path
) -> None:
    messages = drive()
    folder(tmp_path / "drive", form, [messages[:25], messages[25:]])
    uri = put(tmp_path / "drive", place)
    metadata = f"{uri}/metadata.yaml"
    for pattern in (uri, f"{uri}/", f"{place.uri}/dr*", metadata, f"{uri}/*", f"{place.uri}/*/"):
        assert recordings([pattern], place.storage) == ([metadata], []), pattern
    cases = planned(metadata, place.storage)
    assert [case.id for case in cases] == ["drive-0000", "drive-0001", "drive-0002"]
    assert counted(cases, place.storage, tmp_path / "case.mcap") == messages


@pytest.fixture
def large() -> list[Message]:
    """Two files' messages, of 12 MB each, that no compression makes smaller."""
    noise = random.Random(7)  # noqa: S311  nothing secret
    return [
        Message("/a", START + at * 20 * MS, b"\0\1\0\0" + noise.randbytes(100_000))
        for at in range(240)
    ]


def test_of_a_folder_on_s3_only_summaries_and_the_fragment_s_chunks_are_read(
    large: list[Message], proxy: FaultyProxy, s3_folder: str, tmp_path: Path
) -> None:
    folder(tmp_path / "drive", Form("mcap"), [large[:120], large[120:]])
    size = sum(path.stat().st_size for path in (tmp_path / "drive").iterdir())
    place = Place(Storage({}, QUICK), s3_folder)
    uri = put(tmp_path / "drive", place)
    before = len(proxy.ranges())
    cases = planned(f"{uri}/metadata.yaml", place.storage)
    planning = read_since(proxy, before)
    # Heads, footers and summaries of 240 chunks, and the metadata.
    assert (len(cases), size > 24_000_000, planning < 40_000) == (3, True, True), planning
    before = len(proxy.ranges())
    assert counted(cases[:1], place.storage, tmp_path / "case.mcap") == large[:100]
    # Of the 24 MB those of the window's 2 s, and the channels.
    first = read_since(proxy, before)
    assert 10_000_000 <= first < 10_200_000, first


def read_since(proxy: FaultyProxy, before: int) -> int:
    ranges = (each.split("-") for each in proxy.ranges()[before:])
    return sum(int(end) - int(begin) + 1 for begin, end in ranges)


@pytest.fixture
def web() -> Iterator[str]:
    with web_server() as url:
        yield url.removesuffix("/bags")


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_web_server_has_folders_by_their_metadata(
    web: str, form: Form, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    messages = drive()
    folder(tmp_path / "drive", form, [messages[:25], messages[25:]])
    files = {f"/drive/{path.name}": path.read_bytes() for path in (tmp_path / "drive").iterdir()}
    monkeypatch.setattr(WebServer, "files", files)
    storage = Storage({}, QUICK)
    metadata = f"{web}/drive/metadata.yaml"
    for pattern in (metadata, f"{web}/drive", f"{web}/drive/"):
        assert recordings([pattern], storage) == ([metadata], []), pattern
    cases = planned(metadata, storage)
    assert counted(cases, storage, tmp_path / "case.mcap") == messages
    assert urlparse(cases[0].parts[0].bag).path.startswith("/drive/drive_0.")
