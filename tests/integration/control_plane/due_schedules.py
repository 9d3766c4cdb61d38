"""Schedules for tests, and how one of them gets a run that is due at once."""

from datetime import UTC, datetime, timedelta
from typing import Any

from tests.integration.control_plane.client import JOBS, Client, Object
from tests.unit.operator.builders import make_job


def schedules(namespace: str, name: str = "") -> str:
    """The path of a namespace's schedules, or of one of them."""
    below = f"{JOBS}/namespaces/{namespace}/simulationschedules"
    return f"{below}/{name}" if name else below


def a_schedule(name: str = "nightly", **spec: Any) -> Object:
    """At 02:30 in Berlin, with fields of its spec changed."""
    template = {"metadata": {"labels": {"team": "lanes"}}, "spec": make_job("x").object["spec"]}
    timed = {"schedule": "30 2 * * *", "timeZone": "Europe/Berlin", "jobTemplate": template}
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationSchedule",
        "metadata": {"name": name},
        "spec": timed | spec,
    }


def due_once() -> Object:
    """Once a day, two minutes ago: with the last run an hour ago exactly one is due."""
    run = datetime.now(UTC) - timedelta(minutes=2)
    return {"schedule": f"{run.minute} {run.hour} * * *", "timeZone": "Etc/UTC"}


def set_last_run(admin: Client, namespace: str, name: str) -> None:
    """Says in the schedule's status that its last run was an hour ago."""
    before = (datetime.now(UTC) - timedelta(hours=1)).strftime("%Y-%m-%dT%H:%M:%SZ")
    admin.merge(schedules(namespace, name) + "/status", {"status": {"lastScheduleTime": before}})


def start_run(admin: Client, namespace: str, name: str) -> None:
    """Creates a schedule with one run that is due, also while operators look."""
    admin.create(schedules(namespace), a_schedule(name, suspend=True, **due_once()))
    set_last_run(admin, namespace, name)
    admin.merge(schedules(namespace, name), {"spec": {"suspend": False}})
