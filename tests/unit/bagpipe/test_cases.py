"""Planning: the exact cases of given bags, and a sentence for each bag that yields none."""

import dataclasses
from pathlib import Path

import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from bagpipe.driver.progress import Progress
from bagpipe.engine.delivery import judge
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.jobs import make_row, make_spec

SECOND = 1_000_000_000


def storage_with(folder: Path, *names: str) -> Storage:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        write_bag(folder / name, steady("/scan", 100, 50_000_000), chunk_bytes=1024)
    return Storage({"recordings": str(folder)})


def source(*bags: str, length: str = "2s") -> dict[str, object]:
    return {
        "bags": [f"pvc://recordings/{bag}" for bag in bags],
        "topics": ["/scan"],
        "fragment": {"length": length},
    }


def test_every_fragment_of_every_bag_is_a_case(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "a.bag", "b c.bag")
    made = plan(make_spec(source=source("*.bag")), storage)
    assert sorted(case.id for case in made.cases) == [
        "a-0000", "a-0001", "a-0002", "b-c-0000", "b-c-0001", "b-c-0002",
    ]  # fmt: skip
    assert made.unplanned == []
    assert [c.bytes for c in made.cases] == sorted((c.bytes for c in made.cases), reverse=True)


def test_a_repeated_fragment_is_so_many_cases_alike_but_for_their_names(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "a.bag")
    once = {case.id: case for case in plan(make_spec(source=source("a.bag")), storage).cases}
    assert sorted(once) == ["a-0000", "a-0001", "a-0002"]
    spec = make_spec(source=source("a.bag"), playback={"rounds": 2})
    twice = plan(spec, storage).cases
    assert sorted(case.id for case in twice) == [
        "a-0000-r0", "a-0000-r1", "a-0001-r0", "a-0001-r1", "a-0002-r0", "a-0002-r1",
    ]  # fmt: skip
    for case in twice:
        original = once[case.id.rpartition("-r")[0]]
        assert case.fragment == original.id
        plain = dataclasses.replace(case, id=original.id, conditions=original.conditions)
        assert plain == original


def test_the_names_of_many_rounds_sort_by_round(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "a.bag")
    spec = make_spec(source=source("a.bag", length="60s"), playback={"rounds": 100})
    names = [case.id for case in plan(spec, storage).cases]
    assert names == sorted(names)
    assert (len(names), names[0], names[9], names[99]) == (
        100, "a-0000-r00", "a-0000-r09", "a-0000-r99",
    )  # fmt: skip


def test_bags_of_one_name_stay_apart(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "x/a.bag", "y/a.bag")
    made = plan(make_spec(source=source("x/a.bag", "y/a.bag", "x/*.bag", length="60s")), storage)
    assert sorted((case.bag, case.id) for case in made.cases) == [
        ("pvc://recordings/x/a.bag", "a-0c94b7eff280-0000"),
        ("pvc://recordings/y/a.bag", "a-217ab156858c-0000"),
    ]


def test_bags_of_one_name_keep_theirs_whatever_is_beside_them(tmp_path: Path) -> None:
    """Else a comparison with an earlier job, and a quarantine, would take one for another."""
    storage = storage_with(tmp_path, "w/a.bag", "x/a.bag", "y/a.bag")
    before = plan(make_spec(source=source("x/a.bag", "y/a.bag", length="60s")), storage).cases
    after = plan(make_spec(source=source("*/a.bag", length="60s")), storage).cases
    names = {case.bag: case.id for case in after}
    assert len(set(names.values())) == 3
    assert {case.bag: case.id for case in before}.items() < names.items()


def test_bags_of_one_name_that_are_missing_have_a_row_each(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "b.bag")
    made = plan(make_spec(source=source("x/a.bag", "y/a.bag", "z.bag", length="60s")), storage)
    first, second, third = made.unplanned
    assert (first.bag, second.bag) == ("pvc://recordings/x/a.bag", "pvc://recordings/y/a.bag")
    assert first.id != second.id
    assert third.id == "z"


def test_a_faulty_bag_that_is_called_as_a_case_takes_no_case_s_place(tmp_path: Path) -> None:
    """Results have one row for each name: the case would never have run."""
    storage = storage_with(tmp_path, "a.bag")
    (tmp_path / "a-0001.bag").write_text("a slice that was never written")
    made = plan(make_spec(source=source("a.bag", "a-0001.bag")), storage)
    assert sorted(case.id for case in made.cases) == ["a-0000", "a-0001", "a-0002"]
    [faulty] = made.unplanned
    assert (faulty.id, faulty.bag) == ("a-0001-8aa43f306ee2", "pvc://recordings/a-0001.bag")


def test_one_more_file_changes_no_other_s_name(tmp_path: Path) -> None:
    """A nightly would miss all its cases, and a quarantine name none."""

    def names(*files: str) -> set[str]:
        for name in files:
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(name)
        spec = make_spec(
            source={"files": ["pvc://recordings/**"]},
            stack={"engine": "exec", "image": "judge:1", "command": ["judge"]},
            record=None,
        )
        return {case.id for case in plan(spec, Storage({"recordings": str(tmp_path)})).cases}

    assert names("a.json", "b.json") == {"a", "b"}
    assert names("a.csv") == {"a.json", "a.csv", "b"}
    there = names("old/a.csv")
    assert {"a.json", "b"} < there
    assert len(there) == 4
    # Of a name without its ending that another has with it.
    assert len(names("a.json.gz")) == 5


def test_a_file_s_variant_that_is_called_as_another_s_is_a_case_of_its_own(tmp_path: Path) -> None:
    for name in ("drive.x", "drive-fast.x", "walk.x"):
        (tmp_path / name).write_text(name)
    spec = make_spec(
        source={"files": ["pvc://recordings/*.x"]},
        stack={"engine": "exec", "image": "judge:1", "command": ["judge"]},
        record=None,
        variants=[{"name": "lidar"}, {"name": "fast-lidar"}],
    )
    cases = plan(spec, Storage({"recordings": str(tmp_path)})).cases
    assert sorted((case.id, case.fragment, case.conditions.variant) for case in cases) == [
        ("drive-fast-fast-lidar", "drive-fast", "fast-lidar"),
        ("drive-fast-lidar-38b91d042697", "drive-fast", "lidar"),
        ("drive-fast-lidar-e098fccb8a13", "drive", "fast-lidar"),
        ("drive-lidar", "drive", "lidar"),
        ("walk-fast-lidar", "walk", "fast-lidar"),
        ("walk-lidar", "walk", "lidar"),
    ]


def test_a_faulty_bag_is_reported_and_the_others_go_on(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "good.bag", "cut.bag", "other.bag")
    whole = (tmp_path / "cut.bag").read_bytes()
    (tmp_path / "cut.bag").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "empty.bag").write_bytes(b"")
    (tmp_path / "text.bag").write_text("hello")
    write_bag(tmp_path / "camera.bag", steady("/camera", 10, 1_000_000))
    bags = ("good.bag", "cut.bag", "empty.bag", "text.bag", "camera.bag", "none.bag", "no/*.bag")
    made = plan(make_spec(source=source(*bags, length="60s")), storage)
    assert [case.id for case in made.cases] == ["good-0000"]
    reasons = {bag.id: bag.reason for bag in made.unplanned}
    assert reasons == {
        "none": "BagMissing",
        "bag": "BagMissing",
        "cut": "BagCut",
        "empty": "BagCut",
        "text": "BagUnreadable",
        "camera": "NoMatchingTopics",
    }
    sentences = {bag.id: bag.message for bag in made.unplanned}
    assert f"the file ends at byte {len(whole) // 2}" in sentences["cut"]
    assert sentences["camera"].endswith("/scan is in the bag; it has /camera")
    assert all(sentence.find("pvc://recordings/") >= 0 for sentence in sentences.values())


@pytest.mark.parametrize("chunk_bytes", [1024, 1 << 20])
def test_a_gap_of_ten_minutes_leaves_the_jobs_verdict_alone(
    tmp_path: Path, chunk_bytes: int
) -> None:
    recorded = [
        *steady("/scan", 600, SECOND // 10),
        *steady("/scan", 600, SECOND // 10, 661 * SECOND),
    ]
    write_bag(tmp_path / "a.bag", recorded, chunk_bytes)
    spec = make_spec(source=source("a.bag", length="60s"))
    made = plan(spec, Storage({"recordings": str(tmp_path)}))
    assert made.unplanned == []
    assert {case.id for case in made.cases} >= {"a-0000", "a-0011"}
    # A cut near the gap moves to its chunk, so that two more may have a message or some.
    assert len(made.cases) <= 4
    progress = Progress("pvc://results/r")
    progress.begin(len(made.cases))
    for case in made.cases:
        played = sum(case.window.start <= each.time < case.window.end for each in recorded)
        answered = {
            "stack": {"ended": []},
            "ledger": {"topics": [], "sent": played},
            "recorded": {"messages": played},
        }
        verdict = judge(answered)
        progress.add(make_row(case.id, verdict.outcome, verdict.reason))
    assert progress.finish()
    assert progress.verdict == "Passed"


def test_a_topic_without_a_message_is_not_reported_missing(tmp_path: Path) -> None:
    with Writer(tmp_path / "a.bag") as writer:
        store = get_typestore(Stores.ROS1_NOETIC)
        kind = "std_msgs/msg/String"
        writer.add_connection("/scan", kind, typestore=store)
        camera = writer.add_connection("/camera", kind, typestore=store)
        data = store.serialize_ros1(store.types[kind]("seen"), kind)
        writer.write(camera, SECOND, data)
    made = plan(make_spec(source=source("a.bag")), Storage({"recordings": str(tmp_path)}))
    assert made.cases == []
    (bag,) = made.unplanned
    assert bag.reason == "NoMatchingTopics"
    assert bag.message.endswith("/scan is in the bag without a message; it has /camera")


def test_names_have_a_mark_of_their_bag_where_two_share_one(tmp_path: Path) -> None:
    names = ("b.bag", "x/a.bag", "y/a.bag", "q (1)+2.bag", "-.bag")
    storage = storage_with(tmp_path, *names)
    made = plan(make_spec(source=source(*names, length="60s")), storage)
    assert sorted((case.bag.removeprefix("pvc://recordings/"), case.id) for case in made.cases) == [
        ("-.bag", "bag-0000"),
        ("b.bag", "b-0000"),
        ("q (1)+2.bag", "q-1-2-0000"),
        ("x/a.bag", "a-0c94b7eff280-0000"),
        ("y/a.bag", "a-217ab156858c-0000"),
    ]


def test_a_case_has_the_window_and_the_lead_in_that_the_job_asks_for(tmp_path: Path) -> None:
    write_bag(tmp_path / "a.bag", steady("/scan", 100, SECOND // 20))
    fragment = {"length": "2s", "warmUp": "500ms"}
    spec = make_spec(source=source("a.bag") | {"fragment": fragment})
    cases = plan(spec, Storage({"recordings": str(tmp_path)})).cases
    windows = sorted(
        (case.window.lead_in_start, case.window.start, case.window.end) for case in cases
    )
    assert windows == [
        (SECOND, SECOND, 3 * SECOND),
        (2_500_000_000, 3 * SECOND, 5 * SECOND),
        (4_500_000_000, 5 * SECOND, 5_950_000_001),
    ]
    # Connections' records lie in the index, and are read beside the chunks.
    assert all(case.bytes > sum(length for _, length in case.ranges) > 0 for case in cases)
    assert {case.messages for case in cases} == {100}


def test_of_a_bag_s_other_topics_ten_are_named(tmp_path: Path) -> None:
    recorded = [each for n in range(12) for each in steady(f"/t{n:02d}", 1, 1)]
    write_bag(tmp_path / "a.bag", recorded)
    spec = make_spec(source=source("a.bag") | {"topics": ["/x", "/y"]})
    (fault,) = plan(spec, Storage({"recordings": str(tmp_path)})).unplanned
    ten = ", ".join(f"/t{n:02d}" for n in range(10))
    assert fault.message.endswith(f": none of the topics /x, /y is in the bag; it has {ten}")


def test_a_volume_that_can_t_be_asked_hides_no_other_bag(tmp_path: Path) -> None:
    storage = storage_with(tmp_path, "a.bag")
    bags = ["pvc://nowhere/*.bag", "pvc://recordings/a.bag"]
    made = plan(make_spec(source=source("a.bag", length="60s") | {"bags": bags}), storage)
    assert [case.id for case in made.cases] == ["a-0000"]
    assert [(fault.bag, fault.reason) for fault in made.unplanned] == [(bags[0], "BagMissing")]
