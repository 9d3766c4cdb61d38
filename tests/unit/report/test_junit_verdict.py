"""What a CI reads in junit.xml where the verdict is not that of the cases."""

import json
from pathlib import Path
from xml.etree import ElementTree as ET

from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish, versions


def red(folder: Path) -> int:
    """What a CI counts against a build."""
    root = ET.parse(folder / "junit.xml").getroot()  # noqa: S314  our own
    return len(root.findall(".//failure")) + len(root.findall(".//error"))


def verdict(folder: Path) -> tuple[str, str, str]:
    found = json.loads((folder / "manifest.json").read_text())
    return found["phase"], found["verdict"], found["verdictReason"]


def test_a_job_that_failed_since_cases_are_missing_is_not_green(tmp_path: Path) -> None:
    # The baseline has six cases; this job has five of them, and all pass.
    before = publish(tmp_path, versions(failing=set())[::2], uid="old")
    rows = [make_row(f"a-{n:04d}", fragment=f"a-{n:04d}") for n in range(5)]
    old = f"pvc://results/{before.relative_to(tmp_path)}"
    folder = publish(tmp_path, rows, uid="new", baseline={"results": old})
    assert verdict(folder)[:2] == ("Complete", "Failed")
    assert red(folder) > 0


def test_a_job_that_failed_since_a_criterion_is_worse_is_not_green(tmp_path: Path) -> None:
    def row(n: int, variant: str, figure: float) -> dict[str, object]:
        found = {
            "name": "delay", "kind": "latency", "outcome": "passed", "figure": figure, "unit": "ms",
            "limit": "at most 100 ms", "direction": "lower", "message": "", "coverage": 1.0,
            "expected_failure": False, "covered": "", "clock": "receipt",
        }  # fmt: skip
        return make_row(
            f"a{n}-0000-{variant}", fragment=f"a{n}-0000", variant=variant, criteria=[found],
            bag=f"pvc://recordings/a{n}.bag",
        )  # fmt: skip

    rows = [row(n, "released", 10.0 + n * 0.01) for n in range(12)]
    rows += [row(n, "pr-812", 60.0 + n * 0.011) for n in range(12)]
    variants = [{"name": "released"}, {"name": "pr-812", "image": "stack:2"}]
    evaluate = [{"name": "delay", "latency": {"topic": "/out", "max": "100ms"}}]
    folder = publish(tmp_path, rows, variants=variants, evaluate=evaluate)
    assert verdict(folder) == ("Complete", "Failed", "WorseCriteria")
    assert red(folder) > 0


def test_a_job_of_which_nothing_counts_is_not_green(tmp_path: Path) -> None:
    rules = [{"cases": "*", "reason": "issue 17", "until": "2026-12-01"}]
    folder = publish(tmp_path, [make_row("a"), make_row("b")], quarantine=rules)
    assert verdict(folder) == ("Complete", "Invalid", "AllQuarantined")
    assert red(folder) > 0
