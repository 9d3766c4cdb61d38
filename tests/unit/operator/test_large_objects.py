"""Lists and watches with objects of a megabyte: each is read alone, and its bulk is left out."""

import gc
import json
import tracemalloc
from dataclasses import replace
from typing import Any

import pytest

from bagpipe_operator import names
from bagpipe_operator.large_objects import LARGE_TEXT, PAGE, TRIMMED, read_answer, read_event
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView
from bagpipe_operator.view import JobView, PodView
from tests.unit.operator.builders import make_driver, make_job
from tests.unit.operator.schedules.world import make_schedule
from tests.unit.operator.test_nesting import nested

# Many small values: a byte of JSON is ten of Python's.
LARGE = {f"/p{n}": [n % 7, n % 5] for n in range(12_000)}


def large_job(name: str, **spec: Any) -> dict[str, Any]:
    job = make_job(name).with_spec("stack.parameters", LARGE)
    for key, value in spec.items():
        job.with_spec(key, value)
    job.object["metadata"]["annotations"] = {"kubectl": "x" * 100_000}
    return job.object


def listed(*items: Any, **more: Any) -> bytes:
    """As the API server writes a list, without spaces."""
    value = {"apiVersion": "v1", "items": list(items), "kind": "List", "metadata": more}
    return json.dumps(value, separators=(",", ":")).encode()


def test_a_list_is_what_it_was_but_for_its_large_objects() -> None:
    small = make_job("small").object
    answer = listed(small, large_job("large", suspend=True), small, **{"continue": "token"})
    value = read_answer(answer)
    assert (value["kind"], value["metadata"]["continue"]) == ("List", "token")
    assert value["items"][0] == value["items"][2] == json.loads(json.dumps(small))
    large = value["items"][1]
    assert (large[TRIMMED], large["spec"]) == (True, {"suspend": True})
    assert len(json.dumps(large)) < 1_000


@pytest.mark.parametrize("items", [[], [1], ["]"], [None, {"a": '"items":['}]])
def test_short_and_odd_lists_are_read_as_json_reads_them(items: list[Any]) -> None:
    filler = {"x": "y" * LARGE_TEXT}
    for answer in (listed(*items), listed(*items, filler)):
        wanted = json.loads(answer)
        if filler in wanted["items"]:
            wanted["items"][-1] = read_answer(answer)["items"][-1]
        assert read_answer(answer) == wanted
    assert read_answer(b'{"items":null}') == {"items": None}


def test_an_object_that_has_items_inside_is_no_list() -> None:
    job = make_job("x").with_spec("stack.parameters", {"/a": {"items": [{"b": "y" * LARGE_TEXT}]}})
    text = json.dumps(job.object, separators=(",", ":"))
    assert read_answer(text.encode()) == job.object


@pytest.mark.parametrize("cut", [-1, -40, -300_000])
def test_a_list_that_breaks_off_is_no_json(cut: int) -> None:
    with pytest.raises(json.JSONDecodeError):
        read_answer(listed(large_job("a"), large_job("b"))[:cut])


def test_a_large_list_with_an_object_that_is_nested_deeply_is_read() -> None:
    deep = '{"spec": {"stack": {"parameters": ' + nested(2_000) + "}}}"
    answer = listed(large_job("a"), "HERE", make_job("b").object)
    value = read_answer(answer.replace(b'"HERE"', deep.encode()))
    assert [TRIMMED in item for item in value["items"]] == [True, False, False]
    assert value["items"][2]["metadata"]["name"] == "b"


def test_what_views_keep_of_a_large_object_is_what_they_keep_of_all_of_it() -> None:
    job = large_job("x", suspend=True, ttlAfterFinished="5m")
    job["spec"]["spark"] = {"executors": 7}
    part, entire = (
        JobView.from_object(read_answer(listed(job))["items"][0]),
        JobView.from_object(job),
    )
    assert (part.large, entire.large) == (True, False)
    assert replace(part.kept(), large=False) == entire.kept()
    assert part.kept().packed == b""

    schedule = make_schedule()
    schedule["spec"]["jobTemplate"]["spec"]["stack"] = {"parameters": LARGE}
    (read,) = read_answer(listed(schedule))["items"]
    assert ScheduleView.from_object(read).kept() == ScheduleView.from_object(schedule).kept()
    owner = {"uid": "uid-of-nightly", "controller": True}
    job["metadata"]["ownerReferences"] = [{"uid": "another"}, owner]
    job["metadata"]["labels"] = {names.LABEL_SCHEDULE: "nightly", "other": "x" * LARGE_TEXT}
    (read,) = read_answer(listed(job))["items"]
    # kopf brings a schedule only jobs with its label.
    assert read["metadata"]["labels"] == {names.LABEL_SCHEDULE: "nightly"}
    assert ScheduledJob.from_object(read) == ScheduledJob.from_object(job)
    assert ScheduledJob.from_object(read).schedule_uid == "uid-of-nightly"

    pod = make_driver("x").running().object()
    claim = {"name": "v", "persistentVolumeClaim": {"claimName": "results"}}
    pod["metadata"]["annotations"] = {"a": "x" * LARGE_TEXT}
    pod["spec"] = {"nodeName": "n", "containers": [{"env": ["x"] * LARGE_TEXT}],
                   "volumes": [{"name": "e", "emptyDir": {}}, claim]}  # fmt: skip
    (read,) = read_answer(listed(pod))["items"]
    assert PodView.from_object(read) == PodView.from_object(pod)
    assert PodView.from_object(read).claims == ("results",)
    assert len(json.dumps(read)) < 2_000


def test_an_event_is_trimmed_and_what_is_none_is_left() -> None:
    line = json.dumps({"type": "ADDED", "object": large_job("x")}).encode()
    event = json.loads(read_event(line))
    assert (event["type"], event["object"]["metadata"]["name"]) == ("ADDED", "x")
    assert event["object"][TRIMMED] is True
    long = b'{"type": "ERROR", "object": "' + b"x" * LARGE_TEXT + b'"}'
    for each in (long, line[:-1], b"[" + b"1," * LARGE_TEXT + b"1]"):
        assert read_event(each) == each


def test_a_page_of_the_largest_objects_takes_little_beside_its_text() -> None:
    answer = listed(*(large_job(f"x{n}") for n in range(PAGE)))
    assert len(answer) > 5_000_000
    peaks = []
    for read in (json.loads, read_answer):
        gc.collect()
        tracemalloc.start()
        read(answer)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    print(len(answer), peaks)
    assert peaks[1] < 2 * len(answer)
    assert peaks[1] < peaks[0] / 3
