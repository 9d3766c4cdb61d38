"""Figures that pages quote stand where they were published, so that neither grows old alone."""

import pytest

from tests.unit.site.pages import DOCS

# Beside rosbag2: its rows over Cyclone DDS and Fast DDS, as they were printed.
ROSBAG2 = [
    "| 114k msg/s (104k to 119k) | 0 | 70k msg/s (65k to 149k) | 44,317 (12,546 to 45,758) |",
    "| 1,141 msg/s (1,077 to 1,151) | 0 | 512 msg/s (364 to 717) | 130 (113 to 158) |",
    "| 85k msg/s (69k to 92k) | 0 | 35k msg/s (27k to 41k) | 82,995 (75,491 to 85,284) |",
    "| 2,075 msg/s (2,009 to 2,387) | 0 | 1,399 msg/s (1,069 to 1,915) | 207 (187 to 231) |",
]
QUOTED = {
    "../README.md": {
        "performance.md": ROSBAG2,
        "concepts/proof.md": ["20 of 20 runs beside busy loops"],
    },
    "comparison.md": {
        "performance.md": [
            "153,755", "8,322", "1,292", "724", "1.83", "1.42", "5k msg/s",
            "44,317", "82,995", "1.62", "2.42", "it was 1.15", "| 0 | 135 (", "| 0 | 122 (",
        ],
    },
    "operations/sizing.md": {
        "performance.md": ["359k msg/s", "5.013 MiB"],
        "limits.md": ["91 MiB", "119 MiB", "20,000 cases", "300,000 findings", "at most 1 GiB"],
        "reference/agent.md": ["default: 4GiB"],
        "reference/storage.md": ["at most 32 MiB", "at most four parts of 8 MiB"],
        "reference/simulationjob.md": ["at least 896Mi", "at least 512Mi"],
    },
}  # fmt: skip


def test_the_first_page_has_the_rows_beside_rosbag2_as_they_were_printed() -> None:
    page = (DOCS / "../README.md").read_text()
    assert [row for row in ROSBAG2 if row not in page] == []


@pytest.mark.parametrize("page", QUOTED)
def test_what_a_page_quotes_is_published(page: str) -> None:
    for source, figures in QUOTED[page].items():
        published = (DOCS / source).read_text()
        old = [figure for figure in figures if figure not in published]
        assert old == [], f"{source} has other figures now: correct {page}"
