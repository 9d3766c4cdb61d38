"""Which transitions are reported, and how an Event looks."""

from bagpipe_operator.api import conditions
from bagpipe_operator.api.conditions import Condition
from bagpipe_operator.api.objects import Json
from bagpipe_operator.cluster.events import Note
from bagpipe_operator.jobs.transitions import manifest, transitions
from tests.unit.operator.builders import START, make_job


def state(type_: str, true: bool, reason: str) -> Json:
    return conditions.merged([], [Condition(type_, true, reason, "Why.")], 1, START)[0]


def test_only_what_changed_is_reported() -> None:
    accepted = state("Accepted", True, "DriverCreated")
    assert transitions([accepted], [accepted]) == []
    assert transitions([], [accepted]) == [Note("Normal", "DriverCreated", "Why.")]


def test_a_changed_message_alone_is_not_reported() -> None:
    before = state("Running", True, "CasesRunning")
    assert transitions([before], [before | {"message": "Another."}]) == []


def test_troubles_and_failures_are_warnings_and_waiting_is_silent() -> None:
    reported = transitions(
        [],
        [
            state("Accepted", False, "ServiceAccountMissing"),
            state("Planned", False, "Planning"),
            state("Running", False, "Unschedulable"),
            state("Complete", False, "InProgress"),
            state("Failed", True, "DriverLost"),
        ],
    )
    assert [(n.type, n.reason) for n in reported] == [
        ("Warning", "ServiceAccountMissing"),
        ("Warning", "Unschedulable"),
        ("Warning", "DriverLost"),
    ]
    assert transitions([], [state("Running", False, "DriverPending")]) == []


def test_one_reason_is_reported_once_in_a_write() -> None:
    reported = transitions(
        [], [state("Accepted", False, "SpecInvalid"), state("Failed", True, "SpecInvalid")]
    )
    assert [n.reason for n in reported] == ["SpecInvalid"]


def test_the_event_points_at_its_job() -> None:
    event = manifest(make_job("x").view(), Note("Normal", "CasesRunning", "m" * 2000), START)
    assert event["metadata"]["namespace"] == "lanes"
    assert event["metadata"]["name"].startswith("x.")
    assert event["involvedObject"] == {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "namespace": "lanes",
        "name": "x",
        "uid": "uid-of-x",
        "resourceVersion": "7",
    }
    assert len(event["message"]) == 1024
    assert event["firstTimestamp"] == "2026-11-20T04:00:00Z"
