"""The counted rows in other forms, beside results.jsonl: JUnit XML, Parquet, comparisons, report.

All of them can be made again from results.jsonl; so a fault here costs a warning in the log and
the one file that it concerns, not a job. Faults of storage alone are raised: they may pass.
"""

import contextlib
import json
import logging
import posixpath
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from bagpipe.driver.baseline import baseline_rows
from bagpipe.marks import PROVENANCE
from bagpipe.report.html import Report
from bagpipe.report.junit import kept, write_junit
from bagpipe.report.table import TableWriter
from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError

_PIECE_BYTES = 1 << 20
TABLE, JUNIT, REPORT = "results.parquet", "junit.xml", "report.html"
COMPARISONS, JOB = "comparison.json", "job.json"
_SCRATCH = "the folder for results.parquet and junit.xml"
_OVER_SCRATCH = (TABLE, JUNIT)
COMPARISON_SCHEMA = "sim.bagpipe.io/comparison/v1alpha2"

log = logging.getLogger(__name__)


class Artefacts:
    """Takes every counted row once, in the order of the case names, and stores what it made."""

    def __init__(
        self, job: JobFile, storage: Storage, folder: str, manifest: Mapping[str, Any]
    ) -> None:
        self._job = job
        self._storage = storage
        self._folder = folder
        self._given_up: set[str] = set()
        self._open = contextlib.ExitStack()
        self._tests: list[dict[str, Any]] = []
        self._report = Report(job.spec, folder, manifest.get("comparisons") or [])
        self._scratch = Path()
        self._tried(_SCRATCH, self._begin)
        self._tried(TABLE, self._begin_table)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def add(self, row: Row) -> None:
        """One row that counts."""
        self._tried(TABLE, lambda: self._table.add(row))
        self._tried(JUNIT, lambda: self._tests.append(kept(row)))
        self._tried(REPORT, lambda: self._report.add(row))

    def store(self, manifest: Mapping[str, Any]) -> None:
        """Write everything below the results. Raises StorageError."""
        compared = manifest.get("comparisons") or []
        self._tried(TABLE, self._store_table)
        self._tried(JUNIT, lambda: self._store_junit(manifest))
        self._tried(JOB, lambda: self._put(JOB, _json(job_manifest(self._job, manifest))))
        if compared:
            self._tried(COMPARISONS, lambda: self._store_comparisons(compared))
        self._tried(REPORT, self._lay_over_the_baseline)
        self._tried(REPORT, lambda: self._put(REPORT, self._report.html(manifest, compared)))

    def _tried(self, name: str, action: Callable[[], None]) -> None:
        """Do what one file needs, unless something that it needs failed before."""
        if name in self._given_up or (name in _OVER_SCRATCH and _SCRATCH in self._given_up):
            return
        try:
            action()
        except StorageError:
            raise
        except Exception:  # the verdict stands without the file
            log.exception("%s could not be made; the job's results are whole without", name)
            self._given_up.add(name)

    def _begin(self) -> None:
        scratch = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        self._scratch = Path(self._open.enter_context(scratch))

    def _begin_table(self) -> None:
        self._table = TableWriter(self._scratch / TABLE)

    def _store_table(self) -> None:
        self._table.finish()
        self._put_scratch(TABLE)

    def _store_junit(self, manifest: Mapping[str, Any]) -> None:
        with (self._scratch / JUNIT).open("wb") as file:
            write_junit(file, manifest, self._tests)
        self._put_scratch(JUNIT)

    def _lay_over_the_baseline(self) -> None:
        baseline = self._job.spec.compared_with
        if baseline is None:
            return
        try:
            self._report.add_earlier(baseline_rows(baseline, self._storage))
        except StorageError as error:
            # The page is not worth another try of the whole commit.
            log.warning("the report has no course of the baseline: %s", error)

    def _put_scratch(self, name: str) -> None:
        with self._storage.create(posixpath.join(self._folder, name)) as file:
            for piece in _pieces(self._scratch / name):
                file.write(piece)

    def _put(self, name: str, data: bytes) -> None:
        with self._storage.create(posixpath.join(self._folder, name)) as file:
            for first in range(0, len(data), _PIECE_BYTES):
                file.write(data[first : first + _PIECE_BYTES])

    def _store_comparisons(self, compared: list[dict[str, Any]]) -> None:
        document = {"schema": COMPARISON_SCHEMA, "job": self._job.name, "comparisons": compared}
        self._put(COMPARISONS, _json(document))


def job_manifest(job: JobFile, manifest: Mapping[str, Any]) -> dict[str, Any]:
    """The job as it ran, as a manifest that kubectl, `bagpipe plan` and `bagpipe replay` read.

    Where its results come from is an annotation: no field of a SimulationJob is for it.
    """
    provenance = json.dumps(manifest.get("provenance") or {}, sort_keys=True)
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {
            "name": job.name,
            "namespace": job.namespace,
            "uid": job.uid,
            "labels": job.labels,
            "annotations": job.annotations | {PROVENANCE: provenance},
        },
        "spec": job.spec.model_dump(mode="json", by_alias=True, exclude_defaults=True),
    }


def _json(document: Mapping[str, Any]) -> bytes:
    return json.dumps(document, indent=1).encode()


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while piece := file.read(_PIECE_BYTES):
            yield piece
