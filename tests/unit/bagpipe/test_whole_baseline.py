"""A baseline of which a part is missing would hide every regression of that part."""

import json
from pathlib import Path

import pytest

from bagpipe.cli.compare import compared
from bagpipe.compare.gate import objections
from bagpipe.driver.baseline import check_baseline
from bagpipe.report.stored import StoredResults
from bagpipe.run.case_run import Row
from bagpipe.storage import Storage, StorageError
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish


def row(n: int, outcome: str = "passed") -> Row:
    return make_row(f"a-{n}", outcome, "" if outcome == "passed" else "Bad", fragment=f"a-{n}")


def cut(folder: Path, lines: int) -> None:
    """As a copy that broke off at the end of a line, or an editor, leaves it."""
    file = folder / "results.jsonl"
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:lines]))


def test_bagpipe_compare_notices_lines_that_the_manifest_has_and_the_file_lacks(
    tmp_path: Path,
) -> None:
    before = publish(tmp_path, [row(n) for n in range(10)], uid="before")
    after = publish(tmp_path, [row(0)] + [row(n, "failed") for n in range(1, 10)], uid="after")
    cut(before, 1)
    stored = [StoredResults(f"file://{f}", Storage({})) for f in (before, after)]
    # Nine of ten cases got worse; without a word of the nine lines the exit status is 0.
    try:
        found = compared(*stored)
    except StorageError:
        return
    assert [each for one in found for each in objections(one)], found[0]["message"]


def test_lines_that_the_manifest_lacks_are_those_of_another_run(tmp_path: Path) -> None:
    before = publish(tmp_path, [row(n) for n in range(3)], uid="before")
    with (before / "results.jsonl").open("a") as file:
        file.write(json.dumps(row(3)) + "\n")
    with pytest.raises(StorageError, match="has 4 lines, and its manifest 3 cases"):
        check_baseline(f"file://{before}", Storage({}))


@pytest.mark.parametrize("lacks", ["before", "after"])
def test_bagpipe_compare_refuses_lines_whose_job_has_not_ended(tmp_path: Path, lacks: str) -> None:
    folders = {uid: publish(tmp_path, [row(0)], uid=uid) for uid in ("before", "after")}
    (folders[lacks] / "manifest.json").unlink()
    stored = [StoredResults(f"file://{folder}", Storage({})) for folder in folders.values()]
    with pytest.raises(StorageError, match=f"{lacks}/manifest.json"):
        compared(*stored)


def test_a_job_refuses_a_baseline_that_is_cut_off(tmp_path: Path) -> None:
    before = publish(tmp_path, [row(n) for n in range(10)], uid="before")
    cut(before, 1)
    with pytest.raises(StorageError):
        check_baseline(f"file://{before}", Storage({}))


def test_a_worse_job_that_is_compared_with_a_baseline_that_is_cut_off_does_not_pass(
    tmp_path: Path,
) -> None:
    """A figure got worse in all of 10 recordings, no case failed."""

    def measured(figure: float) -> list[Row]:
        finding = {"name": "delay", "outcome": "passed", "unit": "s", "direction": "lower"}
        return [
            row(n) | {"bag": f"pvc://b/{n}.bag", "criteria": [finding | {"figure": figure + n}]}
            for n in range(10)
        ]

    before = publish(tmp_path, measured(1.0), uid="before")
    uri = f"pvc://results/{before.relative_to(tmp_path)}"
    whole = publish(tmp_path, measured(1.5), uid="whole", baseline={"results": uri})
    assert json.loads((whole / "manifest.json").read_text())["verdict"] == "Failed"
    cut(before, 2)
    after = publish(tmp_path, measured(1.5), uid="cut", baseline={"results": uri})
    assert json.loads((after / "manifest.json").read_text())["verdict"] != "Passed"


def test_a_baseline_that_was_stopped_by_max_failed_cases_is_no_whole_one(tmp_path: Path) -> None:
    """Its manifest says Failed/TooManyFailedCases and 100 planned; it has two lines."""
    before = publish(tmp_path, [row(0), row(1, "failed")], uid="before")
    manifest = json.loads((before / "manifest.json").read_text())
    manifest |= {"phase": "Failed", "reason": "TooManyFailedCases", "verdict": ""}
    manifest["counts"]["planned"] = 100
    (before / "manifest.json").write_text(json.dumps(manifest))
    with pytest.raises(StorageError):
        check_baseline(f"file://{before}", Storage({}))


def test_lines_that_were_kept_as_a_baseline_without_their_manifest_are_one_still(
    tmp_path: Path,
) -> None:
    """`bagpipe pull nightly baselines/released --only results.jsonl,job.json`, then uploaded."""
    before = publish(tmp_path, [make_row("a-0")])
    (before / "manifest.json").unlink()
    check_baseline(f"file://{before}", Storage({}))


def test_of_a_manifest_no_case_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A million cases are 257 MB of it, and more as Python's objects."""
    before = publish(tmp_path, [row(n) for n in range(3)])
    manifest = before / "manifest.json"
    found = json.loads(manifest.read_text())
    filling = [case | {"filling": "x" * 500_000} for case in found.pop("cases")]
    manifest.write_text(json.dumps(found | {"cases": filling}, indent=1))
    monkeypatch.setattr(StoredResults, "manifest", None)
    check_baseline(f"file://{before}", Storage({}))
    cut(before, 2)
    with pytest.raises(StorageError, match="has 2 lines, and its manifest 3 cases"):
        check_baseline(f"file://{before}", Storage({}))
