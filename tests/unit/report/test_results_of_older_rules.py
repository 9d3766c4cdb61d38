"""Results of jobs that today's rules refuse: what was run once is read as it is."""

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from bagpipe.driver.baseline import baseline_rows, check_baseline
from bagpipe.report.stored import StoredResults
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage, StorageError
from tests.unit.compare.rows import row

SPEC: dict[str, Any] = {
    "source": {"bags": ["pvc://r/*.mcap"], "topics": ["/scan"], "fragment": {"length": "10s"}},
    "stack": {"image": "a/b:1", "command": ["x"]},
    "variants": [{"name": "released"}, {"name": "pr-812"}],
    "record": {"topics": ["/pose"]},
    "output": {"uri": "pvc://r/out"},
    "evaluate": [{"name": "late", "latency": {"topic": "/pose", "max": "100ms"}}],
}


def results(folder: Path, spec: Any) -> str:
    (folder / "job.json").write_text(json.dumps({"spec": spec}))
    rows = [row(n, variant) for variant in ("released", "pr-812") for n in range(3)]
    (folder / "results.jsonl").write_text("".join(json.dumps(each) + "\n" for each in rows))
    return folder.as_uri()


@pytest.mark.parametrize(
    "older",
    [
        # Bag time waits there for the stack, so latency is refused today.
        {"playback": {"mode": "max"}},
        {"playback": {"mode": "lockstep"}},
        # A criterion over what is not recorded.
        {"record": {"topics": ["/odom"]}},
    ],
    ids=["max", "lockstep", "not recorded"],
)
def test_results_of_a_job_that_is_refused_today_are_read(
    tmp_path: Path, older: dict[str, Any]
) -> None:
    with pytest.raises(ValidationError):
        SimulationJobSpec.model_validate(SPEC | older)
    uri, storage = results(tmp_path, SPEC | older), Storage({})
    check_baseline(uri, storage)
    assert [each["variant"] for each in baseline_rows(uri, storage)] == ["released"] * 3
    spec = StoredResults(uri, storage).spec()
    assert spec is not None
    assert spec.evaluate[0].latency is not None


@pytest.mark.parametrize("spec", [7, {"variants": 7}, {"variants": [{}]}, {"variants": {}}])
def test_what_is_no_job_at_all_is_refused(tmp_path: Path, spec: Any) -> None:
    found = StoredResults(results(tmp_path, spec), Storage({}))
    with pytest.raises(StorageError, match="is no job"):
        found.spec()
    if spec != {"variants": {}}:
        with pytest.raises(StorageError, match="is no job"):
            list(found.baseline_rows())


def test_results_of_several_variants_without_the_job_are_no_baseline(tmp_path: Path) -> None:
    """Their order is that of the cases' names, and says nothing of which variant was the first."""
    uri, storage = results(tmp_path, SPEC), Storage({})
    assert len(list(StoredResults(uri, storage).baseline_rows())) == 3
    (tmp_path / "job.json").unlink()
    with pytest.raises(StorageError, match=r"several variants \(pr-812, released\), and no job"):
        list(StoredResults(uri, storage).baseline_rows())
