"""Pods go to nodes whose processor the images are built for."""

import pytest

from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_template
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import JobBuilder, make_job


def nodes(job: JobBuilder, settings: Settings) -> dict[str, dict[str, str] | None]:
    """The labels that the pods of each role ask of their nodes."""
    view = job.view()
    spec = read_spec(view)
    pods = {
        "driver": driver_pod(view, spec, 1, settings, "x-1-0a"),
        "executor": executor_template(view, spec, 1, settings),
    }
    return {role: pod["spec"].get("nodeSelector") for role, pod in pods.items()}


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ({}, {"kubernetes.io/arch": "amd64"}),
        ({"BAGPIPE_ARCHITECTURE": "arm64"}, {"kubernetes.io/arch": "arm64"}),
        ({"BAGPIPE_ARCHITECTURE": ""}, None),
    ],
)
def test_it_is_that_of_the_images(given: dict[str, str], expected: dict[str, str] | None) -> None:
    settings = Settings.from_environment(given)
    assert nodes(make_job("x"), settings) == {"driver": expected, "executor": expected}


def test_what_a_job_asks_for_comes_beside_it_and_goes_before_it() -> None:
    named = {"kubernetes.io/arch": "arm64"}
    job = make_job("x").with_spec("spark.driver.pod", {"nodeSelector": {"pool": "fast"}})
    assert nodes(job.with_spec("spark.executor.pod", {"nodeSelector": named}), Settings()) == {
        "driver": {"kubernetes.io/arch": "amd64", "pool": "fast"},
        "executor": named,
    }
