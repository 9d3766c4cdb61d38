"""What a job leaves behind: one line per case, and the manifest that says which bags count.

Readers trust only manifest.json. It is put once, whole, and never replaced: of two drivers of
one job (the first was cut off and came back) one commits, and the other adopts what it finds.
A recorded bag that the manifest does not name came from an attempt that did not count.
"""

import json
import posixpath
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from bagpipe.driver.journal import Journal
from bagpipe.driver.own_pods import Seen
from bagpipe.driver.progress import Progress
from bagpipe.driver.provenance import provenance_of
from bagpipe.driver.row_file import RowFile
from bagpipe.quarantine import Quarantine
from bagpipe.report.stored import StoredResults
from bagpipe.row_facts import counts_of, discarded_of, quarantine_of, recorded_names
from bagpipe.run.case_run import Row
from bagpipe.spec import JobFile
from bagpipe.storage import Storage, StorageError

CASE_SCHEMA = "sim.bagpipe.io/case/v1alpha1"
MANIFEST_SCHEMA = "sim.bagpipe.io/manifest/v1alpha1"
LINES = "results.jsonl"
_MAX_MANIFEST_BYTES = 1 << 30

Manifest = dict[str, Any]


def results_uri(job: JobFile) -> str:
    """The folder of this job's results; the UID keeps a job apart from its earlier namesakes."""
    return job.results or posixpath.join(job.spec.output.uri, job.name, job.uid)


@dataclass(frozen=True)
class Results:
    """The results folder of one job. Every method raises StorageError."""

    job: JobFile
    storage: Storage

    @property
    def folder(self) -> str:
        """Its URI."""
        return results_uri(self.job)

    def is_committed(self) -> bool:
        """Whether some driver of this job has committed."""
        return self.storage.exists(self._uri("manifest.json"))

    def committed(self) -> Manifest | None:
        """The manifest, if some driver of this job has committed."""
        if not self.is_committed():
            return None
        uri = self._uri("manifest.json")
        try:
            manifest: Manifest = json.loads(self.storage.read_all(uri, _MAX_MANIFEST_BYTES))
        except ValueError as error:
            raise StorageError(f"{uri} is no JSON: {error}") from error
        return manifest | {"counts": counts_of(manifest)}

    def commit(
        self, rows: RowFile, progress: Progress, driver: str, seen: Seen | None = None
    ) -> Manifest:
        """Put the manifest, unless another driver has; the one that is there then is returned.

        Its `driver` names the writer: the answer to the put may be an earlier try's.
        """
        progress.finish()
        snapshot = progress.snapshot()
        manifest = {
            "schema": MANIFEST_SCHEMA,
            "job": {"name": self.job.name, "namespace": self.job.namespace, "uid": self.job.uid},
            "attempt": self.job.attempt,
            "driver": driver,
            "phase": snapshot["phase"],
            "reason": snapshot["reason"],
            "message": snapshot["message"],
            "verdict": snapshot["verdict"],
            "verdictReason": snapshot["verdictReason"],
            "counts": snapshot["cases"],
            "ledger": snapshot["ledger"],
            "failures": snapshot["failures"],
            "provenance": provenance_of(
                self.job, rows.rows(), seen or Seen(), (progress.began, progress.ended or 0.0)
            )
            | {"catalogue": progress.selection},
            "comparisons": progress.comparisons,
            "quarantine": progress.quarantine,
            "cases": [_manifest_entry(row) for row in rows.rows()],
        }
        data = json.dumps(manifest, indent=1).encode()
        self.storage.put_once(self._uri("manifest.json"), data)
        found = self.committed()
        if found is None:
            raise StorageError(
                f"{self._uri('manifest.json')} was put and is not there: nothing counts yet, and"
                " nothing is removed"
            )
        return found

    def publish(
        self, manifest: Manifest, rows: Callable[[], Iterable[Row]], journal: Journal
    ) -> None:
        """Write results.jsonl as the manifest counts, then remove what does not count.

        May be done again, by another driver too, until the journal is gone, which goes last.
        """
        # PyArrow and Jinja, which a laptop loads while the cases run.
        from bagpipe.driver.artefacts import Artefacts  # noqa: PLC0415

        with Artefacts(self.job, self.storage, self.folder, manifest) as artefacts:
            for row in self._lines(manifest, rows):
                artefacts.add(row)
            artefacts.store(manifest)
        self._remove_uncounted(manifest)
        journal.remove()

    def is_published(self, journal: Journal) -> bool:
        """Whether `publish` has come to its end."""
        return self.storage.exists(self._uri(LINES)) and journal.is_empty()

    def _lines(self, manifest: Manifest, rows: Callable[[], Iterable[Row]]) -> Iterator[Row]:
        """The rows that count, written to results.jsonl as they go by, unless that was done.

        It is not done twice: a journal that somebody was removing no longer has all rows.
        """
        uri = self._uri(LINES)
        if self.storage.exists(uri):
            yield from StoredResults(self.folder, self.storage).rows()
            return
        # A journal's rows may have the marks of a manifest that was edited since.
        quarantine = Quarantine.decided(manifest.get("quarantine"))
        entries = manifest["cases"]
        counted = {_key(entry) for entry in entries}
        # Another version's driver may have stored less of a row.
        stored = entries[0].keys() if entries else set()
        with self.storage.create(uri) as file:
            for row in map(quarantine.marked, rows()):
                entry = {name: of for name, of in _manifest_entry(row).items() if name in stored}
                if (key := _key(entry)) in counted:
                    counted.remove(key)
                    file.write(json.dumps({"schema": CASE_SCHEMA} | row).encode() + b"\n")
                    yield row
            if counted:
                raise StorageError(
                    f"{uri} can't be written: there is no row of case {min(counted)[0]}, one of"
                    f" {len(counted)} that the manifest has and the journal has not"
                )

    def _remove_uncounted(self, manifest: Manifest) -> None:
        """Remove recordings that nothing names; by the manifest that lies there, whoever asks."""
        there = self.committed()
        if there is None or there["driver"] != manifest["driver"]:
            raise StorageError(
                f"{self._uri('manifest.json')} is not the one that was published: no recording was"
                " removed"
            )
        cases = there["cases"]
        counted = {posixpath.basename(name) for case in cases for name in recorded_names(case)}
        for name in self.storage.names(self._uri("cases")):
            if name not in counted:
                self.storage.remove(posixpath.join(self._uri("cases"), name))

    def _uri(self, name: str) -> str:
        return posixpath.join(self.folder, name)


def _key(entry: Mapping[str, Any]) -> tuple[str, str]:
    """A case, and all that its entry in the manifest holds of the row that counts.

    What it recorded is unique to an attempt; where it recorded nothing, the rest distinguishes
    it from another driver's row of the case.
    """
    return entry.get("case", ""), json.dumps(entry, sort_keys=True)


def _manifest_entry(row: Row) -> dict[str, Any]:
    keys = ("case", "outcome", "reason", "recorded", "attempts", "starts")
    return {key: row.get(key) for key in keys} | {
        "discarded": discarded_of(row),
        "quarantined": quarantine_of(row) is not None,
    }
