"""Specs of a megabyte that hold what no job needs: refused at their first value, and only once."""

from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.spec import SimulationJobSpec
from bagpipe_operator.cluster.client import ApiError
from bagpipe_operator.jobs.pods import job_config
from bagpipe_operator.jobs.pods.job_config import JobTooLargeError, UnusableSpecError, read_spec
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import JobBuilder, make_job
from tests.unit.operator.world import World

# Each was 0.3 to 1.4 MB, and made 110,000 to 2,700,000 errors.
MOST_ERRORS = 1_000


def simulated(**part: Any) -> JobBuilder:
    job = make_job("x").with_spec("source", {"simulator": {"duration": "10s"} | part})
    return job.with_spec("playback", {"mode": "lockstep"})


def with_matrix(variables: Any, **more: Any) -> JobBuilder:
    return make_job("x").with_spec("matrix", {"variables": variables, **more})


def keys(count: int, value: Any = 1) -> dict[str, Any]:
    return {f"k{n:06d}": value for n in range(count)}


ACTOR = {"name": "a", "kind": "car", "start": {"x": 1, "lane": 0}}

CASES = {
    "brackets": (
        with_matrix({"v": [[] for _ in range(450_000)]}),
        "spec.matrix.variables: it has 450001 values in its lists and maps, and may have 131072",
    ),
    "brackets of a size that can be": (
        with_matrix({"v": [[] for _ in range(130_000)]}),
        "Input should be a valid string",
    ),
    "nulls in many": (
        with_matrix({f"v{n}": [None] * 10_000 for n in range(12)}),
        "Input should be a valid string",
    ),
    "choices": (
        with_matrix({"v": {"choices": [{"value": []} for _ in range(60_000)]}}),
        "spec.matrix.variables.v.",
    ),
    "keys of ranges": (
        with_matrix({f"v{n}": keys(3_000) for n in range(32)}),
        "spec.matrix.variables.v0.",
    ),
    "names of variables": (
        with_matrix(keys(90_000, [1])),
        "spec.matrix.variables: it has 90000 keys, and may have 64",
    ),
    "include": (
        with_matrix({"v": [1]}, include=[keys(64, None) for _ in range(1_000)]),
        "spec.matrix.include.0.k000000.str: Input should be a valid string",
    ),
    "keys of include": (
        with_matrix({"v": [1]}, include=[keys(100, None) for _ in range(1_000)]),
        "spec.matrix.include.0: it has 100 keys, and may have 64",
    ),
    "exclude": (
        with_matrix({"v": [1]}, exclude=[keys(1_000) for _ in range(100)]),
        "spec.matrix.exclude.0: it has 1000 keys, and may have 64",
    ),
    "scene": (
        simulated(scene=keys(110_000)),
        "spec.source.simulator.scene: it has 110000 keys, and may have 64",
    ),
    "script": (
        simulated(actors=[ACTOR | {"script": [1] * 690_000}]),
        "spec.source.simulator.actors: it has 690007 values in its lists and maps, and may have",
    ),
    "script of a size that can be": (
        simulated(actors=[ACTOR | {"script": [1] * 130_000}]),
        "spec.source.simulator.actors.0.script.0: Input should be a valid dictionary",
    ),
    "affinity": (
        make_job("x").with_spec(
            "spark.executor.pod.affinity", {"nodeAffinity": [[] for _ in range(450_000)]}
        ),
        "spec.spark.executor.pod.affinity: it has 450001 values in its lists and maps",
    ),
    "parameters": (
        make_job("x").with_spec("stack.parameters", {"/x": [[] for _ in range(470_000)]}),
        "spec.stack.parameters: it has 470001 values in its lists and maps, and may have 131072",
    ),
    "names of parameters": (
        make_job("x").with_spec("stack.parameters", keys(100_000)),
        "spec.stack.parameters: it has 100000 keys, and may have 1000",
    ),
}


@pytest.mark.parametrize("which", CASES)
def test_it_is_refused_by_its_first_errors_with_the_field_and_what_it_may_have(which: str) -> None:
    job, sentence = CASES[which]
    with pytest.raises(ValidationError) as refused:
        SimulationJobSpec.model_validate(job.object["spec"])
    assert refused.value.error_count() <= MOST_ERRORS
    with pytest.raises(UnusableSpecError, match=r"^spec[.]") as unusable:
        read_spec(job.view())
    assert sentence in str(unusable.value)


def test_as_many_values_as_fit_a_config_map_are_taken() -> None:
    variables = {f"v{n}": list(range(10_000)) for n in range(13)}
    spec = read_spec(with_matrix(variables).view())
    assert spec.matrix is not None
    assert {name: len(list(spec.matrix.variables[name])) for name in variables} == dict.fromkeys(
        variables, 10_000
    )


def test_the_template_of_what_is_too_large_already_is_not_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    job = make_job("x").with_spec("stack.parameters", {"/x": "y" * 1_048_576})
    job.with_spec("spark.executor.pod.affinity", {"nodeAffinity": ["z" * 9] * 9_999})
    written: list[object] = []
    monkeypatch.setattr("yaml.dump", lambda template, **_more: written.append(template))
    with pytest.raises(JobTooLargeError, match=r"takes 1\d{6} bytes or more"):
        job_config.job_config(job.view(), read_spec(job.view()), 1, Settings())
    assert written == []


async def test_a_refused_spec_is_read_once_however_often_its_status_can_t_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world, validated = World(CASES["nulls in many"][0]), 0
    validate = SimulationJobSpec.model_validate

    def counted(*args: Any, **more: Any) -> SimulationJobSpec:
        nonlocal validated
        validated += 1
        return validate(*args, **more)

    monkeypatch.setattr(SimulationJobSpec, "model_validate", counted)
    for _ in range(20):
        world.api.fail("patch status", ApiError(0, "Unreachable", "no answer"))
        with pytest.raises(ApiError):
            await world.reconcile(after=10)
    assert validated == 1
    await world.reconcile(after=10)
    assert (validated, world.reason("Failed")) == (1, "True/SpecInvalid")


LONG = "k" * 1_200_000
LONG_SENTENCES = {
    "a parameter's name": make_job("x").with_spec("stack.parameters", {LONG: 1}),
    "a variable's name": with_matrix({LONG: 1}),
    "a memory's size": make_job("x").with_spec("spark.driver.resources.memory", LONG),
}


@pytest.mark.parametrize("which", LONG_SENTENCES)
async def test_of_a_refused_spec_a_bounded_sentence_is_made_and_kept(which: str) -> None:
    """Of 1.2 MB that stood three times in it, 3.6 MB were kept for each such job."""
    job = LONG_SENTENCES[which]
    with pytest.raises(UnusableSpecError, match=r"^spec[.]") as unusable:
        read_spec(job.view())
    assert len(str(unusable.value)) <= 1_500
    world = World(job)
    world.api.fail("patch status", ApiError(500, "InternalError", "etcdserver: too large"))
    with pytest.raises(ApiError):
        await world.reconcile()
    ((_, kept),) = world.reconciler._specs._refused.values()
    assert len(kept) <= 1_024
    assert kept == str(unusable.value)[:1_024]


async def test_an_edited_spec_is_read_again() -> None:
    world = World(CASES["names of parameters"][0])
    world.api.fail("patch status", ApiError(0, "Unreachable", "no answer"))
    with pytest.raises(ApiError):
        await world.reconcile()
    job = world.api.objects["jobs", "x"]
    job["spec"]["stack"]["parameters"] = {"/x": 1}
    job["metadata"] |= {"generation": 2, "resourceVersion": "8"}
    world.deliver_job()
    await world.reconcile()
    assert world.api.named("pods") == ["x-1-driver"]
