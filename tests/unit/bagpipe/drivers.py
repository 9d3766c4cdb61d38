"""One job's results folder, and drivers that come and go over it, without a Spark."""

import json
import threading
from pathlib import Path
from typing import Any

from bagpipe.driver.journal import Journal
from bagpipe.driver.keep import Keeper
from bagpipe.driver.progress import Progress
from bagpipe.driver.results import Results, results_uri
from bagpipe.driver.row_file import RowFile
from bagpipe.plan.case import Case
from bagpipe.plan.fragments import Window
from bagpipe.plan.made import Unplanned
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage
from tests.unit.bagpipe.jobs import make_job, make_row

MISSING = Unplanned("lost", "pvc://recordings/lost.bag", "BagMissing", "no file at lost.bag")
WINDOW = [10, 20, 30]


class World:
    """One job's results folder, and drivers that come and go over it."""

    def __init__(self, tmp_path: Path) -> None:
        self.tmp_path = tmp_path
        self.job = make_job({"results": str(tmp_path)})
        self.storage = Storage(self.job.volumes)
        self.results = Results(self.job, self.storage)
        self.folder = tmp_path / "out/drive/uid-1"
        self.seconds = 0.0
        self.drivers = 0

    def driver(self, max_failed: int | None = None) -> tuple[Keeper, Journal]:
        self.drivers += 1
        journal = Journal(self.storage, results_uri(self.job), self.drivers)
        progress = Progress(results_uri(self.job))
        progress.begin(4)
        rows = RowFile(self.tmp_path / f"rows-{self.drivers}")
        keeper = Keeper(
            progress, rows, journal, max_failed, self.results.is_committed, lambda: self.seconds
        )
        return keeper, journal

    def record(self, name: str) -> None:
        with self.storage.create(f"{results_uri(self.job)}/cases/{name}") as file:
            file.write(b"bag")

    def names(self, folder: str) -> list[str]:
        return self.storage.names(f"{results_uri(self.job)}/{folder}")

    def lines(self) -> list[Row]:
        text = (self.folder / "results.jsonl").read_text()
        return [json.loads(line) for line in text.splitlines()]


def case(name: str, start: int = 20) -> Case:
    return Case(name, "pvc://recordings/a.bag", "9-1", Window(10, start, 30), [], [(0, 9)], 1)


def ran(name: str, outcome: str = "passed", **changed: Any) -> Row:
    return make_row(name, outcome, **({"window": WINDOW, "bag_version": "9-1"} | changed))


def finish(keeper: Keeper) -> None:
    keeper.finish(threading.Event())
