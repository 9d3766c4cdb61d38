"""The counted rows in other forms, beside results.jsonl: JUnit XML, Parquet, comparisons, report.

All of them can be made again from results.jsonl; so a fault here costs a warning, not a job.
"""

import json
import logging
import posixpath
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from bagpipe.compare.compare import compare
from bagpipe.driver.baseline import baseline_rows
from bagpipe.report.html import Report
from bagpipe.report.junit import JUnitWriter
from bagpipe.report.table import TableWriter
from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile
from bagpipe.storage import Storage

# Without its ledger and timings a row is some hundred bytes: all that a comparison reads.
_COMPARED = (
    "case", "fragment", "variant", "values", "seed", "round", "outcome", "reason", "message",
)  # fmt: skip
_PIECE_BYTES = 1 << 20
COMPARISONS = "comparison.json"
COMPARISON_SCHEMA = "sim.bagpipe.io/comparison/v1alpha1"

log = logging.getLogger(__name__)


class Artefacts:
    """Takes every counted row once, in the order of the case names, and stores what it made."""

    def __init__(self, job: JobFile, storage: Storage, folder: str) -> None:
        self._job = job
        self._storage = storage
        self._folder = folder
        self._scratch = tempfile.TemporaryDirectory()
        path = Path(self._scratch.name)
        self._table = TableWriter(path / "results.parquet")
        self._junit_file = (path / "junit.xml").open("wb")
        self._junit = JUnitWriter(self._junit_file, job.name)
        self._report = Report(job.spec, folder)
        self._rows: list[Row] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._junit_file.close()
        self._scratch.cleanup()

    def add(self, row: Row) -> None:
        """One row that counts."""
        self._table.add(row)
        self._report.add(row)
        self._rows.append({key: row.get(key) for key in _COMPARED} | {"criteria": _figures(row)})

    def store(self, manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Write everything below the results; what the comparisons say. Raises StorageError."""
        self._table.finish()
        for row in sorted(self._rows, key=lambda row: row["variant"] or ""):
            self._junit.add(row)
        self._junit.finish()
        self._junit_file.flush()
        for name in ("results.parquet", "junit.xml"):
            with self._storage.create(posixpath.join(self._folder, name)) as file:
                for piece in _pieces(Path(self._scratch.name, name)):
                    file.write(piece)
        self._put("job.json", json.dumps(job_manifest(self._job), indent=1).encode())
        compared = self._compare()
        self._store_report(manifest, compared)
        return compared

    def _store_report(self, manifest: Mapping[str, Any], comparisons: list[dict[str, Any]]) -> None:
        try:
            page = self._report.html(manifest, comparisons)
        except Exception:  # the verdict stands without its page, which can be made again
            log.exception("report.html could not be made: `bagpipe report` makes it anew")
            return
        self._put("report.html", page)

    def _put(self, name: str, data: bytes) -> None:
        with self._storage.create(posixpath.join(self._folder, name)) as file:
            for first in range(0, len(data), _PIECE_BYTES):
                file.write(data[first : first + _PIECE_BYTES])

    def _compare(self) -> list[dict[str, Any]]:
        spec = self._job.spec
        if not spec.baseline and len(spec.variants) < 2:
            return []
        earlier = baseline_rows(spec.baseline.results, self._storage) if spec.baseline else None
        variants = [variant.name for variant in spec.variants]
        found = [comparison.as_json() for comparison in compare(self._rows, variants, earlier)]
        document = {"schema": COMPARISON_SCHEMA, "job": self._job.name, "comparisons": found}
        self._put(COMPARISONS, json.dumps(document, indent=1).encode())
        for comparison in found:
            log.info("%s: %s (%s)", comparison["variant"], comparison["verdict"],
                     comparison["message"])  # fmt: skip
        return found


def job_manifest(job: JobFile) -> dict[str, Any]:
    """The job as it ran, as a manifest that `bagpipe plan` and `bagpipe replay` read."""
    return {
        "apiVersion": "sim.bagpipe.io/v1alpha1",
        "kind": "SimulationJob",
        "metadata": {"name": job.name, "namespace": job.namespace, "uid": job.uid},
        "spec": job.spec.model_dump(mode="json", by_alias=True, exclude_defaults=True),
    }


def in_short(comparison: dict[str, Any]) -> dict[str, Any]:
    """A comparison as the job's status has it."""
    counts = {name: comparison["counts"][name] for name in ("regressed", "fixed", "flaky")}
    return {"variant": comparison["variant"], "verdict": comparison["verdict"], **counts}


def _figures(row: Row) -> list[dict[str, Any]]:
    """The findings without their courses over time, some KB each, which nothing here reads."""
    return [
        {key: value for key, value in finding.items() if key != "course"}
        for finding in row.get("criteria") or []
    ]


def _pieces(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while piece := file.read(_PIECE_BYTES):
            yield piece
