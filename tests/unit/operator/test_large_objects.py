"""Lists and watches with objects of a megabyte: each is read alone, and its bulk is left out."""

import asyncio
import gc
import json
import tracemalloc
from dataclasses import replace
from typing import Any

import pytest

from bagpipe_operator.api import names
from bagpipe_operator.api.nesting import end_of
from bagpipe_operator.cluster.large_objects import (
    PAGE,
    SIZE,
    TRIMMED,
    TRIMMED_FROM,
    read_answer,
    read_event,
    read_whole,
    read_written,
    trimmed,
)
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.schedules.view import ScheduledJob, ScheduleView
from tests.unit.operator.builders import make_driver, make_job
from tests.unit.operator.schedules.world import make_schedule
from tests.unit.operator.test_nesting import nested

# Many small values: a byte of JSON is ten of Python's.
MANY = {f"/p{n}": [n % 7, n % 5] for n in range(12_000)}


def large_job(name: str, **spec: Any) -> dict[str, Any]:
    job = make_job(name).with_spec("stack.parameters", MANY)
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
    value = read_whole(answer)
    assert (value["kind"], value["metadata"]["continue"]) == ("List", "token")
    assert value["items"][0] == value["items"][2] == json.loads(json.dumps(small))
    large = value["items"][1]
    assert (large[TRIMMED], large["spec"]) == (True, {"suspend": True})
    assert len(json.dumps(large)) < 1_000


@pytest.mark.parametrize("items", [[], [1], ["]"], [None, {"a": '"items":['}]])
def test_short_and_odd_lists_are_read_as_json_reads_them(items: list[Any]) -> None:
    filler = {"x": "y" * TRIMMED_FROM}
    for answer in (listed(*items), listed(*items, filler)):
        wanted = json.loads(answer)
        if filler in wanted["items"]:
            wanted["items"][-1] = read_whole(answer)["items"][-1]
        assert read_whole(answer) == wanted
    assert read_whole(b'{"items":null}') == {"items": None}


def test_an_object_that_has_items_inside_is_no_list() -> None:
    job = make_job("x").with_spec(
        "stack.parameters", {"/a": {"items": [{"b": "y" * TRIMMED_FROM}]}}
    )
    text = json.dumps(job.object, separators=(",", ":"))
    assert read_whole(text.encode()) == job.object | {SIZE: len(text)}


@pytest.mark.parametrize("cut", [-1, -40, -300_000])
def test_a_list_that_breaks_off_is_no_json(cut: int) -> None:
    with pytest.raises(json.JSONDecodeError):
        read_whole(listed(large_job("a"), large_job("b"))[:cut])


def test_a_large_list_with_an_object_that_is_nested_deeply_is_read() -> None:
    deep = '{"spec": {"stack": {"parameters": ' + nested(2_000) + "}}}"
    answer = listed(large_job("a"), "HERE", make_job("b").object)
    value = read_whole(answer.replace(b'"HERE"', deep.encode()))
    assert [TRIMMED in item for item in value["items"]] == [True, False, False]
    assert value["items"][2]["metadata"]["name"] == "b"


def test_what_views_keep_of_a_large_object_is_what_they_keep_of_all_of_it() -> None:
    job = large_job("x", suspend=True, ttlAfterFinished="5m")
    job["spec"]["spark"] = {"executors": 7}
    part, entire = (
        JobView.from_object(read_whole(listed(job))["items"][0]),
        JobView.from_object(job),
    )
    assert (part.large, entire.large) == (True, False)
    assert replace(part.kept(), large=False) == entire.kept()
    assert part.kept().packed == b""

    schedule = make_schedule()
    schedule["spec"]["jobTemplate"]["spec"]["stack"] = {"parameters": MANY}
    (read,) = read_whole(listed(schedule))["items"]
    kept = ScheduleView.from_object(read).kept()
    assert kept.large
    assert replace(kept, large=False) == ScheduleView.from_object(schedule).kept()
    owner = {"uid": "uid-of-nightly", "controller": True}
    job["metadata"]["ownerReferences"] = [{"uid": "another"}, owner]
    job["metadata"]["labels"] = {names.LABEL_SCHEDULE: "nightly", "other": "x" * TRIMMED_FROM}
    (read,) = read_whole(listed(job))["items"]
    # kopf brings a schedule only jobs with its label.
    assert read["metadata"]["labels"] == {names.LABEL_SCHEDULE: "nightly"}
    assert ScheduledJob.from_object(read) == ScheduledJob.from_object(job)
    assert ScheduledJob.from_object(read).schedule_uid == "uid-of-nightly"

    pod = make_driver("x").running().object()
    claim = {"name": "v", "persistentVolumeClaim": {"claimName": "results"}}
    # Without its shape the pool would not know that a large driver waits, and would end it.
    shape = {names.ANNOTATION_SHAPE: "ab" * 32}
    pod["metadata"]["annotations"] = shape | {"a": "x" * TRIMMED_FROM}
    pod["spec"] = {"nodeName": "n", "containers": [{"env": ["x"] * TRIMMED_FROM}],
                   "volumes": [{"name": "e", "emptyDir": {}}, claim]}  # fmt: skip
    (read,) = read_whole(listed(pod))["items"]
    assert PodView.from_object(read) == PodView.from_object(pod)
    assert PodView.from_object(read).claims == ("results",)
    assert PodView.from_object(read).shape == "ab" * 32
    assert len(json.dumps(read)) < 2_000
    pod["metadata"]["annotations"] = {names.ANNOTATION_SHAPE: "x" * TRIMMED_FROM}
    assert "annotations" not in read_whole(listed(pod))["items"][0]["metadata"]


def test_of_a_large_event_what_is_read_is_kept_and_its_texts_are_cut() -> None:
    moments = {
        "lastTimestamp": "2026-11-20T04:00:00Z", "eventTime": None,
        "series": {"count": 2, "lastObservedTime": "2026-11-20T04:00:01.000000Z"},
    }  # fmt: skip
    meta = {"name": "e", "creationTimestamp": "2026-11-20T04:00:00Z"}
    event = {
        "metadata": meta | {"annotations": {"a": "x" * TRIMMED_FROM}}, **moments,
        "reason": "Failed" * TRIMMED_FROM, "message": "m" * TRIMMED_FROM,
        "involvedObject": {"name": "p" * TRIMMED_FROM, "fieldPath": ".c{" * TRIMMED_FROM},
        "source": {"component": "k" * TRIMMED_FROM},
    }  # fmt: skip
    (read,) = read_whole(listed(event))["items"]
    assert {key: read[key] for key in moments} == moments
    assert read["metadata"]["creationTimestamp"] == meta["creationTimestamp"]
    assert (len(read["reason"]), len(read["message"])) == (128, 1024)
    assert read["involvedObject"] == {"fieldPath": (".c{" * 100)[:256]}
    assert len(json.dumps(read)) < 2_000


def event_of(line: bytes) -> bytes:
    return asyncio.run(read_event(line))


def test_an_event_is_trimmed_and_what_is_none_is_left() -> None:
    line = json.dumps({"type": "ADDED", "object": large_job("x")}).encode()
    event = json.loads(event_of(line))
    assert (event["type"], event["object"]["metadata"]["name"]) == ("ADDED", "x")
    assert (event["object"][TRIMMED], event["object"][SIZE]) == (True, len(line))
    fault = {"type": "ERROR", "object": {"code": 410, "message": "x" * TRIMMED_FROM}}
    for each in (json.dumps(fault).encode(), line[:-1], b"[" + b"1," * TRIMMED_FROM + b"1]"):
        assert event_of(each) == each


def test_a_deep_object_in_a_watch_is_read_to_the_bound_and_trimmed() -> None:
    deep = '{"type": "ADDED", "object": {"spec": {"suspend": true, "x": ' + nested(20_000) + "}}}"
    event = json.loads(event_of(deep.encode()))
    assert (event["object"]["spec"], event["object"][TRIMMED]) == ({"suspend": True}, True)


def test_a_page_of_the_largest_objects_takes_little_beside_its_text() -> None:
    answer = listed(*(large_job(f"x{n}") for n in range(PAGE)))
    assert len(answer) > 5_000_000
    peaks = []
    for read in (json.loads, read_whole):
        gc.collect()
        tracemalloc.start()
        read(answer)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    print(len(answer), peaks)
    assert peaks[1] < 2 * len(answer)
    assert peaks[1] < peaks[0] / 3


def test_where_an_object_ends_is_found_however_deep_it_is_and_whatever_its_texts_say() -> None:
    for inner in ("[]", '{"a": "]}[{"}', nested(3_000), '["\\"]", {"b": [1]}]'):
        text = f"[{inner},7]"
        assert text[1 : end_of(text, 1)] == inner


def test_an_answer_to_a_write_is_trimmed_and_one_to_a_question_is_whole() -> None:
    job = large_job("x", suspend=True)
    text = json.dumps(job).encode()
    entire = asyncio.run(read_answer(text))
    assert entire == job | {SIZE: len(text)}
    assert JobView.from_object(entire).large
    part = asyncio.run(read_answer(text, written=True))
    assert part == trimmed(entire)
    assert part[SIZE] == len(text)
    small = make_job("y").object
    assert read_written(json.dumps(small).encode()) == small


def test_events_keep_their_words_and_odd_metadata_ends_nothing() -> None:
    note = {"metadata": {"name": "e", "annotations": {"a": "x" * TRIMMED_FROM}}, "reason": "Failed"}
    (read,) = read_whole(listed(note))["items"]
    assert (read["reason"], read["metadata"]["name"]) == ("Failed", "e")
    assert len(json.dumps(read)) < 500
    for owners in ([None], {"a": 1}, "x"):
        odd = {"metadata": {"ownerReferences": owners, "labels": [1]},
               "spec": {"containers": [], "volumes": [None]}}  # fmt: skip
        assert trimmed(odd)["metadata"]["ownerReferences"] == []


@pytest.mark.parametrize("broken", [False, True])
def test_the_collector_waits_while_a_large_object_is_read(broken: bool) -> None:
    text = json.dumps({"items": [large_job("a"), large_job("b")]}, separators=(",", ":")).encode()
    found: list[str] = []

    def note(phase: str, _: dict[str, int]) -> None:
        found.append(phase)

    async def read() -> None:
        if broken:
            with pytest.raises(ValueError, match="Expecting"):
                await read_answer(text[:-1])
        else:
            assert len((await read_answer(text))["items"]) == 2

    before = gc.get_threshold()
    gc.set_threshold(700)
    gc.callbacks.append(note)
    try:
        asyncio.run(read())
        quiet = len(found)
        read_whole(text)  # as it would be without
    finally:
        gc.callbacks.remove(note)
        gc.set_threshold(*before)
    assert gc.isenabled()
    assert len(found) - quiet > 30 > 2 * quiet
