"""Cases in full on the disk of whoever makes the page: which it shows is known at the end."""

import json
import tempfile
import zlib
from typing import IO, Any


class Spool:
    """Maps by name, as JSON. Memory: a name and two integers for each."""

    def __init__(self) -> None:
        self._opened: IO[bytes] | None = None
        self._places: dict[str, tuple[int, int]] = {}
        self._end = 0

    def add(self, name: str, record: dict[str, Any]) -> None:
        """Keep a map; of one name the first stays. Raises OSError."""
        if name in self._places:
            return
        data = zlib.compress(json.dumps(record, default=str).encode(), 1)
        file = self._file()
        file.seek(self._end)
        file.write(data)
        self._places[name] = (self._end, len(data))
        self._end += len(data)

    def read(self, name: str) -> dict[str, Any]:
        """The map of a name. Raises OSError and KeyError."""
        offset, length = self._places[name]
        file = self._file()
        file.seek(offset)
        found: dict[str, Any] = json.loads(zlib.decompress(file.read(length)))
        return found

    def _file(self) -> IO[bytes]:
        """Made when it is first needed: without room for it the page fails, and nothing else."""
        if self._opened is None:
            self._opened = tempfile.TemporaryFile()  # noqa: SIM115  open as long as this is
        return self._opened
