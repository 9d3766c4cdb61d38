"""report.html: one page that needs no network, made of a frame, data and some scripts of ours.

Whatever a job, a stack or a recording has written is hostile here: the frame escapes it (jinja2's
autoescape), the data travels as JSON in which no tag can begin, the scripts set text and never
HTML, and the page's own policy forbids every script but these and every request.
"""

import base64
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from typing import Any

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from bagpipe.quarantine import remark
from bagpipe.report.baselines import Baselines
from bagpipe.report.causes import Causes
from bagpipe.report.columns import Columns, short
from bagpipe.report.details import Details
from bagpipe.report.provenance import facts_of
from bagpipe.report.spool import Spool
from bagpipe.report.words import headline, sentence
from bagpipe.row_facts import counts_of, is_finite
from bagpipe.spec import SimulationJobSpec

Row = Mapping[str, Any]

# In this order: each uses those before it.
_SCRIPTS = (
    "dom.js", "data.js", "filters.js", "heat_map.js", "criteria.js", "cases.js", "axes.js",
    "plane.js", "charts.js", "images.js", "details.js", "causes.js", "main.js",
)  # fmt: skip


class Report:
    """Takes every counted row once; then makes the page."""

    def __init__(
        self,
        spec: SimulationJobSpec | None,
        results: str,
        comparisons: Sequence[Mapping[str, Any]] = (),
    ) -> None:
        """`comparisons` may be given before the rows, so that what regressed is shown in full."""
        self._spec = spec
        self._results = results
        self._regressed = regressed_cases(comparisons)
        self._causes = Causes()
        variants = [variant.name for variant in spec.variants] if spec else []
        self._columns = Columns(variants)
        self._spool = Spool()
        self._details = Details(self._spool, self._regressed, changed_cases(comparisons))
        first = variants[0] if len(variants) > 1 and not (spec and spec.baseline) else None
        self._baselines = Baselines(self._spool, first)
        self._earlier: dict[str, dict[str, Any]] = {}
        self._seconds = 0.0

    def add(self, row: Row) -> None:
        """One row that counts."""
        self._columns.add(row)
        self._details.add(row)
        self._causes.add(row)
        self._baselines.add(row)
        self._seconds += float(row["seconds"]) if is_finite(row.get("seconds")) else 0.0

    def add_earlier(self, rows: Iterable[Row]) -> None:
        """The rows of an earlier job that is the baseline, after all others; they are looked at
        once. Raises what they raise, and the page is made without.
        """
        self._earlier = self._baselines.of_earlier(self._in_full(), rows)

    def html(
        self, manifest: Mapping[str, Any], comparisons: Sequence[Mapping[str, Any]] = ()
    ) -> bytes:
        """The page, from what was added alone: nothing is read for it."""
        data = self._columns.as_json() | {"details": self._in_full(), "replay": self._replay()}
        data["listed"] = [name for name in self._details.listed() if name in data["details"]]
        data["baselines"] = self._earlier or self._baselines.of(data["details"])
        counted = dict(manifest) | {"counts": _counted(manifest, comparisons)}
        data["causes"] = self._causes.as_json(data["cases"]["case"])
        data["regressed"] = regressed_cases(comparisons)
        return render(
            data,
            job=manifest["job"],
            headline=headline(counted),
            sentence=sentence(manifest, data),
            manifest=counted,
            provenance=facts_of(manifest),
            quarantine=_ruled(manifest),
            comparisons=[_drawn(comparison) for comparison in comparisons],
            results=self._results,
            stack_seconds=self._seconds,
        )

    def _in_full(self) -> dict[str, dict[str, Any]]:
        return self._details.in_full([str(row["case"]) for row in self._columns.rows()])

    def _replay(self) -> dict[str, Any]:
        """What `bagpipe replay` has to be given: the results, and the claims to stand in for."""
        uris = [self._results, *(self._spec.source.uris if self._spec else [])]
        claims = [uri.removeprefix("pvc://").split("/")[0] for uri in uris if uri[:6] == "pvc://"]
        return {"results": self._results, "claims": list(dict.fromkeys(claims))}


def render(data: Mapping[str, Any], **words: Any) -> bytes:
    """The frame around the data; `words` are what page/report.html.j2 names."""
    page = files("bagpipe.report").joinpath("page")
    style = page.joinpath("report.css").read_text()
    parts = [page.joinpath(name).read_text() for name in _SCRIPTS]
    script = "(() => {\n'use strict';\n" + "\n".join(parts) + "})();\n"
    # StrictUndefined: a name that is missing is a fault of ours, and no empty place in a verdict.
    frame = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True)
    frame.filters["figure"] = _figure
    text = frame.from_string(page.joinpath("report.html.j2").read_text()).render(
        data=Markup(_safe_json(data)),  # noqa: S704  _safe_json leaves nothing that begins a tag
        style=Markup(style),  # noqa: S704  our own file
        script=Markup(script),  # noqa: S704  our own files
        style_hash=_hash(style),
        script_hash=_hash(script),
        **words,
    )
    return text.encode("utf-8", errors="replace")


def _safe_json(data: Mapping[str, Any]) -> str:
    r"""JSON that holds none of < > &, so that no tag and no comment can begin in it."""
    try:
        text = json.dumps(data, separators=(",", ":"), allow_nan=False, default=str)
    except ValueError:  # a variable of the matrix may be no number, which JSON has not
        text = json.dumps(_as_words(data), separators=(",", ":"), allow_nan=False, default=str)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _as_words(data: Any) -> Any:
    """The data with a word for each number that JSON has not: nan, inf."""
    if isinstance(data, Mapping):
        return {str(key): _as_words(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [_as_words(value) for value in data]
    return str(data) if isinstance(data, float) and not is_finite(data) else data


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"sha256-{base64.b64encode(digest).decode()}"


def _figure(value: Any) -> str:
    """A number as people read it; a dash where there is none."""
    figure = short(value)
    if figure is None:
        return "–"
    return f"{figure:,.0f}" if figure == int(figure) and abs(figure) < 1e9 else f"{figure:.4g}"


def _counted(
    manifest: Mapping[str, Any], comparisons: Sequence[Mapping[str, Any]]
) -> dict[str, int]:
    """A manifest's counts; one of before did not have its comparisons."""
    counts = counts_of(manifest)
    compared = sum(comparison["counts"]["regressed"] for comparison in comparisons)
    return counts | {"regressed": counts["regressed"] or compared}


def regressed_cases(comparisons: Sequence[Mapping[str, Any]]) -> list[str]:
    """The names of what regressed, each once, in the order of the comparisons."""
    named = [_named(case)["case"] for found in comparisons for case in found["regressed"]]
    return list(dict.fromkeys(named))


def changed_cases(comparisons: Sequence[Mapping[str, Any]]) -> list[str]:
    """The names of what was fixed, and of what passes in some rounds."""
    words = ("fixed", "flaky")
    return [str(name) for found in comparisons for word in words for name in found.get(word) or []]


def _named(case: str | Mapping[str, str]) -> dict[str, str]:
    """A regressed case; comparisons of before v1alpha2 have its name alone."""
    return {"case": case, "to": "", "reason": ""} if isinstance(case, str) else dict(case)


def _drawn(comparison: Mapping[str, Any]) -> dict[str, Any]:
    """A comparison with each criterion's interval as per cent of a drawing 100 wide around 0."""
    criteria = []
    for criterion in comparison["criteria"]:
        low, high, middle = (criterion[key] for key in ("low", "high", "difference"))
        drawn = None
        if low is not None and high is not None and middle is not None:
            reach = max(abs(low), abs(high)) or 1.0
            drawn = {
                "low": 50 + 46 * low / reach,
                "high": 50 + 46 * high / reach,
                "middle": 50 + 46 * middle / reach,
            }
        criteria.append({**criterion, "drawn": drawn})
    regressed = [_named(case) for case in comparison["regressed"]]
    # Comparisons of before there was a quarantine have none.
    hidden = comparison.get("quarantined") or []
    return {**comparison, "criteria": criteria, "regressed": regressed, "quarantined": hidden}


def _ruled(manifest: Mapping[str, Any]) -> list[dict[str, Any]]:
    """The rules of a job's quarantine, each with what somebody may have to do about it."""
    rules = (manifest.get("quarantine") or {}).get("rules") or []
    return [{**rule, "remark": remark(rule)} for rule in rules]
