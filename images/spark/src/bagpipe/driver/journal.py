"""What a job has already finished, kept beside its results: a driver that takes over reads it.

A journal is a folder of segments, each a few rows as JSON Lines. A segment appears whole or not
at all and its name is one driver's own, so that two drivers can never write the same one.
"""

import json
import posixpath
import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageError

FOLDER = "journal"
# A row without its figures is below 64 KiB; a segment is what came in a few seconds.
_MAX_SEGMENT_BYTES = 256 << 20
# Of those that are written here, but for a row that is larger by itself.
_SEGMENT_BYTES = 32 << 20


@dataclass
class Journal:
    """The journal in a job's results folder."""

    storage: Storage
    results: str
    attempt: int
    # Unique to this driver, also among those of the same attempt.
    driver: str = field(default_factory=lambda: uuid.uuid4().hex[:12])
    _written: int = 0

    def rows(self) -> Iterator[Row]:
        """The rows of all segments, the oldest attempt's first. Raises StorageError."""
        for name in self._names():
            uri = self._uri(name)
            for number, line in enumerate(
                self.storage.read_all(uri, _MAX_SEGMENT_BYTES).splitlines(), start=1
            ):
                yield read_row(line, uri, number)

    def append(self, rows: Sequence[Row]) -> int:
        """Write the first of the rows as a segment of their own; how many these are.

        Raises StorageError, and can be tried again.
        """
        # Also for another try: a write that was given up may still come, over what is new.
        name = f"{self.attempt:04d}-{self.driver}-{self._written:06d}.jsonl"
        self._written += 1
        written = kept = 0
        with self.storage.create(self._uri(name)) as file:
            for row in rows:
                line = json.dumps(row).encode() + b"\n"
                if kept and written + len(line) > _SEGMENT_BYTES:
                    break
                file.write(line)
                written, kept = written + len(line), kept + 1
        return kept

    def is_empty(self) -> bool:
        """Whether no segment was ever written, or all were removed. Raises StorageError."""
        return not self._names()

    def remove(self) -> None:
        """Remove all segments, when a manifest has made them needless."""
        for name in self._names():
            self.storage.remove(self._uri(name))

    def _names(self) -> list[str]:
        names = self.storage.names(posixpath.join(self.results, FOLDER))
        return [name for name in names if name.endswith(".jsonl")]

    def _uri(self, name: str) -> str:
        return posixpath.join(self.results, FOLDER, name)


def read_row(line: bytes, uri: str, number: int) -> Row:
    """A row from its line of a JSON Lines file. Raises StorageError that names the line."""
    try:
        row = json.loads(line)
    except ValueError as error:
        raise StorageError(
            f"{uri} line {number} is no row of a journal ({error}): remove the file, and its"
            " cases run again"
        ) from error
    if not isinstance(row, dict) or not isinstance(row.get("case"), str):
        raise StorageError(
            f"{uri} line {number} names no case: remove the file, and its cases run again"
        )
    return row
