"""`bagpipe init` over recordings that are hostile, damaged, or larger than one can read."""

import json
import re
import struct
from pathlib import Path

import pytest
from click.testing import CliRunner
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bagpipe.cli.__main__ import main
from bagpipe.cli.first_job.facts import Looked, Recordings, Stretch
from bagpipe.cli.first_job.looking import Bounds, Looking
from bagpipe.cli.first_job.proposing import fragment_length
from bagpipe.storage import Storage
from tests.rosbag2_folders import Form, drive, folder
from tests.unit.bagpipe import mcap_records
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.mcap_records import channel, mcap
from tests.unit.cli.initialised import SECOND, init

HOSTILE = [
    '/a"]\nkind: Pod #',
    "/\x1b]0;owned\x07\x1b[31m",
    "/ünïcode/\u2028\u202etopic",
    "/{{ x }}: !!python/object",
    "/a\r\n  image: evil",
    "/" + "x" * 300,
]


def test_hostile_names_stay_comments_in_ascii(tmp_path: Path) -> None:
    numbers = range(len(HOSTILE))
    channels = [channel(n, topic) for n, topic in enumerate(HOSTILE)] + [channel(90, "/scan")]
    times = {n: [SECOND, 2 * SECOND] for n in [*numbers, 90]}
    (tmp_path / "a.mcap").write_bytes(mcap([times], channels))
    done = init(tmp_path / "a.mcap")
    assert done.status == 0, done.stderr
    # Those that can be named are played, which leaves the others out.
    assert done.spec["source"]["topics"] == ["/scan"]
    assert done.spec["stack"]["image"] == "registry.example/your-stack:1"
    assert done.stdout.count("CAN'T BE PLAYED") == len(HOSTILE)
    assert r"\x1b]0;owned\x07\x1b[31m" in done.stdout
    assert all(len(line) < 400 for line in done.stdout.splitlines())


# UTF-8 has no surrogates, and a recording's names are read as that.
WORDS = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=30)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.one_of(WORDS, WORDS.map("/{}".format)), min_size=1, max_size=5, unique=True))
def test_whatever_topics_are_called_the_job_is_one(tmp_path: Path, topics: list[str]) -> None:
    channels = [channel(n, topic) for n, topic in enumerate(topics)] + [channel(90, "/scan")]
    times = {n: [SECOND, 2 * SECOND] for n in [*range(len(topics)), 90]}
    (tmp_path / "a.mcap").write_bytes(mcap([times], channels))
    # What is written is read again, by YAML, the CRD and the model.
    done = init(tmp_path / "a.mcap", "--output", "/answer")
    assert done.status == 0, done.stderr
    assert done.spec["source"]["bags"] == ["pvc://recordings/a.mcap"]
    assert done.spec["record"] == {"topics": ["/answer"]}
    assert "/scan" in done.spec["source"].get("topics", ["/scan"])


@pytest.mark.parametrize("kind", [*HOSTILE, "%s", "{0}", "std_msgs/String\x00"])
def test_whatever_a_type_is_called_it_is_a_comment(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    named = mcap_records.text(kind.encode()) + mcap_records.text(b"ros1msg")
    definition = struct.pack("<H", 1) + named + mcap_records.text(b"string data\n" + kind.encode())
    monkeypatch.setattr(mcap_records, "SCHEMA", mcap_records.record(3, definition))
    (tmp_path / "a.mcap").write_bytes(mcap([{0: [SECOND, 2 * SECOND]}], [channel(0, "/scan")]))
    done = init(tmp_path / "a.mcap", "--output", "/scan")
    assert done.status == 0, done.stderr
    assert done.spec["stack"]["image"] == "registry.example/your-stack:1"


@pytest.mark.parametrize(
    "name", ["9" * 60 + "-" * 9 + ".bag", "a [1].bag", "q\"\\uot'e.bag", "stär*.bag", "#x: y.bag"]
)
def test_odd_names_of_files_are_found_again(tmp_path: Path, name: str) -> None:
    write_bag(tmp_path / name, steady("/scan", 10, 50_000_000))
    write_bag(tmp_path / "a 1.bag", steady("/scan", 10, 50_000_000))
    done = init(tmp_path / name)
    assert done.status == 0, done.stderr
    (tmp_path / "job.yaml").write_text(done.stdout)
    words = ["plan", str(tmp_path / "job.yaml"), "--volume", f"recordings={tmp_path}"]
    made = json.loads(CliRunner().invoke(main, [*words, "--output", "json"]).stdout)
    assert [each["bag"] for each in made["cases"]] == [f"pvc://recordings/{name}"]


def test_a_bag_of_ten_thousand_topics(tmp_path: Path) -> None:
    count = 10_000
    channels = [channel(n, f"/t{n:05d}") for n in range(count)]
    (tmp_path / "a.mcap").write_bytes(mcap([{n: [SECOND + n] for n in range(count)}], channels))
    done = init(tmp_path / "a.mcap")
    assert done.status == 0, done.stderr
    assert "topics" not in done.spec["source"]
    assert "# and 9900 more topics" in done.stdout
    assert len(done.stdout) < 20_000
    # One that can't be played would need the others to be named, which a job can't.
    (tmp_path / "b.mcap").write_bytes(
        mcap(
            [{n: [SECOND + n] for n in range(count)}], [channel(0, "/json", "json"), *channels[1:]]
        )
    )
    done = init(tmp_path / "b.mcap")
    assert done.status == 2
    assert "at most 500 of the 9999 others: name your stack's by --input" in done.stderr
    done = init(tmp_path / "b.mcap", "--input", "/t00007")
    assert done.spec["source"]["topics"] == ["/t00007"]


def test_the_first_twenty_of_many_are_looked_into(tmp_path: Path) -> None:
    for number in range(23):
        write_bag(tmp_path / f"{number:02d}.bag", steady("/scan", 10, 50_000_000))
    done = init(tmp_path)
    assert done.spec["source"]["bags"] == ["pvc://recordings/*.bag"]
    assert "# 3 of 23 recordings were not looked into" in done.stdout


def test_a_place_of_an_index_that_is_a_lie_reads_no_whole_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "a.bag", steady("/scan", 10, 50_000_000))
    data = bytearray(bag.read_bytes())
    at = data.index(b"index_pos=") + len(b"index_pos=")
    data[at : at + 8] = (4117).to_bytes(8, "little")
    bag.write_bytes(data)
    with bag.open("r+b") as file:
        file.truncate(300 << 20)  # sparse
    done = init(bag)
    assert done.status == 2
    assert "its index would have" in done.stderr


def test_a_large_database_is_described_by_its_metadata(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder(tmp_path / "drive", Form("sqlite3", "", 6), [drive(40)])
    monkeypatch.setattr("bagpipe.cli.first_job.looking._MOST_WHOLE_BYTES", 100)
    monkeypatch.setattr("bagpipe.plan.rosbag2.whole_file", None)
    done = init(tmp_path / "drive", "--output", "/a")
    assert done.status == 0, done.stderr
    assert "3.9 s, by its metadata.yaml" in done.stdout
    # 20 in 3.901 s; when they came is not known.
    assert done.spec["evaluate"][0] == {"name": "a rate", "rate": {"topic": "/a", "min": 2.5}}
    assert "half of the recorded mean, 5.13: when they came was not read" in done.stdout


def test_fragments_without_end_are_not_cut_to_see_when_outputs_came(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # 900,000 fragments of 60 s, for each of which six chunks would be looked at.
    times = [SECOND, 900_000 * 60 * SECOND]
    (tmp_path / "a.mcap").write_bytes(mcap([{0: times}] * 6, [channel(0, "/scan")]))
    monkeypatch.setattr("bagpipe.cli.first_job.looking.cut", None)
    done = init(tmp_path / "a.mcap", "--output", "/scan")
    assert done.status == 0, done.stderr
    assert "when they came was not read" in done.stdout


def test_times_of_centuries_are_written_and_take_no_time(tmp_path: Path) -> None:
    times = [SECOND, 9 * 10**18]
    (tmp_path / "a.mcap").write_bytes(mcap([{0: times}] * 3, [channel(0, "/scan")]))
    done = init(tmp_path / "a.mcap", "--output", "/scan")
    assert done.status == 0, done.stderr
    assert done.spec["source"]["fragment"] == {"length": "60s", "warmUp": "2s"}


def test_a_credential_in_a_uri_is_refused_and_not_repeated() -> None:
    for uri in ("s3://AKIA:hunter2@bucket/a.bag", "https://a/b.bag?sig=hunter2"):
        done = init(uri)
        assert (done.status, "hold no credential" in done.stderr) == (2, True)
        assert "hunter2" not in done.stderr


def test_the_time_for_looking_ends_and_what_was_seen_counts(tmp_path: Path) -> None:
    for number in range(3):
        write_bag(tmp_path / f"{number}.bag", steady("/scan", 10, 50_000_000))
    moments = iter(range(100))
    bounds = Bounds(seconds=2.5, clock=lambda: float(next(moments)))
    uris = [f"pvc://recordings/{number}.bag" for number in range(3)]
    storage = Storage({"recordings": str(tmp_path)})
    found = Looking(storage, ("/scan",), bounds).into(uris, fragment_length)
    # The clock is asked when it begins, before the sample of each, and before the next.
    assert ([each.uri for each in found.looked], found.named) == (uris[:2], 3)
    assert found.looked[0].topics["/scan"].sample.messages == 10
    assert found.looked[1].topics["/scan"].sample.messages == 0
    assert found.course("/scan") is None


def test_a_folder_of_many_files_is_described_by_its_metadata(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder(tmp_path / "drive", Form("mcap"), [drive(10), drive(10), drive(10)])
    monkeypatch.setattr("bagpipe.cli.first_job.looking._MOST_FILES", 2)
    done = init(tmp_path / "drive")
    assert (done.status, "by its metadata.yaml" in done.stdout) == (0, True)
    assert re.search(r"#\s+\S+\s+15\s+-  /a  std_msgs", done.stdout)


def test_large_chunks_make_short_fragments() -> None:
    # 40 MB each second: 256 MiB are 6.7 s, and a fragment of 5 s has 2 s of warm-up before it.
    seconds = tuple(Stretch(n * SECOND, (n + 1) * SECOND - 1, 40_000_000) for n in range(60))
    found = Recordings([Looked("u", "bag", 2_400_000_000, 0, 60 * SECOND, {}, seconds)], 1, [])
    assert fragment_length(found) == (2.0, 1.0)
    assert found.peak(2.0, 1.0) == 3 * 40_000_000
    assert found.peak(60.0, 0.0) == 2_400_000_000


def test_bytes_without_places_are_spread_evenly() -> None:
    found = Recordings([Looked("u", "folder", 600, 0, 60 * SECOND, {})], 1, [])
    assert (found.peak(10.0, 2.0), found.peak(100.0, 0.0)) == (120, 600)
