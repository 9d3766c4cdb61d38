"""What a hostile tenant applies ends as that tenant's own refused job; others go on beside it."""

import json
from typing import Any

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k
from tests.e2e.installation import SYSTEM

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]

# Python's json.dumps can't write it either, so it takes the place of a word.
PLACE = "nested-deep"
DEEP = "[" * 1_500 + "]" * 1_500


def deep_job() -> str:
    """A manifest with a parameter that is nested 1,500 deep."""
    job = jobs.make_job("too-deep")
    job["spec"]["stack"]["parameters"] = {"/x": PLACE}
    return json.dumps(job).replace(f'"{PLACE}"', DEEP)


def slow_pattern_job() -> str:
    """A manifest whose pattern takes a backtracking matcher longer than anybody lives."""
    presence: dict[str, Any] = {"topic": "/" + "a" * 50, "min": 1}
    job = jobs.make_job("slow-pattern", record={"topics": ["/(a+)+b"]})
    job["spec"]["evaluate"] = [{"name": "never", "presence": presence}]
    return json.dumps(job)


def why_failed(namespace: str, name: str) -> str:
    """Reason and message of the condition Failed, by the API server's own words."""
    path = '{.status.conditions[?(@.type=="Failed")].reason}: '
    path += '{.status.conditions[?(@.type=="Failed")].message}'
    return k.kubectl("-n", namespace, "get", "simjob", name, "-o", f"jsonpath={path}")


def await_words(namespace: str, name: str, words: str) -> None:
    """Wait until the job has failed with these words."""
    k.await_that(f"{name} to be refused", lambda: words in why_failed(namespace, name), 60)


def test_hostile_manifests_are_refused_and_a_job_beside_them_completes(namespace: str) -> None:
    hostile = {"too-deep": deep_job(), "slow-pattern": slow_pattern_job()}
    words = {
        "too-deep": "SpecInvalid: spec: its lists and objects lie 32 deep",
        "slow-pattern": "SpecInvalid: spec: evaluate[never] reads /aaa",
    }
    try:
        for manifest in hostile.values():
            k.kubectl("-n", namespace, "apply", "-f", "-", given=manifest)
        for name, expected in words.items():
            await_words(namespace, name, expected)
        restarts = "jsonpath={.items[*].status.containerStatuses[*].restartCount}"
        operator = ("-n", SYSTEM, "get", "pods")
        before = k.kubectl(*operator, "-o", restarts)
        with jobs.applied(namespace, jobs.make_job("canary")) as canary:
            assert jobs.ended(namespace, canary, 300)["status"]["phase"] == "Complete"
        assert k.kubectl(*operator, "-o", restarts) == before
    finally:
        for name in hostile:
            jobs.delete(namespace, name)
