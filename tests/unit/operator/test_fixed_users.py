"""Pods name the users and the group that they run as, or none where the cluster gives them."""

from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.pods.driver_pod import driver_pod
from bagpipe_operator.jobs.pods.executor_template import executor_template
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import SettingError, Settings
from tests.unit.operator.builders import JobBuilder, make_job

USERS = {"runAsUser", "runAsGroup", "fsGroup"}


def pods(job: JobBuilder, fixed_users: bool) -> list[Json]:
    view = job.view()
    spec, settings = read_spec(view), Settings(fixed_users=fixed_users)
    return [
        driver_pod(view, spec, 1, settings, "x-1-0a"),
        executor_template(view, spec, 1, settings),
    ]


def contexts(pod: Json) -> dict[str, Json]:
    """The securityContexts of a pod: its own (as pod), and each container's."""
    containers = pod["spec"].get("initContainers", []) + pod["spec"]["containers"]
    found = {each["name"]: each["securityContext"] for each in containers}
    return {"pod": pod["spec"]["securityContext"], **found}


def users(pod: Json) -> dict[str, dict[str, Any]]:
    return {
        where: {key: context[key] for key in USERS & set(context)}
        for where, context in contexts(pod).items()
    }


def test_they_are_named() -> None:
    ours = {"runAsUser": 10001, "runAsGroup": 10001}
    driver, executor = pods(make_job("x"), fixed_users=True)
    assert users(driver) == {"pod": {"fsGroup": 10001}, "driver": ours}
    assert users(executor) == {
        "pod": {"fsGroup": 10001}, "agent": ours, "spark": ours,
        "stack": {"runAsUser": 65532, "runAsGroup": 65532},
    }  # fmt: skip


def test_none_is_named_where_the_cluster_gives_them_and_all_else_stays() -> None:
    fixed, free = (pods(make_job("x"), fixed_users=given) for given in (True, False))
    for with_users, without in zip(fixed, free, strict=True):
        assert all(named == {} for named in users(without).values())
        for where, context in contexts(with_users).items():
            kept = {key: value for key, value in context.items() if key not in USERS}
            assert contexts(without)[where] == kept


def test_what_a_job_says_itself_is_not_taken_away() -> None:
    """The cluster then refuses it with a reason, which is better than another user in silence."""
    job = make_job("x").with_spec("stack.securityContext", {"runAsUser": 1000})
    job = job.with_spec("spark.executor.pod.securityContext", {"fsGroup": 2000})
    _, executor = pods(job, fixed_users=False)
    assert users(executor)["stack"] == {"runAsUser": 1000, "runAsGroup": 1000}
    assert users(executor)["pod"] == {"fsGroup": 2000}


def test_the_setting() -> None:
    assert Settings.from_environment({}).fixed_users is True
    assert Settings.from_environment({"BAGPIPE_FIXED_USERS": "false"}).fixed_users is False
    with pytest.raises(SettingError, match="BAGPIPE_FIXED_USERS is 'no': write true or false"):
        Settings.from_environment({"BAGPIPE_FIXED_USERS": "no"})
