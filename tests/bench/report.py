"""`make bench BENCH=report`: how long a keystroke in a report's search takes, in a real browser.

Beside it the plain way: a table of all cases, of which those rows are hidden that lack the words.
Both pages are opened in turn, the same words are typed into both, and no time counts that the
browser spends behind the frame that shows them.
"""

import html
import os
import statistics
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.common.by import By

from tests.bench.rows import Row
from tests.integration.chromium import started
from tests.integration.report.drives import drive_rows, report_of
from tests.integration.report.keystrokes import typed

CASES = (1_000, 10_000)
ROUNDS = int(os.environ.get("BENCH_ROUNDS", "5"))
WORDS = ("0023-heavy-35-pr-812", "lane rate 7.")
# A person notices more.
_GOAL_MILLISECONDS = 200.0
_SHOWN = "#case-table .space .row, #plain tr:not([hidden])"
_PLAIN = """<!doctype html><meta charset="utf-8"><input id="search"><table id="plain">%s</table>
<script>
const words_of = (row) => row.textContent.toLowerCase();
const rows = [...document.querySelectorAll('tr')].map((row) => [row, words_of(row)]);
document.getElementById('search').addEventListener('input', (event) => {
  const words = event.target.value.toLowerCase().split(/\\s+/);
  for (const [row, text] of rows) row.hidden = !words.every((word) => text.includes(word));
});
</script>"""


def plain(rows: Sequence[dict[str, Any]]) -> bytes:
    """A page with a line for each case: its name, values, outcome and criteria's figures."""
    lines = []
    for row in rows:
        criteria = row.get("criteria") or []
        figures = " ".join(f"{each['name']} {each['figure']}" for each in criteria)
        cells = (row["case"], row["outcome"], *row["values"].values(), figures)
        lines.append("".join(f"<td>{html.escape(str(cell))}" for cell in cells))
    return (_PLAIN % "".join(f"<tr>{line}" for line in lines)).encode()


def keystrokes(browser: webdriver.Chrome, page: Path) -> list[float]:
    """Milliseconds of each keystroke of all words, on a page that is opened for them."""
    browser.get(page.as_uri())
    name, figure = WORDS
    took = typed(browser, name)
    # A page that finds nothing would be quick.
    (left,) = browser.find_elements(By.CSS_SELECTOR, _SHOWN)
    assert name in left.text
    return took + typed(browser, figure)


def measure() -> tuple[Sequence[Row], Mapping[str, str], str]:
    """Both pages in turn, of few cases and of many."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name, started(Path(name) / "profile") as browser:
        for cases in CASES:
            rows += _of(browser, Path(name), cases)
        version = str(browser.capabilities["browserVersion"])
    note = (
        f"{sum(len(word) for word in WORDS)} keystrokes in the search of a page, in each of"
        f" {ROUNDS} rounds: the median and the slowest of a round"
    )
    return rows, {"chromium": version}, note


def _of(browser: webdriver.Chrome, folder: Path, cases: int) -> list[Row]:
    drives = drive_rows(cases)
    ours, theirs = folder / "report.html", folder / "plain.html"
    ours.write_bytes(report_of(drives, "pvc://results/out/report/u"))
    theirs.write_bytes(plain(drives))
    took = [(keystrokes(browser, ours), keystrokes(browser, theirs)) for _ in range(ROUNDS)]
    case, peer = f"{cases:,} cases", "a table of all cases"
    slowest = [max(own) for own, _ in took]
    medians = [[statistics.median(each) for each in page] for page in zip(*took, strict=True)]
    return [
        Row(case, "median keystroke", "ms", medians[0], peer, medians[1]),
        Row(case, "slowest keystroke", "ms", slowest, peer, [max(other) for _, other in took]),
        Row(case, "slowest keystroke", "ms", slowest, "the goal", [_GOAL_MILLISECONDS], 1.0),
    ]
