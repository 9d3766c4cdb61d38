"""JUnit XML, as CI systems read it: a suite per variant, a test case per case.

A case without enough evidence is an error there: what JUnit calls skipped would look green.
Written line by line, whatever the number of cases.
"""

import re
from collections.abc import Mapping
from typing import IO, Any
from xml.sax.saxutils import escape, quoteattr

Row = Mapping[str, Any]

# XML 1.0 has no place for these, escaped or not.
_UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


class JUnitWriter:
    """Writes rows in the order in which they come; all of one variant belong together."""

    def __init__(self, file: IO[bytes], job: str) -> None:
        self._file = file
        self._job = job
        self._suite: str | None = None
        self._write(f'<?xml version="1.0" encoding="UTF-8"?>\n<testsuites name={_quoted(job)}>\n')

    def add(self, row: Row) -> None:
        """One case."""
        suite = row.get("variant") or self._job
        if suite != self._suite:
            self._end_suite()
            self._suite = suite
            self._write(f"<testsuite name={_quoted(suite)}>\n")
        seconds = float(row.get("seconds") or 0.0)
        self._write(
            f"<testcase name={_quoted(row['case'])}"
            f' classname={_quoted(row.get("fragment") or self._job)} time="{seconds:.3f}">'
            f"{_verdict(row)}{_figures(row)}</testcase>\n"
        )

    def finish(self) -> None:
        """Ends the document; nothing can be added afterwards."""
        self._end_suite()
        self._write("</testsuites>\n")

    def _end_suite(self) -> None:
        if self._suite is not None:
            self._write("</testsuite>\n")

    def _write(self, text: str) -> None:
        self._file.write(text.encode())


def _verdict(row: Row) -> str:
    element = {"passed": "", "failed": "failure"}.get(row["outcome"], "error")
    if not element:
        return ""
    kind = row.get("reason") or row["outcome"]
    message = row.get("message") or row["outcome"]
    return f"<{element} type={_quoted(kind)} message={_quoted(message)}/>"


def _figures(row: Row) -> str:
    lines = [
        f"{finding['name']}: {finding['outcome']} {finding['message']}"
        for finding in row.get("criteria") or []
    ]
    lines += [f"stderr: {line}" for line in row.get("stderr") or []]
    return f"<system-out>{escape(_writable('; '.join(lines)))}</system-out>" if lines else ""


def _quoted(text: str) -> str:
    return quoteattr(_writable(text))


def _writable(text: str) -> str:
    return _UNWRITABLE.sub("�", text)
