"""The results folder of a job, as anybody may read it: manifest, lines, comparisons, the job."""

import json
import posixpath
import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from bagpipe.evaluate.unmarked import EarlierMarks
from bagpipe.row_facts import OUTCOMES, counts_of
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage, StorageError

Row = dict[str, Any]

MANIFEST, LINES, JOB = "manifest.json", "results.jsonl", "job.json"
# What a job leaves in its folder beside the manifest (docs/reference/results.md).
PUT_ONCE = ("quarantine.json", "catalogue.json", "recordings.json.gz")
FILES = (
    LINES, "results.parquet", "junit.xml", "report.html", "comparison.json", JOB,
    *PUT_ONCE,
)  # fmt: skip
FOLDERS = ("cases", "journal")
# And what one that ran on this machine leaves: its logs, and what it began with.
LOGS = ("agent.log", "driver.log")
BEGUN = "run.json"

_MOST_MANIFEST_BYTES = 1 << 30
_HEAD_BYTES = 4 << 20
_CASES = re.compile(rb',\s*"cases": \[')
_MOST_FILE_BYTES = 64 << 20


class ManifestUnreadableError(StorageError):
    """It is there, and is none."""


@dataclass(frozen=True)
class StoredResults:
    """What a job has published below a URI. Every method raises StorageError."""

    uri: str
    storage: Storage

    def manifest(self) -> dict[str, Any]:
        """What counts; a folder without one is not (yet) a job's results."""
        uri = posixpath.join(self.uri, MANIFEST)
        if not self.storage.exists(uri):
            raise StorageError(
                f"there is no {uri}: write status.results of a job that has ended (a job that"
                " still runs has none)"
            )
        manifest = self._map(MANIFEST, _MOST_MANIFEST_BYTES)
        return manifest | {"counts": counts_of(manifest)}

    def head(self) -> dict[str, Any]:
        """The manifest without its cases, of which there may be a million."""
        uri = posixpath.join(self.uri, MANIFEST)
        file = self.storage.open(uri)
        text = file.read(0, _HEAD_BYTES)
        cases = _CASES.search(text) if file.size > len(text) else None
        try:
            head = json.loads(text[: cases.start()] + b"}" if cases else text)
            return dict(head) | {"counts": counts_of(head)}
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise ManifestUnreadableError(f"{uri} is no manifest of results: {error!r}") from error

    def rows(self) -> Iterator[Row]:
        """The lines of results.jsonl, in the order of the case names."""
        uri = posixpath.join(self.uri, LINES)
        for number, line in enumerate(self.storage.open(uri).lines(), start=1):
            yield _row(line, uri, number)

    def marked_rows(self) -> Iterator[Row]:
        """The lines, with a mark of what each figure measures also where a release before wrote
        none.
        """
        marks = EarlierMarks(self._spec_as_stored())
        return map(marks.added, self.rows())

    def baseline_rows(self) -> Iterator[Row]:
        """The marked lines of the first variant, where the job had several; else all.

        Also refused, at the latest at their end, where a part is missing: what got worse in it
        would be taken for new.
        """
        expected = self._lines_of_all()
        first = self._first_variant()
        lines, variants = 0, set()
        for row in self.marked_rows():
            lines += 1
            variants.add(str(row.get("variant") or ""))
            if first is None and len(variants) > 1:
                raise StorageError(
                    f"{self.uri} has cases of several variants ({', '.join(sorted(variants))}), and"
                    f" no {JOB} that says which one is the first: copy that, too"
                )
            if first is None or row.get("variant") == first:
                yield row
        if expected is not None and lines != expected:
            raise StorageError(
                f"{posixpath.join(self.uri, LINES)} has {lines} lines, and its manifest"
                f" {expected} cases: copy the results again, all of them"
            )

    def _first_variant(self) -> str | None:
        """Its name, whatever else the job's spec has; None of a job without variants."""
        variants = self._spec_as_stored().get("variants") or []
        try:
            return str(variants[0]["name"]) if variants else None
        except (TypeError, KeyError, IndexError) as error:
            raise StorageError(f"{self.uri}/{JOB} is no job: {error!r}") from error

    def _spec_as_stored(self) -> dict[str, Any]:
        """The job's, of whatever form its fields are; empty where it was not kept."""
        if not self.storage.exists(posixpath.join(self.uri, JOB)):
            return {}
        spec = self._map(JOB).get("spec") or {}
        if not isinstance(spec, dict):
            raise StorageError(f"{self.uri}/{JOB} is no job: its spec is no map")
        return spec

    def _lines_of_all(self) -> int | None:
        """How many lines there are, of a job of which all cases ran; None without a manifest."""
        if not self.storage.exists(posixpath.join(self.uri, MANIFEST)):
            return None
        manifest = self.head()
        counts = manifest["counts"]
        planned, ran = counts["planned"], sum(counts[outcome] for outcome in OUTCOMES)
        if ran < planned:
            raise StorageError(
                f"{self.uri} is of a job that ended as {manifest['reason']} with {ran} of {planned}"
                " cases: compare with one that ran all of its cases"
            )
        return int(ran)

    def row(self, case: str) -> Row:
        """The line of one case."""
        names: list[str] = []
        for row in self.rows():
            if row["case"] == case:
                return row
            if len(names) < 5:
                names.append(row["case"])
        raise StorageError(f"{self.uri} has no case {case}; it has {', '.join(names)}, ...")

    def comparisons(self) -> list[dict[str, Any]]:
        """What the manifest says of them, or comparison.json beside an earlier release's."""
        if (found := self.manifest().get("comparisons")) is not None:
            return list(found)
        if not self.storage.exists(posixpath.join(self.uri, "comparison.json")):
            return []
        return list(self._map("comparison.json")["comparisons"])

    def spec(self) -> SimulationJobSpec | None:
        """The job as it ran; None where it was not kept (before version 0.1).

        It has a spec's form, and need not keep rules that came after it.
        """
        if not self.storage.exists(posixpath.join(self.uri, JOB)):
            return None
        try:
            return SimulationJobSpec.of_results(self._map(JOB).get("spec") or {})
        except ValidationError as error:
            raise StorageError(f"{self.uri}/{JOB} is no job: {error}") from error

    def _map(self, name: str, most: int = _MOST_FILE_BYTES) -> dict[str, Any]:
        uri = posixpath.join(self.uri, name)
        try:
            found = json.loads(self.storage.read_all(uri, most))
        except ValueError as error:
            raise StorageError(f"{uri} is no JSON: {error}") from error
        if not isinstance(found, dict):
            raise StorageError(f"{uri} is no map")
        return found


def _row(line: bytes, uri: str, number: int) -> Row:
    try:
        row = json.loads(line)
        if isinstance(row["case"], str) and isinstance(row["outcome"], str):
            found: Row = row
            return found
    except (ValueError, TypeError, KeyError) as error:
        raise StorageError(f"{uri} line {number} is no row of results: {error}") from error
    raise StorageError(f"{uri} line {number} is no row of results")
