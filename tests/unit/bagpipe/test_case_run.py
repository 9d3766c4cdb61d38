"""A case from lease to row, against an agent that fails in every way it can."""

import copy
import dataclasses
import errno
from collections.abc import Callable
from pathlib import Path

import pytest

from bagpipe.pipe.frames import FrameType
from bagpipe.plan.cases import Case, plan
from bagpipe.run import attempts as attempts_module
from bagpipe.run import case_run
from bagpipe.run.attempts import Again, next_attempt, quarantine_attempt
from bagpipe.run.case_run import Row, RunContext, case_map, run_case
from bagpipe.run.fragment_stream import fragment_file
from bagpipe.run.judge import DeliveryIncompleteError, judge
from bagpipe.storage import NewFile, Patience, Storage
from bagpipe.storage.backend import TransientError
from bagpipe.storage.faults import told
from bagpipe.storage.local import LocalSink
from bagpipe.storage.retries import Clock, persistently
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


def test_a_lost_message_runs_the_case_again_and_its_bag_never_counts(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    lossy = copy.deepcopy(RESULT)
    lossy["ledger"]["topics"][0]["subscribers"][0] |= {"received": 2, "dropped": 1}

    def losing(agent: FakeAgent) -> None:
        with monkeypatch.context() as patched:
            patched.setattr("tests.unit.bagpipe.fake_agent.RESULT", lossy)
            well_behaved(b"lossy")(agent)

    row, _ = run(losing, well_behaved(b"whole"))
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert len(kept(context)) == 1


def test_ten_losses_are_an_error_that_names_the_node(
    context: RunContext, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    lossy = copy.deepcopy(RESULT)
    lossy["ledger"]["topics"][0]["subscribers"][0] |= {"received": 2, "dropped": 1}

    def losing(*_: object) -> Row:
        judge(lossy)
        raise AssertionError

    monkeypatch.setattr(case_run, "_played", losing)
    row = run_case(case, context)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "DeliveryIncomplete", 10)
    assert "/stack processed 2 of 3" in row["message"]
    # Beside `result`, whose ledgers are summed over the cases that count.
    assert (row["result"], row["evidence"]) == (None, {"ledger": lossy["ledger"]})


def test_the_evidence_of_a_try_that_was_lossy_goes_with_it(
    run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    lossy = copy.deepcopy(RESULT)
    lossy["ledger"]["topics"][0]["subscribers"][0] |= {"received": 2, "dropped": 1}

    def losing(agent: FakeAgent) -> None:
        with monkeypatch.context() as patched:
            patched.setattr("tests.unit.bagpipe.fake_agent.RESULT", lossy)
            well_behaved(b"lossy")(agent)

    row, _ = run(losing, well_behaved(b"whole"))
    assert row["discarded"] == ["DeliveryIncomplete"]
    assert "evidence" not in row


def test_a_dead_agent_is_met_again(run: Run) -> None:
    row, _ = run(dying, well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert (row["discarded"], row["starts"]) == (["AgentDied"], 1)


def test_a_crashed_stack_is_an_error_with_its_stderr_and_is_not_repeated(
    run: Run, context: RunContext
) -> None:
    row, _ = run(aborting("StackExited", "the stack ended with status 3", ["boom"]))
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StackExited", 1)
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
    assert (row["outcome"], row["discarded"]) == ("passed", ["StorageFailed"])
    assert len(kept(context)) == 1


def _raised(error: OSError) -> Callable[[], None]:
    def ask() -> None:
        raise error

    return ask


def test_storage_that_never_answers_has_three_tries(
    context: RunContext, case: Case, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unanswered(*_: object) -> Row:
        with told("hdfs://namenode/a.bag", "written"):
            raise TransientError("the connection to HDFS broke or was refused")

    monkeypatch.setattr(case_run, "_played", unanswered)
    row = run_case(case, context)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StorageFailed", 3)
    assert "hdfs://namenode/a.bag can't be written" in row["message"]


def test_nothing_played_or_recorded_is_invalid_and_never_passed() -> None:
    silent = copy.deepcopy(RESULT)
    silent["recorded"]["messages"] = 0
    assert judge(silent).reason == "NothingRecorded"
    empty = copy.deepcopy(RESULT)
    empty["ledger"] |= {"sent": 0, "topics": []}
    assert (judge(empty).outcome, judge(empty).reason) == ("invalid", "NothingPlayed")


@pytest.mark.parametrize("change", [{"received": 2}, {"dropped": 1}, {"received": 4}])
def test_any_mismatch_in_the_ledger_is_no_delivery(change: dict[str, int]) -> None:
    result = copy.deepcopy(RESULT)
    result["ledger"]["topics"][0]["subscribers"][0] |= change
    with pytest.raises(DeliveryIncompleteError, match="/stack processed"):
        judge(result)


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
    with told(file.uri, "written"):
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
    ("reason", "mode", "attempts"),
    [
        ("DeliveryIncomplete", "realtime", 10),
        ("DeliveryIncomplete", "max", 3),
        ("AgentDied", "realtime", 3),
        ("StackExited", "realtime", 1),
        ("StorageFailed", "realtime", 1),
        ("", "realtime", 1),
    ],
)
def test_only_what_may_pass_is_tried_again(reason: str, mode: str, attempts: int) -> None:
    tries = [next_attempt(reason, [reason] * before, mode) for before in range(attempts)]
    assert tries == [Again()] * (attempts - 1) + [None]


@pytest.mark.parametrize(("limit", "attempts"), [(None, 3), (0, 1), (4, 5)])
def test_storage_that_may_answer_later_is_bounded_as_the_others_are(
    limit: int | None, attempts: int
) -> None:
    reason = "StorageFailed"
    tries = [next_attempt(reason, [reason] * n, "max", limit, True) for n in range(attempts)]
    assert tries == [*[Again()] * (attempts - 1), None]


def test_each_fault_has_an_allowance_of_its_own() -> None:
    earlier = ["DeliveryIncomplete"] * 9 + ["AgentDied"] * 2
    assert next_attempt("SlotUnavailable", earlier, "realtime") == Again()
    assert next_attempt("AgentDied", earlier, "realtime") is None
    assert next_attempt("DeliveryIncomplete", earlier, "realtime") is None
    assert next_attempt("StorageFull", earlier, "realtime") == Again(1.0)


@pytest.mark.parametrize(
    ("reason", "limit", "attempts"),
    [
        ("DeliveryIncomplete", 0, 1),
        ("DeliveryIncomplete", 4, 5),
        ("AgentDied", 1, 2),
        ("StackExited", 2, 3),
        ("NeverSubscribed", 1, 2),
        ("CaseDeadlineExceeded", 1, 2),
        ("BagUnreadable", 5, 1),
        ("StorageFailed", 5, 1),
    ],
)
def test_the_stack_s_backoff_limit_is_the_number_of_further_tries(
    reason: str, limit: int, attempts: int
) -> None:
    tried = [next_attempt(reason, [reason] * n, "realtime", limit) for n in range(attempts)]
    assert tried == [*[Again()] * (attempts - 1), None]


def test_the_limit_reaches_the_executors(context: RunContext, case: Case) -> None:
    limited = dataclasses.replace(context, spec=make_spec(stackBackoffLimit=2))
    crashes = [aborting("StackExited", "the stack ended with status 3", ["boom"])] * 3
    with FakeAgent(make_slot(Path(context.shared)), *crashes):
        row = run_case(case, limited)
    assert (row["outcome"], row["reason"], row["attempts"]) == ("errored", "StackExited", 3)


@pytest.mark.parametrize(("limit", "number"), [(None, 4), (0, 2), (2, 4), (20, 22)])
def test_a_case_is_given_up_after_one_lost_executor_more_than_the_limit(
    limit: int | None, number: int
) -> None:
    assert quarantine_attempt(limit) == number


def test_a_full_volume_gets_a_minute() -> None:
    pauses = [next_attempt("StorageFull", ["StorageFull"] * n, "realtime") for n in range(7)]
    assert sum(again.seconds for again in pauses if again) == 61
    assert pauses[-1] is None


def test_a_full_volume_is_tried_again_and_then_passes(
    run: Run, context: RunContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    real = NewFile.write
    said = [OSError(errno.ENOSPC, "No space left on device")]

    def write(file: NewFile, data: bytes) -> None:
        if said:
            with told(file.uri, "written"):
                raise said.pop()
        real(file, data)

    monkeypatch.setattr(attempts_module, "FULL_VOLUME_PAUSES", (0.0,) * 6)
    monkeypatch.setattr(NewFile, "write", write)
    row, _ = run(well_behaved(), well_behaved())
    assert (row["outcome"], row["attempts"]) == ("passed", 2)
    assert len(kept(context)) == 1
