"""The process that reads a catalogue: `python -P -m bagpipe.source.catalogue.process`.

It has the file, the expression and nothing else of the job: no credential, and bounds of memory
and time that neither the one nor the other can get past. It answers on stdout as JSON.
"""

import json
import resource
import sys
from pathlib import Path
from typing import Any

from bagpipe.source.catalogue.csv_table import CsvTable
from bagpipe.source.catalogue.faults import CatalogueError
from bagpipe.source.catalogue.parquet_table import ParquetTable
from bagpipe.source.catalogue.rows import Table
from bagpipe.source.catalogue.selecting import Choice


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    choice = Choice(**request["choice"])
    try:
        found = choice.of(_table(Path(request["path"]), choice.uri))
    except CatalogueError as error:
        return {"fault": str(error)}
    except MemoryError:
        return {"memory": True}
    return {"uris": found.uris, "rows": found.rows, "selected": found.selected}


def _table(path: Path, uri: str) -> Table:
    return CsvTable(path, uri) if uri.endswith(".csv") else ParquetTable(path, uri)


def main() -> None:
    """Answers one request."""
    request = json.load(sys.stdin)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (request["memory"], request["memory"]))
    # The first ends it by a signal of its own, by which it is known what ended it.
    resource.setrlimit(resource.RLIMIT_CPU, (request["seconds"], request["seconds"] + 5))
    json.dump(_answer(request), sys.stdout)


if __name__ == "__main__":
    main()
