"""`bagpipe replay`: a case of a real job runs once more on this machine, with real ROS nodes."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

from bagpipe.cli.__main__ import main
from bagpipe.run.laptop import ReplayError, local_spec, planned_case
from bagpipe.source.planning import plan
from bagpipe.storage import Storage
from tests.integration.stacks import folders_with_recording, stepped
from tests.unit.bagpipe.jobs import make_row
from tests.unit.report.publishing import publish

pytestmark = pytest.mark.integration

CRITERIA = [
    {"name": "frames", "presence": {"topic": "/tf", "min": 20}},
    {"name": "too many", "presence": {"topic": "/tf", "min": 100_000}},
]
VARIANTS = [{"name": "released"}, {"name": "other", "image": "some.example/other:1"}]


@pytest.fixture
def folders(tmp_path: Path) -> dict[str, str]:
    return folders_with_recording(tmp_path)


@pytest.fixture
def ros_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "/usr/lib/robot_state_publisher:/usr/bin:/bin")


def published(tmp_path: Path, folders: dict[str, str], criteria: int) -> tuple[Path, str]:
    """The results of a job over the real recording, and the name of one of its cases."""
    # In lock-step: by the clock a node with a queue of one loses what comes while others compute.
    spec = stepped().model_dump(mode="json", by_alias=True, exclude_defaults=True)
    spec |= {"variants": VARIANTS, "evaluate": CRITERIA[:criteria]}
    made = local_spec(stepped()).model_validate(spec)
    cases = [c for c in plan(made, Storage(folders)).cases if c.conditions.variant == "other"]
    rows = [
        make_row(
            case.id, "failed", "Lossy", fragment=case.fragment, variant="other", bag=case.bag,
            bag_version=case.bag_version,
            window=[case.window.lead_in_start, case.window.start, case.window.end],
        )
        for case in cases
    ]  # fmt: skip
    wanted = sorted(row["case"] for row in rows)[1]
    return publish(tmp_path, rows, **spec), wanted


def replay(case: str, results: Path, folders: dict[str, str], *more: str) -> tuple[int, str]:
    volume = ["--volume", f"recordings={folders['recordings']}"]
    arguments = ["replay", case, "--results", str(results), *volume, *more]
    ended = CliRunner().invoke(main, arguments)
    assert ended.exception is None or isinstance(ended.exception, SystemExit), ended.exception
    return ended.exit_code, ended.output


@pytest.mark.parametrize(("criteria", "status"), [(1, 0), (2, 1)])
@pytest.mark.usefixtures("ros_path")
def test_a_case_runs_again_here(
    tmp_path: Path, folders: dict[str, str], agent_binary: Path, criteria: int, status: int
) -> None:
    results, case = published(tmp_path, folders, criteria)
    keep = tmp_path / "again"
    ended, text = replay(case, results, folders, "--agent", str(agent_binary), "--keep", str(keep))
    assert ended == status, text
    assert f"{'failed' if status else 'passed'} here, failed in the job: {case}" in text
    row = json.loads((keep / "row.json").read_text())
    assert row["result"]["ledger"]["dropped"] == 0
    assert row["result"]["ledger"]["sent"] == row["result"]["ledger"]["received"] > 300
    assert [found["name"] for found in row["criteria"]] == ["frames", "too many"][:criteria]
    assert (keep / row["recorded"]).stat().st_size > 10_000
    assert (keep / "fragment.bag").stat().st_size > 10_000


@pytest.mark.usefixtures("ros_path")
def test_without_an_agent_the_fragment_and_the_commands_are_left(
    tmp_path: Path, folders: dict[str, str]
) -> None:
    results, case = published(tmp_path, folders, 1)
    keep = tmp_path / "again"
    ended, text = replay(case, results, folders, "--keep", str(keep))
    assert (ended, "there is no bagpipe-agent on this machine: give --agent" in text) == (2, True)
    ended, text = replay(case, results, folders, "--keep", str(keep), "--only-fragment")
    assert ended == 0
    assert f"bagpipe-agent play {keep}/fragment.bag --start " in text
    assert "--topics /joint_states" in text


def test_what_can_t_be_replayed_says_why(tmp_path: Path, folders: dict[str, str]) -> None:
    results, case = published(tmp_path, folders, 1)
    status, text = replay("no-such-case", results, folders)
    assert (status, "has no case no-such-case; it has " in text) == (2, True)
    (Path(folders["recordings"]) / "pr2/joint_states.bag").unlink()
    status, text = replay(case, results, folders, "--keep", str(tmp_path / "k"))
    assert (status, "Is it the recording that the job has played?" in text) == (2, True)
    (results / "job.json").unlink()
    status, text = replay(case, results, folders)
    assert (status, "has no job.json" in text) == (2, True)
    shutil.rmtree(results)
    assert replay(case, results, folders)[0] == 2


def test_a_row_without_a_recording_is_refused() -> None:
    with pytest.raises(ReplayError, match="has no recording that could be played again"):
        planned_case(make_row("a"), stepped(), Storage({}))
