"""A case from lease to row, against an agent that fails in every way it can."""

import copy
import dataclasses
import errno
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bagpipe.engine.delivery import judge
from bagpipe.plan.case import Case
from bagpipe.run import attempts as attempts_module
from bagpipe.run import case_run
from bagpipe.run.attempts import Again, next_attempt
from bagpipe.run.case_run import Row, RunContext, case_map, run_case
from bagpipe.source.bags.stream import fragment_file
from bagpipe.source.planning import plan
from bagpipe.storage import NewFile, Patience, Storage
from bagpipe.storage.backend import TransientError
from bagpipe.storage.faults import storage_errors
from bagpipe.storage.local import LocalSink
from bagpipe.storage.retries import Clock, persistently
from bagpipe.wire.frames import FrameType
from bagpipe.wire.session import Answer, SessionError
from tests.unit.bagpipe.bags import steady, write_bag
from tests.unit.bagpipe.fake_agent import (
    RESULT,
    FakeAgent,
    Script,
    aborting,
    dying,
    make_slot,
    well_behaved,
)
from tests.unit.bagpipe.jobs import make_spec

Run = Callable[..., tuple[Row, FakeAgent]]


@pytest.fixture
def context(tmp_path: Path) -> RunContext:
    folders = {name: str(tmp_path / name) for name in ("recordings", "results")}
    (tmp_path / "recordings").mkdir()
    bag = tmp_path / "recordings/a.bag"
    write_bag(bag, steady("/scan", 50, 10_000_000), chunk_bytes=512)
    return RunContext("lab/drive", make_spec(), folders, "pvc://results/r", str(tmp_path / "s"))


@pytest.fixture
def case(context: RunContext) -> Case:
    (only,) = plan(context.spec, Storage(context.volumes)).cases
    return only


@pytest.fixture
def run(context: RunContext, case: Case) -> Run:
    def with_scripts(*scripts: Script) -> tuple[Row, FakeAgent]:
        with FakeAgent(make_slot(Path(context.shared)), *scripts) as agent:
            return run_case(case, context), agent

    return with_scripts


def kept(context: RunContext) -> list[str]:
    return Storage(context.volumes).names("pvc://results/r/cases")


def test_a_good_case_passes_and_keeps_its_bag(run: Run, context: RunContext) -> None:
    row, agent = run(well_behaved(b"a recorded bag"))
    assert (row["outcome"], row["attempts"], row["case"]) == ("passed", 1, "a-0000")
    assert kept(context) == [row["recorded"].removeprefix("cases/")]
    case = agent.received[0].fields()["case"]
    assert case["stack"]["command"] == ["run"]
    assert case["deadlines"]["subscribe"] == 20.0


def test_the_agent_receives_whole_records_of_the_users_bag(run: Run, context: RunContext) -> None:
    _, agent = run(well_behaved())
    stream = b"".join(f.payload for f in agent.received if f.type is FrameType.DATA)
    described = next(f for f in agent.received if f.type is FrameType.FILE).fields()
    assert described["size"] == len(stream)
    original = (Path(context.volumes["recordings"]) / "a.bag").read_bytes()
    for at, offset, length in described["ranges"]:
        assert stream[at : at + length] == original[offset : offset + length]


def test_the_fragments_stream_is_as_long_as_it_says(case: Case, context: RunContext) -> None:
    file = fragment_file(case, Storage(context.volumes))
    stream = b"".join(file.pieces())
    assert len(stream) == file.size
    assert stream.startswith(b"#ROSBAG V2.0\n")
    assert stream.count(b"index_pos=" + bytes(8)) == 1


def test_a_dead_agent_is_met_again(run: Run) -> None:
    row, _ = run(dying, well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    (run_before,) = row["discarded"]
    assert (run_before["reason"], row["starts"]) == ("AgentDied", 1)
    assert "agent" in run_before["message"]
    assert 0 < run_before["seconds"] < row["seconds"]


def test_a_crashed_stack_has_failed_with_its_stderr_and_is_not_repeated(
    run: Run, context: RunContext
) -> None:
    row, _ = run(aborting("StackCrashed", "the stack ended with status 3", ["boom"]))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("failed", "StackCrashed", 1)
    assert row["stderr"] == ["boom"]
    assert kept(context) == []


def test_no_agent_at_all_is_an_error_in_bounded_time(
    case: Case, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(case_run, "_MEETING_SECONDS", 0.05)
    (Path(context.shared) / "slots").mkdir(parents=True)
    row = run_case(case, context)
    assert (row["reason"], row["attempts"]) == ("SlotUnavailable", 3)


@pytest.mark.usefixtures("case")
def test_a_bag_that_vanished_is_a_storage_error(context: RunContext, run: Run) -> None:
    (Path(context.volumes["recordings"]) / "a.bag").unlink()

    def listening(agent: FakeAgent) -> None:
        agent.read_until(FrameType.END)

    row, _ = run(listening)
    assert (row["reason"], row["attempts"]) == ("StorageFailed", 1)
    assert "pvc://recordings/a.bag can't be read" in row["message"]


@pytest.mark.parametrize("asked_again", [False, True])
def test_storage_that_did_not_answer_may_answer_the_next_try(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch, asked_again: bool
) -> None:
    real = LocalSink.commit
    lost = [TransientError("HDFS did not answer in 30 s")]

    def commit(sink: LocalSink) -> None:
        if not lost:
            return real(sink)
        if asked_again:
            persistently(_raised(lost.pop()), Patience(tries=1), Clock())
        raise lost.pop()

    monkeypatch.setattr(LocalSink, "commit", commit)
    row, _ = run(well_behaved(b"first"), well_behaved(b"second"))
    assert row["outcome"] == "passed"
    assert [run["reason"] for run in row["discarded"]] == ["StorageFailed"]
    assert len(kept(context)) == 1


def _raised(error: OSError) -> Callable[[], None]:
    def ask() -> None:
        raise error

    return ask


def test_storage_that_never_answers_has_three_tries(
    context: RunContext, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unanswered(*_: object) -> Row:
        with storage_errors("hdfs://namenode/a.bag", "written"):
            raise TransientError("the connection to HDFS broke or was refused")

    monkeypatch.setattr(case_run, "_played", unanswered)
    row = run_case(case, context)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StorageFailed", 3)
    assert "hdfs://namenode/a.bag can't be written" in row["message"]


# Promise: no-evidence-no-pass
def test_nothing_played_or_recorded_is_invalid_and_never_passed() -> None:
    silent = copy.deepcopy(RESULT)
    silent["recorded"]["messages"] = 0
    assert judge(silent).reason == "NothingRecorded"
    empty = copy.deepcopy(RESULT)
    empty["ledger"] |= {"sent": 0, "topics": []}
    assert (judge(empty).outcome, judge(empty).reason) == ("invalid", "NothingPlayed")


def test_a_volume_that_stays_full_is_named_as_such(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(attempts_module, "FULL_VOLUME_PAUSES", (0.0,))
    monkeypatch.setattr(NewFile, "write", _no_space)
    row, _ = run(well_behaved(b"recorded"), well_behaved(b"recorded"))
    assert (row["reason"], row["attempts"]) == ("StorageFull", 2)
    assert row["message"].endswith("can't be written: No space left on device")
    assert kept(context) == []


def _no_space(file: NewFile, _data: bytes) -> None:
    with storage_errors(file.uri, "written"):
        raise OSError(errno.ENOSPC, "No space left on device")


def test_a_slot_that_vanishes_is_tried_again_and_not_blamed_on_storage(
    case: Case, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = make_slot(Path(context.shared))
    (folder / "lease").unlink()
    monkeypatch.setattr(case_run, "_MEETING_SECONDS", 0.05)
    row = run_case(case, context)
    assert (row["reason"], row["attempts"]) == ("SlotUnavailable", 3)
    assert "lease" in row["message"]


def test_a_fault_of_ours_costs_one_case(
    case: Case, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> Row:
        raise KeyError("ledger")

    monkeypatch.setattr(case_run, "_played", broken)
    row = run_case(case, context)
    assert (row["outcome"], row["reason"]) == ("errored", "Internal")
    assert row["message"] == "KeyError: 'ledger'"


def test_steps_travel_with_the_case_with_their_deadlines_in_seconds(
    case: Case, context: RunContext
) -> None:
    step = {"trigger": "/scan", "answer": "/out", "deadline": "500ms"}
    spec = make_spec(playback={"mode": "lockstep", "steps": [step]})
    playback = case_map(case, dataclasses.replace(context, spec=spec))["playback"]
    assert playback["mode"] == "lockstep"
    assert playback["steps"] == [
        {"trigger": "/scan", "answer": "/out", "deadline": 0.5, "by": "count", "optional": False}
    ]


@pytest.mark.parametrize(
    ("reason", "attempts"),
    [
        ("AgentDied", 3),
        ("MessagesLost", 1),
        ("StackCrashed", 1),
        ("StackExited", 1),
        ("StorageFailed", 1),
        ("", 1),
    ],
)
def test_only_what_may_pass_is_tried_again(reason: str, attempts: int) -> None:
    tries = [next_attempt(reason, [reason] * before) for before in range(attempts + 2)]
    assert tries == [Again(0.0, about=False)] * (attempts - 1) + [None] * 3


def test_storage_that_may_answer_later_is_bounded_as_the_others_are() -> None:
    reason = "StorageFailed"
    tries = [next_attempt(reason, [reason] * n, may_pass=True) for n in range(3)]
    assert tries == [Again(), Again(), None]


def test_each_fault_has_an_allowance_of_its_own() -> None:
    earlier = ["MachineBusy"] * 5 + ["AgentDied"] * 2
    assert next_attempt("SlotUnavailable", earlier) == Again()
    assert next_attempt("AgentDied", earlier) is None
    assert next_attempt("MachineBusy", earlier) is None
    assert next_attempt("StorageFull", earlier) == Again(1.0)


def test_a_busy_machine_gets_ever_more_time() -> None:
    pauses = [next_attempt("MachineBusy", ["MachineBusy"] * n) for n in range(6)]
    assert pauses == [*(Again(s, about=True) for s in (0.0, 2.0, 8.0, 16.0, 32.0)), None]


def test_cases_that_disturb_each_other_pause_for_different_times(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waited: list[float] = []
    monkeypatch.setattr(threading.Event, "wait", lambda _, seconds: waited.append(seconds))
    for _ in range(100):
        case_run._pause(Again(8.0, about=True))
    assert 4.0 <= min(waited) < 5.0
    assert 11.0 < max(waited) <= 12.0
    waited.clear()
    case_run._pause(Again(8.0))
    assert waited == [8.0]


def test_a_full_volume_gets_a_minute() -> None:
    pauses = [next_attempt("StorageFull", ["StorageFull"] * n) for n in range(7)]
    assert sum(again.seconds for again in pauses if again) == 61
    assert pauses[-1] is None


def test_a_full_volume_is_tried_again_and_then_passes(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = NewFile.write
    errors = [OSError(errno.ENOSPC, "No space left on device")]

    def write(file: NewFile, data: bytes) -> None:
        if errors:
            with storage_errors(file.uri, "written"):
                raise errors.pop()
        real(file, data)

    monkeypatch.setattr(attempts_module, "FULL_VOLUME_PAUSES", (0.0,) * 6)
    monkeypatch.setattr(NewFile, "write", write)
    row, _ = run(well_behaved(), well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert len(kept(context)) == 1


def test_a_busy_machine_that_measured_nothing_costs_one_case(
    case: Case, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    def busy(*_: Any) -> Answer:
        raise SessionError("MachineBusy", "too busy")

    waited: list[Again] = []
    monkeypatch.setattr(case_run, "_pause", waited.append)
    monkeypatch.setattr(case_run, "_answered", busy)
    row = run_case(case, context)
    assert (row["outcome"], row["reason"]) == ("errored", "MachineBusy")
    assert (row["attempts"], [each.seconds for each in waited]) == (6, [0.0, 2.0, 8.0, 16.0, 32.0])
