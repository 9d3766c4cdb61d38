"""Figures that pages quote stand where they were published, so that neither grows old alone."""

import pytest

from tests.unit.site.pages import DOCS

QUOTED = {
    "comparison.md": {
        "performance.md": ["153,755", "8,322", "1,292", "724", "1.83", "1.42", "5k msg/s"],
    },
    "operations/sizing.md": {
        "performance.md": ["359k msg/s", "5.013 MiB"],
        "limits.md": ["91 MiB", "119 MiB", "20,000 cases", "300,000 findings", "at most 1 GiB"],
        "reference/agent.md": ["default: 4GiB"],
        "reference/storage.md": ["at most 32 MiB", "at most four parts of 8 MiB"],
        "reference/simulationjob.md": ["at least 896Mi", "at least 512Mi"],
    },
}


@pytest.mark.parametrize("page", QUOTED)
def test_what_a_page_quotes_is_published(page: str) -> None:
    for source, figures in QUOTED[page].items():
        published = (DOCS / source).read_text()
        old = [figure for figure in figures if figure not in published]
        assert old == [], f"{source} has other figures now: correct {page}"
