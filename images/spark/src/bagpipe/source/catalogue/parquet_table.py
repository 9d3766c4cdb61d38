"""A catalogue as Parquet, of which the asked columns alone are read, some rows at a time."""

from collections.abc import Iterator
from datetime import UTC, date, datetime, time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.catalogue.rows import MOST_COLUMNS, MOST_ROWS, URI, Row

if TYPE_CHECKING:
    import pyarrow as pa

_ROWS_AT_ONCE = 4096
_BUFFER_BYTES = 1 << 20
# Of what the file's own description of itself may ask for.
_MOST_FOOTER = 16 << 20


class ParquetTable:
    """One file; `uri` is its name in sentences. Raises CatalogueError."""

    def __init__(self, path: Path, uri: str) -> None:
        try:
            import pyarrow as pa  # noqa: PLC0415  it takes 0.3 s, and CSV does without
            from pyarrow import parquet  # noqa: PLC0415
        except ImportError as error:
            raise CatalogueError(
                f"{uri} is Parquet, and pyarrow is not installed: install bagpipe with its extra"
                " run, or write the catalogue as CSV"
            ) from error
        self._arrow, self._uri = pa, uri
        try:
            self._file = parquet.ParquetFile(
                path, buffer_size=_BUFFER_BYTES, pre_buffer=False,
                thrift_string_size_limit=_MOST_FOOTER, thrift_container_size_limit=_MOST_FOOTER,
            )  # fmt: skip
            self._schema = self._file.schema_arrow
        except (pa.ArrowException, OSError, ValueError) as error:
            if isinstance(error, MemoryError):
                raise
            raise CatalogueError(f"{uri} is no Parquet: {_first_line(error)}") from error
        if self._file.metadata.num_rows > MOST_ROWS:
            raise CatalogueError(
                f"{uri} has {self._file.metadata.num_rows:,} rows, and may have {MOST_ROWS:,}:"
                " split the catalogue"
            )
        self.columns: list[str] = list(self._schema.names)
        if len(self.columns) > MOST_COLUMNS:
            raise CatalogueError(
                f"{uri} has {len(self.columns)} columns, and may have {MOST_COLUMNS}: leave some"
                " out"
            )
        twice = sorted({name for name in self.columns if self.columns.count(name) > 1})
        if twice:
            raise CatalogueError(f"{uri}: two columns are called {twice[0]!r}: rename one")

    def kinds(self, columns: list[str]) -> dict[str, str]:
        """What their types are called in Parquet."""
        for name in columns:
            kind = self._schema.field(name).type
            if not self._is_usable(kind):
                raise CatalogueError(
                    f"{self._uri}: the column {name} is of type {kind}, which an expression can't"
                    " read: write text, numbers, true and false, timestamps, or lists of these"
                )
        return {name: str(self._schema.field(name).type) for name in columns}

    def rows(self, columns: list[str]) -> Iterator[Row]:
        """Rows are counted from 1."""
        self.kinds(columns)
        kind = self._schema.field(URI).type
        if not self._is_text(kind):
            raise CatalogueError(f"{self._uri}: the column {URI} is of type {kind}: write text")
        asked = list(dict.fromkeys([URI, *columns]))
        number = 0
        try:
            for batch in self._file.iter_batches(_ROWS_AT_ONCE, columns=asked, use_threads=False):
                lists = {name: self._values(batch.column(name)) for name in asked}
                for at, uri in enumerate(lists[URI]):
                    number += 1
                    if number > MOST_ROWS:
                        raise CatalogueError(f"{self._uri} has more than {MOST_ROWS:,} rows")
                    values = {name: _utc(lists[name][at]) for name in columns}
                    yield Row(f"row {number}", uri or "", values)
        except (self._arrow.ArrowException, OSError, ValueError) as error:
            if isinstance(error, CatalogueError | MemoryError):
                raise
            raise CatalogueError(
                f"{self._uri} can't be read behind row {number}: {_first_line(error)}"
            ) from error

    def _values(self, column: "pa.Array") -> list[Any]:
        types = self._arrow.types
        if types.is_timestamp(column.type):
            # Python's moments have microseconds.
            column = column.cast(self._arrow.timestamp("us", column.type.tz), safe=False)
        values: list[Any] = column.to_pylist()
        return values

    def _is_text(self, kind: "pa.DataType") -> bool:
        types = self._arrow.types
        if types.is_dictionary(kind):
            kind = kind.value_type
        return bool(types.is_string(kind) or types.is_large_string(kind))

    def _is_usable(self, kind: "pa.DataType") -> bool:
        types = self._arrow.types
        if types.is_list(kind) or types.is_large_list(kind):
            inner = kind.value_type
            return not types.is_list(inner) and self._is_plain(inner)
        return self._is_plain(kind) or bool(types.is_timestamp(kind) or types.is_date(kind))

    def _is_plain(self, kind: "pa.DataType") -> bool:
        types = self._arrow.types
        tests = (types.is_boolean, types.is_integer, types.is_floating, self._is_text)
        return any(test(kind) for test in tests)


def _utc(value: Any) -> Any:
    """A moment without a zone is taken as UTC, and a day as its beginning."""
    if isinstance(value, datetime):
        return value if value.tzinfo is not None else value.replace(tzinfo=UTC)
    return datetime.combine(value, time(), UTC) if isinstance(value, date) else value


def _first_line(error: BaseException) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:300]
