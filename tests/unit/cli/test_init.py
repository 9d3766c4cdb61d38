"""`bagpipe init`: what is written is a job that is taken as it is, whatever the recording says."""

import re
import resource
from pathlib import Path
from typing import Any

import pytest
import yaml
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from tests.rosbag2_folders import FORMS, Form, drive, folder
from tests.unit.bagpipe.bags import Recorded, steady, write_bag
from tests.unit.bagpipe.mcap_records import channel, mcap
from tests.unit.cli.initialised import SECOND, init, planned


def stamped(path: Path, topics: dict[str, list[tuple[int, int]]]) -> Path:
    """A bag of std_msgs/Header-ed messages: (receipt, stamp) in ns for each topic."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kind = "geometry_msgs/msg/PointStamped"
    rows = sorted((time, stamp, topic) for topic, each in topics.items() for time, stamp in each)
    with Writer(path) as writer:
        writer.chunk_threshold = 4096
        connections = {t: writer.add_connection(t, kind, typestore=store) for t in topics}
        for time, stamp, topic in rows:
            moment = store.types["builtin_interfaces/msg/Time"](stamp // SECOND, stamp % SECOND)
            header = store.types["std_msgs/msg/Header"](seq=0, stamp=moment, frame_id="")
            point = store.types["geometry_msgs/msg/Point"](0.0, 0.0, 0.0)
            raw = store.serialize_ros1(store.types[kind](header, point), kind)
            writer.write(connections[topic], time, raw)
    return path


def test_a_bag_becomes_a_job_that_can_be_planned(tmp_path: Path) -> None:
    write_bag(tmp_path / "drive 1.bag", steady("/scan", 1000, 50_000_000), chunk_bytes=1024)
    done = init(tmp_path / "drive 1.bag")
    assert done.status == 0, done.stderr
    assert done.spec["source"] == {
        "bags": ["pvc://recordings/drive 1.bag"],
        "fragment": {"length": "20s", "warmUp": "2s"},
    }
    assert done.spec["stack"]["engine"] == "ros1"
    assert done.spec["stack"]["parameters"] == {"/use_sim_time": True}
    assert done.spec["record"] == {"topics": ["/.*"]}
    assert "evaluate" not in done.spec
    assert "#         20       1,000          12  /scan  std_msgs/String" in done.stdout
    assert f"--volume recordings={tmp_path}" in done.stdout
    made = planned(tmp_path, done.stdout, tmp_path)
    # 49.95 s: two whole fragments and one of 9.95 s.
    assert "3 cases: 3 fragments" in made.stdout, made.output


def test_in_lockstep_the_named_answers_are_awaited(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, 50_000_000))
    words = (tmp_path / "a.bag", "--output", "/lane", "--mode", "lockstep")
    done = init(*words, "--step", "/scan=/lane")
    assert done.status == 0, done.stderr
    step = {"trigger": "/scan", "answer": "/lane", "deadline": "2s"}
    assert done.spec["playback"] == {"mode": "lockstep", "steps": [step]}
    # Without steps only an engine that sees its nodes' work knows what to wait for.
    done = init(*words)
    assert done.status == 2
    assert "playback.steps are missing" in done.stderr
    assert "(by --step TRIGGER=ANSWER)" in done.stderr
    # A recorded output is a trigger by the name under which it is played.
    done = init(tmp_path / "a.bag", "--output", "/scan", *words[3:], "--step", "/scan=/scan")
    (moved,) = done.spec["playback"]["steps"]
    assert moved == step | {"trigger": "/recorded/scan", "answer": "/scan"}
    folder(tmp_path / "drive", FORMS[0], [drive(40)])
    done = init(tmp_path / "drive", "--output", "/a", "--mode", "lockstep")
    assert done.spec["playback"] == {"mode": "lockstep"}


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--step", "/scan=/lane"), "--step is for --mode lockstep"),
        (("--mode", "lockstep", "--step", "/scan"), "--step '/scan': write TRIGGER=ANSWER"),
        (("--mode", "lockstep", "--step", "/scam=/lane"), "the trigger is none of the topics"),
        (("--mode", "lockstep", "--step", "/scan=/lame"), "the answer is no --output"),
        (
            ("--mode", "lockstep", "--step", "/other=/lane", "--input", "/scan"),
            "/other=/lane: the trigger is none of the topics that are played",
        ),
    ],
)
def test_a_step_that_awaits_nothing_is_refused(
    tmp_path: Path, words: tuple[str, ...], sentence: str
) -> None:
    both = [*steady("/scan", 9, SECOND), *steady("/other", 9, SECOND)]
    write_bag(tmp_path / "a.bag", both)
    done = init(tmp_path / "a.bag", "--output", "/lane", *words)
    assert (done.status, done.stdout) == (2, "")
    assert sentence in done.stderr


@pytest.mark.parametrize("form", FORMS, ids=str)
def test_a_folder_of_rosbag2_is_for_ros2(tmp_path: Path, form: Form) -> None:
    folder(tmp_path / "drive", form, [drive(40), drive(40)])
    done = init(tmp_path / "drive", "--output", "/a")
    assert done.status == 0, done.stderr
    assert done.spec["source"]["bags"] == ["pvc://recordings/drive"]
    assert done.spec["stack"]["engine"] == "ros2"
    assert done.spec["stack"]["parameters"] == {"/**/use_sim_time": True}
    assert done.spec["stack"]["remap"] == {"/recorded/a": "/a"}
    (row,) = re.findall(r"#\s+(\S+)\s+(\S+)\s+(\S+)  /map  (.*)", done.stdout)
    # Twice, as both files begin with it: 2 in 3.901 s.
    assert row == ("0.513", "2", "16", "std_msgs/msg/String, latched")
    made = planned(tmp_path, done.stdout, tmp_path)
    assert "1 case: 1 fragment" in made.stdout, made.output


def test_a_folder_of_recordings_becomes_patterns(tmp_path: Path) -> None:
    folder(tmp_path / "a", FORMS[0], [drive(10)])
    folder(tmp_path / "b", FORMS[3], [drive(20)])
    done = init(tmp_path)
    assert done.status == 0, done.stderr
    assert done.spec["source"]["bags"] == ["pvc://recordings/*/metadata.yaml"]
    assert re.search(r"#\s+\S+\s+15\s+\S+  /a  std_msgs", done.stdout)
    assert "2 cases: 2 fragments" in planned(tmp_path, done.stdout, tmp_path).stdout


def test_ros1_and_ros2_are_jobs_of_their_own(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 10, 50_000_000))
    folder(tmp_path / "b", FORMS[0], [drive(10)])
    done = init(tmp_path)
    assert done.status == 2
    assert "a.bag is for the engine ros1, and others are for ros2: write a job for" in done.stderr


def test_criteria_say_what_the_recording_shows(tmp_path: Path) -> None:
    # 10 a second for 50 s, but for 1.5 s of silence; stamps 80 ms before their receipt.
    times = [t * 100_000_000 + SECOND for t in range(500) if not 230 < t < 245]
    slow = [(t, t - 80_000_000) for t in times]
    bag = stamped(tmp_path / "a.bag", {"/out": slow, "/in": [(t, t) for t in times]})
    done = init(bag, "--output", "/out")
    assert done.status == 0, done.stderr
    assert done.spec["record"] == {"topics": ["/out"]}
    assert done.spec["stack"]["remap"] == {"/recorded/out": "/out"}
    # The second of three fragments, of 20 s and a chunk less, has 1.4 s less; the silence thrice.
    assert done.spec["evaluate"] == [
        {"name": "out rate", "rate": {"topic": "/out", "min": 7.3}},
        {"name": "out gap", "rate": {"topic": "/out", "min": 0.22, "over": "worst"}},
        {"name": "out latency", "latency": {"topic": "/out", "max": "160ms"}},
    ]
    (slowest,) = re.findall(r"# 80 % of the slowest of 3 fragments, (\S+)\n", done.stdout)
    assert 9.2 <= float(slowest) <= 9.3
    assert "the longest that was recorded is 1.5 s\n" in done.stdout
    done = init(bag, "--output", "/out", "--mode", "lockstep", "--step", "/in=/out")
    assert [each["name"] for each in done.spec["evaluate"]] == ["out rate", "out gap"]
    assert "# /out: in lock-step no latency is demanded: steps have deadlines." in done.stdout


@pytest.mark.parametrize(
    ("stamp", "why"),
    [
        (lambda _: 0, r"a recorded stamp is 1\d\d s earlier than its receipt"),
        (lambda t: t + 2_000_000, "a recorded stamp is 0.002 s later than its receipt"),
        (lambda t: t - 61 * SECOND, "a recorded stamp is 61 s earlier than its receipt"),
    ],
    ids=["empty", "later than the receipt", "of another time"],
)
def test_stamps_that_can_t_be_true_make_no_criterion(tmp_path: Path, stamp: Any, why: str) -> None:
    times = [t * 100_000_000 + 100 * SECOND for t in range(100)]
    bag = stamped(tmp_path / "a.bag", {"/out": [(t, stamp(t)) for t in times]})
    done = init(bag, "--output", "/out")
    assert [each["name"] for each in done.spec["evaluate"]] == ["out rate", "out gap"]
    assert re.search(f"# /out: {why}: the clocks differ", done.stdout)


@pytest.mark.parametrize(("step", "gaps"), [(6, True), (7, False), (8, False)])
def test_no_gap_is_demanded_that_only_silence_throughout_could_have(
    tmp_path: Path, step: int, gaps: bool
) -> None:
    """Thrice a gap of 7 s is longer than a fragment of 20 s."""
    slow = steady("/out", 100 // step + 1, step * SECOND)
    steady_in = steady("/in", 1000, 100_000_000)
    write_bag(tmp_path / "a.bag", sorted([*steady_in, *slow], key=lambda m: m.time))
    done = init(tmp_path / "a.bag", "--output", "/out")
    names = [each["name"] for each in done.spec["evaluate"]]
    assert names == (["out rate", "out gap"] if gaps else ["out rate"])
    sentence = f"the longest recorded gap, {step} s, is no small part of a fragment's 20 s"
    assert (sentence in done.stdout) is not gaps


def test_an_output_that_is_silent_in_a_fragment_has_no_rate(tmp_path: Path) -> None:
    messages = steady("/in", 600, 100_000_000) + steady("/out", 10, 100_000_000)
    write_bag(tmp_path / "a.bag", sorted(messages, key=lambda m: m.time), chunk_bytes=512)
    done = init(tmp_path / "a.bag", "--output", "/out")
    assert "evaluate" not in done.spec
    assert "# /out: 2 of 3 fragments have no message of it, so no rate is demanded." in done.stdout
    assert "# /out: no header with a stamp was seen, so no latency is demanded." in done.stdout


def test_what_has_no_rate_is_only_to_be_there(tmp_path: Path) -> None:
    messages = [*steady("/in", 50, 100_000_000), Recorded("/map", 2 * SECOND, "m", latching=True)]
    messages.append(Recorded("/once", 3 * SECOND, "o"))
    write_bag(tmp_path / "a.bag", sorted(messages, key=lambda m: m.time))
    outputs = [word for topic in ("/map", "/once", "/new") for word in ("--output", topic)]
    done = init(tmp_path / "a.bag", *outputs)
    assert [each["presence"] for each in done.spec["evaluate"]] == [
        {"topic": topic, "min": 1} for topic in ("/map", "/once", "/new")
    ]
    for why in ("it is latched", "one message: there is no rate", "it is not in the recordings"):
        assert f"# {why}" in done.stdout
    # What is not in the recording needs no other name.
    assert done.spec["stack"]["remap"] == {"/recorded/map": "/map", "/recorded/once": "/once"}
    assert re.search(r"#\s+-\s+1\s+5  /once", done.stdout)


def test_inputs_are_those_that_are_played(tmp_path: Path) -> None:
    messages = steady("/in", 50, 100_000_000) + steady("/other", 50, 100_000_000)
    write_bag(tmp_path / "a.bag", sorted(messages, key=lambda m: m.time))
    done = init(tmp_path / "a.bag", "--input", "/in", "--output", "/other")
    assert done.spec["source"]["topics"] == ["/in"]
    assert "remap" not in done.spec["stack"]
    done = init(tmp_path / "a.bag", "--input", "/inn")
    assert (done.status, "did you mean '/in'?" in done.stderr) == (2, True), done.stderr


def test_what_is_no_message_of_ros_is_left_out_or_refused(tmp_path: Path) -> None:
    channels = [channel(0, "/scan"), channel(1, "/meta", "json"), channel(2, "/none", schema=0)]
    times = {n: [SECOND, 2 * SECOND] for n in range(3)}
    (tmp_path / "a.mcap").write_bytes(mcap([times], channels))
    done = init(tmp_path / "a.mcap")
    assert done.spec["source"]["topics"] == ["/scan"]
    assert "2 messages" not in done.stderr
    assert "1 case: 1 fragment" in planned(tmp_path, done.stdout, tmp_path).stdout
    done = init(tmp_path / "a.mcap", "--input", "/meta")
    assert (done.status, "(in 'json'): leave it out" in done.stderr) == (2, True), done.stderr
    (tmp_path / "b.mcap").write_bytes(mcap([{1: [SECOND]}], channels[1:2]))
    done = init(tmp_path / "b.mcap")
    assert (done.status, "hold messages in 'json'" in done.stderr) == (2, True), done.stderr


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "the file is empty (0 bytes)"),
        (b"PK\x03\x04\x1b[31mzip", "the file begins with b"),
        (b"#ROSBAG V2.0\n", "a.bag: "),
        (mcap([], [channel(0, "/scan")]), "a.bag: "),
    ],
    ids=["empty", "no recording", "cut", "without messages"],
)
def test_what_can_t_be_looked_into_is_refused(
    tmp_path: Path, content: bytes, sentence: str
) -> None:
    (tmp_path / "a.bag").write_bytes(content)
    done = init(tmp_path / "a.bag")
    assert (done.status, done.stdout) == (2, "")
    assert sentence in done.stderr


def test_one_bad_recording_of_several_is_named_and_the_others_count(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 10, 50_000_000))
    (tmp_path / "b.bag").write_bytes(b"nothing")
    done = init(tmp_path / "a.bag", tmp_path / "b.bag")
    assert done.status == 0
    assert "# CAN'T BE PLAYED: pvc://recordings/b.bag: the file begins with" in done.stdout
    assert "can't be played: pvc://recordings/b.bag" in done.stderr


def test_volumes_name_the_claims(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    write_bag(tmp_path / "deep/a.bag", steady("/scan", 10, 50_000_000))
    volume = ("--volume", f"fleet={tmp_path}")
    assert init(tmp_path / "deep/a.bag", *volume).spec["source"]["bags"] == [
        "pvc://fleet/deep/a.bag"
    ]
    assert init("pvc://fleet/deep/a.bag", *volume).spec["source"]["bags"] == [
        "pvc://fleet/deep/a.bag"
    ]
    done = init(tmp_path / "deep/a.bag", "--volume", "recordings=/tmp")
    assert done.status == (0 if tmp_path.is_relative_to("/tmp") else 2)


def test_a_full_disk_leaves_no_part_of_a_job(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 10, 50_000_000))
    words = (tmp_path / "a.bag", "-o", tmp_path / "job.yaml")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))
    try:
        done = init(*words)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert (done.status, "job.yaml can't be written: File too large" in done.stderr) == (2, True)
    assert not (tmp_path / "job.yaml").exists()
    assert init(*words).status == 0


def test_a_file_is_written_once(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 10, 50_000_000))
    job = tmp_path / "job.yaml"
    done = init(tmp_path / "a.bag", "-o", job, "--name", "lane")
    assert (done.status, done.stdout.splitlines()[0]) == (0, f"{job} is written")
    assert yaml.safe_load(job.read_text())["metadata"] == {"name": "lane"}
    written = job.read_bytes()
    done = init(tmp_path / "a.bag", "-o", job)
    assert (done.status, "is there already: choose another" in done.stderr) == (2, True)
    assert job.read_bytes() == written


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--output", "scan"], "--output 'scan' is no topic's name"),
        (["--output", "/a", "--output", "/a"], "names a topic twice"),
        (["--input", "/scan", "--output", "/scan"], "is --input and --output"),
        (["--command", "a 'b"], "close the quotes"),
        (["--image", "a b"], "is no image's name"),
        (["--name", "Not A Name"], "is no job's name"),
    ],
)
def test_options_that_can_t_be(tmp_path: Path, words: list[str], sentence: str) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 10, 50_000_000))
    done = init(tmp_path / "a.bag", *words)
    assert (done.status, sentence in done.stderr) == (2, True), done.stderr
