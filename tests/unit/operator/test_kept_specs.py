"""What the operator keeps of specs, however large a tenant writes them, and what it asks for."""

import contextlib
import gc
import json
import random
import tracemalloc
from typing import Any

import pytest

from bagpipe_operator.api.kept_spec import LARGEST_KEPT_BYTES, packed, scalars, unpacked
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.cluster.large_objects import SIZE, trimmed
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.view import View
from bagpipe_operator.jobs.whole_job import whole
from bagpipe_operator.schedules.view import Schedules, ScheduleView
from tests.unit.operator.builders import make_job
from tests.unit.operator.schedules.world import make_schedule
from tests.unit.operator.world import UID, World

# What the operator's container may have, what it has before it knows a job, and what kopf takes for
# each (docs/operations/sizing.md).
LIMIT, ALONE, KOPF, JOBS = 512 << 20, 120 << 20, 21_000, 10_000
# A spec of many small values: a byte of JSON is ten of Python's.
LARGE = {f"/p{n}": [m % 7 for m in range(70)] for n in range(1_000)}
SMALL = {"/map": "a4"}


def large_job(name: str) -> dict[str, Any]:
    text = json.dumps(make_job(name).with_spec("stack.parameters", LARGE).object)
    parsed: dict[str, Any] = json.loads(text)
    return parsed


def test_ten_thousand_large_jobs_that_wait_fit_the_charts_limit() -> None:
    view = View()
    size = len(json.dumps(large_job("x")["spec"]))
    assert size > 200_000
    gc.collect()
    tracemalloc.start()
    try:
        for number in range(10):
            view.put_job(JobView.from_object(large_job(f"x{number}")))
        gc.collect()
        each = tracemalloc.get_traced_memory()[0] / 10
    finally:
        tracemalloc.stop()
    assert ALONE + JOBS * (each + LARGEST_KEPT_BYTES + KOPF) < LIMIT
    assert each < 8_000


def test_templates_of_schedules_are_not_kept_either() -> None:
    schedules = Schedules()
    schedule = make_schedule()
    schedule["spec"]["jobTemplate"]["spec"]["stack"] = {"parameters": LARGE}
    schedules.put_schedule(ScheduleView.from_object(json.loads(json.dumps(schedule))))
    (kept,) = schedules.schedules()
    assert "jobTemplate" not in kept.spec
    assert kept.spec["schedule"] == schedule["spec"]["schedule"]


@pytest.mark.parametrize(("parameters", "asked"), [(SMALL, 0), (LARGE, 1)])
async def test_a_driver_gets_the_whole_spec(parameters: dict[str, Any], asked: int) -> None:
    world = World(make_job("x").with_spec("stack.parameters", parameters))
    await world.reconcile()
    config = world.config("x-1")
    written = json.loads(config["data"]["job.json"])["spec"]["stack"]["parameters"]
    assert written == parameters
    assert world.api.calls.count("get job") == asked
    await world.reconcile(after=60)
    assert world.api.calls.count("get job") == asked


async def test_a_job_that_took_the_large_ones_name_is_not_run_in_its_place() -> None:
    world = World(make_job("x").with_spec("stack.parameters", LARGE))
    other = world.api.objects["jobs", "x"]
    other["metadata"]["uid"] = "another"
    with pytest.raises(ApiError, match="another job by now"):
        await world.reconcile()
    assert world.api.named("pods") == []
    assert world.view.job(UID) is None


async def test_what_decides_is_the_same_in_part_and_in_whole() -> None:
    fields = {"suspend": True, "activeDeadline": "1h", "startDeadline": "2h", "backoffLimit": 3,
              "ttlAfterFinished": "5m", "resumeFrom": "earlier", "managedBy": "kueue"}  # fmt: skip
    job = make_job("x").with_spec("stack.parameters", LARGE).with_spec("spark.executors", 7)
    for name, value in fields.items():
        job.with_spec(name, value)
    job.with_spec("spark.slots", 2)
    part = job.view().kept()
    assert part.spec == fields | {"spark": {"executors": 7, "slots": 2}}
    assert part.managed_elsewhere
    assert part.kept() == part
    world = World(job)
    assert (await whole(world.api, part)).spec == job.object["spec"]


@pytest.mark.parametrize(
    ("executors", "kept"),
    [
        ({"min": 1, "max": 8}, {"executors": {"min": 1, "max": 8}}),
        ({"min": 1, "max": 8, "more": "x" * 9000}, {"executors": {"min": 1, "max": 8}}),
        ({"min": 1}, {}),
        ({"min": 1, "max": "x" * 9000}, {}),
        ([1, 8], {}),
    ],
)
def test_of_executors_that_come_and_go_both_numbers_are_kept(
    executors: object, kept: dict[str, Any]
) -> None:
    part = make_job("x").with_spec("spark", {"executors": executors}).view().kept()
    assert part.spec.get("spark", {}) == kept


def test_texts_as_long_as_no_name_and_lists_are_left_out() -> None:
    spec = {"a": "x" * 256, "b": "x" * 257, "c": [1], "d": {"e": 1}, "f": 1.5, "g": None, "h": True}
    assert scalars(spec) == {"a": "x" * 256, "f": 1.5, "h": True}
    assert scalars(spec, frozenset({"h"})) == {"h": True}


def test_what_is_packed_comes_out_as_it_was_or_not_at_all() -> None:
    chance = random.Random(7)  # noqa: S311  no secret
    for _ in range(200):
        value = {chr(chance.randrange(1, 0xD7FF)) * chance.randrange(9): chance.random()
                 for _ in range(chance.randrange(600))}  # fmt: skip
        text = packed(value)
        assert len(text) <= LARGEST_KEPT_BYTES
        assert unpacked(text) == (value if text else None)


def test_what_is_kept_whole_is_at_most_eight_kibibytes() -> None:
    for length in (0, 1, 4000, 8192 - len('{"a":""}')):
        value = {"a": "x" * length}
        assert unpacked(packed(value)) == value
    assert packed({"a": "x" * (8193 - len('{"a":""}'))}) == b""


@pytest.mark.parametrize("parameters", [SMALL, LARGE])
async def test_a_job_that_is_gone_is_dropped_at_its_next_visit(parameters: dict[str, Any]) -> None:
    world = World(make_job("x").with_spec("stack.parameters", parameters))
    del world.api.objects["jobs", "x"]
    with contextlib.suppress(ApiError):
        await world.reconcile()
    assert world.view.job(UID) is None


async def test_a_large_job_stays_large_when_it_is_read_again() -> None:
    world = World(make_job("x").with_spec("stack.parameters", LARGE))
    entire = world.api.objects["jobs", "x"]
    entire[SIZE] = 200_000
    world.view.put_job(JobView.from_object(trimmed(entire)))
    world.api.version += 5
    entire["metadata"]["resourceVersion"] = str(world.api.version)
    with pytest.raises(ApiError, match="modified"):
        await world.reconcile()
    job = world.view.job(UID)
    assert job is not None
    assert (job.large, job.resource_version) == (True, str(world.api.version))
