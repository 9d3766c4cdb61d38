"""One observation, and the whole of what the status says of it."""

from dataclasses import replace
from datetime import timedelta
from typing import Any

import pytest

from bagpipe_operator.api.conditions import timestamp
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.driver.ending import Ending
from bagpipe_operator.jobs.driver.progress import parse
from bagpipe_operator.jobs.observation import Halt, Observation
from bagpipe_operator.jobs.pods.refusal import Refusal
from bagpipe_operator.jobs.policies.stuck import fatal
from bagpipe_operator.jobs.status import acknowledged, decide
from bagpipe_operator.jobs.troubles.trouble import Trouble
from tests.unit.operator.builders import START, account, make_driver, make_executor, make_job

SUSPENDED = Halt("JobSuspended", "spec.suspend is true: set it to false to go on.")
LATE = Halt("DeadlineExceeded", "The job ran for too long.", final=True)
LOST = Ending(False, "DriverLost", "The pod was deleted.", advice="Do it again.", lost=True)
KEPT = "cases that are done are not run again."
UNCOUNTED = "Another driver takes over, which does not count against spec.backoffLimit,"
TAKEN = replace(LOST, reason="DriverEvicted", voluntary=True)


def made(type_: str, status: str, reason: str, message: str = "M.") -> Json:
    return {
        "type": type_,
        "status": status,
        "reason": reason,
        "message": message,
        "observedGeneration": 1,
        "lastTransitionTime": "2026-11-20T03:00:00Z",
    }


def seen(status: dict[str, Any] | None = None, **more: Any) -> Observation:
    job = make_job("x").with_status(**(status or {})).view()
    return replace(Observation(job, attempt=1), **more)


def decided(observation: Observation, seconds: float = 0.0) -> Json:
    return decide(observation, START + timedelta(seconds=seconds), 30.0)


def found(status: Json, type_: str) -> tuple[str, str, str]:
    each = next(c for c in status["conditions"] if c["type"] == type_)
    return each["status"], each["reason"], each["message"]


def test_a_suspended_job_s_pods_are_being_stopped_as_long_as_there_are_any() -> None:
    driver = make_driver("x").running().view()
    stopping = decided(
        seen({"phase": "Running", "startTime": timestamp(START)}, driver=driver, alive=(driver,),
             halt=SUSPENDED, progress=parse(account()))
    )  # fmt: skip
    message = f"{SUSPENDED.message} 1 pod is being stopped; what is done is kept."
    assert found(stopping, "Suspended") == ("False", "Suspending", message)
    assert found(stopping, "Running") == ("False", "Suspending", message)
    assert found(stopping, "Accepted")[:2] == ("True", "DriverCreated")
    assert found(stopping, "Planned")[:2] == ("False", "Planning")
    assert [found(stopping, each)[1] for each in ("Complete", "Failed", "Passed")] == [
        "InProgress", "InProgress", "NotEnded",
    ]  # fmt: skip
    assert (stopping["phase"], stopping["attempt"], stopping["driver"]) == (
        "Running", 1, "x-1-driver",
    )  # fmt: skip
    assert stopping["cases"]["running"] == 2


def test_without_pods_a_suspended_job_has_no_clock_and_its_next_driver_another_number() -> None:
    before = {
        "driver": "x-1-driver",
        "startTime": timestamp(START),
        "firstCaseTime": timestamp(START),
        "nextAttemptTime": timestamp(START),
        "cases": {"planned": 4, "running": 2},
        "conditions": [made("Planned", "True", "CasesPlanned")],
    }
    resting = decided(seen(before, halt=SUSPENDED, ending=LOST))
    assert (resting["phase"], resting["attempt"], resting["driver"]) == ("Suspended", 2, "")
    assert resting["lostDrivers"] == 0
    assert resting["cases"] == {"planned": 4, "running": 0}
    assert not {"startTime", "firstCaseTime", "nextAttemptTime"} & set(resting)
    assert found(resting, "Suspended") == (
        "True", "JobSuspended", f"No pod holds a place. {SUSPENDED.message}",
    )  # fmt: skip
    for type_ in ("Accepted", "Running"):
        assert found(resting, type_) == ("False", "JobSuspended", SUSPENDED.message)
    assert found(resting, "Planned") == (
        "True", "CasesPlanned", "The job consists of 4 cases.",
    )  # fmt: skip
    never = decided(seen(halt=SUSPENDED))
    assert (never["phase"], never["attempt"], never["cases"]) == ("Suspended", 1, {"running": 0})


def test_a_late_job_fails_when_its_pods_are_gone_with_its_driver_s_last_account() -> None:
    driver = make_driver("x").running().view()
    pods = (driver, make_executor("x").running().view())
    stopping = decided(seen(driver=driver, alive=pods, halt=LATE))
    message = f"{LATE.message} 2 pods are being stopped; what is done is kept."
    assert found(stopping, "Running") == ("False", "DeadlineExceeded", message)
    assert found(stopping, "Suspended")[:2] == ("False", "NotSuspended")
    ended = decided(seen(halt=LATE, ending=replace(LOST, progress=parse(account()))))
    assert found(ended, "Failed") == ("True", "DeadlineExceeded", LATE.message)
    assert found(ended, "Passed") == ("False", "DeadlineExceeded", LATE.message)
    assert found(ended, "Planned")[2] == "The job consists of 4 cases."
    assert (ended["phase"], ended["cases"]["running"]) == ("Failed", 0)


def test_an_end_of_its_own_outweighs_a_halt() -> None:
    account_of_it = parse(account("Complete", verdict="Passed"))
    done = Ending(True, "AllCasesPassed", "4 of 4 cases passed.", account_of_it)
    for halt in (SUSPENDED, LATE):
        ended = decided(seen(halt=halt, ending=done))
        assert found(ended, "Complete") == ("True", "AllCasesPassed", "4 of 4 cases passed.")
        assert found(ended, "Failed") == ("False", "JobComplete", "The job completed.")
        assert found(ended, "Passed") == ("True", "Passed", "4 of 4 cases passed.")


def test_a_lost_driver_is_replaced_after_a_pause_that_is_reported() -> None:
    before = {"driver": "x-2-driver", "lostDrivers": 1, "cases": {"planned": 4, "running": 2}}
    status = decided(seen(before, attempt=2, ending=LOST, backoff_limit=3))
    assert (status["attempt"], status["lostDrivers"], status["driver"]) == (3, 2, "")
    assert (status["phase"], status["cases"]) == ("Pending", {"planned": 4, "running": 0})
    assert status["nextAttemptTime"] == "2026-11-20T04:00:20Z"
    assert found(status, "Running") == (
        "False", "DriverLost",
        f"{LOST.message} Driver 3 of at most 4 takes over in 20 s; {KEPT}",
    )  # fmt: skip
    assert found(status, "Accepted") == ("False", "InProgress", "The next driver is created.")
    assert found(status, "Planned")[:2] == ("False", "Planning")
    assert found(status, "Suspended")[:2] == ("False", "NotSuspended")


def test_one_that_was_taken_for_another_s_sake_is_not_counted_and_waits_by_its_attempt() -> None:
    status = decided(seen({"lostDrivers": 1}, attempt=4, ending=TAKEN, backoff_limit=1))
    assert (status["attempt"], status["lostDrivers"]) == (5, 1)
    assert status["nextAttemptTime"] == "2026-11-20T04:01:20Z"
    assert found(status, "Running") == (
        "False", "DriverEvicted",
        f"{LOST.message} {UNCOUNTED} in 80 s; {KEPT}",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("lost", "phase"), [(0, "Pending"), (1, "Pending"), (2, "Failed"), (3, "Failed")]
)
def test_after_so_many_lost_drivers_the_job_fails(lost: int, phase: str) -> None:
    status = decided(seen({"lostDrivers": lost}, ending=LOST, backoff_limit=2))
    assert status["phase"] == phase
    if phase == "Failed":
        assert found(status, "Failed") == (
            "True", "DriverLost", "The pod was deleted. Do it again.",
        )  # fmt: skip
        assert found(status, "Complete") == (
            "False", "JobFailed", "The job failed: see the condition Failed.",
        )  # fmt: skip


def test_between_two_drivers_the_condition_stays_until_the_pause_is_over() -> None:
    before = {
        "phase": "Pending",
        "nextAttemptTime": "2026-11-20T04:00:20Z",
        "conditions": [made("Running", "False", "DriverLost")],
    }
    waiting = decided(seen(before, attempt=2))
    assert waiting["conditions"] == before["conditions"]
    assert "startTime" not in waiting
    over = decided(seen(before, attempt=2), 20.0)
    assert found(over, "Running") == ("False", "DriverLost", "M.")
    assert (over["startTime"], over["nextAttemptTime"]) == (
        "2026-11-20T04:00:20Z", "2026-11-20T04:00:20Z",
    )  # fmt: skip
    created = decided(seen(before, attempt=2, driver=make_driver("x", 2).view()), 20.0)
    assert "nextAttemptTime" not in created
    running = decided(
        seen(before, attempt=2, driver=make_driver("x", 2).running().view(),
             progress=parse(account(cases={"planned": 4}))), 20.0,
    )  # fmt: skip
    assert found(running, "Running")[1] == "ExecutorsPending"


def test_no_job_ends_before_it_began_whatever_the_clocks_say() -> None:
    failed = Ending(False, "BagUnreadable", "It ends.")
    ahead = decided(seen({"startTime": "2026-11-20T05:00:00Z"}, ending=failed))
    assert ahead["completionTime"] == ahead["startTime"] == "2026-11-20T05:00:00Z"
    after = decided(seen({"startTime": "2026-11-20T03:00:00Z"}, ending=failed))
    assert after["completionTime"] == "2026-11-20T04:00:00Z"


@pytest.mark.parametrize(
    ("before", "kueue", "reason", "message"),
    [
        (None, False, "NotSuspended", "spec.suspend is not true."),
        (("False", "NotSuspended"), True, "NotSuspended", "spec.suspend is not true."),
        (("True", "JobSuspended"), True, "JobResumed",
         "The job was resumed: cases that are done are not run again."),
        (("False", "JobResumed"), False, "JobResumed",
         "The job was resumed: cases that are done are not run again."),
        (("True", "Queued"), True, "Admitted", "Kueue has admitted the job."),
        (("False", "Admitted"), True, "Admitted", "Kueue has admitted the job."),
        (("False", "Admitted"), False, "NotSuspended", "spec.suspend is not true."),
    ],
)  # fmt: skip
def test_how_a_job_comes_not_to_be_suspended(
    before: tuple[str, str] | None, kueue: bool, reason: str, message: str
) -> None:
    conditions = [made("Suspended", *before)] if before else []
    status = decided(seen({"conditions": conditions}, kueue=kueue))
    assert found(status, "Suspended") == ("False", reason, message)


def test_the_end_of_a_job_that_needs_a_person_is_the_first_lasting_trouble_s() -> None:
    passing = Trouble("Unschedulable", "a", "No room.", lasting=False)
    short = Trouble("SecretMissing", "b", "No secret.")
    long = Trouble("StackImageUnavailable", "c", "No image.")
    unseen = Trouble("VolumeMissing", "d", "No claim.")
    observation = seen(
        troubles=(passing, unseen, short, long),
        seen_for={passing.key: 90.0, short.key: 29.9, long.key: 30.0},
    )
    assert fatal(observation, 30.0) == long
    assert fatal(replace(observation, seen_for={}), 30.0) is None
    assert fatal(observation, 29.0) == short
    status = decided(observation)
    assert found(status, "Failed") == (
        "True", "StackImageUnavailable", "No image. The job was ended after 30 s of this.",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("lasting", "seconds", "phase"),
    [
        (True, 29.9, "Pending"),
        (True, 30.0, "Failed"),
        (True, 31.0, "Failed"),
        (False, 90.0, "Pending"),
    ],
)
def test_a_refusal_ends_a_job_when_it_lasts(lasting: bool, seconds: float, phase: str) -> None:
    refusal = Refusal("SpecRefused", "It is refused.", lasting=lasting)
    status = decided(seen(refusal=refusal, refused_for=seconds))
    assert status["phase"] == phase
    assert found(status, "Accepted") == ("False", "SpecRefused", "It is refused.")


@pytest.mark.parametrize(
    ("phase", "progress", "driver", "executors", "word", "running"),
    [
        ("", None, None, (), "Pending", ("False", "DriverPending")),
        ("Suspended", None, None, (), "Pending", ("False", "DriverPending")),
        ("Running", None, "pending", (), "Pending", ("False", "DriverPending")),
        ("Pending", None, "running", (), "Planning", ("False", "Planning")),
        ("Running", None, "running", (), "Running", ("False", "ExecutorsPending")),
        ("Running", "Planning", "running", (), "Planning", ("False", "Planning")),
        ("Pending", "Running", "running", (), "Running", ("True", "CasesRunning")),
        ("Running", None, "running", ("x",), "Running", ("True", "CasesRunning")),
        ("Pending", None, "running", ("x",), "Planning", ("False", "Planning")),
    ],
)
def test_the_phase_and_whether_cases_run(
    phase: str,
    progress: str | None,
    driver: str | None,
    executors: tuple[str, ...],
    word: str,
    running: tuple[str, str],
) -> None:
    pod = make_driver("x").running() if driver == "running" else make_driver("x")
    status = decided(
        seen(
            {"phase": phase},
            progress=parse(account(progress)) if progress else None,
            driver=pod.view() if driver else None,
            executors=tuple(make_executor(name).running().view() for name in executors),
        )
    )
    assert status["phase"] == word
    assert found(status, "Running")[:2] == running


def test_what_a_driver_warns_of_is_reported_with_the_cases_that_run() -> None:
    driver = make_driver("x").running().view()
    runs: dict[str, Any] = {
        "driver": driver,
        "executors": (make_executor("x").running().view(),),
    }
    warned = parse(account(warning="Two executors share a disk."))
    trouble = Trouble("Unschedulable", "a", "No room.", lasting=False)
    assert found(decided(seen(progress=warned, **runs)), "Running") == (
        "True", "CasesRunning", "Cases are running. Two executors share a disk.",
    )  # fmt: skip
    assert found(decided(seen(progress=warned, troubles=(trouble,), **runs)), "Running") == (
        "True", "Unschedulable", "Cases are running. No room. Two executors share a disk.",
    )  # fmt: skip
    plans = parse(account("Planning", message="Reading 3 of 9 bags.", cases={}))
    assert found(decided(seen(progress=plans, driver=driver)), "Running") == (
        "False", "Planning", "Reading 3 of 9 bags.",
    )  # fmt: skip


def test_the_first_case_s_time_is_when_it_was_first_seen() -> None:
    unbegun = decided(seen(progress=parse(account(cases={"planned": 4}))))
    assert "firstCaseTime" not in unbegun
    begun = decided(seen(progress=parse(account())), 5.0)
    assert begun["firstCaseTime"] == "2026-11-20T04:00:05Z"
    kept = decided(seen({"firstCaseTime": timestamp(START)}, progress=parse(account())), 5.0)
    assert kept["firstCaseTime"] == "2026-11-20T04:00:00Z"


def test_whose_results_a_job_goes_on_from_is_reported_from_then_on() -> None:
    earlier = {"name": "x-before", "uid": "uid-of-x-before"}
    assert decided(seen(resumed_from=earlier))["resumedFrom"] == earlier
    assert decided(seen({"resumedFrom": earlier}))["resumedFrom"] == earlier
    assert "resumedFrom" not in decided(seen())


def test_a_verdict_is_that_of_a_job_s_good_end() -> None:
    taken_back = decided(seen({"verdict": "Passed"}, progress=parse(account())))
    assert "verdict" not in taken_back
    assert "verdict" not in decided(seen({"verdict": "Passed"}))
    assert "verdict" not in decided(seen(progress=parse(account("Complete", verdict="Passed"))))
    assert "verdict" not in decided(seen({"verdict": "Passed"}, halt=SUSPENDED, ending=LOST))
    done = parse(account("Complete", verdict="Failed", verdictReason="TooManyLost"))
    ended = decided(seen(ending=Ending(True, "JobComplete", "It ran.", done)))
    assert ended["verdict"] == "Failed"


def test_an_ended_job_that_was_edited_is_acknowledged_and_nothing_else() -> None:
    conditions = [made("Complete", "True", "JobComplete"), made("Passed", "True", "Passed")]
    job = make_job("x").with_status(conditions=conditions, observedGeneration=1, phase="Complete")
    assert acknowledged(job.view()) == job.view().status
    edited = replace(job.view(), generation=2)
    status = acknowledged(edited)
    assert (status["phase"], status["observedGeneration"]) == ("Complete", 2)
    assert [c["observedGeneration"] for c in status["conditions"]] == [2, 2]
    assert [c["lastTransitionTime"] for c in status["conditions"]] == ["2026-11-20T03:00:00Z"] * 2
