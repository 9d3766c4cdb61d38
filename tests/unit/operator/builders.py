"""Jobs and pods as the API server sends them, built fluently: make_job("x").with_executors(2)."""

from __future__ import annotations

import copy
import json
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from typing import Any, Self

from bagpipe_operator.api import names
from bagpipe_operator.api.objects import Json
from bagpipe_operator.jobs.job_view import JobView
from bagpipe_operator.jobs.pod_view import PodView

START = datetime(2026, 11, 20, 4, 0, 0, tzinfo=UTC)


class Clock:
    """A wall clock and a monotonic one that move together, and only when the test moves them."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def advance(self, seconds: float) -> None:
        self.seconds += seconds

    def now(self) -> datetime:
        return START + timedelta(seconds=self.seconds)

    def monotonic(self) -> float:
        return 1000.0 + self.seconds


def account(phase: str = "Running", **changes: Any) -> str:
    """A driver's account as JSON; cases and ledger are given as whole maps."""
    document: Json = {
        "phase": phase,
        "reason": "",
        "message": "",
        "cases": {"planned": 4, "running": 2, "passed": 1},
        "ledger": {"sent": 400, "received": 400, "dropped": 0, "leadIn": 8},
        "verdict": "",
        "results": "pvc://results/lane/x",
        "failures": [],
    }
    return json.dumps(document | changes)


@dataclass
class JobBuilder:
    object: Json

    def with_spec(self, path: str, value: Any) -> Self:
        *parents, last = path.split(".")
        place = self.object["spec"]
        for name in parents:
            place = place.setdefault(name, {})
        place[last] = value
        return self

    def with_executors(self, count: int) -> Self:
        return self.with_spec("spark.executors", count)

    def with_status(self, **status: Any) -> Self:
        self.object.setdefault("status", {}).update(status)
        return self

    def deleting(self) -> Self:
        self.object["metadata"]["deletionTimestamp"] = "2026-11-20T04:00:00Z"
        return self

    def view(self) -> JobView:
        return JobView.from_object(copy.deepcopy(self.object))

    def as_written(self, **metadata: Any) -> Json:
        """Without what the API server sets."""
        return self.object | {"metadata": {"name": self.object["metadata"]["name"], **metadata}}


def make_job(name: str) -> JobBuilder:
    return JobBuilder(
        {
            "apiVersion": names.API_VERSION,
            "kind": names.KIND,
            "metadata": {
                "name": name,
                "namespace": "lanes",
                "uid": f"uid-of-{name}",
                "generation": 1,
                "resourceVersion": "7",
            },
            "spec": {
                "source": {"bags": ["pvc://recordings/drive.bag"], "topics": ["/image"]},
                "stack": {"image": "example/lane:1", "command": ["roslaunch", "lane"]},
                "record": {"topics": ["/tf"]},
                "output": {"uri": "pvc://results/lane"},
            },
        }
    )


@dataclass
class PodBuilder:
    name: str
    job: str
    role: str
    phase: str = "Pending"
    status: Json = field(default_factory=dict)
    inits: list[Json] = field(default_factory=list)
    mains: list[Json] = field(default_factory=list)
    gone_by: str = ""
    attempt: int = 1
    node: str = ""
    claims: tuple[str, ...] = ()

    def running(self, ip: str = "10.0.0.5") -> Self:
        self.phase = "Running"
        self.status["podIP"] = ip
        main = names.CONTAINER_DRIVER if self.role == names.ROLE_DRIVER else names.CONTAINER_SPARK
        return self.with_container(main, {"running": {}})

    def ended(self, code: int, message: str = "", reason: str = "") -> Self:
        self.phase = "Failed" if code else "Succeeded"
        state: Json = {"exitCode": code, "reason": reason or ("Error" if code else "Completed")}
        if message:
            state["message"] = message
        return self.with_container(names.CONTAINER_DRIVER, {"terminated": state})

    def waiting(self, container: str, reason: str, message: str = "", image: str = "") -> Self:
        state = {"waiting": {"reason": reason, "message": message}}
        return self.with_container(container, state, image)

    def with_container(self, name: str, state: Json, image: str = "", **more: object) -> Self:
        inits = {names.CONTAINER_AGENT, names.CONTAINER_STACK}
        where = self.inits if name in inits else self.mains
        where[:] = [c for c in where if c["name"] != name]
        where.append({"name": name, "image": image or "example/lane:1", "state": state, **more})
        return self

    def unschedulable(self, message: str) -> Self:
        self.status["conditions"] = [
            {
                "type": "PodScheduled",
                "status": "False",
                "reason": "Unschedulable",
                "message": message,
            }
        ]
        return self

    def evicted(self, message: str) -> Self:
        self.phase = "Failed"
        self.status |= {"reason": "Evicted", "message": message}
        return self

    def disrupted(self, reason: str, message: str) -> Self:
        self.status["conditions"] = [
            {
                "type": "DisruptionTarget",
                "status": "True",
                "reason": reason,
                "message": message,
                "lastTransitionTime": START.isoformat(),
            }
        ]
        return self

    def deleting(self, gone_by: str = "2026-11-20T04:00:00Z") -> Self:
        self.gone_by = gone_by
        return self

    def object(self) -> Json:
        meta: Json = {
            "name": self.name,
            "namespace": "lanes",
            "uid": f"uid-of-{self.name}",
            "labels": names.labels(self.job, f"uid-of-{self.job}", self.role, self.attempt),
            "ownerReferences": [names.owner_reference(self.job, f"uid-of-{self.job}")],
        }
        if self.gone_by:
            meta["deletionTimestamp"] = self.gone_by
        status = {
            "phase": self.phase,
            "initContainerStatuses": self.inits,
            "containerStatuses": self.mains,
        }
        volumes = [{"persistentVolumeClaim": {"claimName": claim}} for claim in self.claims]
        spec: Json = {"volumes": volumes}
        if self.node:
            spec["nodeName"] = self.node
        return copy.deepcopy({"metadata": meta, "spec": spec, "status": status | self.status})

    def view(self) -> PodView:
        return PodView.from_object(self.object())


def make_driver(job: str, attempt: int = 1) -> PodBuilder:
    return PodBuilder(f"{job}-{attempt}-driver", job, names.ROLE_DRIVER, attempt=attempt)


def make_executor(job: str, number: int = 1, attempt: int = 1) -> PodBuilder:
    name = f"{job}-{attempt}-exec-{number}"
    return PodBuilder(name, job, names.ROLE_EXECUTOR, attempt=attempt)
