"""`bagpipe history` of criteria with several bounds, and of results of before these had figures."""

import json
from pathlib import Path
from typing import Any

from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

CPU, MEMORY = "at most 1.5 CPUs", "at most 2e+09 bytes"


def finding(cpu: float, memory: float) -> dict[str, Any]:
    bounds = [("CPUs", cpu, 1.5, CPU), ("bytes", memory, 2e9, MEMORY)]
    figures: list[dict[str, Any]] = [
        {"outcome": "passed" if figure <= most else "failed", "figure": figure, "unit": unit,
         "limit": limit, "direction": "lower"}
        for unit, figure, most, limit in bounds
    ]  # fmt: skip
    decided = next((each for each in figures if each["outcome"] == "failed"), figures[-1])
    return {"name": "use", "kind": "resources", "message": "", "figures": figures} | decided


def nights(folder: Path, found: list[dict[str, Any]]) -> dict[str, dict[str, Any]]:
    for number, each in enumerate(found):
        rows = [make_row(f"a-{n:04d}", criteria=[each], seconds=1.0) for n in range(3)]
        results = publish(folder, rows, uid=f"uid-{number}")
        manifest = json.loads((results / "manifest.json").read_text())
        manifest["provenance"]["ended"] = f"2026-10-{number + 1:02d}T04:00:00Z"
        (results / "manifest.json").write_text(json.dumps(manifest))
    ended = CliRunner().invoke(main, ["history", str(folder), "--output", "json"])
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return {each["name"]: each for each in json.loads(ended.output)["criteria"]}


def test_each_figure_has_medians_of_its_own_and_moves_alone(tmp_path: Path) -> None:
    cpus = [0.5 + n / 1000 for n in range(10)] + [1.4 + n / 1000 for n in range(10)]
    found = nights(tmp_path, [finding(cpu, 1e9) for cpu in cpus])
    assert list(found) == ["use", "use (bytes)"]
    assert (found["use"]["unit"], found["use"]["median"]) == ("CPUs", cpus)
    assert found["use"]["moved_since"]["ended"].startswith("2026-10-11")
    assert found["use (bytes)"]["median"] == [1e9] * 20
    assert found["use (bytes)"]["moved_since"] is None


def test_what_fails_is_named_once_whichever_bound_it_is(tmp_path: Path) -> None:
    found = nights(tmp_path, [finding(0.5, 1e9 if n < 10 else 3e9) for n in range(20)])
    assert found["use"]["worse_since"]["ended"].startswith("2026-10-11")
    assert found["use"]["failed"] == [0] * 10 + [3] * 10
    assert found["use (bytes)"]["worse_since"] is None
    assert found["use (bytes)"]["moved_since"]["ended"].startswith("2026-10-11")


def test_nights_of_before_have_the_figure_that_decided(tmp_path: Path) -> None:
    earlier = {key: value for key, value in finding(0.5, 1e9).items() if key != "figures"}
    found = nights(tmp_path, [earlier, finding(0.5, 1e9)])
    assert sorted(found) == ["use", "use (CPUs)"]
    assert (found["use"]["unit"], found["use"]["median"]) == ("bytes", [1e9, 1e9])
    assert found["use (CPUs)"]["median"] == [None, 0.5]
    assert found["use"]["judged"] == [3, 3]
