"""A catalogue as CSV: comma-separated UTF-8 with a header, each column of the kind that all its
cells can be read as."""

import csv
import re
from collections.abc import Callable, Iterator
from datetime import datetime
from pathlib import Path
from typing import Any, TextIO

from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.catalogue.rows import MOST_COLUMNS, MOST_ROWS, URI, Row

MOST_LINE = 1 << 20
_MOST_CELL = 1 << 16
_LARGEST = 2**63 - 1
_WHOLE = re.compile(r"-?(0|[1-9][0-9]{0,18})")
_NUMBER = re.compile(r"-?(0|[1-9][0-9]{0,30})([.][0-9]{1,40})?([eE][-+]?[0-9]{1,3})?")
_TEXT = "text"


def _truth(cell: str) -> bool:
    return {"true": True, "True": True, "false": False, "False": False}[cell]


def _whole(cell: str) -> int:
    """A number with a leading zero is a name, such as 007."""
    if not _WHOLE.fullmatch(cell) or abs(found := int(cell)) > _LARGEST:
        raise ValueError(cell)
    return found


def _number(cell: str) -> float:
    if not _NUMBER.fullmatch(cell):
        raise ValueError(cell)
    return float(cell)


def _moment(cell: str) -> datetime:
    found = datetime.fromisoformat(cell)
    if found.tzinfo is None:
        raise ValueError(cell)
    return found


# In words; the first that all cells can be read as is a column's kind.
_KINDS: dict[str, Callable[[str], Any]] = {
    "true and false": _truth, "whole numbers": _whole, "numbers": _number,
    "moments with an offset": _moment,
}  # fmt: skip


class CsvTable:
    """One file; `uri` is its name in sentences. Raises CatalogueError."""

    def __init__(self, path: Path, uri: str) -> None:
        self._path, self._uri = path, uri
        self._found: dict[str, tuple[str, str]] = {}
        header = next(self._records(), (1, []))[1]
        self.columns = header
        if len(header) > MOST_COLUMNS:
            raise CatalogueError(
                f"{uri} has {len(header)} columns, and may have {MOST_COLUMNS}: leave some out"
            )
        twice = sorted({name for name in header if header.count(name) > 1})
        if twice:
            raise CatalogueError(f"{uri} line 1: two columns are called {twice[0]!r}: rename one")

    def kinds(self, columns: list[str]) -> dict[str, str]:
        """Of each column the kind, and for text the first cell that made it so."""
        missing = [name for name in columns if name not in self._found]
        possible = {name: list(_KINDS) for name in missing}
        spoilt = dict.fromkeys(missing, "")
        filled = set[str]()
        places = [(name, self.columns.index(name)) for name in missing]
        for line, cells in self._cells() if missing else ():
            for name, at in places:
                if not cells[at] or not possible[name]:
                    continue
                filled.add(name)
                possible[name] = [kind for kind in possible[name] if _reads(kind, cells[at])]
                if not possible[name]:
                    spoilt[name] = f", as line {line} has {cells[at][:40]!r}"
        for name in missing:
            kind = possible[name][0] if name in filled and possible[name] else _TEXT
            self._found[name] = (kind, spoilt[name])
        return {name: "".join(self._found[name]) for name in columns}

    def rows(self, columns: list[str]) -> Iterator[Row]:
        """Of text an empty cell is empty text, of every other kind it is no value."""
        self.kinds(columns)
        uri = self.columns.index(URI)
        readers = [
            (name, self.columns.index(name), _KINDS.get(self._found[name][0])) for name in columns
        ]
        for line, cells in self._cells():
            values = {
                name: cells[at] if read is None else read(cells[at]) if cells[at] else None
                for name, at, read in readers
            }
            yield Row(f"line {line}", cells[uri], values)

    def _cells(self) -> Iterator[tuple[int, list[str]]]:
        records = self._records()
        next(records, None)
        for count, (line, cells) in enumerate(records, start=1):
            if count > MOST_ROWS:
                raise CatalogueError(
                    f"{self._uri} has more than {MOST_ROWS:,} rows: split the catalogue"
                )
            if len(cells) != len(self.columns):
                raise CatalogueError(
                    f"{self._uri} line {line} has {len(cells)} cells where the header has"
                    f" {len(self.columns)}: correct it, or quote a cell that holds a comma"
                )
            yield line, cells

    def _records(self) -> Iterator[tuple[int, list[str]]]:
        """Each record that is not blank, with the number of its last line."""
        csv.field_size_limit(_MOST_CELL)
        with self._path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(self._lines(file), strict=True)
            while True:
                try:
                    cells = next(reader)
                except StopIteration:
                    return
                except csv.Error as error:
                    raise CatalogueError(
                        f"{self._uri} line {reader.line_num} is no CSV: {error}"
                    ) from error
                except UnicodeDecodeError as error:
                    raise CatalogueError(
                        f"{self._uri} is no UTF-8 behind line {reader.line_num}: {error.reason}"
                    ) from error
                if cells:
                    yield reader.line_num, cells

    def _lines(self, file: TextIO) -> Iterator[str]:
        """A line without an end would be held whole, however long."""
        number = 0
        while line := file.readline(MOST_LINE + 1):
            number += 1
            if len(line) > MOST_LINE:
                raise CatalogueError(
                    f"{self._uri} line {number} is longer than {MOST_LINE:,} letters: is it CSV?"
                )
            yield line


def _reads(kind: str, cell: str) -> bool:
    try:
        _KINDS[kind](cell)
    except (ValueError, KeyError):
        return False
    return True
