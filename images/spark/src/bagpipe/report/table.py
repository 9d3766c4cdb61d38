"""results.parquet: one line per case, with typed columns, for pandas, DuckDB and Spark."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from bagpipe.row_facts import discarded_runs, quarantine_words

Row = Mapping[str, Any]

_MEASURED = [
    ("outcome", pa.string()),
    ("figure", pa.float64()),
    ("unit", pa.string()),
    ("limit", pa.string()),
]
_BOUND = pa.struct([*_MEASURED, ("direction", pa.string()), ("measures", pa.string())])
_CRITERION = pa.struct(
    [
        ("name", pa.string()),
        ("kind", pa.string()),
        *_MEASURED,
        ("message", pa.string()),
        ("expected_failure", pa.bool_()),
        ("coverage", pa.float64()),
        ("covered", pa.string()),
        ("clock", pa.string()),
        ("figures", pa.list_(_BOUND)),
        ("measures", pa.string()),
    ]
)
_FIGURES = [field.name for field in _CRITERION]
SCHEMA = pa.schema(
    [
        ("case", pa.string()),
        ("fragment", pa.string()),
        ("variant", pa.string()),
        ("scenario", pa.int64()),
        ("values", pa.string()),
        ("seed", pa.int64()),
        ("round", pa.int64()),
        ("bag", pa.string()),
        ("window_start_ns", pa.int64()),
        ("window_end_ns", pa.int64()),
        ("outcome", pa.string()),
        ("reason", pa.string()),
        ("message", pa.string()),
        ("attempts", pa.int64()),
        ("discarded", pa.list_(pa.string())),
        ("quarantine", pa.string()),
        ("seconds", pa.float64()),
        ("sent", pa.int64()),
        ("received", pa.int64()),
        ("dropped", pa.int64()),
        ("recorded_messages", pa.int64()),
        ("criteria", pa.list_(_CRITERION)),
    ],
    metadata={"schema": "sim.bagpipe.io/results/v1alpha1"},
)
_BATCH = 10_000


class TableWriter:
    """Writes rows in batches; its memory is one batch."""

    def __init__(self, path: Path) -> None:
        self._writer = pq.ParquetWriter(path, SCHEMA, compression="zstd")
        self._batch: list[dict[str, Any]] = []

    def add(self, row: Row) -> None:
        """One case."""
        self._batch.append(_line(row))
        if len(self._batch) >= _BATCH:
            self._flush()

    def finish(self) -> None:
        """Writes the rest and the footer; nothing can be added afterwards."""
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        if self._batch:
            self._writer.write_table(pa.Table.from_pylist(self._batch, schema=SCHEMA))
            self._batch = []


def _line(row: Row) -> dict[str, Any]:
    result = row.get("result") or {}
    ledger = result.get("ledger") or {}
    window = row.get("window") or [None, None, None]
    return {
        **{name: row.get(name) for name in SCHEMA.names if name in row},
        "discarded": [run["reason"] for run in discarded_runs(row)],
        "quarantine": quarantine_words(row) or None,
        "values": json.dumps(row.get("values") or {}, sort_keys=True),
        "window_start_ns": window[1],
        "window_end_ns": window[2],
        **{name: ledger.get(name) for name in ("sent", "received", "dropped")},
        "recorded_messages": (result.get("recorded") or {}).get("messages"),
        "criteria": [
            {name: finding.get(name) for name in _FIGURES} for finding in row.get("criteria") or []
        ],
    }
