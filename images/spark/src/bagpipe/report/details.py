"""The cases that the page shows in full: what did not pass, what changed, some that passed."""

import itertools
import json
import zlib
from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

from bagpipe.pictures import MOST_OF_A_PAGE
from bagpipe.report.columns import short
from bagpipe.report.images import images_of
from bagpipe.report.lines import lines_of
from bagpipe.report.series import series_of
from bagpipe.report.spool import Spool
from bagpipe.row_facts import (
    discarded_runs,
    figures_of,
    is_finite,
    pair_of,
    recorded_names,
    run_words,
)

Row = Mapping[str, Any]

# That many are listed below each other; the others open from the table.
MOST_LISTED = 50
# Of all cases in full together, as JSON; and the share that is filled by what did not pass, and by
# that and what changed. What passed has the rest: a failure is understood beside it.
MOST_BYTES = 6_000_000
_SHARES = (0.7, 0.85, 1.0)
_MOST_CASE_BYTES = 64_000
# Kinds of trouble that are distinguished; what differs beyond that many is not chosen.
_MOST_GROUPS = 50
_MOST_OF_A_GROUP = 2000
_STDERR_LINES = 40
_MOST_FIGURES = 4
_LINE_CHARACTERS = 500
_LEDGER_TOPICS = 50
_LEDGER_NODES = 20
_MOST_STARTS = 10
_MOST_RUNS = 50
_MOST_TIMINGS = 50
_MOST_RECORDED = 20
_MOST_NOTES = 20


class Details:
    """Keeps names by kind of trouble, so that many of one kind do not hide the others; what the
    page says of a case is in the spool.
    """

    def __init__(
        self,
        spool: Spool,
        regressed: Collection[str] = (),
        changed: Collection[str] = (),
        most_listed: int = MOST_LISTED,
        most_bytes: int = MOST_BYTES,
    ) -> None:
        self._spool = spool
        self._most = most_listed
        self._most_bytes = most_bytes
        self._regressed = frozenset(regressed)
        self._changed = frozenset(changed)
        self._first: list[str] = []
        self._groups: dict[tuple[Any, ...], list[str]] = {}
        self._passed: list[str] = []

    def add(self, row: Row) -> None:
        """One case. Raises OSError."""
        name = str(row["case"])
        record = {"detail": detail_of(row), "pair": pair_of(row), "images": images_of(row)}
        self._spool.add(name, record)
        if row["outcome"] == "passed":
            self._passed.append(name)
            return
        if name in self._regressed:
            self._first.append(name)
        key = (row["outcome"], row.get("variant"), row.get("reason"), *_not_passed(row))
        if key not in self._groups and len(self._groups) >= _MOST_GROUPS:
            return
        group = self._groups.setdefault(key, [])
        if len(group) < _MOST_OF_A_GROUP:
            group.append(name)

    def listed(self) -> list[str]:
        """What regressed, then by name the first of every other kind of trouble, and so on.

        Of what regressed half of all, so that it does not hide the others.
        """
        first = sorted(self._first)[: self._most // 2]
        chosen = [name for name in self._in_turns() if name not in first]
        return first + sorted(chosen[: self._most - len(first)])

    def _in_turns(self) -> Iterator[str]:
        turns = itertools.zip_longest(*self._groups.values())
        return (name for turn in turns for name in turn if name)

    def in_full(self, among: Collection[str]) -> dict[str, dict[str, Any]]:
        """What is known of each case that is shown in full, those of `listed` first: as many of
        `among` as there is room for. Raises OSError.
        """
        shown: dict[str, dict[str, Any]] = {}
        passed = sorted(self._passed, key=lambda name: (zlib.crc32(name.encode()), name))
        kinds: tuple[Iterable[str], ...] = (
            itertools.chain(self.listed(), sorted(self._first), self._in_turns()),
            [name for name in passed if name in self._changed],
            # By a number that has nothing to do with the name: a sample, and each time the same.
            passed,
        )
        there, taken, pictures = frozenset(among), 0, MOST_OF_A_PAGE
        for names, share in zip(kinds, _SHARES, strict=True):
            for name in names:
                if name in shown or name not in there:
                    continue
                record = self._spool.read(name)
                detail, size = fitting(record["detail"])
                if taken + size > share * self._most_bytes:
                    break
                # They have a bound of their own: a picture is as large as a case.
                images = record["images"]
                shown[name] = detail | _pictured(images, pictures)
                pictures = max(0, pictures - len(images))
                taken += size
        return shown


def fitting(detail: dict[str, Any], most: int = _MOST_CASE_BYTES) -> tuple[dict[str, Any], int]:
    """A case in at most so many bytes, and these: without its last courses where it has more."""
    size = len(json.dumps(detail))
    while size > most and detail["series"]:
        left = detail.get("left", 0) + 1
        detail = detail | {"series": detail["series"][:-1], "left": left}
        size = len(json.dumps(detail))
    return detail, size


def _pictured(images: list[dict[str, Any]], room: int) -> dict[str, Any]:
    """As many images as there is room for, and how many were left out."""
    kept = images[:room]
    return {"images": kept, "unseen": len(images) - len(kept)} if images else {}


def _not_passed(row: Row) -> list[str]:
    return [f["name"] for f in row.get("criteria") or [] if f["outcome"] != "passed"]


def detail_of(row: Row) -> dict[str, Any]:
    """What the page says of one case beyond its line in the table."""
    result = row.get("result") or {}
    evidence = row.get("evidence") or {}
    stack = result.get("stack") or {}
    ledger = result.get("ledger") or evidence.get("ledger") or {}
    stderr = row.get("stderr") or stack.get("stderr") or []
    stderr = [str(line)[:_LINE_CHARACTERS] for line in stderr[-_STDERR_LINES:]]
    return {
        "message": str(row.get("message") or "")[:4000],
        "stderr": stderr,
        "lines": lines_of(row, stderr),
        "criteria": [_finding(finding) for finding in row.get("criteria") or []],
        "bag": str(row.get("bag") or ""),
        "window": _window(row),
        "recorded": [str(name)[:1000] for name in recorded_names(row)[:_MOST_RECORDED]],
        "ledger": _ledger(ledger),
        "discarded": [
            run_words(run)[:_LINE_CHARACTERS] for run in discarded_runs(row)[:_MOST_RUNS]
        ],
        "strength": str(ledger.get("strength") or ""),
        "notes": _notes(result.get("playback") or {}),
        "machine": _machine(result.get("machine") or evidence.get("machine") or {}),
        "lost": [lost_start(start) for start in (evidence.get("starts") or [])[:_MOST_STARTS]],
        "timings": {
            str(name): seconds
            for name, seconds in list((result.get("timings") or {}).items())[:_MOST_TIMINGS]
            if is_finite(seconds)
        },
        "series": series_of(row),
    }


def _finding(finding: Mapping[str, Any]) -> dict[str, str]:
    """What a criterion found, in words; `figures` are all of them, where it has several."""
    words = {key: finding.get(key) for key in ("name", "kind", "outcome", "covered", "message")}
    figures = figures_of(finding)[:_MOST_FIGURES]
    words["limit"] = "; ".join(str(each["limit"]) for each in figures if each.get("limit"))
    if len(figures) > 1:
        words["figures"] = "; ".join(map(_figure, figures))
    return {key: str(text or "")[:1000] for key, text in words.items()}


def _figure(measured: Mapping[str, Any]) -> str:
    figure = measured.get("figure")
    shown = "–" if figure is None else short(figure) if is_finite(figure) else "infinite"
    return f"{shown} {measured.get('unit') or ''}".strip()


def _window(row: Row) -> list[int] | None:
    """Nanoseconds of the lead-in's start, the start and the end; None where it has none."""
    window = row.get("window")
    if not isinstance(window, list) or len(window) != 3:
        return None
    return window if all(isinstance(time, int) for time in window) else None


def lost_start(start: Mapping[str, Any]) -> str:
    """A line for a start of a case that came to no end."""
    seconds = start.get("seconds")
    after = f" after {seconds:.1f} s" if is_finite(seconds) else ""
    error = " ".join(str(start.get("error") or "Spark does not say why").split())
    where = f"executor {start.get('executor')} at {start.get('host')}"
    return f"{where}{after}: {error}"[:_LINE_CHARACTERS]


def _machine(machine: Mapping[str, Any]) -> dict[str, Any]:
    """What was measured of the machine while the case played: a sentence, and figures."""
    return {
        "message": str(machine.get("message") or "")[:_LINE_CHARACTERS],
        "figures": {
            name.removesuffix("_seconds").replace("_", " "): figure
            for name, figure in machine.items()
            if name.endswith("_seconds") and is_finite(figure)
        },
    }


def _notes(playback: Mapping[str, Any]) -> list[str]:
    """What users should know of the way it was played, as sentences."""
    warnings = list(playback.get("warnings") or [])[:_MOST_NOTES]
    notes = [*warnings, *filter(None, [playback.get("pace")])]
    return [str(note)[:_LINE_CHARACTERS] for note in notes]


def _ledger(ledger: Mapping[str, Any]) -> list[dict[str, Any]]:
    """One line for each topic and node."""
    return [
        {
            "topic": topic.get("topic"),
            "sent": short(topic.get("sent"), 12),
            "node": node.get("node", ""),
            "received": short(node.get("received"), 12),
            "dropped": short(node.get("dropped"), 12),
            "strength": node.get("strength") or "",
            "queue": short(node.get("queue"), 12),
        }
        for topic in (ledger.get("topics") or [])[:_LEDGER_TOPICS]
        for node in (topic.get("subscribers") or [{}])[:_LEDGER_NODES]
    ]
