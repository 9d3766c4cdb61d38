"""Every line of the threat model names tests, and there are such tests."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[3]
PAGE = ROOT / "docs/operations/threat-model.md"
FOLDERS = {"api": "tests/integration/control_plane", "e2e": "tests/e2e", "unit": "tests/unit"}


def lines() -> list[str]:
    """The tables' lines: threat, what stops it, test."""
    rows = [r for r in PAGE.read_text().splitlines() if r.startswith("| ")]
    return [r for r in rows if not r.startswith(("| threat |", "|---"))]


def missing(cell: str) -> list[str]:
    """What a cell names that is not there."""
    found, text = [], ""
    for word, name in re.findall(r"(\bapi\b|\be2e\b|\bunit\b)?,? ?`([^`]+)`", cell):
        path, _, test = name.partition("::")
        if path:
            folder = FOLDERS[word] if word else ""
            file = ROOT / folder / path
            if not file.is_file():
                found.append(name)
                continue
            text = file.read_text()
        if test and f"def {test}(" not in text:
            found.append(name)
    found += [case for case in re.findall(r'"([^"]+)"', cell) if f'"{case}":' not in text]
    return found


def test_each_threat_has_a_test_that_exists() -> None:
    rows = [[cell.strip() for cell in row.strip("|").split(" | ")] for row in lines()]
    assert len(rows) >= 30
    assert [row[0] for row in rows if len(row) != 3 or not re.search(r"test", row[2])] == []
    assert {row[0]: missing(row[2]) for row in rows if missing(row[2])} == {}


def test_a_test_that_is_not_there_is_missed() -> None:
    assert missing("unit `operator/test_walls.py::test_nothing_of_the_kind`") != []
    assert missing("api `test_none.py::test_x`") == ["test_none.py::test_x"]
    assert missing('api `test_pod_refusals.py` case "no such case"') == ["no such case"]
