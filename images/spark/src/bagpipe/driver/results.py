"""What a job leaves behind: one line per case, and the manifest that says which bags count.

Readers trust only manifest.json: it is written last and appears whole. A recorded bag that
it does not name came from an attempt that did not count, and is removed.
"""

import json
import posixpath
from typing import Any

from bagpipe.driver.progress import Progress
from bagpipe.plan.cases import Unplanned
from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile
from bagpipe.storage import Storage

MANIFEST_SCHEMA = "sim.bagpipe.io/manifest/v1alpha1"


def results_uri(job: JobFile) -> str:
    """The folder of this job's results; the UID keeps a job apart from its earlier namesakes."""
    return posixpath.join(job.spec.output.uri, job.name, job.uid)


def first_rows(rows: list[Row]) -> list[Row]:
    """One row per case, the first that came, in the order of the case names."""
    counted: dict[str, Row] = {}
    for row in rows:
        counted.setdefault(row["case"], row)
    return [counted[name] for name in sorted(counted)]


def commit(
    job: JobFile, rows: list[Row], unplanned: list[Unplanned], progress: Progress, storage: Storage
) -> None:
    """Write results.jsonl, then manifest.json, then remove what did not count.

    Raises StorageError.
    """
    folder = results_uri(job)
    lines = [*rows, *(_unplanned_row(bag) for bag in unplanned)]
    with storage.create(posixpath.join(folder, "results.jsonl")) as file:
        for line in lines:
            file.write(json.dumps(line).encode() + b"\n")
    snapshot = progress.snapshot()
    manifest = {
        "schema": MANIFEST_SCHEMA,
        "job": {"name": job.name, "namespace": job.namespace, "uid": job.uid},
        "attempt": job.attempt,
        "phase": snapshot["phase"],
        "verdict": snapshot["verdict"],
        "counts": snapshot["cases"],
        "ledger": snapshot["ledger"],
        "cases": [_manifest_entry(line) for line in lines],
    }
    with storage.create(posixpath.join(folder, "manifest.json")) as file:
        file.write(json.dumps(manifest, indent=1).encode())
    _remove_uncounted(folder, rows, storage)


def _manifest_entry(row: Row) -> dict[str, Any]:
    return {key: row.get(key) for key in ("case", "outcome", "reason", "recorded", "attempts")}


def _unplanned_row(bag: Unplanned) -> Row:
    return {
        "case": bag.id,
        "bag": bag.bag,
        "outcome": "errored",
        "reason": bag.reason,
        "message": bag.message,
        "recorded": None,
        "result": None,
        "attempts": 0,
    }


def _remove_uncounted(folder: str, rows: list[Row], storage: Storage) -> None:
    counted = {posixpath.basename(row["recorded"]) for row in rows if row["recorded"]}
    cases = posixpath.join(folder, "cases")
    for name in storage.names(cases):
        if name not in counted:
            storage.remove(posixpath.join(cases, name))
