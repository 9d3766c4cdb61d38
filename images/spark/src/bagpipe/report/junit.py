"""JUnit XML, as CI systems read it: a suite per variant, a test case per case.

A case without enough evidence is an error there: what JUnit calls skipped would look green. Skipped
is what did not pass and is in quarantine: no CI takes it for passed, and none turns red by it. The
driver and `bagpipe results --junit` write the same file, by the one function here.
"""

import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import IO, Any
from xml.sax.saxutils import escape, quoteattr

from bagpipe.report.provenance import facts_of
from bagpipe.row_facts import discarded_runs, quarantine_words, run_words

Row = Mapping[str, Any]

# XML 1.0 has no place for these, escaped or not.
_UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_KEPT = (
    "case", "fragment", "variant", "outcome", "reason", "message", "seconds", "stderr",
    "attempts", "starts",
)  # fmt: skip
# No variant is called so: its name may not have a space.
_VERDICT = "verdict of the job"
_ELEMENTS = {"passed": "", "failed": "failure"}


def kept(row: Row) -> dict[str, Any]:
    """What of a row is written: some hundred bytes, so that all can be sorted by variant."""
    return {key: row.get(key) for key in _KEPT} | {
        "discarded": [run_words(run) for run in discarded_runs(row)],
        "quarantine": quarantine_words(row),
        "criteria": [
            {key: finding.get(key) for key in ("name", "outcome", "message")}
            for finding in row.get("criteria") or []
        ],
    }


def write_junit(file: IO[bytes], manifest: Mapping[str, Any], rows: Iterable[Row]) -> None:
    """All cases, as `kept` gives them; those of each variant together."""
    job = str(manifest["job"]["name"])
    ordered = sorted(rows, key=lambda row: str(row.get("variant") or ""))
    # Every suite names where the results come from: readers of one suite see no other.
    facts = [*facts_of(manifest), ("discarded runs", str(manifest["counts"]["discarded"]))]
    _write(file, f'<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name={_quoted(job)}>\n')
    for suite, cases in itertools.groupby(ordered, lambda row: str(row.get("variant") or job)):
        _write_suite(file, job, suite, list(cases), facts)
    green = not any(_element(row) in {"failure", "error"} for row in ordered)
    if green and manifest.get("verdict") != "Passed":
        _write_suite(file, job, _VERDICT, [_of_the_job(manifest, job)], facts)
    _write(file, "</testsuites>\n")


def _of_the_job(manifest: Mapping[str, Any], job: str) -> dict[str, Any]:
    """The verdict as a test, where no case has what is the reason for it."""
    verdict = str(manifest.get("verdict") or "")
    reason = str(manifest.get("verdictReason") or manifest.get("reason") or "NoVerdict")
    outcome = "failed" if verdict == "Failed" else "invalid"
    message = str(manifest.get("message") or f"verdict {verdict}")
    return kept({"case": job, "outcome": outcome, "reason": reason, "message": message})


def _write_suite(
    file: IO[bytes], job: str, suite: str, cases: Sequence[Row], facts: list[tuple[str, str]]
) -> None:
    elements = [_element(row) for row in cases]
    seconds = sum(float(row.get("seconds") or 0.0) for row in cases)
    began = dict(facts).get("began", "").removesuffix("Z")
    timestamp = f" timestamp={_quoted(began)}" if began else ""
    _write(
        file,
        f'<testsuite name={_quoted(suite)} tests="{len(cases)}"'
        f' failures="{elements.count("failure")}" errors="{elements.count("error")}"'
        f' skipped="{elements.count("skipped")}" time="{seconds:.3f}"{timestamp}>\n'
        f"{_properties(facts)}\n",
    )
    for row in cases:
        for text in _case(row, job):
            _write(file, text)
    _write(file, "</testsuite>\n")


def _case(row: Row, job: str) -> Iterator[str]:
    seconds = float(row.get("seconds") or 0.0)
    yield (
        f"<testcase name={_quoted(row['case'])}"
        f' classname={_quoted(row.get("fragment") or job)} time="{seconds:.3f}">'
    )
    facts = [("discarded", run) for run in row["discarded"]]
    facts += [("quarantine", row["quarantine"])] if row["quarantine"] else []
    if facts:
        yield _properties(facts)
    yield f"{_verdict(row)}{_figures(row)}</testcase>\n"


def _properties(facts: Iterable[tuple[str, str]]) -> str:
    found = [f"<property name={_quoted(name)} value={_quoted(value)}/>" for name, value in facts]
    return f"<properties>{''.join(found)}</properties>"


def _element(row: Row) -> str:
    element = _ELEMENTS.get(row["outcome"], "error")
    return "skipped" if element and row["quarantine"] else element


def _verdict(row: Row) -> str:
    element = _element(row)
    if not element:
        return ""
    kind = row.get("reason") or row["outcome"]
    message = row.get("message") or row["outcome"]
    if element == "skipped":
        words = f"{row['quarantine']}; {row['outcome']}: {kind}: {message}"
        return f"<skipped message={_quoted(words)}/>"
    return f"<{element} type={_quoted(kind)} message={_quoted(message)}/>"


def _figures(row: Row) -> str:
    lines = [
        f"{finding['name']}: {finding['outcome']} {finding['message']}"
        for finding in row.get("criteria") or []
    ]
    lines += [f"stderr: {line}" for line in row.get("stderr") or []]
    return f"<system-out>{escape(_writable('; '.join(lines)))}</system-out>" if lines else ""


def _write(file: IO[bytes], text: str) -> None:
    file.write(text.encode())


def _quoted(text: str) -> str:
    return quoteattr(_writable(text))


def _writable(text: str) -> str:
    return _UNWRITABLE.sub("�", text)
