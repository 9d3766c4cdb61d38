"""What the operator has seen of its jobs' Workloads, trimmed to what it decides on.

Whoever may write Workloads in a namespace may write anything into one: it is read like a status.
"""

from dataclasses import dataclass

from bagpipe_operator.api import conditions, names, readings
from bagpipe_operator.api.objects import Json, is_older

ADMITTED = "Admitted"
EVICTED = "Evicted"
FINISHED = "Finished"
PODS_READY = "PodsReady"
QUOTA_RESERVED = "QuotaReserved"
REQUEUED = "Requeued"

# Which sizes the Workload was made for.
MADE_OF = f"{names.GROUP}/made-of"


@dataclass(frozen=True)
class WorkloadView:
    """A Workload of a job."""

    namespace: str
    name: str
    uid: str
    job_uid: str  # by its label, which anybody may write
    owner_uid: str
    generation: int
    resource_version: str
    deleting: bool
    conditions: tuple[Json, ...]
    # By the pod set's name: its flavors' names, and what admission checks add to its pods
    flavors: dict[str, tuple[str, ...]]
    updates: dict[str, tuple[Json, ...]]
    made_of: str  # empty where the watch has left it out

    def condition(self, type_: str) -> Json | None:
        """The condition of a type, if it was ever written."""
        return conditions.find(self.conditions, type_)

    def holds(self, type_: str) -> bool:
        """Whether the condition of a type is true."""
        found = self.condition(type_)
        return found is not None and found["status"] == "True"

    @property
    def admitted(self) -> bool:
        """Whether the job may have pods."""
        over = self.holds(EVICTED) or self.holds(FINISHED) or self.deleting
        return self.holds(ADMITTED) and not over

    @classmethod
    def from_object(cls, workload: Json) -> "WorkloadView":
        """Trims a Workload as the API server sends it."""
        meta, status = workload["metadata"], readings.mapping(workload.get("status"))
        owners = [
            each for each in readings.objects(meta.get("ownerReferences")) if each.get("controller")
        ]
        admission = readings.mapping(status.get("admission"))
        checks = readings.objects(status.get("admissionChecks"))
        return cls(
            namespace=meta["namespace"],
            name=meta["name"],
            uid=meta["uid"],
            job_uid=str(readings.mapping(meta.get("labels")).get(names.LABEL_JOB_UID, "")),
            owner_uid=str(owners[0].get("uid")) if owners else "",
            generation=int(meta.get("generation") or 1),
            resource_version=str(meta.get("resourceVersion") or ""),
            deleting=bool(meta.get("deletionTimestamp")),
            conditions=tuple(readings.conditions(status.get("conditions"))),
            flavors=_flavors(readings.objects(admission.get("podSetAssignments"))),
            updates=_updates(
                [u for check in checks for u in readings.objects(check.get("podSetUpdates"))]
            ),
            made_of=str(readings.mapping(meta.get("annotations")).get(MADE_OF, "")),
        )


def _flavors(assignments: list[Json]) -> dict[str, tuple[str, ...]]:
    """A flavor is often that of several resources."""
    found: dict[str, tuple[str, ...]] = {}
    for each in assignments:
        flavors = readings.mapping(each.get("flavors")).values()
        unique = {flavor for flavor in flavors if isinstance(flavor, str)}
        found[str(each.get("name"))] = tuple(sorted(unique))
    return found


def _updates(updates: list[Json]) -> dict[str, tuple[Json, ...]]:
    found: dict[str, tuple[Json, ...]] = {}
    for update in updates:
        name = str(update.get("name"))
        found[name] = (*found.get(name, ()), update)
    return found


class Workloads:
    """The Workloads that were seen, by namespace and name: what their labels say is not trusted."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], WorkloadView] = {}
        self._owned: dict[str, set[tuple[str, str]]] = {}

    def find(self, namespace: str, name: str) -> WorkloadView | None:
        """The Workload, or None when it is gone or was never seen."""
        return self._seen.get((namespace, name))

    def put(self, workload: WorkloadView) -> bool:
        """Keeps a Workload unless something newer is known; says whether it was kept."""
        known = self.find(workload.namespace, workload.name)
        if known is not None and is_older(workload.resource_version, known.resource_version):
            return False
        if known is not None:
            self._remove(known)
        key = workload.namespace, workload.name
        self._seen[key] = workload
        self._owned.setdefault(workload.owner_uid, set()).add(key)
        return True

    def drop(self, workload: WorkloadView) -> None:
        """Takes a Workload away, unless another of the same name has taken its place."""
        known = self.find(workload.namespace, workload.name)
        if known is not None and known.uid == workload.uid:
            self._remove(known)

    def forget(self, owner_uid: str) -> None:
        """Takes away the Workloads of a job that is gone."""
        for key in list(self._owned.get(owner_uid, ())):
            self._remove(self._seen[key])

    def _remove(self, known: WorkloadView) -> None:
        key = known.namespace, known.name
        del self._seen[key]
        self._owned[known.owner_uid].discard(key)
        if not self._owned[known.owner_uid]:
            del self._owned[known.owner_uid]
