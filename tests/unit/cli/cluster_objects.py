"""Jobs as the API server returns them, and a cluster whose answers a test sets."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

from bagpipe.cli.cluster.faults import ClusterError
from bagpipe.cli.cluster.following import Times

Json = dict[str, Any]
ENDED = {"passed": 4}


def condition(kind: str, status: bool, reason: str, message: str = "") -> Json:
    return {"type": kind, "status": str(status), "reason": reason, "message": message}


def a_job(name: str = "nightly", uid: str = "uid-1", version: str = "1", **status: Any) -> Json:
    """A job with these fields of its status, and none of a status if none is given."""
    job: Json = {
        "metadata": {"name": name, "namespace": "robots", "uid": uid, "resourceVersion": version},
        "spec": {"stack": {"image": "i", "command": ["c"]}},
    }
    return job | {"status": status} if status else job


def running(planned: int = 4, **counts: int) -> Json:
    """A job whose cases run."""
    last = condition("Running", True, "CasesRunning", "Cases are running.")
    accepted = condition("Accepted", True, "DriverCreated")
    return a_job(
        phase="Running", conditions=[accepted, last], cases={"planned": planned} | counts,
        driver="nightly-1-driver",
    )  # fmt: skip


def ended(verdict: str = "Passed", reason: str = "AllCasesRan", **status: Any) -> Json:
    """A job at its end; without a verdict it is Failed."""
    kind = "Complete" if verdict else "Failed"
    last = condition(kind, True, reason, "4 of 4 cases ran")
    fields: Json = {
        "phase": kind, "conditions": [last], "verdict": verdict, "cases": {"planned": 4} | ENDED,
        "results": "pvc://results/out/nightly/uid-1", "driver": "nightly-1-driver",
    }  # fmt: skip
    return a_job(**(fields | status))


@dataclass
class FakeClock:
    """Seconds that pass only when somebody waits; it remembers for how long."""

    seconds: float = 0.0
    pauses: list[float] = field(default_factory=list)

    def pause(self, seconds: float) -> None:
        self.pauses.append(seconds)
        self.seconds += seconds

    @property
    def times(self) -> Times:
        return Times(lambda: self.seconds, self.pause)


Answer = Json | ClusterError
Event = tuple[str, Json] | ClusterError | Callable[[], None]


@dataclass
class FaultySource:
    """Answers as a cluster does that breaks connections, which a real one does when it likes."""

    looks: list[Answer]
    watches: list[list[Event]] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)

    def job(self, _name: str) -> Json:
        """The next look; the last one again and again."""
        self.asked.append("get")
        look = self.looks.pop(0) if len(self.looks) > 1 else self.looks[0]
        if isinstance(look, ClusterError):
            raise look
        return look

    def changes(self, _name: str, version: str, _seconds: float) -> Iterator[tuple[str, Json]]:
        """The next watch; none when all were seen."""
        self.asked.append(f"watch from {version}")
        for event in self.watches.pop(0) if self.watches else []:
            if isinstance(event, ClusterError):
                raise event
            if isinstance(event, tuple):
                yield event
            else:
                event()


@dataclass
class FakePods:
    """Logs by pod and container, of pods of one role."""

    logs: dict[tuple[str, str], str]
    fault: ClusterError | None = None

    def pods(self, _uid: str, _role: str) -> list[Json]:
        """A pod for each name, with the containers of its logs."""
        if self.fault:
            raise self.fault
        names = dict.fromkeys(pod for pod, _ in self.logs)
        return [
            {
                "metadata": {"name": name},
                "spec": {"initContainers": [{"name": c} for pod, c in self.logs if pod == name]},
            }
            for name in names
        ]

    def log(self, pod: str, container: str, lines: int, most_bytes: int) -> str:
        """The end of a log."""
        try:
            text = self.logs[pod, container]
        except KeyError:
            raise ClusterError(f"there is no log of pod {pod}", status=404) from None
        return "\n".join(text.splitlines()[-lines:])[-most_bytes:]
