"""Bad input: each ends its job as Failed in bounded time, with a reason and a sentence."""

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import pytest

from tests.e2e import jobs
from tests.e2e import kubectl as k

pytestmark = [pytest.mark.e2e, pytest.mark.usefixtures("recordings")]


@dataclass(frozen=True)
class Bad:
    """A job's changed sections and what the user must read."""

    name: str
    changed: dict[str, dict[str, Any]]
    reason: str
    words: str


def bags(*names: str) -> dict[str, dict[str, Any]]:
    return {"source": {"bags": [f"pvc://recordings/{name}" for name in names]}}


def stack(**fields: Any) -> dict[str, dict[str, Any]]:
    return {"stack": fields}


CRASH = "echo 'the laser is on fire' >&2; exit 3"

BAGS = [
    Bad("bag-missing", bags("no/such.bag"), "BagMissing", "pvc://recordings/no/such.bag"),
    Bad("bag-unreadable", bags("bad/text.bag"), "BagUnreadable", "expected b'#ROSBAG V2.0"),
    Bad("bag-empty", bags("bad/empty.bag"), "BagCut", "0 bytes"),
    Bad("bag-cut", bags("bad/cut.bag"), "BagCut", "the file ends at byte 389444"),
    Bad(
        "no-topics",
        {"source": {"topics": ["/camera"]}},
        "NoMatchingTopics",
        "it has /joint_states",
    ),
]
STACKS = [
    Bad("no-image", stack(image="bagpipe.local/none:9"), "StackImageUnavailable", "none:9"),
    Bad("no-command", stack(command=["flyby"]), "CommandNotFound", "flyby"),
    Bad(
        "no-rosmaster",
        stack(
            image="bagpipe.local/operator:0.2.0",
            command=["sleep", "100"],
            ros1={"master": "image"},
        ),
        "RosMasterNotFound",
        "python3-rosmaster",
    ),
    Bad(
        "never-subscribes",
        stack(command=["sleep", "100"]) | {"playback": {"subscribeTimeout": "10s"}},
        "NeverSubscribed",
        "/joint_states",
    ),
]
CRASHES = Bad("crashes", stack(command=["sh", "-c", CRASH]), "StackCrashed", "exit status 3")


@pytest.fixture(scope="module")
def ended(namespace: str) -> Iterator[dict[str, k.Object]]:
    """All bad jobs, run side by side, and how each ended."""
    with ExitStack() as existing:
        for bad in [*BAGS, *STACKS, CRASHES]:
            job = jobs.make_job(bad.name, **bad.changed)
            existing.enter_context(jobs.applied(namespace, job))
        yield {bad.name: jobs.ended(namespace, bad.name, 400) for bad in [*BAGS, *STACKS, CRASHES]}
    jobs.await_none_left(namespace)


@pytest.mark.parametrize("bad", BAGS + STACKS, ids=lambda bad: bad.name)
def test_the_job_fails_with_a_reason_and_a_sentence(
    bad: Bad, ended: dict[str, k.Object], namespace: str
) -> None:
    job = ended[bad.name]
    failed = jobs.condition(job, "Failed")
    assert job["status"]["phase"] == "Failed"
    assert (failed["status"], failed["reason"]) == ("True", bad.reason)
    assert bad.words in failed["message"]

    def is_described() -> bool:
        described = k.kubectl("-n", namespace, "describe", "simjob", bad.name)
        return bad.reason in described.split("Events:")[1]

    k.await_that(f"an Event of {bad.reason}", is_described, 60)  # it comes after the status


def test_a_crash_is_a_finding_with_the_stacks_last_lines(
    ended: dict[str, k.Object], namespace: str
) -> None:
    status = ended[CRASHES.name]["status"]
    assert (status["phase"], status["verdict"]) == ("Complete", "Failed")
    assert (status["cases"]["failed"], status["cases"]["errored"]) == (1, 0)
    assert CRASHES.words in status["failures"][0]["message"]
    _, (row,) = k.results(namespace, status["results"])
    assert (row["outcome"], row["reason"], row["recorded"]) == ("failed", CRASHES.reason, None)
    assert "the laser is on fire" in row["stderr"]


def test_other_cases_go_on_beside_a_cut_bag(namespace: str) -> None:
    job = jobs.make_job("cut-beside-whole", **bags("bad/cut.bag", "pr2/joint_states.bag"))
    with jobs.applied(namespace, job) as name:
        status = jobs.ended(namespace, name, 400)["status"]
        assert (status["cases"]["passed"], status["cases"]["errored"]) == (1, 1)
        (failure,) = status["failures"]
        assert (failure["case"], failure["reason"]) == ("cut", "BagCut")
        manifest, _ = k.results(namespace, status["results"])
        assert {case["case"]: case["outcome"] for case in manifest["cases"]} == {
            "cut": "errored",
            "joint_states-0000": "passed",
        }


def test_a_stack_that_answers_nothing_is_invalid_and_not_passed(namespace: str) -> None:
    # It only counts: a slow listener would lose messages at full speed, which is a failure.
    listens = {"image": "bagpipe.local/ros:0.2.0", "command": ["rostopic", "hz", "/joint_states"]}
    job = jobs.make_job("answers-nothing", playback={"mode": "max"}, **stack(**listens))
    with jobs.applied(namespace, job) as name:
        status = jobs.ended(namespace, name, 400)["status"]
        # First of all the reason, so that another verdict is explained.
        found = [(each["reason"], each["message"]) for each in status["failures"]]
        assert found == [("NothingRecorded", "the stack published nothing on the recorded topics")]
        assert (status["phase"], status["verdict"]) == ("Complete", "Invalid")
        assert status["cases"]["invalid"] == 1
