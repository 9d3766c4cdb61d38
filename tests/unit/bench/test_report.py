"""The page that the bench of the report measures beside it."""

import re

from tests.bench.report import CASES, WORDS, plain
from tests.integration.report.drives import drive_rows


def test_the_plain_page_has_a_line_for_each_case_that_holds_what_is_searched() -> None:
    rows = drive_rows(CASES[0])
    lines = re.findall(r"<tr>(.*?)(?=<tr>|</table>)", plain(rows).decode())
    name, figure = WORDS
    assert len(lines) == 1_000
    assert [name in line for line in lines].count(True) == 1
    found = [all(word in line for word in figure.split()) for line in lines].count(True)
    assert 50 < found < 500


def test_the_plain_page_takes_no_case_s_words_for_its_own() -> None:
    hostile = plain(drive_rows(200, hostile=True)).decode()
    assert "<script>window" not in hostile
    assert "&lt;script&gt;window.hacked" in hostile
