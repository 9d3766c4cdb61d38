"""The status of a job: whole sequences of states, with a clock that only the test moves."""

from collections.abc import Callable, Iterable
from dataclasses import replace

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.driver.ending import Ending, ending_of
from bagpipe_operator.jobs.driver.progress import parse
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.observation import Observation
from bagpipe_operator.jobs.pod_view import PodView
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.status import decide
from bagpipe_operator.jobs.troubles.diagnose import troubles
from tests.unit.operator.builders import START, Clock, account, make_driver, make_executor, make_job

STUCK_SECONDS = 30.0


def observed(
    job: JobView, driver: PodView | None = None, says: str = "", pods: Iterable[PodView] = ()
) -> Observation:
    executors = tuple(pods)
    everything = ((driver,) if driver else ()) + executors
    return Observation(
        job=job,
        attempt=1,
        driver=driver,
        executors=executors,
        progress=parse(says) if says else None,
        troubles=tuple(troubles(everything, START)),
        ending=ending_of(driver, START) if driver else None,
    )


def condition(status: Json, type_: str) -> tuple[str, str]:
    found = next(c for c in status["conditions"] if c["type"] == type_)
    return found["status"], found["reason"]


def true_conditions(status: Json) -> list[str]:
    return [c["type"] for c in status["conditions"] if c["status"] == "True"]


def run(steps: Iterable[Callable[[JobView], Observation]]) -> list[Json]:
    """The statuses of a job that is observed so, ten seconds apart."""
    clock, job = Clock(), make_job("x").view()
    written: list[Json] = []
    for step in steps:
        status = decide(step(job), clock.now(), STUCK_SECONDS)
        written.append(status)
        job = replace(job, status=status)
        clock.advance(10)
    return written


def test_a_good_job_from_creation_to_its_end() -> None:
    planning = account("Planning", cases={}, ledger={})
    done = account("Complete", verdict="Passed", cases={"planned": 4, "passed": 4})
    executor = make_executor("x").running().view()
    waiting = account(cases={"planned": 4})
    written = run(
        [
            observed,
            lambda job: observed(job, make_driver("x").view()),
            lambda job: observed(job, make_driver("x").running().view()),
            lambda job: observed(job, make_driver("x").running().view(), planning),
            lambda job: observed(job, make_driver("x").running().view(), waiting),
            lambda job: observed(job, make_driver("x").running().view(), account(), [executor]),
            lambda job: observed(job, make_driver("x").ended(0, done).view()),
        ]
    )
    assert [s["phase"] for s in written] == [
        "Pending", "Pending", "Planning", "Planning", "Running", "Running", "Complete",
    ]  # fmt: skip
    assert [true_conditions(s) for s in written] == [
        [],
        ["Accepted"],
        ["Accepted"],
        ["Accepted"],
        ["Accepted", "Planned"],
        ["Accepted", "Planned", "Running"],
        ["Accepted", "Planned", "Complete", "Passed"],
    ]
    assert [condition(s, "Running")[1] for s in written] == [
        "DriverPending", "DriverPending", "Planning", "Planning", "ExecutorsPending",
        "CasesRunning", "JobFinished",
    ]  # fmt: skip
    assert [condition(s, "Passed") for s in written] == [
        *[("Unknown", "NotEnded")] * 6, ("True", "Passed"),
    ]  # fmt: skip
    assert {s["observedGeneration"] for s in written} == {1}
    assert {s["startTime"] for s in written} == {"2026-11-20T04:00:00Z"}
    last = written[-1]
    assert last["completionTime"] == "2026-11-20T04:01:00Z"
    assert last["verdict"] == "Passed"
    assert last["cases"] == {
        "planned": 4, "running": 0, "passed": 4, "failed": 0, "invalid": 0, "errored": 0,
        "crashed": 0,
        "lost": 0,
        "regressed": 0,
        "quarantined": 0,
        "discarded": 0,
    }  # fmt: skip
    assert last["ledger"] == {"sent": 400, "received": 400, "dropped": 0, "leadIn": 8}
    assert last["driver"] == "x-1-driver"


def test_transition_times_move_only_with_the_status() -> None:
    running = make_driver("x").running().view()
    written = run(
        [
            lambda job: observed(job, running),
            lambda job: observed(job, running, account()),
            lambda job: observed(job, running, account(cases={"planned": 4, "passed": 3})),
        ]
    )
    times = [
        {c["type"]: c["lastTransitionTime"][-3:-1] for c in status["conditions"]}
        for status in written
    ]
    assert [t["Accepted"] for t in times] == ["00", "00", "00"]
    assert [t["Running"] for t in times] == ["00", "10", "10"]


def test_nothing_new_is_nothing_to_write() -> None:
    driver = make_driver("x").running().view()
    first, second = run([lambda job: observed(job, driver, account())] * 2)
    assert first == second


def test_a_restarted_operator_keeps_what_it_can_not_see_yet() -> None:
    running = make_driver("x").running().view()
    _, blind, unanswered = run(
        [
            lambda job: observed(job, running, account()),
            observed,
            lambda job: observed(job, running),
        ]
    )
    assert [blind["phase"], unanswered["phase"]] == ["Running", "Running"]
    assert blind["cases"]["planned"] == unanswered["cases"]["planned"] == 4
    assert condition(unanswered, "Planned") == ("True", "CasesPlanned")
    assert (
        condition(blind, "Running")
        == condition(unanswered, "Running")
        == (
            "True",
            "CasesRunning",
        )
    )


def stuck(job: JobView, seconds: float) -> Observation:
    executor = make_executor("x").waiting("stack", "ImagePullBackOff", "Back-off").view()
    seen = observed(job, make_driver("x").running().view(), account(), [executor])
    return replace(seen, seen_for={seen.troubles[0].key: seconds})


# Promise: lasting-trouble-ends
def test_a_stuck_image_is_reported_at_once_and_ends_the_job_at_the_bound() -> None:
    written = run([lambda job, s=s: stuck(job, s) for s in (0.0, 29.9, 30.0)])  # type: ignore[misc]
    assert [condition(s, "Running") for s in written] == [
        ("False", "StackImageUnavailable"),
        ("False", "StackImageUnavailable"),
        ("False", "JobFinished"),
    ]
    assert [condition(s, "Failed") for s in written] == [
        ("False", "InProgress"),
        ("False", "InProgress"),
        ("True", "StackImageUnavailable"),
    ]
    message = next(c["message"] for c in written[-1]["conditions"] if c["type"] == "Failed")
    assert message == (
        "Image example/lane:1 of container stack in pod x-1-exec-1 can't be had "
        "(ImagePullBackOff): Back-off. Correct spec.stack.image or make it pullable, and create "
        "the job again. The job was ended after 30 s of this."
    )
    assert [s["cases"]["running"] for s in written] == [2, 2, 0]
    assert condition(written[-1], "Complete") == ("False", "JobFailed")


def test_a_pod_without_a_node_is_reported_and_never_ends_the_job() -> None:
    def waiting(job: JobView) -> Observation:
        driver = make_driver("x").unschedulable("0/1 nodes are available: Insufficient cpu").view()
        seen = observed(job, driver)
        return replace(seen, seen_for={seen.troubles[0].key: 86400.0})

    (status,) = run([waiting])
    assert (status["phase"], condition(status, "Running")) == (
        "Pending",
        ("False", "Unschedulable"),
    )


def test_one_executor_in_trouble_beside_one_that_runs() -> None:
    pods = [
        make_executor("x", 1).running().view(),
        make_executor("x", 2).unschedulable("Insufficient memory").view(),
    ]
    (status,) = run([lambda job: observed(job, make_driver("x").running().view(), account(), pods)])
    running = next(c for c in status["conditions"] if c["type"] == "Running")
    assert (running["status"], running["reason"]) == ("True", "Unschedulable")
    assert running["message"] == (
        "Cases are running. Pod x-1-exec-2 has no node yet: Insufficient memory. "
        "It starts as soon as a node has room."
    )


def test_a_refusal_is_reported_and_ends_the_job_at_the_bound() -> None:
    refusal = Refusal("ServiceAccountMissing", "There is no ServiceAccount.")

    def refused(job: JobView, seconds: float) -> Observation:
        return replace(observed(job), refusal=refusal, refused_for=seconds)

    reported, ended = run([lambda job: refused(job, 0), lambda job: refused(job, 30)])
    assert (reported["phase"], condition(reported, "Accepted")) == (
        "Pending",
        ("False", "ServiceAccountMissing"),
    )
    assert (ended["phase"], condition(ended, "Failed")) == (
        "Failed",
        ("True", "ServiceAccountMissing"),
    )
    assert ended["completionTime"] == "2026-11-20T04:00:10Z"


def test_a_quota_never_ends_a_job() -> None:
    refusal = Refusal("QuotaExceeded", "No room.", lasting=False)
    (status,) = run([lambda job: replace(observed(job), refusal=refusal, refused_for=9999)])
    assert (status["phase"], condition(status, "Accepted")) == (
        "Pending",
        ("False", "QuotaExceeded"),
    )


def test_a_spec_that_can_not_be_run_is_failed_at_once() -> None:
    ending = Ending(False, "SpecInvalid", "spec.stack.parameters: write /a")
    (status,) = run([lambda job: replace(observed(job), ending=ending)])
    assert (condition(status, "Accepted"), condition(status, "Failed")) == (
        ("False", "SpecInvalid"),
        ("True", "SpecInvalid"),
    )
    assert "driver" not in status


def test_exactly_one_end_with_its_time() -> None:
    for code, phase in ((0, "Complete"), (1, "Failed")):
        end = make_driver("x").ended(code, account(phase)).view()
        (status,) = run([lambda job, end=end: observed(job, end)])  # type: ignore[misc]
        ends = {t: condition(status, t)[0] for t in ("Complete", "Failed")}
        assert ends == {phase: "True"} | {t: "False" for t in ends if t != phase}
        assert (status["phase"], status["completionTime"]) == (phase, "2026-11-20T04:00:00Z")
