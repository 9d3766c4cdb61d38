"""Results folders as drivers leave them, without a driver."""

import json
from collections.abc import Iterable
from datetime import date
from pathlib import Path
from typing import Any

from bagpipe.driver.comparing import compared
from bagpipe.driver.journal import Journal
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results, results_uri
from bagpipe.driver.row_file import RowFile
from bagpipe.quarantine import Quarantine
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_job, make_row

# The day of every such job, on which its quarantine is looked at.
TODAY = date(2026, 11, 23)


def publish(tmp_path: Path, rows: Iterable[Row], uid: str = "uid-1", **changed: Any) -> Path:
    """The folder of a job with these rows; `changed` are fields of its spec."""
    storage = Storage({"results": str(tmp_path), "recordings": str(tmp_path)})
    job = make_job(storage.volumes, **changed).model_copy(update={"uid": uid})
    results = Results(job, storage)
    journal = Journal(storage, results.folder, 1)
    progress = Progress(results.folder)
    quarantine = Quarantine(job.spec.quarantine, TODAY)
    progress.look_at(quarantine)
    with RowFile(tmp_path / f"rows-{uid}") as file:
        for row in map(quarantine.marked, rows):
            file.add(row)
            progress.add(row)
        progress.begin(len(file))
        progress.compare(compared(job.spec, file.rows, storage))
        results.publish(results.commit(file, progress, journal.driver), file.rows, journal)
    return tmp_path / results_uri(job).removeprefix("pvc://results/")


def versions(*, failing: set[int]) -> list[Row]:
    """Six cases of two variants, of which the second fails in those of `failing`."""
    return [
        make_row(
            f"a-{n:04d}-{variant}",
            "failed" if variant == "pr-812" and n in failing else "passed",
            fragment=f"a-{n:04d}",
            variant=variant,
        )
        for n in range(6)
        for variant in ("released", "pr-812")
    ]


def stored(folder: Path, lines: str, cases: int) -> None:
    """Results with just these lines, and a manifest of so many cases."""
    (folder / "results.jsonl").write_text(lines)
    entries = [{"case": f"a-{number}"} for number in range(cases)]
    counts = {"planned": cases, "passed": cases}
    manifest = {"cases": entries, "counts": counts, "reason": "AllCasesRan"}
    (folder / "manifest.json").write_text(json.dumps(manifest))
