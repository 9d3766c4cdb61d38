"""A catalogue's rows: what a table of any format gives to the selection."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

# A catalogue of drives has a row for each: more is another kind of table.
MOST_ROWS = 2_000_000
MOST_COLUMNS = 1_000
URI = "uri"


@dataclass(frozen=True)
class Row:
    """One row: where it stands, such as `line 7`, its URI, and the values of the asked columns."""

    place: str
    uri: str
    values: dict[str, Any]


class Table(Protocol):
    """A file that was opened; `kinds` and `rows` raise CatalogueError for what can't be read."""

    @property
    def columns(self) -> list[str]:
        """All names, in their order."""

    def kinds(self, columns: list[str], /) -> dict[str, str]:
        """What these columns hold, in words, such as `whole numbers`."""

    def rows(self, columns: list[str], /) -> Iterator[Row]:
        """All rows with the values of these columns, None for one that is empty."""
