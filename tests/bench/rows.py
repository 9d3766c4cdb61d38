"""What every bench gives: rows, one file of results, one table.

A row compares raw runs of ours with raw runs of a peer, taken in turn on the same machine. Its
ratio says how many times better ours is, whatever is better: more per second, or fewer
seconds. `target` is the least ratio that the project wants, or None.
"""

import json
import os
import platform
import statistics
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

Json = dict[str, Any]
RESULTS = Path(os.environ.get("BENCH_RESULTS") or Path(__file__).parent / "results")
LESS_IS_BETTER = frozenset({"s", "ms", "us", "KiB", "MB", "MiB", "messages", "objects"})


@dataclass(frozen=True)
class Row:
    """One comparison: `case`, `metric` and `unit` say of what."""

    case: str
    metric: str
    unit: str
    ours: Sequence[float]
    peer: str
    theirs: Sequence[float]
    target: float | None = None

    @property
    def ratio(self) -> float | None:
        """The medians' ratio, better is larger; None without a peer's runs."""
        if not self.ours or not self.theirs:
            return None
        ours, theirs = statistics.median(self.ours), statistics.median(self.theirs)
        better, worse = (theirs, ours) if self.unit in LESS_IS_BETTER else (ours, theirs)
        return better / worse if worse else None

    @property
    def missed(self) -> bool:
        return self.target is not None and self.ratio is not None and self.ratio < self.target


@dataclass(frozen=True)
class Load:
    """One of a bench's loads that do not depend on each other: its rows, or why there are none."""

    name: str
    rows: Sequence[Row] = ()
    failure: str = ""


def write(bench: str, rows: Sequence[Row], versions: Mapping[str, str], note: str) -> Path:
    """Writes results/<bench>.json and returns its path."""
    return _keep(_document(bench, [_as_object(row) for row in rows], versions, note))


def merge(bench: str, rows: Sequence[Row], versions: Mapping[str, str], note: str) -> Path:
    """Puts rows into results/<bench>.json, in which those of other loads stay; returns its path.

    Each row says when and at which commit it was measured; the rest is the last writer's.
    """
    path = RESULTS / f"{bench}.json"
    before = json.loads(path.read_text()) if path.exists() else {"rows": []}
    document = _document(bench, [], versions, note)
    now, then = _origin(document), _origin(before)
    new = {_key(row): row | now for row in map(_as_object, rows)}
    kept = [new.pop(_key(row), then | row) for row in before["rows"]]
    return _keep(document | {"rows": [*kept, *new.values()]})


def _document(bench: str, rows: Sequence[Json], versions: Mapping[str, str], note: str) -> Json:
    return {
        "bench": bench,
        "when": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "machine": machine(),
        "versions": dict(versions),
        "note": note,
        "rows": list(rows),
    }


def _as_object(row: Row) -> Json:
    return {
        "case": row.case,
        "metric": row.metric,
        "unit": row.unit,
        "ours": list(row.ours),
        "peer": row.peer,
        "theirs": list(row.theirs),
        "ratio": row.ratio,
        "target": row.target,
    }


def _key(row: Json) -> tuple[str, str, str]:
    return row["case"], row["metric"], row["peer"]


def _origin(document: Json) -> Json:
    return {key: document[key] for key in ("when", "commit") if key in document}


def _keep(document: Json) -> Path:
    RESULTS.mkdir(parents=True, exist_ok=True)
    path = RESULTS / f"{document['bench']}.json"
    path.write_text(json.dumps(document, indent=1) + "\n")
    return path


def commit() -> str:
    """The commit that was measured, with a + when files differ from it."""
    described = subprocess.run(
        ["git", "describe", "--always", "--abbrev=12", "--dirty=+"],
        cwd=Path(__file__).parent,
        capture_output=True,
        text=True,
        check=False,
    )
    return described.stdout.strip() or "unknown"


def machine() -> dict[str, str | int | float]:
    """Processor, processors, memory, kernel, and how busy it was when the bench ended."""
    info = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in info if line.startswith("model name")]
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "processor": names[0] if names else platform.machine(),
        "processors": os.cpu_count() or 1,
        "memory_bytes": memory,
        "kernel": platform.release(),
        "load_average": os.getloadavg()[0],
    }


def amount(value: float, unit: str) -> str:
    """A value as one reads it: millions of messages, few digits."""
    if unit == "msg/s":
        return f"{value / 1e6:.2f}M" if value >= 1e6 else f"{value / 1e3:.0f}k"
    digits = 3 if value < 10 else 1 if value < 100 else 0
    return f"{value:,.{digits}f}"


def spread(values: Sequence[float], unit: str) -> str:
    """Median, and the least and the most in parentheses."""
    if not values:
        return "-"
    middle = f"{amount(statistics.median(values), unit)} {unit}"
    if len(values) == 1:
        return middle
    return f"{middle} ({amount(min(values), unit)}-{amount(max(values), unit)})"


def table(rows: Sequence[Row]) -> str:
    """The rows as Markdown."""
    lines = [
        "| case | metric | ours: median (min-max) | peer | theirs | ratio | target |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        ratio = "-" if row.ratio is None else f"{row.ratio:.2f}"
        target = "-" if row.target is None else f"{row.target:g}"
        target += " (missed)" if row.missed else ""
        cells = [row.case, row.metric, spread(row.ours, row.unit), row.peer]
        lines.append(
            "| " + " | ".join([*cells, spread(row.theirs, row.unit), ratio, target]) + " |"
        )
    return "\n".join(lines)
