"""Pieces of a real recording through a real node: in every order, and in their own order again."""

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from bagpipe import MemoryBag
from bagpipe.plan.case import Case
from bagpipe.run.case_run import Row, RunContext, run_case
from bagpipe.source.planning import plan
from bagpipe.spec import SimulationJobSpec
from bagpipe.storage import Storage
from tests.integration.conftest import ROOT, RunningAgent
from tests.integration.stacks import folders_with_recording, whole_fields
from tests.recording import MESSAGES
from tests.waiting import patient

pytestmark = pytest.mark.integration

Start = Callable[..., RunningAgent]

BAG = "pvc://recordings/pr2/joint_states.bag"
SECOND = 1_000_000_000
EXAMPLE = ROOT / "docs/examples/recombined/job.yaml"


def run(case: Case, spec: SimulationJobSpec, folders: dict[str, str], agent: RunningAgent) -> Row:
    context = RunContext("lab/pr2", spec, folders, "pvc://results/r", str(agent.shared))
    row = run_case(case, context)
    assert (row["outcome"], row["attempts"]) == ("passed", 1), row
    return row


def digest(row: Row, folders: dict[str, str]) -> str:
    recorded = Path(folders["results"]) / "r" / row["recorded"]
    return hashlib.sha256(recorded.read_bytes()).hexdigest()


def cut_scenes(folders: dict[str, str]) -> None:
    """The example's three scenes, as its comments cut them."""
    pr2 = Path(folders["recordings"]) / "pr2"
    whole = MemoryBag.open(pr2 / "joint_states.bag")
    assert whole.start is not None
    (pr2 / "scenes").mkdir()
    for name, start, end in (("beginning", 0, 4), ("middle", 4, 8), ("end", 12, 100)):
        scene = whole.slice(whole.start + start * SECOND, whole.start + end * SECOND)
        (pr2 / "scenes" / f"{name}.bag").write_bytes(scene.to_bytes())
    shutil.move(pr2 / "joint_states.bag", pr2.parent / "joint_states.bag")


def test_every_order_of_the_example_is_answered_without_a_gap(
    tmp_path: Path, start_agent: Start
) -> None:
    """docs/examples/recombined/job.yaml, all of its cases."""
    folders = folders_with_recording(tmp_path)
    cut_scenes(folders)
    spec = SimulationJobSpec.model_validate(patient(yaml.safe_load(EXAMPLE.read_text())["spec"]))
    agent = start_agent()
    cases = sorted(plan(spec, Storage(folders)).cases, key=lambda case: case.id)
    assert [case.id for case in cases] == [f"sequence-s{n}" for n in (1, 2, 3, 5, 6, 7)]
    rows = [run(case, spec, folders, agent) for case in cases]
    for case, row in zip(cases, rows, strict=True):
        bags = [MemoryBag.open(Path(folders["recordings"]) / p.bag[17:]) for p in case.parts]
        counts = [len(list(bag.messages(None, p.window.start, p.window.end)))
                  for bag, p in zip(bags, case.parts, strict=True)]  # fmt: skip
        ledger = row["result"]["ledger"]
        assert (ledger["sent"], ledger["received"], ledger["dropped"]) == (
            sum(counts), sum(counts), 0,
        )  # fmt: skip
        (step,) = row["result"]["playback"]["steps"]
        assert (step["answered"], step["no_output"]) == (sum(counts), 0)
        assert [part["at"] for part in row["parts"]] == [part.at for part in case.parts]
        print(row["case"], counts, row["result"]["recorded"]["messages"], row["seconds"])
    again = run(cases[0], spec, folders, agent)
    assert digest(again, folders) == digest(rows[0], folders)


def test_a_recording_that_was_cut_and_put_together_again_is_the_whole(
    tmp_path: Path, start_agent: Start
) -> None:
    folders = folders_with_recording(tmp_path)
    fields = whole_fields()
    whole = SimulationJobSpec.model_validate(fields)
    pieces = [{"bag": BAG, "to": "4.3s"}, {"bag": BAG, "from": "4.3s", "to": "9s"},
              {"bag": BAG, "from": "9s"}]  # fmt: skip
    fields["source"] = {"sequence": pieces, "topics": ["/joint_states"]}
    sequence = SimulationJobSpec.model_validate(fields)
    agent = start_agent()
    digests = set()
    for spec in (whole, sequence):
        (case,) = plan(spec, Storage(folders)).cases
        row = run(case, spec, folders, agent)
        assert row["result"]["ledger"]["sent"] == MESSAGES
        digests.add(digest(row, folders))
    assert len(digests) == 1
