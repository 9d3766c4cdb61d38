"""What a job's object says, as the program shows it. Pure."""

from dataclasses import asdict, dataclass, field
from datetime import datetime
from typing import Any, Self

from bagpipe.cli.places import status_of

Json = dict[str, Any]

_NOT_SEEN = (
    "The operator has not looked at the job yet. If this lasts, it is not running, or does not look"
    " after this namespace: kubectl -n bagpipe-system get pods"
)


@dataclass(frozen=True)
class Counts:
    """Cases by state."""

    planned: int = 0
    running: int = 0
    passed: int = 0
    failed: int = 0
    invalid: int = 0
    errored: int = 0
    crashed: int = 0
    lost: int = 0
    regressed: int = 0
    quarantined: int = 0
    discarded: int = 0

    @property
    def done(self) -> int:
        """Cases that came to an end, whatever it was."""
        return self.passed + self.failed + self.invalid + self.errored


@dataclass(frozen=True)
class JobState:
    """One look at a job."""

    name: str
    namespace: str
    uid: str
    phase: str
    verdict: str
    reason: str
    message: str
    cases: Counts
    results: str
    driver: str
    ended: bool
    pods_of: str = ""
    """UID of the job that the pods were made for, where a driver of a pool has taken this one."""

    first_case: datetime | None = None
    completed: datetime | None = None
    failures: list[Json] = field(default_factory=list)
    comparisons: list[Json] = field(default_factory=list)

    @classmethod
    def of(cls, job: Json) -> Self:
        """What a SimulationJob says of itself; one that nobody has looked at yet is Pending."""
        status = job.get("status") or {}
        conditions = {c["type"]: c for c in status.get("conditions") or []}
        reason, message = _reason(conditions)
        counts = status.get("cases") or {}
        # One that could not be run has none, also where an earlier release's operator wrote one.
        verdict = (status.get("verdict") or "") if not _true(conditions, "Failed") else ""
        return cls(
            name=job["metadata"]["name"],
            namespace=job["metadata"]["namespace"],
            uid=job["metadata"]["uid"],
            phase=status.get("phase") or "Pending",
            verdict=verdict,
            reason=reason,
            message=message,
            cases=Counts(**{key: int(counts.get(key) or 0) for key in Counts.__annotations__}),
            results=status.get("results") or "",
            driver=status.get("driver") or "",
            pods_of=_made_for(status),
            ended=_true(conditions, "Complete") or _true(conditions, "Failed"),
            first_case=_moment(status.get("firstCaseTime")),
            completed=_moment(status.get("completionTime")),
            failures=list(status.get("failures") or []),
            comparisons=list(status.get("comparisons") or []),
        )

    @property
    def exit_status(self) -> int:
        """0 when it passed, 1 when it was judged otherwise, 2 without a verdict."""
        return status_of({"verdict": self.verdict}) if self.ended else 2

    def as_json(self) -> Json:
        """For --output json and yaml."""
        found = asdict(self)
        del found["first_case"], found["completed"], found["pods_of"]
        found["completionTime"] = self.completed.isoformat() if self.completed else None
        return found


def _made_for(status: Json) -> str:
    """Only a job's first attempt runs in the pods of another."""
    pool = status.get("pool") or {}
    taken = pool.get("state") == "Taken" and (status.get("attempt") or 1) == 1
    return str(pool.get("uid") or "") if taken else ""


def _reason(conditions: dict[str, Json]) -> tuple[str, str]:
    """The reason and the sentence that matter now, of the six conditions."""
    for kind in ("Complete", "Failed", "Suspended"):
        if _true(conditions, kind):
            return conditions[kind]["reason"], conditions[kind]["message"]
    accepted = conditions.get("Accepted")
    if accepted and accepted["status"] == "False":
        return accepted["reason"], accepted["message"]
    running = conditions.get("Running")
    if running:
        return running["reason"], running["message"]
    return "NotSeen", _NOT_SEEN


def _true(conditions: dict[str, Json], kind: str) -> bool:
    return (conditions.get(kind) or {}).get("status") == "True"


def _moment(text: str | None) -> datetime | None:
    return datetime.fromisoformat(text) if text else None
