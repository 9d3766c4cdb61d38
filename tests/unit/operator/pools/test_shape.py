"""Which jobs' pods are alike: all that is rendered counts, but for whose they are."""

from dataclasses import replace
from typing import Any

import pytest

from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.jobs.pools.shape import Shape, shape_of
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import JobBuilder, make_job

SETTINGS = Settings()


def shape(job: JobBuilder, settings: Settings = SETTINGS) -> Shape:
    view = job.view()
    return shape_of(view, read_spec(view), settings)


USUAL = shape(make_job("x"))


def test_two_jobs_of_one_spec_are_alike_whatever_they_are_called() -> None:
    other = make_job("another-name")
    other.object["metadata"]["labels"] = {"lane": "left"}
    assert shape(other) == USUAL
    assert len(USUAL.digest) == 64
    assert not USUAL.pulls


def test_the_order_in_which_labels_are_written_is_no_difference() -> None:
    one, other = {"a": "1", "b": "2"}, {"b": "2", "a": "1"}
    shapes = [
        shape(make_job("x").with_spec("spark.executor.pod", {"labels": labels}))
        for labels in (one, other)
    ]
    assert shapes[0] == shapes[1]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("stack.command", ["roslaunch", "other"]),
        ("source.topics", ["/scan"]),
        ("stack.env", [{"name": "SPEED", "value": "3"}]),
        ("stack.parameters", {"/gain": 2}),
        ("playback", {"rate": 2}),
        ("maxFailedCases", 3),
    ],
)
def test_what_travels_with_the_job_or_its_cases_changes_no_pod(path: str, value: Any) -> None:
    assert shape(make_job("x").with_spec(path, value)) == USUAL


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("stack.image", "example/lane:2"),
        ("stack.resources", {"limits": {"memory": "1Gi"}}),
        ("stack.env", [{"name": "A", "valueFrom": {"secretKeyRef": {"name": "s", "key": "k"}}}]),
        ("stack.envFrom", [{"secretRef": {"name": "s"}}]),
        ("stack.securityContext", {"runAsUser": 7}),
        ("spark.slots", 2),
        ("spark.executors", 2),
        ("spark.executors", {"min": 1, "max": 2}),
        ("spark.driver.resources", {"cpu": "2", "memory": "2Gi"}),
        ("spark.executor.resources", {"cpu": "2", "memory": "2Gi"}),
        ("spark.executor.pod", {"labels": {"team": "lanes"}}),
        ("spark.executor.pod", {"annotations": {"team": "lanes"}}),
        ("spark.executor.pod", {"nodeSelector": {"gpu": "yes"}}),
        ("spark.executor.pod", {"tolerations": [{"key": "gpu", "operator": "Exists"}]}),
        ("spark.driver.pod", {"priorityClassName": "nightly"}),
        ("storage.secrets", ["bucket"]),
        ("output.uri", "pvc://elsewhere/lane"),
        ("playback.caseTimeout", "7m"),
    ],
)
def test_what_is_rendered_or_given_to_spark_makes_other_pods(path: str, value: Any) -> None:
    assert shape(make_job("x").with_spec(path, value)).digest != USUAL.digest


def test_a_claim_that_is_written_to_is_another_mount_than_one_that_is_read() -> None:
    written = make_job("x").with_spec("output.uri", "pvc://recordings/lane")
    assert shape(written).digest != USUAL.digest


def test_another_release_or_setting_of_the_installation_makes_other_pods() -> None:
    for changed in (
        {"spark_image": "registry.example/spark:next"},
        {"agent_image": "registry.example/agent:next"},
        {"driver_service_account": "another"},
        {"executor_service_account": "another"},
        {"storage_hosts": ("s3.example.com",)},
        {"fixed_users": False},
        {"architecture": "arm64"},
    ):
        assert shape(make_job("x"), replace(SETTINGS, **changed)).digest != USUAL.digest, changed


def test_the_namespace_is_a_part_of_it() -> None:
    elsewhere = make_job("x")
    elsewhere.object["metadata"]["namespace"] = "depths"
    assert shape(elsewhere).digest != USUAL.digest


def test_an_image_that_is_asked_for_at_each_start_is_seen_in_every_container() -> None:
    assert shape(make_job("x").with_spec("stack.imagePullPolicy", "Always")).pulls
    assert shape(make_job("x"), replace(SETTINGS, image_pull_policy="Always")).pulls
    assert not shape(make_job("x").with_spec("stack.imagePullPolicy", "Never")).pulls
