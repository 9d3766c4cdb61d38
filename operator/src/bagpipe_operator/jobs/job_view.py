"""A SimulationJob, trimmed to what the operator decides on."""

from dataclasses import dataclass, field, replace
from functools import cached_property

from bagpipe.marks import marks_of
from bagpipe_operator.api import names, readings
from bagpipe_operator.api.kept_spec import packed, scalars, what_decides
from bagpipe_operator.api.nesting import bounded
from bagpipe_operator.api.objects import Json
from bagpipe_operator.api.runs import schedule_of
from bagpipe_operator.cluster.large_objects import TRIMMED, is_large


@dataclass(frozen=True)
class JobView:
    """A SimulationJob."""

    namespace: str
    name: str
    uid: str
    generation: int
    resource_version: str
    deleting: bool = False
    spec: Json = field(default_factory=dict)
    status: Json = field(default_factory=dict)
    created: str = ""  # as the API server writes it
    schedule: tuple[str, str] = ("", "")  # the name and the UID of the one that made it
    # `labels` and `annotations`, as far as results keep them
    marks: Json = field(default_factory=dict)
    # `spec` and `marks` whole, where these are only what decides; empty if it is too large to keep
    packed: bytes | None = None
    # Each call about it is a megabyte's work for the API server and for us.
    large: bool = False

    @cached_property
    def finished(self) -> bool:
        """Whether the job has ended, well or not, and this has been written."""
        return self._is({"Complete", "Failed"})

    @property
    def managed_elsewhere(self) -> bool:
        """Whether somebody else runs it, as spec.managedBy says."""
        return bool(self.spec.get("managedBy", names.MANAGER) != names.MANAGER)

    @property
    def suspended(self) -> bool:
        """Whether it has been written that the job rests, without pods."""
        return self._is({"Suspended"})

    def _is(self, types: set[str]) -> bool:
        return any(
            c.get("type") in types and c.get("status") == "True"
            for c in self.status.get("conditions") or []
        )

    def kept(self) -> "JobView":
        """The job with as much of its spec as is kept until the next visit."""
        if self.finished:
            marks = _few(self.marks) if self.status.get("notifications") else {}
            return replace(self, spec=scalars(self.spec, _OF_ENDED), marks=marks, packed=b"")
        decides = what_decides(self.spec, _OF_UNFINISHED)
        entire = self.packed
        if entire is None:
            entire = packed({"spec": self.spec, "marks": self.marks})
        return replace(self, spec=decides, marks={}, packed=entire)

    @classmethod
    def from_object(cls, job: Json) -> "JobView":
        """A job as the API server sends it."""
        meta = job["metadata"]
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            generation=int(meta.get("generation") or 1),
            resource_version=str(meta.get("resourceVersion") or ""),
            deleting=bool(meta.get("deletionTimestamp")),
            spec=bounded(readings.mapping(job.get("spec"))),
            status=bounded(readings.status(job.get("status"))),
            created=str(meta.get("creationTimestamp") or ""),
            schedule=schedule_of(job),
            marks=marks_of(meta.get("labels") or {}, meta.get("annotations") or {}),
            packed=b"" if TRIMMED in job else None,
            large=is_large(job),
        )


# How much of an ended job's marks is kept for those who are notified of its end.
_MOST_MARKS, _LONGEST_MARK = 16, 253


def _few(marks: Json) -> Json:
    return {
        kind: {k: v[:_LONGEST_MARK] for k, v in list(found.items())[:_MOST_MARKS] if len(k) <= 317}
        for kind, found in marks.items()
    }


# What an ended job's spec still decides: whether it is removed some time.
_OF_ENDED = frozenset({"ttlAfterFinished"})
# And of any other: whether it may run, how long, how often, and whose it is.
_OF_UNFINISHED = _OF_ENDED | {
    "suspend", "startDeadline", "activeDeadline", "backoffLimit", "managedBy", "resumeFrom",
    "queueName",
}  # fmt: skip
