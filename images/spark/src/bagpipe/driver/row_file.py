"""The rows of a job on the driver's own disk: one per case.

A row holds a case's whole ledger and can be some kilobytes; the driver of a hundred thousand
cases keeps only where each one lies.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Self

from bagpipe.run.case_run import Row


class RowFile:
    """Rows by case. Memory: a case's name and two integers for each, whatever its row holds."""

    def __init__(self, path: Path) -> None:
        # Unbuffered, so that a full disk is met by the row that it has no room for.
        self._file = path.open("w+b", buffering=0)
        self._places: dict[str, tuple[int, int]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, case: str) -> bool:
        return case in self._places

    def add(self, row: Row) -> bool:
        """Keep a row; False where its case has one already, which stays.

        Raises OSError, and the case has no row then.
        """
        if row["case"] in self._places:
            return False
        self.replace(row)
        return True

    def replace(self, row: Row) -> None:
        """Keep a row in place of its case's one, if there is one. Raises OSError."""
        data = json.dumps(row).encode()
        place = (self._file.seek(0, 2), len(data))
        rest = memoryview(data)
        while rest:
            rest = rest[self._file.write(rest) :]
        self._places[row["case"]] = place

    def rows(self) -> Iterator[Row]:
        """All rows in the order of the case names."""
        for case in sorted(self._places):
            offset, length = self._places[case]
            self._file.seek(offset)
            row: Row = json.loads(self._file.read(length))
            yield row
