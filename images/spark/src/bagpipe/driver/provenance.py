"""Where a job's results come from: software, images, machines, labels, time, seeds. Pure.

Nothing of a Secret can be in it: it holds what the job's object says of itself to everybody who
may read it, what kubelets say of images, and what the rows say of machines.
"""

from collections import Counter
from collections.abc import Iterable
from datetime import UTC, datetime
from typing import Any

import bagpipe
from bagpipe.driver.own_pods import Seen
from bagpipe.row_facts import discarded_runs
from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile

_MOST_NAMES = 20
_MOST_SEEDS = 100
_KIND = ("cpu", "arch", "kernel", "cpus")


class Provenance:
    """Takes every row that counts; then makes the document."""

    def __init__(self, job: JobFile, seen: Seen) -> None:
        self._job = job
        self._seen = seen
        self._agents: set[str] = set()
        self._seeds: set[int] = set()
        self._machines: dict[tuple[Any, ...], Counter[str]] = {}
        self._reasons: Counter[str] = Counter()

    def add(self, row: Row) -> None:
        """One row that counts."""
        if software := (row.get("result") or {}).get("software"):
            self._agents.add(str(software))
        if row.get("seed") is not None:
            self._seeds.add(int(row["seed"]))
        if where := row.get("ran_on"):
            kind = tuple(where.get(key) for key in _KIND)
            host = str(where.get("host") or "")
            name = self._seen.nodes.get(host, host)
            self._machines.setdefault(kind, Counter())[name] += 1
        self._reasons.update(run["reason"] for run in discarded_runs(row))

    def as_json(self, began: float, ended: float) -> dict[str, Any]:
        """The document; the times are seconds since 1970."""
        return {
            "bagpipe": bagpipe.__version__,
            "agents": sorted(self._agents),
            "images": self._seen.images(),
            "labels": self._job.labels,
            "annotations": self._job.annotations,
            "created": self._job.created,
            "baseline": _baseline(self._job),
            "began": _moment(began),
            "ended": _moment(ended),
            "seconds": round(ended - began, 1),
            "machines": [
                dict(zip(_KIND, kind, strict=True))
                | {"cases": hosts.total(), "names": sorted(hosts)[:_MOST_NAMES]}
                for kind, hosts in sorted(self._machines.items(), key=str)
            ],
            "seeds": sorted(self._seeds)[:_MOST_SEEDS],
            "discarded": dict(self._reasons.most_common()),
        }


def provenance_of(
    job: JobFile, rows: Iterable[Row], seen: Seen, times: tuple[float, float]
) -> dict[str, Any]:
    """What a manifest says of where its rows come from; `times` are its begin and end."""
    found = Provenance(job, seen)
    for row in rows:
        found.add(row)
    return found.as_json(*times)


def _baseline(job: JobFile) -> dict[str, Any] | None:
    """Which job spec.baseline.lastPassed was, or why it was none."""
    if job.baseline is None:
        return None
    return job.baseline.model_dump() | {"results": job.spec.compared_with}


def _moment(seconds: float) -> str:
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")
