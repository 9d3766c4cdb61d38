"""What a Workload says of its job, and what its job writes into it, by one state of the two."""

from typing import Any

import pytest

from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.kueue import workload
from bagpipe_operator.jobs.kueue.workload_view import WorkloadView
from bagpipe_operator.jobs.pods.job_config import read_spec
from bagpipe_operator.settings import Settings
from tests.unit.operator.builders import START, make_job

# A condition as type, status, reason and message.
Stated = tuple[str, str, str, str]
SHORT: Stated = ("QuotaReserved", "False", "Pending", "insufficient quota.")
RESERVED: Stated = ("QuotaReserved", "True", "QuotaReserved", "Quota reserved in ClusterQueue lab")
PREEMPTED: Stated = ("Evicted", "True", "Preempted", "for what matters more")
GIVEN_UP: Stated = ("Evicted", "True", "DeactivatedDueToRequeuingLimitExceeded", "too often.")
LONG_AGO = "2026-11-20T03:00:00Z"
NOW = "2026-11-20T04:00:00Z"


def make_workload(*conditions: Stated, deleting: bool = False) -> WorkloadView:
    stated = [
        {"type": type_, "status": status, "reason": reason, "message": message,
         "lastTransitionTime": LONG_AGO}
        for type_, status, reason, message in conditions
    ]  # fmt: skip
    meta: Json = {"name": "w", "namespace": "lanes", "uid": "uid-of-w", "generation": 3}
    if deleting:
        meta["deletionTimestamp"] = NOW
    return WorkloadView.from_object({"metadata": meta, "status": {"conditions": stated}})


def reported(patch: Json) -> list[tuple[str, str, str, str, str]]:
    return [
        (c["type"], c["status"], c["reason"], c["message"], c["lastTransitionTime"])
        for c in patch["conditions"]
    ]


def test_another_release_finds_the_workload_of_the_one_before() -> None:
    """Else an upgrade would put every job into its queue again."""
    job = make_job("x").with_executors(3).view()
    assert workload.name_of(job) == "simulationjob-x-29c8838fae"
    assert workload.made_of(job) == "4b7cf58572c1155f"
    assert workload.made_of(make_job("x").with_executors(4).view()) != workload.made_of(job)
    breathing = make_job("x").with_spec("spark", {"executors": {"min": 1, "max": 3}}).view()
    assert workload.made_of(breathing) != workload.made_of(job)
    orders = [{"executors": 3, "driver": {}}, {"driver": {}, "executors": 3}]
    marks = {workload.made_of(make_job("x").with_spec("spark", each).view()) for each in orders}
    assert len(marks) == 1
    edited = make_job("x").with_executors(3).with_spec("activeDeadline", "1h")
    assert workload.made_of(edited.view()) == workload.made_of(job)


def test_a_queue_is_asked_for_as_many_executors_as_there_may_be() -> None:
    """Kueue gives a job its quota as a whole, before there is a pod."""
    job = make_job("x").with_spec("queueName", "nightly")
    view = job.with_spec("spark.executors", {"min": 1, "max": 5}).view()
    made = workload.manifest(view, read_spec(view), Settings())
    assert [(each["name"], each["count"]) for each in made["spec"]["podSets"]] == [
        ("driver", 1), ("executors", 5),
    ]  # fmt: skip


AGAIN = " again: its Workload was ended or deleted, another follows when it is gone."
FINISHED: Stated = ("Finished", "True", "Succeeded", "or so somebody says")


@pytest.mark.parametrize(
    ("conditions", "why"),
    [
        ([], ", which has not looked at it yet."),
        ([("Finished", "False", "", "")], ", which has not looked at it yet."),
        ([FINISHED, SHORT], AGAIN),
        ([SHORT], ": insufficient quota."),
        ([GIVEN_UP, SHORT],
         ", which has given it up: too often. Delete its Workload to queue it again."),
        # It was given up once, and somebody has activated it again.
        ([("Evicted", "False", *GIVEN_UP[2:]), SHORT], ": insufficient quota."),
        # What it was short of before stays message beside the deactivation.
        ([("Evicted", "True", "Deactivated", "it is deactivated"), SHORT], ": it is deactivated."),
        ([("Evicted", "True", "Deactivated", ""), SHORT], ": insufficient quota."),
        ([("Evicted", "False", "Deactivated", "it was"), SHORT], ": insufficient quota."),
        ([PREEMPTED, RESERVED], ": for what matters more."),
        ([PREEMPTED, (*SHORT[:3], "")], ": for what matters more."),
        ([("Evicted", "False", "Preempted", "it was"), RESERVED],
         ": it has its quota, and the queue's admission checks are not done."),
        ([("Evicted", "False", "Preempted", "it was")], ", which has not looked at it yet."),
    ],
)  # fmt: skip
def test_why_a_job_waits_is_what_kueue_wrote_last(conditions: list[Stated], why: str) -> None:
    message = workload.waits_for(make_workload(*conditions), "nightly")
    assert message == f"The job waits in the queue nightly of Kueue{why}"


def test_a_job_whose_workload_is_being_deleted_waits_for_another() -> None:
    message = workload.waits_for(make_workload(RESERVED, deleting=True), "nightly")
    assert message == f"The job waits in the queue nightly of Kueue{AGAIN}"


@pytest.mark.parametrize(
    ("conditions", "must_be"),
    [([PREEMPTED, RESERVED], True), ([PREEMPTED, SHORT], False), ([RESERVED], False), ([], False)],
)
def test_what_was_evicted_and_has_its_quota_gives_it_back(
    conditions: list[Stated], must_be: bool
) -> None:
    assert workload.must_be_released(make_workload(*conditions)) is must_be


@pytest.mark.parametrize(
    ("reason", "requeued"),
    [("Preempted", "True"), ("NodeFailures", "True"), ("PodsReadyTimeout", "False")],
)
def test_quota_is_given_back_with_the_eviction_s_own_words(reason: str, requeued: str) -> None:
    why = "for what matters more"
    other: Stated = ("Other", "True", "Other", "somebody else's")
    ready: Stated = ("PodsReady", "False", "Old", "old")
    patch = workload.released(
        make_workload(other, ("Evicted", "True", reason, why), RESERVED, ready), START
    )
    assert reported(patch) == [
        (*other, LONG_AGO),
        ("Evicted", "True", reason, why, LONG_AGO),
        ("QuotaReserved", "False", "Pending", why, NOW),
        ("Admitted", "False", "NoReservation", "The workload has no reservation", NOW),
        ("Requeued", requeued, reason, why, NOW),
        ("PodsReady", "False", "WaitForStart", "The job's pods are gone.", LONG_AGO),
    ]
    assert patch["admission"] is None
    assert {c["observedGeneration"] for c in patch["conditions"][2:]} == {3}


def test_pods_that_run_are_reported_beside_kueue_s_conditions() -> None:
    assert reported(workload.ready(make_workload(RESERVED), START)) == [
        (*RESERVED, LONG_AGO),
        ("PodsReady", "True", "Started", "The job's cases run.", NOW),
    ]


def ends(**statuses: str) -> list[dict[str, Any]]:
    return [
        {"type": type_, "status": status, "reason": "R", "message": f"{type_} is {status}."}
        for type_, status in statuses.items()
    ]


@pytest.mark.parametrize(
    ("conditions", "reason", "message"),
    [
        (ends(Complete="False", Failed="True"), "Failed", "Failed is True."),
        (ends(Complete="True", Failed="False"), "Succeeded", "Complete is True."),
        (ends(Complete="True"), "Succeeded", "Complete is True."),
        (None, "Succeeded", "The job has ended."),
    ],
)
def test_an_ended_job_s_workload_is_finished_with_the_job_s_words(
    conditions: list[dict[str, Any]] | None, reason: str, message: str
) -> None:
    job = make_job("x").with_status(conditions=conditions).view()
    patch = workload.finished(make_workload(RESERVED), job, START)
    assert reported(patch) == [(*RESERVED, LONG_AGO), ("Finished", "True", reason, message, NOW)]
